"""Steady-state values against strain amplitude, one curve for each volume fraction: the form of most figures."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from suspend.figures.panel import Columns, Panel, labelled, stack
from suspend.figures.runs import Point, Runs, oscillatory, points
from suspend.figures.style import BLACK, curve_style, errors_or_none, log_axis_of, number, zero_lines

if TYPE_CHECKING:
    from matplotlib.axes import Axes

Curves = dict[tuple[float, bool], list[Point]]  # (phi, far field) -> points in the order of the amplitude
GAMMA0 = r"strain amplitude $\gamma_0$"


def curves_of(runs: Runs, column: str) -> Curves:
    """The column of every family of runs."""
    return {key: points(groups, column) for key, groups in oscillatory(runs).families().items()}


def curve_table(curves: Curves, name: str, unit: str = "-") -> Columns:
    """One row a point: phi, amplitude, far field or not, value, error, number of runs."""
    return stack(
        [
            labelled(
                {"phi[-]": phi, "far_field[bool]": int(far)},
                {
                    "gamma0[-]": np.array([p.gamma0 for p in found], float),
                    f"{name}[{unit}]": np.array([p.value for p in found], float),
                    f"{name}_error[{unit}]": np.array([p.error for p in found], float),
                    "runs[-]": np.array([p.runs for p in found], int),
                },
            )
            for (phi, far), found in curves.items()
        ]
    )


def fraction_style(phi: float, fractions: list[float]) -> dict:
    """Colour and marker of a volume fraction, the same in every panel of a figure."""
    return curve_style(sorted(fractions).index(phi))


def draw_curves(ax: Axes, curves: Curves, shift: dict[float, float] | None = None, sign: float = 1.0) -> None:
    """Points with error bars joined by thin lines; filled with far field, empty without."""
    fractions = sorted({phi for phi, _ in curves})
    for (phi, far), found in curves.items():
        if not found:
            continue
        style = fraction_style(phi, fractions)
        x, y, error = (np.array([getattr(p, name) for p in found], float) for name in ("gamma0", "value", "error"))
        ax.errorbar(
            x,
            sign * y + (shift or {}).get(phi, 0.0),
            yerr=errors_or_none(error),
            linewidth=0.7,
            elinewidth=0.7,
            markerfacecolor=style["color"] if far else "white",
            **style,
        )
    amplitudes = [p.gamma0 for found in curves.values() for p in found]
    log_axis_of(ax, "x", amplitudes, 1.35)
    ax.set_xlabel(GAMMA0)


def fraction_legend(ax: Axes, curves: Curves, **where) -> None:
    """Volume fractions by colour and marker; what filled and empty mean where both are there."""
    from matplotlib.lines import Line2D

    fractions = sorted({phi for phi, _ in curves})
    entries = [
        Line2D([], [], linestyle="-", linewidth=0.7, label=rf"$\phi = {number(phi)}$", markerfacecolor="white")
        for phi in fractions
    ]
    for entry, phi in zip(entries, fractions, strict=True):
        style = fraction_style(phi, fractions)
        entry.set(color=style["color"], marker=style["marker"])
        if all(far for other, far in curves if other == phi):
            entry.set_markerfacecolor(style["color"])
    if len({far for _, far in curves}) == 2:
        for text, face in (("with far field", BLACK), ("without", "white")):
            entries.append(Line2D([], [], linestyle="", marker="o", color=BLACK, markerfacecolor=face, label=text))
    ax.legend(handles=entries, **{"loc": "best"} | where)


class AgainstAmplitude(Panel):
    """One column of the analysis against amplitude; subclasses name it."""

    column = ""
    name = ""
    label = ""
    sign = 1.0

    def __init__(self, runs: Runs):
        self.curves = curves_of(runs, self.column)

    def tables(self) -> dict[str, Columns]:
        """phi, far_field, gamma0, value, error, runs."""
        return {"": curve_table(self.curves, self.name or self.column)}

    def draw(self, page) -> None:
        """The curves with a legend."""
        ax = page.subplots()
        self.draw_axes(ax)
        fraction_legend(ax, self.curves)

    def draw_axes(self, ax: Axes) -> None:
        """Curves and labels, without a legend."""
        zero = any(p.value <= 0.0 for found in self.curves.values() for p in found)
        if zero:
            zero_lines(ax)
        draw_curves(ax, self.curves, sign=self.sign)
        ax.set_ylabel(self.label)
        ax.margins(y=0.12)
