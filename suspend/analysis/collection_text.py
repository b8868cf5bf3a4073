"""Text of a collection of runs for the terminal, at most 110 characters wide."""

from __future__ import annotations

from suspend.analysis.collection import Collection, Series
from suspend.analysis.phase_diagram import PhaseDiagram
from suspend.analysis.signatures import LEAST_AMPLITUDES, Range, Signatures
from suspend.missing import DASH, has_value, text

_COLUMNS = (  # heading, quantity
    ("eta_r'", "eta_r_prime"),
    ("-e3'/e1'", "minus_eta3_over_eta1"),
    ("-nu0/eta0", "minus_N2_nu0"),
    ("nu4/nu2", "nu4_over_nu2"),
    ("D_cyc", "D_cyc"),
)
_NOTES = 12


def format_collection(collection: Collection, diagram: PhaseDiagram) -> str:
    """Steady-state values and signatures of each series, the phase diagram, notes."""
    runs = "1 run" if len(collection) == 1 else f"{len(collection)} runs"
    means = "means over the last cycles and over seeds; +- over seeds, of one over its cycles"
    sections = [f"{runs} in {len(collection.series)} series; {means}"]
    for series, signatures in zip(collection.series, diagram.signatures, strict=True):
        sections.append(_values(series) + "\n\n" + _ranges(signatures))
    sections.append(_diagram(diagram))
    notes = [*collection.notes, *diagram.notes]
    shown = notes if len(notes) <= _NOTES else notes[: _NOTES - 1]
    sections += ["Note: " + note for note in shown]
    if len(notes) > len(shown):
        sections.append(f"and {len(notes) - len(shown)} more notes (--json has them all)")
    return "\n".join(["\n\n".join(sections[: 2 + len(collection.series)]), *sections[2 + len(collection.series) :]])


def _number(value: float, digits: int = 4, width: int = 10) -> str:
    if not has_value(value):
        return DASH.rjust(width)
    extreme = value != 0.0 and not 1e-3 <= abs(value) < 1e4
    return (f"{value:.{max(digits - 2, 1)}e}" if extreme else f"{value:.{digits}g}").rjust(width)


def _values(series: Series) -> str:
    heads = "".join(f" {head:>10} {'+-':>7}" for head, _ in _COLUMNS[:4]) + f" {'D_cyc':>8}"
    lines = [series.title, f"{'gamma0':>7} {'runs':>4}" + heads + "  state"]
    for k, group in enumerate(series.groups):
        cells = ""
        for _, name in _COLUMNS[:4]:
            cells += " " + _number(series.mean(name)[k]) + " " + _number(series.error(name)[k], 2, 7)
        cells += " " + _number(series.mean("D_cyc")[k], 3, 8)
        states = {member.state for member in group}
        lines.append(f"{group[0].gamma0:>7g} {len(group):>4d}{cells}  {states.pop() if len(states) == 1 else 'mixed'}")
    return "\n".join(lines)


def _ranges(signatures: Signatures) -> str:
    if len(signatures.series.groups) < LEAST_AMPLITUDES:
        return f"    ({LEAST_AMPLITUDES} amplitudes are needed for the signatures)"
    lines = ["    " + "signature".ljust(26) + "range of gamma0".ljust(20) + "best".rjust(8) + "   over seeds, 95 %"]
    for name, value in signatures.rows():
        lines.append("    " + name.ljust(26) + _range(value).ljust(20) + _best(value) + _confidence(signatures, name))
    return "\n".join(lines)


def _range(value: Range | None) -> str:
    return "none" if value is None else str(value)


def _best(value: Range | None) -> str:
    return text(value and value.best, ".3g").rjust(8)


def _confidence(signatures: Signatures, name: str) -> str:
    found = signatures.confidence(name)
    if found is None:
        return ""
    none = f", none in {100.0 * found['none']:.0f} %" if found["none"] else ""
    if not has_value(found["low"]):
        return "   " + none.removeprefix(", ")
    return f"   ({found['low']:g}, {text(found['high'], 'g')}), the same in {100.0 * found['same']:.0f} %{none}"


def _diagram(diagram: PhaseDiagram) -> str:
    lines = ["gamma_c from the signatures, beside 0.14 phi^-1.93 (experiments)"]
    for signatures, bound, value, agrees in zip(
        diagram.signatures, diagram.bounds, diagram.reference, diagram.agrees, strict=True
    ):
        verdict = {True: "within", False: "outside", None: "no bound"}[agrees]
        line = f"    {signatures.series.title:<40} {_range(bound):<16} {value:8.3f}   {verdict}"
        if bound is None and signatures.agreement[2] is not None:
            count, total, where = signatures.agreement
            line += f"; {count} of {total} signatures in {where}"
        lines.append(line)
    for setup in sorted({s.series.setup for s in diagram.signatures}):
        law = diagram.power_law(setup)
        if law is not None:
            n, c = law["exponent_interval"], law["prefactor_interval"]
            lines.append(
                f"    {setup or 'fit'}: gamma_c = {law['prefactor']:.3g} phi^-{law['exponent']:.3g}, 95 %: prefactor "
                f"{c[0]:.3g} to {c[1]:.3g}, exponent {n[0]:.3g} to {n[1]:.3g}"
            )
    return "\n".join(lines)
