"""The far field of one scene: Ewald mobility, near field and their coupled solve.

Imported only where `far_field: ewald` asks for it; nothing else imports `suspend.hydro.ewald`.
"""

from __future__ import annotations

import numpy as np

from suspend.conventions import COMPONENT_INDEX, ROTATIONAL_DRAG
from suspend.hydro.ewald.mobility import Mobility
from suspend.hydro.ewald.parameters import EwaldParameters, choose_parameters
from suspend.hydro.two_sphere_matrices import FIVE
from suspend.solvers.coupled import CoupledSolution, CoupledSolver

_FIVE_TO_SIX = np.array([[basis[a, b] for a, b in COMPONENT_INDEX] for basis in FIVE])


def screened_drags(volume_fraction: float) -> tuple[float, float]:
    """Drag and rotational drag D of the preconditioner (R_nf + D).

    A sphere among others feels a larger drag than alone. Fitted to the fewest products at phi = 0.01 to 0.55
    (benchmarks/bench_coupled.py): any value within a factor of two costs at most one product more.
    """
    factor = 1.0 + 10.0 * volume_fraction
    return factor, factor * ROTATIONAL_DRAG


def stresslet_scale(volume_fraction: float) -> float:
    """Eigenvalue of M_ES taken by the preconditioner: 0.9 of a lone sphere, smaller in a crowd."""
    return 0.9 - 0.8 * min(volume_fraction, 0.5)


def five_of(tensor: np.ndarray) -> np.ndarray:
    """Components (5,) of a symmetric traceless tensor (3, 3) in the orthonormal basis `FIVE`."""
    return np.einsum("aij,ij->a", FIVE, tensor)


def six_of(five: np.ndarray) -> np.ndarray:
    """Components (..., 6) in the order of `suspend.conventions.COMPONENTS` from five-vectors (..., 5)."""
    return five @ _FIVE_TO_SIX


def make_parameters(section, tolerance: float, number: int, edge: float) -> EwaldParameters:
    """Parameters of the Ewald sum from a tolerance; `section` (`suspend.config.Config.ewald`) may fix some."""
    names = ("split", "cutoff", "grid", "window", "support")
    fixed = {name: getattr(section, name) for name in names if getattr(section, name, None) is not None}
    return choose_parameters(tolerance, number, edge, **fixed)


class FarField:
    """Mobility and coupled solve of spheres in a cell.

    Parameters
    ----------
    edge, number : cell edge (radii) and number of spheres
    parameters : `suspend.hydro.ewald.parameters.EwaldParameters`
    near : `NearField` with the drags of `screened_drags`, or None without lubrication
    tolerance : of the coupled solve; limit : iterations; threads
    """

    def __init__(self, edge: float, number: int, parameters, near, tolerance: float, limit: int, threads: int):
        self.mobility = Mobility(edge, number, parameters, threads)
        phi = number * 4.0 * np.pi / 3.0 / edge**3
        self.solver = CoupledSolver(self.mobility, near, stresslet_scale(phi), limit)
        self.tolerance = tolerance

    def place(self, position: np.ndarray, tilt: float, pairs: np.ndarray, offset: np.ndarray) -> None:
        """Take the positions of an evaluation, with a neighbour list that reaches `mobility.cutoff`."""
        self.mobility.place(position, tilt, pairs, offset)

    def solve(self, load, strain_rate, floor: float, start) -> CoupledSolution:
        """Velocities and stresslets for loads (N, 6) = external + R_FE : E and the flow's strain rate (3, 3)."""
        return self.solver.solve(load, five_of(strain_rate), self.tolerance, floor, start)
