"""Bounds on the critical amplitude from the rheological signatures, against volume fraction."""

from __future__ import annotations

import numpy as np

from suspend.analysis.collection import Series
from suspend.analysis.phase_diagram import PhaseDiagram, experimental_fit
from suspend.analysis.signatures import Signatures
from suspend.figures.panel import Columns, Panel
from suspend.figures.runs import Runs
from suspend.figures.style import BLACK, BLUE, GREY, say


def best_signatures(runs: Runs) -> list[Signatures]:
    """Signatures of the series with the most amplitudes at each volume fraction."""
    best: dict[float, Series] = {}
    for series in runs.collection.series:
        if series.phi not in best or len(series.groups) > len(best[series.phi].groups):
            best[series.phi] = series
    return [Signatures().compute(series) for series in best.values()]


class TransitionDiagram(Panel):
    """Bounds on gamma_c against volume fraction, and the fit to experiments 0.14 phi^-1.93."""

    def __init__(self, runs: Runs):
        self.diagram = PhaseDiagram().compute(runs.collection)

    def tables(self) -> dict[str, Columns]:
        """Bounds and the experimental fit."""
        return {"": self.diagram.table()}

    def draw(self, page) -> None:
        """Bars from bound to bound; crosses join the interval most signatures share where there is no bound."""
        ax = page.subplots()
        tops = []
        for signatures in self.diagram.signatures:
            _, _, shared = signatures.agreement
            found = signatures.bound or shared
            if found is None or not found.bracketed:
                continue
            ends = (
                {"marker": "o", "markerfacecolor": "white"} if signatures.bound else {"marker": "x", "linestyle": ":"}
            )
            ax.plot([signatures.series.phi] * 2, [found.low, found.high], color=BLUE, **ends)
            tops.append(found.high)
        phi = self.diagram.phi
        grid = np.linspace(min(phi.min() - 0.03, 0.25), max(phi.max() + 0.03, 0.55), 100)
        ax.plot(grid, experimental_fit(grid), "--", color=BLACK, linewidth=0.8, label=r"$0.14\,\phi^{-1.93}$")
        if not tops:
            say(ax, "no closed bound:\ngive more amplitudes")
        ax.set(xlabel=r"volume fraction $\phi$", ylabel=r"$\gamma_c$", ylim=(0.0, None))
        ax.text(0.05, 0.06, "reversible", transform=ax.transAxes, color=GREY)
        ax.text(0.95, 0.6, "irreversible", transform=ax.transAxes, color=GREY, ha="right")
        ax.legend(loc="upper right")
