"""Viscosity: its evolution and Lissajous curves, its steady value and shear thinning against amplitude."""

from __future__ import annotations

import numpy as np

from suspend.analysis.lissajous import Lissajous
from suspend.analysis.moduli import Moduli
from suspend.figures.amplitude import (
    AgainstAmplitude,
    curve_table,
    curves_of,
    draw_curves,
    fraction_legend,
    values_of,
)
from suspend.figures.panel import Columns, Panel, labelled, stack
from suspend.figures.runs import Member, Runs, cycles_of
from suspend.figures.style import GREY, MARKERS, log_axis_of, number, shades, zero_lines

REPRESENTATIVE = (0.2, 0.8, 3.2)  # amplitudes of the paper's Lissajous curves


def representative(runs: Runs) -> list[Member]:
    """At most three runs at the paper's volume fraction: those nearest to the amplitudes 0.2, 0.8 and 3.2."""
    members = runs.amplitudes()
    if len(members) <= len(REPRESENTATIVE):
        return members
    chosen: list[Member] = []
    for wanted in REPRESENTATIVE:
        left = [m for m in members if m not in chosen]
        chosen.append(min(left, key=lambda m: abs(np.log(m.gamma0 / wanted))))
    return sorted(chosen, key=lambda m: m.gamma0)


def half_cycle(curve: Lissajous) -> tuple[np.ndarray, np.ndarray]:
    """Rate and shear stress over the half cycle of positive rate, in the order of time."""
    rate, shear = curve.signal("rate"), curve.signal("shear")
    forward = np.flatnonzero(rate >= -1e-9)
    gap = np.flatnonzero(np.diff(forward) > 1)
    order = np.roll(forward, -(gap[0] + 1)) if gap.size else forward  # begins where the rate turns positive
    return rate[order], shear[order]


class ViscosityEvolution(Panel):
    """eta_r' and eta_r'' of every cycle against total strain; the response in the last half cycle below."""

    def __init__(self, runs: Runs):
        self.members, self.moduli, self.loops = representative(runs), [], []
        for member in self.members:
            with member.open() as run:
                cycles_of(run, member.path)
                self.moduli.append(Moduli().compute(run))
                self.loops.append(half_cycle(Lissajous(1).compute(run)))

    def tables(self) -> dict[str, Columns]:
        """The moduli of every cycle, and the last half cycles ("lissajous")."""
        evolution, loops = [], []
        for m, moduli, (rate, shear) in zip(self.members, self.moduli, self.loops, strict=True):
            constants = {"phi[-]": m.phi, "gamma0[-]": m.gamma0}
            names = ("total_strain[-]", "eta_r_prime[-]", "eta_r_double_prime[-]")
            table = moduli.table()
            evolution.append(labelled(constants, {name: table[name] for name in names}))
            loops.append(labelled(constants, {"rate[gamma0*omega]": rate, "sigma_xy[eta0*gamma0*omega]": shear}))
        return {"": stack(evolution), "lissajous": stack(loops)}

    def draw(self, page) -> None:
        """Evolution above, the half cycles below."""
        ax, low = page.subplots(2, 1, height_ratios=(1.55, 1.0))
        for m, moduli, loop, colour, marker in zip(
            self.members, self.moduli, self.loops, shades(len(self.members)), MARKERS, strict=False
        ):
            strain = moduli.total_strain
            shown = {"color": colour, "marker": marker, "markevery": _spread(strain), "linewidth": 0.8}
            ax.plot(strain, moduli.eta_r_prime, **shown)
            ax.plot(strain, moduli.eta_r_double_prime, markerfacecolor="white", **shown)
            low.plot(*loop, color=colour, label=number(m.gamma0))
        log_axis_of(ax, "x", np.concatenate([m.total_strain for m in self.moduli]))
        zero_lines(ax)
        ax.set_xlabel(r"total strain $\gamma_\mathrm{tot}$")
        ax.set_ylabel(r"$\eta_r^\prime$ (filled), $\eta_r^{\prime\prime}$ (empty)")
        ax.margins(y=0.1)
        zero_lines(low, vertical=True)
        low.set_xlim(-0.04, 1.04)
        low.margins(y=0.1)
        low.set_xlabel(r"$\dot\gamma/\gamma_0\omega$, last half cycle")
        low.set_ylabel(r"$\sigma_{xy}/\eta_0\gamma_0\omega$")
        title = rf"$\gamma_0$ at $\phi = {number(self.members[0].phi)}$"
        low.legend(title=title, title_fontsize=6.5, loc="upper left")


def _spread(strain: np.ndarray, most: int = 12) -> list[int]:
    """At most a dozen indices, evenly spaced on the logarithmic axis."""
    if len(strain) <= most:
        return list(range(len(strain)))
    wanted = np.geomspace(strain[0], strain[-1], most)
    return sorted({int(i) for i in np.searchsorted(strain, wanted * (1.0 - 1e-9)) if i < len(strain)})


class SteadyViscosity(AgainstAmplitude):
    """Steady-state eta_r' against amplitude."""

    quantity = "eta_r_prime"
    label = r"$\eta_r^\prime$"

    def scale(self, ax) -> None:
        """Logarithmic where the fractions differ much."""
        values = values_of(self.curves)
        if values.size and values.min() > 0.0 and values.max() > 2.5 * values.min():
            log_axis_of(ax, "y", values, 1.1)


class Thinning(Panel):
    """-eta_3'/eta_1' against amplitude; each higher fraction is shifted up by 0.05, as in the paper."""

    shift = 0.05

    def __init__(self, runs: Runs):
        self.curves = curves_of(runs, "minus_eta3_over_eta1")
        fractions = sorted({c.phi for c in self.curves})
        self.shifts = {phi: i * self.shift for i, phi in enumerate(fractions)}

    def tables(self) -> dict[str, Columns]:
        """Without the shift."""
        return {"": curve_table(self.curves, "minus_eta3_over_eta1")}

    def draw(self, page) -> None:
        """With a thin line at each fraction's zero."""
        ax = page.subplots()
        draw_curves(ax, self.curves, self.shifts)
        for zero in self.shifts.values():
            ax.axhline(zero, color=GREY, linewidth=0.4, zorder=0)
        shifted = rf" (shifted by {self.shift} each)" if len(self.shifts) > 1 else ""
        ax.set_ylabel(r"$-\eta_3^\prime/\eta_1^\prime$" + shifted)
        ax.margins(y=0.12)
        fraction_legend(ax, self.curves)
