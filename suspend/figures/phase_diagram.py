"""Bounds on the critical amplitude from the rheological signatures, against volume fraction."""

from __future__ import annotations

import numpy as np

from suspend.analysis.collection import Series
from suspend.analysis.phase_diagram import PhaseDiagram, experimental_fit
from suspend.analysis.signatures import Signatures
from suspend.figures.groups import family, far_field_entries, filling, group_entries, marker_style, short_setup
from suspend.figures.panel import Columns, Panel, stack
from suspend.figures.runs import Runs
from suspend.figures.style import BLACK, BLUE, GREY

LEAST_FRACTIONS = 3  # volume fractions that a power law is fitted through
BESIDE = 0.01  # volume fraction between the bars of two setups


def best_signatures(runs: Runs) -> list[Signatures]:
    """Signatures of the series with the most amplitudes, then runs, at each volume fraction."""
    best: dict[float, Series] = {}
    for series in runs.collection.series:
        if series.phi not in best or _size(series) > _size(best[series.phi]):
            best[series.phi] = series
    return [Signatures().compute(series) for series in best.values()]


def _size(series: Series) -> tuple[int, int]:
    return len(series.groups), int(series.runs.sum())


class TransitionDiagram(Panel):
    """Bounds on gamma_c against volume fraction, and the fit to experiments 0.14 phi^-1.93.

    Filled with far field, empty without, as the paper draws its points; setups stand a little beside each other.
    """

    def __init__(self, runs: Runs):
        self.diagram = PhaseDiagram().compute(runs.collection)
        self.series = [s.series for s in self.diagram.signatures]
        setups = sorted({s.setup for s in self.series})
        laws = {setup: self.diagram.power_law(setup) for setup in setups}
        self.laws = {k: law for k, law in laws.items() if law and law["volume_fractions"] >= LEAST_FRACTIONS}
        self.several = len({family(s)[1] for s in self.series}) > 1
        self.shifts = {setup: BESIDE * (i - 0.5 * (len(setups) - 1)) for i, setup in enumerate(setups)}

    def tables(self) -> dict[str, Columns]:
        """Bounds and the experimental fit; power laws through the bounds ("fits") of three volume fractions or more."""
        rows = [
            {
                "setup": np.array([setup]),
                "exponent[-]": np.array([law["exponent"]]),
                "exponent_low[-]": np.array(law["exponent_interval"][:1]),
                "exponent_high[-]": np.array(law["exponent_interval"][1:]),
                "prefactor[-]": np.array([law["prefactor"]]),
                "prefactor_low[-]": np.array(law["prefactor_interval"][:1]),
                "prefactor_high[-]": np.array(law["prefactor_interval"][1:]),
            }
            for setup, law in self.laws.items()
        ]
        return {"": self.diagram.table()} | ({"fits": stack(rows)} if rows else {})

    def draw(self, page) -> None:
        """Bars from bound to bound; crosses join the interval most signatures share where there is no bound."""
        ax = page.subplots()
        marks: dict[str, object] = {}
        for signatures in self.diagram.signatures:
            self._draw_bound(ax, signatures, marks)
        phi = self.diagram.phi
        grid = np.linspace(min(phi.min() - 0.03, 0.25), max(phi.max() + 0.03, 0.55), 100)
        (pine,) = ax.plot(grid, experimental_fit(grid), "--", color=BLACK, linewidth=0.8, label=r"$0.14\,\phi^{-1.93}$")
        lines = [pine, *self._draw_laws(ax, grid)]
        if not marks:
            missing = "no closed bound:\ngive more amplitudes"
            ax.text(0.05, 0.18, missing, transform=ax.transAxes, color=GREY, fontsize=7.0)
        ax.set(xlabel=r"volume fraction $\phi$", ylabel=r"$\gamma_c$", ylim=(0.0, None))
        ax.text(0.05, 0.06, "reversible", transform=ax.transAxes, color=GREY)
        ax.text(0.95, 0.42, "irreversible", transform=ax.transAxes, color=GREY, ha="right")
        marks.pop("bound", None)  # the setups' entries say it, or there is nothing else
        groups = group_entries(self.series) if self.several else []
        ax.legend(handles=[*lines, *groups, *far_field_entries(self.series), *marks.values()], loc="upper right")

    def _draw_bound(self, ax, signatures: Signatures, marks: dict[str, object]) -> None:
        """Draw one bound, with a thin bar over what resampled seeds give; adds a legend entry of each kind of mark."""
        _, _, shared = signatures.agreement
        found, series = signatures.bound or shared, signatures.series
        if found is None or not found.bracketed:
            return
        x, ends, style = series.phi + self.shifts[series.setup], [found.low, found.high], self._style(series)
        if not signatures.bound:
            style |= {"marker": "x", "linestyle": ":", "label": "most signatures"}
            (marks["shared"],) = ax.plot([x, x], ends, **style)
            return
        (marks["bound"],) = ax.plot([x, x], ends, **style)
        seeds = signatures.confidence("gamma_c")
        if seeds is not None and np.isfinite([seeds["low"], seeds["high"]]).all():
            thin = {"color": BLACK, "linewidth": 0.5, "marker": "_", "markersize": 6, "label": "95 % over seeds"}
            (marks["seeds"],) = ax.plot([x, x], [seeds["low"], seeds["high"]], **thin)

    def _style(self, series: Series) -> dict:
        """One colour where the volume fractions tell all apart, else that of each group."""
        if self.several:
            return marker_style(series, self.series)
        return {"color": BLUE, "marker": "o"} | filling(series.far_field, BLUE)

    def _draw_laws(self, ax, grid: np.ndarray) -> list:
        lines = []
        for (setup, law), style in zip(self.laws.items(), ("-", "-.", ":") * len(self.laws), strict=False):
            name = (short_setup(setup) or "fit") + ": "
            label = name + rf"${law['prefactor']:.2g}\,\phi^{{-{law['exponent']:.2f}}}$"
            curve = law["prefactor"] * grid ** -law["exponent"]
            lines += ax.plot(grid, curve, style, color=BLUE, linewidth=0.7, label=label)
        return lines
