"""Conjugate gradients for a symmetric positive definite operator that is known by its products."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from suspend.errors import NumericalError

STALLED = 3  # restarts from the true residual after which round-off is what is left


class Iterations(NamedTuple):
    """Solution and what it cost."""

    solution: np.ndarray
    iterations: int
    products: int
    residual: float  # |right - A solution| / |right|, computed anew


def solve_definite(
    product: Callable[[np.ndarray], np.ndarray],
    right: np.ndarray,
    diagonal: np.ndarray,
    tolerance: float,
    limit: int,
) -> Iterations:
    """Solve A x = right to a relative true residual of `tolerance` with products A x.

    diagonal : of A, or near it: the preconditioner (broadcast against `right`). The residual of the recurrence is
    replaced by the true one when it says that the tolerance is met. Raises NumericalError after `limit` iterations
    or where round-off keeps the residual above the tolerance.
    """
    size = np.linalg.norm(right)
    x = np.zeros_like(right)
    if size == 0.0:
        return Iterations(x, 0, 0, 0.0)
    residual, done, products = right.copy(), 0, 0
    for _ in range(STALLED):
        z = residual / diagonal
        direction, gain = z, np.vdot(residual, z)
        while np.linalg.norm(residual) > tolerance * size and done < limit:
            image = product(direction)
            step = gain / np.vdot(direction, image)
            x += step * direction
            residual -= step * image
            z = residual / diagonal
            gain, previous = np.vdot(residual, z), gain
            direction = z + gain / previous * direction
            done += 1
            products += 1
        residual = right - product(x)
        products += 1
        error = np.linalg.norm(residual) / size
        if error <= tolerance:
            return Iterations(x, done, products, float(error))
    raise NumericalError(
        f"the far-field solve did not converge: relative residual {error:.3g} after {done} iterations, asked for"
        f" {tolerance:.3g} (accuracy, solver.far_tolerance, solver.max_iterations)"
    )
