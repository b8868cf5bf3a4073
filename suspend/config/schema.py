# ruff: noqa: RUF009 (the defaults are dataclasses.field objects)
"""Every key of the configuration, once: name, type, default, unit, allowed values, meaning.

Objects of these classes are made by `load`, `loads` and `from_dict`, which validate; the classes do not. Keys
that have no meaning in a configuration (an amplitude in steady shear) are None in it.
"""

from __future__ import annotations

import dataclasses
import math
from dataclasses import dataclass
from typing import Any

from suspend.config.keys import Only, key, keys_of, section, sections_of

CLOSE_PACKING = math.pi / math.sqrt(18.0)  # densest packing of equal spheres
DENSEST_RANDOM = 0.60  # `suspend.packing` makes random configurations up to here
LARGEST_CUTOFF = 8.0  # the tabulated two-sphere functions end at this centre distance, radii
SCALE = {"least": 1e-30, "most": 1e30}  # of units: products of their powers stay within floating-point range

OSCILLATORY = Only("type", ("oscillatory",))
AT_A_RATE = Only("type", ("steady", "reversal", "quiescent"))
REVERSAL = Only("type", ("reversal",))
WITH_EWALD = Only("far_field", ("ewald",), top=True)
FINEST, COARSEST = 1e-10, 1e-2  # tolerances: round-off of the Ewald sum; beyond, no digit is right
NEAR_SHARE = 1e-2  # of the run's tolerance: that of the near-field velocity solve


@dataclass(frozen=True, kw_only=True)
class Particles:
    """The spheres and their starting configuration."""

    number: int = key(
        "integer", "number of spheres N", least=1, most=10_000_000, example=500, symbols=("n", "np")
    )
    volume_fraction: float = key(
        "number",
        f"volume fraction phi; at most {DENSEST_RANDOM:g} where initial is random",
        above=0.0,
        most=CLOSE_PACKING,
        example=0.4,
        symbols=("phi",),
    )
    radius: float = key("number", "sphere radius a", unit="length", default=1.0, symbols=("a",), **SCALE)
    initial: str = key(
        "text",
        "start: random (a hard-sphere packing made from the seed), or a file (.gsd, .xyz, .npz, .h5) or run"
        " folder, relative to the folder of this file",
        default="random",
        symbols=("configuration", "positions"),
    )
    frame: int | None = key(
        "integer",
        "frame of that file; -1 is the last",
        default=-1,
        only=Only("initial", ("random",), negated=True),
    )
    minimum_gap: float | None = key(
        "number",
        "smallest surface gap of the random packing",
        unit="radii",
        default=1e-3,
        above=0.0,
        most=1.0,
        only=Only("initial", ("random",)),
    )


@dataclass(frozen=True, kw_only=True)
class Fluid:
    """The suspending fluid."""

    viscosity: float = key(
        "number", "viscosity eta0", unit="viscosity", default=1.0, symbols=("eta", "eta0"), **SCALE
    )


@dataclass(frozen=True, kw_only=True)
class Flow:
    """Undisturbed flow u = gdot(t) y e_x. `omega` is resolved; `frequency` is None once it is."""

    type: str = key(
        "choice",
        "oscillatory: gamma = gamma0 sin(omega t + phase); steady; reversal: steady until reversal_strain,"
        " then backwards; quiescent: no flow",
        choices=("oscillatory", "steady", "reversal", "quiescent"),
        example="oscillatory",
        symbols=("protocol", "mode"),
    )
    amplitude: float | None = key(
        "number",
        "strain amplitude gamma0",
        unit="strain",
        least=1e-8,
        most=1e4,
        only=OSCILLATORY,
        example=0.8,
        symbols=("gamma0", "gamma_0", "strain_amplitude"),
    )
    omega: float | None = key(
        "number",
        "angular frequency omega = 2 pi frequency",
        unit="radians/time",
        default=1.0,
        only=OSCILLATORY,
        group="omega | frequency",
        symbols=("angular_frequency", "w"),
        **SCALE,
    )
    frequency: float | None = key(
        "number",
        "cycles per unit of time, instead of omega",
        unit="1/time",
        default=None,
        only=OSCILLATORY,
        group="omega | frequency",
        example=0.159155,
        symbols=("f", "freq"),
        **SCALE,
    )
    phase: float | None = key(
        "number",
        "initial phase; the strain at t = 0 is gamma0 sin(phase)",
        unit="radians",
        default=0.0,
        least=-2.0 * math.pi,
        most=2.0 * math.pi,
        only=OSCILLATORY,
    )
    rate: float | None = key(
        "number",
        "shear rate; for quiescent the reference rate that sets the unit of force",
        unit="1/time",
        default=1.0,
        only=AT_A_RATE,
        symbols=("shear_rate", "gdot"),
        **SCALE,
    )
    reversal_strain: float | None = key(
        "number",
        "strain of the pre-shear, after which the rate changes sign",
        unit="strain",
        above=0.0,
        most=1e9,
        only=REVERSAL,
        example=10.0,
    )


@dataclass(frozen=True, kw_only=True)
class Duration:
    """Length of the run; cycles or strain is None."""

    cycles: int | None = key(
        "integer",
        "whole cycles of oscillatory flow",
        unit="cycles",
        default=None,
        least=1,
        most=10**9,
        group="cycles | strain",
        example=80,
        symbols=("n_cyc", "n_cycles"),
    )
    strain: float | None = key(
        "number",
        "total strain; oscillatory: rounded up to whole cycles (4 gamma0); quiescent: time x rate",
        unit="strain",
        default=None,
        above=0.0,
        most=1e9,
        group="cycles | strain",
        example=256.0,
        symbols=("gamma_tot", "total_strain", "time"),
    )


@dataclass(frozen=True, kw_only=True)
class Ewald:
    """The Ewald sum of the far field; what is None is chosen from the tolerance and a cost model."""

    tolerance: float = key(
        "number",
        "relative error of a mobility product (2-norm, random loads); null = the run's tolerance; below 1e-10"
        " is round-off",
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
class Lubrication:
    """Near-field hydrodynamic interactions of pairs."""

    enabled: bool = key("switch", "whether pairs interact hydrodynamically", default=True)
    cutoff: float = key(
        "number",
        "centre distance up to which they do",
        unit="radii",
        default=4.0,
        above=2.0,
        most=LARGEST_CUTOFF,
    )
    at_cutoff: str = key(
        "choice",
        "at the cutoff the functions are shifted to zero, end there (hard), or are tapered smoothly to zero",
        default="shifted",
        choices=("shifted", "hard", "tapered"),
    )
    minimum_gap: float = key(
        "number", "gap below which the functions are frozen; 0 = never", unit="radii", default=0.0, least=0.0
    )


@dataclass(frozen=True, kw_only=True)
class Repulsion:
    """Pair force F0 exp(-(h - gap_shift)/debye_length), h the surface gap."""

    force: float = key(
        "number",
        "strength F0 of F0 exp(-kappa h), h the surface gap",
        unit="F_stk",
        default=10.0,
        least=0.0,
        most=1e12,
        symbols=("f0", "f_0", "strength"),
    )
    debye_length: float = key(
        "number",
        "decay length 1/kappa",
        unit="radii",
        default=0.01,
        least=1e-8,
        most=10.0,
        symbols=("kappa", "debye", "screening_length"),
    )
    gap_shift: float = key(
        "number", "the force is evaluated at h - gap_shift", unit="radii", default=0.0, least=0.0, most=1.0
    )
    cutoff: float | None = key(
        "number",
        "range beyond gap_shift; null = where the force is negligible",
        unit="Debye lengths",
        default=None,
        above=0.0,
        most=1e6,
    )


@dataclass(frozen=True, kw_only=True)
class Contact:
    """Linear spring stiffness (gap_shift - h) for h < gap_shift."""

    stiffness: float = key(
        "number",
        "spring constant of the force on spheres in contact",
        unit="F_stk/radius",
        above=0.0,
        most=1e12,
        example=1e4,
        symbols=("k", "spring"),
    )
    gap_shift: float = key(
        "number", "gap at which contact begins", unit="radii", default=0.0, least=0.0, most=1.0
    )


@dataclass(frozen=True, kw_only=True)
class External:
    """The same force and torque on every sphere."""

    force: tuple[float, float, float] = key(
        "numbers",
        "force on every sphere (x, y, z)",
        unit="F_stk",
        default=(0.0, 0.0, 0.0),
        length=3,
        least=-1e12,
        most=1e12,
        symbols=("gravity",),
    )
    torque: tuple[float, float, float] = key(
        "numbers",
        "torque on every sphere (x, y, z)",
        unit="F_stk a",
        default=(0.0, 0.0, 0.0),
        length=3,
        least=-1e12,
        most=1e12,
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
        "position error (rms) per unit of strain that steps are chosen for; null = the run's tolerance",
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
    max_step: float = key("number", "largest step", unit="strain", default=0.1, above=0.0, most=10.0)
    min_step: float = key(
        "number",
        "the run stops with an error where a smaller step is needed",
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
        "coupled solve of near and far field: true residual, relative; null = the run's tolerance",
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


@dataclass(frozen=True, kw_only=True)
class Config:
    """A complete, validated configuration. Made by `load`, `loads` or `from_dict`.

    `directory` is the folder that `particles.initial` is relative to: no key, and not compared.
    """

    seed: int = key("integer", "seed of everything random", default=1, least=0, most=2**63 - 1)
    particles: Particles = section(Particles, "spheres and their starting configuration")
    fluid: Fluid = section(Fluid, "suspending fluid")
    flow: Flow = section(Flow, "undisturbed flow u = gdot(t) y e_x (x flow, y gradient, z vorticity)")
    duration: Duration = section(Duration, "length of the run")
    tolerance: float = key(
        "number",
        "accuracy of the run; integrator.tolerance, solver.tolerance, solver.far_tolerance and"
        " ewald.tolerance follow from it unless they are given",
        default=1e-3,
        least=FINEST,
        most=COARSEST,
        symbols=("accuracy", "precision"),
    )
    far_field: str = key(
        "choice",
        "ewald: many-body, by an Ewald sum; self: every sphere's own drag and stresslet; identity: the same"
        " with the factors of the authors' code (rotational drag 3/4 and stresslet 9/5 of the right ones)",
        default="self",
        choices=("ewald", "self", "identity"),
    )
    ewald: Ewald | None = section(
        Ewald, "Ewald sum of the far field; all follows from the tolerance", optional=True, only=WITH_EWALD
    )
    lubrication: Lubrication = section(Lubrication, "near-field hydrodynamic interactions of pairs")
    repulsion: Repulsion | None = section(
        Repulsion, "repulsion F0 exp(-(h - gap_shift)/debye_length) of pairs; h surface gap", optional=True
    )
    contact: Contact | None = section(
        Contact, "spring stiffness (gap_shift - h) for h < gap_shift", optional=True
    )
    external: External | None = section(
        External, "force and torque on every sphere, gravity for one", optional=True
    )
    integrator: Integrator = section(Integrator, "time stepping")
    solver: Solver = section(Solver, "iterative solves for the velocities")
    output: Output = section(Output, "what is stored")
    directory: str = dataclasses.field(default=".", compare=False)

    def to_dict(self) -> dict[str, Any]:
        """The keys that apply, as nested dicts of plain values; `from_dict` makes the same of them."""
        result: dict[str, Any] = {}
        for field in dataclasses.fields(self):
            value = getattr(self, field.name)
            if "key" in field.metadata:
                result[field.name] = value
            elif "section" in field.metadata:
                result[field.name] = None if value is None else _plain(value, self)
        return result

    def to_yaml(self) -> str:
        """The resolved configuration, every key that applies, as YAML; `loads` makes the same of it."""
        from suspend.config.render import to_yaml

        return to_yaml(self.to_dict())


def _plain(values: Any, config: Config) -> dict[str, Any]:
    result = {}
    for name, info in keys_of(type(values)).items():
        value = getattr(values, name)
        deciding = config if info.only is not None and info.only.top else values
        missing = info.only is not None and not info.only.holds(getattr(deciding, info.only.key))
        if missing or (info.group is not None and value is None):
            continue
        result[name] = list(value) if isinstance(value, tuple) else value
    return result


def every_key() -> dict[str, tuple]:
    """All keys of the configuration by dotted name."""
    found = dict(keys_of(Config))
    for name, part in sections_of(Config).items():
        found.update({f"{name}.{inner}": info for inner, info in keys_of(part.cls).items()})
    return found
