"""How groups of runs are told apart: colour and marker by volume fraction and setup, filled with far field, else empty.

A group is anything with `phi`, `setup` (the text of what differs, see `suspend.analysis.setups`) and `far_field`.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Protocol

import numpy as np

from suspend.figures.style import BLACK, curve_style, number

if TYPE_CHECKING:
    from suspend.figures.amplitude import Curve

_FAR_FIELD = ("far_field = ewald", "far_field = self")  # told by the filling
_LINE = 20  # characters of a legend that stand on one line: panels are narrow


class Group(Protocol):
    """A curve, or a series of runs."""

    phi: float
    setup: str
    far_field: bool


def family(group: Group) -> tuple[float, str]:
    """Volume fraction, and what differs besides the far field: groups of one family share colour and marker."""
    return group.phi, ", ".join(part for part in group.setup.split(", ") if part and part not in _FAR_FIELD)


def families(groups: Sequence[Group]) -> list[tuple[float, str]]:
    """The families there are, in order."""
    return sorted({family(group) for group in groups})


def marker_style(group: Group, groups: Sequence[Group]) -> dict:
    """Keywords of a marker: colour and shape of its family, filled with far field, else empty."""
    style = curve_style(families(groups).index(family(group)))
    return style | filling(group.far_field, style["color"])


def filling(far_field: bool, colour: str) -> dict:
    """Keywords of a marker's face."""
    return {"markerfacecolor": colour if far_field else "white"}


def group_entries(groups: Sequence[Group]) -> list:
    """Legend entries of the families."""
    from matplotlib.lines import Line2D

    entries = []
    for phi, setup in families(groups):
        shown = next(g for g in groups if family(g) == (phi, setup))
        text = rf"$\phi = {number(phi)}$" + _after(short_setup(setup) if setup else "")
        entries.append(Line2D([], [], linewidth=0.7, label=text, **marker_style(shown, groups)))
    return entries


def _after(setup: str) -> str:
    return "" if not setup else ", " + setup if len(setup) < _LINE - 7 else ",\n" + setup.replace(", ", ",\n")


def far_field_entries(groups: Sequence[Group]) -> list:
    """Legend entries of filled and empty markers, where there are both."""
    from matplotlib.lines import Line2D

    if len({group.far_field for group in groups}) < 2:
        return []
    return [
        Line2D([], [], linestyle="", marker="o", color=BLACK, label=text, **filling(far, BLACK))
        for far, text in ((True, "with far field"), (False, "without"))
    ]


def error_entry(curves: Sequence[Curve]) -> list:
    """Legend entry that says what the bars are: standard errors over how many seeds, or within single runs."""
    from matplotlib.lines import Line2D

    shown = [c.known & np.isfinite(c.error) & (c.error > 0.0) for c in curves]
    seeds = sorted({int(n) for c, k in zip(curves, shown, strict=True) for n in c.runs[k]})
    if not seeds:
        return []
    several, parts = [n for n in seeds if n > 1], []
    if several:
        parts.append(f"{several[0]}" + (f"\u2013{several[-1]}" if len(several) > 1 else "") + " seeds")
    if 1 in seeds:
        parts.append(f"one: {curves[0].alone}" if several else curves[0].alone)
    text = "s.e. over " + ",\n".join(parts)
    return [Line2D([], [], linestyle="", marker="|", markersize=7, color=BLACK, label=text)]


def short_setup(setup: str) -> str:
    """The text of a setup in a legend: last words of keys, the kind of start alone."""
    parts = []
    for part in setup.split(", "):
        key, _, value = part.partition(" = ")
        if part in _FAR_FIELD:
            parts.append("far field" if part == _FAR_FIELD[0] else "no far field")
        elif key == "particles.initial":
            parts.append("start " + value if value.startswith("read") else value)
        else:
            parts.append(part.removeprefix(key.rpartition(".")[0]).lstrip(".").replace("_", " "))
    return ", ".join(parts)
