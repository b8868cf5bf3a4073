"""The look of every figure: column widths, fonts, colours and markers, and how axes are labelled.

Widths are those of two-column journals (single 3.375 in, double 7 in); colours are those of Okabe and Ito, distinct
for colour-blind readers, and every curve differs in its marker too, so that a figure reads in grey. matplotlib is
imported by the functions, never with the module.
"""

from __future__ import annotations

import logging
import math
from contextlib import contextmanager
from typing import TYPE_CHECKING

import numpy as np

from suspend.backend import load_matplotlib

if TYPE_CHECKING:
    from collections.abc import Iterator

    from matplotlib.axes import Axes

SINGLE, DOUBLE = 3.375, 7.0  # inches
BLACK, BLUE, VERMILION, GREEN, GREY = "#000000", "#0072B2", "#D55E00", "#009E73", "#999999"
PURPLE, SKY, ORANGE = "#CC79A7", "#56B4E9", "#E69F00"
PALETTE = (BLUE, VERMILION, GREEN, PURPLE, ORANGE, SKY, BLACK)
MARKERS = "osD^v<P"
SEQUENTIAL, DIVERGING = "cividis", "RdBu_r"
STYLE = {
    "font.family": "sans-serif",
    "font.sans-serif": ["DejaVu Sans"],
    "mathtext.fontset": "dejavusans",
    "font.size": 8.0,
    "axes.labelsize": 8.0,
    "axes.linewidth": 0.6,
    "axes.titlesize": 8.0,
    "legend.fontsize": 6.5,
    "legend.frameon": True,  # a veil without an edge: lines may pass below it
    "legend.edgecolor": "none",
    "legend.framealpha": 0.75,
    "legend.fancybox": False,
    "legend.handlelength": 1.6,
    "legend.borderaxespad": 0.4,
    "legend.labelspacing": 0.3,
    "legend.columnspacing": 1.0,
    "lines.linewidth": 1.0,
    "lines.markersize": 3.5,
    "lines.markeredgewidth": 0.8,
    "errorbar.capsize": 1.5,
    "xtick.direction": "in",
    "ytick.direction": "in",
    "xtick.top": True,
    "ytick.right": True,
    "xtick.labelsize": 7.0,
    "ytick.labelsize": 7.0,
    "savefig.dpi": 300,
    "pdf.fonttype": 42,
    "axes.unicode_minus": True,
}


@contextmanager
def journal() -> Iterator[None]:
    """matplotlib in this style inside the block, whatever the user's own settings."""
    load_matplotlib()
    import matplotlib

    logging.getLogger("fontTools").setLevel(logging.ERROR)  # it remarks on dates inside the fonts that a PDF takes in
    with matplotlib.rc_context():
        matplotlib.rcdefaults()
        matplotlib.rcParams.update(STYLE)
        yield


def curve_style(index: int) -> dict:
    """Colour and marker of the curve number `index` of a family."""
    return {"color": PALETTE[index % len(PALETTE)], "marker": MARKERS[index % len(MARKERS)]}


def shades(count: int) -> list:
    """`count` colours in order, dark to light, for an ordered family of curves (amplitudes)."""
    import matplotlib

    return [matplotlib.colormaps["viridis"](x) for x in np.linspace(0.0, 0.88, max(count, 2))[:count]]


def zero_lines(ax: Axes, vertical: bool = False) -> None:
    """A thin grey line at zero (and at x = 0)."""
    ax.axhline(0.0, color=GREY, linewidth=0.4, zorder=0)
    if vertical:
        ax.axvline(0.0, color=GREY, linewidth=0.4, zorder=0)


def log_axis(ax: Axes, which: str, low: float, high: float, margin: float = 1.25) -> None:
    """A logarithmic axis ("x" or "y") over positive data from `low` to `high`, labelled sparsely.

    Less than about a decade and a half: plain numbers at 1, 2, 5; more: powers of ten.
    """
    from matplotlib.ticker import FuncFormatter, LogFormatterMathtext, LogLocator, NullFormatter

    getattr(ax, f"set_{which}scale")("log")
    low, high = low / margin, high * margin
    getattr(ax, f"set_{which}lim")(low, high)
    axis = getattr(ax, which + "axis")
    if high / low < 40.0:
        axis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0) if high / low > 3.0 else tuple(range(1, 10))))
        axis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:.3g}"))
    else:
        axis.set_major_locator(LogLocator(numticks=7))
        axis.set_major_formatter(LogFormatterMathtext())
    axis.set_minor_formatter(NullFormatter())


def log_axis_of(ax: Axes, which: str, values: np.ndarray, margin: float = 1.25) -> None:
    """`log_axis` over the positive finite `values`; leaves the axis alone where there are none."""
    values = np.asarray(values, float)
    values = values[np.isfinite(values) & (values > 0.0)]
    if values.size:
        log_axis(ax, which, float(values.min()), float(values.max()), margin)


def say(ax: Axes, text: str) -> None:
    """Words where a curve would be: why there is nothing to draw."""
    ax.text(0.5, 0.5, text, transform=ax.transAxes, ha="center", va="center", color=GREY, fontsize=7.0)


def number(value: float) -> str:
    """A parameter in a legend: 3 digits, no trailing zeros, round-off around zero as 0."""
    return f"{value if abs(value) > 1e-9 else 0.0:.3g}"


def errors_or_none(errors: np.ndarray) -> np.ndarray | None:
    """Error bars, none where no error is known."""
    errors = np.asarray(errors, float)
    return np.nan_to_num(errors) if errors.size and any(math.isfinite(e) and e > 0 for e in errors) else None
