"""CSV and JSON: moduli of every cycle, or the time series sample by sample."""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from suspend.analysis.summary import Analysis, analyze_run
from suspend.conventions import COMPONENTS
from suspend.errors import ConfigurationError
from suspend.io import Run
from suspend.io.csv_text import write_rows
from suspend.missing import plain

UNITS = {
    "time": "time",
    "strain": "-",
    "rate": "1/time",
    "phase": "cycles",
    "cycle": "-",
}
STRESS_UNIT = "viscosity/time"
UNITS_SAID = (
    "length as particles.radius, viscosity as fluid.viscosity, time as 1/flow.omega or 1/flow.rate of the "
    "configuration; stress is viscosity/time"
)


def sample_names(run: Run) -> list[str]:
    """Time series of a run that are exported: all but the stress of every sphere. Raises ConfigurationError."""
    if not run.stored:
        raise ConfigurationError(f"{run.path} holds no cycle yet: nothing to export; let the run go on")
    stresses = [name for name in run.fields if name.startswith("stress_")]
    return ["cycle", "phase", "time", "strain", "rate", *stresses]


def sample_columns(run: Run, name: str, first: int = 0, last: int | None = None) -> Iterator[tuple[str, np.ndarray]]:
    """Columns "quantity[unit]" of one time series of cycles first to last: six of a stress, else one."""
    values = run.series(name, first, last)
    if values.ndim == 1:
        yield f"{name}[{UNITS.get(name, '?')}]", values
        return
    for component, column in zip(COMPONENTS, values.T, strict=True):
        yield f"{name}_{component}[{STRESS_UNIT}]", column


def write_csv(run: Run, path: Path, table: str, notes: list[str]) -> None:
    """Write `table` ("cycles" or "samples") under a header "quantity[unit]". Raises OSError, ConfigurationError."""
    if table == "cycles":
        analysis = _analysis(run)
        notes += analysis.notes
        rows = ([k, *row] for k, row in enumerate(analysis.values.tolist()))
        _write_rows(path, [["cycle", *analysis.columns], *rows])
        return
    _write_rows(path, _sample_rows(run, sample_names(run)))


def _sample_rows(run: Run, names: list[str]) -> Iterator[list]:
    for k in range(run.stored):  # one cycle in memory at a time
        columns = dict(column for name in names for column in sample_columns(run, name, k, k + 1))
        if k == 0:
            yield list(columns)
        yield from map(list, zip(*(column.tolist() for column in columns.values()), strict=True))


def _write_rows(path: Path, rows) -> None:
    with open(path, "w", encoding="utf-8", newline="") as file:
        write_rows(file, rows)


def _analysis(run: Run) -> Analysis:
    analysis = analyze_run(run, path=str(run.path))
    if not len(analysis.values):
        raise ConfigurationError(f"nothing to export from {run.path}: {'; '.join(analysis.notes)}")
    return analysis


def write_json(run: Run, path: Path, table: str, notes: list[str]) -> None:
    """Write one object: configuration, facts and statistics of the run, its moduli, and its samples on request.

    What is not a finite number is null. Samples are written column by column. Raises OSError, ConfigurationError.
    """
    analysis = _analysis(run) if table == "cycles" else None
    content: dict[str, Any] = {
        "run": str(run.path),
        "run_id": run.run_id,
        "finished": run.finished,
        "cycles": run.cycles,
        "units": UNITS_SAID,
        "configuration": run.config,
        "meta": run.meta,
        "statistics": {name: column.tolist() for name, column in run.statistics().items()},
    }
    if analysis is not None:
        notes += analysis.notes
        content["analysis"] = analysis.as_dict()
    with open(path, "w", encoding="utf-8") as file:
        text = json.dumps(plain(content), indent=1, allow_nan=False)
        if analysis is not None:
            file.write(text + "\n")
            return
        names = sample_names(run)
        file.write(text[: text.rindex("}")].rstrip() + ',\n "samples": {')
        first = True
        for name in names:
            for header, column in sample_columns(run, name):
                file.write(("" if first else ",") + f"\n  {json.dumps(header)}: {json.dumps(plain(column.tolist()))}")
                first = False
        file.write("\n }\n}\n")
