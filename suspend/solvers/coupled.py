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
from suspend.solvers.gmres import WIDTH, Gmres, norm_of
from suspend.solvers.incomplete import apply_factor
from suspend.solvers.stiff_clusters import add_clusters

INNER_TOLERANCE = 0.05  # of the inner iteration: about the accuracy of the coarse mobility
INNER_LIMIT = 40
_NO_LOAD = np.empty((0, 6))


@dataclass
class CoupledSolution:
    """Velocities (N, 6) relative to the flow, stresslets on the fluid (N, 5), and what they cost."""

    velocity: np.ndarray
    stresslet: np.ndarray
    iterations: int
    products: int
    residual: float  # relative to the norm of [U; E]
    coarse_products: int
    guess: np.ndarray  # (N, 17): [U; s; f], from which the next solve starts


@parallel_kernel
def _subtract_resistance(chunks, active, scalars, state, load, out):
    """out[:, :6] = load - R_nf . state[:, :6] (`load` may be empty: zero), out[:, 6:] = state[:, 6:]."""
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
            out[i, c] = (load[i, c] if loaded else 0.0) - s
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


class CoupledSolver:
    """Velocities and stresslets of spheres with a mobility and (or without) a near field.

    mobility : object with `apply(loads (N, 11)) -> (N, 11)`, symmetric positive definite; near : a
    `suspend.hydro.nearfield.NearField` whose drags are D, assembled and with its factor made, or None: no
    lubrication; stresslet_scale : m of the preconditioner (about the mean eigenvalue of M_ES); limit :
    iterations before a NumericalError; coarse : a cheaper mobility at the same positions, with which an inner
    iteration preconditions the outer one.
    """

    def __init__(self, mobility, near, stresslet_scale: float = 0.5, limit: int = 200, coarse=None):
        self.mobility, self.coarse, self.near = mobility, coarse, near
        self.stresslet_scale, self.limit = stresslet_scale, limit
        self.products = self.coarse_products = 0
        if coarse is None:
            self._outer = Gmres(self._operate, self._precondition)
        else:
            self._inner = Gmres(self._operate_coarsely, self._precondition)
            self._outer = Gmres(self._operate, self._solve_coarsely, flexible=True)

    def solve(self, load, strain_rate, tolerance: float, floor: float = 0.0, start=None) -> CoupledSolution:
        """Solve for `load` (N, 6) = external + R_FE : E and the undisturbed `strain_rate` (five-vector).

        tolerance : norm of the residual relative to that of [U; E], or to `floor` * sqrt(N) if that is
        larger; start : (N, 17) first guess [U; s; f] with f the mobility's forces and torques, such as `solution.guess`
        or an extrapolation of several, else one near-field solve.
        """
        before, coarsely = self.products, self.coarse_products
        state = self._first_guess(load, strain_rate) if start is None else self._adapted(load, start)
        residual = self._residual(load, strain_rate, state)
        norm, iterations = norm_of(residual), 0
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
                self._outer.left(residual)
            cycle = self._outer.cycle(residual, norm, tolerance * scale, self.limit - iterations)
            state += cycle.correction
            norm = cycle.norm
            iterations += cycle.iterations
        return CoupledSolution(
            np.ascontiguousarray(state[:, :6]),
            np.ascontiguousarray(state[:, 6:]),
            iterations,
            self.products - before,
            norm / scale if scale > 0.0 else 0.0,
            self.coarse_products - coarsely,
            np.hstack([state, self._loads(state, load)[:, :6]]),
        )

    def _first_guess(self, load, strain_rate) -> np.ndarray:
        guess = np.empty((len(load), WIDTH))
        guess[:, :6] = load
        guess[:, 6:] = -strain_rate
        if self.near is not None:
            guess[:, :6] /= np.repeat(self.near.drags, 3)
        return self._precondition(guess)

    def _adapted(self, load, start) -> np.ndarray:
        """A guess whose near-field loads fit the present positions: U + (R + D)^-1 (b - R U - f).

        The forces f on the mobility vary smoothly; those that a guessed U makes across a closing gap do not.
        """
        state = start[:, :WIDTH].copy()
        if self.near is not None:
            excess = np.zeros_like(state)
            excess[:, :6] = (self._loads(state, load)[:, :6] - start[:, WIDTH:]) / np.repeat(self.near.drags, 3)
            state += self._precondition(excess)
        return state

    def _scale(self, state, strain_rate, floor: float) -> float:
        moved = float(np.vdot(state[:, :6], state[:, :6])) + len(state) * float(strain_rate @ strain_rate)
        return max(np.sqrt(moved), floor * np.sqrt(len(state)))

    def _loads(self, state, load) -> np.ndarray:
        """[load - R_nf U; s]."""
        out = np.empty_like(state)
        if self.near is None:
            out[:, :6] = load if len(load) else 0.0
            out[:, 6:] = state[:, 6:]
        else:
            near = self.near
            _subtract_resistance(near.chunks, near.active, near.scalars, state, load, out)
        return out

    def _residual(self, load, strain_rate, state) -> np.ndarray:
        self.products += 1
        moved = self.mobility.apply(self._loads(state, load))
        _equation_residual(state, strain_rate, moved)
        return moved

    def _operate(self, direction) -> np.ndarray:
        self.products += 1
        moved = self.mobility.apply(self._loads(direction, _NO_LOAD))
        _operator_rows(direction, moved)
        return moved

    def _operate_coarsely(self, direction) -> np.ndarray:
        self.coarse_products += 1
        moved = self.coarse.apply(self._loads(direction, _NO_LOAD))
        _operator_rows(direction, moved)
        return moved

    def _precondition(self, vector) -> np.ndarray:
        out = np.empty_like(vector)
        if self.near is None:
            out[:, :6] = vector[:, :6]
            out[:, 6:] = vector[:, 6:] / self.stresslet_scale
        else:
            clusters = self.near.clusters
            if not len(clusters.order):
                self._factor_inverse(vector, out)
            else:
                self._with_clusters(clusters, vector, out)
        return out

    def _factor_inverse(self, vector, out) -> None:
        _precondition(self.near.factor, self.near.drags, self.stresslet_scale, vector, out)

    def _with_clusters(self, clusters, vector, out) -> None:
        """The factorisation's inverse between two exact solves of the clusters (multiplicative Schwarz).

        A product with R_nf costs little here, and next to the mobility's identity the sum of both inverses, which
        counts some motions twice, would cost iterations.
        """
        drags = np.repeat(self.near.drags, 3)
        work = np.empty((2, len(clusters.order), 6))
        load = drags * vector[:, :6]
        found = np.zeros((len(vector), WIDTH))
        velocity = np.zeros((len(vector), 6))
        for clustered in (True, False, True):
            found[:, :6] = velocity
            residual = self._loads(found, load)[:, :6] - drags * velocity
            if clustered:
                residual = np.ascontiguousarray(residual)
                add_clusters(clusters, residual, velocity, work)
            else:
                found[:, :6] = residual / drags
                self._factor_inverse(found, out)
                velocity += out[:, :6]
        out[:, :6] = velocity
        out[:, 6:] = vector[:, 6:] / self.stresslet_scale

    def _solve_coarsely(self, vector) -> np.ndarray:
        norm = norm_of(vector)
        return self._inner.cycle(vector, norm, INNER_TOLERANCE * norm, INNER_LIMIT).correction
