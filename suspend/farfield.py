"""The far field of one scene: Ewald mobility, near field and their coupled solve.

Imported only where `far_field: ewald` asks for it; nothing else imports `suspend.hydro.ewald`.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from suspend.box import volume_fraction
from suspend.conventions import ROTATIONAL_DRAG
from suspend.hydro.ewald.mobility import Mobility
from suspend.hydro.ewald.parameters import EwaldParameters, choose_parameters
from suspend.hydro.two_sphere_matrices import five_of
from suspend.solvers.coupled import CoupledSolution, CoupledSolver

# An inner iteration with a mobility of 1 % error halves the time of a solve at 1e-6, changes nothing at 1e-3, and
# above phi = 0.45 keeps the accurate products few (benchmarks/bench_coupled.py)
COARSE, NESTED_BELOW, CROWDED = 1e-2, 2e-4, 0.45


def screened_drags(phi: float) -> tuple[float, float]:
    """Drag and rotational drag D of the preconditioner (R_nf + D).

    A sphere among others feels a larger drag than alone. Fitted to the fewest products at phi = 0.01 to 0.55
    (benchmarks/bench_coupled.py): any value within a factor of two costs at most one product more.
    """
    factor = 1.0 + 10.0 * phi
    return factor, factor * ROTATIONAL_DRAG


def stresslet_scale(phi: float) -> float:
    """Eigenvalue of M_ES taken by the preconditioner: 0.9 of a lone sphere, smaller in a crowd."""
    return max(0.9 - phi, 0.5)


@dataclass(frozen=True)
class FarFieldParameters:
    """The Ewald sum of a scene, and a cheaper one for the inner iteration of its solves (None: not worth it)."""

    accurate: EwaldParameters
    coarse: EwaldParameters | None

    @property
    def cutoff(self) -> float:
        """Centre distance (radii) that a neighbour list has to reach."""
        return max(part.split.cutoff for part in (self.accurate, self.coarse) if part is not None)


def make_parameters(section, tolerance: float, number: int, edge: float) -> FarFieldParameters:
    """Parameters from the tolerance of a mobility product.

    section : `suspend.config.Config.ewald`, whose keys may fix some of the accurate sum.
    """
    names = ("split", "cutoff", "grid", "window", "support")
    fixed = {name: getattr(section, name) for name in names if getattr(section, name, None) is not None}
    accurate = choose_parameters(tolerance, number, edge, **fixed)
    crowded = volume_fraction(number, edge) > CROWDED
    nested = tolerance <= NESTED_BELOW or (crowded and tolerance < COARSE)
    return FarFieldParameters(accurate, choose_parameters(COARSE, number, edge) if nested else None)


class FarField:
    """Mobility and coupled solve of spheres in a cell.

    Parameters
    ----------
    edge, number : cell edge (radii) and number of spheres
    parameters : from `make_parameters`
    near : `NearField` with the drags of `screened_drags`, or None without lubrication
    tolerance : of the coupled solve; limit : iterations; threads
    """

    def __init__(self, edge: float, number: int, parameters, near, tolerance: float, limit: int, threads: int):
        self.mobility = Mobility(edge, number, parameters.accurate, threads)
        self.coarse = Mobility(edge, number, parameters.coarse, threads) if parameters.coarse is not None else None
        scale = stresslet_scale(volume_fraction(number, edge))
        self.solver = CoupledSolver(self.mobility, near, scale, limit, self.coarse)
        self.tolerance = tolerance

    def place(self, position: np.ndarray, tilt: float, pairs: np.ndarray, offset: np.ndarray) -> None:
        """Take the positions of an evaluation, with a neighbour list that reaches the parameters' cutoff."""
        self.mobility.place(position, tilt, pairs, offset)
        if self.coarse is not None:
            self.coarse.place(position, tilt, pairs, offset)

    def solve(self, load, strain_rate, floor: float, start) -> CoupledSolution:
        """Velocities and stresslets for loads (N, 6) = external + R_FE : E and the flow's strain rate (3, 3)."""
        return self.solver.solve(load, five_of(strain_rate), self.tolerance, floor, start)
