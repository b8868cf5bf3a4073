"""Steady-state values against strain amplitude, one curve for each volume fraction: the form of most figures."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from suspend.analysis.collection import SeedAverage, Series, seed_average
from suspend.figures.groups import error_entry, far_field_entries, group_entries, marker_style
from suspend.figures.panel import Columns, Panel, labelled, stack
from suspend.figures.runs import Runs
from suspend.figures.style import errors_or_none, log_axis_of, zero_lines

if TYPE_CHECKING:
    from matplotlib.axes import Axes

GAMMA0 = r"strain amplitude $\gamma_0$"
_FEW = 3  # entries of a legend that find their place among the curves
_ROW = 0.055  # height of a row of a legend relative to axes as high as the page
_MOST = 0.66  # of the height that a legend may take


@dataclass(frozen=True)
class Curve:
    """One quantity of one series of runs against amplitude; the value is NaN where it is not known.

    runs: how many seeds have a value; error: standard error over them, of a single one over what `alone` says.
    """

    phi: float
    setup: str
    far_field: bool
    gamma0: np.ndarray
    value: np.ndarray
    error: np.ndarray
    runs: np.ndarray
    alone: str = "cycles"

    @property
    def known(self) -> np.ndarray:
        """Where there is a value."""
        return np.isfinite(self.value)

    @property
    def error_over(self) -> np.ndarray:
        """What the errors are the scatter of, at each amplitude: seeds, or within the single run."""
        return np.where(self.runs > 1, "seeds", np.where(self.runs == 1, self.alone, ""))


def curves_of(runs: Runs, name: str) -> list[Curve]:
    """A quantity of `suspend.analysis.collection` for every series of the runs."""
    return [_curve(s, s.averages(name), "cycles") for s in runs.collection.series]


def curves_by(runs: Runs, evaluate: Callable[[str], tuple[float, float]], alone: str = "cycles") -> list[Curve]:
    """As `curves_of`, for a value and its error (over `alone`) from the path of each run."""
    found = []
    for series in runs.collection.series:
        pairs = [[evaluate(member.path) for member in group] for group in series.groups]
        found.append(_curve(series, [seed_average(*zip(*each, strict=True)) for each in pairs], alone))
    return found


def _curve(series: Series, averages: list[SeedAverage], alone: str) -> Curve:
    value, error, count = (np.array(column) for column in zip(*averages, strict=True))
    return Curve(series.phi, series.setup, series.far_field, series.gamma0, value, error, count, alone)


def curve_table(curves: list[Curve], name: str, unit: str = "-") -> Columns:
    """One row a point: phi, setup (where there are several), amplitude, value, error, number of runs, kind of error."""
    several = len({c.setup for c in curves}) > 1
    return stack(
        [
            labelled(
                {"phi[-]": c.phi, "far_field[bool]": int(c.far_field)} | ({"setup": c.setup} if several else {}),
                {
                    "gamma0[-]": c.gamma0,
                    f"{name}[{unit}]": c.value,
                    f"{name}_error[{unit}]": c.error,
                    "runs[-]": c.runs,
                    "error_over": c.error_over,
                },
            )
            for c in curves
        ]
    )


def draw_curves(ax: Axes, curves: list[Curve], shift: dict[float, float] | None = None) -> None:
    """Points with error bars joined by thin lines, against the logarithm of the amplitude."""
    for curve in curves:
        known = curve.known
        if not known.any():
            continue
        ax.errorbar(
            curve.gamma0[known],
            curve.value[known] + (shift or {}).get(curve.phi, 0.0),
            yerr=errors_or_none(curve.error[known]),
            linewidth=0.7,
            elinewidth=0.7,
            **marker_style(curve, curves),
        )
    amplitude_axis(ax, curves)


def amplitude_axis(ax: Axes, curves: list[Curve]) -> None:
    """The logarithmic axis of the amplitude, and its label."""
    log_axis_of(ax, "x", np.concatenate([c.gamma0 for c in curves]), 1.35)
    ax.set_xlabel(GAMMA0)


def values_of(curves: list[Curve]) -> np.ndarray:
    """All known values."""
    return np.concatenate([c.value[c.known] for c in curves])


def fraction_legend(ax: Axes, curves: list[Curve], row: float = _ROW) -> None:
    """Legend of the groups, the far field and the bars; a long one gets room above the curves, `row` a line."""
    entries = [*group_entries(curves), *far_field_entries(curves), *error_entry(curves)]
    if len(entries) > _FEW:
        rows = sum(1 + str(entry.get_label()).count("\n") for entry in entries)
        headroom(ax, min(row * rows, _MOST))
    ax.legend(handles=entries, loc="upper left" if len(entries) > _FEW else "best")


def headroom(ax: Axes, share: float) -> None:
    """Raise the upper limit of y so that `share` of the height is free above what is shown now."""
    low, high = ax.get_ylim()
    if ax.get_yscale() == "log":
        ax.set_ylim(low, high * (high / low) ** (share / (1.0 - share)))
    else:
        ax.set_ylim(low, high + (high - low) * share / (1.0 - share))


class AgainstAmplitude(Panel):
    """One quantity of the collection against amplitude; subclasses name it."""

    quantity = ""
    label = ""

    def __init__(self, runs: Runs):
        self.curves = curves_of(runs, self.quantity)

    def tables(self) -> dict[str, Columns]:
        """phi, far_field, gamma0, value, error, runs."""
        return {"": curve_table(self.curves, self.quantity)}

    def draw(self, page) -> None:
        """The curves with a legend."""
        ax = page.subplots()
        if (values_of(self.curves) <= 0.0).any():
            zero_lines(ax)
        draw_curves(ax, self.curves)
        ax.set_ylabel(self.label)
        ax.margins(y=0.12)
        self.scale(ax)
        fraction_legend(ax, self.curves)

    def scale(self, ax: Axes) -> None:
        """Change the scale of y before the legend is placed."""
