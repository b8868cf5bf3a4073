"""Variance of the number of spheres in randomly placed test spheres, its growth exponent, and the exponent's fit.

sigma^2(r) = <n^2> - <n>^2 ~ r^beta for r in [2a, L/4]: beta = 3 for ordinary fluids, 2 for crystals and other
strongly hyperuniform states (Torquato & Stillinger, Phys. Rev. E 68, 041113, 2003). n counts sphere centres.
"""

from __future__ import annotations

import warnings
from typing import Any, NamedTuple

import numpy as np
from scipy.optimize import OptimizeWarning, curve_fit

from suspend import fluctuations
from suspend.analysis.microstructure.snapshot import SPACED, FrameQuantity, Frames, Snapshot, tabulate_frames
from suspend.errors import ConfigurationError
from suspend.fluctuations import ALL_PAIRS, RADII, log_slopes, variance_radii

_CENTRES, _VOLUME = 12000, 3.0  # test spheres: at most so many, one per so many a^3
_BLOCKS = 2  # per direction, for the error by leaving one out


class Exponent(NamedTuple):
    """beta of one configuration, its standard error, and the variance behind it."""

    beta: float
    error: float
    variance: np.ndarray  # (radii,)


class BetaFit(NamedTuple):
    """Parameters of beta = (beta0 - beta_inf)(1 + gamma_tot)^nu + beta_inf, standard errors, rms residual."""

    beta0: float
    beta_inf: float
    nu: float
    beta0_error: float
    beta_inf_error: float
    nu_error: float
    residual: float

    @property
    def determined(self) -> bool:
        """False where the data show no decay of this form: nu is not known to its own size."""
        return bool(self.nu_error < abs(self.nu)) and self.nu < 0.0

    def __call__(self, total_strain: np.ndarray) -> np.ndarray:
        """Fitted beta at gamma_tot."""
        return _decay(np.asarray(total_strain, float), self.beta0, self.beta_inf, self.nu)


def number_variance(snapshot: Snapshot, radii: np.ndarray, centres: int | None = None, seed: int = 1) -> Exponent:
    """sigma^2(r) and its exponent beta from an unweighted straight line through ln sigma^2 against ln r.

    Up to `ALL_PAIRS` spheres sigma^2 is `exact_variance`, beyond (and where `centres` is given) it is sampled; the
    error of beta is the sampling's in both. radii (m,), in sphere radii, at most L/4.

    One test centre lies at random in each of m^3 equal parts of the (sheared) cell, m^3 about `centres` (default:
    one per 3 a^3, at most 12000), which samples more evenly than independent centres and is unbiased; <n> = N v/V
    is known. With the default, sampling alone would add 0.03 (N = 500) or 0.01 (N >= 4000) to the scatter of beta. The
    error of beta comes from leaving out one octant of the cell at a time (jackknife). It is too small, because
    large test spheres reach beyond an octant: for independent Poisson configurations it is 0.7 of the scatter found
    (0.18 at N = 500, 0.12 at N = 4096). The periodic cell holds a fixed N, which lowers sigma^2 by S(0) N (v/V)^2:
    for a Poisson configuration by the factor 1 - v/V, at L/4 0.935, which takes 0.07 (N = 500) or 0.04 (N = 4096)
    from beta. As in the paper, this is not corrected.
    """
    radii = np.asarray(radii, float)
    exact = centres is None and snapshot.number <= ALL_PAIRS
    if centres is None:
        centres = min(_CENTRES, int(snapshot.length**3 / _VOLUME))
    m = _BLOCKS * max(1, round(centres ** (1.0 / 3.0) / _BLOCKS))
    corner = np.stack(np.meshgrid(*(np.arange(m),) * 3, indexing="ij"), axis=-1).reshape(-1, 3)
    fraction = (corner + np.random.default_rng(seed).random(corner.shape)) / m
    points = snapshot.length * fraction
    points[:, 0] += snapshot.tilt * points[:, 1]
    tree = snapshot.images(float(radii[-1]))
    expected = snapshot.number * 4.0 * np.pi / 3.0 * radii**3 / snapshot.length**3
    block = corner // (m // _BLOCKS)
    block = (block[:, 0] * _BLOCKS + block[:, 1]) * _BLOCKS + block[:, 2]
    squares = np.empty((_BLOCKS**3, len(radii)))
    for i, r in enumerate(radii):
        n = tree.query_ball_point(points, r, return_length=True)
        squares[:, i] = np.bincount(block, (n - expected[i]) ** 2) / (m // _BLOCKS) ** 3
    sampled = squares.mean(axis=0)
    variance = exact_variance(snapshot, radii) if exact else sampled
    without = (squares.sum(axis=0) - squares) / (len(squares) - 1)
    slopes = log_slopes(radii, np.vstack([variance, without]))  # one line each
    spread = (len(squares) - 1) * np.mean((slopes[1:] - slopes[1:].mean()) ** 2)
    return Exponent(float(slopes[0]), float(np.sqrt(spread)), variance)


def exact_variance(snapshot: Snapshot, radii: np.ndarray) -> np.ndarray:
    """sigma^2(r) over all places of the test sphere (`suspend.fluctuations.exact_variance`); radii (m,) up to L/4."""
    return fluctuations.exact_variance(snapshot.position, snapshot.length, radii, snapshot.tilt)


def _decay(strain, beta0, beta_inf, nu):
    return (beta0 - beta_inf) * (1.0 + strain) ** nu + beta_inf


def fit_beta(total_strain, beta, error=None, free_start: bool = True) -> BetaFit:
    """Fit beta = (beta0 - beta_inf)(1 + gamma_tot)^nu + beta_inf (the equation of the paper for beta) by least squares.

    total_strain, beta, error (n,): weights 1/error^2 where errors are given. `free_start`: beta0 is fitted too;
    otherwise it is the first value. Standard errors from the scatter about the fit. Raises ConfigurationError
    for fewer than 4 values, or where no such decay fits.
    """
    strain, beta = np.asarray(total_strain, float), np.asarray(beta, float)
    good = np.isfinite(beta)
    if good.sum() < 4:
        raise ConfigurationError(
            f"{good.sum()} values of beta are too few to fit its decay: at least 4 frames are needed"
        )
    strain, beta = strain[good], beta[good]
    sigma = None if error is None else np.asarray(error, float)[good]
    start = (min(beta.min(), beta[0] - 0.05), -0.3, beta[0])

    def model(s, low, nu, beta0=beta[0]):
        return _decay(s, beta0, low, nu)

    guess = start if free_start else start[:2]
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("error", OptimizeWarning)  # no covariance: the parameters are not determined
            best, covariance = curve_fit(model, strain, beta, guess, sigma, maxfev=20000)
    except (RuntimeError, ValueError, OptimizeWarning) as failure:
        raise ConfigurationError(f"beta does not follow a decay with the total strain: {failure}") from failure
    low, nu, beta0 = (float(v) for v in (*best, beta[0])[:3])
    errors = [float(v) for v in (*np.sqrt(np.diag(covariance)), 0.0)[:3]]
    residual = float(np.sqrt(np.mean((_decay(strain, beta0, low, nu) - beta) ** 2)))
    return BetaFit(beta0, low, nu, errors[2], errors[0], errors[1], residual)


class NumberVariance(FrameQuantity):
    """sigma^2(r) in spheres of `count` radii, evenly spaced in ln r over [2a, L/4], and beta, frame by frame.

    `centres`: test spheres per frame and radius (see `number_variance`). A cell with L/4 below 2.5 a leaves no
    range: ConfigurationError.
    """

    def __init__(self, frames: Frames = SPACED, centres: int | None = None, count: int = RADII):
        self.frames, self.centres, self.count = frames, centres, count

    def missing(self, snapshot: Snapshot) -> str | None:
        """Too small a cell: no range of radii."""
        largest = 0.25 * snapshot.length
        if fluctuations.holds_range(snapshot.length):
            return None
        return (
            f"the number variance needs test spheres from 2 a to L/4, but L/4 is {largest:.3g} a here: use more spheres"
        )

    def begin(self) -> None:
        """Forget earlier results."""
        self._results, self._when, self._radii = [], [], None

    def add(self, snapshot: Snapshot) -> None:
        """Count in one configuration."""
        self._radii = variance_radii(snapshot.length, self.count)
        self._results.append(number_variance(snapshot, self._radii, self.centres))
        self._when.append((snapshot.total_strain, snapshot.cycle))

    @property
    def radii(self) -> np.ndarray:
        """Radii of the test spheres, in sphere radii."""
        return self._radii

    @property
    def variance(self) -> np.ndarray:
        """sigma^2(r), shape (frames, radii)."""
        return np.array([result.variance for result in self._results])

    @property
    def beta(self) -> np.ndarray:
        """Exponent per frame."""
        return np.array([result.beta for result in self._results])

    @property
    def error(self) -> np.ndarray:
        """Standard error of beta per frame."""
        return np.array([result.error for result in self._results])

    @property
    def total_strain(self) -> np.ndarray:
        """gamma_tot of the frames."""
        return tabulate_frames(self._when)["total_strain[-]"]

    def fit(self, free_start: bool = True) -> BetaFit:
        """Decay of beta with the total strain, see `fit_beta`; every frame has the same weight."""
        return fit_beta(self.total_strain, self.beta, free_start=free_start)

    def table(self) -> dict[str, np.ndarray]:
        """gamma_tot, cycle, beta and its error."""
        return tabulate_frames(self._when) | {"beta[-]": self.beta, "beta_error[-]": self.error}

    def variance_table(self) -> dict[str, np.ndarray]:
        """sigma^2(r) of the first and the last frame."""
        ends = {"variance_first[-]": self.variance[0], "variance_last[-]": self.variance[-1]}
        return {"r[a]": self.radii, **ends}

    def plot(self, ax) -> None:
        """beta against gamma_tot, with its fit where there is one."""
        ax.errorbar(self.total_strain, self.beta, self.error, fmt="o", markersize=3)
        try:
            fit = self.fit()
        except ConfigurationError:
            fit = None
        if fit is not None and fit.determined:
            strain = np.linspace(0.0, self.total_strain[-1], 200)
            ax.plot(strain, fit(strain), "k--", linewidth=1.0)
        ax.set(xlabel=r"$\gamma_{tot}$", ylabel=r"$\beta$")

    def summary(self) -> dict[str, Any]:
        """First and last beta with errors, and the fit (absent where there is none)."""
        result = {
            "beta_first[-]": float(self.beta[0]),
            "beta_first_error[-]": float(self.error[0]),
            "beta_last[-]": float(self.beta[-1]),
            "beta_last_error[-]": float(self.error[-1]),
        }
        try:
            fit = self.fit()
        except ConfigurationError as reason:
            return result | {"beta_fit": f"none: {reason}"}
        if not fit.determined:
            return result | {"beta_fit": "none: beta shows no decay that stands out of its scatter"}
        return result | {f"beta_fit_{name}": value for name, value in fit._asdict().items()}
