"""Viscosity: its evolution and Lissajous curves, its steady value and shear thinning against amplitude."""

from __future__ import annotations

import numpy as np

from suspend.figures.amplitude import AgainstAmplitude, curve_table, curves_of, draw_curves, fraction_legend
from suspend.figures.panel import Columns, Panel, labelled, stack
from suspend.figures.runs import Runs, oscillatory
from suspend.figures.style import MARKERS, log_axis_of, number, shades, zero_lines

RATE = r"$\dot\gamma/\gamma_0\omega$"
REPRESENTATIVE = (0.2, 0.8, 3.2)  # amplitudes of the paper's Lissajous curves


def representative(runs: Runs, phi: float | None = 0.40, most: int = 3) -> list:
    """At most three runs of one volume fraction: those nearest to the amplitudes 0.2, 0.8 and 3.2."""
    members = oscillatory(runs).amplitudes(phi)
    if len(members) <= most:
        return members
    chosen = []
    for wanted in REPRESENTATIVE:
        left = [m for m in members if m not in chosen]
        chosen.append(min(left, key=lambda m: abs(np.log(m.gamma0 / wanted))))
    return sorted(chosen, key=lambda m: m.gamma0)


def half_cycle(wave: dict, name: str) -> tuple[np.ndarray, np.ndarray]:
    """Rate and a signal over the half cycle of positive rate, in the order of time."""
    forward = np.flatnonzero(wave["rate"] >= -1e-9)
    gap = np.flatnonzero(np.diff(forward) > 1)
    order = np.roll(forward, -(gap[0] + 1)) if gap.size else forward  # begins where the rate turns positive
    return wave["rate"][order], wave[name][order]


class ViscosityEvolution(Panel):
    """eta_r' and eta_r'' of every cycle against total strain; viscous response in the last half cycle below."""

    def __init__(self, runs: Runs):
        self.members = representative(runs)
        self.phi = self.members[0].phi

    def tables(self) -> dict[str, Columns]:
        """The evolution, and the last half cycles ("lissajous")."""
        evolution, loops = [], []
        for m in self.members:
            constants = {"phi[-]": m.phi, "gamma0[-]": m.gamma0}
            a = m.analysis
            columns = {"total_strain[-]": a.total_strain, "eta_r_prime[-]": a["eta_r_prime"]}
            evolution.append(labelled(constants, columns | {"eta_r_double_prime[-]": a["eta_r_double_prime"]}))
            rate, shear = half_cycle(a.waveforms[max(a.waveforms)], "shear")
            loops.append(labelled(constants, {"rate[gamma0*omega]": rate, "sigma_xy[eta0*gamma0*omega]": shear}))
        return {"": stack(evolution), "lissajous": stack(loops)}

    def draw(self, page) -> None:
        """Evolution above, the half cycles below."""
        grid = page.add_gridspec(2, 1, height_ratios=(1.55, 1.0))
        ax = page.add_subplot(grid[0])
        low = page.add_subplot(grid[1])
        colours = shades(len(self.members))
        strains = []
        for m, colour, marker in zip(self.members, colours, MARKERS, strict=False):
            a = m.analysis
            every = max(len(a.values) // 12, 1)
            for column, face in (("eta_r_prime", colour), ("eta_r_double_prime", "white")):
                ax.plot(
                    a.total_strain,
                    a[column],
                    color=colour,
                    marker=marker,
                    markevery=_spread(a.total_strain, every),
                    markerfacecolor=face,
                    linewidth=0.8,
                )
            low.plot(*half_cycle(a.waveforms[max(a.waveforms)], "shear"), color=colour, label=number(m.gamma0))
            strains += [a.total_strain[0], a.total_strain[-1]]
        log_axis_of(ax, "x", strains)
        self._label(ax, low)

    def _label(self, ax, low) -> None:
        zero_lines(ax)
        ax.set_xlabel(r"total strain $\gamma_\mathrm{tot}$")
        ax.set_ylabel(r"$\eta_r^\prime$ (filled), $\eta_r^{\prime\prime}$ (empty)")
        ax.margins(y=0.1)
        zero_lines(low, vertical=True)
        low.set_xlim(-0.04, 1.04)
        low.set_xlabel(RATE)
        low.set_ylabel(r"$\sigma_{xy}/\eta_0\gamma_0\omega$")
        low.legend(title=rf"$\gamma_0$ at $\phi = {number(self.phi)}$", title_fontsize=6.5, loc="upper left")


def _spread(strain: np.ndarray, every: int) -> list[int]:
    """About a dozen indices, evenly spaced on the logarithmic axis."""
    if every == 1:
        return list(range(len(strain)))
    wanted = np.geomspace(strain[0], strain[-1], 12)
    return sorted({int(i) for i in np.searchsorted(strain, wanted * (1 - 1e-9)) if i < len(strain)})


class SteadyViscosity(AgainstAmplitude):
    """Steady-state eta_r' against amplitude."""

    column = "eta_r_prime"
    label = r"$\eta_r^\prime$"

    def draw(self, page) -> None:
        """On a logarithmic axis where the fractions differ much."""
        super().draw(page)
        values = [p.value for found in self.curves.values() for p in found]
        if values and min(values) > 0 and max(values) > 4.0 * min(values):
            log_axis_of(page.axes[0], "y", values, 1.2)


class Thinning(AgainstAmplitude):
    """-eta_3'/eta_1' against amplitude; higher fractions are shifted up by 0.05 each, as in the paper."""

    shift = 0.05

    def __init__(self, runs: Runs):
        self.curves = curves_of(runs, "minus_eta3_over_eta1")
        fractions = sorted({phi for phi, _ in self.curves})
        self.shifts = {phi: i * self.shift for i, phi in enumerate(fractions)}

    def tables(self) -> dict[str, Columns]:
        """Without the shift."""
        return {"": curve_table(self.curves, "minus_eta3_over_eta1")}

    def draw(self, page) -> None:
        """A thin line at each fraction's zero."""
        ax = page.subplots()
        draw_curves(ax, self.curves, self.shifts)
        for zero in self.shifts.values():
            ax.axhline(zero, color="#999999", linewidth=0.4, zorder=0)
        label = r"$-\eta_3^\prime/\eta_1^\prime$"
        ax.set_ylabel(label + (rf" (shifted by {self.shift} each)" if len(self.shifts) > 1 else ""))
        ax.margins(y=0.12)
        fraction_legend(ax, self.curves)
