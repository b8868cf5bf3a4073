"""The mobility problem of one configuration, set up once for many loads."""

from __future__ import annotations

import numpy as np

from suspend.conventions import COMPONENT_INDEX
from suspend.hydro.two_sphere_matrices import tensor_of
from suspend.oneshot.hydrodynamics import Hydrodynamics
from suspend.oneshot.scene import Method, PeriodicScene


class ConfigurationSolver:
    """`suspend.short_time.estimators.Solve` of a scene: tables, grid and factorisation are made once.

    far_field and lubrication are those of `method`; velocities and stresslets to its accuracy. Raises
    ConfigurationError where the method cannot be used for the scene, NumericalError where a solve does not converge.
    """

    def __init__(self, scene: PeriodicScene, method: Method):
        self.hydro = Hydrodynamics(scene, method)
        self.solves = self.iterations = 0

    def __call__(self, load: np.ndarray, strain_rate: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Velocities (N, 6) relative to the flow and mean stresslet (3, 3) a sphere."""
        self.solves += 1
        hydro = self.hydro
        load = load + hydro.strain_loads(strain_rate)
        solve = self._alone if hydro.far is None else self._with_far_field
        velocity, mean = solve(load, strain_rate)
        if hydro.near is not None:
            near = hydro.near.stresslet(velocity, strain_rate) / hydro.scene.number
            for c, (a, b) in enumerate(COMPONENT_INDEX):
                mean[a, b] += near[c]
                mean[b, a] = mean[a, b]
        return velocity, mean

    def _with_far_field(self, load: np.ndarray, strain_rate: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        found = self.hydro.far.solve(load, strain_rate, 0.0, None)
        self.iterations += found.iterations
        return found.velocity, -tensor_of(found.stresslet.mean(axis=0))

    def _alone(self, load: np.ndarray, strain_rate: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Every sphere's own drag and stresslet, and the near field."""
        hydro = self.hydro
        mean = hydro.self_stresslet * strain_rate
        if hydro.near is None:
            return load / np.repeat(hydro.drags, 3), mean
        method = hydro.method
        found = hydro.near.solve(load, np.zeros_like(load), method.near_target, 0.0, method.max_iterations)
        self.iterations += found.iterations
        return found.velocity, mean
