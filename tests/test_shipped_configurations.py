"""Shipped configurations show what their comments say."""

from pathlib import Path

import numpy as np
import pytest

from suspend.analysis.summary import analyze
from suspend.config import load
from suspend.io import Run
from suspend.simulation import run

CONFIGS = Path(__file__).parents[1] / "configs"


def test_two_spheres_pass_each_other_as_two_spheres_alone(tmp_path):
    """Exact answer, from A(r) and B(r) of two spheres in unbounded fluid (integrated apart from the program): from
    y = 0.5 at x = -6 the smallest gap is 2.523e-4 a and y = 0.5 again at x = +6. 1 % of the gap and 1e-3 of y are left
    to the images in the cell of edge 40 a.
    """
    run(load(CONFIGS / "two_spheres.yaml"), tmp_path / "r")
    with Run(tmp_path / "r") as opened:
        distance = np.array([frame["unwrapped"][0] - frame["unwrapped"][1] for frame in opened.frames()])
        gap = opened.statistics()["minimum_gap"].min()
    np.testing.assert_allclose(distance[0], [-6.0, 0.5, 0.0], atol=1e-12)
    assert gap == pytest.approx(2.523e-4, rel=0.01)
    assert distance[-1, 0] > 6.0
    assert np.interp(6.0, distance[:, 0], distance[:, 1]) == pytest.approx(0.5, abs=1e-3)


def test_stored_d_cyc_takes_off_the_mean_drift_as_the_analysis_does(tmp_path):
    """Spheres that all sink under one force, radius 1.5: `cycles/statistics/d_cyc` is the mean square displacement
    relative to that of the centre, over 8 gamma0, and the same as D_cyc of the analysis; the absolute one is larger.
    """
    settings = ["particles.number=8", "particles.radius=1.5", "duration.cycles=2", "external.force=[0, 0, -1]"]
    run(load(CONFIGS / "demo.yaml", settings), tmp_path / "r")
    with Run(tmp_path / "r") as opened:
        stored = opened.statistics()["d_cyc"]
        x = np.array([frame["unwrapped"] for frame in opened.frames()]) / 1.5
    moved = np.diff(x, axis=0)
    relative = moved - moved.mean(axis=1, keepdims=True)
    np.testing.assert_allclose(stored, (relative**2).sum(axis=2).mean(axis=1) / 6.4, rtol=1e-7)
    np.testing.assert_allclose(stored, analyze(tmp_path / "r").d_cyc, rtol=1e-7)
    assert ((moved**2).sum(axis=2).mean(axis=1) / 6.4 > 2.0 * stored).all()
