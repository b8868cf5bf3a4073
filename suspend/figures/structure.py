"""Microstructure at the start and at the end of a run: clusters, neighbours, density fluctuations, pairs."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from suspend.analysis.microstructure import (
    BetaFit,
    NearestNeighbourGraph,
    NeighbourDistances,
    NumberVariance,
    PairDistribution,
    ShearPlaneDistribution,
    StructureFactor,
    compute_together,
    first,
    last,
    spaced,
)
from suspend.errors import ConfigurationError
from suspend.figures.panel import Columns, Panel, labelled, stack
from suspend.figures.runs import Member, Runs, oscillatory
from suspend.figures.style import BLACK, BLUE, GREY, MARKERS, ORANGE, log_axis_of, number

if TYPE_CHECKING:
    from matplotlib.axes import Axes

CRITICAL = 0.8  # amplitude of the paper's figures of the microstructure, at phi = 0.40
STATES = (("initial", BLUE), ("final", ORANGE))
_UNRESOLVED = 0.5  # error of beta_infinity above which a fit says nothing
_FINAL = 8  # cycle starts that make the final state


def at_the_ends(member: Member, make, kind: str) -> tuple:
    """`make(frames)` of the initial configuration and of the last cycle starts. Raises ConfigurationError."""
    with member.open() as run:
        if run.cycles < 1:
            raise ConfigurationError(f"{member.path}: {kind} needs a complete cycle, none is stored yet")
        found = make(first(1)), make(last(min(_FINAL, run.cycles)))
        compute_together(run, found)
    return found


def two_states(member: Member, tables: list[Columns]) -> Columns:
    """Tables of the initial and the final state below one another."""
    constants = {"phi[-]": member.phi, "gamma0[-]": member.gamma0}
    return stack(
        [labelled({**constants, "state": name}, table) for (name, _), table in zip(STATES, tables, strict=True)]
    )


def title_of(member: Member, lines: int = 1) -> str:
    """phi, gamma0 and N of the run, in one line or two."""
    first = rf"$\phi = {number(member.phi)}$, $\gamma_0 = {number(member.gamma0)}$"
    return first + (", " if lines == 1 else "\n") + rf"$N = {member.number}$"


def keyed(ax: Axes, member: Member, **where) -> None:
    """A legend under the parameters of the run."""
    ax.legend(title=title_of(member, 2), title_fontsize=6.5, alignment="left", **where)


class Clusters(Panel):
    """Sizes and shapes of the clusters of the nearest-neighbour graph, initial above, final below."""

    aspect = 1.7

    def __init__(self, runs: Runs):
        self.member = oscillatory(runs).nearest(CRITICAL)
        self.graphs = at_the_ends(self.member, NearestNeighbourGraph, "the nearest-neighbour graph")

    def tables(self) -> dict[str, Columns]:
        """Shares by size; probability density of the shape factor ("shapes")."""
        return {
            "": two_states(self.member, [g.table() for g in self.graphs]),
            "shapes": two_states(self.member, [g.shape_table() for g in self.graphs]),
        }

    def draw(self, page) -> None:
        """Bars; the doublet at distance 2.1 a is marked."""
        axes = page.subplots(2, 2, sharex="col", sharey="col")
        for (name, colour), graph, (left, right) in zip(STATES, self.graphs, axes, strict=True):
            size, share = graph.size_distribution
            left.bar(size, share, width=0.85, color=colour, linewidth=0)
            middle, density = graph.shape_distribution
            right.bar(middle, density, width=graph.width, color=colour, linewidth=0)
            right.axvline(1.938, color=GREY, linewidth=0.6, linestyle=":", zorder=3)
            left.text(0.95, 0.92, name, transform=left.transAxes, ha="right", va="top")
            left.set_ylabel("share of clusters")
            right.set_ylabel("density")
        axes[0, 0].set_xlim(1.0, max(g.sizes.max() for g in self.graphs) + 1.0)
        axes[0, 1].text(
            1.938, 0.98, " doublet\n at 2.1 a", transform=axes[0, 1].get_xaxis_transform(), fontsize=6, va="top"
        )
        axes[0, 1].set_title(title_of(self.member), loc="right", fontsize=6, pad=2)
        axes[1, 0].set_xlabel("cluster size")
        axes[1, 1].set_xlabel("shape factor")


class NeighbourDistance(Panel):
    """Mean distance to the k-th nearest neighbour, initial and final."""

    def __init__(self, runs: Runs):
        self.member = oscillatory(runs).nearest(CRITICAL)
        self.distances = at_the_ends(self.member, NeighbourDistances, "the distance to neighbours")

    def tables(self) -> dict[str, Columns]:
        """k and the distance."""
        return {"": two_states(self.member, [d.table() for d in self.distances])}

    def draw(self, page) -> None:
        """Squares initial, circles final, as in the paper."""
        ax = page.subplots()
        for (name, colour), found, marker in zip(STATES, self.distances, "so", strict=True):
            ax.plot(found.k, found.distance, marker + "-", color=colour, label=name, linewidth=0.7)
        ax.set(xlabel=r"$k$", ylabel=r"$\langle r_k\rangle/a$")
        ax.margins(y=0.1)
        keyed(ax, self.member, loc="upper left")


class NumberVarianceExponent(Panel):
    """Exponent beta of the number variance against total strain, with the fit of the paper's equation (8)."""

    def __init__(self, runs: Runs):
        self.member = max([m for m in oscillatory(runs) if _equals(m, runs.nearest(CRITICAL))], key=lambda m: m.number)
        with self.member.open() as run:
            self.variance = NumberVariance(spaced(24)).compute(run)
        self.fit = _resolved_fit(self.variance)

    def tables(self) -> dict[str, Columns]:
        """beta and its error by total strain; sigma_n^2(r) at the ends; the fit where there is one."""
        constants = {"phi[-]": self.member.phi, "gamma0[-]": self.member.gamma0, "N[-]": self.member.number}
        table = self.variance.table()
        if self.fit is not None:
            table["beta_fit[-]"] = np.asarray(self.fit(self.variance.total_strain))
        found = {"": labelled(constants, table), "variance": labelled(constants, self.variance.variance_table())}
        if self.fit is not None:
            values = {f"{name}[-]": np.array([value]) for name, value in self.fit._asdict().items()}
            found["fit"] = labelled(constants, values)
        return found

    def draw(self, page) -> None:
        """Against 1 + gamma_tot, logarithmic, so that the initial state shows."""
        ax = page.subplots()
        strain = 1.0 + self.variance.total_strain
        ax.errorbar(
            strain, self.variance.beta, self.variance.error, fmt="o", color=BLUE, markersize=2.5, elinewidth=0.6
        )
        if self.fit is not None:
            x = np.geomspace(1.0, strain.max(), 200)
            label = rf"$\nu = {self.fit.nu:.2f}$" + "\n" + rf"$\beta_\infty = {self.fit.beta_inf:.2f}$"
            ax.plot(x, self.fit(x - 1.0), "--", color=BLACK, linewidth=0.8, label=label)
        else:
            ax.plot([], [], " ", label="no decay resolved")
        log_axis_of(ax, "x", strain)
        ax.set(xlabel=r"$1 + \gamma_\mathrm{tot}$", ylabel=r"$\beta$")
        low, high = ax.get_ylim()
        ax.set_ylim(low, high + 0.45 * (high - low))  # room for the legend
        keyed(ax, self.member, loc="upper right")


def _resolved_fit(variance: NumberVariance) -> BetaFit | None:
    """The fit of beta(gamma_tot), unless it says nothing: no decay, or beta_infinity uncertain by more than 0.5."""
    try:
        fit = variance.fit()
    except ConfigurationError:
        return None
    return fit if fit.nu < 0.0 and fit.beta_inf_error < _UNRESOLVED and fit.beta_inf < fit.beta0 else None


def _equals(a: Member, b: Member) -> bool:
    """Same amplitude and volume fraction."""
    return bool(np.isclose(a.gamma0, b.gamma0) and np.isclose(a.phi, b.phi, rtol=1e-3))


class Pairs(Panel):
    """g(r), initial and final."""

    def __init__(self, runs: Runs):
        self.member = oscillatory(runs).nearest(CRITICAL)
        self.found = at_the_ends(self.member, PairDistribution, "g(r)")

    def tables(self) -> dict[str, Columns]:
        """r, g and its error."""
        return {"": two_states(self.member, [g.table() for g in self.found])}

    def draw(self, page) -> None:
        """Steps, the first peaks marked."""
        ax = page.subplots()
        for (name, colour), found in zip(STATES, self.found, strict=True):
            ax.step(found.r, found.g, where="mid", color=colour, label=name, linewidth=0.9)
        ax.axhline(1.0, color=GREY, linewidth=0.4, zorder=0)
        ax.set(xlabel=r"$r/a$", ylabel=r"$g(r)$", xlim=(1.8, None), ylim=(0.0, None))
        keyed(ax, self.member)


class ShearPlane(Panel):
    """g(x, y) in the shear plane at the end of the run."""

    def __init__(self, runs: Runs):
        self.member = oscillatory(runs).nearest(CRITICAL)
        _, self.final = at_the_ends(self.member, lambda f: ShearPlaneDistribution(f, width=0.2), "g in the shear plane")

    def tables(self) -> dict[str, Columns]:
        """x, y, g."""
        return {"": labelled({"phi[-]": self.member.phi, "gamma0[-]": self.member.gamma0}, self.final.table())}

    def draw(self, page) -> None:
        """The map with its colour bar."""
        ax = page.subplots()
        self.final.plot(ax)


class Scattering(Panel):
    """Structure factor S(q), initial and final, down to the smallest wave number of the cell."""

    def __init__(self, runs: Runs):
        self.member = oscillatory(runs).nearest(CRITICAL)
        self.found = at_the_ends(self.member, StructureFactor, "S(q)")

    def tables(self) -> dict[str, Columns]:
        """q, S and its error."""
        return {"": two_states(self.member, [s.table() for s in self.found])}

    def draw(self, page) -> None:
        """Both logarithmic."""
        ax = page.subplots()
        for (name, colour), found, marker in zip(STATES, self.found, MARKERS, strict=False):
            ax.errorbar(
                found.q,
                found.s,
                found.error,
                color=colour,
                marker=marker,
                markersize=2,
                linewidth=0.6,
                elinewidth=0.4,
                label=name,
            )
        log_axis_of(ax, "x", np.concatenate([f.q for f in self.found]))
        log_axis_of(ax, "y", np.concatenate([f.s for f in self.found]), 1.6)
        ax.set(xlabel=r"$qa$", ylabel=r"$S(q)$")
        keyed(ax, self.member)
