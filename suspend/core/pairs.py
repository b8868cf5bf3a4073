"""Near-field pair kernels: scalars of every pair, resistance products, loads and stresslets.

For equal spheres the pair resistance splits by parity. With e the unit vector from sphere i to sphere j,
U+- = U_i +- U_j, W+- = Omega_i +- Omega_j and functions f+- = f_11 +- f_12 (Jeffrey & Onishi 1984), loads
exerted by the spheres on the fluid are

    F_i + F_j = A+ U+ + YB+ e x W-        T_i + T_j = C+ W+ + YB- U- x e
    F_i - F_j = A- U- + YB- e x W+        T_i - T_j = C- W- + YB+ U+ x e

with A = XA ee + YA (1 - ee), C likewise. The strain rate E adds to the right-hand side
F_i = -F_j = XG- (e.E.e) e + 2 YG- [E.e - (e.E.e) e] and T_i = T_j = 2 YH+ e x E.e.

`scalars[p]` holds, for pair p: e (3), then the 16 combined functions in the order of `COMBINED` (A, B, C
are halved).
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from suspend.core.jit import kernel, scalar

COMBINED = ("XA+-YA+", "YA+", "XA--YA-", "YA-", "YB+", "YB-", "XC+-YC+", "YC+", "XC--YC-", "YC-",
            "XG-", "YG-", "YH+", "XM+", "YM+", "ZM+")  # fmt: skip
WIDTH = 16  # functions of a pair
STRIDE = 3 + WIDTH  # e, then the functions
# Smallest gap (radii) that 1/h is taken at. A pair pressed closer is as good as in contact: its normal force is off by
# this share, and smaller still 1/h times the round-off of the velocities would be the larger error.
STIFFEST = 1e-9
LOG_STIFFEST = math.log(STIFFEST)
TINY = 5e-324  # the smallest number above zero: a gap is never closed


class PairTable(NamedTuple):
    """Combined near-field functions for the kernels (built by `suspend.hydro.nearfield.pair_table`).

    f = singular[0]/gap + singular[1] ln(1/gap) + sum_{d<=5} coefficients[k, d] u^d
    with (ln gap - t0) inv_dt = k + u.
    """

    t0: float
    inv_dt: float
    coefficients: np.ndarray  # (intervals, 6, 16)
    singular: np.ndarray  # (2, 16)
    cutoff: float  # centre distance, radii
    taper_start: float  # centre distance from which the functions are brought to zero; cutoff = not at all
    frozen: float  # gap below which the functions are held; 0 = never


@scalar
def evaluate_combined(table, t, inverse, value):
    """The 16 combined functions at the gap (radii) with logarithm `t` and reciprocal `inverse` into `value[0:16]`.

    Below the table the polynomial part keeps its end value: there it has reached its limit at contact.
    """
    coefficients, singular = table.coefficients, table.singular
    x = (t - table.t0) * table.inv_dt
    if x < 0.0:
        x = 0.0
    k = min(int(x), coefficients.shape[0] - 1)
    u = x - k
    for f in range(WIDTH):
        smooth = coefficients[k, 5, f] * u + coefficients[k, 4, f]
        smooth = smooth * u + coefficients[k, 3, f]
        smooth = smooth * u + coefficients[k, 2, f]
        smooth = smooth * u + coefficients[k, 1, f]
        smooth = smooth * u + coefficients[k, 0, f]
        value[f] = smooth + singular[0, f] * inverse - singular[1, f] * t


@scalar
def taper(r, start, cutoff):
    """Factor bringing the functions to zero: 1 below `start`, 0 at `cutoff`, twice differentiable."""
    if r <= start:
        return 1.0
    x = (r - start) / (cutoff - start)
    return 1.0 - x * x * x * (10.0 - x * (15.0 - 6.0 * x))


class ActivePairs(NamedTuple):
    """Pairs within the cutoff by sphere: row[i, 0]:row[i, 1] are those of sphere i with spheres other[p]."""

    row: np.ndarray  # (N, 2) int64
    other: np.ndarray  # (P,) int32
    gap: np.ndarray  # (P,) surface gap h, radii


class PlacedPairs(NamedTuple):
    """A neighbour list together with the positions that its pairs are looked at in."""

    pairs: np.ndarray  # (P, 5) int32: i, j and the image numbers of j (`suspend.hydro.neighbours`)
    offset: np.ndarray  # (N+1,) int64, pairs of sphere i are rows offset[i]:offset[i+1]
    position: np.ndarray  # (N, 3), radii
    edge: float  # of the cell, radii
    tilt: float


class HeldPairs(NamedTuple):
    """Pairs whose gaps are a state of their own (`suspend.gaps`), as rows of a neighbour list and ln h."""

    rows: np.ndarray  # (K, 5) int32
    log_gap: np.ndarray  # (K,)


@kernel
def place_held(pairs, offset, held):
    """ln h by row of the neighbour list, NaN for rows that are not held; the rows may name a pair either way round."""
    log_gap = np.full(pairs.shape[0], np.nan)
    rows = held.rows
    for k in range(rows.shape[0]):
        i, j, sign = rows[k, 0], rows[k, 1], 1
        if j < i:
            i, j, sign = j, i, -1
        for p in range(offset[i], offset[i + 1]):
            same = pairs[p, 1] == j
            for c in range(2, 5):
                same = same and pairs[p, c] == sign * rows[k, c]
            if same:
                log_gap[p] = held.log_gap[k]
    return log_gap


@scalar
def separation(pairs, p, position, edge, tilt):
    """Vector from sphere i to the image of sphere j that row p of a neighbour list names (three floats)."""
    i, j = pairs[p, 0], pairs[p, 1]
    return (
        position[j, 0] - position[i, 0] + edge * (pairs[p, 2] + tilt * pairs[p, 3]),
        position[j, 1] - position[i, 1] + edge * pairs[p, 3],
        position[j, 2] - position[i, 2] + edge * pairs[p, 4],
    )


@kernel
def assemble_rows(first, last, placed, log_gap, table, active, scalars):
    """Scalars of the pairs of spheres first:last that are closer than the cutoff, packed sphere by sphere.

    log_gap : ln h of held pairs by row of the list (`place_held`), or (0,) where none is held. active.row[i] = (begin,
    end) of sphere i's packed pairs, active.other[p] = the other sphere of pair p. Returns the smallest gap (inf without
    a pair). A gap <= 0 with unfrozen functions ends the loop at once.
    """
    pairs, offset, position, edge, tilt = placed
    smallest = np.inf
    q = offset[first]
    for i in range(first, last):
        active.row[i, 0] = q
        for p in range(offset[i], offset[i + 1]):
            j = pairs[p, 1]
            dx, dy, dz = separation(pairs, p, position, edge, tilt)
            r2 = dx * dx + dy * dy + dz * dz
            if r2 >= table.cutoff * table.cutoff:
                continue
            r = math.sqrt(r2)
            gap = r - 2.0
            if log_gap.shape[0] > 0 and log_gap[p] == log_gap[p]:
                t = log_gap[p]
                smallest = min(smallest, max(math.exp(t), TINY))
                gap = math.exp(max(t, LOG_STIFFEST))
                inverse = 1.0 / gap
            else:
                smallest = min(smallest, gap)
                if gap <= 0.0 and table.frozen <= 0.0:
                    return gap
                t = math.log(max(gap, table.frozen))
                inverse = 1.0 / max(gap, table.frozen)
            value = scalars[q]
            value[0] = dx / r
            value[1] = dy / r
            value[2] = dz / r
            evaluate_combined(table, t, inverse, value[3:])
            if r > table.taper_start:
                factor = taper(r, table.taper_start, table.cutoff)
                for f in range(3, STRIDE):
                    value[f] *= factor
            active.other[q] = j
            active.gap[q] = gap
            q += 1
        active.row[i, 1] = q
    return smallest


@scalar
def pair_loads(s, ui, uj, p):
    """Loads (F_i, T_i, F_j, T_j) of a pair with scalars s[p], velocities ui[0:6] and uj[0:6] (12 floats)."""
    ex, ey, ez = s[p, 0], s[p, 1], s[p, 2]
    a1, a2, a3, a4, b1, b2 = s[p, 3], s[p, 4], s[p, 5], s[p, 6], s[p, 7], s[p, 8]
    c1, c2, c3, c4 = s[p, 9], s[p, 10], s[p, 11], s[p, 12]
    px, py, pz = ui[0] + uj[0], ui[1] + uj[1], ui[2] + uj[2]
    mx, my, mz = ui[0] - uj[0], ui[1] - uj[1], ui[2] - uj[2]
    qx, qy, qz = ui[3] + uj[3], ui[4] + uj[4], ui[5] + uj[5]
    nx, ny, nz = ui[3] - uj[3], ui[4] - uj[4], ui[5] - uj[5]
    dp = a1 * (ex * px + ey * py + ez * pz)
    dm = a3 * (ex * mx + ey * my + ez * mz)
    dq = c1 * (ex * qx + ey * qy + ez * qz)
    dn = c3 * (ex * nx + ey * ny + ez * nz)
    fx = a2 * px + dp * ex + b1 * (ey * nz - ez * ny)
    fy = a2 * py + dp * ey + b1 * (ez * nx - ex * nz)
    fz = a2 * pz + dp * ez + b1 * (ex * ny - ey * nx)
    gx = a4 * mx + dm * ex + b2 * (ey * qz - ez * qy)
    gy = a4 * my + dm * ey + b2 * (ez * qx - ex * qz)
    gz = a4 * mz + dm * ez + b2 * (ex * qy - ey * qx)
    tx = c2 * qx + dq * ex + b2 * (my * ez - mz * ey)
    ty = c2 * qy + dq * ey + b2 * (mz * ex - mx * ez)
    tz = c2 * qz + dq * ez + b2 * (mx * ey - my * ex)
    wx = c4 * nx + dn * ex + b1 * (py * ez - pz * ey)
    wy = c4 * ny + dn * ey + b1 * (pz * ex - px * ez)
    wz = c4 * nz + dn * ez + b1 * (px * ey - py * ex)
    on_i = fx + gx, fy + gy, fz + gz, tx + wx, ty + wy, tz + wz
    on_j = fx - gx, fy - gy, fz - gz, tx - wx, ty - wy, tz - wz
    return on_i + on_j


@kernel
def apply_rows(first, last, active, scalars, velocity, load):
    """Add R_nf . velocity of the pairs of spheres first:last to `load`, both (N, 6), rotation last."""
    for i in range(first, last):
        ui = (velocity[i, 0], velocity[i, 1], velocity[i, 2], velocity[i, 3], velocity[i, 4], velocity[i, 5])
        y0, y1, y2, y3, y4, y5 = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
        for p in range(active.row[i, 0], active.row[i, 1]):
            j = active.other[p]
            uj = (
                velocity[j, 0],
                velocity[j, 1],
                velocity[j, 2],
                velocity[j, 3],
                velocity[j, 4],
                velocity[j, 5],
            )
            r = pair_loads(scalars, ui, uj, p)
            y0 += r[0]
            y1 += r[1]
            y2 += r[2]
            y3 += r[3]
            y4 += r[4]
            y5 += r[5]
            load[j, 0] += r[6]
            load[j, 1] += r[7]
            load[j, 2] += r[8]
            load[j, 3] += r[9]
            load[j, 4] += r[10]
            load[j, 5] += r[11]
        load[i, 0] += y0
        load[i, 1] += y1
        load[i, 2] += y2
        load[i, 3] += y3
        load[i, 4] += y4
        load[i, 5] += y5


@kernel
def strain_loads_rows(first, last, active, scalars, strain_rate, load):
    """Add R_FE : E of the pairs of spheres first:last to `load` (N, 6); strain_rate (3, 3)."""
    for i in range(first, last):
        for p in range(active.row[i, 0], active.row[i, 1]):
            j = active.other[p]
            e = scalars[p]
            vx = strain_rate[0, 0] * e[0] + strain_rate[0, 1] * e[1] + strain_rate[0, 2] * e[2]
            vy = strain_rate[1, 0] * e[0] + strain_rate[1, 1] * e[1] + strain_rate[1, 2] * e[2]
            vz = strain_rate[2, 0] * e[0] + strain_rate[2, 1] * e[1] + strain_rate[2, 2] * e[2]
            along = vx * e[0] + vy * e[1] + vz * e[2]
            axial = (e[13] - 2.0 * e[14]) * along
            fx = axial * e[0] + 2.0 * e[14] * vx
            fy = axial * e[1] + 2.0 * e[14] * vy
            fz = axial * e[2] + 2.0 * e[14] * vz
            tx = 2.0 * e[15] * (e[1] * vz - e[2] * vy)
            ty = 2.0 * e[15] * (e[2] * vx - e[0] * vz)
            tz = 2.0 * e[15] * (e[0] * vy - e[1] * vx)
            load[i, 0] += fx
            load[i, 1] += fy
            load[i, 2] += fz
            load[i, 3] += tx
            load[i, 4] += ty
            load[i, 5] += tz
            load[j, 0] -= fx
            load[j, 1] -= fy
            load[j, 2] -= fz
            load[j, 3] += tx
            load[j, 4] += ty
            load[j, 5] += tz


@scalar
def add_own_block(s, p, sign, block):
    """Add a pair's resistance of a sphere to its own motion to `block` (6, 6).

    sign : +1 for i, -1 for j (e reversed).
    """
    a = s[p, 3] + s[p, 5], s[p, 4] + s[p, 6]
    b = sign * (s[p, 7] + s[p, 8])
    c = s[p, 9] + s[p, 11], s[p, 10] + s[p, 12]
    _fill_block(s, p, a, (b, b), c, block)


@scalar
def add_cross_block(s, p, block):
    """Add a pair's resistance of i to the motion of j to `block` (6, 6); its transpose is that of j to i."""
    a = s[p, 3] - s[p, 5], s[p, 4] - s[p, 6]
    b = s[p, 7] - s[p, 8]
    c = s[p, 9] - s[p, 11], s[p, 10] - s[p, 12]
    _fill_block(s, p, a, (-b, b), c, block)


@scalar
def _fill_block(s, p, a, b, c, block):
    """block += [[A, b0 K], [b1 K^T, C]] with A = a0 ee + a1, C = c0 ee + c1, K v = e x v."""
    e = (s[p, 0], s[p, 1], s[p, 2])
    for m in range(3):
        for n in range(3):
            block[m, n] += a[0] * e[m] * e[n]
            block[3 + m, 3 + n] += c[0] * e[m] * e[n]
        block[m, m] += a[1]
        block[3 + m, 3 + m] += c[1]
        after, before = (m + 1) % 3, (m + 2) % 3  # K[m, after] = -e[before], K[m, before] = e[after]
        block[m, 3 + after] -= b[0] * e[before]
        block[m, 3 + before] += b[0] * e[after]
        block[3 + after, m] -= b[1] * e[before]
        block[3 + before, m] += b[1] * e[after]


@scalar
def add_pair_stresslet(s, p, ui, uj, strain_rate, total):
    """Add S_i + S_j of a pair (Brady's sign) to `total` (6,), order of `suspend.conventions.COMPONENTS`.

    S = -{XG- (ee - 1/3) e.U- + YG- [e U-' + U-' e] + YH+ [e (W+ x e) + (W+ x e) e]} + 2 M+ : E,
    U-' normal to e.
    """
    e = (s[p, 0], s[p, 1], s[p, 2])
    xg, yg, yh, xm, ym, zm = s[p, 13], s[p, 14], s[p, 15], s[p, 16], s[p, 17], s[p, 18]
    m = (ui[0] - uj[0], ui[1] - uj[1], ui[2] - uj[2])
    w = (ui[3] + uj[3], ui[4] + uj[4], ui[5] + uj[5])
    v = (
        strain_rate[0, 0] * e[0] + strain_rate[0, 1] * e[1] + strain_rate[0, 2] * e[2],
        strain_rate[1, 0] * e[0] + strain_rate[1, 1] * e[1] + strain_rate[1, 2] * e[2],
        strain_rate[2, 0] * e[0] + strain_rate[2, 1] * e[1] + strain_rate[2, 2] * e[2],
    )
    speed = e[0] * m[0] + e[1] * m[1] + e[2] * m[2]
    along = e[0] * v[0] + e[1] * v[1] + e[2] * v[2]
    spin = (w[1] * e[2] - w[2] * e[1], w[2] * e[0] - w[0] * e[2], w[0] * e[1] - w[1] * e[0])
    ee = -(xg - 2.0 * yg) * speed + (3.0 * xm - 4.0 * ym + zm) * along
    unit = xg * speed / 3.0 + (zm - xm) * along
    g = (
        -yg * m[0] - yh * spin[0] + 2.0 * (ym - zm) * v[0],
        -yg * m[1] - yh * spin[1] + 2.0 * (ym - zm) * v[1],
        -yg * m[2] - yh * spin[2] + 2.0 * (ym - zm) * v[2],
    )
    for c in range(3):
        total[c] += ee * e[c] * e[c] + unit + 2.0 * e[c] * g[c] + 2.0 * zm * strain_rate[c, c]
    total[3] += ee * e[0] * e[1] + e[0] * g[1] + e[1] * g[0] + 2.0 * zm * strain_rate[0, 1]
    total[4] += ee * e[0] * e[2] + e[0] * g[2] + e[2] * g[0] + 2.0 * zm * strain_rate[0, 2]
    total[5] += ee * e[1] * e[2] + e[1] * g[2] + e[2] * g[1] + 2.0 * zm * strain_rate[1, 2]


@kernel
def stresslet_rows(first, last, active, scalars, velocity, strain_rate, total):
    """Add the pairs' stresslets of spheres first:last, summed over spheres, to `total` (6,)."""
    for i in range(first, last):
        for p in range(active.row[i, 0], active.row[i, 1]):
            add_pair_stresslet(scalars, p, velocity[i], velocity[active.other[p]], strain_rate, total)


@kernel
def stresslet_of_each(active, scalars, difference, velocity, strain_rate, each):
    """Add the pair stresslets to `each` (N, 6): S_i, S_j = half the sum plus, minus half the difference.

    `difference` are scalars with XG+, YG+, YH- in the places of XG-, YG-, YH+: the difference S_i - S_j is
    the formula of the sum with these and with sphere j's velocity reversed.
    """
    total, odd = np.empty(6), np.empty(6)
    reversed_velocity = np.empty(6)
    still = np.zeros((3, 3))
    for i in range(active.row.shape[0]):
        for p in range(active.row[i, 0], active.row[i, 1]):
            j = active.other[p]
            total[:], odd[:] = 0.0, 0.0
            for c in range(6):
                reversed_velocity[c] = -velocity[j, c]
            add_pair_stresslet(scalars, p, velocity[i], velocity[j], strain_rate, total)
            add_pair_stresslet(difference, p, velocity[i], reversed_velocity, still, odd)
            for c in range(6):
                each[i, c] += 0.5 * (total[c] + odd[c])
                each[j, c] += 0.5 * (total[c] - odd[c])
