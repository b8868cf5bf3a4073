"""Block incomplete factorisation of the near-field resistance, the preconditioner of the velocity solve.

A ~ L D L^T with 6 x 6 blocks on the pattern of the close pairs, without fill. The diagonal blocks hold all
pairs within the cutoff, so leaving out the other blocks keeps the matrix positive definite. A pair (or a
chain of pairs) at a vanishing gap is factorised exactly: that is what makes stiff configurations solvable.
"""

from __future__ import annotations

from typing import NamedTuple

import numba
import numpy as np

from suspend.core.jit import kernel, parallel_kernel, scalar
from suspend.core.pairs import add_cross_block, add_own_block


class Factor(NamedTuple):
    """L D L^T by domains: sphere i belongs to one domain; L couples spheres of the same domain only.

    start[i]:start[i+1] are the blocks left of the diagonal in row i, column[b] < i their columns, lower[b]
    the blocks stored transposed (products then run along memory); inverse[i] = D_i^-1. `broken` counts the
    rows whose pivot was not positive definite: they were uncoupled (block Jacobi), which costs iterations,
    never accuracy.
    """

    bounds: np.ndarray  # (domains + 1,) int64
    start: np.ndarray  # (N + 1,) int64
    column: np.ndarray  # (B,) int32
    lower: np.ndarray  # (B, 6, 6)
    inverse: np.ndarray  # (N, 6, 6)
    broken: np.ndarray  # (domains,) int64
    drags: np.ndarray  # (2,) drag and rotational drag of R_self


@scalar
def cholesky(block, low):
    """Lower Cholesky factor of an SPD 6 x 6 block; False if a pivot is not positive."""
    for c in range(6):
        s = block[c, c]
        for k in range(c):
            s -= low[c, k] * low[c, k]
        if not s > 1e-14 * block[c, c]:
            return False
        low[c, c] = np.sqrt(s)
        for r in range(c + 1, 6):
            s = block[r, c]
            for k in range(c):
                s -= low[r, k] * low[c, k]
            low[r, c] = s / low[c, c]
    return True


@scalar
def solve_lower(low, x):
    """x <- low^-1 x for the six columns of x."""
    for r in range(6):
        for k in range(r):
            for c in range(6):
                x[r, c] -= low[r, k] * x[k, c]
        for c in range(6):
            x[r, c] /= low[r, r]


@scalar
def solve_upper(low, x):
    """x <- low^-T x for the six columns of x."""
    for r in range(5, -1, -1):
        for k in range(r + 1, 6):
            for c in range(6):
                x[r, c] -= low[k, r] * x[k, c]
        for c in range(6):
            x[r, c] /= low[r, r]


@kernel
def diagonal_blocks(active, scalars, drag, rotational_drag, block):
    """Diagonal 6 x 6 blocks of R_self + R_nf, all pairs included; `block` (N, 6, 6) is overwritten."""
    block[:] = 0.0
    for i in range(block.shape[0]):
        for c in range(3):
            block[i, c, c] += drag
            block[i, 3 + c, 3 + c] += rotational_drag
        for p in range(active.row[i, 0], active.row[i, 1]):
            j = active.other[p]
            add_own_block(scalars, p, 1.0, block[i])
            add_own_block(scalars, p, -1.0, block[j])
            if j == i:  # an image of itself: the cross blocks fall on the diagonal
                cross = np.zeros((6, 6))
                add_cross_block(scalars, p, cross)
                block[i] += cross + cross.T


@kernel
def close_blocks(active, scalars, below, bounds):
    """Cross blocks of the pairs with gap < `below` inside one domain, rows of lower neighbours.

    Returns (start, column, block).

    Images of one pair fall into one block. `block[b]` is the coupling of sphere column[b] to the motion of
    the row's sphere, that is the transpose of the row's block.
    """
    number = active.row.shape[0]
    domain = np.empty(number, np.int64)
    for d in range(bounds.shape[0] - 1):
        domain[bounds[d] : bounds[d + 1]] = d
    start = np.zeros(number + 1, np.int64)
    latest = np.full(number, -1, np.int64)
    for i in range(number):
        for p in range(active.row[i, 0], active.row[i, 1]):
            j = active.other[p]
            if j != i and domain[j] == domain[i] and active.gap[p] < below and latest[j] != i:
                latest[j] = i
                start[j + 1] += 1
    for i in range(number):
        start[i + 1] += start[i]
    column = np.empty(start[number], np.int32)
    block = np.zeros((start[number], 6, 6))
    fill = start[:-1].copy()
    latest[:] = -1
    for i in range(number):  # columns come in rising order, because i rises
        for p in range(active.row[i, 0], active.row[i, 1]):
            j = active.other[p]
            if j != i and domain[j] == domain[i] and active.gap[p] < below:
                if latest[j] != i:
                    latest[j] = i
                    column[fill[j]] = i
                    fill[j] += 1
                add_cross_block(scalars, p, block[fill[j] - 1])
    return start, column, block


@scalar
def _subtract_product(a, b, out):
    """out -= a b, all 6 x 6 (b, out transposed blocks: (W L^T)^T = L W^T)."""
    for r in range(6):
        for k in range(6):
            x = a[r, k]
            for c in range(6):
                out[r, c] -= x * b[k, c]


@kernel
def factorise_rows(first, last, start, column, lower, diagonal, inverse):
    """Factorise rows first:last in place: `lower` from A to L, `inverse` from `diagonal` (N, 6, 6)."""
    number = diagonal.shape[0]
    place = np.full(number, -1, np.int64)
    scaled = np.empty((number, 6, 6))  # W_ik^T = (L_ik D_k)^T of the current row, by position in the row
    root = np.empty((last - first, 6, 6))  # D_i = root_i root_i^T
    pivot, half = np.empty((6, 6)), np.empty((6, 6))
    broken = 0
    for i in range(first, last):
        pivot[:] = diagonal[i]
        for b in range(start[i], start[i + 1]):
            place[column[b]] = b
        for b in range(start[i], start[i + 1]):
            k = column[b]
            w = scaled[b - start[i]]
            w[:] = lower[b]
            for g in range(start[k], start[k + 1]):  # W_ik -= W_im L_km^T, transposed: W_ik^T -= L_km W_im^T
                if place[column[g]] >= 0:
                    _subtract_product(lower[g].T, scaled[place[column[g]] - start[i]], w)
            # D_i -= W_ik D_k^-1 W_ik^T as a square: through the explicit inverse the stiff parts of two
            # touching spheres, 1/gap each, would cancel with an error of eps/gap^2
            half[:] = w
            solve_lower(root[k - first], half)
            _subtract_product(half.T, half, pivot)
            solve_upper(root[k - first], half)
            lower[b] = half  # L_ik^T = D_k^-1 W_ik^T
        for b in range(start[i], start[i + 1]):
            place[column[b]] = -1
        if not cholesky(pivot, root[i - first]):
            broken += 1
            lower[start[i] : start[i + 1]] = 0.0
            cholesky(diagonal[i], root[i - first])
        inverse[i] = np.eye(6)
        solve_lower(root[i - first], inverse[i])
        solve_upper(root[i - first], inverse[i])
    return broken


@parallel_kernel
def factorise(active, scalars, below, bounds, drag, rotational_drag):
    """Preconditioner of R_self + R_nf from the pairs with gap < `below` (radii); else block Jacobi."""
    number = active.row.shape[0]
    diagonal = np.empty((number, 6, 6))
    diagonal_blocks(active, scalars, drag, rotational_drag, diagonal)
    start, column, lower = close_blocks(active, scalars, below, bounds)
    inverse = np.empty((number, 6, 6))
    broken = np.zeros(bounds.shape[0] - 1, np.int64)
    for d in numba.prange(bounds.shape[0] - 1):
        broken[d] = factorise_rows(bounds[d], bounds[d + 1], start, column, lower, diagonal, inverse)
    return Factor(bounds, start, column, lower, inverse, broken, np.array([drag, rotational_drag]))


@kernel
def apply_factor(first, last, factor, residual, result):
    """result = (L D L^T)^-1 residual for rows first:last of one domain; both (N, 6)."""
    start, column, lower, inverse = factor.start, factor.column, factor.lower, factor.inverse
    for i in range(first, last):
        y0, y1, y2 = residual[i, 0], residual[i, 1], residual[i, 2]
        y3, y4, y5 = residual[i, 3], residual[i, 4], residual[i, 5]
        for b in range(start[i], start[i + 1]):
            k = column[b]
            for c in range(6):
                x = result[k, c]
                y0 -= lower[b, c, 0] * x
                y1 -= lower[b, c, 1] * x
                y2 -= lower[b, c, 2] * x
                y3 -= lower[b, c, 3] * x
                y4 -= lower[b, c, 4] * x
                y5 -= lower[b, c, 5] * x
        result[i, 0], result[i, 1], result[i, 2] = y0, y1, y2
        result[i, 3], result[i, 4], result[i, 5] = y3, y4, y5
    for i in range(last - 1, first - 1, -1):
        z0, z1, z2, z3, z4, z5 = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
        for c in range(6):  # the inverse is symmetric: columns are rows
            x = result[i, c]
            z0 += inverse[i, c, 0] * x
            z1 += inverse[i, c, 1] * x
            z2 += inverse[i, c, 2] * x
            z3 += inverse[i, c, 3] * x
            z4 += inverse[i, c, 4] * x
            z5 += inverse[i, c, 5] * x
        result[i, 0], result[i, 1], result[i, 2] = z0, z1, z2
        result[i, 3], result[i, 4], result[i, 5] = z3, z4, z5
    for i in range(last - 1, first - 1, -1):
        x = (result[i, 0], result[i, 1], result[i, 2], result[i, 3], result[i, 4], result[i, 5])
        for b in range(start[i], start[i + 1]):
            k = column[b]
            for c in range(6):
                s = 0.0
                for r in range(6):
                    s += lower[b, c, r] * x[r]
                result[k, c] -= s
