"""Figures of an analysis, in the style of a journal; matplotlib is imported here and nowhere else.

Drawn off screen (Agg), colours of Okabe and Ito (distinct for colour-blind readers), PNG or PDF.
"""

from __future__ import annotations

import logging
import os
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from suspend.backend import load_matplotlib
from suspend.errors import ConfigurationError
from suspend.io.files import replace_atomically, storage_errors

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from suspend.analysis.summary import Analysis

FORMATS = (".png", ".pdf")
_BLACK, _BLUE, _VERMILION, _GREEN, _GREY = "#000000", "#0072B2", "#D55E00", "#009E73", "#999999"
_STYLE = {
    "font.family": "sans-serif",
    "font.sans-serif": ["DejaVu Sans"],
    "mathtext.fontset": "dejavusans",
    "font.size": 8.0,
    "axes.labelsize": 8.0,
    "axes.linewidth": 0.6,
    "axes.titlesize": 8.0,
    "legend.fontsize": 7.0,
    "legend.frameon": False,
    "lines.linewidth": 1.1,
    "lines.markersize": 3.0,
    "xtick.direction": "in",
    "ytick.direction": "in",
    "xtick.top": True,
    "ytick.right": True,
    "xtick.labelsize": 7.0,
    "ytick.labelsize": 7.0,
    "savefig.dpi": 300,
    "pdf.fonttype": 42,
}
_SINGLE = 40  # fewer cycles than this are drawn with markers


def check_figure_path(path: os.PathLike | str) -> Path:
    """The path, if its suffix is one of FORMATS. Raises ConfigurationError, before anything is computed."""
    path = Path(path)
    if path.suffix.lower() not in FORMATS:
        raise ConfigurationError(
            f"cannot write a figure to {path}: its name ends in {path.suffix or 'no suffix'!r}, "
            f"but figures are {' or '.join(FORMATS)}"
        )
    return path


def plot_first_figure(analysis: Analysis, path: os.PathLike | str) -> None:
    """Evolution over total strain, and Lissajous curves, as in the first rheology figure of the paper.

    PNG or PDF. Oscillatory: (a) eta_r', (b) viscous and (e) elastic Lissajous curve of sigma_xy/(eta0 gamma0
    omega) in the first and the last cycle, (c) -eta_3'/eta_1', (d) eta_r'', (f) D_cyc. Other flows:
    viscosity (stress, where quiescent) and normal stress differences per block. Atomic. Raises
    ConfigurationError (suffix, nothing analysed), StorageError.
    """
    path = check_figure_path(path)
    if not len(analysis.values):
        raise ConfigurationError(f"nothing to draw for {analysis.path}: {'; '.join(analysis.notes)}")
    load_matplotlib()
    import matplotlib
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    logging.getLogger("fontTools").setLevel(logging.ERROR)  # it remarks on the dates of matplotlib's fonts in a PDF
    with matplotlib.rc_context(_STYLE):
        figure = Figure(figsize=(7.0, 4.3 if analysis.oscillatory else 2.5), layout="constrained")
        FigureCanvasAgg(figure)
        if analysis.oscillatory:
            _draw_oscillatory(figure, analysis)
        else:
            _draw_blocks(figure, analysis)
        kind = path.suffix.lower()[1:]
        with storage_errors("write the figure", path):
            replace_atomically(path, lambda temporary: figure.savefig(temporary, format=kind), sync=True)


def _draw_oscillatory(figure: Figure, analysis: Analysis) -> None:
    axes = figure.subplots(2, 3)
    evolution = (
        (axes[0, 0], "eta_r_prime", r"$\eta_r^\prime$", _BLUE),
        (axes[1, 0], "eta_r_double_prime", r"$\eta_r^{\prime\prime}$", _VERMILION),
        (axes[0, 2], "minus_eta3_over_eta1", r"$-\eta_3^\prime/\eta_1^\prime$", _GREEN),
    )
    for axis, name, label, colour in evolution:
        _draw_evolution(axis, analysis.total_strain, analysis[name], colour)
        axis.set_ylabel(label)
    _draw_diffusivity(axes[1, 2], analysis)
    stress = r"$\sigma_{xy}/\eta_0\gamma_0\omega$"
    _draw_loops(axes[0, 1], analysis, "rate", (r"$\dot\gamma/\gamma_0\omega$", stress))
    _draw_loops(axes[1, 1], analysis, "strain", (r"$\gamma/\gamma_0$", stress))
    for letter, axis in zip("abcdef", axes.flat, strict=True):
        axis.set_title(f"({letter})", loc="left", pad=3)
    scales = analysis.scales
    facts = rf"$\phi = {scales['volume_fraction']:.4g}$, $\gamma_0 = {scales['gamma0']:.4g}$"
    figure.suptitle(facts + rf", $N = {scales['number']}$", fontsize=8)


def _draw_evolution(axis: Axes, strain: np.ndarray, values: np.ndarray, colour: str) -> None:
    """One quantity against total strain, logarithmic in strain."""
    marker = "o" if len(values) < _SINGLE else None
    axis.plot(strain, values, color=colour, marker=marker)
    finite = values[np.isfinite(values)]
    if finite.size and np.ptp(finite) < 1e-9:  # a constant: its round-off is not to fill the panel
        half = max(0.1 * abs(finite[0]), 0.01)
        axis.set_ylim(finite[0] - half, finite[0] + half)
    axis.ticklabel_format(axis="y", style="sci", scilimits=(-3, 4), useMathText=True, useOffset=False)
    _log_strain(axis, strain)


def _log_strain(axis: Axes, strain: np.ndarray) -> None:
    axis.set_xscale("log")
    axis.set_xlim(strain[0] / 1.3, strain[-1] * 1.3)
    _sparse_log_labels(axis.xaxis, strain[-1] / strain[0] * 1.69)
    axis.set_xlabel(r"$\gamma_\mathrm{tot}$")


def _sparse_log_labels(axis, ratio: float) -> None:
    """Label decades, and 2 and 5 too where there are few decades; plain numbers near 1."""
    from matplotlib.ticker import FuncFormatter, LogFormatterMathtext, LogLocator, NullFormatter

    if ratio < 30.0:
        axis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0) if ratio > 3.0 else tuple(range(1, 10))))
        axis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:.3g}"))
    else:
        axis.set_major_formatter(LogFormatterMathtext())
    axis.set_minor_formatter(NullFormatter())


def _draw_diffusivity(axis: Axes, analysis: Analysis) -> None:
    """D_cyc against total strain, both logarithmic; says in words why there is nothing to draw."""
    strain, values = analysis.total_strain, analysis.d_cyc
    axis.set_ylabel(r"$D_\mathrm{cyc}$")
    _log_strain(axis, strain)
    shown = np.isfinite(values) & (values > 0.0)
    if not shown.any():
        known = np.isfinite(values).any()
        text = "all displacements\nare exactly zero" if known else "not known: see\nthe analysis' notes"
        axis.text(0.5, 0.5, text, transform=axis.transAxes, ha="center", va="center", color=_GREY)
        axis.set_yticks([])
        return
    values = np.where(shown, values, np.nan)
    axis.plot(strain, values, color=_BLACK, marker="o" if len(values) < _SINGLE else None)
    axis.set_yscale("log")
    low, high = np.nanmin(values) / 1.5, np.nanmax(values) * 1.5
    axis.set_ylim(low, high)
    _sparse_log_labels(axis.yaxis, high / low)


def _draw_loops(axis: Axes, analysis: Analysis, against: str, labels: tuple[str, str]) -> None:
    """Closed curves of the stress against the rate or the strain in the first and the last cycle."""
    cycles = sorted(analysis.waveforms)
    names = ["first cycle", "last cycle"] if len(cycles) == 2 else ["cycle"]
    styles = [{"color": _GREY, "linestyle": "--"}, {"color": _BLUE}][2 - len(cycles) :]
    for cycle, name, style in zip(cycles, names, styles, strict=True):
        wave = analysis.waveforms[cycle]
        x, y = (np.append(wave[key], wave[key][0]) for key in (against, "shear"))
        axis.plot(x, y, label=name, **style)
    axis.axhline(0.0, color=_GREY, linewidth=0.4, zorder=0)
    axis.axvline(0.0, color=_GREY, linewidth=0.4, zorder=0)
    axis.set_xlabel(labels[0])
    axis.set_ylabel(labels[1])
    if against == "rate" and len(cycles) == 2:
        axis.legend(loc="upper left", handlelength=1.6)


def _draw_blocks(figure: Figure, analysis: Analysis) -> None:
    """Viscosity (or stress) and normal stress differences of blocks against strain (or time)."""
    left, right = figure.subplots(1, 2)
    quiescent = analysis.flow == "quiescent"
    name, unit = ("sigma_xy", r"\eta_0\Gamma") if quiescent else ("eta_r", r"\eta_0|\dot\gamma|")
    parts = (("", "total", _BLACK), ("_hydrodynamic", "hydrodynamic", _BLUE))
    for tail, label, colour in (*parts, ("_interparticle", "interparticle", _VERMILION)):
        _draw_blocks_of(left, analysis, name + tail, label, colour)
    left.set_ylabel(rf"$\sigma_{{xy}}/{unit}$" if quiescent else r"$\eta_r$")
    for name, label, colour in (("N1", "$N_1$", _GREEN), ("N2", "$N_2$", _VERMILION)):
        _draw_blocks_of(right, analysis, name, label, colour)
    right.axhline(0.0, color=_GREY, linewidth=0.4, zorder=0)
    right.set_ylabel(rf"$N_1,\ N_2\ /\ {unit}$")
    for letter, axis in zip("ab", (left, right), strict=True):
        axis.set_xlabel(r"$\Gamma t$" if quiescent else r"$\gamma_\mathrm{tot}$")
        axis.set_title(f"({letter})", loc="left", pad=3)
        axis.margins(y=0.25)  # room for the legend
        axis.legend(loc="best", ncols=3, handlelength=1.4, columnspacing=1.0)


def _draw_blocks_of(axis: Axes, analysis: Analysis, name: str, label: str, colour: str) -> None:
    marker = "o" if len(analysis.values) < _SINGLE else None
    axis.plot(analysis.total_strain, analysis[name], color=colour, marker=marker, label=label)
