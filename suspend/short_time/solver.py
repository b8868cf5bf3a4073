"""The mobility problem of one configuration, set up once for many loads."""

from __future__ import annotations

import functools

import numpy as np

from suspend.conventions import COMPONENT_INDEX, ROTATIONAL_DRAG, SELF_STRESSLET
from suspend.hydro.neighbours import find_pairs
from suspend.hydro.two_sphere_matrices import FIVE
from suspend.oneshot.scene import Method, PeriodicScene
from suspend.scene import threads_used

CLOSE_GAP = 0.2  # radii: pairs below it enter the incomplete factorisation, as in runs


class ConfigurationSolver:
    """`suspend.short_time.estimators.Solve` of a scene: tables, grid and factorisation are made once.

    far_field and lubrication are those of `method`; velocities and stresslets to its accuracy. Raises
    ConfigurationError where the method cannot be used for the scene, NumericalError where a solve does not converge.
    """

    def __init__(self, scene: PeriodicScene, method: Method):
        method.check(scene)
        self.scene, self.method = scene, method
        self.threads = threads_used(scene.number, method.threads)
        identity = method.far_field == "identity"
        self.drags = (1.0, 1.0 if identity else ROTATIONAL_DRAG)
        self.self_stresslet = 2.0 if identity else SELF_STRESSLET
        self.solves = self.iterations = 0
        far = method.far_field == "ewald"
        self.near = self._near_field(far) if method.lubrication.enabled else None
        self.far = self._far_field() if far else None

    def __call__(self, load: np.ndarray, strain_rate: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Velocities (N, 6) relative to the flow and mean stresslet (3, 3) a sphere."""
        self.solves += 1
        if self.near is not None:
            load = load + self.near.strain_loads(strain_rate)
        solve = self._with_far_field if self.far is not None else self._alone
        velocity, mean = solve(load, strain_rate)
        if self.near is not None:
            near = self.near.stresslet(velocity, strain_rate) / self.scene.number
            for c, (a, b) in enumerate(COMPONENT_INDEX):
                mean[a, b] += near[c]
                mean[b, a] = mean[a, b]
        return velocity, mean

    def _near_field(self, far: bool):
        from suspend.hydro.nearfield import NearField, pair_table

        law, scene = self.method.lubrication, self.scene
        drags = self.drags
        if far:  # those of the preconditioner
            from suspend.farfield import screened_drags

            drags = screened_drags(scene.volume_fraction)
        table = pair_table(law.cutoff, law.at_cutoff, law.minimum_gap)
        near = NearField(table, drags, self.threads)
        position, tilt = scene.wrapped(), scene.reduced_tilt
        near.use_list(*find_pairs(position, scene.edge, tilt, law.cutoff))
        near.assemble(position, scene.edge, tilt)
        near.precondition(CLOSE_GAP)
        return near

    def _far_field(self):
        from suspend.farfield import FarField

        scene, method = self.scene, self.method
        parameters = _parameters(method.ewald, method.ewald_target, scene.number, scene.edge)
        far = FarField(
            scene.edge, scene.number, parameters, self.near, method.far_target, method.max_iterations, self.threads
        )
        position, tilt = scene.wrapped(), scene.reduced_tilt
        far.place(position, tilt, *find_pairs(position, scene.edge, tilt, parameters.cutoff))
        return far

    def _with_far_field(self, load: np.ndarray, strain_rate: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        found = self.far.solve(load, strain_rate, 0.0, None)
        self.iterations += found.iterations
        return found.velocity, -np.einsum("a,aij->ij", found.stresslet.mean(axis=0), FIVE)

    def _alone(self, load: np.ndarray, strain_rate: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Every sphere's own drag and stresslet, and the near field."""
        mean = self.self_stresslet * strain_rate
        if self.near is None:
            return load / np.repeat(self.drags, 3), mean
        method = self.method
        found = self.near.solve(load, np.zeros_like(load), method.near_target, 0.0, method.max_iterations)
        self.iterations += found.iterations
        return found.velocity, mean


@functools.lru_cache(maxsize=4)
def _parameters(ewald, tolerance: float, number: int, edge: float):
    """Parameters of the Ewald sum, kept for the next configuration of an ensemble."""
    from suspend.farfield import make_parameters

    return make_parameters(ewald, tolerance, number, edge)
