"""Density fluctuations of a configuration, and what the hard-sphere fluid at equilibrium has: S(q), number variance.

Lengths in sphere radii unless said otherwise; the cell is (L,0,0), (tilt L, L, 0), (0,0,L).
"""

from __future__ import annotations

import math

import numpy as np

from suspend.errors import ConfigurationError

FREEZING = 0.494  # volume fraction of the hard-sphere fluid at coexistence (Hoover & Ree 1968)
SMALLEST = 2.0  # radii: the smallest test sphere
RADII = 12  # test spheres from there to L/4, evenly spaced in ln r
ALL_PAIRS = 40_000  # spheres up to which every pair is visited: about 10 s
MINIMUM_RANGE = 1.25  # L/4 has to exceed the smallest radius by this factor to say anything about a power
_BINS = 200_000  # of the squared distances, up to (L/2)^2
_CHUNK = 1 << 18  # pairs in memory at once
_LARGEST_WAVE, _WAVES = 40.0, 40_001  # 1/a: of the integral over S(q) - 1; points


# --- of a configuration -------------------------------------------------------------------------------------


def smallest_wave_structure(positions: np.ndarray, length: float, tilt: float = 0.0) -> float:
    """S(q) = |sum_j exp(-i q.x_j)|^2 / N, mean over the three waves q = 2 pi of the inverse cell; tilt in [-1/2, 1/2].

    Without tilt these are the smallest wave vectors, |q| = 2 pi/L. In a fluid the value of one wave is distributed
    exponentially: the mean of one configuration scatters by 1/sqrt(3) of itself.
    """
    x = np.asarray(positions, float) / length
    fractions = np.column_stack([x[:, 0] - tilt * x[:, 1], x[:, 1], x[:, 2]])
    return float(np.mean(np.abs(np.exp(-2j * np.pi * fractions).sum(axis=0)) ** 2) / len(x))


def holds_range(length: float) -> bool:
    """Whether radii from 2 a to L/4 span enough to say anything about a power of r."""
    return 0.25 * length >= MINIMUM_RANGE * SMALLEST


def variance_radii(length: float, count: int = RADII) -> np.ndarray:
    """Radii (count,) of test spheres from 2 a to L/4, evenly spaced in ln r."""
    return np.geomspace(SMALLEST, 0.25 * length, count)


def variance_exponent(positions: np.ndarray, length: float, tilt: float = 0.0) -> float:
    """beta of sigma^2(r) ~ r^beta: line through ln sigma^2 against ln r at `variance_radii`, by `exact_variance`."""
    radii = variance_radii(length)
    return float(log_slopes(radii, exact_variance(positions, length, radii, tilt)))


def exact_variance(positions: np.ndarray, length: float, radii: np.ndarray, tilt: float = 0.0) -> np.ndarray:
    """sigma^2(r) over all places of the test sphere, from the pairs; radii (m,) up to L/4; tilt in [-1/2, 1/2].

    sigma^2 = N v/V (1 - N v/V) + (v/V) sum over ordered pairs of alpha(d), alpha = 1 - 3d/4r + d^3/16r^3 for d < 2r the
    shared fraction of two test spheres at the distance d (Torquato & Stillinger, Phys. Rev. E 68, 041113, 2003). With
    2r <= L/2 no pair has two images within reach. Squared distances are collected in 200,000 bins: beside the exact
    sum sigma^2 errs by less than 1e-3 at N = 32,768. Raises ConfigurationError for r > L/4.
    """
    radii, number = np.asarray(radii, float), len(positions)
    if radii.max() > 0.25 * length * (1.0 + 1e-12):
        raise ConfigurationError(f"number variance: r = {radii.max():g} a is above L/4 = {0.25 * length:g} a")
    count, total = _squared_distances(np.asarray(positions, float), length, tilt)
    filled = count > 0
    d = 0.5 * length * np.sqrt(total[filled] / count[filled])
    variance = np.empty(len(radii))
    for i, r in enumerate(radii):
        x = np.minimum(d / (2.0 * r), 1.0)
        share = 4.0 * np.pi / 3.0 * r**3 / length**3
        pairs = 2.0 * np.sum(count[filled] * (1.0 - x) ** 2 * (1.0 + 0.5 * x))
        variance[i] = number * share * (1.0 - number * share) + share * pairs
    return variance


def _squared_distances(positions: np.ndarray, length: float, tilt: float) -> tuple[np.ndarray, np.ndarray]:
    """Pairs closer than L/2 by (2d/L)^2, in equal bins: their number and the sum of (2d/L)^2 in each."""
    fraction = positions / length
    fraction[:, 0] -= tilt * fraction[:, 1]
    x, y, z = np.ascontiguousarray(fraction.T)
    count, total = np.zeros(_BINS, np.int64), np.zeros(_BINS)
    n, first = len(x), 0
    while first < n - 1:
        rows = max(1, min(n - 1 - first, _CHUNK // (n - first)))
        last = first + rows
        dy, dz = y[first:last, None] - y[first:], z[first:last, None] - z[first:]
        dy -= np.rint(dy)
        dz -= np.rint(dz)
        dx = x[first:last, None] - x[first:]
        dx += tilt * dy
        dx -= np.rint(dx)
        square = 4.0 * (dx * dx + dy * dy + dz * dz)
        square[np.tril_indices(rows)] = 2.0  # each pair once
        square = square[square < 1.0]
        bins = (square * _BINS).astype(np.int64)
        count += np.bincount(bins, minlength=_BINS)
        total += np.bincount(bins, square, minlength=_BINS)
        first = last
    return count, total


def log_slopes(radii: np.ndarray, variance: np.ndarray) -> np.ndarray:
    """Slopes of the least-squares lines through ln of the rows of `variance` (..., m) against ln radii (m,)."""
    x = np.log(radii)
    x = x - x.mean()
    with np.errstate(divide="ignore"):
        return np.log(variance) @ x / (x @ x)


# --- of the fluid at equilibrium ----------------------------------------------------------------------------


def structure_factor_at_zero(phi: float) -> float:
    """S(q -> 0) of hard spheres, the compressibility of Carnahan & Starling (J. Chem. Phys. 51, 635, 1969).

    S(0) = (1 - phi)^4 / [(1 + 2 phi)^2 + phi^3 (phi - 4)], of a fluid: phi up to 0.494.
    """
    return (1.0 - phi) ** 4 / ((1.0 + 2.0 * phi) ** 2 + phi**3 * (phi - 4.0))


def equilibrium_structure_factor(q: np.ndarray | float, phi: float, diameter: float = 2.0) -> np.ndarray:
    """S(q) of the hard-sphere fluid, q in 1/a, phi that of spheres of `diameter`; a fluid: phi up to 0.494.

    Percus & Yevick's closed form (Wertheim, Phys. Rev. Lett. 10, 321, 1963), whose long waves (wave lengths above
    about three diameters) are brought to `structure_factor_at_zero`, 4 to 9 % higher at phi = 0.3 to 0.49.
    """
    q = np.asarray(q, float)
    closed = _percus_yevick(q * diameter, phi)
    excess = structure_factor_at_zero(phi) / _percus_yevick(np.zeros(1), phi)[0] - 1.0
    return closed * (1.0 + excess * np.exp(-((0.5 * diameter * q) ** 2)))


def _percus_yevick(k: np.ndarray, phi: float) -> np.ndarray:
    """1/(1 - rho c(k)), k in inverse diameters; below 0.05 its value there (1e-3 off)."""
    k = np.maximum(k, 0.05)
    sine, cosine = np.sin(k), np.cos(k)
    a = (1.0 + 2.0 * phi) ** 2 / (1.0 - phi) ** 4
    b = -6.0 * phi * (1.0 + 0.5 * phi) ** 2 / (1.0 - phi) ** 4
    first = a * (sine - k * cosine) / k**2
    second = b * (2.0 * k * sine + (2.0 - k * k) * cosine - 2.0) / k**3
    third = 0.5 * phi * a * (-(k**4) * cosine + 4.0 * ((3.0 * k * k - 6.0) * cosine + (k**3 - 6.0 * k) * sine + 6.0))
    return 1.0 / (1.0 + 24.0 * phi * (first + second + third / k**5) / k)


def equilibrium_variance(number: int, length: float, radii: np.ndarray, phi: float, diameter: float) -> np.ndarray:
    """sigma^2(r) of the fluid in a cell of `number` spheres, phi that of spheres of `diameter`; radii (m,).

    Of the infinite fluid, rho v + rho/(2 pi^2) int (S - 1) w^2 q^2 dq with w(q) the transform of the test sphere, less
    what the fixed number takes: S(0) N (v/V)^2. Beside averages over Monte Carlo packings, N = 500 to 2000, it is right
    to 2 % at phi = 0.3 to 0.49 and to 5 % at 0.1 (N = 500), beta to 0.02 and 0.05.
    """
    q = np.linspace(1e-3, _LARGEST_WAVE, _WAVES)
    missing = equilibrium_structure_factor(q, phi, diameter) - 1.0
    variance = np.empty(len(radii))
    for i, r in enumerate(radii):
        volume = 4.0 * np.pi / 3.0 * r**3
        wave = 4.0 * np.pi * (np.sin(q * r) - q * r * np.cos(q * r)) / q**3
        integral = np.trapezoid(missing * (q * wave) ** 2, q) / (2.0 * np.pi**2)
        fixed = structure_factor_at_zero(phi) * (volume / length**3) ** 2
        variance[i] = number * ((volume + integral) / length**3 - fixed)
    return variance


def equilibrium_exponent(number: int, length: float, phi: float, diameter: float) -> float:
    """`variance_exponent` of the fluid at equilibrium in such a cell, by `equilibrium_variance`."""
    radii = variance_radii(length)
    return float(log_slopes(radii, equilibrium_variance(number, length, radii, phi, diameter)))


def needed_travel(phi: float, length: float, decay: float) -> float:
    """Rms displacement of a sphere in which the cell's longest wave decays by exp(-decay): sqrt(6 decay S(0)) L/2 pi.

    A density wave decays like exp(-D k^2 t/S(k)), its share in S twice as fast, while a sphere travels sqrt(6 D t).
    """
    return math.sqrt(6.0 * decay * structure_factor_at_zero(phi)) * length / (2.0 * math.pi)
