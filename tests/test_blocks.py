"""Averages of steady and reversed shear over blocks with known stresses."""

from __future__ import annotations

import json

import numpy as np
import pytest
from synthetic_runs import configuration, oscillatory_record, steady_record, stress, write_run

from suspend.analysis.blocks import SteadyStresses, direction_begins
from suspend.analysis.summary import analyze
from suspend.errors import ConfigurationError
from suspend.io import Run

RATE = {"rate": 2.0, "viscosity": 2.0}
UNIT = 4.0  # eta0 rate


def reversed_run(path, blocks: int = 20, turn: int = 4):
    """sigma_xy of the spheres 3 eta0 rate before, 5 + noise after the reversal; N1 = -0.5, N2 = -1.5 after it."""
    random, records = np.random.default_rng(3), []
    for k in range(blocks):
        sign = 1.0 if k < turn else -1.0
        shear = 3.0 if k < turn else 5.0 + 0.1 * random.normal()
        normal = (0.0, 0.0, 0.0) if k < turn else (-2.0 * UNIT, -1.5 * UNIT, 0.0)
        records.append(steady_record(k, RATE, stress(np.full(32, UNIT * sign * shear), *normal), sign))
    flow = {"type": "reversal", "rate": 2.0, "reversal_strain": float(turn)}
    return write_run(path, configuration(flow, {"strain": float(blocks)}), records, np.zeros((4, 3)))


def test_averages_after_a_reversal(tmp_path):
    """Last half after the reversal: eta_r = 6 within four errors of 0.1/sqrt(8); N1/sigma = -0.5/6, N2/sigma -1.5/6."""
    path = reversed_run(tmp_path / "run")
    with Run(path) as run:
        found = SteadyStresses().compute(run)
    assert (found.begin, found.window) == (4, 8)
    np.testing.assert_allclose(found.viscosity[:4], 4.0, rtol=1e-12)
    np.testing.assert_allclose(found.normal("N2")[4:], -1.5, rtol=1e-12)
    np.testing.assert_allclose(found.normal("N2", "interparticle"), 0.0)
    averages = found.steady()
    assert averages["eta_r"].mean == pytest.approx(6.0, abs=0.14)
    assert 0.02 < averages["eta_r"].error < 0.08 and not averages["eta_r"].drifting
    assert averages["N1"].mean == pytest.approx(-0.5) and averages["N2_hydrodynamic"].mean == pytest.approx(-1.5)
    assert averages["N2_over_shear"].mean == pytest.approx(-1.5 / averages["eta_r"].mean, rel=1e-10)
    content = json.loads(json.dumps(found.summary()))
    assert content["blocks"] == 8 and content["averages"]["N1_over_shear"]["mean"] < 0.0
    assert len(found.table()["block"]) == len(found.total_strain) == 20
    with Run(path) as run, pytest.raises(ConfigurationError, match="last 17 of 16 blocks"):
        SteadyStresses(last=17).compute(run)


def test_analysis_prints_the_same(tmp_path):
    """`analyze` of the run: same averages, N2/|sigma_xy| on the screen and in JSON, no drift noted."""
    path = reversed_run(tmp_path / "run")
    result = analyze(path)
    with Run(path) as run:
        averages = SteadyStresses().compute(run).steady()
    assert result.averages()["eta_r[-]"]["standard_error"] == averages["eta_r"].error
    assert result.averages()["eta_r[-]"]["mean"] == averages["eta_r"].mean
    line = next(line for line in result.table().splitlines() if line.startswith("N2/|sigma_xy|"))
    assert f"{averages['N2_over_shear'].mean:.4g}" in line
    assert result.as_dict()["normal_stresses"]["averages"]["N2_over_shear"]["mean"] == averages["N2_over_shear"].mean
    assert not any("drift" in note for note in result.notes)


def test_direction_begins():
    """Index after the last change of sign."""
    assert direction_begins(np.array([1.0, 1.0])) == 0
    assert direction_begins(np.array([1.0, -1.0, -1.0, 1.0, 1.0])) == 3


def test_other_flows_and_empty_runs(tmp_path):
    """Oscillatory shear, or nothing stored: an error that says so."""
    scales = {"gamma0": 0.8, "omega": 2.0, "viscosity": 2.0, "phase": 0.0}
    silent = dict.fromkeys(("hydrodynamic", "interparticle"), lambda t: stress(np.zeros_like(t)))
    flow = {"type": "oscillatory", "amplitude": 0.8, "omega": 2.0}
    records = [oscillatory_record(0, scales, silent)]
    for path, message in (
        (write_run(tmp_path / "o", configuration(flow, {"cycles": 1}), records), "flow is oscillatory"),
        (write_run(tmp_path / "e", configuration({"type": "steady", "rate": 2.0}, {"strain": 2.0}), []), "no complete"),
    ):
        with Run(path) as run, pytest.raises(ConfigurationError, match=message):
            SteadyStresses().compute(run)


def test_plot(tmp_path):
    """One curve against strain."""
    from matplotlib.figure import Figure

    axes = Figure().add_subplot()
    with Run(reversed_run(tmp_path / "run")) as run:
        SteadyStresses().compute(run).plot(axes)
    assert len(axes.lines[0].get_xdata()) == 20 and axes.get_ylabel()
