"""What a run is and how far it got, for `suspend info` and for sweeps that do only what is missing."""

from __future__ import annotations

import os
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np

from suspend.errors import StorageError
from suspend.io.checkpoint import read_checkpoint
from suspend.io.files import holder
from suspend.io.reader import CHECKPOINT, Run
from suspend.missing import largest, smallest


def describe(path: os.PathLike | str) -> dict[str, Any]:
    """Summary of a run directory or trajectory file, plain types only (fit for JSON).

    Keys: path, run_id, finished, running (who writes it, or None), cycles, incomplete_cycle (bool), pending,
    samples, frames, time and strain of the last sample (or None), bytes on disk, fields, statistics (totals,
    extremes), checkpoint (cycles and partial_samples, or problem; or None), meta, config_yaml.
    Raises StorageError.
    """
    path = Path(path)
    with Run(path) as run:
        last = run.stored
        samples = {n: run.series(n, last - 1)[-1].item() if last else None for n in ("time", "strain")}
        return {
            "path": str(path),
            "run_id": run.run_id,
            "finished": run.finished,
            "running": holder(path) if path.is_dir() else None,
            "cycles": run.cycles,
            "incomplete_cycle": run.stored > run.cycles,
            "pending": run.pending,
            "samples": run.n_samples,
            "frames": run.n_frames,
            **samples,
            "bytes": _size(path),
            "fields": run.fields if last else [],
            "statistics": _summary(run.statistics()),
            "checkpoint": _checkpoint(path / CHECKPOINT) if path.is_dir() else None,
            "meta": run.meta,
            "config_yaml": run.config_yaml,
        }


def _size(path: Path) -> int:
    """Bytes on disk; files that a run going on removes meanwhile have none."""
    total = 0
    for file in path.iterdir() if path.is_dir() else [path]:
        with suppress(FileNotFoundError):
            total += file.stat().st_size if file.is_file() else 0
    return total


def _summary(columns: dict[str, np.ndarray]) -> dict[str, float]:
    """Totals of counts (integers) and times; the smallest of minima and the largest of other real numbers (or NaN)."""
    summary = {}
    for name, column in columns.items():
        if not len(column):
            continue
        if column.dtype.kind in "iu" or name.endswith("_time"):
            summary[name] = np.sum(column).item()
        else:
            summary[name] = smallest(column) if name.startswith("minimum") else largest(column)
    return summary


def _checkpoint(path: Path) -> dict | None:
    if not path.exists():
        return None
    try:
        content = read_checkpoint(path)
    except StorageError as error:
        return {"problem": str(error)}
    partial = content["partial"]
    # of a begun cycle: its index, and the rows recorded so far (none right at its start)
    return {"cycles": content["cycles"], "partial_samples": len(partial["rows"].get("time", ())) if partial else 0}
