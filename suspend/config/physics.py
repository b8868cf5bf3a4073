"""Keys of what is simulated: spheres, fluid, flow, and the forces on spheres besides the far field's."""

from __future__ import annotations

import math
from dataclasses import dataclass

from suspend.config.keys import Only, key

CLOSE_PACKING = math.pi / math.sqrt(18.0)  # densest packing of equal spheres
DENSEST_RANDOM = 0.60  # `suspend.packing` makes random configurations up to here
PACKED = ("equilibrium", "quenched")  # what it makes, as particles.initial calls it
FORMERLY = "random"  # name of the first, still read
LARGEST_CUTOFF = 8.0  # the tabulated two-sphere functions end at this centre distance, radii
SCALE = {"least": 1e-30, "most": 1e30}  # of units: products of their powers stay within floating-point range

OSCILLATORY = Only("type", ("oscillatory",))
AT_A_RATE = Only("type", ("steady", "reversal", "quiescent"))
REVERSAL = Only("type", ("reversal",))


@dataclass(frozen=True, kw_only=True)
class Particles:
    """The spheres and their starting configuration."""

    number: int = key(
        "integer", "number of spheres N", least=1, most=10_000_000, example=500, symbols=("n", "np")
    )
    volume_fraction: float = key(
        "number",
        f"volume fraction phi; at most {DENSEST_RANDOM:g} where initial is {' or '.join(PACKED)}",
        above=0.0,
        most=CLOSE_PACKING,
        example=0.4,
        symbols=("phi",),
    )
    radius: float = key("number", "sphere radius a", unit="length", default=1.0, symbols=("a",), **SCALE)
    initial: str = key(
        "text",
        "start: equilibrium (a stirred fluid of hard spheres; a glass above freezing, phi = 0.494; also read as"
        " random), quenched (random points whose overlapping pairs are pushed apart, unstirred: the paper's), both"
        " made from the seed, or a file (.gsd, .xyz, .npz, .h5) or run folder, relative to the folder of this file",
        default=PACKED[0],
        former=((FORMERLY, PACKED[0]),),
        symbols=("configuration", "positions"),
    )
    frame: int | None = key(
        "integer",
        "frame of that file; -1 is the last",
        default=-1,
        only=Only("initial", PACKED, negated=True),
    )
    minimum_gap: float | None = key(
        "number",
        "smallest surface gap of the packing made",
        unit="radii",
        default=1e-3,
        above=0.0,
        most=1.0,
        only=Only("initial", PACKED),
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
    until_steady: float | None = key(
        "number",
        "oscillatory: end before that, after the first cycle at which the steady state is established: over the last"
        " half of the cycles, at least 16, eta_r' and eta_r'' are shown (95 %) to change by less than this times eta_r'"
        " and ln D_cyc by less than 10 times this, or spheres would diffuse by less than this many radii over as much"
        " strain again; 0.02 is usual; null = run for the whole duration",
        unit="relative",
        default=None,
        least=1e-6,
        most=0.5,
        symbols=("steady", "stop_when_steady", "steady_state"),
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
