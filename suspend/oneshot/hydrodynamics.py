"""Near and far field of one configuration, assembled once: the linear operators of the one-shot problems."""

from __future__ import annotations

import functools

import numpy as np

from suspend.conventions import COMPONENT_INDEX, ROTATIONAL_DRAG, SELF_STRESSLET
from suspend.dynamics import SolverSettings
from suspend.hydro.neighbours import find_pairs
from suspend.oneshot.scene import Method, PeriodicScene
from suspend.threads import start_threads


class Hydrodynamics:
    """Resistance of close pairs (`near`, None without lubrication) and far-field mobility (`mobility`, None
    unless ewald) of a scene; `drags` and `self_stresslet` are those of a lone sphere otherwise.
    """

    def __init__(self, scene: PeriodicScene, method: Method):
        method.check(scene)
        self.scene, self.method = scene, method
        self.position, self.tilt = scene.wrapped(), scene.reduced_tilt
        self.threads = start_threads(scene.number, method.threads)
        identity = method.far_field == "identity"
        self.drags = (1.0, 1.0 if identity else ROTATIONAL_DRAG)
        self.self_stresslet = 2.0 if identity else SELF_STRESSLET
        self.near = self.far = self.mobility = None
        if method.lubrication.enabled:
            self._assemble_near_field()
        if method.far_field == "ewald":
            self._place_far_field()

    def _assemble_near_field(self) -> None:
        from suspend.hydro.nearfield import NearField, pair_table

        law = self.method.lubrication
        table = pair_table(law.cutoff, law.at_cutoff, law.minimum_gap)
        drags = self.drags
        if self.method.far_field == "ewald":  # of the preconditioner
            from suspend.farfield import screened_drags

            drags = screened_drags(self.scene.volume_fraction)
        self.near = NearField(table, drags, self.threads)
        pairs, offset = find_pairs(self.position, self.scene.edge, self.tilt, law.cutoff)
        self.near.use_list(pairs, offset)
        self.near.assemble(self.position, self.scene.edge, self.tilt)
        self.near.precondition(SolverSettings.close_gap)  # as in runs

    def _place_far_field(self) -> None:
        from suspend.farfield import FarField

        scene, method = self.scene, self.method
        parameters = _parameters(method.ewald, method.ewald_target, scene.number, scene.edge)
        self.far = FarField(
            scene.edge, scene.number, parameters, self.near, method.far_target, method.max_iterations, self.threads
        )
        self.mobility = self.far.mobility
        pairs, offset = find_pairs(self.position, scene.edge, self.tilt, parameters.cutoff)
        self.far.place(self.position, self.tilt, pairs, offset)

    def strain_loads(self, strain_rate: np.ndarray) -> np.ndarray:
        """R_FE^nf : E, (N, 6): loads of the near field on spheres held in the flow."""
        if self.near is None:
            return np.zeros((self.scene.number, 6))
        return self.near.strain_loads(strain_rate)

    def near_loads(self, velocity: np.ndarray) -> np.ndarray:
        """R_FU^nf U', (N, 6): loads that move the spheres against the near field."""
        loads = np.zeros((self.scene.number, 6))
        if self.near is not None:
            from suspend.core.pairs import apply_rows

            apply_rows(0, self.scene.number, self.near.active, self.near.scalars, velocity, loads)
        return loads

    def near_stresslets(self, velocity: np.ndarray, strain_rate: np.ndarray) -> np.ndarray:
        """-R_SU^nf U' + R_SE^nf : E of each sphere, (N, 3, 3), Brady's sign."""
        result = np.zeros((self.scene.number, 3, 3))
        if self.near is None:
            return result
        from suspend.hydro.nearfield import pair_table

        law = self.method.lubrication
        odd = pair_table(law.cutoff, law.at_cutoff, law.minimum_gap, odd=True)
        each = self.near.stresslet_of_each(
            odd, self.position, self.scene.edge, self.tilt, velocity, strain_rate
        )
        for c, (a, b) in enumerate(COMPONENT_INDEX):
            result[:, a, b] = result[:, b, a] = each[:, c]
        return result


@functools.lru_cache(maxsize=16)
def _parameters(ewald, tolerance: float, number: int, edge: float):
    """Parameters of the Ewald sum, kept: to find them takes longer than to solve a small scene."""
    from suspend.farfield import make_parameters

    return make_parameters(ewald, tolerance, number, edge)

