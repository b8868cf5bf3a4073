"""The bound on gamma_c with the scatter over seeds in it, and the amplitudes that would narrow it.

Each signature gives a range of amplitudes. An extremum lies above every amplitude from which the values are shown to
rise towards it and below every one towards which they are shown to fall; the largest d ln D_cyc/d ln gamma0 likewise
with convex and concave in the place of rising and falling. Shown: the slope (the curvature) of a least-squares line
(parabola) through some neighbouring amplitudes differs from zero by more than noise gives to any such set in two cases
of a hundred; that is drawn from the scatter over the seeds (Student's t, variances pooled over neighbours). Values on
one side of a single extremum are monotonic, which gives such a line its sign whatever the shape of the curve. Without
scatter the range is that between the neighbours of the largest value, as the paper reads it. Examined are amplitudes
within a factor of REACH of the best one, or its neighbours. The onset is where the drawn lines of `onset_range` vanish.

The bound is what the largest number of signatures have in common; where that is not the majority there is none. Its
width is (high - low)/middle: 22 % for the paper's (0.8, 1.0). Next amplitudes: the geometric means of the (two) widest
gaps between amplitudes within the bound, none of those below a quarter of the width asked for. A bound over more than
SPANNED gaps, or over gaps too narrow to halve, is set by the scatter: only seeds narrow it.

Measured on curves with gamma_c known (tests/critical_model.py; 12 amplitudes a fifth to a factor of two apart, at most
12 added, 5 % asked; 40 draws each): with three seeds and a scatter of 0.03 (eta_r' 0.01 %, ln D_cyc 0.01) 5 % are
reached in 98 % of the draws with 4.6 amplitudes; at 0.3 (0.1 %, 0.1) the median bound is 12 % wide, at 1 (0.3 %, 0.3)
28 % (17 % with ten seeds), and more seeds are asked for. gamma_c is inside in 95 to 100 %.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from suspend.analysis.signatures import (
    LEAST_AMPLITUDES,
    Range,
    most_covered,
    onset_range,
)

DRAWS = 500
ALONE = 1.5  # times the width asked for: of one signature by itself, lest two that exclude each other make a bound
SPANNED = 8  # gaps between amplitudes; without scatter a bracket spans two or three
AT_ONCE = 2  # amplitudes chosen at a time
FINEST = 0.25  # of the width asked for: gaps that are not halved
DIGITS = 4  # of a chosen amplitude
REACH = 2.0
POOLED = 2  # neighbours on each side whose variances count as one
LEVEL = 98.0  # percentile of the noise, for each signature
_LOGARITHMIC = ("nu4_over_nu2", "D_cyc")  # what spans decades

Values = Mapping[str, Sequence[np.ndarray]]  # by quantity, at each amplitude those of its runs

SIGNATURES = {  # by the quantity they are seen in: name, sign, and degree of the polynomial that shows it, 0 for onset
    "eta_r_prime": ("minimum of eta_r'", -1.0, 1),
    "minus_eta3_over_eta1": ("maximum of -eta3'/eta1'", 1.0, 1),
    "minus_N2_nu0": ("onset of -nu0/eta0", 1.0, 0),
    "nu4_over_nu2": ("peak of |nu4|/|nu2|", 1.0, 1),
    "D_cyc": ("rise of ln D_cyc", 1.0, 2),
}


@dataclass(frozen=True)
class Bound:
    """What the signatures say of gamma_c.

    low, high: NaN without a bound; ranges: of each signature, None where it is not found; agreeing: names of those that
    hold the bound; gaps: between amplitudes, within it.
    """

    low: float = math.nan
    high: float = math.nan
    ranges: dict[str, Range | None] = field(default_factory=dict)
    agreeing: tuple[str, ...] = ()
    gaps: tuple[tuple[float, float], ...] = ()

    @property
    def closed(self) -> bool:
        """Whether amplitudes lie on both sides."""
        return self.low > 0.0 and math.isfinite(self.high)

    @property
    def width(self) -> float:
        """(high - low)/middle; infinite where it is not closed."""
        return relative_width(self.low, self.high) if self.closed else math.inf


@dataclass(frozen=True)
class Decision:
    """What to do about a bound: `amplitudes` to add, or why there are none (`narrow`: it is as narrow as asked)."""

    bound: Bound
    amplitudes: tuple[float, ...] = ()
    narrow: bool = False
    reason: str = ""


def relative_width(low: float, high: float) -> float:
    """(high - low)/middle."""
    return (high - low) / (0.5 * (high + low))


def decide(amplitudes: np.ndarray, values: Values, errors: Values, width: float, room: int) -> Decision:
    """The bound from runs at ascending amplitudes (n,), and the next ones; at most `room` more.

    values, errors: by quantity (those of SIGNATURES that count), at each amplitude an array over its seeds; the errors,
    of each run over its cycles, count where there is one seed. width: relative, asked for.
    """
    bound = find_bound(amplitudes, values, errors)
    if not bound.closed:
        return Decision(bound, reason=_no_bound(bound, amplitudes))
    alone = min(relative_width(r.low, r.high) for n, r in bound.ranges.items() if n in bound.agreeing and r.bracketed)
    if bound.width <= width and alone <= ALONE * width:
        return Decision(bound, narrow=True, reason="as narrow as asked")
    wide = [gap for gap in bound.gaps if relative_width(*gap) > FINEST * width]
    if len(bound.gaps) > SPANNED or not wide:
        seeds = min(len(runs) for runs in next(iter(values.values())))
        need = math.ceil(seeds * (bound.width / width) ** 2)
        why = "the scatter over seeds sets the width, not the amplitudes"
        return Decision(bound, reason=f"{why}: at least {need} seeds are needed, not {seeds}")
    if room < 1:
        return Decision(bound, reason="the most points are reached")
    widest = sorted(wide, key=lambda gap: (-gap[1] / gap[0], gap))[: min(AT_ONCE, room)]
    return Decision(bound, tuple(sorted(middle(*gap) for gap in widest)))


def middle(low: float, high: float) -> float:
    """Geometric mean, with as many digits as names should have."""
    return float(f"{math.sqrt(low * high):.{DIGITS}g}")


def find_bound(amplitudes: np.ndarray, values: Values, errors: Values) -> Bound:
    """The bound, with the scatter over seeds."""
    x = np.asarray(amplitudes, float)
    random = np.random.default_rng(0)
    ranges: dict[str, Range | None] = {}
    for quantity in values:
        name, sign, degree = SIGNATURES[quantity]
        means, noise = _draw(quantity, values[quantity], errors[quantity], random)
        known = np.isfinite(means)
        place = (x[known], sign * means[known], noise[:, known])
        enough = known.sum() >= LEAST_AMPLITUDES
        ranges[name] = None if not enough else _shown(*place, degree) if degree else _onset(*place)
    found = {name: each for name, each in ranges.items() if each is not None}
    count, shared = most_covered(found.values())
    if shared is None or 2 * count <= len(values):
        return Bound(ranges=ranges)
    agreeing = tuple(name for name, r in found.items() if r.low <= shared.low and shared.high <= r.high)
    inside = x[(x >= shared.low) & (x <= shared.high)]
    gaps = tuple(zip(inside[:-1].tolist(), inside[1:].tolist(), strict=True))
    return Bound(shared.low, shared.high, ranges, agreeing, gaps)


def _draw(
    quantity: str, values: Sequence, errors: Sequence, random: np.random.Generator
) -> tuple[np.ndarray, np.ndarray]:
    """Means over the seeds (n,) and draws of their noise (DRAWS, n); logarithms of what spans decades."""
    means, variances, count = (np.full(len(values), math.nan) for _ in range(3))
    for k, (runs, own) in enumerate(zip(values, errors, strict=True)):
        runs, own = np.asarray(runs, float), np.asarray(own, float)
        if quantity in _LOGARITHMIC:
            positive = np.where(runs > 0.0, runs, math.nan)
            runs, own = np.log(positive), own / positive
        known = np.isfinite(runs)
        count[k] = known.sum()
        if known.any():
            means[k] = runs[known].mean()
            variances[k] = runs[known].var(ddof=1) if count[k] > 1 else own[known][0] ** 2
    freedom = np.maximum(count - 1.0, 1.0)
    pooled = _neighbours(freedom * np.nan_to_num(variances)) / _neighbours(freedom)
    t = random.standard_t(_neighbours(freedom) if (count > 1).all() else 1e6, (DRAWS, len(count)))
    return means, np.sqrt(pooled / np.maximum(count, 1.0)) * t


def _neighbours(values: np.ndarray) -> np.ndarray:
    """Sums over each entry and two neighbours on both sides."""
    return np.convolve(values, np.ones(2 * POOLED + 1), "full")[POOLED : POOLED + len(values)]


def _shown(x: np.ndarray, y: np.ndarray, noise: np.ndarray, degree: int) -> Range | None:
    """Between the amplitudes that are shown to lie below and above the largest value (slope, for degree 2) of y."""
    k = int(np.argmax(y)) if degree == 1 else int(np.argmax(np.diff(y) / np.diff(np.log(x))))
    best = float(x[k] if degree == 1 else math.sqrt(x[k] * x[k + 1]))
    near = (np.abs(np.log(x / x[k])) <= math.log(REACH)) | (np.abs(np.arange(len(x)) - k - 0.5 * (degree - 1)) < degree)
    x, y, noise = x[near], y[near], noise[:, near]
    if len(x) <= degree:
        return None
    windows = [(i, r) for i in range(len(x)) for r in range(i + degree, len(x))]
    contrasts = np.array([_contrast(np.log(x), i, r, degree) for i, r in windows])
    sizes = np.sqrt(np.mean((noise @ contrasts.T) ** 2, axis=0))
    sizes = np.maximum(sizes, 1e-12 * np.abs(y).max() + np.finfo(float).tiny)
    limit = np.percentile(np.abs(noise @ contrasts.T / sizes).max(axis=1), LEVEL)
    found = contrasts @ y / sizes
    low = max((x[i] for (i, _), z in zip(windows, found, strict=True) if z > limit), default=0.0)
    high = min((x[r] for (_, r), z in zip(windows, found, strict=True) if z < -limit), default=math.inf)
    return Range(float(low), float(high), best) if low < high else None


def _contrast(u: np.ndarray, first: int, last: int, degree: int) -> np.ndarray:
    """Weights (n,) whose product with values is the leading coefficient of a polynomial through some of them."""
    weights = np.zeros(len(u))
    centred = u[first : last + 1] - u[first : last + 1].mean()
    basis, _ = np.linalg.qr(np.vander(centred, degree + 1, increasing=True))
    weights[first : last + 1] = basis[:, degree] * math.copysign(1.0, basis[-1, degree])
    return weights


def _onset(x: np.ndarray, y: np.ndarray, noise: np.ndarray) -> Range | None:
    """From the lowest to the highest range of the drawn onsets, percentiles of both left out."""
    found = [each for each in (onset_range(x, y + row) for row in noise) if each is not None]
    if len(found) < LEVEL / 100.0 * len(noise):
        return None
    outside = 0.5 * (100.0 - LEVEL)
    low = float(np.percentile([each.low for each in found], outside, method="lower"))
    high = float(np.percentile([each.high for each in found], 100.0 - outside, method="higher"))
    return Range(low, high, float(np.median([each.best for each in found])))


def _no_bound(bound: Bound, amplitudes: np.ndarray) -> str:
    missing = [name for name, each in bound.ranges.items() if each is None]
    open_ones = {name: each.best for name, each in bound.ranges.items() if each is not None and not each.bracketed}
    ends = [name for name, best in open_ones.items() if not amplitudes[0] < best < amplitudes[-1]]
    if len(missing) > len(bound.ranges) / 2:
        return f"not found: {', '.join(missing)}"
    if ends:
        return f"at the end of the amplitudes, give a wider range: {', '.join(ends)}"
    if open_ones:
        return f"the scatter hides the place, more seeds or longer runs are needed: {', '.join(open_ones)}"
    found = ", ".join(f"{name} {each.low:.4g} to {each.high:.4g}" for name, each in bound.ranges.items() if each)
    return f"the signatures exclude each other: {found}"
