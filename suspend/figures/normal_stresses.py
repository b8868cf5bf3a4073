"""Normal stress differences: averages of N1 and N2, frequency doubling of N2, its Lissajous curves."""

from __future__ import annotations

import math

import numpy as np

from suspend.figures.amplitude import (
    GAMMA0,
    Curves,
    curve_table,
    curves_of,
    draw_curves,
    fraction_legend,
    fraction_style,
)
from suspend.figures.panel import Columns, Panel, labelled, stack
from suspend.figures.runs import Point, Runs
from suspend.figures.style import errors_or_none, log_axis_of, number, shades, zero_lines
from suspend.figures.viscosity import representative

FITTED = 3  # points at the largest amplitudes that the dashed lines are fitted to


class FirstDifference(Panel):
    """Average N1 against amplitude; its hydrodynamic part below."""

    def __init__(self, runs: Runs):
        self.total = curves_of(runs, "N1_nu0")
        self.hydrodynamic = curves_of(runs, "N1_nu0_hydrodynamic")

    def tables(self) -> dict[str, Columns]:
        """N1 and its hydrodynamic part."""
        return {
            "": curve_table(self.total, "N1_mean", "eta0*gamma0*omega"),
            "hydrodynamic": curve_table(self.hydrodynamic, "N1_mean_hydrodynamic", "eta0*gamma0*omega"),
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
        lower.set_ylabel(r"hydrodynamic part")
        fraction_legend(upper, self.total)


class SecondDifference(Panel):
    """Average -N2 (-nu_0/eta0) against amplitude, whole and interparticle part, with lines fitted at the end."""

    def __init__(self, runs: Runs):
        self.total = curves_of(runs, "N2_nu0")
        self.interparticle = curves_of(runs, "N2_nu0_interparticle")
        self.fits = {key: _end_fit(found) for key, found in self.total.items()}

    def tables(self) -> dict[str, Columns]:
        """nu_0 of the whole and of the interparticle stress, and the fitted lines ("fits")."""
        fits = [
            {
                "phi[-]": phi,
                "far_field[bool]": int(far),
                "slope_per_ln_gamma0[eta0]": fit[0],
                "intercept[eta0]": fit[1],
                "zero_at_gamma0[-]": _zero(fit),
            }
            for (phi, far), fit in self.fits.items()
            if fit
        ]
        found = {
            "": curve_table(self.total, "minus_nu0", "eta0") | {},
            "interparticle": curve_table(self.interparticle, "minus_nu0_interparticle", "eta0"),
        }
        for table in found.values():
            for name in table:
                if name.startswith("minus_nu0") and "error" not in name:
                    table[name] = -table[name]
        return found | ({"fits": stack([{k: np.array([v]) for k, v in row.items()} for row in fits])} if fits else {})

    def draw(self, page) -> None:
        """Filled: the entire stress; empty: interparticle."""
        ax = page.subplots()
        zero_lines(ax)
        _draw_parts(ax, self.total, self.interparticle)
        fractions = sorted({phi for phi, _ in self.total})
        for (phi, _), fit in self.fits.items():
            if fit and math.isfinite(_zero(fit)):
                end = max(p.gamma0 for found in self.total.values() for p in found)
                x = np.geomspace(max(_zero(fit), 1e-3), end, 2)
                ax.plot(
                    x,
                    -(fit[0] * np.log(x) + fit[1]),
                    "--",
                    color=fraction_style(phi, fractions)["color"],
                    lw=0.7,
                )
        ax.set_ylabel(r"$-\nu_0/\eta_0 = -\langle N_2\rangle/\eta_0\gamma_0\omega$")
        ax.set_xlabel(GAMMA0)


def _end_fit(found: list[Point]) -> tuple[float, float] | None:
    """Slope and intercept of nu_0 against ln gamma0 over the last points; None for fewer than 3 or no decrease."""
    if len(found) < FITTED:
        return None
    x, y = (np.array([getattr(p, name) for p in found[-FITTED:]]) for name in ("gamma0", "value"))
    slope, intercept = np.polyfit(np.log(x), y, 1)
    return (float(slope), float(intercept)) if slope < 0.0 else None


def _zero(fit: tuple[float, float]) -> float:
    return math.exp(-fit[1] / fit[0])


def _draw_parts(ax, total: Curves, part: Curves) -> None:
    """The whole filled, the part empty, negated; far field or not by the line."""
    from matplotlib.lines import Line2D

    fractions = sorted({phi for phi, _ in total})
    entries = []
    for curves, filled in ((total, True), (part, False)):
        for (phi, far), found in curves.items():
            style = fraction_style(phi, fractions)
            x, y, e = (np.array([getattr(p, n) for p in found], float) for n in ("gamma0", "value", "error"))
            face = style["color"] if filled else "white"
            line = "-" if far else ""
            ax.errorbar(
                x,
                -y,
                yerr=errors_or_none(e),
                markerfacecolor=face,
                linestyle=line,
                lw=0.7,
                elinewidth=0.7,
                **style,
            )
    for phi in fractions:
        entries.append(Line2D([], [], linestyle="", label=rf"$\phi = {number(phi)}$", **fraction_style(phi, fractions)))
    for text, face in (("entire stress", "black"), ("interparticle", "white")):
        entries.append(Line2D([], [], linestyle="", marker="o", color="black", markerfacecolor=face, label=text))
    if len({far for _, far in total}) == 2:
        entries.append(Line2D([], [], color="black", lw=0.7, label="with far field"))
    ax.legend(handles=entries, loc="upper left")
    log_axis_of(ax, "x", [p.gamma0 for found in total.values() for p in found], 1.35)
    ax.margins(y=0.12)


class Doubling(Panel):
    """|nu_4|/|nu_2| of N2 against amplitude; that of the hydrodynamic part below."""

    def __init__(self, runs: Runs):
        self.total = _ratio(curves_of(runs, "N2_nu4_abs"), curves_of(runs, "N2_nu2_abs"))
        tail = "_hydrodynamic"
        self.hydrodynamic = _ratio(curves_of(runs, "N2_nu4_abs" + tail), curves_of(runs, "N2_nu2_abs" + tail))

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
            ax.axhline(1.0, color="#999999", linewidth=0.4, zorder=0)
            log_axis_of(ax, "y", [p.value for found in curves.values() for p in found], 2.0)
        upper.set_xlabel("")
        upper.set_ylabel(r"$|\nu_4|/|\nu_2|$")
        lower.set_ylabel("hydrodynamic part")
        fraction_legend(upper, self.total)


def _ratio(above: Curves, below: Curves) -> Curves:
    """Quotients of two curves point by point, errors added in squares."""
    found = {}
    for key, tops in above.items():
        rows = []
        for p, q in zip(tops, below[key], strict=True):
            if q.value > 0.0:
                value = p.value / q.value
                error = abs(value) * math.hypot(p.error / p.value if p.value else 0.0, q.error / q.value)
                rows.append(Point(p.gamma0, value, error, p.runs))
        found[key] = rows
    return found


class SecondLissajous(Panel):
    """N2 against strain in the last cycle, for three amplitudes of one volume fraction; arrows give the direction."""

    def __init__(self, runs: Runs):
        self.members = representative(runs)

    def tables(self) -> dict[str, Columns]:
        """Strain and N2 over the last cycle."""
        parts = []
        for m in self.members:
            wave = m.analysis.waveforms[max(m.analysis.waveforms)]
            columns = {"strain[gamma0]": wave["strain"], "N2[eta0*gamma0*omega]": wave["N2"]}
            parts.append(labelled({"phi[-]": m.phi, "gamma0[-]": m.gamma0}, columns))
        return {"": stack(parts)}

    def draw(self, page) -> None:
        """One axes for each amplitude, as their scales differ."""
        axes = page.subplots(len(self.members), 1, sharex=True, squeeze=False)[:, 0]
        for m, ax, colour in zip(self.members, axes, shades(len(self.members)), strict=True):
            wave = m.analysis.waveforms[max(m.analysis.waveforms)]
            x, y = (np.append(wave[name], wave[name][0]) for name in ("strain", "N2"))
            zero_lines(ax, vertical=True)
            ax.plot(x, y, color=colour)
            for start in (0, len(x) // 2):
                step = max(len(x) // 32, 1)
                ends = {"xy": (x[start + step], y[start + step]), "xytext": (x[start], y[start])}
                ax.annotate(
                    "",
                    **ends,
                    arrowprops={"arrowstyle": "-|>", "color": colour, "lw": 0.8, "mutation_scale": 7},
                )
            ax.set_title(rf"$\gamma_0 = {number(m.gamma0)}$", loc="right", fontsize=7, pad=2)
            ax.ticklabel_format(axis="y", style="sci", scilimits=(-2, 3), useMathText=True)
            ax.margins(y=0.15)
        axes[-1].set_xlabel(r"$\gamma/\gamma_0$")
        axes[len(axes) // 2].set_ylabel(r"$\nu(t)/\eta_0 = N_2/\eta_0\gamma_0\omega$")
