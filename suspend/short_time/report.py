"""Short-time properties as a table on the screen, and as JSON or CSV files."""

from __future__ import annotations

import math

from suspend.io.csv_text import csv_text
from suspend.short_time import literature
from suspend.short_time.ensemble import ShortTimeProperties

NAMES = {"eta_inf": "eta_inf/eta0", "D_s": "D_s/D0", "D_r": "D_r/D0", "U": "U/U0"}
MEANING = {
    "eta_inf": "high-frequency viscosity, mean over the five independent strain rates",
    "D_s": "short-time self-diffusion, translation",
    "D_r": "short-time self-diffusion, rotation",
    "U": "sedimentation velocity, mean over three directions",
}
COLUMNS = (
    "property",
    "value",
    "error",
    "inner_error",
    "corrected",
    "literature",
    "deviation",
    "source",
)


def lines(result: ShortTimeProperties, source: str) -> list[str]:
    """Table with what was computed, its errors, the correction and the literature; then the caveats."""
    lubrication = "with lubrication" if result.lubrication else "without lubrication"
    head = [
        f"{source}: {result.configurations} x {result.number} spheres, volume fraction"
        f" {result.volume_fraction:.6g}",
        f"far field {result.far_field}, {lubrication}, accuracy {result.accuracy:g}, {result.solves} solves"
        + (f", {result.probes} random loads a configuration" if result.probes else ", exact traces"),
        *_structure(result),
        "",
        f"{'':14}{'computed':>10}{'+-':>9}{'within':>9}{'corrected':>11}{'literature':>12}{'deviation':>11}",
    ]
    rows = [
        f"{NAMES[p.name]:14}{p.value:>10.4f}{_number(p.error, 9)}{_number(p.inner_error, 9)}"
        f"{_number(p.corrected, 11)}{_number(p.literature, 12)}{_percent(p.deviation)}"
        for p in result.properties
    ]
    return head + rows + ["", *_notes(result)]


def _structure(result: ShortTimeProperties) -> list[str]:
    s = result.structure
    contact = "too few close pairs"
    if not math.isnan(s.contact_value):
        contact = f"{s.contact_value:.3f} +- {s.contact_error:.3f}"
    waves = f"{s.long_waves:.3f}" + (f" +- {s.long_waves_error:.3f}" if s.long_waves_error is not None else "")
    return [
        f"g(2a) {contact} (fluid at equilibrium: {s.equilibrium_contact_value:.3f})",
        f"S of the longest waves {waves} (fluid at equilibrium: {result.structure_factor:.3f})",
        f"global Q6 {s.global_q6:.3f}, crystalline spheres {100.0 * s.crystal_fraction:.1f} %",
    ]


def _number(value: float | None, width: int) -> str:
    return " " * (width - 1) + "-" if value is None else f"{value:>{width}.4f}"


def _percent(value: float | None) -> str:
    return f"{'-':>11}" if value is None else f"{100.0 * value:>+9.1f} %"


def _notes(result: ShortTimeProperties) -> list[str]:
    notes = [f"{NAMES[name]}: {meaning}" for name, meaning in MEANING.items()]
    notes += [
        "+-: standard error over configurations; within: the same from the scatter inside them, over",
        "  random loads (D_s, D_r) or directions (eta_inf, U)",
    ]
    if result.finite_size_shift is not None:
        notes += [
            f"corrected for the finite cell (Ladd 1990): D_s/D0 + {result.finite_size_shift:.4f}, U/U0 + that times",
            f"  S(0) = {result.structure_factor:.4f} (Carnahan-Starling)",
        ]
    else:
        notes.append(f"far field {result.far_field}: nothing to correct; the literature has the many-body far field")
    if result.far_field == "ewald" and result.lubrication:
        notes += [
            "U at the force-torque-stresslet level is known to come out too fast for random spheres:",
            f"  {literature.KNOWN_EXCESS}",
        ]
    notes.append("literature: fits for fluids at equilibrium, phi <= 0.5:")
    notes += [f"  {NAMES[p.name]}: {p.source}" for p in result.properties if p.source]
    return notes


def to_csv(result: ShortTimeProperties) -> str:
    """One row a property; empty where there is no value. Fractions, not percent."""
    rows: list[tuple] = [("number", "volume_fraction", "configurations", "far_field", "lubrication", *COLUMNS)]
    fixed = (
        result.number,
        repr(result.volume_fraction),
        result.configurations,
        result.far_field,
        result.lubrication,
    )
    for p in result.properties:
        values = (p.value, p.error, p.inner_error, p.corrected, p.literature, p.deviation)
        rows.append((*fixed, p.name, *("" if v is None else repr(v) for v in values), p.source))
    return csv_text(rows)
