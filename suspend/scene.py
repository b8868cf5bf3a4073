"""From a configuration to the objects of a run: only what the scene needs is built."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from suspend.box import edge_length, volume_fraction
from suspend.conventions import ROTATIONAL_DRAG, SELF_STRESSLET
from suspend.dynamics import Scene, SolverSettings, Suspension
from suspend.forces import pair_force
from suspend.hydro.lubrication import Lubrication
from suspend.threads import start_threads


@dataclass(frozen=True)
class Units:
    """Scales of the configuration's units: length a, rate Gamma, viscosity eta0."""

    length: float
    rate: float
    viscosity: float

    @property
    def stress(self) -> float:
        """Stress scale eta0 Gamma."""
        return self.viscosity * self.rate

    @property
    def time(self) -> float:
        """Time scale 1 / Gamma."""
        return 1.0 / self.rate


def make_units(config) -> Units:
    """Scales from `suspend.config.Config`."""
    from suspend.flow import rate_scale

    return Units(config.particles.radius, rate_scale(config), config.fluid.viscosity)


def make_scene(config, edge: float | None = None) -> Scene:
    """Forces, resistance functions and self terms; `edge` L in radii, from phi unless a file gave it."""
    law = config.lubrication
    identity = config.far_field == "identity"
    edge = edge or edge_length(config.particles.number, config.particles.volume_fraction)
    drags, ewald = (1.0, 1.0 if identity else ROTATIONAL_DRAG), None
    if config.far_field == "ewald":
        from suspend.farfield import make_parameters, screened_drags

        ewald = make_parameters(config.ewald, config.ewald.tolerance, config.particles.number, edge)
        drags = screened_drags(volume_fraction(config.particles.number, edge))
    external = np.zeros(6)
    if config.external is not None:
        external[:3], external[3:] = config.external.force, config.external.torque
    return Scene(
        edge=edge,
        lubrication=Lubrication(law.cutoff, law.at_cutoff, law.minimum_gap) if law.enabled else None,
        drags=drags,
        self_stresslet=2.0 if identity else SELF_STRESSLET,
        force=pair_force(config.repulsion, config.contact),
        external=external,
        sheared=config.flow.type != "quiescent",
        ewald=ewald,
    )


def make_suspension(config, threads: int, edge: float | None = None) -> Suspension:
    """The velocity field of a configuration. Raises what `suspend.threads.start_threads` raises."""
    settings = SolverSettings(
        tolerance=config.solver.tolerance,
        far_tolerance=config.solver.far_tolerance or config.tolerance,
        max_iterations=config.solver.max_iterations,
    )
    number = config.particles.number
    return Suspension(make_scene(config, edge), settings, number, start_threads(number, threads))
