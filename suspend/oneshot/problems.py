"""The mobility problem (loads -> velocities) and the resistance problem (velocities -> loads) of one configuration.

Unknown are the far-field loads f = [F; T], s of the spheres on the fluid (s: stresslet in the basis FIVE, minus
Brady's) and the velocities U' = [U; Omega], given is the other of loads and velocities:

    M [f; s] = [U'; -E],    f = b - R_FU^nf U',    b = external loads + R_FE^nf : E
    stresslet (Brady's sign) = -s - R_SU^nf U' + R_SE^nf : E

All velocities are relative to the undisturbed flow at the centres. With far_field self or identity M is the
diagonal of lone spheres. Units: a = 1, loads over 6 pi eta0 a^n. Fiore & Swan, J. Fluid Mech. 878, 544 (2019).
"""

from __future__ import annotations

import time
from dataclasses import dataclass

import numpy as np

from suspend.errors import ConfigurationError
from suspend.hydro.two_sphere_matrices import five_of, tensor_of
from suspend.oneshot.hydrodynamics import Hydrodynamics
from suspend.oneshot.iterations import solve_definite
from suspend.oneshot.scene import Method, PeriodicScene, strain_rate_tensor, vectors_of

MOBILITY_DIAGONAL = np.array([1.0] * 3 + [0.75] * 3 + [0.9] * 5)  # of a lone sphere
LONE = Method()


@dataclass(frozen=True)
class Cost:
    """Accuracy reached and work done.

    residual : with the Ewald far field the relative residual of the solve, computed anew; with far_field self and
    identity the estimated relative error of the velocities (energy norm), 0 where nothing was iterated.
    """

    accuracy: float
    residual: float
    iterations: int
    products: int  # of the far-field mobility
    seconds: float


@dataclass(frozen=True)
class Motions:
    """Answer of the mobility problem; lengths in radii, loads over 6 pi eta0 a^n.

    U, Omega : (N, 3), relative to the undisturbed flow; stresslet : (N, 3, 3), Brady's sign;
    eta_r : 1 + 6 pi (N/V) <S>:E / (2 E:E), for simple shear sigma_xy / (eta0 rate); None without flow.
    """

    U: np.ndarray
    Omega: np.ndarray
    stresslet: np.ndarray
    eta_r: float | None
    cost: Cost


@dataclass(frozen=True)
class Loads:
    """Answer of the resistance problem; units and eta_r as in `Motions`.

    forces, torques : (N, 3), to be exerted on the spheres from outside.
    """

    forces: np.ndarray
    torques: np.ndarray
    stresslet: np.ndarray
    eta_r: float | None
    cost: Cost


def mobility_problem(
    scene: PeriodicScene, forces=None, torques=None, strain_rate=None, method: Method = LONE
) -> Motions:
    """Velocities and stresslets of spheres under given forces and torques in a given flow.

    Parameters
    ----------
    forces, torques : (N, 3) on the spheres from outside, units 6 pi eta0 a and 6 pi eta0 a^2 (times a velocity and
        a rate); None = 0
    strain_rate : None, the shear rate of u = rate y e_x, or the flow's strain rate, a symmetric traceless (3, 3)
    method : far field, lubrication, accuracy

    Raises ConfigurationError (malformed arrays, overlap with lubrication, cell too small), NumericalError (no
    convergence). The F, T, S truncation has its own error: about 10 % in drag above phi = 0.15 without lubrication.
    """
    started = time.perf_counter()
    load = np.hstack([_vectors("forces", forces, scene), _vectors("torques", torques, scene)])
    load, flow, scale = _scaled(load, strain_rate_tensor(strain_rate))
    hydro = Hydrodynamics(scene, method)
    load = load + hydro.strain_loads(flow)
    solve = _move_coupled if hydro.mobility is not None else _move_alone
    velocity, far, residual, iterations, products = solve(hydro, load, flow)
    stresslet = -far + hydro.near_stresslets(velocity, flow)
    cost = Cost(method.accuracy, residual, iterations, products, time.perf_counter() - started)
    eta_r = relative_viscosity(scene, stresslet, flow)
    velocity, stresslet = _unscaled(scale, velocity, stresslet)
    return Motions(velocity[:, :3].copy(), velocity[:, 3:].copy(), stresslet, eta_r, cost)


def resistance_problem(
    scene: PeriodicScene, velocities=None, angular_velocities=None, strain_rate=None, method: Method = LONE
) -> Loads:
    """Forces, torques and stresslets of spheres that move with given velocities in a given flow.

    velocities, angular_velocities : (N, 3), relative to the undisturbed flow at the centres; None = 0. Parameters
    and errors otherwise as for `mobility_problem`. The k = 0 mode is left out: velocities are relative to zero
    mean velocity of the suspension.
    """
    started = time.perf_counter()
    velocity = np.hstack(
        [_vectors("velocities", velocities, scene), _vectors("angular_velocities", angular_velocities, scene)]
    )
    velocity, flow, scale = _scaled(velocity, strain_rate_tensor(strain_rate))
    hydro = Hydrodynamics(scene, method)
    if hydro.mobility is None:
        load = velocity * np.repeat(hydro.drags, 3)
        far, residual, iterations, products = _lone_stresslets(hydro, flow), 0.0, 0, 0
    else:
        right = np.hstack([velocity, np.tile(-five_of(flow), (scene.number, 1))])
        found = solve_definite(
            hydro.mobility.apply, right, MOBILITY_DIAGONAL, method.far_target, method.max_iterations
        )
        load, far = found.solution[:, :6], tensor_of(found.solution[:, 6:])
        residual, iterations, products = found.residual, found.iterations, found.products
    load = load + hydro.near_loads(velocity) - hydro.strain_loads(flow)
    stresslet = -far + hydro.near_stresslets(velocity, flow)
    cost = Cost(method.accuracy, residual, iterations, products, time.perf_counter() - started)
    eta_r = relative_viscosity(scene, stresslet, flow)
    load, stresslet = _unscaled(scale, load, stresslet)
    return Loads(load[:, :3].copy(), load[:, 3:].copy(), stresslet, eta_r, cost)


def relative_viscosity(scene: PeriodicScene, stresslet: np.ndarray, strain_rate: np.ndarray) -> float | None:
    """eta_r = 1 + 6 pi (N/V) <S>:E / (2 E:E), None without flow."""
    size = np.sum(strain_rate**2)
    if size == 0.0:
        return None
    mean = stresslet.mean(axis=0)
    return float(1.0 + 6.0 * np.pi * scene.density * np.sum(mean * strain_rate) / (2.0 * size))


def _scaled(given: np.ndarray, flow: np.ndarray) -> tuple[np.ndarray, np.ndarray, int]:
    """`given` and `flow` over 2**scale, of the order of 1, and scale.

    The problems are linear; squares of loads of 1e-200 would vanish in the norms of the solves. A power of two
    changes no digit.
    """
    size = max(np.abs(given).max(), np.abs(flow).max())
    scale = int(np.frexp(size)[1]) if size > 0.0 else 0
    return np.ldexp(given, -scale), np.ldexp(flow, -scale), scale


def _unscaled(scale: int, *answers: np.ndarray) -> list[np.ndarray]:
    """The answers times 2**scale; ConfigurationError where they are beyond double precision."""
    with np.errstate(over="ignore"):
        result = [np.ldexp(answer, scale) for answer in answers]
    if not all(np.isfinite(answer).all() for answer in result):
        raise ConfigurationError("the answer is larger than double precision holds (1.8e308): scale what is given down")
    return result


def _vectors(name: str, value, scene: PeriodicScene) -> np.ndarray:
    return np.zeros((scene.number, 3)) if value is None else vectors_of(name, value, scene.number)


def _lone_stresslets(hydro: Hydrodynamics, flow: np.ndarray) -> np.ndarray:
    return np.tile(-hydro.self_stresslet * flow, (hydro.scene.number, 1, 1))


def _move_alone(hydro: Hydrodynamics, load: np.ndarray, flow: np.ndarray) -> tuple:
    """Without far field: (R_self + R_nf) U' = load."""
    far = _lone_stresslets(hydro, flow)
    if hydro.near is None:
        return load / np.repeat(hydro.drags, 3), far, 0.0, 0, 0
    start, method = np.zeros_like(load), hydro.method
    solution = hydro.near.solve(load, start, method.near_target, 0.0, method.max_iterations)
    return solution.velocity, far, float(solution.error), solution.iterations, 0


def _move_coupled(hydro: Hydrodynamics, load: np.ndarray, flow: np.ndarray) -> tuple:
    """With the Ewald far field; without lubrication M_SS s = -E - M_SF f alone is to be solved."""
    method, number = hydro.method, hydro.scene.number
    if hydro.near is not None:
        found = hydro.far.solve(load, flow, 0.0, None)
        return (
            found.velocity,
            tensor_of(found.stresslet),
            float(found.residual),
            found.iterations,
            found.products,
        )

    def strain_rates(stresslets: np.ndarray) -> np.ndarray:
        return hydro.mobility.apply(np.hstack([np.zeros((number, 6)), stresslets]))[:, 6:]

    loads = np.hstack([load, np.zeros((number, 5))])
    right = -five_of(flow) - hydro.mobility.apply(loads)[:, 6:]
    found = solve_definite(
        strain_rates, right, MOBILITY_DIAGONAL[6:], method.far_target, method.max_iterations
    )
    loads[:, 6:] = found.solution
    velocity = hydro.mobility.apply(loads)[:, :6]
    return velocity, tensor_of(found.solution), found.residual, found.iterations, found.products + 2
