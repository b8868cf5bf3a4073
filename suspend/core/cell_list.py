"""Pairs of spheres in the sheared periodic cell by a cell list, every image counted."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from suspend.core.jit import kernel, scalar


class Bins(NamedTuple):
    """Spheres sorted into cells x cells x cells equal parts of the periodic cell, the first running fastest."""

    position: np.ndarray  # (N, 3)
    edge: float
    tilt: float
    cells: int
    start: np.ndarray  # (cells^3 + 1,) int64
    member: np.ndarray  # (N,) int64, spheres of part c are member[start[c]:start[c+1]]


@scalar
def scan(i, bins, reach, pairs, first):
    """Pairs of sphere i with spheres j > i (or its own images, each once) closer than `reach`.

    Writes (i, j, n1, n2, n3) to `pairs` from row `first` on if `first` >= 0; returns the number of pairs.
    """
    position, edge, tilt, cells, start, member = bins
    width = edge / cells
    span = math.ceil(reach / width)
    span_x = math.ceil(reach * math.sqrt(1.0 + tilt * tilt) / width)
    xi, yi, zi = position[i, 0], position[i, 1], position[i, 2]
    cx = min(int((xi - tilt * yi) / width), cells - 1)
    cy = min(int(yi / width), cells - 1)
    cz = min(int(zi / width), cells - 1)
    reach2 = reach * reach
    found = 0
    for kz in range(cz - span, cz + span + 1):
        n3 = kz // cells
        for ky in range(cy - span, cy + span + 1):
            n2 = ky // cells
            for kx in range(cx - span_x, cx + span_x + 1):
                n1 = kx // cells
                cell = ((kz - n3 * cells) * cells + (ky - n2 * cells)) * cells + (kx - n1 * cells)
                for m in range(start[cell], start[cell + 1]):
                    j = member[m]
                    if j < i:
                        continue
                    if j == i and (n3 < 0 or (n3 == 0 and (n2 < 0 or (n2 == 0 and n1 <= 0)))):
                        continue
                    dx = position[j, 0] + edge * (n1 + tilt * n2) - xi
                    dy = position[j, 1] + edge * n2 - yi
                    dz = position[j, 2] + edge * n3 - zi
                    if dx * dx + dy * dy + dz * dz < reach2:
                        if first >= 0:
                            row = first + found
                            pairs[row, 0] = i
                            pairs[row, 1] = j
                            pairs[row, 2] = n1
                            pairs[row, 3] = n2
                            pairs[row, 4] = n3
                        found += 1
    return found


@scalar
def sort_into_bins(position, edge, tilt, cells):
    """Sort the spheres, wrapped into the cell (N, 3), into `Bins`."""
    number = position.shape[0]
    width = edge / cells
    cell_of = np.empty(number, np.int64)
    start = np.zeros(cells**3 + 1, np.int64)
    for i in range(number):
        cx = min(int((position[i, 0] - tilt * position[i, 1]) / width), cells - 1)
        cy = min(int(position[i, 1] / width), cells - 1)
        cz = min(int(position[i, 2] / width), cells - 1)
        cell_of[i] = (cz * cells + cy) * cells + cx
        start[cell_of[i] + 1] += 1
    for c in range(cells**3):
        start[c + 1] += start[c]
    fill = start.copy()
    member = np.empty(number, np.int64)
    for i in range(number):
        member[fill[cell_of[i]]] = i
        fill[cell_of[i]] += 1
    return Bins(position, edge, tilt, cells, start, member)


@kernel
def collect(bins, reach):
    """All pairs closer than `reach`, sorted by their first sphere, by one thread; int32 (P, 5) as `scan` writes them.

    `suspend.hydro.neighbours` does the same by all threads.
    """
    number = bins.position.shape[0]
    nothing = np.empty((0, 5), np.int32)
    found = 0
    for i in range(number):
        found += scan(i, bins, reach, nothing, -1)
    pairs = np.empty((found, 5), np.int32)
    row = 0
    for i in range(number):
        row += scan(i, bins, reach, pairs, row)
    return pairs


def cells_along(edge: float, reach: float, number: int) -> int:
    """Parts of the cell along an edge, about half of `reach` wide.

    Fewer candidates than with parts of one reach, few empty ones at N = 10^5.
    """
    return max(1, min(int(edge / (0.5 * reach)), 1 + round(2.0 * number ** (1.0 / 3.0))))
