"""Further sections of the analysis of one run: what moves, and how the spheres are arranged."""

from __future__ import annotations

import os
from typing import Any

from suspend.analysis.activity import ActiveFraction
from suspend.analysis.displacements import CyclicDiffusivity, DisplacementCloud
from suspend.analysis.relaxation import Relaxation
from suspend.errors import ConfigurationError
from suspend.io import Run
from suspend.missing import text


def dynamics_section(path: os.PathLike | str) -> dict[str, Any]:
    """Scalars of D_cyc, of the displacements over half a cycle, of activity and relaxation, by name.

    What a run does not hold is said under `notes`. Oscillatory runs only.
    """
    result: dict[str, Any] = {}
    notes: list[str] = []
    with Run(path) as run:
        for quantity in (CyclicDiffusivity(), DisplacementCloud(), ActiveFraction(), Relaxation()):
            name = type(quantity).__name__
            try:
                found = dict(quantity.compute(run).summary())
            except ConfigurationError as missing:
                notes.append(f"{name}: {missing}")
                continue
            notes += [f"{name}: {note}" for note in found.pop("notes", [])]
            result[name] = found
    return result | {"notes": notes}


def structure_section(path: os.PathLike | str) -> dict[str, Any]:
    """Scalars of the microstructure, initial and final (`suspend.analysis.microstructure`), by name."""
    from suspend.analysis.microstructure import microstructure

    with Run(path) as run:
        found = microstructure(run)
        return {"Microstructure": found.summary(), "notes": list(found.notes)}


def format_section(section: dict[str, Any]) -> str:
    """Text, one line a scalar, names aligned."""
    lines = []
    for title, values in section.items():
        if title == "notes":
            continue
        lines.append(title)
        width = max((len(name) for name in values), default=0) + 2
        for name, value in values.items():
            lines.append(f"  {name.ljust(width)}{text(value) if isinstance(value, float | None) else value}")
    lines += [f"note: {note}" for note in section.get("notes", [])]
    return "\n".join(lines)
