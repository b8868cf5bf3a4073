"""Whether a run under oscillatory shear has established its steady state: the test that ends a run early.

At the end of a cycle the last half of the cycles so far, at least LEAST of them, is examined. The steady state is
established where, each at the one-sided 95 % level,
    eta_r', eta_r''   change by less than `tolerance` x eta_r'
    ln D_cyc          changes by less than 10 x `tolerance`, or the run is absorbed: at the mean D_cyc the spheres would
                      diffuse by less than `tolerance` radii over as much strain again, sqrt(2 D_cyc gamma_tot)
where a change is that of the straight line through the half, from end to end, and likewise the bend of the parabola
(`suspend.analysis.steady.trend`; the correlation of the cycles is allowed for). It is a test of equivalence (two
one-sided tests): noise that hides a drift delays the end, where a mere "no significant drift" would bring it about.
The last half means a factor of two in total strain, so that a relaxation in the logarithm of the strain, however slow,
is measured alike at every time. D_cyc has the wider limit since it spans decades and scatters by tens of per cent.

Measured on Gaussian AR(1) noise of correlation rho = 0, 0.5, 0.8 (as in tests/test_steady_state.py, 100 series),
looked at after every cycle to cycle 320, tolerance 2 %, noise of eta_r' 0.5 %, of ln D_cyc 0.2. False ends: of an
eta_r' that falls by 2 % in each doubling of the strain 6, 5, 2 %; by 3 % in each, none; by 30 % exp(-n/40), none before
less than 2 % was left. Without drift 100, 75, 12 % end by cycle 320, half of them by cycle 103, 220, 91: that noise of
ln D_cyc decides. Large amplitudes have few cycles, and seldom end early.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import NamedTuple, Self

import numpy as np
from scipy.special import stdtrit

from suspend.analysis.rheology import cycle_row
from suspend.analysis.samples import cycle_samples, read_scales
from suspend.analysis.steady import trend
from suspend.io import Run

LEAST = 16  # cycles in the half that is examined
LEVEL = 0.95  # of each one-sided test
WIDER = 10.0  # the limit of ln D_cyc over that of the moduli
COLUMNS = ("eta_r_prime[-]", "eta_r_double_prime[-]", "D_cyc[-]")


class Bound(NamedTuple):
    """Upper limit of a change at the level of the test, and the largest that is allowed."""

    change: float
    allowed: float

    @property
    def holds(self) -> bool:
        """Whether the change is shown to be small enough."""
        return self.change < self.allowed


@dataclass(frozen=True)
class Verdict:
    """Of a run after `cycles` cycles: the bounds by quantity (none with too few cycles), whether it is absorbed."""

    cycles: int
    bounds: dict[str, Bound]
    absorbed: bool = False

    @property
    def steady(self) -> bool:
        """Whether the steady state is established."""
        return bool(self.bounds) and not self.drifting

    @property
    def drifting(self) -> list[str]:
        """Quantities that are not shown to be steady."""
        return [n for n, bound in self.bounds.items() if not bound.holds and not (n == "ln D_cyc" and self.absorbed)]

    def text(self) -> str:
        """In words, how the run ended."""
        if self.steady:
            return f"steady at cycle {self.cycles}" + (", absorbed" if self.absorbed else "")
        if not self.bounds:
            return f"duration reached, {self.cycles} cycles are too few to show a steady state ({2 * LEAST} needed)"
        found = ", ".join(
            f"{name} may change by {bound.change:.2g} (allowed {bound.allowed:.2g})"
            for name, bound in self.bounds.items()
            if name in self.drifting
        )
        return f"duration reached, not shown to be steady: {found}"


class SteadyWatch:
    """Follows eta_r', eta_r'' and D_cyc of a run, cycle by cycle; `verdict` depends on nothing but these."""

    def __init__(self, tolerance: float, scales: Mapping[str, float]):
        self.tolerance, self.scales = tolerance, scales
        self._rows: list[tuple[float, ...]] = []

    @classmethod
    def of(cls, run: Run, tolerance: float, cycles: int) -> Self:
        """The first `cycles` cycles of a stored run under oscillatory shear, all of them complete."""
        watch = cls(tolerance, read_scales(run)[1])
        d_cyc = run.statistics()["d_cyc"] if cycles else ()
        for record in cycle_samples(run, 0, cycles):
            watch.add(record | {"statistics": {"d_cyc": float(d_cyc[record["index"]])}})
        return watch

    def add(self, record: Mapping) -> None:
        """The record of the next cycle, as the simulation hands it out."""
        row = cycle_row(record, self.scales)
        self._rows.append(tuple(row[name] for name in COLUMNS))

    @property
    def steady(self) -> bool:
        """Whether the steady state is established after the last cycle added."""
        return self.verdict().steady

    def verdict(self) -> Verdict:
        """After the last cycle added."""
        columns = np.array(self._rows).reshape(-1, len(COLUMNS)).T
        return examine(*columns, self.scales["gamma0"], self.tolerance)


def examine(
    eta_r_prime: np.ndarray, eta_r_double_prime: np.ndarray, d_cyc: np.ndarray, gamma0: float, tolerance: float
) -> Verdict:
    """The test, from the values (n,) of all cycles of a run; d_cyc all NaN for a lone sphere, which has none."""
    count = len(eta_r_prime)
    if count < 2 * LEAST:
        return Verdict(count, {})
    viscous, elastic, d_cyc = (values[count // 2 :] for values in (eta_r_prime, eta_r_double_prime, d_cyc))
    allowed = tolerance * abs(float(viscous.mean()))
    bounds = {"eta_r'": Bound(largest_change(viscous), allowed), "eta_r''": Bound(largest_change(elastic), allowed)}
    if np.isnan(d_cyc).all():
        return Verdict(count, bounds)
    with np.errstate(divide="ignore", invalid="ignore"):
        logarithm = np.log(d_cyc)
    bounds["ln D_cyc"] = Bound(largest_change(logarithm), WIDER * tolerance)
    further = math.sqrt(2.0 * float(d_cyc.mean()) * 4.0 * gamma0 * count)
    return Verdict(count, bounds, further < tolerance)


def largest_change(values: np.ndarray) -> float:
    """Upper limit at LEVEL of the change over a series, of its line or its bend; infinite where it is not finite."""
    if not np.isfinite(values).all():
        return math.inf
    found = trend(values)
    t = float(stdtrit(found.freedom, LEVEL))
    return max(abs(found.change) + t * found.change_error, found.bend + t * found.bend_error)
