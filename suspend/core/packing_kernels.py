"""Kernels of the random packing: removal of overlaps and hard-sphere Monte Carlo in a cubic periodic cell.

Single-threaded and without fast-math, so that a seed gives the same bits whatever the number of threads.
Cells of edge >= the interaction range, 27 of them per sphere; where fewer than three fit along the edge,
every pair is visited with its images instead. A sphere's own images are at distance >= L, which the caller
keeps above the diameter.
"""

from __future__ import annotations

import numpy as np

from suspend.core.jit import scalar as jit


@jit
def uniform(state):
    """Next number in [0, 1) of a SplitMix64 stream (Steele, Lea & Flood 2014); `state` (1,) uint64."""
    state[0] += np.uint64(0x9E3779B97F4A7C15)
    z = state[0]
    z = (z ^ (z >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
    z = (z ^ (z >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
    z ^= z >> np.uint64(31)
    return (z >> np.uint64(11)) * (1.0 / 9007199254740992.0)


@jit
def nearest(dx, length):
    """Component of a separation brought to [-L/2, L/2] (any dx)."""
    return dx - length * np.rint(dx / length)


@jit
def wrapped(x, length):
    """Coordinate brought to [0, L); rounding of a tiny negative x up to L counts as 0."""
    x -= length * np.floor(x / length)
    return 0.0 if x >= length else x


@jit
def cells_along(length, reach, number):
    """Cells along an edge: as many as are wider than `reach`, but not many more than spheres in all."""
    return int(min(length / reach, max(3.0, np.ceil((4.0 * number) ** (1.0 / 3.0)))))


@jit
def cell_of(x, cells, length):
    """Index along one axis of the cell that holds the wrapped coordinate x."""
    c = int(x * cells / length)
    return cells - 1 if c >= cells else c


@jit
def add_push(i, j, d, diameter, force):
    """Add the force diameter - r between i and j, d = x_i - x_j; returns r^2 (4 diameter^2 if apart)."""
    r2 = d[0] * d[0] + d[1] * d[1] + d[2] * d[2]
    if r2 >= diameter * diameter:
        return 4.0 * diameter * diameter
    r = np.sqrt(r2)
    if r == 0.0:  # coincident centres: any direction separates them
        force[i, 0] += diameter
        force[j, 0] -= diameter
        return 0.0
    push = (diameter - r) / r
    for a in range(3):
        force[i, a] += push * d[a]
        force[j, a] -= push * d[a]
    return r2


@jit
def push_images(x, length, diameter, force):
    """`push_cells` for a small cell: all pairs, each with its 27 nearest images."""
    smallest = 4.0 * diameter * diameter
    d = np.empty(3)
    for i in range(len(x)):
        for j in range(i):
            for k in range(27):
                d[0] = nearest(x[i, 0] - x[j, 0], length) + (k // 9 - 1) * length
                d[1] = nearest(x[i, 1] - x[j, 1], length) + (k // 3 % 3 - 1) * length
                d[2] = nearest(x[i, 2] - x[j, 2], length) + (k % 3 - 1) * length
                smallest = min(smallest, add_push(i, j, d, diameter, force))
    return smallest


@jit
def push_cells(x, length, cells, diameter, force):
    """Add the forces of E = sum (diameter - r)^2/2 over overlapping pairs; returns their smallest r^2."""
    n = len(x)
    head = np.full(cells**3, -1, np.int64)
    following = np.empty(n, np.int64)
    smallest = 4.0 * diameter * diameter
    d = np.empty(3)
    for i in range(n):
        cx = cell_of(x[i, 0], cells, length)
        cy = cell_of(x[i, 1], cells, length)
        cz = cell_of(x[i, 2], cells, length)
        # Only spheres already in the list are visited, so that each pair comes up once.
        for k in range(27):
            ax = (cx + k // 9 - 1 + cells) % cells
            ay = (cy + k // 3 % 3 - 1 + cells) % cells
            j = head[(ax * cells + ay) * cells + (cz + k % 3 - 1 + cells) % cells]
            while j >= 0:
                for a in range(3):
                    d[a] = nearest(x[i, a] - x[j, a], length)
                smallest = min(smallest, add_push(i, j, d, diameter, force))
                j = following[j]
        here = (cx * cells + cy) * cells + cz
        following[i] = head[here]
        head[here] = i
    return smallest


@jit
def push_apart(x, length, hard, soft, sweeps):
    """Sweeps over the spheres `x` (N,3) that move each sphere of an overlapping pair by half the overlap, all at once.

    Overlaps are those at the diameter `soft`. Returns the sweeps done when every distance is >= `hard`, else -1.
    """
    n = len(x)
    cells = cells_along(length, soft, n)
    force = np.zeros((n, 3))
    for sweep in range(sweeps + 1):
        force[:] = 0.0
        if cells >= 3:
            smallest = push_cells(x, length, cells, soft, force)
        else:
            smallest = push_images(x, length, soft, force)
        if smallest >= hard * hard:
            return sweep
        if sweep < sweeps:
            for i in range(n):
                for a in range(3):
                    x[i, a] = wrapped(x[i, a] + 0.5 * force[i, a], length)
    return -1


@jit
def separate(x, length, hard, soft, max_steps):
    """Move the spheres `x` (N,3) apart until every distance is >= `hard`; returns the steps, -1 if jammed.

    Fast inertial relaxation (FIRE: Bitzek et al., PRL 97, 170201, 2006) of the harmonic overlap energy at the
    slightly larger diameter `soft`, so that the small overlaps an iteration leaves are none at `hard`.
    """
    n = len(x)
    cells = cells_along(length, soft, n)
    velocity = np.zeros((n, 3))
    force = np.zeros((n, 3))
    dt, mixing, downhill = 0.1, 0.1, 0
    for step in range(max_steps):
        force[:] = 0.0
        if cells >= 3:
            smallest = push_cells(x, length, cells, soft, force)
        else:
            smallest = push_images(x, length, soft, force)
        if smallest >= hard * hard:
            return step
        power, ff, vv = 0.0, 0.0, 0.0
        for i in range(n):
            for a in range(3):
                power += force[i, a] * velocity[i, a]
                ff += force[i, a] ** 2
                vv += velocity[i, a] ** 2
        if power > 0.0:
            downhill += 1
            steer = mixing * np.sqrt(vv / ff)
            keep = 1.0 - mixing
            if downhill > 5:
                dt = min(1.1 * dt, 0.5)
                mixing *= 0.99
        else:
            downhill, steer, keep = 0, 0.0, 0.0
            dt = max(0.5 * dt, 0.02)
            mixing = 0.1
        for i in range(n):
            for a in range(3):
                velocity[i, a] = keep * velocity[i, a] + (steer + dt) * force[i, a]
                move = min(0.2, max(-0.2, dt * velocity[i, a]))  # random points start with violent pushes
                x[i, a] = wrapped(x[i, a] + move, length)
    return -1


@jit
def fill_cells(x, length, cells, head, following):
    """Chain the spheres of each cell: head (cells^3,) the first, following (N,) the next, -1 ends a chain."""
    head[:] = -1
    for i in range(len(x)):
        c = cell_of(x[i, 0], cells, length) * cells + cell_of(x[i, 1], cells, length)
        c = c * cells + cell_of(x[i, 2], cells, length)
        following[i] = head[c]
        head[c] = i


@jit
def free_in_cells(x, i, p, length, cells, d2, head, following):
    """Whether sphere i of squared diameter d2 may sit at p (wrapped coordinates), from the chains."""
    cx, cy, cz = cell_of(p[0], cells, length), cell_of(p[1], cells, length), cell_of(p[2], cells, length)
    for ox in range(-1, 2):
        ax = cx + ox
        sx = p[0]
        if ax < 0:  # shift the sphere instead of wrapping every separation
            ax, sx = ax + cells, sx + length
        elif ax >= cells:
            ax, sx = ax - cells, sx - length
        for oy in range(-1, 2):
            ay = cy + oy
            sy = p[1]
            if ay < 0:
                ay, sy = ay + cells, sy + length
            elif ay >= cells:
                ay, sy = ay - cells, sy - length
            for oz in range(-1, 2):
                az = cz + oz
                sz = p[2]
                if az < 0:
                    az, sz = az + cells, sz + length
                elif az >= cells:
                    az, sz = az - cells, sz - length
                c = (ax * cells + ay) * cells + az
                j = head[c]
                while j >= 0:
                    r2 = (sx - x[j, 0]) ** 2 + (sy - x[j, 1]) ** 2 + (sz - x[j, 2]) ** 2
                    if r2 < d2 and j != i:
                        return False
                    j = following[j]
    return True


@jit
def free_among_images(x, i, p, length, d2):
    """`free_in_cells` for a small cell: the nearest image is the only one that can overlap first."""
    for j in range(len(x)):
        if j != i:
            dx = nearest(p[0] - x[j, 0], length)
            dy = nearest(p[1] - x[j, 1], length)
            dz = nearest(p[2] - x[j, 2], length)
            if dx * dx + dy * dy + dz * dz < d2:
                return False
    return True


@jit
def move_member(i, old, new, head, following):
    """Move sphere i from the chain of cell `old` to that of `new`."""
    if head[old] == i:
        head[old] = following[i]
    else:
        j = head[old]
        while following[j] != i:
            j = following[j]
        following[j] = following[i]
    following[i] = head[new]
    head[new] = i


@jit
def metropolis(x, travel, length, diameter, step, sweeps, state):
    """Metropolis sweeps of hard spheres `x` (N,3), trial moves uniform in a cube of half edge `step`.

    Updates x (wrapped), travel (N,3: accumulated displacement) and the random stream `state`; returns the
    fraction of moves accepted. `x` must be free of overlaps at `diameter`.
    """
    n = len(x)
    cells = cells_along(length, diameter, n)
    small = cells < 3
    head = np.full(1 if small else cells**3, -1, np.int32)
    following = np.full(n, -1, np.int32)
    if not small:
        fill_cells(x, length, cells, head, following)
    p = np.empty(3)
    d = np.empty(3)
    d2 = diameter * diameter
    accepted = 0
    for _ in range(sweeps):
        for i in range(n):
            for a in range(3):
                d[a] = step * (2.0 * uniform(state) - 1.0)
                p[a] = wrapped(x[i, a] + d[a], length)
            if small:
                free = free_among_images(x, i, p, length, d2)
            else:
                free = free_in_cells(x, i, p, length, cells, d2, head, following)
            if not free:
                continue
            accepted += 1
            if not small:
                old, new = 0, 0
                for a in range(3):
                    old = old * cells + cell_of(x[i, a], cells, length)
                    new = new * cells + cell_of(p[a], cells, length)
                if new != old:
                    move_member(i, old, new, head, following)
            for a in range(3):
                x[i, a] = p[a]
                travel[i, a] += d[a]
    return accepted / (sweeps * n)
