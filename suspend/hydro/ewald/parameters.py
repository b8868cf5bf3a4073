"""All parameters of the Ewald sum from one tolerance, by the predicted error and a measured cost.

The error asked for is the relative 2-norm of [U; Omega; E] for random unit loads. Most of it is given to the real
part left out beyond r_c, which kmax controls continuously (`suspend.hydro.ewald.truncation`); the grid, which
comes in steps, gets the rest (`suspend.hydro.ewald.windows.aliasing_error`). The cutoff r_c is free: it is chosen
where a product takes the least time.
"""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass
from typing import NamedTuple

from suspend.box import volume_fraction
from suspend.errors import ConfigurationError
from suspend.hydro.ewald.split import Split, make_split
from suspend.hydro.ewald.truncation import truncation_error
from suspend.hydro.ewald.windows import (
    LARGEST_SUPPORT,
    LOWEST_MODES,
    SELF_NORM2,
    TILT_STRETCH,
    Window,
    aliasing_error,
    choose_window,
    grid_of,
    largest_modes,
    matched_shape,
    smooth_sizes,
    wave_cost,
)

FINEST, COARSEST = 1e-10, 1e-2
TRUNCATION_SHARE, GRID_SHARE = 0.45, 0.25  # of the tolerance
SMALLEST_CUTOFF = 2.4  # radii; below, kmax r_c grows steeply
SURE_CUTOFF = 5.0  # radii; enough for any tolerance
RELATIVE_CUTOFF = 1.2  # largest r_c / L: beyond, few modes carry the error, which then depends on the tilt
FEW = 16  # spheres up to which r_c is as large as can be: few pairs at a shorter one carry the error
SMALL_CELL = 8  # spheres below which the truncation error scatters so much about its prediction that less is aimed at
QUICK = 1e-3  # s: a product that takes less is not worth looking for a cheaper one
SMALLEST_PRODUCT = 2.0  # least kmax r_c for which the error's prediction holds
OPTIMAL_GAIN = 0.85  # c of the optimal split over that of the prolate one at equal error
LOWEST_REACH = 1.1  # least kmax L/2pi: without any mode in the wave part the prediction means nothing

LARGEST_REACH = 1000.0  # kmax L/2pi beyond which a grid would take more memory than any machine has
MUCH_CHEAPER = 0.1  # a sum better than asked for is taken where it costs less than this share of the exact one
LARGEST_EDGE = 1e9  # radii; beyond, positions in double precision hold gaps to worse than 1e-7 radii

# Seconds on one core of an AMD EPYC (Zen 5), from `python benchmarks/bench_mobility.py --calibrate`
PER_PAIR, PER_SPHERE = 1.9e-8, 7e-8  # real part: product and a tenth of the assembly


@dataclass(frozen=True)
class EwaldParameters:
    """Parameters of one Ewald sum, with what they promise.

    split : kind, r_c, kmax and weight; grid : points along the lattice vectors; window : kind, support, shape
    truncation, aliasing : predicted relative errors; seconds : predicted time of a product on one core
    """

    split: Split
    grid: tuple[int, int, int]
    window: Window
    truncation: float
    aliasing: float
    seconds: float

    @property
    def error(self) -> float:
        """Predicted relative error of a product."""
        return math.hypot(self.truncation, self.aliasing)


def real_cost(number: int, edge: float, cutoff: float) -> float:
    """Time (s) of the real part of one product on one core of the machine the constants were measured on."""
    pairs = number * (number / edge**3) * (2.0 / 3.0) * math.pi * cutoff**3
    return PER_PAIR * pairs + PER_SPHERE * number


def predicted_seconds(number: int, edge: float, split: Split, grid, support: int) -> float:
    """Time (s) of one product on one core: the real part and `suspend.hydro.ewald.windows.wave_cost`."""
    return real_cost(number, edge, split.cutoff) + wave_cost(
        number, grid, largest_modes(split.kmax, edge), support
    )


def _norm_factor(number: int, edge: float) -> float:
    """|[U; Omega; E]| of random loads over that of lone spheres in an unbounded fluid.

    Own images lower it (Hasimoto 1959 for the force, 1 - phi of one sphere for torque and stresslet), long
    waves of the other spheres' forces dominate it in large cells.
    """
    volume = 4.0 * math.pi / 3.0 / edge**3
    force = 1.0 - 2.837297 / edge + volume
    own = 3.0 * force**2 + (SELF_NORM2 - 3.0) * (1.0 - volume) ** 2
    waves = 72.0 * LOWEST_MODES / (16.0 * math.pi**2) * (number - 1) / edge**2
    return math.sqrt((own + waves) / SELF_NORM2)


def _split_of(
    kind: str, cutoff: float, fraction: float, target: float, start: float, accuracy: float,
    least: float = SMALLEST_PRODUCT,
) -> tuple[Split, float]:
    """The split whose truncation error is `target` to the relative `accuracy`, and that error.

    Secant method in c = kmax r_c; the error is less than `target` where c = `least` does already.
    """

    def trial(c: float) -> tuple[Split, float]:
        kmax = c / cutoff
        shape = None
        if kind == "gaussian":
            shape, kmax = cutoff**2 / (2.0 * c), math.sqrt(c * c + 4.0 * c) / cutoff
        split = make_split(kind, cutoff, kmax, shape)
        return split, math.log(truncation_error(split, fraction) / target)

    c, slope = max(start, least), -1.1
    split, excess = trial(c)
    for _ in range(20):
        if abs(excess) < accuracy or (excess < 0.0 and c == least):
            break
        following = max(least, c + min(8.0, max(-8.0, -excess / slope)))
        split, new_excess = trial(following)
        slope = min(-0.3, max(-3.0, (new_excess - excess) / (following - c)))
        c, excess = following, new_excess
    else:
        raise ConfigurationError(
            f"far_field: no {kind} split with a truncation error of {target:.3g} at a cutoff of {cutoff:.3g} radii"
        )
    return split, target * math.exp(excess)


def _given_window(split, number, edge, kind, grid, support, target) -> tuple[tuple[int, int, int], Window]:
    """Grid and window where the grid, the support or both are given by hand: the least of the rest that will do.

    The last one tried if none will.
    """
    largest, reach = largest_modes(split.kmax, edge), split.kmax * edge / math.pi
    supports = range(3, LARGEST_SUPPORT + 1) if support is None else [support]
    if grid is None:
        least = max(2 * largest[0] + 1, support)
        grids = [grid_of(m, largest, support) for m in smooth_sizes(least, 2 * least + 20, True)]
    else:
        grids = [tuple(grid)]
    for points, size in itertools.product(grids, supports):
        window = Window(kind, size, matched_shape(kind, size, max(1.0, points[0] / reach)))
        if aliasing_error(split, edge, number, points, window) <= target:
            break
    return points, window


def _cutoffs(number: int, edge: float) -> list[float]:
    """Cutoffs r_c to choose from, radii, in the order of trial."""
    usual, largest = max(RELATIVE_CUTOFF * edge, SMALLEST_CUTOFF), max(RELATIVE_CUTOFF * edge, SURE_CUTOFF)
    steps = max(1, math.ceil(math.log(largest / SMALLEST_CUTOFF) / 0.15))
    cutoffs = [SMALLEST_CUTOFF * (largest / SMALLEST_CUTOFF) ** (n / steps) for n in range(steps + 1)]
    if number > FEW:
        return cutoffs
    return [usual, *(r for r in cutoffs[::-1] if r < usual), *(r for r in cutoffs if r > usual)]


class _Candidate(NamedTuple):
    """A cutoff r_c, about the c = kmax r_c it needs, the least c allowed there, predicted seconds a product."""

    cutoff: float
    product: float
    least: float
    seconds: float


def _choose_cutoff(kind, cutoffs, number, edge, tolerance, target) -> _Candidate:
    """The cheapest cutoff whose error is the one asked for, unless a more accurate sum is far cheaper.

    In a large cell the spheres hardly feel each other: any sum with a long r_c is then more accurate than asked
    for, and the error asked for would take the shortest r_c and a grid that resolves single spheres.
    """
    exact = _cheapest_cutoff(kind, cutoffs, number, edge, tolerance, target, False)
    if exact is not None and exact.seconds < QUICK:
        return exact
    better = _cheapest_cutoff(kind, cutoffs, number, edge, tolerance, target, True)
    found = [candidate for candidate in (exact, better) if candidate is not None]
    if not found:
        return _last_cutoff(kind, cutoffs[-1], number, edge, target)
    if exact is not None and better is not None and better.seconds > MUCH_CHEAPER * exact.seconds:
        return exact
    return found[-1]


def _last_cutoff(kind, cutoff: float, number: int, edge: float, target: float) -> _Candidate:
    """A cutoff that is no good choice but was given by hand; ConfigurationError where it cannot be used at all."""
    split, _ = _split_of(kind, cutoff, volume_fraction(number, edge), target, 10.0, 0.3)
    if split.kmax * edge > 2.0 * math.pi * LARGEST_REACH:
        raise ConfigurationError(
            f"far_field: a real-space cutoff of {cutoff:.3g} radii in a cell of edge {edge:.3g} radii needs a grid of "
            f"{split.kmax * edge / math.pi:.3g} points along an edge, more than fits into memory; leave out "
            "ewald.cutoff, or raise it"
        )
    return _Candidate(cutoff, split.kmax * cutoff, SMALLEST_PRODUCT, math.inf)


def _cheapest_cutoff(kind, cutoffs, number, edge, tolerance, target, better: bool) -> _Candidate | None:
    """The cutoff with the least predicted time; for few spheres the first that will do; None if none will.

    The prolate split, quick to make, stands for the optimal one, which needs OPTIMAL_GAIN of its c. better : c is
    kept so large that the wave part has modes, and an error below `target` is welcome.
    """
    gain, trial_kind = (OPTIMAL_GAIN, "pswf") if kind == "optimal" else (1.0, kind)
    fraction = volume_fraction(number, edge)
    support = round(2.5 + 1.1 * math.log10(1.0 / tolerance))
    best, c = None, 10.0 + 2.0 * math.log10(COARSEST / tolerance)
    for cutoff in cutoffs:
        least = SMALLEST_PRODUCT
        if better:
            least = max(least, 1.001 * LOWEST_REACH * 2.0 * math.pi * cutoff / (gain * edge))
        if least * edge / cutoff > 2.0 * math.pi * LARGEST_REACH:
            continue
        try:
            split, error = _split_of(trial_kind, cutoff, fraction, target, c, 0.3, least)
        except ConfigurationError:  # the weight would not be positive: too short a cutoff for this kind
            continue
        c, reach = split.kmax * cutoff, gain * split.kmax * edge / (2.0 * math.pi)
        if not LOWEST_REACH <= reach <= LARGEST_REACH or error > 1.4 * target or (error < 0.5 * target and not better):
            continue
        largest = (int(reach), int(TILT_STRETCH * reach), int(reach))
        size = smooth_sizes(max(support, math.ceil(2.5 * reach)), 10 + support + math.ceil(4.0 * reach), True)[0]
        seconds = real_cost(number, edge, cutoff)
        seconds += wave_cost(number, grid_of(size, largest, support), largest, support)
        if best is None or seconds < best.seconds:
            best = _Candidate(cutoff, gain * c, max(SMALLEST_PRODUCT, gain * least), seconds)
        if seconds > 1.5 * best.seconds or number <= FEW:
            break
    return best


def _check(tolerance: float, number: int, edge: float) -> None:
    if not FINEST <= tolerance <= COARSEST:
        raise ConfigurationError(
            f"far_field tolerance: {tolerance:g}; choose from {FINEST:g} to {COARSEST:g}: below, the round-off of "
            "double precision in sums over pairs and modes (about 1e-12) spoils the promise, above, no digit is right"
        )
    if int(number) != number or number < 1:
        raise ConfigurationError(f"far_field: {number} spheres; it must be an integer >= 1")
    if not (math.isfinite(edge) and edge >= 2.0):
        raise ConfigurationError(
            f"far_field: the cell's edge is {edge:g} radii, must be >= 2: a sphere would overlap its own image"
        )
    if edge > LARGEST_EDGE:
        raise ConfigurationError(
            f"far_field: the cell's edge is {edge:g} radii, must be <= {LARGEST_EDGE:g}: beyond, double precision does "
            "not resolve gaps between spheres; such a cell is an unbounded fluid, take far_field: self"
        )


def choose_parameters(
    tolerance: float,
    number: int,
    edge: float,
    *,
    split: str = "optimal",
    cutoff: float | None = None,
    grid: tuple[int, int, int] | None = None,
    window: str = "pswf",
    support: int | None = None,
) -> EwaldParameters:
    """Parameters of the Ewald sum of `number` spheres in a cell of edge `edge` (radii) for one tolerance.

    tolerance : relative 2-norm of the error of [U; Omega; E] for random unit loads, 1e-10 to 1e-2, at any tilt
    split : kind of the split; cutoff : r_c (radii); grid, support : points along the lattice vectors and under the
    window; window : its kind. What is None is chosen for the least time.

    Raises ConfigurationError for a tolerance or a cell out of range, or if what is given cannot meet the tolerance.
    """
    _check(tolerance, number, edge)
    factor = _norm_factor(number, edge)
    cutoffs = _cutoffs(number, edge) if cutoff is None else [cutoff]
    share = TRUNCATION_SHARE * min(1.0, (number / SMALL_CELL) ** 0.45)
    target = share * tolerance * factor
    best = _choose_cutoff(split, cutoffs, number, edge, tolerance, target)
    fraction = volume_fraction(number, edge)
    chosen, truncation = _split_of(split, best.cutoff, fraction, target, best.product, 0.05, best.least)
    target = GRID_SHARE * tolerance * min(1.0, factor)
    if grid is None and support is None:
        points, shape = choose_window(chosen, edge, target, number, window)
    else:
        points, shape = _given_window(chosen, number, edge, window, grid, support, target)
    aliasing = aliasing_error(chosen, edge, number, points, shape)
    if aliasing > tolerance:
        raise ConfigurationError(
            f"far_field grid: {points} points and a {window} window of {shape.support} points have an error of "
            f"{aliasing:.3g}, more than the tolerance {tolerance:g}; give more points or leave them out"
        )
    seconds = predicted_seconds(number, edge, chosen, points, shape.support)
    return EwaldParameters(chosen, points, shape, truncation / factor, aliasing, seconds)
