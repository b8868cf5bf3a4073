"""Splits of the mobility into a wave part, summed over k, and a real part, summed over near pairs.

The wave part of spheres i, j is (6 pi/V) sum_{k != 0} W(k)/k^2 (I - kk/k^2) e^{ik.(x_i - x_j)} between the vectors
F (1 - k^2/15) - i k.C. Spheres that do not touch feel the true form factors sin k/k and 3 j1(k)/k only through
their curvature at k = 0, so that any even W = 1 - k^2/5 + O(k^4) leaves a real part of short range: the range
of the one-dimensional Fourier transform of W. W >= 0 makes the wave part a Gram matrix.

    gaussian : W = (1 + (s - 1/5) k^2) exp(-s k^2)
    pswf     : W = (1 + beta k^2) psi(k/K) for k <= K, else 0, psi the prolate function of order zero and
               bandwidth c = K r_c, psi(0) = 1 (Slepian & Pollak 1961): of all functions of support K the
               one most concentrated in r < r_c.
    optimal  : the W >= 0 of support kmax whose real part beyond r_c is least (`suspend.hydro.ewald.truncation`).
               The prolate function is the best for the energy of the transform of W itself; the error is made by
               up to its third derivative, and r_c kmax comes out smaller by a seventh.

Cut at kmax, either split is still exact; only leaving out the real part beyond r_c is an error.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace

import numpy as np
from scipy.linalg import eigh_tridiagonal
from scipy.optimize import brentq

from suspend.core.ewald_functions import WeightTable, wave_weights
from suspend.errors import ConfigurationError, NumericalError
from suspend.hydro.ewald.radial import interval_polynomials
from suspend.hydro.ewald.truncation import bernstein, optimal_coefficients, truncation_error

WEIGHT_INTERVALS = 128
KINDS = ("gaussian", "pswf", "optimal")
SMALLEST_ERROR, LARGEST_ERROR = 1e-11, 0.1


@dataclass(frozen=True)
class Split:
    """A split: kind, r_c and kmax (radii), W(k), and its curvature.

    cutoff : r_c, the real part is left out from there on
    kmax : W = 0 beyond
    shape : s of the Gaussian (radii^2), else c = kmax r_c
    coefficients : psi in Legendre polynomials (pswf), W in Bernstein polynomials of (k/kmax)^2 (optimal)
    beta : W = (1 + beta k^2) exp(-s k^2) or (1 + beta k^2) psi(k/kmax)
    """

    kind: str
    cutoff: float
    kmax: float
    shape: float
    coefficients: np.ndarray = field(repr=False, compare=False)
    beta: float = 0.0
    table: WeightTable | None = field(default=None, repr=False, compare=False)

    def exact_wave(self, k: np.ndarray) -> np.ndarray:
        """W(k) from its definition, to 1e-15; slower than `wave`."""
        k = np.asarray(k, dtype=float)
        x = k / self.kmax
        if self.kind == "gaussian":
            base = np.exp(-self.shape * k**2)
        elif self.kind == "pswf":
            base = np.polynomial.legendre.legval(np.minimum(x, 1.0), self.coefficients)
        else:
            base = bernstein(np.minimum(x, 1.0), len(self.coefficients) - 1) @ self.coefficients
        return np.where(x <= 1.0, (1.0 + self.beta * k**2) * base, 0.0)

    def wave(self, k: np.ndarray) -> np.ndarray:
        """W(k) >= 0 from the table (error below 1e-14), any shape; 0 beyond kmax."""
        k = np.ascontiguousarray(k, dtype=float)
        weight = np.empty(k.shape)
        wave_weights(self.table, k.reshape(-1), weight.reshape(-1))
        return weight

    @property
    def jump(self) -> float:
        """W(kmax), the height of the step at the end of the support."""
        return float(self.exact_wave(np.array(self.kmax)))


def prolate(c: float) -> tuple[np.ndarray, float]:
    """Prolate spheroidal wave function of order zero: psi = sum legendre[n] P_n(x), psi(0) = 1.

    Returns (legendre, eigenvalue) with ((1 - x^2) psi')' + (eigenvalue - c^2 x^2) psi = 0, from the
    tridiagonal matrix of the equation in normalised Legendre polynomials (Xiao, Rokhlin & Yarvin 2001).
    """
    k = 2.0 * np.arange(int(24 + 0.75 * c))
    diagonal = k * (k + 1) + (2 * k * (k + 1) - 1) / ((2 * k + 3) * (2 * k - 1)) * c**2
    beside = (k + 2) * (k + 1) / ((2 * k + 3) * np.sqrt((2 * k + 1) * (2 * k + 5))) * c**2
    value, vector = eigh_tridiagonal(diagonal, beside[:-1], select="i", select_range=(0, 0))
    legendre = np.zeros(2 * len(k) - 1)
    legendre[::2] = vector[:, 0] * np.sqrt(k + 0.5)
    return legendre / np.polynomial.legendre.legval(0.0, legendre), float(value[0])


def _definition(kind: str, cutoff: float, kmax: float, shape: float) -> Split:
    """The split of these parameters, without its table and unchecked."""
    if kind == "gaussian":
        return Split(kind, cutoff, kmax, shape, np.zeros(1), shape - 0.2)
    if kind == "optimal":
        return Split(kind, cutoff, kmax, shape, optimal_coefficients(cutoff, kmax))
    legendre, eigenvalue = prolate(shape)
    return Split(kind, cutoff, kmax, shape, legendre, eigenvalue / (2.0 * kmax**2) - 0.2)


def make_split(kind: str, cutoff: float, kmax: float, shape: float | None = None) -> Split:
    """A split with all its parameters given (see `Split`); shape only for the Gaussian, else kmax r_c.

    Raises ConfigurationError if W is not positive: r_c is then too short for that accuracy, because the
    curvature of a sphere, 1/5, has to come from a W whose transform ends at r_c.
    """
    if kind not in KINDS or (kind == "gaussian") != (shape is not None):
        raise ConfigurationError(
            f"far_field split: {kind!r}, shape {shape}; kinds are {', '.join(KINDS)}, a shape belongs to the first"
        )
    shape = kmax * cutoff if shape is None else shape
    split = _definition(kind, cutoff, kmax, shape)
    if 1.0 + split.beta * kmax**2 < 0.0:
        raise ConfigurationError(
            f"far_field: a real-space cutoff of {cutoff:.3g} radii is too short for a split of this accuracy "
            f"(kmax = {kmax:.3g}/a): the wave part would not be positive; raise the cutoff or the tolerance"
        )
    values = interval_polynomials(lambda t: split.exact_wave(np.sqrt(t)), kmax**2, WEIGHT_INTERVALS)
    return replace(split, table=WeightTable(WEIGHT_INTERVALS / kmax**2, kmax**2, values))


def _solve(excess, low: float, high: float) -> float:
    """Root of a function of log(parameter) between two bounds, to half a percent of the parameter."""
    return math.exp(brentq(lambda t: excess(math.exp(t)), math.log(low), math.log(high), xtol=5e-3))


def _check(cutoff: float, error: float) -> None:
    if not cutoff >= 2.0:
        raise ConfigurationError(f"far_field: a real-space cutoff of {cutoff:g} radii; it must be 2 or more")
    if not SMALLEST_ERROR <= error <= LARGEST_ERROR:
        raise ConfigurationError(
            f"far_field: a truncation error of {error:g}; choose from {SMALLEST_ERROR:g} to {LARGEST_ERROR:g}"
        )


def gaussian_split(cutoff: float, error: float) -> Split:
    """Gaussian split whose predicted truncation error (see `truncation_error`) beyond `cutoff` is `error`.

    s is set by 0.7 error for the untruncated Gaussian, then kmax so that the whole is `error`.
    """
    _check(cutoff, error)

    def excess(shape, kmax, goal):
        return math.log(truncation_error(_definition("gaussian", cutoff, kmax, shape)) / goal)

    s = _solve(lambda s: excess(s, 6.3 / math.sqrt(s), 0.7 * error), cutoff**2 / 180.0, cutoff**2 / 2.0)
    kmax = _solve(lambda k: excess(s, k, error), 0.5 / math.sqrt(s), 6.3 / math.sqrt(s))
    return make_split("gaussian", cutoff, kmax, s)


def pswf_split(cutoff: float, error: float) -> Split:
    """Prolate split whose predicted truncation error (see `truncation_error`) beyond `cutoff` is `error`.

    c = kmax r_c; kmax is about half of the Gaussian's for the same cutoff and error.
    """
    _check(cutoff, error)

    def excess(c):
        return math.log(truncation_error(_definition("pswf", cutoff, c / cutoff, c)) / error)

    c = _solve(excess, 1.0, 60.0)
    return make_split("pswf", cutoff, c / cutoff)


def optimal_split(cutoff: float, error: float) -> Split:
    """Split of the least kmax whose predicted truncation error beyond `cutoff` is `error`.

    c = kmax r_c: about 12, 21 and 28 for 1e-3, 1e-6 and 1e-9, where a Gaussian needs 17, 32 and 47.
    """
    _check(cutoff, error)

    def excess(c):
        return math.log(truncation_error(_definition("optimal", cutoff, c / cutoff, c)) / error)

    c = 4.0
    while excess(c) > 0.0:
        c *= 1.15
        if c > 60.0:
            raise NumericalError(f"far_field: no split of error {error:g} found at a cutoff of {cutoff:g} radii")
    c = _solve(excess, c / 1.15, c) if c > 4.0 else c
    return make_split("optimal", cutoff, c / cutoff)
