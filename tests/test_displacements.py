"""Displacements over a cycle and a part of it, and the active fraction, from stored runs with known motion."""

from __future__ import annotations

import math

import numpy as np
import pytest
from synthetic_runs import EDGE, configuration, oscillatory_record, steady_record, stress, write_run

from suspend.analysis.activity import ActiveFraction
from suspend.analysis.displacements import CyclicDiffusivity, DisplacementCloud
from suspend.errors import ConfigurationError, StorageError
from suspend.io import Run

SCALES = {"gamma0": 0.8, "omega": 2.0, "viscosity": 2.0, "phase": 0.0, "radius": 1.5}
FLOW = {"type": "oscillatory", "amplitude": 0.8, "omega": 2.0, "phase": 0.0}


def rest(theta: np.ndarray) -> np.ndarray:
    return stress(np.zeros(len(theta)))


def record_of(index: int, phases: list[float], positions: np.ndarray, scales: dict = SCALES) -> dict:
    """A cycle without stress whose positions at `phases` are `positions` (phases, N, 3)."""
    record = oscillatory_record(index, scales, {"hydrodynamic": rest, "interparticle": rest}, 20, positions[0])
    theta = 2.0 * np.pi * np.array(phases) + scales["phase"]
    strain = scales["gamma0"] * np.sin(theta)
    image = np.floor(positions / EDGE).astype(np.int32)
    return record | {
        "frame_time": record["time"][0] + np.array(phases) * 2.0 * np.pi / scales["omega"],
        "frame_strain": strain,
        "frame_phase": np.array(phases),
        "tilt": strain - np.floor(strain + 0.5),
        "position": positions - image * EDGE,
        "image": image,
        "unwrapped": positions,
    }


def run_of(path, walk: np.ndarray, final: np.ndarray | None, phases=(0.0,), scales: dict = SCALES):
    """A stored run: walk (cycles, phases, N, 3) and the positions at its end, or None while it goes on."""
    records = [record_of(k, list(phases), positions, scales) for k, positions in enumerate(walk)]
    flow = FLOW | {"phase": scales["phase"]}
    config = configuration(flow, {"cycles": max(len(walk), 1)}, walk.shape[2], scales["radius"])
    return write_run(path, config, records, final)


def test_diffusion_tensor_of_random_walkers(tmp_path):
    """Gaussian steps of covariance 2 D_ab 4 gamma0 a^2 return D_ab within 4 standard errors, and its trace as D_cyc.

    The variance of a product of two Gaussians is C_aa C_bb + C_ab^2. The error over spheres that is reported must agree
    with the exact sqrt of the variance of Delta^2, 2 tr(C^2), itself: sampled to 5 % with 4000 spheres (kurtosis).
    """
    number, cycles = 4000, 5
    tensor = np.array([[5.0, -1.5, 0.0], [-1.5, 2.0, 0.4], [0.0, 0.4, 1.0]]) * 1e-3
    covariance = tensor * 8.0 * SCALES["gamma0"] * SCALES["radius"] ** 2
    steps = np.random.default_rng(1).multivariate_normal(np.zeros(3), covariance, (cycles, number))
    walk = 50.0 + np.cumsum(steps, axis=0)
    start = np.full((1, number, 3), 50.0)
    path = run_of(tmp_path / "run", np.concatenate([start, walk[:-1]])[:, None], walk[-1])
    with Run(path) as run:
        found = CyclicDiffusivity().compute(run)
    spread = np.sqrt((np.outer(np.diag(tensor), np.diag(tensor)) + tensor**2) / (number * cycles))
    assert np.all(np.abs(found.tensor.mean(axis=0) - tensor) < 4.0 * spread + np.abs(tensor) / number)
    np.testing.assert_allclose(found.d_cyc, found.tensor.trace(axis1=1, axis2=2), rtol=1e-14)
    np.testing.assert_allclose(found.standard_error, math.sqrt(2.0 * np.sum(tensor**2) / number), rtol=0.1)
    np.testing.assert_allclose(found.total_strain, 3.2 * np.arange(1, 6), rtol=1e-14)
    table = found.table()
    np.testing.assert_array_equal(table["D_xy[-]"], found.tensor[:, 0, 1])
    assert found.summary()["D_cyc"] == found.d_cyc[-1] and found.notes == []


def test_cloud_of_half_a_cycle_has_the_given_axes(tmp_path):
    """Four spheres displaced by +-3 d along an axis at -30 degrees and +-d across it: axes, angle, elongation 3.

    The second half cycle turns the cloud round (Delta -> -Delta), here exactly, so that the whole cycle has none.
    """
    axis = np.array([math.cos(math.radians(-30.0)), math.sin(math.radians(-30.0)), 0.0])
    across = np.array([-axis[1], axis[0], 0.0])
    cloud = 0.15 * np.array([3.0 * axis, -3.0 * axis, across, -across])
    start = np.random.default_rng(2).random((4, 3)) * 20.0
    path = run_of(tmp_path / "run", np.array([[start, start + cloud]]), start, (0.0, 0.5))
    with Run(path) as run:
        first = DisplacementCloud().compute(run)
        second = DisplacementCloud(cycle=-1, start=0.5, stop=1.0).compute(run)
        whole = DisplacementCloud(stop=1.0).compute(run)
    np.testing.assert_allclose(first.displacements, cloud / 1.5, atol=1e-14)
    np.testing.assert_allclose(second.displacements, -cloud / 1.5, atol=1e-14)
    np.testing.assert_allclose(whole.displacements, 0.0, atol=1e-14)
    assert first.inclination == pytest.approx(-30.0, abs=1e-9) and first.elongation == pytest.approx(3.0, rel=1e-9)
    np.testing.assert_allclose(first.principal, [0.3 / math.sqrt(2), 0.1 / math.sqrt(2), 0.0], atol=1e-12)
    assert math.isnan(whole.elongation) and first.notes == []
    assert set(first.table()) == {"delta_x[a]", "delta_y[a]", "delta_z[a]"}


def test_cloud_between_different_strains_is_free_of_the_flow(tmp_path):
    """With an initial phase the strain changes over half a cycle: spheres that follow the flow leave no cloud."""
    scales = SCALES | {"phase": 0.3}
    start = np.random.default_rng(3).random((6, 3)) * 20.0
    shear = -2.0 * 0.8 * math.sin(0.3)
    half = start + shear * start[:, [1]] * [1.0, 0.0, 0.0]
    path = run_of(tmp_path / "run", np.array([[start, half]]), start, (0.0, 0.5), scales)
    with Run(path) as run:
        cloud = DisplacementCloud().compute(run)
    assert np.abs(half - start).max() > 1.0 and np.abs(cloud.displacements).max() < 1e-13
    assert any("strain differs" in note for note in cloud.notes)


def test_active_fraction_counts_spheres_beyond_the_threshold(tmp_path):
    """3, 2 and 0 of 10 spheres move by 0.02 a in the three cycles, the rest by 0.001 a; all drift together.

    Displacements are measured from their mean, at most 0.006 a here, which moves no sphere across the threshold.
    """
    start, walk = np.random.default_rng(4).random((10, 3)) * 20.0, []
    for active in (3, 2, 0):
        step = np.where(np.arange(10) < active, 0.02, 0.001)[:, None] * [0.0, 1.5, 0.0]
        walk.append(start)
        start = start + step + [0.7, -0.4, 0.1]
    path = run_of(tmp_path / "run", np.array(walk)[:, None], start)
    with Run(path) as run:
        found = ActiveFraction(0.01).compute(run)
        assert ActiveFraction(0.03).compute(run).fraction.tolist() == [0.0, 0.0, 0.0]
    assert found.fraction.tolist() == [0.3, 0.2, 0.0]
    np.testing.assert_allclose(found.standard_error, [math.sqrt(0.021), math.sqrt(0.016), 0.0], atol=1e-15)
    assert found.summary()["threshold[a]"] == 0.01 and found.notes == []


def test_threshold_near_the_step_error_is_said(tmp_path):
    """Where the run's own estimate of the position error comes near the threshold, the result says so."""
    walk = np.zeros((1, 1, 4, 3))
    record = record_of(0, [0.0], walk[0])
    record["statistics"] = record["statistics"] | {"position_error": 0.004}
    path = write_run(tmp_path / "run", configuration(FLOW, {"cycles": 1}, 4, 1.5), [record], walk[0, 0])
    with Run(path) as run:
        assert "position error" in ActiveFraction(0.01).compute(run).notes[0]
        assert ActiveFraction(0.02).compute(run).notes == []


def test_what_is_missing_is_said(tmp_path):
    """Unfinished, one sphere, no oscillation, phase not stored, no such cycle, impossible phases: note or error."""
    walk = np.random.default_rng(5).random((3, 1, 4, 3))
    with Run(run_of(tmp_path / "open", walk, None)) as run:
        found = CyclicDiffusivity().compute(run)
        assert len(found.d_cyc) == 2 and "1 cycle(s)" in found.notes[0]
        with pytest.raises(ConfigurationError, match=r"position_phases: \[0.0, 0.5\]"):
            DisplacementCloud().compute(run)
        with pytest.raises(StorageError, match="not stored"):
            DisplacementCloud(cycle=-1, stop=1.0).compute(run)
        with pytest.raises(ConfigurationError, match="no cycle 3"):
            DisplacementCloud(cycle=3).compute(run)
    with Run(run_of(tmp_path / "lone", walk[:, :, :1], walk[0, 0, :1])) as run:
        for quantity in (CyclicDiffusivity(), ActiveFraction(), DisplacementCloud()):
            with pytest.raises(ConfigurationError, match="1 sphere"):
                quantity.compute(run)
    steady = steady_record(0, {"rate": 1.0, "viscosity": 2.0}, np.zeros((8, 6)))
    config = configuration({"type": "steady", "rate": 1.0}, {"strain": 1.0})
    with (
        Run(write_run(tmp_path / "steady", config, [steady], np.zeros((4, 3)))) as run,
        pytest.raises(ConfigurationError, match="SelfDiffusion"),
    ):
        CyclicDiffusivity().compute(run)
    for wrong in ({"start": 0.5, "stop": 0.5}, {"stop": 1.2}, {"start": -0.1}):
        with pytest.raises(ConfigurationError, match="start < stop"):
            DisplacementCloud(**wrong)
    with pytest.raises(ConfigurationError, match="threshold"):
        ActiveFraction(0.0)


def test_run_of_no_complete_cycle(tmp_path):
    """Nothing stored yet: empty results, no error."""
    with Run(write_run(tmp_path / "run", configuration(FLOW, {"cycles": 3}), [])) as run:
        found = CyclicDiffusivity().compute(run)
        assert found.d_cyc.shape == (0,) and found.summary()["cycles"] == 0 and found.tensor.shape == (0, 3, 3)
        assert ActiveFraction().compute(run).fraction.size == 0
