"""Averages of correlated series against the exact error of the mean of AR(1) noise; the drift test."""

from __future__ import annotations

import json
import math

import numpy as np
import pytest

from suspend.analysis.steady import (
    magnitude_series,
    ratio_average,
    ratio_series,
    steady_average,
    summarise,
)


def correlated(rho: float, count: int, rows: int, seed: int = 1) -> np.ndarray:
    """Stationary Gaussian AR(1) noise of variance 1, (rows, count)."""
    random = np.random.default_rng(seed)
    noise = random.normal(size=(rows, count))
    noise[:, 1:] *= math.sqrt(1.0 - rho**2)
    for k in range(1, count):
        noise[:, k] += rho * noise[:, k - 1]
    return noise


def exact_error(rho: float, count: int) -> float:
    """Standard deviation of the mean of AR(1) noise: sqrt(sum_jk rho^|j-k|)/n, the double sum written out."""
    lags = np.abs(np.subtract.outer(np.arange(count), np.arange(count)))
    return math.sqrt((rho**lags).sum()) / count


@pytest.mark.parametrize("rho", [0.0, 0.5, 0.8])
def test_error_of_long_series(rho):
    """4000 values of AR(1) noise: the error is the exact one, and not s/sqrt(n), which is 3 times smaller at rho = 0.8.

    Relative error of the estimate: (1/2) d ln[(1 + rho)/(1 - rho)] = d rho/(1 - rho^2) with d rho = sqrt((1 -
    rho^2)/4000), 2.6 % at rho = 0.8; four of them are allowed.
    """
    found = steady_average(correlated(rho, 4000, 1)[0], 2000)
    assert found.error == pytest.approx(exact_error(rho, 2000), rel=0.1)
    assert found.correlation == pytest.approx(rho, abs=0.06)
    assert found.effective == pytest.approx(2000 * (1 - rho) / (1 + rho), rel=0.2)
    assert not found.drifting


@pytest.mark.parametrize(("rho", "lowest"), [(0.0, 0.85), (0.5, 0.75), (0.8, 0.6)])
def test_error_of_short_series(rho, lowest):
    """64 cycles, the last 16 averaged: the median error over 400 series against the exact one of the mean.

    rho from 32 values is uncertain by 0.1 to 0.18: it raises the errors of white noise and leaves those at rho = 0.8
    skewed (median 0.7, root mean square 1.5 times the exact one). s/sqrt(m) instead gives 0.4 at rho = 0.8.
    """
    series = correlated(rho, 64, 400)
    found = np.array([steady_average(row, 16).error for row in series])
    means = series[:, 48:].mean(axis=1)
    assert means.std() == pytest.approx(exact_error(rho, 16), rel=0.15)  # the test's own noise is what it says
    assert lowest < np.median(found) / exact_error(rho, 16) < 1.25


@pytest.mark.parametrize(("rho", "highest"), [(0.0, 0.02), (0.5, 0.06), (0.8, 0.10)])
def test_false_alarms(rho, highest):
    """Stationary noise of 64 cycles: drift at the nominal 1 % where white, at the documented rate where correlated.

    1000 series; a rate of 1 % has a standard deviation of 0.3 %. For rho = 0 the upper limit is nominal + 3 of them.
    """
    rate = np.mean([steady_average(row, 8).drifting for row in correlated(rho, 64, 1000, 2)])
    assert rate <= highest


def test_false_alarms_vanish_with_length():
    """640 cycles at rho = 0.8: the nominal 5 % within four standard deviations of 300 series (1.3 % each)."""
    rate = np.mean([steady_average(row, 80, 0.05).drifting for row in correlated(0.8, 640, 300, 3)])
    assert abs(rate - 0.05) < 0.05


@pytest.mark.parametrize("rho", [0.0, 0.5])
def test_linear_drift_is_detected(rho):
    """Ten standard errors of the slope over the last half: always found, with the change from end to end.

    The error of the change over n values with white noise is sqrt(12/n) (n large); correlation multiplies it by
    sqrt((1 + rho)/(1 - rho)).
    """
    n = 64
    unit = math.sqrt(12.0 / n) * math.sqrt((1 + rho) / (1 - rho))
    line = 10.0 * unit * np.arange(2 * n) / (n - 1)
    found = [steady_average(row + line, 8) for row in correlated(rho, 2 * n, 50, 4)]
    assert all(each.drifting and each.p_value < 0.01 for each in found)
    changes = np.array([each.change for each in found])
    assert changes.mean() == pytest.approx(10.0 * unit, abs=4 * unit / math.sqrt(50))
    assert changes.std() == pytest.approx(unit, rel=0.35)


def test_power_of_the_drift_test():
    """A drift of three standard errors is found as often as Student's test of an exactly known white noise would.

    Normal statistics: P(|t| > 2.6) for t ~ N(3, 1) is 0.65 at 1 %; estimating the correlation costs some of it.
    """
    n, unit = 64, math.sqrt(12.0 / 64)
    line = 3.0 * unit * np.arange(2 * n) / (n - 1)
    rate = np.mean([steady_average(row + line, 8).drifting for row in correlated(0.0, 2 * n, 400, 5)])
    assert 0.45 < rate < 0.75


def test_smooth_relaxation_drifts():
    """A transient without noise that has not ended: exponential, power law, logarithm, at 10 to 640 cycles."""
    for count in (16, 64, 640):
        k = np.arange(1, count + 1)
        for curve in (np.exp(-2.0 * k / count), k**-0.3, np.log(k)):
            assert steady_average(3.0 + 0.01 * curve, 4).drifting


def test_verdicts():
    """White noise is steady, a line drifts, two values say nothing, one period of a wave in the window is slow.

    The wave has no slope but changes as slowly as the window is long: neither drift nor steadiness is shown.
    """
    t = np.linspace(0.0, 1.0, 40)
    wave = np.concatenate([np.zeros(40), np.cos(2.0 * np.pi * t)])
    assert steady_average(wave, 5).verdict == "slow"
    assert steady_average(correlated(0.0, 80, 1)[0], 5).verdict == "steady"
    assert steady_average(np.linspace(0.0, 1.0, 80), 5).verdict == "drifting"
    assert steady_average(np.array([1.0, 2.0]), 2).verdict == "unknown"
    assert steady_average(np.full(40, 2.5), 5).as_dict()["verdict"] == "steady"


def test_constants_do_not_drift():
    """A constant, its round-off, and an exact straight line: no error; p = 1, 1 and 0."""
    assert steady_average(np.full(40, 2.5), 5).p_value == 1.0
    found = steady_average(2.5 + 1e-15 * np.random.default_rng(0).normal(size=40), 5)
    assert found.p_value == 1.0 and found.error == 0.0 and not found.drifting
    line = steady_average(np.linspace(0.0, 1.0, 40), 5)
    assert line.drifting and line.p_value == 0.0 and line.change == pytest.approx(19.0 / 39.0)
    assert steady_average(np.zeros(20), 4).mean == 0.0


def test_few_values():
    """One: the mean. Two: no error (no straight line is left to scatter about). Three: an error. Four: a p-value."""
    random = np.random.default_rng(1).normal(size=(4, 4))
    assert math.isnan(steady_average(random[0, :2], 2).error)
    assert math.isnan(steady_average(random[0, :1], 1).change)
    three, four = steady_average(random[1, :3], 3), steady_average(random[2], 4)
    assert three.error > 0.0 and math.isnan(three.p_value) and not three.drifting
    assert math.isnan(three.correlation) and 0.0 < four.p_value < 1.0
    with pytest.raises(ValueError, match="last 5 of 4"):
        steady_average(random[0], 5)


def test_small_samples_are_students():
    """Fewer than eight: slope and error of ordinary least squares, p from Student's t with n - 2 degrees of freedom."""
    values = np.array([1.0, 3.0, 2.0, 5.0, 4.0])
    found = steady_average(values, 5)
    # by hand: slope 0.8, residual squares 10 - 0.64 * 10 = 3.6, s^2 = 1.2, t = 0.8/sqrt(0.12) = 2.309, p(3) = 0.104
    assert found.change == pytest.approx(3.2) and found.p_value == pytest.approx(0.104, abs=5e-4)
    assert found.error == pytest.approx(math.sqrt(1.2 / 5))


def test_missing_values_are_left_out():
    """NaN (a cycle whose end is not stored) changes nothing but the counts."""
    values = correlated(0.3, 40, 1)[0]
    whole, holed = steady_average(values, 6), steady_average(np.append(values, np.nan), 7)
    assert holed.mean == whole.mean and holed.cycles == 6
    assert math.isnan(steady_average(np.full(5, np.nan), 2).mean)


def test_ratio():
    """<a>/<b> with a, b correlated with each other: error by the delta method against its scatter over 400 series.

    a = 2 + 0.1 x, b = 1 + 0.1 y, x and y of correlation 0.8: sd of the ratio of the means of 16 is
    0.1 sqrt(1 - 2 * 2 * 0.8 + 4)/sqrt(16). A denominator through zero in single cycles stays finite.
    """
    random, found, ratios = np.random.default_rng(7), [], []
    for _ in range(400):
        x, other = random.normal(size=(2, 32))
        a, b = 2.0 + 0.1 * x, 1.0 + 0.1 * (0.8 * x + 0.6 * other)
        each = ratio_average(a, b, 16)
        ratios.append(each.mean - a[16:].mean() / b[16:].mean())
        found.append((each.mean, each.error))
    means, errors = np.array(found).T
    expected = 0.1 * math.sqrt(1.0 - 3.2 + 4.0) / 4.0
    assert np.abs(ratios).max() < 1e-14
    assert means.std() == pytest.approx(expected, rel=0.15) and np.median(errors) == pytest.approx(expected, rel=0.25)
    assert ratio_average(np.array([1.0, 2.0, 3.0]), np.array([-1.0, 0.0, 4.0]), 3).mean == 2.0
    assert np.isnan(ratio_series(np.ones(4), np.array([1.0, -1.0, 1.0, -1.0]), 4)).all()


def test_magnitude_is_not_raised_by_noise():
    """Complex noise of 0.1 about 0.01 i: the mean of |c| is 0.13, the magnitude of the mean 0.01 within its error."""
    random = np.random.default_rng(8)
    values = 0.01j + 0.1 * (random.normal(size=4000) + 1j * random.normal(size=4000)) / math.sqrt(2.0)
    series = magnitude_series(values, 2000)
    assert series[2000:].mean() == pytest.approx(abs(values[2000:].mean()), rel=1e-12)
    found = steady_average(series, 2000)
    assert abs(found.mean - 0.01) < 4.0 * found.error and np.abs(values).mean() > 0.08
    np.testing.assert_array_equal(magnitude_series(np.zeros(3, complex), 2), np.zeros(3))


def test_plain_types():
    """The summary is fit for JSON."""
    content = summarise({"a": steady_average(np.random.default_rng(1).normal(size=20), 5)})
    assert json.loads(json.dumps(content))["a"]["cycles"] == 5 and content["a"]["reference"] == 10
