"""Verlet list of pairs in the sheared periodic cell, all images counted, right while the cell shears."""

from __future__ import annotations

import math
from typing import NamedTuple

import numba
import numpy as np

from suspend.box import flips_of
from suspend.core.cell import wrap_and_count
from suspend.core.jit import kernel, parallel_kernel, scalar
from suspend.core.pairs import PlacedPairs, separation


class Bins(NamedTuple):
    """Spheres sorted into cells x cells x cells equal parts of the periodic cell, the first running fastest."""

    position: np.ndarray  # (N, 3)
    edge: float
    tilt: float
    cells: int
    start: np.ndarray  # (cells^3 + 1,) int64
    member: np.ndarray  # (N,) int64, spheres of part c are member[start[c]:start[c+1]]


@scalar
def _scan(i, bins, reach, pairs, first):
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
def _bin(position, edge, tilt, cells):
    """Sort the spheres into `Bins`."""
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


@parallel_kernel
def _build(bins, reach):
    """All pairs closer than `reach`, sorted by their first sphere; int32 (P, 5) and row offsets (N+1,)."""
    number = bins.position.shape[0]
    row = np.zeros(number + 1, np.int64)
    nothing = np.empty((0, 5), np.int32)
    for i in numba.prange(number):
        row[i + 1] = _scan(i, bins, reach, nothing, -1)
    for i in range(number):
        row[i + 1] += row[i]
    pairs = np.empty((row[number], 5), np.int32)
    for i in numba.prange(number):
        _scan(i, bins, reach, pairs, row[i])
    return pairs, row


def find_pairs(position: np.ndarray, edge: float, tilt: float, reach: float) -> tuple[np.ndarray, np.ndarray]:
    """Every pair (and image pair) of spheres closer than `reach`, once.

    Parameters
    ----------
    position : (N, 3) float64, wrapped into the cell (radii)
    edge, tilt : cell edge L (radii) and tilt
    reach : centre distance (radii); may exceed L/2, all images are found

    Returns
    -------
    pairs : (P, 5) int32, columns i, j, n1, n2, n3: sphere j shifted by n . cell vectors is the neighbour of i
    row : (N+1,) int64, pairs of sphere i are rows row[i]:row[i+1]
    """
    # cells of about half the reach: fewer candidates than cells of one reach, few empty cells at N = 10^5
    cells = max(1, min(int(edge / (0.5 * reach)), 1 + round(2.0 * position.shape[0] ** (1.0 / 3.0))))
    return _build(_bin(position, edge, tilt, cells), reach)


def stretch(strain_increment: float) -> float:
    """Largest singular value of the simple-shear deformation by `strain_increment`."""
    half = 0.5 * abs(strain_increment)
    return half + math.sqrt(1.0 + half * half)


class VerletList:
    """Pairs within `cutoff` + skin at the build; valid while no other pair can have come within `cutoff`.

    A pair at distance r <= cutoff now had, when the list was built at a strain lower by g, a distance of at
    most stretch(g) (r + 2 u): u is the largest displacement relative to the affine motion since the build.
    The list is rebuilt when that bound exceeds cutoff + skin. Positions need not be wrapped, the tilt not be
    reduced: the image numbers of the pairs belong to the positions and the tilt that were given.
    """

    def __init__(self, edge: float, cutoff: float, skin: float):
        self.edge, self.cutoff, self.skin = edge, cutoff, skin
        self.pairs = self.offset = self.reference = None
        self.strain = self.tilt = 0.0
        self.builds = 0

    def build(self, position: np.ndarray, strain: float, tilt: float) -> None:
        """Build from positions (N, 3) at the given strain and tilt (equal up to an integer)."""
        flips = flips_of(tilt)
        wrapped, image = position.copy(), np.zeros(position.shape, np.int32)
        wrap_and_count(wrapped, image, self.edge, tilt - flips)
        self.pairs, self.offset = find_pairs(wrapped, self.edge, tilt - flips, self.cutoff + self.skin)
        first, second = self.pairs[:, 0], self.pairs[:, 1]
        self.pairs[:, 2:] += image[first] - image[second]
        self.pairs[:, 2] -= flips * self.pairs[:, 3]
        self.reference = position.copy()
        self.strain, self.tilt = strain, tilt
        self.builds += 1

    def at(self, position: np.ndarray, tilt: float) -> PlacedPairs:
        """The list with the positions (N, 3) and the tilt its pairs are wanted at."""
        return PlacedPairs(self.pairs, self.offset, position, self.edge, tilt)

    def valid(self, position: np.ndarray, strain: float) -> bool:
        """Whether the list still holds every pair within the cutoff at these positions and this strain."""
        if self.pairs is None:
            return False
        increment = strain - self.strain
        largest = math.sqrt(_largest_displacement2(position, self.reference, increment))
        return stretch(increment) * (self.cutoff + 2.0 * largest) <= self.cutoff + self.skin


@kernel
def _largest_displacement2(position, reference, increment):
    """Largest squared displacement relative to the affine motion by the strain `increment`."""
    largest = 0.0
    for i in range(position.shape[0]):
        dx = position[i, 0] - reference[i, 0] - increment * reference[i, 1]
        dy = position[i, 1] - reference[i, 1]
        dz = position[i, 2] - reference[i, 2]
        largest = max(largest, dx * dx + dy * dy + dz * dz)
    return largest


@kernel
def _contacts(placed, reach):
    pairs, _, position, edge, tilt = placed
    smallest, overlaps = np.inf, 0
    for p in range(pairs.shape[0]):
        dx, dy, dz = separation(pairs, p, position, edge, tilt)
        r2 = dx * dx + dy * dy + dz * dz
        if r2 < reach * reach:
            smallest = min(smallest, math.sqrt(r2) - 2.0)
            overlaps += r2 < 4.0
    return smallest, overlaps


def contacts_within(placed: PlacedPairs, reach: float) -> tuple[float, int]:
    """Smallest gap (radii; inf without a pair) and number of overlapping pairs at centre distances below `reach`."""
    smallest, overlaps = _contacts(placed, reach)
    return float(smallest), int(overlaps)
