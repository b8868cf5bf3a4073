"""Text tables of an analysis for the terminal, at most 110 characters wide."""

from __future__ import annotations

import math
import textwrap
from typing import TYPE_CHECKING

import numpy as np

from suspend.analysis.normal_stresses import NormalStresses
from suspend.analysis.rheology import HARMONICS
from suspend.missing import DASH, has_value, text

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
            sections += [_harmonics(analysis), _parts(analysis), _laos(analysis)]
    if analysis.statistics and len(analysis.values):
        sections.append(_cost(analysis))
    sections += [textwrap.fill("Note: " + note, 110, break_long_words=False) for note in analysis.notes]
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
    if not has_value(value):
        return DASH.rjust(width)
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
    for label, kind in kinds[: min(analysis.last, 3)]:  # a trend needs three values
        lines.append(label.rjust(8) + _cells(averages, layout, kind))
    reference = max((found.reference for found in analysis.steady.values()), default=0)
    if reference >= 4:
        lines.append("p".rjust(8) + _cells(averages, layout, "p_value"))
    for name, label in (("N1_over_shear", "N1/|sigma_xy|"), ("N2_over_shear", "N2/|sigma_xy|")):
        if name in analysis.steady:
            found = analysis.steady[name]
            lines.append(f"{label} = {text(found.mean, '.4g')}" + _error(found.error))
    lines.append(f"(+-: standard error, correlation between {unit}s included; change: linear trend over them;")
    lines.append(
        f" p: chance of the trend over the last {reference} {unit}s if the state is steady, drift where < 0.01)"
    )
    return "\n".join(lines)


def _cells(averages: dict[str, dict[str, float]], layout, kind: str) -> str:
    return "".join(" " + (_number(averages[n][kind]) if n in averages else " " * 10) for _, n in layout)


def _harmonics(analysis: Analysis) -> str:
    averages = {name.partition("[")[0]: value for name, value in analysis.averages().items()}
    spectrum = abs(analysis.spectrum.coefficients["shear"])
    lines = [f"Harmonics of sigma_xy, mean of the last {analysis.last}:"]
    lines.append("       n" + "".join(f" {head:>10}" for head in ("eta_n'", "+-", "G_n'", "+-", "I_n/I_1")))
    for n in range(1, HARMONICS + 1):
        viscous, elastic = averages[f"eta{n}_prime"], averages[f"G{n}_prime"]
        cells = [viscous["mean"], viscous["standard_error"], elastic["mean"], elastic["standard_error"]]
        cells.append(spectrum[n] / spectrum[1] if spectrum[1] else math.nan)
        lines.append(f"{n:8d}" + "".join(" " + _number(cell) for cell in cells))
    fifth = averages["eta5_over_eta1"]
    lines.append(f"eta_5'/eta_1' = {text(fifth['mean'], '.4g')}" + _error(fifth["standard_error"]))
    return "\n".join(lines)


def _error(value: float) -> str:
    return f" +- {value:.1g}" if math.isfinite(value) else ""


def _parts(analysis: Analysis) -> str:
    steady = analysis.steady | NormalStresses().use(analysis.harmonics).steady()
    layout = ("eta1_prime", "G1_prime", "N1_nu0", "N2_nu0", "N2_nu2_abs", "N2_nu4_abs", "N2_nu4_over_nu2")
    heads = ("eta_1'", "G_1'", "N1:nu0", "N2:nu0", "N2:|nu2|", "N2:|nu4|", "|nu4/nu2|")
    lines = [f"Parts, mean of the last {analysis.last} (total = fluid + hydrodynamic + interparticle):"]
    lines.append(" " * 16 + "".join(f" {head:>10}" for head in heads))
    for part in analysis.harmonics.parts:
        tail = "" if part == "total" else "_" + part
        found = [steady[name + tail] for name in layout]
        name = _PART_NAMES.get(part, part)
        lines.append(name.ljust(16) + "".join(" " + _number(each.mean) for each in found))
        if any(math.isfinite(each.error) for each in found):
            lines.append("+-".rjust(16) + "".join(" " + _number(each.error) for each in found))
    return "\n".join(lines)


def _laos(analysis: Analysis) -> str:
    """Measures of Ewoldt, Hosoi & McKinley 2008 of the total and the parts; the tangents also from the curve itself."""
    layout = ("e3_over_e1", "v3_over_v1", "G_M", "G_L", "eta_M", "eta_L", "S", "T")
    heads = ("e3/e1", "v3/v1", "G_M'", "G_L'", "eta_M'", "eta_L'", "S", "T")
    lines = [f"Large-amplitude measures (Ewoldt, Hosoi & McKinley 2008), mean of the last {analysis.last}:"]
    lines.append(" " * 16 + "".join(f" {head:>10}" for head in heads))
    for part in analysis.laos.parts:
        found = [analysis.laos.steady(part)[name] for name in layout]
        lines.append(_PART_NAMES.get(part, part).ljust(16) + "".join(" " + _number(each.mean) for each in found))
        if part == "total":
            if any(math.isfinite(each.error) for each in found):
                lines.append("+-".rjust(16) + "".join(" " + _number(each.error) for each in found))
            direct = [analysis.laos.direct.get(name, None) for name in layout]
            cells = (" " * 11 if value is None else " " + _number(value) for value in direct)
            lines.append("from the curve".rjust(16) + "".join(cells).rstrip())
    lines.append(
        f"(sums over harmonics to {HARMONICS}; 'from the curve': tangents and secants of the mean curve itself)"
    )
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
    line = "Cost: " + "; ".join(f"{labels[name]} {text(value, '.4g')}" for name, value in found.items())
    return textwrap.fill(line, 110)
