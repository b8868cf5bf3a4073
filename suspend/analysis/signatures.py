"""The four rheological signatures of the reversible-irreversible transition and the bound on gamma_c they give."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass
from itertools import pairwise
from typing import Any, Self

import numpy as np

from suspend.analysis.collection import Series
from suspend.analysis.quantity import Quantity
from suspend.errors import ConfigurationError

LEAST_AMPLITUDES = 3
_LEVEL = (2.5, 97.5)  # percentiles of the bootstrap


@dataclass(frozen=True)
class Range:
    """Where a feature of a sampled curve lies: between two amplitudes, its best estimate and whether it is bracketed.

    low, high: open interval (low 0, high infinity: the feature lies at or beyond the end of the samples); best: the
    amplitude itself; rivals: amplitudes outside the interval that the errors do not rule out as its place.
    """

    low: float
    high: float
    best: float
    rivals: tuple[float, ...] = ()

    @property
    def bracketed(self) -> bool:
        """True where samples lie on both sides."""
        return self.low > 0.0 and math.isfinite(self.high)

    def overlap(self, other: Range) -> float:
        """Length of the common part; 0 where there is none."""
        return max(0.0, min(self.high, other.high) - max(self.low, other.low))

    def __str__(self) -> str:
        return f"({self.low:g}, {self.high:g})" if math.isfinite(self.high) else f"above {self.low:g}"


def extremum_range(gamma0: np.ndarray, values: np.ndarray, errors: np.ndarray | None = None) -> Range | None:
    """The maximum of sampled values (n,): between the neighbours of the largest one, as the paper estimates it.

    For a curve with a single maximum this holds whatever its shape. Minimum: pass -values. Amplitudes ascend; values
    that are not finite are left out; None for fewer than 3 others. rivals: amplitudes beyond the neighbours whose value
    is within two combined errors of the largest (none without errors).
    """
    known = np.isfinite(values)
    x, y = np.asarray(gamma0, float)[known], np.asarray(values, float)[known]
    if len(x) < LEAST_AMPLITUDES:
        return None
    k = int(np.argmax(y))
    low = float(x[k - 1]) if k > 0 else 0.0
    high = float(x[k + 1]) if k + 1 < len(x) else math.inf
    rivals: tuple[float, ...] = ()
    if errors is not None:
        spread = np.hypot(errors[known], errors[known][k])
        near = (y[k] - y < 2.0 * spread) & (np.abs(np.arange(len(x)) - k) > 1)
        rivals = tuple(x[near].tolist())
    return Range(low, high, float(x[k]), rivals)


def onset_range(gamma0: np.ndarray, values: np.ndarray, points: int = 3) -> Range | None:
    """Onset of values that are zero below some amplitude: where a line through the last `points` crosses zero.

    The range is the interval between the sampled amplitudes around the crossing. None for fewer than 3 amplitudes or
    a line that does not rise; low 0 where it crosses before the first amplitude.
    """
    known = np.isfinite(values)
    x, y = np.asarray(gamma0, float)[known], np.asarray(values, float)[known]
    if len(x) < LEAST_AMPLITUDES:
        return None
    tail = slice(max(len(x) - points, 0), None)
    centred = x[tail] - x[tail].mean()
    slope = float(centred @ y[tail] / (centred @ centred))
    if not slope > 0.0:
        return None
    crossing = float(x[tail].mean() - y[tail].mean() / slope)
    above = int(np.searchsorted(x, crossing, side="right"))
    low = float(x[above - 1]) if above > 0 else 0.0
    high = float(x[above]) if above < len(x) else math.inf
    return Range(low, high, crossing)


def steepest_range(gamma0: np.ndarray, values: np.ndarray, logarithmic: bool = False) -> Range | None:
    """Interval between neighbouring amplitudes over which the values rise most per unit of amplitude; best: its middle.

    logarithmic: the rise of ln(value), which the smallest values decide; values that are not positive are left out.
    None for fewer than 3 amplitudes or values that rise nowhere.
    """
    known = np.isfinite(values) & ((np.asarray(values) > 0.0) | (not logarithmic))
    x, y = np.asarray(gamma0, float)[known], np.asarray(values, float)[known]
    if len(x) < LEAST_AMPLITUDES:
        return None
    slopes = np.diff(np.log(y) if logarithmic else y) / np.diff(x)
    k = int(np.argmax(slopes))
    if not slopes[k] > 0.0:
        return None
    return Range(float(x[k]), float(x[k + 1]), float(0.5 * (x[k] + x[k + 1])))


def intersection(ranges: Iterable[Range]) -> Range | None:
    """What all ranges have in common, best in its middle; None where that is empty or there is no range."""
    ranges = list(ranges)
    if not ranges:
        return None
    low, high = max(r.low for r in ranges), min(r.high for r in ranges)
    return Range(low, high, _middle(low, high)) if low < high else None


def most_covered(ranges: Iterable[Range]) -> tuple[int, Range | None]:
    """The interval that lies in the largest number of ranges (the lowest of several), and that number."""
    ranges = list(ranges)
    edges = sorted({edge for r in ranges for edge in (r.low, r.high)})
    best, found = 0, None
    for low, high in pairwise(edges):
        count = sum(r.low <= low and high <= r.high for r in ranges)
        if count > best:
            best, found = count, Range(low, high, _middle(low, high))
        elif count == best and found is not None and found.high == low:
            found = Range(found.low, high, _middle(found.low, high))
    return best, found


def _middle(low: float, high: float) -> float:
    return 0.5 * (low + high) if math.isfinite(high) else math.nan


class Signatures(Quantity):
    """Ranges of the four signatures in one `Series` of a `Collection`, their intersection, and the rise of D_cyc.

        I    minimum of eta_r'             between the neighbours of the smallest value
        II   maximum of -eta_3'/eta_1'     between the neighbours of the largest value
        III  onset of -nu_0/eta0           interval that holds the zero of a line through the last `points` amplitudes
        IV   peak of |nu_4|/|nu_2|         between the neighbours of the largest value
    The paper gives (0.8, 1.6) and (0.4, 1.0) for I and II at phi = 0.4, read in this way from its amplitudes, and
    draws the lines of III. gamma_c lies in the intersection. D_cyc: the interval of the largest slope d D_cyc/d gamma0.
    For comparison, not part of the bound: the intervals where ln D_cyc and ln(-nu_0/eta0) rise most steeply.

    Uncertainty: bootstrap over seeds. At each amplitude with two or more runs, runs are drawn with replacement
    (`resamples` times, generator `seed`), and everything is evaluated again. Amplitudes with one run stay fixed: with
    one seed throughout there is no such uncertainty, and `notes` says so.
    """

    def __init__(self, points: int = 3, resamples: int = 1000, seed: int = 0):
        if points < 2 or resamples < 0:
            raise ConfigurationError(f"points = {points} must be 2 or more, resamples = {resamples} not negative")
        self.points, self.resamples, self.seed = points, resamples, seed

    def compute(self, run: Series) -> Self:
        """Compute from a series of runs; what cannot be had from its amplitudes is None and said in `notes`."""
        self.series = run
        names = ("eta_r_prime", "minus_eta3_over_eta1", "minus_N2_nu0", "nu4_over_nu2", "D_cyc")
        means = {name: run.mean(name) for name in names}
        errors = {name: run.error(name) for name in names}
        self._ranges = self._evaluate(means, errors)
        self._rise = steepest_range(run.gamma0, means["D_cyc"])
        self._log_rise = steepest_range(run.gamma0, means["D_cyc"], logarithmic=True)
        self._onset_rise = steepest_range(run.gamma0, means["minus_N2_nu0"], logarithmic=True)
        self._bootstrap(names)
        return self

    def _evaluate(self, means: dict, errors: dict | None = None) -> dict[str, Range | None]:
        x, errors = self.series.gamma0, errors or {}
        thinning, ratio = "minus_eta3_over_eta1", "nu4_over_nu2"
        return {
            "minimum of eta_r'": extremum_range(x, -means["eta_r_prime"], errors.get("eta_r_prime")),
            "maximum of -eta3'/eta1'": extremum_range(x, means[thinning], errors.get(thinning)),
            "onset of -nu0/eta0": onset_range(x, means["minus_N2_nu0"], self.points),
            "peak of |nu4|/|nu2|": extremum_range(x, means[ratio], errors.get(ratio)),
        }

    def _bootstrap(self, names: Iterable[str]) -> None:
        repeated = self.series.runs > 1
        self._draws: dict[str, np.ndarray] = {}
        if not repeated.any() or not self.resamples:
            return
        random = np.random.default_rng(self.seed)
        drawn: dict[str, list] = {name: [] for name in [*self._ranges, "gamma_c", "rise of D_cyc"]}
        for _ in range(self.resamples):
            picks = [random.integers(0, n, n) for n in self.series.runs]
            means = {name: self._resampled(name, picks) for name in names}
            ranges = self._evaluate(means)
            found: dict[str, Range | None] = dict(ranges)
            found["gamma_c"] = intersection(r for r in ranges.values() if r is not None)
            found["rise of D_cyc"] = steepest_range(self.series.gamma0, means["D_cyc"])
            for name, value in found.items():
                drawn[name].append((value.low, value.high, value.best) if value else (math.nan,) * 3)
        self._draws = {name: np.array(values) for name, values in drawn.items()}

    def _resampled(self, name: str, picks: list[np.ndarray]) -> np.ndarray:
        means = []
        for group, pick in zip(self.series.groups, picks, strict=True):
            values = np.array([group[i].values[name] for i in pick])
            values = values[np.isfinite(values)]
            means.append(values.mean() if values.size else math.nan)
        return np.array(means)

    @property
    def ranges(self) -> dict[str, Range | None]:
        """The four signatures by name, ranges of gamma0; None where it cannot be had."""
        return self._ranges

    @property
    def bound(self) -> Range | None:
        """Intersection of the available signatures: the bound on gamma_c; None where they exclude each other."""
        return intersection(self._available)

    @property
    def agreement(self) -> tuple[int, int, Range | None]:
        """Number of signatures that agree best, number available, and the interval they share."""
        count, where = most_covered(self._available)
        return count, len(self._available), where

    @property
    def rise(self) -> Range | None:
        """Interval of gamma0 where D_cyc rises most steeply, d D_cyc/d gamma0."""
        return self._rise

    @property
    def logarithmic_rise(self) -> Range | None:
        """Interval of gamma0 where ln D_cyc rises most steeply."""
        return self._log_rise

    @property
    def onset_rise(self) -> Range | None:
        """Interval of gamma0 where ln(-nu_0/eta0) rises most steeply: the jump of the onset, in its decades."""
        return self._onset_rise

    @property
    def _available(self) -> list[Range]:
        return [r for r in self._ranges.values() if r is not None]

    def confidence(self, name: str) -> dict[str, float] | None:
        """Bootstrap of a signature, "gamma_c" or "rise of D_cyc"; None with one run at every amplitude.

        same: fraction of resamples with the same range; none: fraction without any; low, high: 2.5th percentile of the
        lower end and 97.5th of the upper end of the ranges found.
        """
        draws = self._draws.get(name)
        if draws is None:
            return None
        found = draws[np.isfinite(draws[:, 0])]
        value = {"gamma_c": self.bound, "rise of D_cyc": self.rise}.get(name, self._ranges.get(name))
        same = float(np.mean((found[:, 0] == value.low) & (found[:, 1] == value.high))) if value and len(found) else 0.0
        low, high = (math.nan, math.nan)
        if len(found):
            low = float(np.percentile(found[:, 0], _LEVEL[0], method="lower"))
            high = float(np.percentile(found[:, 1], _LEVEL[1], method="higher"))
        share = len(found) / len(draws)
        return {"same": same * share, "none": 1.0 - share, "low": low, "high": high}

    def bootstrap_bounds(self) -> np.ndarray:
        """Closed bounds on gamma_c (m, 2) found in the resamples; m = 0 with one run at every amplitude."""
        draws = self._draws.get("gamma_c", np.empty((0, 3)))
        return draws[np.isfinite(draws).all(axis=1) & (draws[:, 0] > 0.0), :2]

    @property
    def notes(self) -> list[str]:
        """What is missing, not bracketed, ambiguous, contradictory, or without uncertainty."""
        notes, runs = [], self.series.runs
        if len(runs) < LEAST_AMPLITUDES:
            return [f"{len(runs)} amplitude(s): {LEAST_AMPLITUDES} are needed for the signatures"]
        for name, value in self._ranges.items():
            if value is None:
                notes.append(f"{name}: not found at {len(runs)} amplitude(s)")
            elif not value.bracketed:
                notes.append(f"{name}: at the end of the sampled amplitudes, so not bracketed")
            if value is not None and value.rivals:
                notes.append(f"{name}: the errors do not rule out gamma0 = {', '.join(f'{r:g}' for r in value.rivals)}")
        if len(self._available) < len(self._ranges):
            notes.append(f"the bound rests on {len(self._available)} of {len(self._ranges)} signatures")
        if self.bound is None and self._available:
            count, total, where = self.agreement
            notes.append(f"the signatures exclude each other; {count} of {total} agree on {where}")
        if (runs == 1).all():
            notes.append(
                "one run (seed) at each amplitude: no uncertainty from seeds; ranges are gaps between amplitudes"
            )
        elif (runs == 1).any():
            notes.append(
                f"one run (seed) at {int((runs == 1).sum())} of {len(runs)} amplitudes: kept fixed in the bootstrap"
            )
        if (runs > 1).any() and runs.max() < 5:
            notes.append(f"at most {runs.max()} seeds: the bootstrap is coarse and too narrow")
        drifting = [f"{group[0].gamma0:g}" for group in self.series.groups if any(m.drifting for m in group)]
        if drifting:
            notes.append(f"not steady yet at gamma0 = {', '.join(drifting)}: values still drift")
        return notes

    def rows(self) -> list[tuple[str, Range | None]]:
        """The signatures, the bound, the rises of D_cyc, ln D_cyc and ln(-nu0/eta0), in this order."""
        return [
            *self._ranges.items(),
            ("gamma_c", self.bound),
            ("rise of D_cyc", self.rise),
            ("rise of ln D_cyc", self.logarithmic_rise),
            ("rise of ln(-nu0/eta0)", self.onset_rise),
        ]

    def table(self) -> dict[str, np.ndarray]:
        """One row for each of `rows`."""
        rows, nothing = self.rows(), Range(math.nan, math.nan, math.nan)
        columns = {"phi[-]": np.full(len(rows), self.series.phi), "setup": np.full(len(rows), self.series.setup)}
        columns["signature"] = np.array([name for name, _ in rows])
        for key in ("low", "high", "best"):
            columns[f"{key}[gamma0]"] = np.array([getattr(value or nothing, key) for _, value in rows])
        found = [self.confidence(name) or {} for name, _ in rows]
        for key, unit in (("same", "-"), ("none", "-"), ("low", "gamma0"), ("high", "gamma0")):
            columns[f"bootstrap_{key}[{unit}]"] = np.array([item.get(key, math.nan) for item in found])
        return columns

    def summary(self) -> dict[str, Any]:
        """All ranges as [low, high], the best estimates, the bootstrap, and the notes."""
        rows = {
            name: {"range": [value.low, value.high], "best": value.best} if value else None
            for name, value in self.rows()
        }
        bootstrap = {name: self.confidence(name) for name, _ in self.rows() if self.confidence(name)}
        count, total, where = self.agreement
        agree = {"signatures": count, "of": total, "range": [where.low, where.high] if where else None}
        return {"phi": self.series.phi, "setup": self.series.setup, "ranges": rows, "agreement": agree} | {
            "bootstrap": bootstrap,
            "notes": self.notes,
        }

    def plot(self, ax) -> None:
        """D_cyc against amplitude with the bound on gamma_c shaded."""
        series = self.series
        ax.errorbar(series.gamma0, series.mean("D_cyc"), series.error("D_cyc"), marker="o", ms=4, label=series.title)
        if self.bound is not None and self.bound.bracketed:
            ax.axvspan(self.bound.low, self.bound.high, alpha=0.2, color="#56B4E9", linewidth=0)
        ax.set_xlabel(r"$\gamma_0$")
        ax.set_ylabel(r"final $D_\mathrm{cyc}$")
