"""Shipped configurations show what their comments say."""

from pathlib import Path

import numpy as np
import pytest

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
