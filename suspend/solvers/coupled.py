"""Velocities and stresslets with far field: the coupled solve of near field and mobility.

Unknown are y = [U; s]: velocities U (6N) relative to the undisturbed flow and far-field stresslets s (5N,
loads on the fluid, orthonormal five-basis). With b = F_P + R_FE : E the loads of the mobility are
x = [b - R_nf U; s], and

    residual(y) = [M_U x - U; -E - M_E x] = 0,        A y = [U + M_U R U - M_U s; M_E s - M_E R U]

(the forces are eliminated, so that one mobility product is one iteration). GMRES (Saad & Schultz 1986),
preconditioned from the right: U <- (R_nf + D)^-1 D U with the incomplete factorisation of `incomplete` and a
screened drag D, s <- s/m. The residual has the units of a velocity and stays bounded when a gap vanishes,
unlike the right-hand side, so it is measured against the velocities found and the strain rate.
"""

from __future__ import annotations

from dataclasses import dataclass

import numba
import numpy as np

from suspend.core.jit import kernel, parallel_kernel
from suspend.core.pairs import apply_rows
from suspend.errors import NumericalError
from suspend.solvers.incomplete import apply_factor

WIDTH = 11  # unknowns of a sphere
RESTART = 40  # iterations after which GMRES begins anew
REORTHOGONALISE_FROM = 20  # iterations: fewer lose no orthogonality that counts
BLOCK = 2048  # spheres whose partial sums are added first: fixed, so that bits do not depend on threads


@dataclass
class CoupledSolution:
    """Velocities (N, 6) relative to the flow, stresslets on the fluid (N, 5), and what they cost."""

    velocity: np.ndarray
    stresslet: np.ndarray
    iterations: int
    products: int
    residual: float  # relative to the norm of [U; E]


@parallel_kernel
def _resistance(chunks, active, scalars, state, load, sign, out):
    """out[:, :6] = load + sign * R_nf . state[:, :6] (`load` may be empty: zero), out[:, 6:] = state[:, 6:]."""
    number, threads = state.shape[0], chunks.shape[0] - 1
    partial = np.zeros((threads, number, 6))
    velocity = np.ascontiguousarray(state[:, :6])
    if threads == 1:
        apply_rows(chunks[0], chunks[1], active, scalars, velocity, partial[0])
    else:
        for t in numba.prange(threads):
            apply_rows(chunks[t], chunks[t + 1], active, scalars, velocity, partial[t])
    loaded = load.shape[0] > 0
    for i in numba.prange(number):
        for c in range(6):
            s = 0.0
            for t in range(threads):
                s += partial[t, i, c]
            out[i, c] = sign * s + (load[i, c] if loaded else 0.0)
        for c in range(6, 11):
            out[i, c] = state[i, c]


@parallel_kernel
def _precondition(factor, drags, stresslet_scale, vector, out):
    """out = [(R + D)^-1 D vector_U; vector_E / m]; `factor` of R + D, D = `drags`."""
    number, domains = vector.shape[0], factor.bounds.shape[0] - 1
    scaled = np.empty((number, 6))
    solved = np.zeros((number, 6))
    for i in numba.prange(number):
        for c in range(3):
            scaled[i, c] = drags[0] * vector[i, c]
            scaled[i, 3 + c] = drags[1] * vector[i, 3 + c]
    if domains == 1:
        apply_factor(factor.bounds[0], factor.bounds[1], factor, scaled, solved)
    else:
        for d in numba.prange(domains):
            apply_factor(factor.bounds[d], factor.bounds[d + 1], factor, scaled, solved)
    for i in numba.prange(number):
        for c in range(6):
            out[i, c] = solved[i, c]
        for c in range(6, 11):
            out[i, c] = vector[i, c] / stresslet_scale


@parallel_kernel
def _project(basis, count, vector, coefficients):
    """coefficients[:count] = basis[:count] . vector, basis (m, N, 11); partial sums in blocks of fixed size."""
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
def _combine(basis, count, coefficients, vector):
    """vector += sum_k coefficients[k] basis[k]."""
    number = vector.shape[0]
    for b in numba.prange((number + 255) // 256):
        for k in range(count):
            for i in range(b * 256, min(number, (b + 1) * 256)):
                for c in range(WIDTH):
                    vector[i, c] += coefficients[k] * basis[k, i, c]


@kernel
def _equation_residual(velocity, strain_rate, moved):
    """[z_U - U; -E - z_E] in place of z = M x in `moved`."""
    for i in range(moved.shape[0]):
        for c in range(6):
            moved[i, c] -= velocity[i, c]
        for c in range(5):
            moved[i, 6 + c] = -strain_rate[c] - moved[i, 6 + c]


@kernel
def _operator_rows(velocity, moved):
    """A y = [U - z_U; z_E] in place of z = M [-R U; s] in `moved`."""
    for i in range(moved.shape[0]):
        for c in range(6):
            moved[i, c] = velocity[i, c] - moved[i, c]


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
        from scipy.linalg import solve_triangular

        k = len(self.turns)
        return solve_triangular(self.matrix[:k, :k], self.right[:k])


class CoupledSolver:
    """Velocities and stresslets of spheres with a mobility and (or without) a near field.

    mobility : object with `apply(loads (N, 11)) -> (N, 11)`, symmetric positive definite; near : a
    `suspend.hydro.nearfield.NearField` whose drags are D, assembled and with its factor made, or None: no
    lubrication; stresslet_scale : m of the preconditioner (about the mean eigenvalue of M_ES); limit :
    iterations before a NumericalError.
    """

    def __init__(self, mobility, near, stresslet_scale: float = 0.5, limit: int = 200):
        self.mobility, self.near = mobility, near
        self.stresslet_scale, self.limit = stresslet_scale, limit
        self.products = 0
        self._basis = self._left = None

    def solve(self, load, strain_rate, tolerance: float, floor: float = 0.0, start=None) -> CoupledSolution:
        """Solve for `load` (N, 6) = external + R_FE : E and the undisturbed `strain_rate` (five-vector).

        tolerance : norm of the residual relative to that of [U; E], or to `floor` * sqrt(N) if that is
        larger; start : (N, 11) first guess [U; s], else one near-field solve.
        """
        before = self.products
        state = start.copy() if start is not None else self._first_guess(load, strain_rate)
        iterations = 0
        residual = self._residual(load, strain_rate, state)
        norm = self._norm(residual)
        while True:
            scale = self._scale(state, strain_rate, floor)
            if not np.isfinite(norm):
                raise NumericalError("the coupled solve met a number that is not finite")
            if norm <= tolerance * scale:
                break
            if iterations >= self.limit:
                raise NumericalError(
                    f"the coupled solve of near and far field did not converge: residual {norm / scale:.3g} after "
                    f"{iterations} iterations, asked for {tolerance:.3g} (solver.far_tolerance, solver.max_iterations)"
                )
            if iterations > 0:
                self._rebuild(residual)
            used, norm = self._gmres(state, residual, norm, tolerance * scale, self.limit - iterations)
            iterations += used
        return CoupledSolution(
            np.ascontiguousarray(state[:, :6]),
            np.ascontiguousarray(state[:, 6:]),
            iterations,
            self.products - before,
            norm / scale if scale > 0.0 else 0.0,
        )

    def _first_guess(self, load, strain_rate) -> np.ndarray:
        guess = np.empty((len(load), WIDTH))
        guess[:, :6] = load
        guess[:, 6:] = -strain_rate
        if self.near is not None:
            guess[:, :6] /= np.repeat(self.near.drags, 3)
        return self._preconditioned(guess)

    def _scale(self, state, strain_rate, floor: float) -> float:
        moved = float(np.vdot(state[:, :6], state[:, :6])) + len(state) * float(strain_rate @ strain_rate)
        return max(np.sqrt(moved), floor * np.sqrt(len(state)))

    def _norm(self, vector) -> float:
        square = np.empty(1)
        _project(vector[None], 1, vector, square)
        return float(np.sqrt(square[0]))

    def _loads(self, state, load, sign: float) -> np.ndarray:
        out = np.empty_like(state)
        if self.near is None:
            out[:, :6] = load if len(load) else 0.0
            out[:, 6:] = state[:, 6:]
        else:
            near = self.near
            _resistance(near.chunks, near.active, near.scalars, state, load, sign, out)
        return out

    def _move(self, loads) -> np.ndarray:
        self.products += 1
        return self.mobility.apply(loads)

    def _residual(self, load, strain_rate, state) -> np.ndarray:
        moved = self._move(self._loads(state, load, -1.0))
        _equation_residual(state, strain_rate, moved)
        return moved

    def _preconditioned(self, vector) -> np.ndarray:
        out = np.empty_like(vector)
        if self.near is None:
            out[:, :6] = vector[:, :6]
            out[:, 6:] = vector[:, 6:] / self.stresslet_scale
        else:
            _precondition(self.near.factor, self.near.drags, self.stresslet_scale, vector, out)
        return out

    def _operate(self, direction) -> np.ndarray:
        """A . direction."""
        moved = self._move(self._loads(direction, np.empty((0, 6)), -1.0))
        _operator_rows(direction, moved)
        return moved

    def _gmres(self, state, residual, norm: float, target: float, limit: int) -> tuple[int, float]:
        """One cycle of GMRES from `residual`; updates `state` in place.

        Returns (iterations, norm of the residual).
        """
        basis = self._space(state.shape)
        size = min(len(basis) - 1, limit)
        basis[0] = residual / norm
        start = norm
        problem = Rotations(size, norm)
        hessenberg = np.zeros((size + 1, size))
        again = np.empty(size + 1)
        for k in range(size):
            vector = self._operate(self._preconditioned(basis[k]))
            column = hessenberg[:, k]
            _project(basis, k + 1, vector, column)
            _combine(basis, k + 1, -column, vector)
            if k >= REORTHOGONALISE_FROM:
                _project(basis, k + 1, vector, again)
                _combine(basis, k + 1, -again, vector)
                column[: k + 1] += again[: k + 1]
            column[k + 1] = self._norm(vector)
            norm = problem.add(column[: k + 2])
            if column[k + 1] == 0.0:
                break
            np.divide(vector, column[k + 1], out=basis[k + 1])
            if norm <= target:
                break
        coefficients = problem.coefficients()
        used = len(coefficients)
        correction = np.zeros_like(state)
        _combine(basis, used, coefficients, correction)
        state += self._preconditioned(correction)
        left = -hessenberg[: used + 1, :used] @ coefficients  # the new residual in the basis
        left[0] += start
        self._left = left
        return used, norm

    def _rebuild(self, residual) -> None:
        """The residual that the last cycle has left, without a product."""
        residual[:] = 0.0
        if self._left[-1] == 0.0:  # the last direction was not needed, and not made
            self._left = self._left[:-1]
        _combine(self._basis, len(self._left), self._left, residual)

    def _space(self, shape) -> np.ndarray:
        if self._basis is None or self._basis.shape[1:] != shape:
            self._basis = np.empty((RESTART + 1, *shape))
        return self._basis
