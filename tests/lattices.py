"""Lattices, random points and sheared replicas for the tests of the microstructure."""

from __future__ import annotations

import numpy as np

from suspend.box import cell_vectors

SC = [(0.0, 0.0, 0.0)]
BCC = [*SC, (0.5, 0.5, 0.5)]
FCC = [*SC, (0.5, 0.5, 0.0), (0.5, 0.0, 0.5), (0.0, 0.5, 0.5)]


def lattice(basis, cells: int, edge: float) -> tuple[np.ndarray, float]:
    """Positions and edge of a cube of cells^3 unit cells."""
    corners = np.array(list(np.ndindex(cells, cells, cells)), dtype=float)
    return np.concatenate([corners + offset for offset in basis]) * edge, cells * edge


def spheres(rng: np.random.Generator, number: int, length: float, tilt: float = 0.0) -> np.ndarray:
    """Non-overlapping spheres of radius 1 in the sheared cell, by random insertion (phi below about 0.3)."""
    vectors, made = cell_vectors(length, tilt), np.empty((0, 3))
    images = (np.stack(np.meshgrid(*(np.arange(-1, 2),) * 3, indexing="ij"), axis=-1).reshape(-1, 3)) @ vectors
    while len(made) < number:
        trial = rng.random(3) @ vectors
        shifted = (made - trial)[:, None, :] + images
        if len(made) == 0 or np.min(np.sum(shifted**2, axis=-1)) >= 4.0:
            made = np.vstack([made, trial])
    return made


def doubled(position: np.ndarray, length: float) -> tuple[np.ndarray, float]:
    """The same infinite configuration as that of a cell of tilt 1/2, in an untilted cube of twice the edge.

    (0, 2L, 0) = 2 a2 - a1, so the cube holds eight copies of the tilted cell.
    """
    vectors = cell_vectors(length, 0.5)
    shifts = np.array(list(np.ndindex(2, 2, 2))) @ vectors
    return np.concatenate([position + shift for shift in shifts]), 2.0 * length
