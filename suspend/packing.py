"""Random packings of equal hard spheres in a cubic periodic cell: the starting configurations of a run.

Random points are pushed apart until no two are closer than 2 + minimum_gap (radii), then moved by hard-sphere
Monte Carlo at that diameter until the configuration has forgotten how it was made: below the freezing point
until every sphere has travelled a diameter (an equilibrium fluid), above it for a limited number of sweeps, because
the equilibrium there is a crystal.
"""

from __future__ import annotations

import math
import time
from typing import NamedTuple

import numpy as np

from suspend.core.packing_kernels import metropolis, separate
from suspend.errors import ConfigurationError, NumericalError
from suspend.structure import bond_order, carnahan_starling, contact_value, smallest_distance

FREEZING = 0.494  # volume fraction of the hard-sphere fluid at coexistence (Hoover & Ree 1968)
DENSEST = 0.62  # random packings jam at 0.64; closer to it the spheres cannot be separated reliably
SOFTENING = 1e-3  # relative excess of the diameter at which overlaps are removed
ROUNDING = 1e-10  # relative excess of the diameter, so that no rounding brings a pair below it
BLOCK = 50  # sweeps between adjustments of the trial step
EQUILIBRIUM_SWEEPS = 20_000  # at most, below freezing
METASTABLE_SWEEPS = 500  # above freezing
CRYSTALLINE = 0.15  # share of crystalline spheres above which a configuration is refused
ATTEMPTS = 20  # independent starts
SEPARATION_STEPS = 20_000  # of the relaxation, per start


class Packing(NamedTuple):
    """A random packing (lengths in sphere radii) and the figures that show what it is."""

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
    sweeps: int  # Monte Carlo sweeps
    rms_travel: float  # rms displacement of a sphere by the Monte Carlo
    equilibrium: bool  # below freezing and every sphere has travelled a diameter (rms)
    attempts: int  # independent starts used
    seconds: float


def random_packing(
    number: int, volume_fraction: float, minimum_gap: float = 1e-3, seed: int = 1
) -> Packing:
    """Random hard-sphere configuration of `number` spheres at `volume_fraction`, all gaps >= minimum_gap (radii).

    L^3 = N (4/3) pi / phi. The same seed gives the same bits, whatever the number of threads. Valid for
    phi (1 + minimum_gap/2)^3 <= 0.62 and N >= 1. Raises ConfigurationError where the spheres cannot fit, NumericalError
    where no disordered arrangement was found.
    """
    started = time.perf_counter()
    length, diameter = _cell_and_diameter(number, volume_fraction, minimum_gap)
    effective = volume_fraction * (1.0 + 0.5 * minimum_gap) ** 3
    crystals = 0
    for attempt in range(ATTEMPTS):
        x = _separated(number, length, diameter, seed, attempt)
        if x is None:
            continue
        # A start that crystallised is begun again and stirred for half as long.
        x, sweeps, travel = _stirred(x, length, diameter, effective, (seed, attempt), 2**-crystals)
        order = bond_order(x, length, reach=1.4 * diameter)
        if number < 100 or order.crystal_fraction <= CRYSTALLINE:
            break
        crystals += 1
    else:
        raise NumericalError(_failure(number, volume_fraction, minimum_gap, crystals))
    gap = smallest_distance(x, length)[0] - 2.0
    contact = contact_value(x, length, diameter=diameter)
    return Packing(
        positions=x,
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
        sweeps=sweeps,
        rms_travel=travel,
        equilibrium=effective <= FREEZING and travel >= diameter,
        attempts=attempt + 1,
        seconds=time.perf_counter() - started,
    )


def _cell_and_diameter(number: int, volume_fraction: float, minimum_gap: float) -> tuple[float, float]:
    """Edge of the cell and diameter of the spheres with their gap; ConfigurationError where they cannot fit."""
    if int(number) != number or number < 1:
        raise ConfigurationError(f"random packing: number of spheres is {number}, must be an integer >= 1")
    if not 0.0 < volume_fraction < 1.0:
        raise ConfigurationError(f"random packing: volume fraction is {volume_fraction}, must be in (0, 0.62]")
    if not (minimum_gap >= 0.0 and math.isfinite(minimum_gap)):
        raise ConfigurationError(f"random packing: minimum gap is {minimum_gap} radii, must be >= 0")
    effective = volume_fraction * (1.0 + 0.5 * minimum_gap) ** 3
    if effective > DENSEST:
        raise ConfigurationError(
            f"random packing: {number} spheres at volume fraction {volume_fraction:g} with gaps >= {minimum_gap:g} "
            f"radii fill {effective:.4f} of the cell, more than the {DENSEST} that random packings reach; lower "
            "particles.volume_fraction or particles.minimum_gap, or read the configuration from a file"
        )
    length = (number * 4.0 * math.pi / (3.0 * volume_fraction)) ** (1.0 / 3.0)
    if length < (2.0 + minimum_gap) * (1.0 + ROUNDING):
        raise ConfigurationError(
            f"random packing: the cell's edge is {length:.4f} radii, so that a sphere touches its own image; "
            f"{number} spheres with gaps >= {minimum_gap:g} radii need a lower particles.volume_fraction or more spheres"
        )
    return length, 2.0 + minimum_gap


def _separated(number: int, length: float, diameter: float, seed: int, attempt: int) -> np.ndarray | None:
    """Random points pushed apart to distances >= diameter, in spatial order; None if they jammed."""
    x = np.random.default_rng([seed, attempt]).random((number, 3)) * length
    hard = diameter * (1.0 + ROUNDING)
    x = x[spatial_order(x, length)]
    steps = separate(x, length, hard, min(diameter * (1.0 + SOFTENING), length), SEPARATION_STEPS)
    return x[spatial_order(x, length)] if steps >= 0 else None


def _stirred(
    x: np.ndarray, length: float, diameter: float, effective: float, stream: tuple[int, int], share: float
) -> tuple[np.ndarray, int, float]:
    """Hard-sphere Monte Carlo from `x`; returns the positions in spatial order, the sweeps and the rms travel."""
    state = np.random.SeedSequence([*stream, 1]).generate_state(1, np.uint64)
    travel = np.zeros_like(x)
    limit = EQUILIBRIUM_SWEEPS if effective <= FREEZING else int(share * METASTABLE_SWEEPS)
    step, sweeps, rms = 0.1, 0, 0.0
    while sweeps < limit and (rms < diameter or effective > FREEZING):
        block = min(BLOCK, limit - sweeps)
        accepted = metropolis(x, travel, length, diameter * (1.0 + ROUNDING), step, block, state)
        sweeps += block
        # Towards 30 % acceptance, which moves dense hard spheres fastest.
        step = min(step * min(1.5, max(0.5, (accepted + 0.05) / 0.35)), 0.5 * length)
        rms = math.sqrt(np.mean(np.sum(travel**2, axis=1)))
    return np.ascontiguousarray(x[spatial_order(x, length)]), sweeps, rms


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
        f"random packing: no disordered arrangement of {number} spheres at volume fraction {volume_fraction:g} with "
        f"gaps >= {minimum_gap:g} radii in {ATTEMPTS} starts ({what}); use more spheres, a lower "
        "particles.volume_fraction or particles.minimum_gap, or read the configuration from a file"
    )
