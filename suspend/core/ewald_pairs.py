"""Real-space far-field kernels: scalars of every pair, and the mobility product for both spheres at once.

With e = (x_i - x_j)/r and the seven functions f1, f2, g1, g2, h1, h2, h3 of the real part
(`suspend.core.ewald_functions`), the motion of sphere i from force F, torque T and stresslet S on sphere j is

    U     = f1 F + [f' (e.F) - q2 (e.S.e)] e + q1 S.e - p e x T
    Omega = -p e x F + t0 T + t1 (e.T) e - 2 t1 e x (S.e)
    E     = [e w + w e] + s0 S + [h3 (e.S.e) - g2 (e.F)] 1
    2 w   = -q1 F + 2 t1 e x T + s1 S.e + [q2 (e.F) - s2 (e.S.e)] e

    f' = f2 - f1, q1 = g1 + g2, q2 = g1 + 4 g2, p = (g1 - g2)/2, t1 = (h3 - h2)/4, t0 = -(5 h1 + h3)/2 - t1,
    s0 = -(3 h1 + h3), s1 = h2 + 3 h3, s2 = h2 + 6 h3;

that of j from i is the same with -e. It follows from the finite-size Oseen kernels with Faxen's law at both
ends (Durlofsky, Brady & Bossis 1987), S symmetric and traceless; E is traceless for any seven functions and
the pair's (22, 22) matrix is symmetric.

Pairs are packed in blocks of `LANES` pairs of one sphere, component by component, so that the compiler turns
the loop over the lanes into vector instructions; the last block of a sphere is filled up with zero scalars.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from suspend.core.ewald_functions import real_functions
from suspend.core.jit import inlined, kernel
from suspend.core.pairs import separation

LANES = 8
BLOCK = 10 * LANES  # e, f1, f', q1, q2, t0, t1, s0 of every lane
LOAD = 12  # components of a sphere in the kernels: F, T, Sxx, Syy, Szz, Sxy, Sxz, Syz
MOTION = 11  # U, Omega, Exx, Eyy, Exy, Exz, Eyz
THEIRS, OWN, OTHERS = 10, 10 + LOAD, 10 + LOAD + MOTION  # rows of the workspace behind the scalars:
WORKSPACE = (OTHERS + MOTION) * LANES  # loads of the other spheres, motion of this one, motions of the others
_INV_R2, _INV_R6 = 1.0 / math.sqrt(2.0), 1.0 / math.sqrt(6.0)


class PackedPairs(NamedTuple):
    """Pairs within the real-space cutoff: blocks row[i, 0]:row[i, 1] are those of sphere i."""

    row: np.ndarray  # (N, 2) int64
    other: np.ndarray  # (blocks, LANES) int32, the other sphere (the sphere itself in empty lanes)
    scalars: np.ndarray  # (blocks, BLOCK)


@kernel
def pack_rows(first, last, start, placed, table, packed):
    """Scalars of the pairs of spheres first:last closer than table.cutoff, packed sphere by sphere.

    placed : `suspend.core.pairs.PlacedPairs`; start : (N + 1,) first block a sphere may use. Returns the number of
    pairs.
    """
    pairs, offset, position, edge, tilt = placed
    f = np.empty(7)
    cutoff2 = table.cutoff * table.cutoff
    total = 0
    for i in range(first, last):
        block = start[i] - 1
        lane = LANES
        packed.row[i, 0] = start[i]
        for p in range(offset[i], offset[i + 1]):
            dx, dy, dz = separation(pairs, p, position, edge, tilt)
            r2 = dx * dx + dy * dy + dz * dz
            if r2 >= cutoff2:
                continue
            if lane == LANES:
                lane = 0
                block += 1
                packed.other[block] = i
                packed.scalars[block] = 0.0
            r = math.sqrt(r2)
            real_functions(table, r, f)
            s = packed.scalars[block]
            t1 = 0.25 * (f[6] - f[5])
            s[lane] = -dx / r
            s[LANES + lane] = -dy / r
            s[2 * LANES + lane] = -dz / r
            s[3 * LANES + lane] = f[0]
            s[4 * LANES + lane] = f[1] - f[0]
            s[5 * LANES + lane] = f[2] + f[3]
            s[6 * LANES + lane] = f[2] + 4.0 * f[3]
            s[7 * LANES + lane] = -0.5 * (5.0 * f[4] + f[6]) - t1
            s[8 * LANES + lane] = t1
            s[9 * LANES + lane] = -(3.0 * f[4] + f[6])
            packed.other[block, lane] = pairs[p, 1]
            lane += 1
            total += 1
        packed.row[i, 1] = block + 1
    return total


@kernel
def unpack_loads(loads, unpacked):
    """Loads (N, 11) in the basis of the package to the kernels' twelve components `unpacked` (N, 12)."""
    for i in range(loads.shape[0]):
        for c in range(6):
            unpacked[i, c] = loads[i, c]
        a, b = _INV_R2 * loads[i, 6], _INV_R6 * loads[i, 7]
        unpacked[i, 6] = a - b
        unpacked[i, 7] = -a - b
        unpacked[i, 8] = 2.0 * b
        unpacked[i, 9] = _INV_R2 * loads[i, 8]
        unpacked[i, 10] = _INV_R2 * loads[i, 9]
        unpacked[i, 11] = _INV_R2 * loads[i, 10]


@kernel
def add_motions(partial, self_terms, loads, result):
    """result (N, 11) += self terms (F, T, S) x loads + the motions partial (T, N, 11) summed in order."""
    force, torque, stresslet = self_terms
    total = np.empty(MOTION)
    for i in range(result.shape[0]):
        for c in range(MOTION):
            total[c] = partial[0, i, c]
        for t in range(1, partial.shape[0]):
            for c in range(MOTION):
                total[c] += partial[t, i, c]
        for c in range(3):
            result[i, c] += force * loads[i, c] + total[c]
            result[i, 3 + c] += torque * loads[i, 3 + c] + total[3 + c]
        result[i, 6] += stresslet * loads[i, 6] + _INV_R2 * (total[6] - total[7])
        result[i, 7] += stresslet * loads[i, 7] - 3.0 * _INV_R6 * (total[6] + total[7])
        for c in range(3):
            result[i, 8 + c] += stresslet * loads[i, 8 + c] + 2.0 * _INV_R2 * total[8 + c]


@inlined
def _motion(ex, ey, ez, f1, df, q1, q2, t0, t1, s0, load):
    """Motion (U, Omega, Exx, Eyy, Exy, Exz, Eyz) from the loads of a sphere at -e: the module's equations."""
    fx, fy, fz, tx, ty, tz, sxx, syy, szz, sxy, sxz, syz = load
    h3 = 3.0 * (t0 + t1) - 2.5 * s0
    s1 = 4.0 * (h3 - t1)
    s2 = s1 + 3.0 * h3
    g2 = (q2 - q1) * (1.0 / 3.0)
    p = 0.5 * (q1 - 2.0 * g2)
    vx = sxx * ex + sxy * ey + sxz * ez
    vy = sxy * ex + syy * ey + syz * ez
    vz = sxz * ex + syz * ey + szz * ez
    n = ex * vx + ey * vy + ez * vz
    d = ex * fx + ey * fy + ez * fz
    k1, k2, k3 = ey * tz - ez * ty, ez * tx - ex * tz, ex * ty - ey * tx
    c1, c2, c3 = ey * fz - ez * fy, ez * fx - ex * fz, ex * fy - ey * fx
    m1, m2, m3 = ey * vz - ez * vy, ez * vx - ex * vz, ex * vy - ey * vx
    along = df * d - q2 * n
    spin = t1 * (ex * tx + ey * ty + ez * tz)
    t2 = 2.0 * t1
    stretch = 0.5 * (q2 * d - s2 * n)
    unit = h3 * n - g2 * d
    q, s = 0.5 * q1, 0.5 * s1
    wx = s * vx + t1 * k1 - q * fx + stretch * ex
    wy = s * vy + t1 * k2 - q * fy + stretch * ey
    wz = s * vz + t1 * k3 - q * fz + stretch * ez
    return (
        f1 * fx + along * ex + q1 * vx - p * k1,
        f1 * fy + along * ey + q1 * vy - p * k2,
        f1 * fz + along * ez + q1 * vz - p * k3,
        t0 * tx + spin * ex - t2 * m1 - p * c1,
        t0 * ty + spin * ey - t2 * m2 - p * c2,
        t0 * tz + spin * ez - t2 * m3 - p * c3,
        2.0 * ex * wx + s0 * sxx + unit,
        2.0 * ey * wy + s0 * syy + unit,
        ex * wy + ey * wx + s0 * sxy,
        ex * wz + ez * wx + s0 * sxz,
        ey * wz + ez * wy + s0 * syz,
    )


@kernel
def _block_motions(own, w):
    """Both motions of the pairs of a block in the workspace `w`.

    One flat array with fixed places: only then does the compiler see that the lanes are independent.
    """
    for k in range(LANES):
        ex, ey, ez = w[k], w[LANES + k], w[2 * LANES + k]
        f1, df, q1, q2 = w[3 * LANES + k], w[4 * LANES + k], w[5 * LANES + k], w[6 * LANES + k]
        t0, t1, s0 = w[7 * LANES + k], w[8 * LANES + k], w[9 * LANES + k]
        theirs = (
            w[10 * LANES + k],
            w[11 * LANES + k],
            w[12 * LANES + k],
            w[13 * LANES + k],
            w[14 * LANES + k],
            w[15 * LANES + k],
            w[16 * LANES + k],
            w[17 * LANES + k],
            w[18 * LANES + k],
            w[19 * LANES + k],
            w[20 * LANES + k],
            w[21 * LANES + k],
        )
        a = _motion(ex, ey, ez, f1, df, q1, q2, t0, t1, s0, theirs)
        b = _motion(-ex, -ey, -ez, f1, df, q1, q2, t0, t1, s0, own)
        w[22 * LANES + k] += a[0]
        w[23 * LANES + k] += a[1]
        w[24 * LANES + k] += a[2]
        w[25 * LANES + k] += a[3]
        w[26 * LANES + k] += a[4]
        w[27 * LANES + k] += a[5]
        w[28 * LANES + k] += a[6]
        w[29 * LANES + k] += a[7]
        w[30 * LANES + k] += a[8]
        w[31 * LANES + k] += a[9]
        w[32 * LANES + k] += a[10]
        w[33 * LANES + k] = b[0]
        w[34 * LANES + k] = b[1]
        w[35 * LANES + k] = b[2]
        w[36 * LANES + k] = b[3]
        w[37 * LANES + k] = b[4]
        w[38 * LANES + k] = b[5]
        w[39 * LANES + k] = b[6]
        w[40 * LANES + k] = b[7]
        w[41 * LANES + k] = b[8]
        w[42 * LANES + k] = b[9]
        w[43 * LANES + k] = b[10]


@kernel
def apply_rows(first, last, packed, loads, motion):
    """Add the motions (N, 11) due to the pairs of spheres first:last; loads (N, 12) of `unpack_loads`."""
    w = np.zeros(WORKSPACE)
    for i in range(first, last):
        begin, end = packed.row[i, 0], packed.row[i, 1]
        if begin == end:
            continue
        x = loads[i]
        own = (x[0], x[1], x[2], x[3], x[4], x[5], x[6], x[7], x[8], x[9], x[10], x[11])
        w[OWN * LANES : OTHERS * LANES] = 0.0
        for block in range(begin, end):
            other = packed.other[block]
            w[:BLOCK] = packed.scalars[block]
            for k in range(LANES):
                y = loads[other[k]]
                for c in range(LOAD):
                    w[(THEIRS + c) * LANES + k] = y[c]
            _block_motions(own, w)
            for k in range(LANES):
                y = motion[other[k]]
                for c in range(MOTION):
                    y[c] += w[(OTHERS + c) * LANES + k]
        for c in range(MOTION):
            total = 0.0
            for k in range(LANES):
                total += w[(OWN + c) * LANES + k]
            motion[i, c] += total
