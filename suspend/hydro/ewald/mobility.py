"""The many-body mobility of spheres in the sheared periodic cell at the force-torque-stresslet level.

    [U; Omega; E] = M_ff [F; T; S]        loads on the fluid, k = 0 left out: velocities relative to the mean

M_ff is the sum over all images of the finite-size Oseen kernels with Faxen's laws at both ends (Durlofsky,
Brady & Bossis 1987; Fiore & Swan 2019), split into a wave part on a grid and a real part over near pairs. It
is symmetric positive definite in the plain dot product, also for overlapping spheres. Units 6 pi eta0 a^n, a = 1:
a lone sphere in a large cell has the diagonal 1, 3/4, 9/10.
"""

from __future__ import annotations

import numpy as np

from suspend.errors import ConfigurationError
from suspend.hydro.ewald.parameters import EwaldParameters
from suspend.hydro.ewald.radial import radial_table, self_terms
from suspend.hydro.ewald.real import RealPart
from suspend.hydro.ewald.wave import WavePart

COMPONENTS = 11  # F, T, S of a sphere; S in the orthonormal basis `suspend.hydro.two_sphere_matrices.FIVE`


class Mobility:
    """M_ff of `number` spheres in a cell of edge `edge` (radii); `place` first, then any number of `apply`.

    Parameters
    ----------
    edge : cell edge L, radii
    number : spheres
    parameters : from `suspend.hydro.ewald.parameters.choose_parameters`
    threads : parts the work is cut into; results depend on it in the last digits only
    """

    def __init__(self, edge: float, number: int, parameters: EwaldParameters, threads: int = 1):
        self.edge, self.number, self.parameters = edge, number, parameters
        split = parameters.split
        self.real = RealPart(radial_table(split), self_terms(split), threads)
        self.wave = WavePart(edge, split, parameters.grid, parameters.window, threads)

    @property
    def cutoff(self) -> float:
        """Centre distance (radii) the neighbour list has to reach."""
        return self.parameters.split.cutoff

    def place(self, position: np.ndarray, tilt: float, pairs: np.ndarray, offset: np.ndarray) -> None:
        """Take positions (N, 3) (radii), the tilt and a list of pairs of `suspend.hydro.neighbours`.

        The list must hold every pair, own images included, closer than `cutoff`; it may hold more. Its image
        numbers belong to these positions and this tilt, which need be neither wrapped nor reduced.
        """
        if position.shape != (self.number, 3) or offset.shape[0] != self.number + 1:
            raise ConfigurationError(
                f"far field: positions of shape {position.shape} and a list of {offset.shape[0] - 1} spheres, "
                f"made for {self.number}"
            )
        self.real.use_list(pairs, offset)
        self.real.place(position, self.edge, tilt)
        self.wave.place(position, tilt)

    def apply(self, loads: np.ndarray) -> np.ndarray:
        """[U, Omega, E] (N, 11) from [F, T, S] (N, 11) float64, units 6 pi eta0 a^n."""
        result = np.zeros((self.number, COMPONENTS))
        self.real.add(loads, result)
        self.wave.add(loads, result)
        return result

    def matrix(self) -> np.ndarray:
        """The dense matrix (11 N, 11 N), sphere by sphere, from 11 N products: for small N."""
        unit = np.eye(COMPONENTS * self.number).reshape(-1, self.number, COMPONENTS)
        return np.stack([self.apply(loads).reshape(-1) for loads in unit], axis=1)
