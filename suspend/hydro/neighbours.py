"""Verlet list of pairs in the sheared periodic cell, all images counted, right while the cell shears."""

from __future__ import annotations

import math

import numba
import numpy as np

from suspend.box import flips_of
from suspend.core.cell import wrap_and_count
from suspend.core.cell_list import cells_along, scan, sort_into_bins
from suspend.core.jit import kernel, parallel_kernel
from suspend.core.pairs import PlacedPairs, separation


@parallel_kernel
def _build(bins, reach):
    """All pairs closer than `reach`, sorted by their first sphere; int32 (P, 5) and row offsets (N+1,)."""
    number = bins.position.shape[0]
    row = np.zeros(number + 1, np.int64)
    nothing = np.empty((0, 5), np.int32)
    for i in numba.prange(number):
        row[i + 1] = scan(i, bins, reach, nothing, -1)
    for i in range(number):
        row[i + 1] += row[i]
    pairs = np.empty((row[number], 5), np.int32)
    for i in numba.prange(number):
        scan(i, bins, reach, pairs, row[i])
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
    return _build(sort_into_bins(position, edge, tilt, cells_along(edge, reach, position.shape[0])), reach)


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

    def holds(self, position: np.ndarray, tilt: float, reach: float) -> bool:
        """Whether a pair can come within `reach` <= cutoff while the list, built at these positions, is valid.

        A pair farther apart than reach + skin at the build cannot: its distance stays above
        cutoff - (cutoff - reach)/stretch >= reach.
        """
        if not len(self.pairs) or reach <= 0.0:
            return False
        return reach >= self.cutoff or contacts_within(self.at(position, tilt), reach + self.skin)[0] < math.inf

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
