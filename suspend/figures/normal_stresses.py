"""Normal stress differences: averages of N1 and N2, frequency doubling of N2, its Lissajous curves."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from suspend.analysis.lissajous import Lissajous
from suspend.analysis.normal_stresses import NormalStresses
from suspend.analysis.samples import chosen_window
from suspend.analysis.signatures import onset_range
from suspend.figures.amplitude import (
    Curve,
    amplitude_axis,
    curve_table,
    curves_by,
    curves_of,
    draw_curves,
    fraction_legend,
    values_of,
)
from suspend.figures.groups import error_entry, families, family, group_entries, marker_style
from suspend.figures.panel import Columns, Panel, labelled, stack
from suspend.figures.runs import Runs
from suspend.figures.style import BLACK, GREY, curve_style, errors_or_none, log_axis_of, number, shades, zero_lines
from suspend.figures.viscosity import representative
from suspend.io import Run

FITTED = 3  # points at the largest amplitudes that the dashed lines are fitted to
_UNIT = "eta0*gamma0*omega"


class FirstDifference(Panel):
    """Average N1 against amplitude; its hydrodynamic part below."""

    def __init__(self, runs: Runs):
        self.total = curves_of(runs, "N1_nu0")
        self.hydrodynamic = curves_of(runs, "N1_nu0_hydrodynamic")

    def tables(self) -> dict[str, Columns]:
        """N1 and its hydrodynamic part."""
        return {
            "": curve_table(self.total, "N1_mean", _UNIT),
            "hydrodynamic": curve_table(self.hydrodynamic, "N1_mean_hydrodynamic", _UNIT),
        }

    def draw(self, page) -> None:
        """Two axes over the same amplitudes."""
        upper, lower = page.subplots(2, 1, sharex=True, height_ratios=(1.4, 1.0))
        for ax, curves in ((upper, self.total), (lower, self.hydrodynamic)):
            zero_lines(ax)
            draw_curves(ax, curves)
            ax.margins(y=0.15)
        upper.set_xlabel("")
        upper.set_ylabel(r"$\langle N_1\rangle/\eta_0\gamma_0\omega$")
        lower.set_ylabel("hydrodynamic part")
        fraction_legend(upper, self.total, row=0.09)


class SecondDifference(Panel):
    """Average -N2 (-nu_0/eta0) against amplitude, whole and interparticle part, with lines fitted at the end."""

    def __init__(self, runs: Runs):
        self.total = curves_of(runs, "minus_N2_nu0")
        part = curves_of(runs, "N2_nu0_interparticle")
        self.interparticle = [replace(curve, value=-curve.value) for curve in part]
        self.fits = [end_line(curve) for curve in self.total]

    def tables(self) -> dict[str, Columns]:
        """-nu_0 of the whole and of the interparticle stress, and the fitted lines ("fits")."""
        rows = [
            {
                "phi[-]": np.array([curve.phi]),
                "far_field[bool]": np.array([int(curve.far_field)]),
                "zero_at_gamma0[-]": np.array([fit[0]]),
                "slope_per_gamma0[eta0]": np.array([fit[1]]),
            }
            for curve, fit in zip(self.total, self.fits, strict=True)
            if fit
        ]
        found = {
            "": curve_table(self.total, "minus_nu0", "eta0"),
            "interparticle": curve_table(self.interparticle, "minus_nu0_interparticle", "eta0"),
        }
        return found | ({"fits": stack(rows)} if rows else {})

    def draw(self, page) -> None:
        """Filled: the entire stress; empty: interparticle. Lines join the points of runs with far field."""
        ax = page.subplots()
        zero_lines(ax)
        kinds = families(self.total)
        for curves, filled in ((self.total, True), (self.interparticle, False)):
            for c in curves:
                style = curve_style(kinds.index(family(c)))
                face = {"markerfacecolor": style["color"] if filled else "white"}
                line = {"linestyle": "-" if c.far_field else "", "linewidth": 0.7, "elinewidth": 0.7}
                k = c.known
                ax.errorbar(c.gamma0[k], c.value[k], yerr=errors_or_none(c.error[k]), **line, **style, **face)
        for c, fit in zip(self.total, self.fits, strict=True):
            if fit:
                end = float(c.gamma0[-1])
                x = np.geomspace(max(fit[0], 0.01 * end), end, 100)
                colour = marker_style(c, self.total)["color"]
                ax.plot(x, fit[1] * (x - fit[0]), "--", color=colour, linewidth=0.7)
        amplitude_axis(ax, self.total)
        ax.set_ylabel(r"$-\nu_0/\eta_0 = -\langle N_2\rangle/\eta_0\gamma_0\omega$")
        ax.margins(y=0.12)
        self._legend(ax)

    def _legend(self, ax) -> None:
        from matplotlib.lines import Line2D

        entries = group_entries(self.total)
        for entry in entries:
            entry.set(linestyle="", markerfacecolor=entry.get_color())
        for text, face in (("entire stress", BLACK), ("interparticle", "white")):
            entries.append(Line2D([], [], linestyle="", marker="o", color=BLACK, markerfacecolor=face, label=text))
        if len({c.far_field for c in self.total}) == 2:
            entries.append(Line2D([], [], color=BLACK, linewidth=0.7, label="with far field"))
        entries += error_entry(self.total)
        ax.legend(handles=entries, loc="upper left")


def end_line(curve: Curve) -> tuple[float, float] | None:
    """Amplitude where the line through the last points of -nu_0 crosses zero, and its slope; None without an onset."""
    onset = onset_range(curve.gamma0, curve.value, FITTED)
    if onset is None:
        return None
    x, y = (column[curve.known][-FITTED:].mean() for column in (curve.gamma0, curve.value))
    return onset.best, float(y / (x - onset.best))  # a least-squares line passes through the mean point


class Doubling(Panel):
    """|nu_4|/|nu_2| of N2 against amplitude; that of the hydrodynamic part below."""

    def __init__(self, runs: Runs):
        def hydrodynamic(path: str) -> tuple[float, float]:
            with Run(path) as run:
                last = min(runs.last, run.cycles) if runs.last else None
                found = NormalStresses(last).compute(run).steady_of("N2", "hydrodynamic")["nu4_over_nu2"]
            return found.mean, found.error

        self.total = curves_of(runs, "nu4_over_nu2")
        self.hydrodynamic = curves_by(runs, hydrodynamic)

    def tables(self) -> dict[str, Columns]:
        """The ratio, whole and hydrodynamic."""
        name = "nu4_abs_over_nu2_abs"
        return {
            "": curve_table(self.total, name),
            "hydrodynamic": curve_table(self.hydrodynamic, name + "_hydrodynamic"),
        }

    def draw(self, page) -> None:
        """Two logarithmic axes over the same amplitudes."""
        upper, lower = page.subplots(2, 1, sharex=True, height_ratios=(1.4, 1.0))
        for ax, curves in ((upper, self.total), (lower, self.hydrodynamic)):
            draw_curves(ax, curves)
            ax.axhline(1.0, color=GREY, linewidth=0.4, zorder=0)
            log_axis_of(ax, "y", values_of(curves), 2.0)
        upper.set_xlabel("")
        upper.set_ylabel(r"$|\nu_4|/|\nu_2|$")
        lower.set_ylabel("hydrodynamic part")
        fraction_legend(upper, self.total, row=0.09)


class SecondLissajous(Panel):
    """N2 against strain, mean of the last cycles, for three amplitudes; arrows give the direction in time."""

    def __init__(self, runs: Runs):
        self.members, self.loops = representative(runs), []
        for member in self.members:
            with member.open() as run:
                last = min(runs.last, run.cycles) if runs.last else None
                window = chosen_window(run, last) if run.cycles else 1
                self.loops.append(Lissajous(window, "strain", "N2").compute(run))

    def tables(self) -> dict[str, Columns]:
        """Strain and N2 over the mean cycle."""
        parts = []
        for m, loop in zip(self.members, self.loops, strict=True):
            constants = {"phi[-]": m.phi, "gamma0[-]": m.gamma0, "averaged_cycles[-]": loop.cycles}
            table = loop.table()
            names = ("theta[rad]", "strain[gamma0]", f"N2[{_UNIT}]")
            parts.append(labelled(constants, {name: table[name] for name in names}))
        return {"": stack(parts)}

    def draw(self, page) -> None:
        """One axes for each amplitude, as their scales differ."""
        axes = page.subplots(len(self.members), 1, sharex=True, squeeze=False)[:, 0]
        for m, loop, ax, colour in zip(self.members, self.loops, axes, shades(len(self.members)), strict=True):
            x, y = loop.curve()
            zero_lines(ax, vertical=True)
            ax.plot(x, y, color=colour)
            for start in (0, len(x) // 2):
                stop = start + max(len(x) // 32, 1)
                arrow = {"arrowstyle": "-|>", "color": colour, "lw": 0.8, "mutation_scale": 7}
                ax.annotate("", xy=(x[stop], y[stop]), xytext=(x[start], y[start]), arrowprops=arrow)
            ax.set_title(rf"$\gamma_0 = {number(m.gamma0)}$", loc="right", fontsize=7, pad=2)
            ax.ticklabel_format(axis="y", style="sci", scilimits=(-2, 3), useMathText=True)
            ax.margins(y=0.15)
        axes[-1].set_xlabel(r"$\gamma/\gamma_0$")
        axes[len(axes) // 2].set_ylabel(r"$\nu(t)/\eta_0 = N_2/\eta_0\gamma_0\omega$")
