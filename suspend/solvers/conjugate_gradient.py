"""Preconditioned conjugate gradients for the velocities, stopped on the error in velocity.

Solves (R_self + R_nf) U = F for SPD R. With one pair at a small gap the residual is dominated by that pair,
so the residual's norm says nothing about the velocities. Conjugate gradients minimise the error in the energy
norm e.R.e, and because R >= R_self, the drag-weighted velocity error e.R_self.e is never larger. The decrease
of that norm over the last `DELAY` iterations is the sum of alpha_k r_k.z_k (Hestenes & Stiefel 1952; Strakos
& Tichy 2002), a lower bound of the error DELAY iterations ago that is sharp once convergence sets in.
"""

from __future__ import annotations

from typing import NamedTuple

import numba
import numpy as np

from suspend.core.jit import kernel, parallel_kernel
from suspend.core.pairs import apply_rows
from suspend.solvers.incomplete import apply_factor
from suspend.solvers.stiff_clusters import add_clusters

DELAY = 2  # iterations over which the decrease of the error is summed
# Error of the pairs' normal forces, relative to the drag on the spheres, per error of the velocities: a stress that is
# stored is to be as accurate as the positions, which need velocities a hundred times better.
FORCE_SHARE = 100.0
LEAST_FORCE_ERROR = 1e-6  # round-off of the velocities times the largest stiffness (`suspend.core.pairs.STIFFEST`)


class Goal(NamedTuple):
    """When to stop: at the relative error `tolerance`, or after `limit` iterations.

    The error is that of the velocity in the energy norm, relative to sqrt(max(velocity.R_self.velocity, floor2)). A
    share of that error, however small, is a large force on a pair at a small gap: the normal forces of the pairs are to
    be right within FORCE_SHARE * tolerance of the same norm, too.
    """

    tolerance: float
    floor2: float
    limit: int


@kernel
def _multiply_rows(first, last, active, scalars, velocity, load):
    load[:] = 0.0
    apply_rows(first, last, active, scalars, velocity, load)


@kernel
def _sum_loads(partial, velocity, drag, rotational_drag, load):
    """load = R_self . velocity + sum of the threads' partial loads; returns velocity . load."""
    dot = 0.0
    for i in range(load.shape[0]):
        for c in range(6):
            s = (drag if c < 3 else rotational_drag) * velocity[i, c]
            for t in range(partial.shape[0]):
                s += partial[t, i, c]
            load[i, c] = s
            dot += s * velocity[i, c]
    return dot


@kernel
def _dot(a, b):
    s = 0.0
    for i in range(a.shape[0]):
        for c in range(6):
            s += a[i, c] * b[i, c]
    return s


@kernel
def _total(values):
    """Sum in fixed order: the parallel kernel's own reductions would depend on the number of threads."""
    s = 0.0
    for value in values:
        s += value
    return max(s, 0.0)


@kernel
def _drag_norm2(velocity, drag, rotational_drag):
    """velocity . R_self . velocity."""
    s = 0.0
    for i in range(velocity.shape[0]):
        for c in range(3):
            u, w = velocity[i, c], velocity[i, 3 + c]
            s += drag * u * u + rotational_drag * w * w
    return s


@kernel
def _normal_forces2(active, scalars, velocity):
    """Sum over the pairs of the squared force along their line of centres that these velocities make."""
    s = 0.0
    for i in range(active.row.shape[0]):
        for p in range(active.row[i, 0], active.row[i, 1]):
            j = active.other[p]
            speed = 0.0
            for c in range(3):
                speed += scalars[p, c] * (velocity[i, c] - velocity[j, c])
            force = (scalars[p, 5] + scalars[p, 6]) * speed
            s += force * force
    return s


@kernel
def _step(alpha, direction, product, velocity, residual):
    for i in range(velocity.shape[0]):
        for c in range(6):
            velocity[i, c] += alpha * direction[i, c]
            residual[i, c] -= alpha * product[i, c]


@kernel
def _turn(beta, preconditioned, direction):
    for i in range(direction.shape[0]):
        for c in range(6):
            direction[i, c] = preconditioned[i, c] + beta * direction[i, c]


@parallel_kernel
def conjugate_gradient(chunks, active, scalars, factor, clusters, load, velocity, goal):
    """Solve (R_self + R_nf) velocity = load, starting from and overwriting `velocity` (N, 6).

    chunks : (T + 1,) int64, spheres of each thread; active, scalars : R_nf (`suspend.core.pairs`); factor :
    `suspend.solvers.incomplete.Factor`, whose drags are those of R_self; clusters :
    `suspend.solvers.stiff_clusters.Clusters`; goal : `Goal`. Returns (iterations, estimated relative error); the
    estimate exceeds the tolerance if the limit was reached.
    """
    work = np.empty((2, clusters.order.shape[0], 6))
    tolerance, floor2, limit = goal
    share2 = max(FORCE_SHARE, LEAST_FORCE_ERROR / tolerance) ** 2
    drag, rotational_drag = factor.drags[0], factor.drags[1]
    number, threads = load.shape[0], chunks.shape[0] - 1
    domains = factor.bounds.shape[0] - 1
    partial = np.empty((threads, number, 6))
    product = np.empty((number, 6))
    preconditioned = np.zeros((number, 6))
    direction = np.zeros((number, 6))
    decrease = np.zeros(DELAY)
    if threads == 1:
        _multiply_rows(chunks[0], chunks[1], active, scalars, velocity, partial[0])
    else:
        for t in numba.prange(threads):
            _multiply_rows(chunks[t], chunks[t + 1], active, scalars, velocity, partial[t])
    _sum_loads(partial, velocity, drag, rotational_drag, product)
    residual = load - product
    previous = 1.0
    error2 = np.inf
    iteration = 0
    while True:
        if domains == 1:
            apply_factor(factor.bounds[0], factor.bounds[1], factor, residual, preconditioned)
        else:
            for d in numba.prange(domains):
                apply_factor(factor.bounds[d], factor.bounds[d + 1], factor, residual, preconditioned)
        add_clusters(clusters, residual, preconditioned, work)
        gain = _dot(residual, preconditioned)
        target2 = tolerance * tolerance * max(_drag_norm2(velocity, drag, rotational_drag), floor2)
        if gain == 0.0:
            return iteration, 0.0
        if iteration >= DELAY:
            error2 = _total(decrease)
            if error2 <= target2:
                # M^-1 r is about the error that is left.
                error2 = max(error2, _normal_forces2(active, scalars, preconditioned) / share2)
                if error2 <= target2:
                    break
        if iteration >= limit or not gain > 0.0:
            break
        _turn(gain / previous if iteration > 0 else 0.0, preconditioned, direction)
        previous = gain
        if threads == 1:
            _multiply_rows(chunks[0], chunks[1], active, scalars, direction, partial[0])
        else:
            for t in numba.prange(threads):
                _multiply_rows(chunks[t], chunks[t + 1], active, scalars, direction, partial[t])
        curvature = _sum_loads(partial, direction, drag, rotational_drag, product)
        alpha = gain / curvature
        _step(alpha, direction, product, velocity, residual)
        decrease[iteration % DELAY] = alpha * gain
        iteration += 1
    return iteration, np.sqrt(error2 / target2) * tolerance
