"""Keys of how it is computed: the far field's Ewald sum, time steps, solves; and of what is stored."""

from __future__ import annotations

from dataclasses import dataclass

from suspend.config.keys import Only, key

WITH_EWALD = Only("far_field", ("ewald",), top=True)
FINEST, COARSEST = 1e-10, 1e-2  # tolerances: round-off of the Ewald sum; beyond, no digit is right
NEAR_SHARE = 1e-2  # of the run's tolerance: that of the near-field velocity solve


@dataclass(frozen=True, kw_only=True)
class Ewald:
    """The Ewald sum of the far field; what is None is chosen from the tolerance and a cost model."""

    tolerance: float = key(
        "number",
        "relative error of a mobility product (2-norm, random loads); null = the run's tolerance, or"
        " integrator.tolerance where that is smaller; below 1e-10 is round-off",
        default=None,
        least=FINEST,
        most=COARSEST,
    )
    split: str | None = key(
        "choice",
        "how the kernel is split into a real-space and a wave-space part; null = optimal, the fastest",
        default=None,
        choices=("gaussian", "pswf", "optimal"),
    )
    cutoff: float | None = key(
        "number",
        "centre distance at which the real-space part ends; null = where the product is fastest",
        unit="radii",
        default=None,
        least=0.1,
        most=1000.0,
        symbols=("rc", "r_c", "xi"),
    )
    grid: tuple[int, int, int] | None = key(
        "integers",
        "grid points along the three cell vectors; null = as the tolerance asks",
        default=None,
        length=3,
        least=2,
        most=4096,
        symbols=("mesh", "m"),
    )
    window: str | None = key(
        "choice",
        "function that carries loads to the grid and velocities back; null = the fastest",
        default=None,
        choices=("gaussian", "kaiser-bessel", "pswf"),
    )
    support: int | None = key(
        "integer",
        "grid points under the window in each direction; null = as the tolerance asks",
        default=None,
        least=2,
        most=32,
        symbols=("p",),
    )


@dataclass(frozen=True, kw_only=True)
class Integrator:
    """Time stepping and its accuracy."""

    method: str = key(
        "choice",
        "bogacki-shampine (order 3) and tsitouras (order 5) control their error; rk4, rk2: fixed step only",
        default="bogacki-shampine",
        choices=("bogacki-shampine", "tsitouras", "rk4", "rk2"),
    )
    tolerance: float = key(
        "number",
        "position error (rms) per unit of strain that steps are chosen for; per radius that the spheres go (rms) in a "
        "fluid at rest, per ten radii where forces move them faster than ten radii per unit of strain; null = the "
        "run's tolerance",
        unit="radii/strain",
        default=None,
        least=1e-13,
        most=0.1,
    )
    step: float | None = key(
        "number",
        "fixed step instead of error control; null = error control",
        unit="strain",
        default=None,
        least=1e-12,
        most=1.0,
        symbols=("dt", "time_step", "timestep"),
    )
    max_step: float = key(
        "number",
        "largest step; in radii that the spheres go (rms) in a fluid at rest",
        unit="strain",
        default=0.1,
        above=0.0,
        most=10.0,
    )
    min_step: float = key(
        "number",
        "the run stops with an error where a smaller step is needed; measured as the tolerance is",
        unit="strain",
        default=1e-9,
        above=0.0,
    )
    max_evaluations: int | None = key(
        "integer", "velocity evaluations after which the run stops; null = no limit", default=None, least=1
    )


@dataclass(frozen=True, kw_only=True)
class Solver:
    """Iterative solves for the velocities."""

    tolerance: float = key(
        "number",
        "near-field solve: relative error of the velocities (energy norm); null = a hundredth of the run's"
        " tolerance",
        default=None,
        least=1e-14,
        most=0.1,
    )
    far_tolerance: float | None = key(
        "number",
        "coupled solve of near and far field: true residual, relative; null = the run's tolerance, or"
        " integrator.tolerance where that is smaller",
        default=None,
        least=1e-12,
        most=0.1,
        only=WITH_EWALD,
    )
    max_iterations: int = key(
        "integer", "the run stops with an error where more are needed", default=2000, least=1, most=10**7
    )


@dataclass(frozen=True, kw_only=True)
class Output:
    """What is stored, and how often."""

    samples_per_cycle: int = key(
        "integer",
        "stress samples per cycle; without oscillation, per block of about one unit of strain",
        default=64,
        least=1,
        most=100_000,
    )
    position_phases: tuple[float, ...] = key(
        "numbers",
        "where in the cycle positions are stored, in increasing order from 0.0, the cycle's start",
        unit="cycles",
        default=(0.0,),
        least=0.0,
        below=1.0,
    )
    particle_stress: bool = key(
        "switch", "store the stress of every sphere at every sample (large)", default=False
    )
    flow_driven: bool = key(
        "switch", "store apart the hydrodynamic stress driven by the flow alone", default=True
    )
