"""Gaps of nearly touching pairs over large steps, against exact motion of a pair."""

import numpy as np
import pytest

from suspend.errors import NumericalError
from suspend.gaps import CloseGaps
from suspend.integrators import METHODS, interpolate, take_step

EDGE, TURN, PRESS = 20.0, 1.0, 12.0  # cell edge; angular velocity of the pair; approach rate -d(ln h)/dt
PAIRS = np.array([[0, 1, 0, 0, 0]], np.int32)


def pair(gap):
    """Two spheres along (3, 4, 0)/5 at the middle of the cell."""
    half = 0.5 * (2.0 + gap) * np.array([0.6, 0.8, 0.0])
    return np.array([10.0 - half, 10.0 + half])


def velocities(position, _time=0.0):
    """Rotation about z with TURN and approach at PRESS times the gap: h = h0 exp(-PRESS t), exactly."""
    d = position[1] - position[0]
    r = np.linalg.norm(d)
    relative = TURN * np.cross([0.0, 0.0, 1.0], d) - PRESS * (r - 2.0) * d / r
    result = np.zeros((2, 6))
    result[0, :3], result[1, :3] = -0.5 * relative, 0.5 * relative
    return result


def gaps_of(position):
    return CloseGaps(PAIRS, position, EDGE, 0.0, lambda time: 0.0, lambda time: 0.0)


def step(gap, size, method="bogacki-shampine", keep=True):
    position = pair(gap)
    kept = gaps_of(position) if keep else None
    return position, take_step(
        METHODS[method], velocities, lambda time: 0.0, position, velocities(position), 0.0, size, kept
    )


def gap_of(position):
    return np.linalg.norm(position[1] - position[0]) - 2.0


@pytest.mark.parametrize("method", ["bogacki-shampine", "tsitouras", "rk4"])
def test_gap_of_a_turning_pair(method):
    """h = h0 exp(-PRESS t) after a step of 0.1, from 1e-9 a, where the step's own error in position is 1e-6: to the
    1 % that gaps are held to. Without the gaps' own equation the spheres overlap or part by far more than h.
    """
    _, taken = step(1e-9, 0.1, method)
    assert gap_of(taken.position) == pytest.approx(1e-9 * np.exp(-PRESS * 0.1), rel=0.011)
    _, plain = step(1e-9, 0.1, method, keep=False)
    assert abs(gap_of(plain.position) - 1e-9 * np.exp(-PRESS * 0.1)) > 1e-8


def test_direction_and_centre_are_those_of_the_plain_step():
    """Holding the gap moves the spheres along the line of centres only, by about the step's error (1e-5 estimated)."""
    _, taken = step(1e-6, 0.05)
    _, plain = step(1e-6, 0.05, keep=False)
    assert np.allclose(taken.position.mean(axis=0), plain.position.mean(axis=0), atol=1e-14)
    assert np.abs(taken.position - plain.position).max() < 5e-5
    turned = np.arctan2(*(taken.position[1] - taken.position[0])[[1, 0]])
    assert turned == pytest.approx(np.arctan2(4, 3) + 0.05 * TURN, abs=1e-6)


def test_interpolated_positions_keep_the_gap():
    """Within the step ln h is interpolated, exactly so where its rate is constant."""
    position, taken = step(1e-9, 0.1)
    start, end = (0.0, position, velocities(position)), (0.1, taken.position, taken.velocity)
    for fraction in (0.3, 0.5, 0.9):
        found = interpolate(lambda time: 0.0, start, end, fraction, taken.gaps)
        assert gap_of(found) == pytest.approx(1e-9 * np.exp(-PRESS * 0.1 * fraction), rel=0.02)


def test_rates_count_the_affine_motion():
    """d(ln h)/dt of a pair carried by shear alone: shear_rate d_x d_y/(r h)."""
    position = pair(1e-4)
    gaps = CloseGaps(PAIRS, position, EDGE, 0.0, lambda time: 0.0, lambda time: 2.0)
    expected = 2.0 * 0.6 * 0.8 * 2.0001 / 1e-4
    assert gaps.rates(position, 0.0, np.zeros((2, 6)))[0] == pytest.approx(expected, rel=1e-9)


def test_chain_of_touching_spheres():
    """Five spheres in a row, every gap 1e-8, all to be brought to 2e-9: sweeps over the chain converge."""
    position = np.column_stack([5.0 + (2.0 + 1e-8) * np.arange(5), np.full(5, 7.0), np.full(5, 9.0)])
    pairs = np.array([[i, i + 1, 0, 0, 0] for i in range(4)], np.int32)
    gaps = CloseGaps(pairs, position, EDGE, 0.0, lambda time: 0.0, lambda time: 0.0)
    position[2, 0] += 3e-7  # what a step's error does
    gaps.hold(position, 0.0, np.full(4, np.log(0.2)))
    assert np.allclose(np.diff(position[:, 0]) - 2.0, 2e-9, rtol=0.011)


def test_wide_gaps_are_left_alone():
    """No pair closer than 1e-3 a: nothing to keep."""
    assert len(gaps_of(pair(2e-3))) == 0


def test_a_gap_below_double_precision_is_an_error():
    """Below 1e-12 a positions cannot tell the gap: the run stops and says what to do."""
    with pytest.raises(NumericalError, match=r"lubrication\.minimum_gap"):
        step(1e-11, 0.4)
