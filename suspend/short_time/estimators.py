"""Short-time properties of one configuration from solves of its mobility problem.

With U = M_UF F the velocities of force-loaded spheres (torques, rate of strain and k = 0 flow zero), and likewise
Omega = M_OT T (6 pi eta0 a^n units: 1 and 3/4 for a lone sphere):

    eta_inf/eta0 = 1 + (9/4) phi <S>:E / (E:E)           five solves, one for each independent strain rate E
    U/U0         = mean velocity along equal forces      three solves
    D_s/D0       = tr M_UF / 3N,    D_r/D0 = (4/3) tr M_OT / 3N

The traces are exact from 6N unit loads, or estimated from solves with loads z of random signs, E[z.Mz] = tr M
(Hutchinson 1989). One solve serves both traces, forces and torques having independent signs. From z.Mz the same form
of an effective medium (`suspend.short_time.medium`) is subtracted and its exact mean added: this takes out the
long-ranged part of the scatter, whatever the medium's viscosity, without any bias.
"""

from __future__ import annotations

from typing import NamedTuple, Protocol

import numpy as np

from suspend.hydro.two_sphere_matrices import FIVE
from suspend.oneshot.scene import PeriodicScene
from suspend.short_time.medium import Medium

EXACT_BELOW = 8  # spheres up to which the traces are computed exactly, by 6N <= 48 solves


class Solve(Protocol):
    """Solution of the mobility problem of one configuration, set up once."""

    def __call__(self, load: np.ndarray, strain_rate: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Velocities (N, 6) relative to the flow, mean stresslet (3, 3) a sphere (Brady's sign).

        load : (N, 6) forces and torques on the spheres; strain_rate : (3, 3); 6 pi eta0 a^n units.
        """


class Measured(NamedTuple):
    """Properties of one configuration over their dilute values, and what they scatter over."""

    viscosities: np.ndarray  # (5,) of the strain rates FIVE
    settling: np.ndarray  # (3,) U/U0 along x, y, z
    diffusion: np.ndarray  # (p, 2) D_s/D0 and D_r/D0 of each probe; (1, 2) if exact
    exact: bool
    solves: int


def measure(
    solve: Solve, scene: PeriodicScene, probes: int, random: np.random.Generator, far_field: bool = True
) -> Measured:
    """All properties of one configuration; `probes` random loads for the traces (N > 8).

    far_field : whether spheres far apart feel each other, so that the medium's form helps.
    """
    number = scene.number
    viscosities = high_frequency_viscosities(solve, number, scene.volume_fraction)
    settling = settling_velocities(solve, number)
    exact = number <= EXACT_BELOW
    if exact:
        diffusion = exact_traces(solve, number)[None]
    else:
        medium = None
        if far_field:
            medium = Medium(scene.wrapped(), scene.edge, scene.reduced_tilt, float(viscosities.mean()))
        diffusion = probed_traces(solve, number, medium, probes, random)
    solves = 8 + (6 * number if exact else probes)
    return Measured(viscosities, settling, diffusion, exact, solves)


def high_frequency_viscosities(solve: Solve, number: int, phi: float) -> np.ndarray:
    """eta_inf/eta0 for each of the five strain rates of the basis FIVE (xx-yy, zz, xy, xz, yz)."""
    still = np.zeros((number, 6))
    values = [1.0 + 2.25 * phi * np.sum(solve(still, strain)[1] * strain) for strain in FIVE]
    return np.array(values)


def settling_velocities(solve: Solve, number: int) -> np.ndarray:
    """U/U0 along x, y and z: mean velocity along unit forces, relative to zero mean velocity of the suspension."""
    values = []
    for axis in range(3):
        load = np.zeros((number, 6))
        load[:, axis] = 1.0
        values.append(solve(load, np.zeros((3, 3)))[0][:, axis].mean())
    return np.array(values)


def exact_traces(solve: Solve, number: int) -> np.ndarray:
    """(D_s/D0, D_r/D0) by 6N solves with one unit load each."""
    trace = np.zeros(2)
    for i in range(number):
        for c in range(6):
            load = np.zeros((number, 6))
            load[i, c] = 1.0
            trace[c // 3] += solve(load, np.zeros((3, 3)))[0][i, c]
    return _reduced(trace, number)


def probed_traces(
    solve: Solve, number: int, medium: Medium | None, probes: int, random: np.random.Generator
) -> np.ndarray:
    """(D_s/D0, D_r/D0) from each of `probes` loads of random signs, (p, 2); each row is unbiased.

    medium : whose form is subtracted from the solution's, or None.
    """
    loads = random.choice(np.array([-1.0, 1.0]), size=(probes, number, 6))
    forms = np.empty((probes, 2))
    for load, form in zip(loads, forms, strict=True):
        velocity = solve(load, np.zeros((3, 3)))[0]
        form[:] = np.sum(load[:, :3] * velocity[:, :3]), np.sum(load[:, 3:] * velocity[:, 3:])
    if medium is not None:
        forms += medium.traces - medium.forms(loads)
    return _reduced(forms, number)


def _reduced(traces: np.ndarray, number: int) -> np.ndarray:
    return traces / (3.0 * number) * np.array([1.0, 4.0 / 3.0])
