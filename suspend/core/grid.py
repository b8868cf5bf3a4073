"""Spreading of forces and dipoles to a grid along the lattice vectors, interpolation, and the product over modes.

Cell vectors (L,0,0), (tilt L, L, 0), (0,0,L); lattice coordinates x = L (s1 + tilt s2), y = L s2, z = L s3, so that
d_x = D1, d_y = D2 - tilt D1, d_z = D3 with D = (1/L) d/ds. A sphere's functional of a velocity field u is

    l(u) = F_q (1 + lap/15) u_q + C_qp d_p u_q,      C_qp = S_qp - eps_qpk T_k / 2,

with lap = (1 + tilt^2) D11 - 2 tilt D12 + D22 + D33. Spreading adds l to the grid with the separable window
w1(s1) w1(s2) w1(s3) in the place of the delta function; interpolation is its exact transpose.

The grid is (M3, M2, 3, row): lattice axis 3, axis 2, component, axis 1, whose rows are longer than M1 by the width
of a stencil, so that no stencil wraps along it: `close_rows` folds the overhang, `open_rows` copies it back.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from suspend.core.ewald_functions import wave_weight
from suspend.core.jit import kernel, scalar
from suspend.core.lanes import load, multiply_add, scaled, store, total

BLOCK = 8  # grid points a side: what the windows of a block's spheres reach stays in the cache
_R2, _R6 = math.sqrt(0.5), math.sqrt(1.0 / 6.0)


class Stencil(NamedTuple):
    """Windows of all spheres at the present positions, in the order of blocks of the grid (`block_of`)."""

    sphere: np.ndarray  # (N,) which sphere
    base: np.ndarray  # (N, 3) first grid point along each axis
    weight: np.ndarray  # (N, 3, 3, padded support): axis, derivative with respect to x_j, point
    first: np.ndarray  # first of the spheres of each block of base points (`block_of`)


@kernel
def locate_rows(first, last, position, edge, tilt, shape, support, base, fraction):
    """First grid point (N, 3) of each sphere's window and its distance (N, 3) from the window's edge, in cells."""
    for i in range(first, last):
        s2 = position[i, 1] / edge
        s = (position[i, 0] / edge - tilt * s2, s2, position[i, 2] / edge)
        for d in range(3):
            m = shape[d]
            x = (s[d] - math.floor(s[d])) * m - 0.5 * support
            g = math.ceil(x)
            fraction[i, d] = g - x
            base[i, d] = int(g) % m


@scalar
def blocks(shape):
    """Number of blocks in a layer (along axes 1 and 2) and number of layers (along axis 3)."""
    one, two, three = shape
    return (one + BLOCK - 1) // BLOCK * ((two + BLOCK - 1) // BLOCK), (three + BLOCK - 1) // BLOCK


@scalar
def block_of(base, i, shape):
    """Block of sphere i: axis 3, then 2, then 1."""
    across = (shape[1] + BLOCK - 1) // BLOCK
    along = (shape[0] + BLOCK - 1) // BLOCK
    return (base[i, 2] // BLOCK * across + base[i, 1] // BLOCK) * along + base[i, 0] // BLOCK


@kernel
def sort_by_block(base, shape, first, order):
    """Order of the spheres by block (counting sort, stable); `first` as in `Stencil`."""
    layer, layers = blocks(shape)
    first[:] = 0
    for i in range(base.shape[0]):
        first[block_of(base, i, shape) + 1] += 1
    for r in range(layer * layers):
        first[r + 1] += first[r]
    for i in range(base.shape[0]):
        r = block_of(base, i, shape)
        order[first[r]] = i
        first[r] += 1
    for r in range(layer * layers, 0, -1):
        first[r] = first[r - 1]
    first[0] = 0


@kernel
def weight_rows(first, last, base, fraction, scale, polynomials, stencil, lanes):
    """Fill `stencil` rows first:last: windows and derivatives with respect to x_j in radii.

    polynomials : (3, degree + 1, padded support) in 2 fraction - 1, highest power first; scale (3,) = M/L.
    """
    width = len(lanes)
    degree, padded = polynomials.shape[1] - 1, polynomials.shape[2]
    for i in range(first, last):
        j = stencil.sphere[i]
        for d in range(3):
            stencil.base[i, d] = base[j, d]
            v = 2.0 * fraction[j, d] - 1.0
            factor = 1.0
            for n in range(3):
                for p in range(0, padded, width):
                    at = n * (degree + 1) * padded + p
                    w = load(polynomials, at, lanes)
                    for _ in range(degree):
                        at += padded
                        w = multiply_add(v, w, load(polynomials, at, lanes))
                    store(stencil.weight, ((i * 3 + d) * 3 + n) * padded + p, scaled(factor, w))
                factor *= scale[d]


@scalar
def moments(loads, i, tilt):
    """For each component q: F_q, C_qx - tilt C_qy, C_qy, C_qz, F_q/15 (15 floats) from [F T S] of sphere i."""
    fx, fy, fz = loads[i, 0], loads[i, 1], loads[i, 2]
    tx, ty, tz = 0.5 * loads[i, 3], 0.5 * loads[i, 4], 0.5 * loads[i, 5]
    d, e = _R2 * loads[i, 6], _R6 * loads[i, 7]
    xy, xz, yz = _R2 * loads[i, 8], _R2 * loads[i, 9], _R2 * loads[i, 10]
    cxy, cyx, cxz, czx, cyz, czy = xy - tz, xy + tz, xz + ty, xz - ty, yz - tx, yz + tx
    cyy = -d - e
    x = (fx, d - e - tilt * cxy, cxy, cxz, fx / 15.0)
    y = (fy, cyx - tilt * cyy, cyy, cyz, fy / 15.0)
    z = (fz, czx - tilt * czy, czy, 2.0 * e, fz / 15.0)
    return x, y, z


@scalar
def spread_profiles(m, tilt, w3, d3, s3, w, d, s):
    """Profiles along axis 1 that multiply the window along axis 2 and its first and second derivative.

    m : moments of one component; w3, d3, s3 : window along axis 3; w, d, s : along axis 1 (lanes).
    """
    value = scaled(m[0] * w3 + m[3] * d3 + m[4] * s3, w)
    value = multiply_add(m[1] * w3, d, value)
    value = multiply_add((1.0 + tilt * tilt) * m[4] * w3, s, value)
    slope = multiply_add(-2.0 * tilt * m[4] * w3, d, scaled(m[2] * w3, w))
    return value, slope, scaled(m[4] * w3, w)


@kernel
def spread_sphere(i, planes, stencil, loads, tilt, grid, support, lanes):
    """Add sphere i of the stencil to the grid's planes[0]:planes[1]."""
    weight = stencil.weight
    padded = weight.shape[3]
    at = 9 * padded * i
    row = grid.shape[3]
    mx, my, mz = moments(loads, stencil.sphere[i], tilt)
    z = stencil.base[i, 2] - 1
    for i3 in range(support):
        z += 1
        if z >= grid.shape[0]:
            z -= grid.shape[0]
        if z < planes[0] or z >= planes[1]:
            continue
        w3, d3, s3 = weight[i, 2, 0, i3], weight[i, 2, 1, i3], weight[i, 2, 2, i3]
        for strip in range(0, padded, len(lanes)):
            w = load(weight, at + strip, lanes)
            d = load(weight, at + padded + strip, lanes)
            s = load(weight, at + 2 * padded + strip, lanes)
            x0, x1, x2 = spread_profiles(mx, tilt, w3, d3, s3, w, d, s)
            y0, y1, y2 = spread_profiles(my, tilt, w3, d3, s3, w, d, s)
            z0, z1, z2 = spread_profiles(mz, tilt, w3, d3, s3, w, d, s)
            y = stencil.base[i, 1] - 1
            for i2 in range(support):
                y += 1
                if y >= grid.shape[1]:
                    y -= grid.shape[1]
                w2, d2, s2 = weight[i, 1, 0, i2], weight[i, 1, 1, i2], weight[i, 1, 2, i2]
                g = (z * grid.shape[1] + y) * 3 * row + stencil.base[i, 0] + strip
                v = multiply_add(d2, x1, multiply_add(w2, x0, load(grid, g, lanes)))
                store(grid, g, multiply_add(s2, x2, v))
                v = multiply_add(d2, y1, multiply_add(w2, y0, load(grid, g + row, lanes)))
                store(grid, g + row, multiply_add(s2, y2, v))
                v = multiply_add(d2, z1, multiply_add(w2, z0, load(grid, g + 2 * row, lanes)))
                store(grid, g + 2 * row, multiply_add(s2, z2, v))


@kernel
def spread_planes(planes, stencil, loads, tilt, grid, length, support, lanes):
    """All spheres' loads on planes[0]:planes[1] of the grid, always in the order of the stencil."""
    m3 = grid.shape[0]
    layer, layers = blocks((length, grid.shape[1], m3))
    grid[planes[0] : planes[1]] = 0.0
    for b in range(layers):
        low = b * BLOCK
        if (planes[0] - low) % m3 >= BLOCK - 1 + support and not planes[0] <= low < planes[1]:
            continue  # no window of the block reaches the planes
        for i in range(stencil.first[b * layer], stencil.first[(b + 1) * layer]):
            spread_sphere(i, planes, stencil, loads, tilt, grid, support, lanes)


@kernel
def close_rows(planes, grid, length, support):
    """Fold the overhang of the rows of some planes onto their beginning."""
    for z in range(planes[0], planes[1]):
        for y in range(grid.shape[1]):
            for c in range(3):
                for x in range(support - 1):
                    grid[z, y, c, x] += grid[z, y, c, length + x]


@kernel
def open_rows(planes, grid, length, support):
    """Repeat the beginning of the rows of some planes in their overhang (the rest of it is zero)."""
    for z in range(planes[0], planes[1]):
        for y in range(grid.shape[1]):
            for c in range(3):
                for x in range(support - 1):
                    grid[z, y, c, length + x] = grid[z, y, c, x]
                for x in range(length + support - 1, grid.shape[3]):
                    grid[z, y, c, x] = 0.0


@scalar
def add_profiles(sums, tilt, w3, d3, s3, q0, q1, q2, w, d, s):
    """Add one plane of one component to its four sums: (1 + lap/15) u, D1 u, D2 u, D3 u (lanes).

    q0, q1, q2 : rows summed with the window along axis 2 and its derivatives; the rest as `spread_profiles`.
    """
    value = multiply_add(w3 / 15.0, q2, scaled(w3 + s3 / 15.0, q0))
    value = multiply_add(w, value, sums[0])
    value = multiply_add(s, scaled((1.0 + tilt * tilt) / 15.0 * w3, q0), value)
    value = multiply_add(d, scaled(-2.0 * tilt / 15.0 * w3, q1), value)
    return (
        value,
        multiply_add(d, scaled(w3, q0), sums[1]),
        multiply_add(w, scaled(w3, q1), sums[2]),
        multiply_add(w, scaled(d3, q0), sums[3]),
    )


@kernel
def gather_sphere(i, stencil, tilt, grid, support, lanes):
    """Transpose of `spread_sphere`: for each component (1 + lap/15) u, D1 u, D2 u, D3 u (lanes, to be summed)."""
    weight = stencil.weight
    padded = weight.shape[3]
    row = grid.shape[3]
    first = 9 * padded * i
    zero = scaled(0.0, load(weight, first, lanes))
    x = y = z = (zero, zero, zero, zero)
    m3 = stencil.base[i, 2] - 1
    for i3 in range(support):
        m3 += 1
        if m3 >= grid.shape[0]:
            m3 -= grid.shape[0]
        w3, d3, s3 = weight[i, 2, 0, i3], weight[i, 2, 1, i3], weight[i, 2, 2, i3]
        for strip in range(0, padded, len(lanes)):
            a0, a1, a2, b0, b1, b2, c0, c1, c2 = zero, zero, zero, zero, zero, zero, zero, zero, zero
            m2 = stencil.base[i, 1] - 1
            for i2 in range(support):
                m2 += 1
                if m2 >= grid.shape[1]:
                    m2 -= grid.shape[1]
                w2, d2, s2 = weight[i, 1, 0, i2], weight[i, 1, 1, i2], weight[i, 1, 2, i2]
                at = (m3 * grid.shape[1] + m2) * 3 * row + stencil.base[i, 0] + strip
                g = load(grid, at, lanes)
                a0, a1, a2 = multiply_add(w2, g, a0), multiply_add(d2, g, a1), multiply_add(s2, g, a2)
                g = load(grid, at + row, lanes)
                b0, b1, b2 = multiply_add(w2, g, b0), multiply_add(d2, g, b1), multiply_add(s2, g, b2)
                g = load(grid, at + 2 * row, lanes)
                c0, c1, c2 = multiply_add(w2, g, c0), multiply_add(d2, g, c1), multiply_add(s2, g, c2)
            w = load(weight, first + strip, lanes)
            d = load(weight, first + padded + strip, lanes)
            s = load(weight, first + 2 * padded + strip, lanes)
            x = add_profiles(x, tilt, w3, d3, s3, a0, a1, a2, w, d, s)
            y = add_profiles(y, tilt, w3, d3, s3, b0, b1, b2, w, d, s)
            z = add_profiles(z, tilt, w3, d3, s3, c0, c1, c2, w, d, s)
    return x, y, z


@scalar
def add_motion(result, j, tilt, ux, uy, uz):
    """Add [U; Omega; E] from the sums (u, D1 u, D2 u, D3 u) of each component to row j of `result` (N, 11)."""
    xx, zx = total(ux[1]), total(ux[3])  # pq: d_p u_q
    xy, zy = total(uy[1]), total(uy[3])
    xz, zz = total(uz[1]), total(uz[3])
    yx, yy, yz = total(ux[2]) - tilt * xx, total(uy[2]) - tilt * xy, total(uz[2]) - tilt * xz
    result[j, 0] += total(ux[0])
    result[j, 1] += total(uy[0])
    result[j, 2] += total(uz[0])
    result[j, 3] += 0.5 * (yz - zy)
    result[j, 4] += 0.5 * (zx - xz)
    result[j, 5] += 0.5 * (xy - yx)
    result[j, 6] += _R2 * (xx - yy)
    result[j, 7] += _R6 * (2.0 * zz - xx - yy)
    result[j, 8] += _R2 * (xy + yx)
    result[j, 9] += _R2 * (xz + zx)
    result[j, 10] += _R2 * (yz + zy)


@kernel
def gather_rows(first, last, stencil, tilt, grid, support, result, lanes):
    """Add the interpolated [U; Omega; E] of spheres first:last of the stencil to `result` (N, 11)."""
    for i in range(first, last):
        ux, uy, uz = gather_sphere(i, stencil, tilt, grid, support, lanes)
        add_motion(result, stencil.sphere[i], tilt, ux, uy, uz)


@scalar
def signed(m, size):
    """Mode number of element m of a transform of this size."""
    return m if 2 * m < size else m - size


@kernel
def scale_modes(planes, table, edge, tilt, inverse2, scaling):
    """scaling[m3, m2, n1] = (6 pi/V) W(k)/k^2 / w_hat^2 on the planes, 0 at k = 0 and beyond kmax.

    inverse2 : per axis 1/w_hat(n)^2 by element of the transform. scaling (M3, M2, n1max + 1).
    """
    unit = 2.0 * math.pi / edge
    factor = 6.0 * math.pi / edge**3
    for m3 in range(planes[0], planes[1]):
        kz = unit * signed(m3, scaling.shape[0])
        for m2 in range(scaling.shape[1]):
            n2 = signed(m2, scaling.shape[1])
            h = factor * inverse2[2][m3] * inverse2[1][m2]
            for n1 in range(scaling.shape[2]):
                kx, ky = unit * n1, unit * (n2 - tilt * n1)
                k2 = kx * kx + ky * ky + kz * kz
                value = 0.0
                if 0.0 < k2 < table.kmax2:
                    value = h * inverse2[0][n1] * wave_weight(table, k2) / k2
                scaling[m3, m2, n1] = value


@kernel
def apply_modes(planes, scaling, edge, tilt, modes):
    """modes <- scaling (I - kk/k^2) modes on some planes; modes (M3, M2, 3, n1max + 1) complex."""
    unit = 2.0 * math.pi / edge
    for m3 in range(planes[0], planes[1]):
        kz = unit * signed(m3, modes.shape[0])
        for m2 in range(modes.shape[1]):
            n2 = signed(m2, modes.shape[1])
            f = modes[m3, m2]
            b = scaling[m3, m2]
            for n1 in range(modes.shape[3]):
                kx, ky = unit * n1, unit * (n2 - tilt * n1)
                k2 = kx * kx + ky * ky + kz * kz
                h = b[n1]
                if h == 0.0:  # k = 0 among them
                    f[0, n1], f[1, n1], f[2, n1] = 0.0, 0.0, 0.0
                    continue
                along = (kx * f[0, n1] + ky * f[1, n1] + kz * f[2, n1]) / k2
                f[0, n1] = h * (f[0, n1] - kx * along)
                f[1, n1] = h * (f[1, n1] - ky * along)
                f[2, n1] = h * (f[2, n1] - kz * along)
