"""Flow protocols against quadrature, and the cell's bookkeeping of images and flips."""

import math
from itertools import pairwise

import numpy as np
import pytest
from scipy.integrate import quad

from suspend.box import cell_vectors, edge_length, flip, flips_of, unwrap
from suspend.core.cell import wrap_and_count
from suspend.flow import Oscillatory, Steps

PHASES = (0.0, 0.3, math.pi / 2, 2.0, math.pi, 4.5, -1.0, -7.0, 20.0)


def integral(function, start, end, breaks):
    """Quadrature cut at `breaks`."""
    points = [start, *sorted(b for b in breaks if start < b < end), end]
    return sum(quad(function, a, b, epsabs=1e-13, epsrel=1e-13)[0] for a, b in pairwise(points))


@pytest.mark.parametrize("phase", PHASES)
@pytest.mark.parametrize("amplitude", [0.05, 1.0, 7.0])
def test_oscillatory(amplitude, phase):
    """Strain is gamma0 sin(phase) + integral of rate, accumulated strain the integral of |rate|; quadrature
    to 1e-11.
    """
    flow = Oscillatory(amplitude, phase, 3)
    period = flow.period(0)
    assert period == pytest.approx(2 * math.pi * amplitude)
    zeros = [amplitude * (math.pi * (k + 0.5) - phase) for k in range(-20, 40)]
    for time in np.array([0.0, 0.1, 0.35, 0.5, 0.77, 1.0]) * period:
        strain = amplitude * math.sin(phase) + integral(lambda t: flow.rate(0, t), 0.0, time, zeros)
        assert flow.strain(0, time) == pytest.approx(strain, abs=1e-11 * max(amplitude, 1))
        total = integral(lambda t: abs(flow.rate(0, t)), 0.0, time, zeros)
        assert flow.accumulated(0, time) == pytest.approx(total, abs=1e-11 * max(amplitude, 1))
        assert flow.accumulated(2, time) == pytest.approx(8 * amplitude + total, rel=1e-12)
        assert flow.elapsed(2, time) == pytest.approx(2 * period + time, rel=1e-14)


@pytest.mark.parametrize(
    "flow",
    [
        Steps(5.0, 0.0, 1.0, 1.0),
        Steps(5.4, 0.0, 1.0, 1.0),
        Steps(7.3, 2.6, 1.0, -1.0),
        Steps(3.0, 3.0, 1.0, -1.0),
        Steps(0.4, 0.1, 1.0, -1.0),
        Steps(2.5, 0.0, 0.0, 0.0),
    ],
    ids=["steady", "broken", "reversal", "all_before", "short", "quiescent"],
)
def test_steps(flow):
    """Blocks follow each other without gap; strain = integral of rate, accumulated = integral of |rate| (or
    time).
    """
    elapsed = strain = accumulated = 0.0
    for cycle in range(flow.cycles):
        for fraction in (0.0, 0.4, 1.0):
            time = fraction * flow.period(cycle)
            assert flow.elapsed(cycle, time) == pytest.approx(elapsed + time, abs=1e-12)
            assert flow.strain(cycle, time) == pytest.approx(strain + flow.rate(cycle, time) * time,
            abs=1e-12)
            travelled = abs(flow.rate(cycle, time)) * time if flow.rate_before else time
            assert flow.accumulated(cycle, time) == pytest.approx(accumulated + travelled, abs=1e-12)
        period = flow.period(cycle)
        assert 0.0 < period <= 1.0 + 1e-12
        elapsed, strain = elapsed + period, strain + flow.rate(cycle, 0.0) * period
        accumulated += abs(flow.rate(cycle, 0.0)) * period if flow.rate_before else period
    assert elapsed == pytest.approx(flow.total, rel=1e-12)


@pytest.mark.parametrize("flow", [Steps(5.4, 0.0, 1.0, 1.0), Steps(7.3, 2.6, 1.0, -1.0), Steps(2.7, 2.7, 1.0, -1.0)])
def test_the_block_after_the_last_one(flow):
    """A finished run stands at the start of block `cycles`: all of the strain is behind it, and a block there would
    be as long as the last (rounding, 1e-14), also where the run ends before the reversal.
    """
    assert flow.period(flow.cycles) == pytest.approx(flow.period(flow.cycles - 1), rel=1e-14)
    assert flow.elapsed(flow.cycles, 0.0) == pytest.approx(flow.total, rel=1e-14)


def test_reversal_is_the_start_of_a_block():
    """The rate changes sign at the pre-shear strain exactly, where the strain is largest."""
    flow = Steps(7.3, 2.6, 1.0, -1.0)
    first = next(c for c in range(flow.cycles) if flow.rate(c, 0.0) < 0)
    assert flow.elapsed(first, 0.0) == pytest.approx(2.6, rel=1e-14)
    assert flow.strain(first, 0.0) == pytest.approx(2.6, rel=1e-14)
    assert flow.strain(flow.cycles - 1, flow.period(flow.cycles - 1)) == pytest.approx(2.6 - 4.7, abs=1e-12)


def test_edge_length():
    """phi L^3 = N 4 pi/3."""
    assert 0.4 * edge_length(50, 0.4) ** 3 == pytest.approx(50 * 4 * math.pi / 3, rel=1e-14)


@pytest.mark.parametrize("strain", [-3.5, -0.5, -0.49, 0.0, 0.49, 0.5, 0.51, 7.3])
def test_flips_bring_the_tilt_back(strain):
    """tilt = strain - flips in [-1/2, 1/2)."""
    assert -0.5 <= strain - flips_of(strain) < 0.5


@pytest.mark.parametrize("tilt", [-0.5, 0.0, 0.23, 0.499])
def test_wrapping_leaves_unwrapped_positions_unchanged(tilt):
    """Wrapped positions lie in the cell; position + image . cell vectors is what it was (rounding)."""
    edge, random = 6.0, np.random.default_rng(1)
    position, image = random.normal(size=(200, 3)) * 15, random.integers(-3, 4, (200, 3)).astype(np.int32)
    before = unwrap(position, image, edge, tilt)
    wrap_and_count(position, image, edge, tilt)
    assert np.allclose(unwrap(position, image, edge, tilt), before, rtol=0, atol=1e-12)
    fraction = position @ np.linalg.inv(cell_vectors(edge, tilt))
    assert fraction.min() >= -1e-14 and fraction.max() <= 1 + 1e-14
    again = image.copy()
    wrap_and_count(position, again, edge, tilt)
    assert np.array_equal(again, image)


@pytest.mark.parametrize("extra", [-2, -1, 1, 3])
def test_flipping_leaves_unwrapped_positions_unchanged(extra):
    """The lattice of tilt - m is that of tilt: positions stay, images are re-expressed, unwrapped positions
    stay.
    """
    edge, tilt, random = 6.0, 0.5, np.random.default_rng(1)
    position, image = random.random((50, 3)) * edge, random.integers(-9, 9, (50, 3)).astype(np.int32)
    before = unwrap(position, image, edge, tilt)
    flip(image, extra)
    assert image.dtype == np.int32
    assert np.allclose(unwrap(position, image, edge, tilt - extra), before, rtol=0, atol=1e-12)
