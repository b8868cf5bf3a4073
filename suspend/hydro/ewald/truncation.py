"""What the real part left out beyond r_c amounts to, and the weight that makes it least.

For uncorrelated unit loads on spheres at volume fraction phi, placed at random beyond r_c, the relative error of
[U; Omega; E] is

    error^2 = 3 phi int_{r_c}^inf |M_real(r)|^2 r^2 dr / |M_self|^2     (Frobenius norms of 11 x 11 blocks).

M_real is affine in W, so that the best W of a linear family is the solution of a least-squares problem. The
family here, with t = (k/kmax)^2,

    W = sum_{j<=M} b_j C(M, j) t^j (1 - t)^(M - j),   b_0 = 1,  b_1 = 1 - kmax^2/(5 M),  b_j >= 0,

has the curvature of a sphere, W = 1 - k^2/5 + O(k^4), and is never negative.
"""

from __future__ import annotations

import math

import numpy as np
from scipy.optimize import lsq_linear
from scipy.special import comb

from suspend.hydro.ewald.radial import SELF, functions_of_weight, quadrature, total_functions

REFERENCE_FRACTION = 0.4  # volume fraction for which errors are predicted
REACH = 6.0  # the integral over r ends at REACH r_c, what is beyond is known in closed form
END = 1.0 - 1e-4  # the slope of W at kmax is taken from END kmax
SELF_NORM2 = float(np.repeat(SELF**2, (3, 3, 5)).sum())


def block_components(f: np.ndarray) -> np.ndarray:
    """Eleven combinations (11, n, ...) of a pair's functions f (n, 7, ...): squares add up to |M|^2."""
    f1, f2, g1, g2, h1, h2, h3 = np.moveaxis(f, 1, 0)
    q1, q2 = g1 + g2, g1 + 4.0 * g2
    along = 0.25 * (h3 - h2)
    spin = -0.5 * (5.0 * h1 + h3) - along
    root = math.sqrt(2.0)
    force = [root * f1, f2, g1 - g2, root * q1, math.sqrt(4.0 / 3.0) * (q2 - q1)]
    torque = [root * spin, spin + along, (h2 - h3) / root]
    strain = [3.0 * (h1 + h3), root * (0.5 * (h2 + h3) - 3.0 * h1), root * (3.0 * h1 + h3)]
    return np.stack(force + torque + strain)


def _beyond(cutoff: float, kmax: float, fraction: float) -> tuple[np.ndarray, np.ndarray]:
    """Distances r (n,) from r_c to REACH r_c and factors (n,), so that error^2 = sum of (factor component)^2."""
    nodes, weights = np.polynomial.legendre.leggauss(int(60 + 2.5 * kmax * cutoff))
    r = cutoff * (1.0 + 0.5 * (REACH - 1.0) * (nodes + 1.0))
    weights = 0.5 * (REACH - 1.0) * cutoff * weights
    return r, r * np.sqrt(3.0 * fraction * weights / SELF_NORM2)


def _far(cutoff: float, kmax: float, fraction: float, end: np.ndarray) -> np.ndarray:
    """Two further components (2, ...) of the error: what is beyond REACH r_c, the trace of the step of W.

    For large r, f1, g1 and h2 prevail: (3/pi) W(kmax)/r^2 times p^2/kmax, p and kmax, p = 1 - kmax^2/15, and
    cos(kmax r) or sin; the next order has W'(kmax)/r^3.
    end : W (or a basis of it) at kmax and at END kmax, (2, ...)
    """
    p = 1.0 - kmax**2 / 15.0
    amplitude = math.sqrt(2.0 * p**4 / kmax**2 + 3.0 * p**2 + 1.125 * kmax**2)
    scale = 3.0 / math.pi * amplitude * math.sqrt(1.5 * fraction / SELF_NORM2)
    r = REACH * cutoff
    slope = (end[0] - end[1]) / ((1.0 - END) * kmax)
    return scale * np.stack([end[0] / math.sqrt(r), slope / math.sqrt(3.0 * r**3)])


def truncation_error(split, fraction: float = REFERENCE_FRACTION) -> float:
    """Predicted relative 2-norm of what the real part beyond r_c adds to [U; Omega; E] for random loads.

    fraction : volume fraction; the error grows as its square root. Round-off: about 1e-12.
    """
    cutoff, kmax = split.cutoff, split.kmax
    r, factor = _beyond(cutoff, kmax, fraction)
    k, dk = quadrature(kmax, r[-1])
    wave = functions_of_weight(k, dk * split.exact_wave(k), r)
    near = factor * block_components(total_functions(r) - wave)
    far = _far(cutoff, kmax, fraction, split.exact_wave(kmax * np.array([1.0, END])))
    return math.hypot(np.linalg.norm(near), np.linalg.norm(far))


def bernstein(x: np.ndarray, degree: int) -> np.ndarray:
    """Bernstein polynomials (..., degree + 1) in t = x^2."""
    j = np.arange(degree + 1)
    t = np.asarray(x)[..., None] ** 2
    return comb(degree, j) * t**j * (1.0 - t) ** (degree - j)


def optimal_coefficients(cutoff: float, kmax: float) -> np.ndarray:
    """b_j of the weight of support kmax with the least truncation error beyond r_c.

    The degree grows with kmax r_c: a higher one gains a tenth in the error and puts more weight at kmax, where
    a grid is least accurate. Bounded least squares (Stark & Parker 1995) after a QR factorisation.
    """
    degree = max(8, math.ceil(0.7 * kmax * cutoff), math.ceil(0.25 * kmax**2))
    r, factor = _beyond(cutoff, kmax, REFERENCE_FRACTION)
    k, dk = quadrature(kmax, r[-1])
    wave = functions_of_weight(k, dk[:, None] * bernstein(k / kmax, degree), r)
    matrix = (factor[:, None] * block_components(wave)).reshape(-1, degree + 1)
    far = _far(cutoff, kmax, REFERENCE_FRACTION, bernstein(np.array([1.0, END]), degree))
    matrix = np.concatenate([matrix, -far])
    fixed = np.array([1.0, 1.0 - kmax**2 / (5.0 * degree)])
    goal = np.concatenate([(factor * block_components(total_functions(r))).reshape(-1), [0.0, 0.0]])
    goal -= matrix[:, :2] @ fixed
    triangle = np.linalg.qr(np.column_stack([matrix[:, 2:], goal]), mode="r")
    scale = np.linalg.norm(triangle[:, :-1], axis=0)
    fit = lsq_linear(triangle[:, :-1] / scale, triangle[:, -1], (0.0, np.inf), method="bvls", tol=1e-16, max_iter=2000)
    return np.concatenate([fixed, fit.x / scale])
