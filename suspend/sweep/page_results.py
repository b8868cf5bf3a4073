"""What a sweep's page says about its complete points together: figures against amplitude, averages, phase diagram."""

from __future__ import annotations

import math
from collections.abc import Iterator
from html import escape
from importlib import import_module

from suspend.analysis.collection import Member, Series
from suspend.analysis.phase_diagram import EXPONENT, PREFACTOR, PhaseDiagram, experimental_fit
from suspend.analysis.signatures import Range, Signatures
from suspend.errors import SuspendError
from suspend.figures.groups import short_setup
from suspend.figures.phase_diagram import LEAST_FRACTIONS
from suspend.figures.runs import Runs, open_runs
from suspend.report.drawing import picture
from suspend.report.text import UNKNOWN, number, table, unfolding, with_error

_LOW, _HIGH = (3.4, 2.9), (3.4, 3.6)  # inches
PANELS = (  # module:class, title, what it shows, size
    ("viscosity:SteadyViscosity", "Viscosity", "Steady η<sub>r</sub>′.", _LOW),
    ("viscosity:Thinning", "Shear thinning within the cycle", "−η<sub>3</sub>′/η<sub>1</sub>′.", _LOW),
    ("normal_stresses:FirstDifference", "Average N<sub>1</sub>", "The whole, and its hydrodynamic part below.", _HIGH),
    (
        "normal_stresses:SecondDifference",
        "Average N<sub>2</sub>",
        "Here filled points are the entire stress, empty ones the interparticle part, and points with far field are "
        "joined; dashed: lines fitted to the last amplitudes, whose zero is the onset.",
        _LOW,
    ),
    ("normal_stresses:Doubling", "Frequency doubling of N<sub>2</sub>", "|ν<sub>4</sub>|/|ν<sub>2</sub>|.", _HIGH),
    (
        "diffusivity:FinalDiffusivity",
        "Final D<sub>cyc</sub>",
        "Of the last cycle that ends by total strain 256 (in the tables the mean over the last cycles); shaded: the "
        "bounds on γ<sub>c</sub>, pale where only most signatures share them.",
        _LOW,
    ),
)
_DIAGRAM = "phase_diagram:TransitionDiagram"
_BARS = (
    "Bars: standard error over the seeds; where there is one seed, within its run, over its last cycles (of "
    "D<sub>cyc</sub> over the spheres). Filled: with far field; empty: without."
)
QUANTITIES = {  # name in the collection: heading
    "eta_r_prime": "η<sub>r</sub>′",
    "minus_eta3_over_eta1": "−η<sub>3</sub>′/η<sub>1</sub>′",
    "N1_nu0": "ν<sub>0</sub>/η<sub>0</sub> of N<sub>1</sub>",
    "minus_N2_nu0": "−ν<sub>0</sub>/η<sub>0</sub>",
    "nu4_over_nu2": "|ν<sub>4</sub>|/|ν<sub>2</sub>|",
    "D_cyc": "D<sub>cyc</sub>",
}


class Results:
    """The complete points of the sweeps of a page, at the paths of their runs; `why` says why there is nothing."""

    def __init__(self, paths: list[str], last: int | None = None):
        self.runs: Runs | None = None
        self.why = "" if paths else "No point is complete yet."
        self.members: dict[str, Member] = {}
        self.diagram = PhaseDiagram()
        if paths:
            try:
                self.runs = open_runs(paths, last)
                self.members = {member.path: member for member in self.runs.collection.members}
                self.diagram.compute(self.runs.collection)
            except SuspendError as error:
                self.runs, self.why = None, str(error)

    def notes(self) -> list[str]:
        """What was left out of the complete points, and what must be known to read the numbers."""
        return [] if self.runs is None else [*self.runs.notes, *self.diagram.notes]

    def html(self) -> Iterator[str]:
        """The sections of the page."""
        if self.runs is None:
            yield f'<section id="results"><h2>Results</h2>\n<p>{escape(self.why)}</p></section>'
            return
        drawn = [_drawn(self.runs, *panel) for panel in PANELS]
        yield (
            '<section id="results"><h2>Against the amplitude</h2>\n'
            f'<p class="soft">Means over the seeds at the end of the runs. {_BARS}</p>\n'
            '<div class="figures">' + "\n".join(drawn) + "</div>\n" + _averages(self.runs) + "</section>"
        )
        yield (
            f'<section id="phase-diagram"><h2>Phase diagram</h2>\n<div class="figures">{_diagram(self.runs)}</div>\n'
            + bounds(self.diagram)
            + "</section>"
        )


def _drawn(runs: Runs, panel: str, title: str, caption: str, size: tuple[float, float]) -> str:
    module, _, name = panel.partition(":")
    try:
        made = getattr(import_module("suspend.figures." + module), name)(runs)
    except SuspendError as error:  # one quantity that cannot be had does not hide the others
        return f"<figure><figcaption><b>{title}.</b> Not drawn: {escape(str(error))}</figcaption></figure>"
    return picture(made.draw, title, caption, size)


def _diagram(runs: Runs) -> str:
    caption = (
        "Bounds on γ<sub>c</sub> from the four rheological signatures; dashed: experiments, 0.14 φ<sup>−1.93</sup> "
        "(Pine et al. 2005). Filled: with far field; empty: without. Thin bars: 95 % of the bounds of resampled seeds."
    )
    return _drawn(runs, _DIAGRAM, "Bounds on the critical amplitude", caption, _LOW)


def _averages(runs: Runs) -> str:
    """Tables of the means over seeds, one for each volume fraction and setup."""
    parts = []
    for series in runs.collection.series:
        averages = {name: series.averages(name) for name in QUANTITIES}
        rows = [
            (f"{x:g}", str(n), *(with_error(averages[name][k].mean, averages[name][k].error) for name in QUANTITIES))
            for k, (x, n) in enumerate(zip(series.gamma0, series.runs, strict=True))
        ]
        head = ("γ<sub>0</sub>", "Seeds", *QUANTITIES.values())
        parts.append(f"<h3>{_title(series)}</h3>\n" + table(rows, head, kind="dense"))
    return unfolding("Means over the seeds and their standard errors", "\n".join(parts))


def _title(series: Series) -> str:
    return f"φ = {series.phi:g}" + (f", {escape(short_setup(series.setup))}" if series.setup else "")


def bounds(diagram: PhaseDiagram) -> str:
    """Table of gamma_c beside the experiments' fit, and the power laws through it."""
    head = ("Runs", "γ<sub>c</sub>", "95 % over seeds", "Signatures", "0.14 φ<sup>−1.93</sup>", "It lies")
    text = table([_bound_cells(s) for s in diagram.signatures], head)
    return text + "\n".join(f"<p>{line}</p>" for line in _laws(diagram))


def _bound_cells(signatures: Signatures) -> tuple[str, ...]:
    bound, (agreeing, found, shared) = signatures.bound, signatures.agreement
    seeds = signatures.confidence("gamma_c")
    closed = seeds is not None and math.isfinite(seeds["low"])
    value = float(experimental_fit(signatures.series.phi))
    inside = bound is not None and bound.low < value < bound.high
    return (
        _title(signatures.series),
        str(bound) if bound else "none" + (f" (most share {shared})" if shared else ""),
        str(Range(seeds["low"], seeds["high"], math.nan)) if closed else UNKNOWN,
        f"{agreeing} of {found} agree" if found else "too few amplitudes",
        f"{value:.3g}",
        ("within" if inside else "outside") if bound else UNKNOWN,
    )


def _laws(diagram: PhaseDiagram) -> Iterator[str]:
    """One line for each setup with enough bounds, else why there is none."""
    for setup in sorted({s.series.setup for s in diagram.signatures}):
        law = diagram.power_law(setup)
        name = escape(short_setup(setup)) + ": " if setup else ""
        count = law["volume_fractions"] if law else 0
        if count < LEAST_FRACTIONS:
            closed = {s.series.phi for s in diagram.signatures if s.series.setup == setup and s.bound}
            yield (
                f"{name}no power law is fitted: it needs closed bounds at {LEAST_FRACTIONS} volume fractions, there "
                f"{'is' if len(closed) == 1 else 'are'} {len(closed)}."
            )
            continue
        (n_low, n_high), (c_low, c_high) = law["exponent_interval"], law["prefactor_interval"]
        yield (
            f"{name}γ<sub>c</sub> = C φ<sup>−n</sup> through {count} bounds: n = {number(law['exponent'], 3)} "
            f"({number(n_low, 3)} to {number(n_high, 3)}, 95 %), beside {EXPONENT}; C = {number(law['prefactor'], 3)} "
            f"({number(c_low, 3)} to {number(c_high, 3)}), beside {PREFACTOR}."
        )
