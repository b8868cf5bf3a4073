"""The sheared periodic cell: wrapping of positions and tilt, images, unwrapped positions.

The cell has vectors a1 = (L,0,0), a2 = (tilt L, L, 0), a3 = (0,0,L). The strain gamma and the tilt differ by
a whole number of flips, tilt = gamma - flips; any two tilts that differ by an integer span the same lattice.
"""

from __future__ import annotations

import math

import numpy as np

from suspend.core.jit import kernel


def edge_length(number: int, volume_fraction: float) -> float:
    """Edge L of the cubic cell in radii: phi = N (4/3) pi / L^3."""
    return (number * 4.0 * math.pi / (3.0 * volume_fraction)) ** (1.0 / 3.0)


def flips_of(strain: float) -> int:
    """Whole number of cell flips that brings the tilt `strain - flips` into [-1/2, 1/2)."""
    return math.floor(strain + 0.5)


def cell_vectors(edge: float, tilt: float) -> np.ndarray:
    """Cell vectors as rows, shape (3, 3)."""
    return edge * np.array([[1.0, 0.0, 0.0], [tilt, 1.0, 0.0], [0.0, 0.0, 1.0]])


def unwrap(position: np.ndarray, image: np.ndarray, edge: float, tilt: float) -> np.ndarray:
    """Unwrapped positions `position + image . cell_vectors`, shape (N, 3)."""
    return position + image @ cell_vectors(edge, tilt)


@kernel
def wrap(position, image, edge, tilt):
    """Move every sphere into the cell and count the cell vectors removed in `image` (both in place).

    position (N, 3) float64, image (N, 3) int32; position + image . cell vectors is unchanged.
    """
    for i in range(position.shape[0]):
        n2 = math.floor(position[i, 1] / edge)
        n1 = math.floor((position[i, 0] - tilt * position[i, 1]) / edge)
        n3 = math.floor(position[i, 2] / edge)
        position[i, 0] -= edge * (n1 + tilt * n2)
        position[i, 1] -= edge * n2
        position[i, 2] -= edge * n3
        image[i, 0] += n1
        image[i, 1] += n2
        image[i, 2] += n3


def flip(image: np.ndarray, extra_flips: int) -> None:
    """Re-express images (in place) for a tilt lowered by `extra_flips`: a2_old = a2_new + extra_flips a1."""
    image[:, 0] += (extra_flips * image[:, 1]).astype(image.dtype)
