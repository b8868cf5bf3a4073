"""Averages of correlated series of cycles: mean, error bar, drift test.

Model: over a reference window (the last half of the run, the averaged cycles or four, whichever is most) a series is a
quadratic trend plus stationary noise whose correlation decays as rho^|k| from cycle to cycle (AR(1)). rho is the
lag-one autocorrelation of the residuals, corrected for the bias of short detrended series,
rho = (n r_1 + p)/(n - 2 - p) with p coefficients of the trend (Kendall 1954, and each further coefficient
likewise), not below 0; the variance is corrected for the coefficients fitted. The error of a mean over m cycles is
then sigma sqrt(sum_jk rho^|j-k|)/m. The drift test divides the least-squares slope over the window by its error
under the same noise (Student's t, degrees of freedom from the effective number of cycles, at least 3).

Measured on Gaussian AR(1) noise (tests/test_steady.py): false alarms at a nominal 1 % are 1 % for white noise, and 3 %
at rho = 0.5, 4 % at 0.8 for a window of 32 cycles, 1.5 % for one of 320; the median error bar is 1.05, 0.95, 0.8 times
the exact one for 32, 1.0 for 320. Noise that remembers longer than the window cannot be told from drift.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np
from scipy.special import stdtr

SIGNIFICANCE = 0.01  # of the drift test: a trend with a smaller p-value counts as drift
_TREND = 2  # degree of the trend that is removed before the correlation is measured
_SHORT = 8  # fewer cycles cannot show their correlation: a straight line, independent noise
_LEAST = 4  # cycles in the reference window where the run has them
_ROUNDING = 1e-12  # of the largest value: changes below are round-off of a constant


@dataclass(frozen=True)
class SteadyAverage:
    """Average over the last `cycles` values of a series, in the units of the series.

    mean; error: standard error, correlation included, drift not; effective: number of independent cycles that would
    give this error; correlation: rho (NaN: too few cycles to tell, taken as independent); change: of the straight
    line through the last `reference` values, from end to end; p_value: probability of such a slope without drift;
    drifting: p_value below the significance asked for. NaN where there are too few values (error: 3, drift: 4).
    `verdict` says what the test allows to say.
    """

    mean: float
    error: float
    effective: float
    correlation: float
    change: float
    p_value: float
    drifting: bool
    cycles: int
    reference: int

    @property
    def verdict(self) -> str:
        """ "drifting"; "slow", changes as long as the window: drift or not cannot be told; "steady"; "unknown".

        slow: the reference window amounts to fewer than four independent cycles. unknown: too few values.
        """
        if not math.isfinite(self.p_value):
            return "unknown"
        if self.drifting:
            return "drifting"
        rho = self.correlation if math.isfinite(self.correlation) else 0.0
        return "slow" if self.reference * (1.0 - rho) / (1.0 + rho) < _LEAST else "steady"

    def as_dict(self) -> dict[str, Any]:
        """Plain types by name, the verdict included."""
        return asdict(self) | {"verdict": self.verdict}


def steady_average(values: np.ndarray, last: int, significance: float = SIGNIFICANCE) -> SteadyAverage:
    """Average of the last `last` of `values` (n,), its error, and the drift over the last half of them.

    Values that are not finite are left out, the others taken as consecutive.
    """
    values = np.asarray(values, float)
    if not 1 <= last <= len(values):
        raise ValueError(f"an average over the last {last} of {len(values)} values")
    window = values[len(values) - last :]
    window = window[np.isfinite(window)]
    reference = values[-max(last, len(values) - len(values) // 2, min(len(values), _LEAST)) :]
    reference = reference[np.isfinite(reference)]
    m, n = len(window), len(reference)
    mean = float(window.mean()) if m else math.nan
    if n < 3 or not m:
        return SteadyAverage(mean, math.nan, float(m), math.nan, math.nan, math.nan, False, m, n)
    sigma2, rho, change, p_value = _noise_and_trend(reference)
    inflation = _quadratic(np.arange(m, 0, -1), rho) / m  # of the variance of the mean, by correlation
    error = math.sqrt(sigma2 * inflation / m)
    known = rho if n >= _SHORT else math.nan
    return SteadyAverage(mean, error, m / inflation, known, change, p_value, p_value < significance, m, n)


def ratio_average(
    numerator: np.ndarray, denominator: np.ndarray, last: int, significance: float = SIGNIFICANCE
) -> SteadyAverage:
    """<numerator>/<denominator> over the last values; error and drift by linearisation (delta method).

    Unlike the mean of ratios this stays finite where the denominator passes through zero in some cycle. NaN where
    its mean is zero, meaningless where it is within a few errors of zero.
    """
    return steady_average(ratio_series(numerator, denominator, last), last, significance)


def ratio_series(numerator: np.ndarray, denominator: np.ndarray, last: int) -> np.ndarray:
    """Series r + (numerator - r denominator)/<denominator>: its mean over the last values is r, their ratio."""
    numerator, denominator = np.asarray(numerator, float), np.asarray(denominator, float)
    mean = denominator[len(denominator) - last :].mean()
    if mean == 0.0:
        return np.full(len(numerator), math.nan)
    ratio = numerator[len(numerator) - last :].mean() / mean
    return ratio + (numerator - ratio * denominator) / mean


def magnitude_series(values: np.ndarray, last: int) -> np.ndarray:
    """Components of complex `values` along their mean over the last ones: the mean of the series is |<values>|.

    The mean of |values| instead would be too large by the noise.
    """
    mean = np.mean(values[len(values) - last :])
    return (values * (np.conj(mean) / abs(mean))).real if mean != 0.0 else np.zeros(len(values))


def summarise(averages: Mapping[str, SteadyAverage]) -> dict[str, dict[str, Any]]:
    """`as_dict` of each."""
    return {name: average.as_dict() for name, average in averages.items()}


class Trend(NamedTuple):
    """Parabola through a series: what it changes by over the series, with standard errors under AR(1) noise.

    change: of the straight line from end to end; bend: of the parabola's curvature, between its lowest and highest
    point; freedom: degrees of freedom of Student's t for both. The errors are 0 where there is no noise at all.
    """

    change: float
    change_error: float
    bend: float
    bend_error: float
    freedom: float


def trend(values: np.ndarray) -> Trend:
    """Straight line and bend of a series of at least 8 finite values (n,); the noise is that of the module."""
    if len(values) < _SHORT:
        raise ValueError(f"a parabola with correlated noise through {len(values)} values")
    fit = _fit(np.asarray(values, float))
    sizes = fit.basis.max(axis=0) - fit.basis.min(axis=0)
    changes = np.abs(fit.coefficients) * sizes
    errors = np.sqrt(fit.variance * np.array(fit.spans)) * sizes
    sign = math.copysign(1.0, fit.coefficients[1] * (fit.basis[-1, 1] - fit.basis[0, 1]))
    return Trend(sign * float(changes[1]), float(errors[1]), float(changes[2]), float(errors[2]), fit.freedom)


class _Fit(NamedTuple):
    """Polynomials (orthonormal) through a series, and its noise: variance, correlation, q^T R q of each polynomial."""

    basis: np.ndarray
    coefficients: np.ndarray
    variance: float
    rho: float
    spans: list[float]
    freedom: float


def _fit(values: np.ndarray) -> _Fit:
    n = len(values)
    degree = _TREND if n >= _SHORT else 1
    basis, overlaps = _polynomials(n, degree)
    coefficients = basis.T @ values
    residuals = values - basis @ coefficients
    square = float(residuals @ residuals)
    rho = 0.0
    if square <= n * _floor(values):  # no noise at all
        return _Fit(basis, coefficients, 0.0, rho, [0.0] * (degree + 1), n - degree - 1.0)
    if n >= _SHORT:
        rho = (n * float(residuals[1:] @ residuals[:-1]) / square + degree + 1) / (n - 3 - degree)
        rho = min(max(rho, 0.0), 1.0 - 1.0 / n)
    spans = [_quadratic(row, rho) for row in overlaps]  # q^T R q for each polynomial, R_jk = rho^|j-k|
    variance = square / (n - sum(spans))
    freedom = max(n * (1.0 - rho) / (1.0 + rho) - degree - 1, 3.0) if n >= _SHORT else n - 2.0
    return _Fit(basis, coefficients, variance, rho, spans, freedom)


def _floor(values: np.ndarray) -> float:
    """Square of a change that is round-off of a constant."""
    return (_ROUNDING * np.abs(values).max()) ** 2


def _noise_and_trend(values: np.ndarray) -> tuple[float, float, float, float]:
    """Variance and correlation of the noise, end-to-end change of the straight line, its p-value."""
    fit = _fit(values)
    change = float(fit.coefficients[1] * (fit.basis[-1, 1] - fit.basis[0, 1]))
    if fit.variance == 0.0:
        return 0.0, 0.0, change, 0.0 if change**2 > _floor(values) else 1.0
    if len(values) < 4:
        return fit.variance, fit.rho, change, math.nan
    t = abs(fit.coefficients[1]) / math.sqrt(fit.variance * fit.spans[1])
    return fit.variance, fit.rho, change, float(2.0 * stdtr(fit.freedom, -t))


def _quadratic(overlap: np.ndarray, rho: float) -> float:
    """q^T R q from the autocorrelation sum_j q_j q_(j+k), k = 0, 1, ..., of the vector q; R_jk = rho^|j-k|."""
    return float(2.0 * (overlap @ rho ** np.arange(len(overlap))) - overlap[0])


@lru_cache(maxsize=64)
def _polynomials(n: int, degree: int) -> tuple[np.ndarray, np.ndarray]:
    """Orthonormal polynomials (n, degree + 1) on n equal steps, and their autocorrelations (degree + 1, n)."""
    basis, _ = np.linalg.qr(np.vander(np.linspace(-1.0, 1.0, n), degree + 1, increasing=True))
    spectrum = np.abs(np.fft.rfft(basis, 2 * n, axis=0)) ** 2
    return basis, np.ascontiguousarray(np.fft.irfft(spectrum, 2 * n, axis=0)[:n].T)
