"""Microstructure of stored runs: which frames are taken, units, and what is said where data are missing."""

from __future__ import annotations

import math

import numpy as np
import pytest
from lattices import spheres
from scipy.integrate import quad
from synthetic_runs import EDGE, configuration, oscillatory_record, stress, write_run

from suspend.analysis.microstructure import (
    Contacts,
    Frames,
    NearestNeighbourGraph,
    NeighbourDistances,
    PairDistribution,
    compute_together,
    first,
    last,
    microstructure,
    read_snapshot,
    spaced,
)
from suspend.analysis.microstructure.snapshot import accumulated_strain
from suspend.errors import ConfigurationError, StorageError
from suspend.io import Run, RunStore

FLOW = {"type": "oscillatory", "amplitude": 0.5, "omega": 2.0}
SCALES = {"gamma0": 0.5, "omega": 2.0, "viscosity": 2.0, "phase": 0.0}
PARTS = {
    "hydrodynamic": lambda theta: stress(np.cos(theta)),
    "interparticle": lambda theta: stress(0.0 * theta),
}


def stored(path, positions, final=None):
    """A run with one frame per cycle, at phase 0, of the given positions (N,3) each."""
    config = configuration(FLOW, {"cycles": len(positions)}, number=len(positions[0]))
    records = [oscillatory_record(k, SCALES, PARTS, unwrapped=x) for k, x in enumerate(positions)]
    return write_run(path, config, records, final)


@pytest.fixture
def growing(tmp_path):
    """Ten frames and the final one of 60 pairs, the gap of frame k is 0.1 + 0.01 k."""
    middle = np.stack(np.meshgrid(*(np.arange(4),) * 3, indexing="ij"), axis=-1).reshape(-1, 3)[:60] * 7.5
    shots = [np.vstack([middle, middle + np.array([0.0, 2.1 + 0.01 * k, 0.0])]) for k in range(11)]
    return stored(tmp_path / "run", shots[:10], shots[10])


def test_frames_are_chosen_and_read_once_each(growing):
    """First, last and spaced frames, each read into units of the radius; gamma_tot = 4 gamma0 n_cyc."""
    with Run(growing) as run:
        early, late, path = (NeighbourDistances(f, count=1) for f in (first(2), last(3), spaced(5)))
        compute_together(run, [early, late, path])
        assert early.per_frame[:, 0] == pytest.approx([2.10, 2.11])
        assert late.per_frame[:, 0] == pytest.approx([2.18, 2.19, 2.20])
        assert path.total_strain[[0, -1]] == pytest.approx([0.0, 4 * 0.5 * 10], abs=0.1)  # the final frame is early
        assert np.all(np.diff(path.total_strain) > 0)
        assert Contacts(last(1)).compute(run).smallest_gap == pytest.approx([0.2])
        assert read_snapshot(run, -1).length == EDGE


def test_other_radii_are_brought_to_units_of_the_radius(tmp_path):
    """A run with spheres of radius 2: the cell and the distances are read in radii."""
    x = spheres(np.random.default_rng(0), 30, EDGE / 2) * 2.0
    config = configuration(FLOW, {"cycles": 1}, number=30, radius=2.0)
    with RunStore.create(tmp_path / "run", config, {"number": 30, "L": EDGE, "radius": 2.0}) as store:
        store.append_cycle(oscillatory_record(0, SCALES, PARTS, unwrapped=x))
    with Run(tmp_path / "run") as run:
        shot = read_snapshot(run, 0)
    assert shot.length == EDGE / 2
    assert 2.0 <= shot.nearest(1)[0].min() < 2.3


def test_a_file_without_the_radius_is_refused(tmp_path):
    with RunStore.create(tmp_path / "run", configuration(FLOW, {"cycles": 1}), {"number": 4, "L": EDGE}) as store:
        store.append_cycle(oscillatory_record(0, SCALES, PARTS))
    with Run(tmp_path / "run") as run, pytest.raises(StorageError, match="does not say the radius and the edge"):
        PairDistribution().compute(run)


@pytest.mark.parametrize("phase", [0.0, 0.7, math.pi / 2, -1.0])
def test_accumulated_strain_is_the_integral_of_the_rate(phase):
    """Against quadrature of |gamma0 omega cos(omega t + phase)|; steady shear: rate times time."""
    flow = {"type": "oscillatory", "amplitude": 0.8, "omega": 2.0, "phase": phase}
    for time in (0.0, 0.3, 1.7, 9.1):
        kinks = (np.arange(-2, 9) * math.pi + math.pi / 2 - phase) / 2.0
        inside = kinks[(kinks > 0) & (kinks < time)]
        expected = quad(lambda t: abs(1.6 * math.cos(2.0 * t + phase)), 0.0, time, points=inside, epsabs=1e-12)[0]
        assert accumulated_strain({"flow": flow}, time) == pytest.approx(expected, abs=1e-9)
    assert accumulated_strain({"flow": {"type": "steady", "rate": -2.0}}, 3.0) == 6.0
    with pytest.raises(StorageError, match="not usable"):
        accumulated_strain({"flow": {"type": "oscillatory"}}, 1.0)


def test_a_phase_without_frames_is_named(growing):
    with Run(growing) as run, pytest.raises(ConfigurationError, match=r"at phase 0.25 of the cycle, only at 0"):
        PairDistribution(last(phase=0.25)).compute(run)


def test_spaced_frames_hold_both_ends_and_never_repeat():
    for n in (1, 2, 3, 40, 641):
        chosen = Frames("spaced", 24).select(np.zeros(n))
        assert chosen[0] == 0
        assert chosen[-1] == n - 1
        assert len(set(chosen.tolist())) == len(chosen) <= 24
    assert Frames("last", 8).select(np.array([0.0, 0.5, 0.0, 0.5])).tolist() == [0, 2]
    assert Frames("last", 3, None).select(np.array([0.0, 0.5, 0.0, 0.5])).tolist() == [1, 2, 3]
    with pytest.raises(ConfigurationError, match="no position frames"):
        first().select(np.empty(0))


def test_overview_of_a_dense_run_of_one_cycle(tmp_path):
    """All quantities in one pass; first and last of a single frame are the same numbers."""
    x = spheres(np.random.default_rng(1), 400, EDGE)
    with Run(stored(tmp_path / "run", [x])) as run:
        result = microstructure(run)
        alone = NearestNeighbourGraph().compute(run)
    assert result.notes == ()
    assert np.array_equal(result["graph_last"].shapes, alone.shapes)
    summary = result.summary()
    assert summary["r1[a]"] == summary["initial_r1[a]"] > 2.0
    assert summary["beta_fit"].startswith("none")
    for name, quantity in result.quantities.items():
        assert len({len(column) for column in quantity.table().values()}) == 1, name


def test_two_spheres_and_one_sphere_say_what_is_missing(tmp_path):
    """N = 2: one cluster of shape sqrt(1 + 5 r^2/8), one neighbour, no peak of g; N = 1: nothing, and why."""
    two = np.array([[1.0, 1.0, 1.0], [1.0, 3.1, 1.0]])
    with Run(stored(tmp_path / "two", [two])) as run:
        result = microstructure(run)
    assert result["graph_last"].shapes == pytest.approx([math.sqrt(1 + 0.625 * 2.1**2)])
    assert result["distances_last"].distance == pytest.approx([2.1])
    with Run(stored(tmp_path / "one", [two[:1]])) as run:
        result = microstructure(run)
    assert "pair distribution last: one sphere has no neighbours" in result.notes


def test_an_empty_run_is_refused(tmp_path):
    with RunStore.create(tmp_path / "run", configuration(FLOW, {"cycles": 1}), {"number": 4, "L": EDGE, "radius": 1.0}):
        pass
    with Run(tmp_path / "run") as run, pytest.raises(ConfigurationError, match="no position frames"):
        microstructure(run)
