"""Functions of the distance of the wave part, their table, and the self terms of the real part.

With W_DD = W, W_FD = W (1 - k^2/15), W_FF = W (1 - k^2/15)^2 and phi_n = j_n(kr)/(kr)^n, the wave part of the
mobility of two spheres in an unbounded fluid is (3/pi) int_0^kmax (...) dk of

    f1: W_FF (phi_0 - phi_1)             f2: W_FF 2 phi_1
    g1: W_FD k^2 r (phi_1 - phi_2)       g2: -W_FD k^2 r phi_2
    h1: -W k^2 phi_2    h2: W k^2 (phi_0 - 4 phi_1 + 5 phi_2)    h3: W k^2 (5 phi_2 - phi_1)

(Hasimoto 1959; Fiore & Swan 2018 for the form of the integrals, here with derivatives taken analytically).
Radii a = 1, units 6 pi eta0 a^n.
"""

from __future__ import annotations

import math

import numpy as np

from suspend.core.ewald_functions import RadialTable, total_functions_at

DEGREE = 7
INTERVALS = 160  # error below 1e-13 up to K r_c = 40
SELF = np.array([1.0, 0.75, 0.9])  # mobility of a lone sphere: force, torque, stresslet


def reduced_bessel(x: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """phi_n = j_n(x)/x^n for n = 0, 1, 2 and x >= 0; upward recursion, power series below x = 2."""
    small = x < 2.0
    y = np.where(small, 2.0, x)
    sine, cosine = np.sin(y), np.cos(y)
    phi0 = sine / y
    phi1 = (phi0 - cosine) / y**2
    phi2 = (3.0 * phi1 - phi0) / y**2
    functions = [phi0, phi1, phi2]
    z = -0.5 * x[small] ** 2
    for n in range(3):  # sum_m z^m / (m! (2n+1)(2n+3)..(2n+2m+1)), 1/(2n+1)!! in front
        term = np.full_like(z, 1.0 / math.prod(range(1, 2 * n + 2, 2)))
        total = term.copy()
        for m in range(1, 16):
            term = term * z / (m * (2 * n + 2 * m + 1))
            total += term
        functions[n][small] = total
    return tuple(functions)


def quadrature(kmax: float, r_max: float) -> tuple[np.ndarray, np.ndarray]:
    """Gauss-Legendre nodes on [0, kmax] and (3/pi) dk, fit for the integrals at all r <= r_max."""
    nodes, weights = np.polynomial.legendre.leggauss(int(70 + 0.6 * kmax * r_max))
    return 0.5 * kmax * (nodes + 1.0), (3.0 / np.pi) * 0.5 * kmax * weights


def functions_of_weight(k: np.ndarray, weight: np.ndarray, r: np.ndarray) -> np.ndarray:
    """f1 f2 g1 g2 h1 h2 h3 at r (n,) >= 0 of a wave part: (n, 7), or (n, 7, m) of m of them.

    weight : (3/pi) W(k) dk at the nodes k of a quadrature, (nodes,) or (nodes, m)
    """
    column = (-1,) + (1,) * (weight.ndim - 1)
    factor, k2, s = (1.0 - k**2 / 15.0).reshape(column), (k**2).reshape(column), r.reshape(column)
    phi0, phi1, phi2 = reduced_bessel(np.outer(r, k))
    ff, fd, dd = weight * factor**2, weight * factor * k2, weight * k2
    one, two = phi1 @ fd, phi2 @ fd
    p0, p1, p2 = phi0 @ dd, phi1 @ dd, phi2 @ dd
    f1, f2 = (phi0 - phi1) @ ff, 2.0 * (phi1 @ ff)
    return np.stack([f1, f2, s * (one - two), -s * two, -p2, p0 - 4 * p1 + 5 * p2, 5 * p2 - p1], axis=1)


def wave_functions(split, r: np.ndarray) -> np.ndarray:
    """f1 f2 g1 g2 h1 h2 h3 (n, 7) of the wave part at distances r (n,) >= 0, to about 1e-15."""
    k, dk = quadrature(split.kmax, float(r.max()))
    return functions_of_weight(k, dk * split.exact_wave(k), r)


def total_functions(r: np.ndarray) -> np.ndarray:
    """f1 f2 g1 g2 h1 h2 h3 (n, 7) of two spheres in an unbounded fluid at distances r (n,) > 0."""
    total = np.empty((len(r), 7))
    total_functions_at(r, total)
    return total


def interval_polynomials(function, end: float, intervals: int) -> np.ndarray:
    """Coefficients (intervals, DEGREE+1, ...) of interpolants in u, x = (i + 1/2 + u) end/intervals.

    function : from abscissae (n,) in [0, end] to values (n,) or (n, m). Chebyshev nodes in each interval; u is
    counted from its middle, so that the powers do not amplify round-off.
    """
    u = -0.5 * np.cos(np.pi * (np.arange(DEGREE + 1) + 0.5) / (DEGREE + 1))
    to_power = np.linalg.inv(np.vander(u, increasing=True))
    x = (np.arange(intervals)[:, None] + (0.5 + u)) * (end / intervals)
    values = function(x.ravel())
    values = values.reshape(intervals, DEGREE + 1, *values.shape[1:])
    return np.ascontiguousarray(np.einsum("du,iu...->id...", to_power, values))


def radial_table(split) -> RadialTable:
    """Table of the wave part's functions on [0, r_c] for `suspend.core.ewald_functions.real_functions`.

    Interpolation error below 1e-13 (absolute, units 6 pi eta0 a^n) for kmax r_c <= 40.
    """
    coefficients = interval_polynomials(lambda r: wave_functions(split, r), split.cutoff, INTERVALS)
    return RadialTable(INTERVALS / split.cutoff, coefficients, split.cutoff)


def wave_self(split) -> np.ndarray:
    """The wave part's value at r = 0 in an unbounded fluid: (force, torque, stresslet)."""
    f1, _, _, _, h1, _, h3 = wave_functions(split, np.zeros(1))[0]
    return np.array([f1, -0.5 * (5.0 * h1 + h3), -(3.0 * h1 + h3)])


def self_terms(split) -> tuple[float, float, float]:
    """Self mobility of the real part, (1, 3/4, 9/10) less the wave part's: (force, torque, stresslet)."""
    force, torque, stresslet = SELF - wave_self(split)
    return float(force), float(torque), float(stresslet)
