"""What the findings share: versions, the verdict, and the sheared cell by brute force."""

import itertools
import sys
from importlib.metadata import version

import numpy as np


def versions(*names: str) -> None:
    """Print the version of Python and of the packages that are looked at."""
    print(", ".join([f"Python {sys.version.split()[0]}", *(f"{name} {version(name)}" for name in names)]))


def as_found(behaviour: str, seen: bool) -> None:
    """Say that the behaviour is still there, or end the program with exit code 1 and what changed."""
    if not seen:
        sys.exit(f"CHANGED, no longer so: {behaviour}")
    print(f"as found: {behaviour}")


def sheared_cell(edge: float, tilt: float) -> np.ndarray:
    """Rows are the cell vectors (L, 0, 0), (tilt L, L, 0), (0, 0, L)."""
    return edge * np.array([[1.0, 0.0, 0.0], [tilt, 1.0, 0.0], [0.0, 0.0, 1.0]])


def wrapped(positions: np.ndarray, cell: np.ndarray) -> np.ndarray:
    """Positions moved by cell vectors into the cell whose corner is the origin."""
    fractions = positions @ np.linalg.inv(cell)
    return (fractions - np.floor(fractions)) @ cell


def distances(positions: np.ndarray, cell: np.ndarray, reach: int = 3) -> np.ndarray:
    """Distance of the nearest image of every pair, (N, N), by trying all images up to `reach` cells away."""
    separation = positions[None] - positions[:, None]
    shifts = (np.array(n) @ cell for n in itertools.product(range(-reach, reach + 1), repeat=3))
    return np.min([np.linalg.norm(separation + shift, axis=-1) for shift in shifts], axis=0)
