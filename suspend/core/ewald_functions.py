"""Scalar functions of the Ewald sum: the weight of the wave part, the seven functions of the real part.

Spheres of radius 1, units 6 pi eta0 a^n. The total mobility of two spheres at centre distance r is that of
Faxen's laws at both ends (form factors sin k / k for forces, 3 j1(k)/k for torques and stresslets), for
overlapping spheres too; the real part is the total less the wave part.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from suspend.core.jit import kernel, scalar


class WeightTable(NamedTuple):
    """W(k) as polynomials: sum_{d<=7} coefficients[i, d] u^d with k^2 inv_dt = i + 1/2 + u, 0 beyond kmax2."""

    inv_dt: float
    kmax2: float
    coefficients: np.ndarray  # (intervals, 8)


class RadialTable(NamedTuple):
    """Wave part's f1 f2 g1 g2 h1 h2 h3: sum_{d<=7} coefficients[i, d, f] u^d with r inv_dr = i + 1/2 + u."""

    inv_dr: float
    coefficients: np.ndarray  # (intervals, 8, 7)
    cutoff: float  # r_c, radii: the real part is left out from here on


@scalar
def wave_weight(table, k2):
    """W at the squared wave number `k2`; zero beyond kmax."""
    if k2 > table.kmax2:
        return 0.0
    c = table.coefficients
    x = k2 * table.inv_dt
    i = min(int(x), c.shape[0] - 1)
    u = x - i - 0.5
    low = c[i, 0] + u * (c[i, 1] + u * (c[i, 2] + u * c[i, 3]))
    high = c[i, 4] + u * (c[i, 5] + u * (c[i, 6] + u * c[i, 7]))
    u2 = u * u
    return low + u2 * u2 * high


@kernel
def wave_weights(table, k, weight):
    """W at the wave numbers k (n,) into `weight` (n,)."""
    for i in range(k.shape[0]):
        weight[i] = wave_weight(table, k[i] * k[i])


@scalar
def total_functions(r, out):
    """f1 f2 g1 g2 h1 h2 h3 of two spheres in an unbounded fluid at centre distance r > 0 into out[0:7].

    r >= 2: Durlofsky, Brady & Bossis (1987). r < 2: the integrals (3/pi) int_0^inf W(k) (...) dk with
    W = j0^2, j0 s1, s1^2, s1 = 3 j1/k, in closed form; f1, f2 are those of Rotne & Prager (1969).
    """
    if r >= 2.0:
        i1 = 1.0 / r
        i2 = i1 * i1
        i3 = i1 * i2
        i4, i5 = i2 * i2, i2 * i3
        out[0] = 0.75 * i1 + 0.5 * i3
        out[1] = 1.5 * i1 - i3
        out[2] = 0.75 * i2 + 1.2 * i4
        out[3] = -0.75 * i2 + 1.2 * i4
        out[4] = -0.75 * i3 + 0.9 * i5
        out[5] = -2.25 * i3 - 4.5 * i5
        out[6] = 2.25 * i3 - 4.5 * i5
    else:
        r2 = r * r
        out[0] = 1.0 - r * (9.0 / 32.0)
        out[1] = 1.0 - r * (3.0 / 16.0)
        out[2] = r * (3.0 / 5.0 - r * (15.0 / 64.0))
        out[3] = r * (-3.0 / 20.0 + r * (3.0 / 64.0))
        out[4] = -3.0 / 10.0 + r * (9.0 / 64.0 - r2 * (3.0 / 512.0))
        out[5] = r * (-45.0 / 64.0 + r2 * (63.0 / 512.0))
        out[6] = r * (9.0 / 64.0 - r2 * (9.0 / 512.0))


@scalar
def real_functions(table, r, out):
    """f1 f2 g1 g2 h1 h2 h3 of the real part (total less wave) at 0 < r <= table.cutoff into out[0:7]."""
    total_functions(r, out)
    c = table.coefficients
    x = r * table.inv_dr
    i = min(int(x), c.shape[0] - 1)
    u = x - i - 0.5
    u2 = u * u
    u4 = u2 * u2
    for f in range(7):
        low = c[i, 0, f] + u * c[i, 1, f] + u2 * (c[i, 2, f] + u * c[i, 3, f])
        high = c[i, 4, f] + u * c[i, 5, f] + u2 * (c[i, 6, f] + u * c[i, 7, f])
        out[f] -= low + u4 * high


@kernel
def real_functions_at(table, r, out):
    """The functions of the real part at distances r (n,) into out (n, 7)."""
    for i in range(r.shape[0]):
        real_functions(table, r[i], out[i])


@kernel
def total_functions_at(r, out):
    """The functions of the total mobility at distances r (n,) into out (n, 7)."""
    for i in range(r.shape[0]):
        total_functions(r[i], out[i])
