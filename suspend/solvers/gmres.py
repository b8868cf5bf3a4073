"""GMRES for states of eleven numbers a sphere, preconditioned from the right, by a fixed or a changing map.

Saad & Schultz (1986); with a changing preconditioner (an inner iteration) the flexible form of Saad (1993).
The norm it reduces is that of the true residual. Partial sums are taken over blocks of a fixed size, so that
results do not depend on the number of threads.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numba
import numpy as np
from scipy.linalg import solve_triangular

from suspend.core.jit import parallel_kernel

WIDTH = 11  # unknowns of a sphere
RESTART = 40  # iterations after which it begins anew
REORTHOGONALISE_FROM = 20  # iterations: fewer lose no orthogonality that counts
BLOCK = 2048  # spheres of a partial sum

Map = Callable[[np.ndarray], np.ndarray]


@parallel_kernel
def project(basis, count, vector, coefficients):
    """coefficients[:count] = basis[:count] . vector, basis (m, N, 11)."""
    number = vector.shape[0]
    blocks = (number + BLOCK - 1) // BLOCK
    partial = np.zeros((blocks, count))
    for b in numba.prange(blocks):
        for k in range(count):
            lanes = np.zeros(WIDTH)
            for i in range(b * BLOCK, min(number, (b + 1) * BLOCK)):
                for c in range(WIDTH):
                    lanes[c] += basis[k, i, c] * vector[i, c]
            s = 0.0
            for c in range(WIDTH):
                s += lanes[c]
            partial[b, k] = s
    for k in range(count):
        s = 0.0
        for b in range(blocks):
            s += partial[b, k]
        coefficients[k] = s


@parallel_kernel
def combine(basis, count, coefficients, vector):
    """vector += sum_k coefficients[k] basis[k], basis (m, N, 11)."""
    number = vector.shape[0]
    for b in numba.prange((number + 255) // 256):
        for k in range(count):
            for i in range(b * 256, min(number, (b + 1) * 256)):
                for c in range(WIDTH):
                    vector[i, c] += coefficients[k] * basis[k, i, c]


def norm_of(vector: np.ndarray) -> float:
    """2-norm of a state (N, 11)."""
    square = np.empty(1)
    project(vector[None], 1, vector, square)
    return float(np.sqrt(square[0]))


class Rotations:
    """Least-squares problem of GMRES, kept triangular by Givens rotations."""

    def __init__(self, size: int, norm: float):
        self.matrix = np.zeros((size + 1, size))
        self.right = np.zeros(size + 1)
        self.right[0] = norm
        self.turns: list[tuple[float, float]] = []

    def add(self, column: np.ndarray) -> float:
        """Take the next Hessenberg column (k + 2,); returns the norm of the residual."""
        k = len(self.turns)
        h = column.copy()
        for i, (cosine, sine) in enumerate(self.turns):
            h[i], h[i + 1] = cosine * h[i] + sine * h[i + 1], cosine * h[i + 1] - sine * h[i]
        length = np.hypot(h[k], h[k + 1])
        cosine, sine = h[k] / length, h[k + 1] / length
        self.turns.append((cosine, sine))
        h[k] = length
        self.matrix[: k + 1, k] = h[: k + 1]
        self.right[k], self.right[k + 1] = cosine * self.right[k], -sine * self.right[k]
        return abs(self.right[k + 1])

    def coefficients(self) -> np.ndarray:
        """Coefficients of the basis."""
        k = len(self.turns)
        return solve_triangular(self.matrix[:k, :k], self.right[:k])


@dataclass
class Cycle:
    """Outcome of one cycle: correction of the solution, iterations, norm of the residual that is left."""

    correction: np.ndarray
    iterations: int
    norm: float


class Gmres:
    """Cycles of GMRES for one operator; the arrays are kept from one solve to the next.

    operator, preconditioner : maps of states (N, 11); flexible : the preconditioner is not a fixed linear map.
    """

    def __init__(self, operator: Map, preconditioner: Map, flexible: bool = False):
        self.operator, self.preconditioner, self.flexible = operator, preconditioner, flexible
        self._basis = np.empty((0, 0, WIDTH))
        self._directions: list[np.ndarray] = []

    def cycle(self, residual: np.ndarray, norm: float, target: float, limit: int) -> Cycle:
        """At most RESTART iterations from a zero correction, until the norm is <= target.

        `residual` (N, 11), of 2-norm `norm`, is kept; `left` gives the one at the end.
        """
        basis = self._space(residual.shape)
        size = min(len(basis) - 1, limit)
        self._directions = []
        np.divide(residual, norm, out=basis[0])
        problem = Rotations(size, norm)
        self._hessenberg, self._start = np.zeros((size + 1, size)), norm
        for k in range(size):
            direction = self.preconditioner(basis[k])
            if self.flexible:
                self._directions.append(direction)
            column = self._orthogonalise(k, self.operator(direction))
            norm = problem.add(column)
            if norm <= target or column[-1] == 0.0:
                break
        self._coefficients = problem.coefficients()
        return Cycle(self._correction(residual.shape), len(self._coefficients), norm)

    def left(self, residual: np.ndarray) -> None:
        """Overwrite `residual` by the one that the last cycle has left, without a product."""
        used = len(self._coefficients)
        weights = -self._hessenberg[: used + 1, :used] @ self._coefficients
        weights[0] += self._start
        residual[:] = 0.0
        combine(self._basis, used + 1, weights, residual)

    def _orthogonalise(self, k: int, vector: np.ndarray) -> np.ndarray:
        """Take A z of iteration k into the basis; returns its column of the Hessenberg matrix."""
        basis, column = self._basis, np.empty(k + 2)
        project(basis, k + 1, vector, column)
        combine(basis, k + 1, -column, vector)
        if k >= REORTHOGONALISE_FROM:
            again = np.empty(k + 1)
            project(basis, k + 1, vector, again)
            combine(basis, k + 1, -again, vector)
            column[:-1] += again
        column[-1] = norm_of(vector)
        basis[k + 1] = vector / column[-1] if column[-1] > 0.0 else 0.0
        self._hessenberg[: k + 2, k] = column
        return column

    def _correction(self, shape) -> np.ndarray:
        correction = np.zeros(shape)
        if self.flexible:
            for weight, direction in zip(self._coefficients, self._directions, strict=True):
                correction += weight * direction
            return correction
        combine(self._basis, len(self._coefficients), self._coefficients, correction)
        return self.preconditioner(correction)

    def _space(self, shape) -> np.ndarray:
        if len(self._basis) != RESTART + 1 or self._basis.shape[1:] != shape:
            self._basis = np.empty((RESTART + 1, *shape))
        return self._basis
