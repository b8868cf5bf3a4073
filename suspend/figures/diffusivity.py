"""Irreversible dynamics: per-cycle diffusivity in time and against amplitude, the cloud after half a cycle."""

from __future__ import annotations

from contextlib import suppress

import numpy as np

from suspend.analysis.displacements import CyclicDiffusivity, DisplacementCloud
from suspend.errors import ConfigurationError
from suspend.figures.amplitude import Curves, curve_table, draw_curves, fraction_legend
from suspend.figures.panel import Columns, Panel, labelled, stack
from suspend.figures.runs import Member, Point, Runs, oscillatory
from suspend.figures.style import MARKERS, log_axis_of, number, say, shades

FINAL_STRAIN = 256.0  # the paper's


class DiffusivityEvolution(Panel):
    """D_cyc against total strain for every amplitude of one volume fraction, and the cloud after half a cycle."""

    aspect = 1.1

    def __init__(self, runs: Runs, phi: float = 0.40, cloud: float = 0.8):
        self.members = oscillatory(runs).amplitudes(phi)
        self.diffusivities = []
        for member in self.members:
            with member.open() as run:
                self.diffusivities.append(CyclicDiffusivity().compute(run))
        self.cloud_of, self.cloud, self.missing = _first_cloud(self.members, cloud)

    def tables(self) -> dict[str, Columns]:
        """The evolution; the cloud ("dispersion") where half-cycle positions are stored."""
        parts = [
            labelled({"phi[-]": m.phi, "gamma0[-]": m.gamma0}, d.table())
            for m, d in zip(self.members, self.diffusivities, strict=True)
        ]
        found = {"": stack(parts)}
        if self.cloud is not None:
            constants = {"phi[-]": self.cloud_of.phi, "gamma0[-]": self.cloud_of.gamma0}
            found["dispersion"] = labelled(constants, self.cloud.table())
        return found

    def draw(self, page) -> None:
        """Curves with their amplitudes at the end; the cloud below."""
        grid = page.add_gridspec(2, 1, height_ratios=(1.8, 1.0))
        ax = page.add_subplot(grid[0])
        colours = shades(len(self.members))
        for m, d, colour, marker in zip(self.members, self.diffusivities, colours, MARKERS * 4, strict=False):
            shown = np.where(d.d_cyc > 0.0, d.d_cyc, np.nan)
            few = {"marker": marker} if len(shown) < 40 else {}
            ax.plot(d.total_strain, shown, color=colour, linewidth=0.8, label=number(m.gamma0), **few)
        log_axis_of(ax, "x", np.concatenate([d.total_strain for d in self.diffusivities]))
        log_axis_of(ax, "y", np.concatenate([d.d_cyc for d in self.diffusivities]), 1.6)
        ax.set_xlabel(r"total strain $\gamma_\mathrm{tot}$")
        ax.set_ylabel(r"$D_\mathrm{cyc}$")
        ax.legend(title=r"$\gamma_0$", title_fontsize=6.5, ncols=2 if len(self.members) > 4 else 1, loc="lower left")
        self._draw_cloud(page.add_subplot(grid[1]))

    def _draw_cloud(self, ax) -> None:
        ax.set_xlabel(r"$\Delta_x/a$ after half a cycle")
        ax.set_ylabel(r"$\Delta_y/a$")
        if self.cloud is None:
            say(ax, "positions at half a cycle\nare not stored")
            ax.set_xticks([])
            ax.set_yticks([])
            return
        x, y = self.cloud.displacements[:, :2].T
        reach = 1.1 * float(np.max(np.abs([x, y]))) or 1.0
        ax.scatter(x, y, s=2.0, color="#0072B2", alpha=0.6, linewidths=0)
        ax.set(xlim=(-reach, reach), ylim=(-reach, reach), aspect="equal")
        ax.text(
            1.06,
            0.98,
            rf"$\gamma_0 = {number(self.cloud_of.gamma0)}$",
            transform=ax.transAxes,
            va="top",
            fontsize=6.5,
        )


def _first_cloud(members: list[Member], gamma0: float) -> tuple[Member | None, DisplacementCloud | None, str]:
    """The cloud of the first half cycle of the run nearest to `gamma0` that stores it; else why there is none."""
    why = ""
    for member in sorted(members, key=lambda m: abs(np.log(m.gamma0 / gamma0))):
        with member.open() as run, suppress(ConfigurationError):
            return member, DisplacementCloud().compute(run), ""
        why = f"{member.path}: run with output.position_phases: [0.0, 0.5]"
    return None, None, why


def final_diffusivity(member: Member, strain: float = FINAL_STRAIN) -> tuple[float, float]:
    """D_cyc of the cycle that ends at or before total strain `strain` (or of the last), and its standard error."""
    with member.open() as run:
        found = CyclicDiffusivity().compute(run)
    if not len(found.d_cyc):
        return float("nan"), float("nan")
    k = max(int(np.searchsorted(found.total_strain, strain * (1 + 1e-9), side="right")) - 1, 0)
    return float(found.d_cyc[k]), float(found.standard_error[k])


class FinalDiffusivity(Panel):
    """D_cyc at total strain 256 (or at the end of shorter runs) against amplitude."""

    def __init__(self, runs: Runs):
        self.curves: Curves = {}
        for key, groups in oscillatory(runs).families().items():
            self.curves[key] = [_mean_point(group) for group in groups]

    def tables(self) -> dict[str, Columns]:
        """phi, far_field, gamma0, D_cyc, error, runs."""
        return {"": curve_table(self.curves, "D_cyc")}

    def draw(self, page) -> None:
        """Logarithmic D_cyc."""
        ax = page.subplots()
        draw_curves(ax, self.curves)
        log_axis_of(ax, "y", np.array([p.value for found in self.curves.values() for p in found]), 2.0)
        ax.set_ylabel(r"final $D_\mathrm{cyc}$")
        fraction_legend(ax, self.curves)


def _mean_point(group: list[Member]) -> Point:
    values, errors = np.array([final_diffusivity(m) for m in group]).T
    error = values.std(ddof=1) / np.sqrt(len(values)) if len(values) > 1 else errors[0]
    return Point(group[0].gamma0, float(values.mean()), float(error), len(values))
