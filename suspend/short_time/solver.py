"""The mobility problem of one configuration, set up once for many loads."""

from __future__ import annotations

import numpy as np

from suspend.conventions import COMPONENT_INDEX
from suspend.oneshot.hydrodynamics import Hydrodynamics, to_five, to_tensor
from suspend.oneshot.scene import Method, PeriodicScene


class ConfigurationSolver:
    """`suspend.short_time.estimators.Solve` of a scene: tables, grid and factorisation are made once.

    far_field and lubrication are those of `method`; velocities and stresslets to its accuracy. Raises
    ConfigurationError where the method cannot be used for the scene, NumericalError where a solve does not converge.
    """

    def __init__(self, scene: PeriodicScene, method: Method):
        self.scene, self.method = scene, method
        self.hydro = Hydrodynamics(scene, method)
        self.coupled = None
        if self.hydro.mobility is not None:
            from suspend.farfield import stresslet_scale
            from suspend.solvers.coupled import CoupledSolver

            scale = stresslet_scale(scene.volume_fraction)
            self.coupled = CoupledSolver(self.hydro.mobility, self.hydro.near, scale, method.max_iterations)
        self.solves = self.iterations = 0

    def __call__(self, load: np.ndarray, strain_rate: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Velocities (N, 6) relative to the flow and mean stresslet (3, 3) a sphere."""
        self.solves += 1
        load = load + self.hydro.strain_loads(strain_rate)
        solve = self._with_far_field if self.coupled is not None else self._alone
        velocity, mean = solve(load, strain_rate)
        if self.hydro.near is not None:
            near = self.hydro.near.stresslet(velocity, strain_rate) / self.scene.number
            for c, (a, b) in enumerate(COMPONENT_INDEX):
                mean[a, b] += near[c]
                mean[b, a] = mean[a, b]
        return velocity, mean

    def _with_far_field(self, load: np.ndarray, strain_rate: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        found = self.coupled.solve(load, to_five(strain_rate), self.method.far_target)
        self.iterations += found.iterations
        return found.velocity, to_tensor(-found.stresslet.mean(axis=0))

    def _alone(self, load: np.ndarray, strain_rate: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Every sphere's own drag and stresslet, and the near field."""
        hydro, mean = self.hydro, self.hydro.self_stresslet * strain_rate
        if hydro.near is None:
            return load / np.repeat(hydro.drags, 3), mean
        method = self.method
        found = hydro.near.solve(load, np.zeros_like(load), method.near_target, 0.0, method.max_iterations)
        self.iterations += found.iterations
        return found.velocity, mean
