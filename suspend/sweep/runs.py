"""The runs of sweeps: the points that results are taken from, and what is left out of them."""

from __future__ import annotations

import os
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from suspend.errors import ConfigurationError
from suspend.sweep.folder import MANIFEST
from suspend.sweep.status import sweep_status

SUFFIXES = (".yaml", ".yml")
NAMED = 6  # points named in a note of one state
_WORDS = {"running": "being computed", "interrupted": "interrupted", "waiting": "not begun", "failed": "failed"}


@dataclass(frozen=True)
class Selection:
    """Runs to take results from: what was given besides sweeps, and the complete points of the sweeps.

    sweeps: what `sweep_status` says of each; notes: the points left out, and why.
    """

    runs: list[str]
    sweeps: list[dict[str, Any]]
    notes: list[str]


def is_sweep(path: os.PathLike | str) -> bool:
    """Whether this is the folder of a sweep or a YAML file, which can only be that of a sweep where runs are asked."""
    path = Path(path)
    return (path / MANIFEST).is_file() if path.is_dir() else path.suffix.lower() in SUFFIXES and path.is_file()


def select_runs(paths: Iterable[os.PathLike | str]) -> Selection:
    """The paths with every sweep replaced by its complete points.

    Raises ConfigurationError where only sweeps are given and none has a complete point, or a file is no sweep;
    StorageError.
    """
    paths = [os.fspath(path) for path in paths]
    sweeps = sweeps_at(path for path in paths if is_sweep(path))
    runs = [path for path in paths if not is_sweep(path)]
    runs += [folder for status in sweeps for folder in complete_points(status)]
    if not runs and sweeps:
        raise ConfigurationError("; ".join(_nothing(status) for status in sweeps))
    return Selection(runs, sweeps, [note for status in sweeps for note in left_out(status)])


def sweeps_at(paths: Iterable[os.PathLike | str]) -> list[dict[str, Any]]:
    """What `sweep_status` says of the sweeps, each once where both its folder and its file are given."""
    found: dict[Path, dict[str, Any]] = {}
    for path in paths:
        status = sweep_status(path)
        found.setdefault(Path(status["sweep"]).resolve(), status)
    return list(found.values())


def complete_points(status: dict[str, Any]) -> list[str]:
    """Folders of the complete points of a sweep."""
    return [str(Path(status["sweep"]) / p["folder"]) for p in status["points"] if p["state"] == "complete"]


def _nothing(status: dict[str, Any]) -> str:
    counts = ", ".join(f"{count} {state}" for state, count in status["counts"].items() if count)
    elsewhere = "" if Path(status["sweep"]).is_dir() else " (no such folder: give the one that its runs are in)"
    return f"no point of the sweep {status['sweep']} is complete{elsewhere}: {counts}; `suspend sweep` computes them"


def left_out(status: dict[str, Any]) -> list[str]:
    """A line for each failed point with its message, and one for all others of each state."""
    notes, base = [], status["sweep"]
    for state, words in _WORDS.items():
        points = [p for p in status["points"] if p["state"] == state]
        if state == "failed":
            notes += [f"left out: {base}/{p['folder']}: failed: {p['message'] or 'unknown'}" for p in points]
        elif points:
            names = ", ".join(_named(p) for p in points[:NAMED])
            more = f" and {len(points) - NAMED} more (`suspend sweep status {base}`)" if len(points) > NAMED else ""
            notes.append(f"left out: {base}: {words}: {names}{more}")
    return notes


def _named(point: dict[str, Any]) -> str:
    if not point["strain"]:
        return point["folder"]
    return f"{point['folder']} (total strain {point['strain']:.4g} of {point['total_strain']:.4g})"
