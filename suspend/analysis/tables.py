"""Text tables of an analysis for the terminal, at most 110 characters wide."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from suspend.analysis.rheology import HARMONICS, PARTS

if TYPE_CHECKING:
    from suspend.analysis.summary import Analysis

_SHOWN = 20  # longer runs are shown at their first, last and logarithmically spaced cycles
_OSCILLATORY = (  # heading, column
    ("gamma_tot", "total_strain"),
    ("eta_r'", "eta_r_prime"),
    ("eta_r''", "eta_r_double_prime"),
    ("-e3'/e1'", "minus_eta3_over_eta1"),
    ("N1:nu0", "N1_nu0"),
    ("N2:nu0", "N2_nu0"),
    ("N2:|nu2|", "N2_nu2_abs"),
    ("N2:|nu4|", "N2_nu4_abs"),
    ("D_cyc", "D_cyc"),
)
_STEADY = (
    ("strain", "total_strain"),
    ("rate", "shear_rate"),
    ("eta_r", "eta_r"),
    ("hydrodyn.", "eta_r_hydrodynamic"),
    ("interpart.", "eta_r_interparticle"),
    ("N1", "N1"),
    ("N2", "N2"),
)
_QUIESCENT = (("time*rate", "total_strain"), ("sigma_xy", "sigma_xy"), ("N1", "N1"), ("N2", "N2"))
_FLOWS = {
    "oscillatory": "oscillatory shear",
    "steady": "steady shear",
    "reversal": "shear reversal",
    "quiescent": "no flow",
}
_LEGEND = {
    True: "per cycle; eta_n' and nu_n in units of eta0, G_n' of eta0 omega, D_cyc of a^2 per unit strain",
    False: "averages over blocks of about one unit of strain (time); N1, N2, sigma_xy in units of eta0 rate",
}
_PART_NAMES = {
    "hydrodynamic": "hydrodynamic",
    "interparticle": "interparticle",
    "flow_driven": "of hydr.: flow",  # the share of the hydrodynamic part that the flow alone drives
}


def format_analysis(analysis: Analysis) -> str:
    """The whole report: what was run, moduli per cycle, averages, harmonics, parts, cost, notes."""
    sections = [_title(analysis)]
    if len(analysis.values):
        sections.append(_cycles(analysis))
        if analysis.oscillatory:
            sections += [_harmonics(analysis), _parts(analysis)]
    if analysis.statistics and len(analysis.values):
        sections.append(_cost(analysis))
    sections += ["Note: " + note for note in analysis.notes]
    return "\n\n".join(sections)


def shown_cycles(count: int, most: int = _SHOWN) -> list[int]:
    """Which of `count` cycles to print: all, or the first three, logarithmically spaced ones and the last."""
    if count <= most:
        return list(range(count))
    spaced = np.unique(np.rint(np.geomspace(3, count, most - 3)).astype(int)) - 1
    return sorted({0, 1, 2, *spaced.tolist(), count - 1})


def _title(analysis: Analysis) -> str:
    scales, count = analysis.scales, len(analysis.values)
    facts = [_FLOWS.get(analysis.flow, analysis.flow), f"N = {scales['number']}"]
    facts.append(f"phi = {scales['volume_fraction']:.4g}")
    if analysis.oscillatory:
        facts += [f"gamma0 = {scales['gamma0']:g}", f"omega = {scales['omega']:g}"]
        if scales["phase"]:
            facts.append(f"initial phase {scales['phase']:g} rad")
    else:
        facts.append(f"rate = {scales['rate']:g}")
    done = f"{count} complete {_plural('cycle' if analysis.oscillatory else 'block', count)}"
    return f"{analysis.path}: {', '.join(facts)}; {done}\n{_LEGEND[analysis.oscillatory]}"


def _plural(unit: str, count: int) -> str:
    return unit if count == 1 else unit + "s"


def _number(value: float, width: int = 10) -> str:
    if not math.isfinite(value):
        return "-".rjust(width)
    extreme = value != 0.0 and not 1e-3 <= abs(value) < 1e5
    return (f"{value:.3e}" if extreme else f"{value:.5g}").rjust(width)


def _cycles(analysis: Analysis) -> str:
    layout = _OSCILLATORY if analysis.oscillatory else _STEADY if analysis.flow != "quiescent" else _QUIESCENT
    columns = [analysis[name] for _, name in layout]
    shown = shown_cycles(len(analysis.values))
    unit = "cycle" if analysis.oscillatory else "block"
    lines = [unit.rjust(8) + "".join(f" {head:>10}" for head, _ in layout)]
    for k in shown:
        lines.append(f"{k:8d}" + "".join(" " + _number(column[k]) for column in columns))
    averages = {name.partition("[")[0]: value for name, value in analysis.averages().items()}
    lines.append(f"last {analysis.last} {_plural(unit, analysis.last)}:")
    kinds = (("mean", "mean"), ("+-", "standard_error"), ("change", "change"))
    for label, kind in kinds[: min(analysis.last, 3)]:  # an error needs two values, a trend three
        cells = [_number(averages[name][kind]) if name in averages else " " * 10 for _, name in layout]
        lines.append(label.rjust(8) + "".join(" " + cell for cell in cells))
    lines.append(f"(+-: standard error, {unit}s taken as independent; change: linear trend over them)")
    return "\n".join(lines)


def _harmonics(analysis: Analysis) -> str:
    averages = {name.partition("[")[0]: value for name, value in analysis.averages().items()}
    lines = [f"Harmonics of sigma_xy, mean of the last {analysis.last}:"]
    lines.append("       n" + "".join(f" {head:>10}" for head in ("eta_n'", "+-", "G_n'", "+-")))
    for n in range(1, HARMONICS + 1):
        viscous, elastic = averages[f"eta{n}_prime"], averages[f"G{n}_prime"]
        cells = (viscous["mean"], viscous["standard_error"], elastic["mean"], elastic["standard_error"])
        lines.append(f"{n:8d}" + "".join(" " + _number(cell) for cell in cells))
    return "\n".join(lines)


def _parts(analysis: Analysis) -> str:
    averages = {name.partition("[")[0]: value["mean"] for name, value in analysis.averages().items()}
    layout = ("eta1_prime", "G1_prime", "N1_nu0", "N2_nu0", "N2_nu2_abs", "N2_nu4_abs")
    heads = ("eta_1'", "G_1'", "N1:nu0", "N2:nu0", "N2:|nu2|", "N2:|nu4|")
    lines = [f"Parts, mean of the last {analysis.last} (total = fluid + hydrodynamic + interparticle):"]
    lines.append(" " * 16 + "".join(f" {head:>10}" for head in heads))
    lines.append("total".ljust(16) + "".join(" " + _number(averages[name]) for name in layout))
    for part in PARTS:
        if f"eta1_prime_{part}" in averages:
            cells = "".join(" " + _number(averages[f"{name}_{part}"]) for name in layout)
            lines.append(_PART_NAMES[part].ljust(16) + cells)
    return "\n".join(lines)


def _cost(analysis: Analysis) -> str:
    labels = {
        "evaluations": "velocity evaluations",
        "iterations": "solver iterations",
        "steps": "steps",
        "overlaps": "overlaps",
        "minimum_gap": "smallest gap (a)",
        "position_error": "largest estimated position error of a cycle (a)",
        "wall_time": "wall time (s)",
    }
    found = {name: value for name, value in analysis.statistics.items() if name in labels}
    return "Cost: " + "; ".join(f"{labels[name]} {value:.4g}" for name, value in found.items())
