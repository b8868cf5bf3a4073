"""The sheared periodic cell: wrapping of positions and tilt, images, unwrapped positions.

The cell has vectors a1 = (L,0,0), a2 = (tilt L, L, 0), a3 = (0,0,L). The strain gamma and the tilt differ by
a whole number of flips, tilt = gamma - flips; any two tilts that differ by an integer span the same lattice.
"""

from __future__ import annotations

import math

import numpy as np


def edge_length(number: int, volume_fraction: float) -> float:
    """Edge L of the cubic cell in radii: phi = N (4/3) pi / L^3."""
    return (number * 4.0 * math.pi / (3.0 * volume_fraction)) ** (1.0 / 3.0)


def volume_fraction(number: int, edge: float) -> float:
    """Volume fraction of `number` spheres in a cubic cell of edge L (radii), the inverse of `edge_length`."""
    return number * 4.0 * math.pi / 3.0 / edge**3


def flips_of(strain: float) -> int:
    """Whole number of cell flips that brings the tilt `strain - flips` into [-1/2, 1/2)."""
    return math.floor(strain + 0.5)


def cell_vectors(edge: float, tilt: float = 0.0) -> np.ndarray:
    """Cell vectors as rows, shape (3, 3)."""
    return edge * np.array([[1.0, 0.0, 0.0], [tilt, 1.0, 0.0], [0.0, 0.0, 1.0]])


def unwrap(position: np.ndarray, image: np.ndarray, edge: float, tilt: float) -> np.ndarray:
    """Unwrapped positions `position + image . cell_vectors`, shape (N, 3)."""
    return position + image @ cell_vectors(edge, tilt)


def wrap(positions: np.ndarray, edge: float, tilt: float = 0.0) -> np.ndarray:
    """Positions (N,3) brought into the cell: fractional coordinates in [0, 1) along its vectors.

    Where the images matter: `suspend.core.cell.wrap_and_count`.
    """
    x = np.array(positions, dtype=float)
    x[:, 2] -= edge * np.floor(x[:, 2] / edge)
    x[x[:, 2] >= edge, 2] = 0.0  # a tiny negative coordinate rounds up to L
    image = np.floor(x[:, 1] / edge)
    x[:, 1] -= edge * image
    image += x[:, 1] >= edge
    x[x[:, 1] >= edge, 1] = 0.0
    x[:, 0] -= tilt * edge * image
    start = tilt * x[:, 1]  # of the cell at this height
    x[:, 0] -= edge * np.floor((x[:, 0] - start) / edge)
    x[:, 0] = np.where(x[:, 0] - start >= edge, start, x[:, 0])
    return x


def flip(image: np.ndarray, extra_flips: int) -> None:
    """Re-express images (in place) for a tilt lowered by `extra_flips`: a2_old = a2_new + extra_flips a1."""
    image[:, 0] += (extra_flips * image[:, 1]).astype(image.dtype)


def periodic_images(
    positions: np.ndarray, length: float, reach: float, tilt: float = 0.0
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Wrapped positions (N,3), all their images closer than `reach` to the cell (M,3), and whose they are (M,).

    The images include the positions themselves. A k-d tree of them answers any question about distances up
    to `reach` from points of the cell; scipy's own periodic tree (boxsize) knows rectangular cells only, where
    a neighbour across a sheared face would be looked for at the wrong x.
    """
    x = wrap(positions, length, tilt)
    fractions = np.column_stack([(x[:, 0] - tilt * x[:, 1]) / length, x[:, 1] / length, x[:, 2] / length])
    margin = reach / length * np.array([math.hypot(1.0, tilt), 1.0, 1.0])
    layers = np.ceil(margin).astype(int)
    vectors = cell_vectors(length, tilt)
    ghosts, owners = [], []
    for shift in np.ndindex(*(2 * layers + 1)):
        image = np.array(shift) - layers
        f = fractions + image
        near = np.flatnonzero(np.all((f >= -margin - 1e-9) & (f <= 1.0 + margin + 1e-9), axis=1))
        ghosts.append(x[near] + image @ vectors)
        owners.append(near)
    return x, np.concatenate(ghosts), np.concatenate(owners)
