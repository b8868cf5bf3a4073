"""Irreversible dynamics: per-cycle diffusivity in time and against amplitude, the cloud after half a cycle."""

from __future__ import annotations

from contextlib import suppress

import numpy as np

from suspend.analysis.displacements import CyclicDiffusivity, DisplacementCloud
from suspend.errors import ConfigurationError
from suspend.figures.amplitude import curve_table, curves_by, draw_curves, fraction_legend, values_of
from suspend.figures.groups import marker_style
from suspend.figures.panel import Columns, Panel, labelled, stack
from suspend.figures.phase_diagram import best_signatures
from suspend.figures.runs import Member, Runs
from suspend.figures.style import BLUE, MARKERS, log_axis_of, number, say, shades
from suspend.io import Run

FINAL_STRAIN = 256.0  # the paper's


class DiffusivityEvolution(Panel):
    """D_cyc against total strain for every amplitude of one volume fraction, and the cloud after half a cycle."""

    aspect = 1.1

    def __init__(self, runs: Runs, cloud: float = 0.8):
        self.members = runs.amplitudes()
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
        """Curves above; the cloud and the legend below."""
        grid = page.add_gridspec(2, 2, height_ratios=(1.8, 1.0), width_ratios=(1.2, 1.0))
        ax, cloud, key = page.add_subplot(grid[0, :]), page.add_subplot(grid[1, 0]), page.add_subplot(grid[1, 1])
        colours = shades(len(self.members))
        for m, d, colour, marker in zip(self.members, self.diffusivities, colours, MARKERS * 4, strict=False):
            shown = np.where(d.d_cyc > 0.0, d.d_cyc, np.nan)
            few = {"marker": marker} if len(shown) < 30 else {}
            ax.plot(d.total_strain, shown, color=colour, linewidth=0.8, label=number(m.gamma0), **few)
        values = np.concatenate([d.d_cyc for d in self.diffusivities])
        log_axis_of(ax, "x", np.concatenate([d.total_strain for d in self.diffusivities]))
        log_axis_of(ax, "y", values, 1.6)
        if not (values > 0.0).any():
            say(ax, "all displacements are exactly zero")
        ax.set_xlabel(r"total strain $\gamma_\mathrm{tot}$")
        ax.set_ylabel(r"$D_\mathrm{cyc}$")
        key.set_axis_off()
        title = rf"$\gamma_0$ at $\phi = {number(self.members[0].phi)}$"
        columns = {"ncols": -(-len(self.members) // 5), "handlelength": 1.2}
        key.legend(*ax.get_legend_handles_labels(), title=title, title_fontsize=6.5, loc="center", **columns)
        self._draw_cloud(cloud)

    def _draw_cloud(self, ax) -> None:
        ax.set_xlabel(r"$\Delta_x/a$ after half a cycle")
        ax.set_ylabel(r"$\Delta_y/a$")
        if self.cloud is None:
            say(ax, "positions at half\na cycle are\nnot stored")
            ax.set(xticks=[], yticks=[])
            return
        x, y = self.cloud.displacements[:, :2].T
        reach = 1.1 * float(np.max(np.abs([x, y]))) or 1.0
        ax.scatter(x, y, s=2.0, color=BLUE, alpha=0.6, linewidths=0)
        ax.set(xlim=(-reach, reach), ylim=(-reach, reach), aspect="equal")
        ax.locator_params(nbins=3)
        ax.set_title(rf"$\gamma_0 = {number(self.cloud_of.gamma0)}$", fontsize=6.5, pad=2)


def _first_cloud(members: list[Member], gamma0: float) -> tuple[Member | None, DisplacementCloud | None, str]:
    """The cloud of the first half cycle of the run nearest to `gamma0` that stores it; else why there is none."""
    why = ""
    for member in sorted(members, key=lambda m: abs(np.log(m.gamma0 / gamma0))):
        with member.open() as run, suppress(ConfigurationError):
            return member, DisplacementCloud().compute(run), ""
        why = f"{member.path}: run with output.position_phases: [0.0, 0.5]"
    return None, None, why


class FinalDiffusivity(Panel):
    """D_cyc of the last cycle that ends by total strain 256 against amplitude; shaded: the bounds on gamma_c."""

    def __init__(self, runs: Runs):
        self.curves = curves_by(runs, final_diffusivity, "spheres")
        self.signatures = best_signatures(runs)

    def tables(self) -> dict[str, Columns]:
        """phi, far_field, gamma0, D_cyc, error, runs; the ranges of the signatures ("signatures")."""
        ranges = stack([s.table() for s in self.signatures])
        return {"": curve_table(self.curves, "D_cyc"), "signatures": ranges}

    def draw(self, page) -> None:
        """Logarithmic D_cyc."""
        ax = page.subplots()
        draw_curves(ax, self.curves)
        for found in self.signatures:
            colour = marker_style(found.series, self.curves)["color"]
            _, _, shared = found.agreement
            bound = found.bound or shared
            if bound is not None and bound.bracketed:
                ax.axvspan(bound.low, bound.high, color=colour, alpha=0.18 if found.bound else 0.07, linewidth=0)
        log_axis_of(ax, "y", values_of(self.curves), 2.0)
        ax.set_ylabel(r"final $D_\mathrm{cyc}$")
        fraction_legend(ax, self.curves)


def final_diffusivity(path: str, strain: float = FINAL_STRAIN) -> tuple[float, float]:
    """D_cyc of the last cycle that ends at or before total strain `strain`, and its standard error over the spheres.

    That of the first cycle where it ends beyond; NaN where the positions are not stored.
    """
    with Run(path) as run:
        found = CyclicDiffusivity().compute(run)
    if not len(found.d_cyc):
        return float("nan"), float("nan")
    k = max(int(np.searchsorted(found.total_strain, strain * (1 + 1e-9), side="right")) - 1, 0)
    return float(found.d_cyc[k]), float(found.standard_error[k])
