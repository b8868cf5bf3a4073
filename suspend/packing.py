"""Packings of equal hard spheres in a cubic periodic cell: the starting configurations of a run, of two kinds.

equilibrium (`random_packing`): random points are moved apart until no two are closer than the diameter
2 + minimum_gap (radii); hard-sphere Monte Carlo stirs them until every sphere has travelled a diameter and the longest
density wave of the cell has decayed: an equilibrium fluid. Above the freezing point, where the equilibrium is a
crystal, the fluid at freezing is compressed in small steps instead, each followed by a limited number of sweeps: a
glass that is disordered and has forgotten the random points.

quenched (`quenched_packing`): the spheres of every overlapping pair are pushed apart by half the overlap each, again
and again, and nothing is stirred. Neighbours nearly touch, and long density waves keep much of the scatter of the
random points: far from equilibrium.
"""

from __future__ import annotations

import math
import time
from typing import NamedTuple

import numpy as np

from suspend.box import edge_length
from suspend.core.packing_kernels import metropolis, push_apart, separate
from suspend.errors import ConfigurationError, NumericalError
from suspend.fluctuations import FREEZING, needed_travel
from suspend.structure import bond_order, carnahan_starling, contact_value, smallest_distance

DENSEST = 0.62  # random packings jam at 0.64; closer to it the spheres cannot be separated reliably
SOFTENING = 1e-3  # relative excess of the diameter at which overlaps are removed
ROUNDING = 1e-10  # relative excess of the diameter, so that no rounding brings a pair below it
BLOCK = 50  # sweeps between adjustments of the trial step
STIRRING_SWEEPS = 100_000  # at most, in the fluid
STIRRING_MOVES = 5 * 10**8  # at most, in the fluid: fewer sweeps for very many spheres
LONG_WAVE_MOVES = 25 * 10**7  # at most, where spheres have travelled a diameter and only long waves have not decayed
COMPRESSION_STEP = 0.005  # in volume fraction, above freezing
COMPRESSION_SWEEPS = 300  # after each of these steps
CRYSTALLINE = 0.15  # share of crystalline spheres above which a configuration is refused
JUDGED = 100  # spheres from which on a share of crystalline ones says something
ATTEMPTS = 20  # independent starts
DECAY = 2.0  # exponents by which the longest wave decays in the fluid: its excess in S falls to 2 %
QUENCH_MARGIN = 5e-4  # relative excess of the diameter at which pairs are pushed apart
QUENCH_SWEEPS = 1000  # at most; what is left is separated by relaxation
QUENCH_BLOCK = 50  # sweeps between looks at signals
SEPARATION_STEPS = 20_000  # of the relaxation, per start


class Packing(NamedTuple):
    """A random packing (lengths in sphere radii) and the figures that show what it is."""

    kind: str  # "equilibrium" or "quenched"
    positions: np.ndarray  # (N,3), in [0, L), neighbours in space near in order
    length: float  # edge L of the cubic cell
    volume_fraction: float
    effective_volume_fraction: float  # at the diameter 2 + minimum_gap
    minimum_gap: float  # smallest surface gap found, own images included
    contact_value: float  # g(r) at 2 + minimum_gap of this configuration; NaN where too few pairs
    contact_error: float  # its standard error
    equilibrium_contact_value: float  # Carnahan & Starling at the effective volume fraction
    global_q6: float
    local_q6: float
    crystal_fraction: float
    sweeps: int  # of the Monte Carlo, or of pushing pairs apart
    relaxation_steps: int  # of a quench, beyond its sweeps
    rms_travel: float  # rms displacement of a sphere by the Monte Carlo
    needed_travel: float  # of the fluid, for the longest wave of the cell to decay
    equilibrium: bool  # below freezing and every sphere has travelled a diameter (rms)
    long_waves: bool  # stirred until the longest wave had decayed (a glass: as the fluid it was compressed from)
    attempts: int  # independent starts used
    seconds: float


def random_packing(number: int, volume_fraction: float, minimum_gap: float = 1e-3, seed: int = 1) -> Packing:
    """Stirred hard spheres, `number` of them at `volume_fraction`, all surface gaps >= minimum_gap (radii).

    An equilibrium fluid, above freezing a glass. Stirring for long waves ends after 2.5e8 trial moves, for very many
    spheres before they have decayed (`long_waves` is False then): beyond about N = 28,000 at phi = 0.4, 11,000 at 0.1
    and 14,000 at 0.49. L^3 = N (4/3) pi / phi. The same seed gives the same bits, whatever the number of threads. Valid
    for phi (1 + minimum_gap/2)^3 <= 0.62 and N >= 1. Raises ConfigurationError where the spheres cannot fit,
    NumericalError where no disordered arrangement was found.
    """
    return _packing("equilibrium", number, volume_fraction, minimum_gap, seed)


def quenched_packing(number: int, volume_fraction: float, minimum_gap: float = 1e-3, seed: int = 1) -> Packing:
    """Random points pushed apart, not stirred: `number` spheres, all surface gaps >= minimum_gap (radii).

    The spheres of every pair closer than (2 + minimum_gap)(1 + 5e-4) move apart by half the overlap each, all pairs at
    once, until no pair is closer than 2 + minimum_gap. The margin of 5e-4 is a choice: without it the sweeps never
    end. It sets how nearly neighbours touch (median nearest distance at minimum_gap 1e-3, N = 500, phi = 0.4:
    2.0010, 2.0012, 2.0020 and 2.0030 at margins of 1e-5, 1e-4, 5e-4 and 1e-3) and how many sweeps it takes (91 to
    147, 69 to 111, 55 to 87, 49 to 77 over 20 seeds). S of the smallest waves and the exponent of the number
    variance do not feel it: 0.755 and 3.22 in the mean for all four, to 0.003 (from seed to seed they scatter by
    0.39 and 0.20). Up to phi about 0.58 sweeps alone separate all; what 1000 of them have not separated, a
    relaxation of the overlap energy finishes (at phi = 0.6, where sweeps alone would take 1300 at N = 500 and 1800
    at N = 100,000).

    L^3, seed, range and errors as for `random_packing`, which starts from the same points.
    """
    return _packing("quenched", number, volume_fraction, minimum_gap, seed)


PACKINGS = {"equilibrium": random_packing, "quenched": quenched_packing}


class _Made(NamedTuple):
    """Positions (N,3) of one attempt, and how they came about (see `Packing`)."""

    positions: np.ndarray
    sweeps: int
    relaxation_steps: int
    rms_travel: float


def _packing(kind: str, number: int, volume_fraction: float, minimum_gap: float, seed: int) -> Packing:
    started = time.perf_counter()
    length, diameter = _cell_and_diameter(number, volume_fraction, minimum_gap, seed)
    effective = _effective(volume_fraction, minimum_gap)
    crystals = 0
    for attempt in range(ATTEMPTS):
        points = np.random.default_rng([seed, attempt]).random((number, 3)) * length
        if number == 1:
            made = _Made(points, 0, 0, 0.0)  # wherever it lies, it is at equilibrium
        elif kind == "quenched":
            made = _quench(points, length, diameter)
        else:
            # After a start that crystallised the next one is compressed twice as fast.
            stirring = _Stirring(points, length, [seed, attempt, 1])
            made = stirring.prepare(diameter, effective, COMPRESSION_SWEEPS >> crystals)
        if made is None:
            continue
        order = bond_order(made.positions, length, reach=1.4 * diameter)
        if number < JUDGED or order.crystal_fraction <= CRYSTALLINE:
            break
        crystals += 1
    else:
        raise NumericalError(_failure(number, volume_fraction, minimum_gap, crystals))
    gap = smallest_distance(made.positions, length)[0] - 2.0
    if gap < minimum_gap:  # found apart from the kernels, by another search
        raise NumericalError(f"random packing: the smallest gap is {gap:.17g} radii, below {minimum_gap:g}")
    contact = contact_value(made.positions, length, diameter=diameter)
    needed = needed_travel(min(effective, FREEZING), length, DECAY)
    stirred = kind == "equilibrium"
    return Packing(
        kind=kind,
        **made._asdict(),
        length=length,
        volume_fraction=volume_fraction,
        effective_volume_fraction=effective,
        minimum_gap=gap,
        contact_value=contact.value,
        contact_error=contact.error,
        equilibrium_contact_value=carnahan_starling(effective),
        global_q6=order.global_q6,
        local_q6=order.local_q6,
        crystal_fraction=order.crystal_fraction,
        needed_travel=needed,
        equilibrium=stirred and effective <= FREEZING and (number == 1 or made.rms_travel >= diameter),
        long_waves=stirred and (number == 1 or made.rms_travel >= needed),
        attempts=attempt + 1,
        seconds=time.perf_counter() - started,
    )


def _quench(points: np.ndarray, length: float, diameter: float) -> _Made | None:
    """Push the points (N,3) apart by sweeps, then by relaxation; None if they jam."""
    x = _ordered(points, length)
    hard = diameter * (1.0 + ROUNDING)
    soft = min(diameter * (1.0 + QUENCH_MARGIN), length)
    for done in range(0, QUENCH_SWEEPS, QUENCH_BLOCK):
        sweeps = push_apart(x, length, hard, soft, QUENCH_BLOCK)
        if sweeps >= 0:
            return _Made(_ordered(x, length), done + sweeps, 0, 0.0)
    steps = separate(x, length, hard, soft, SEPARATION_STEPS)
    return _Made(_ordered(x, length), QUENCH_SWEEPS, steps, 0.0) if steps >= 0 else None


def _effective(volume_fraction: float, minimum_gap: float) -> float:
    """Volume fraction of spheres of the diameter 2 + minimum_gap."""
    return volume_fraction * (1.0 + 0.5 * minimum_gap) ** 3


class _Stirring:
    """One start: positions, random stream and Monte Carlo figures, from random points to the packing."""

    def __init__(self, points: np.ndarray, length: float, entropy: list[int]):
        self.length = length
        self.positions = points
        self.travel = np.zeros_like(points)
        self.sweeps = 0
        self._state = np.random.SeedSequence(entropy).generate_state(1, np.uint64)
        self._step = 0.1  # half edge of the cube of trial moves

    def prepare(self, diameter: float, effective: float, compression_sweeps: int) -> _Made | None:
        """Bring the points to a packing at `diameter` (volume fraction `effective`); None if they jam."""
        stages = max(0, math.ceil((effective - FREEZING) / COMPRESSION_STEP - 1e-9))
        fluid = diameter * (min(effective, FREEZING) / effective) ** (1.0 / 3.0)
        if not self._separate(fluid):
            return None
        limit = min(STIRRING_SWEEPS, STIRRING_MOVES // len(self.positions))
        target = needed_travel(min(effective, FREEZING), self.length, DECAY)
        for travel, most in ((fluid, limit), (target, min(limit, LONG_WAVE_MOVES // len(self.positions)))):
            while self.sweeps < most and self.rms_travel() < travel:
                self._stir(fluid, BLOCK)
        for stage in range(1, stages + 1):
            larger = fluid + (diameter - fluid) * (stage / stages)
            if not self._separate(larger):
                return None
            for _ in range(0, compression_sweeps, BLOCK):
                self._stir(larger, BLOCK)
        self._sort()
        return _Made(self.positions, self.sweeps, 0, self.rms_travel())

    def rms_travel(self) -> float:
        """Root mean square displacement of a sphere by the Monte Carlo so far."""
        return math.sqrt(np.mean(np.sum(self.travel**2, axis=1)))

    def _sort(self) -> None:
        order = spatial_order(self.positions, self.length)
        self.positions = np.ascontiguousarray(self.positions[order])
        self.travel = np.ascontiguousarray(self.travel[order])

    def _separate(self, diameter: float) -> bool:
        self._sort()  # neighbours in memory make both kernels faster
        soft = min(diameter * (1.0 + SOFTENING), self.length)
        hard = diameter * (1.0 + ROUNDING)
        return separate(self.positions, self.length, hard, soft, SEPARATION_STEPS) >= 0

    def _stir(self, diameter: float, sweeps: int) -> None:
        hard = diameter * (1.0 + ROUNDING)
        accepted = metropolis(self.positions, self.travel, self.length, hard, self._step, sweeps, self._state)
        self.sweeps += sweeps
        # Towards 30 % acceptance, which moves dense hard spheres fastest.
        self._step = min(self._step * min(1.5, max(0.5, (accepted + 0.05) / 0.35)), 0.5 * self.length)


def _cell_and_diameter(
    number: int, volume_fraction: float, minimum_gap: float, seed: int
) -> tuple[float, float]:
    """Edge of the cell, diameter of the spheres with their gap; ConfigurationError if they cannot fit."""
    if int(number) != number or number < 1:
        raise ConfigurationError(f"random packing: number of spheres is {number}, must be an integer >= 1")
    if not 0.0 < volume_fraction < 1.0:
        raise ConfigurationError(
            f"random packing: volume fraction is {volume_fraction}, must be > 0 and <= {DENSEST}"
        )
    if not (minimum_gap >= 0.0 and math.isfinite(minimum_gap)):
        raise ConfigurationError(f"random packing: minimum gap is {minimum_gap} radii, must be >= 0")
    if int(seed) != seed or seed < 0:
        raise ConfigurationError(f"random packing: seed is {seed}, must be an integer >= 0")
    effective = _effective(volume_fraction, minimum_gap)
    if effective > DENSEST:
        raise ConfigurationError(
            f"random packing: {number} spheres at volume fraction {volume_fraction:g} with gaps >= "
            f"{minimum_gap:g} radii fill {effective:.4f} of the cell, more than the {DENSEST} that random "
            "packings reach; lower particles.volume_fraction or particles.minimum_gap, or read the "
            "configuration from a file"
        )
    length = edge_length(number, volume_fraction)
    if length < (2.0 + minimum_gap) * (1.0 + ROUNDING):
        raise ConfigurationError(
            f"random packing: the cell's edge is {length:.4f} radii, so that a sphere would touch its own "
            f"image; N = {number} with gaps >= {minimum_gap:g} radii needs a lower particles.volume_fraction "
            "or more spheres"
        )
    return length, 2.0 + minimum_gap


def _ordered(positions: np.ndarray, length: float) -> np.ndarray:
    return np.ascontiguousarray(positions[spatial_order(positions, length)])


def spatial_order(positions: np.ndarray, length: float) -> np.ndarray:
    """Permutation (N,) that puts wrapped positions (N,3) in Morton order of cells of about two radii.

    Neighbours in space become neighbours in memory (Morton 1966); ties keep their order.
    """
    bits = max(1, math.ceil(math.log2(max(length / 2.0, 1.0))))
    cells = np.minimum((positions * (2**bits / length)).astype(np.int64), 2**bits - 1)
    key = np.zeros(len(positions), np.int64)
    for bit in range(bits):
        for axis in range(3):
            key |= ((cells[:, axis] >> bit) & 1) << (3 * bit + axis)
    return np.argsort(key, kind="stable")


def _failure(number: int, volume_fraction: float, minimum_gap: float, crystals: int) -> str:
    """The message when every start jammed or crystallised."""
    what = f"{crystals} crystallised and {ATTEMPTS - crystals} jammed"
    return (
        f"random packing: no disordered arrangement of {number} spheres at volume fraction "
        f"{volume_fraction:g} with gaps >= {minimum_gap:g} radii in {ATTEMPTS} starts ({what}); use more "
        "spheres, a lower particles.volume_fraction or particles.minimum_gap, or read the configuration "
        "from a file"
    )
