"""How far a sweep is: one entry a point, from the folder alone or from the file."""

from __future__ import annotations

import statistics
from pathlib import Path
from typing import Any

from suspend.config import loads
from suspend.errors import ConfigurationError, StorageError
from suspend.io.files import holder
from suspend.sweep.adaptive import Group, describe, line_of, value_of
from suspend.sweep.file import RETRIES
from suspend.sweep.folder import CONFIGURATION, MANIFEST, Folder, SweepLock, at_work, is_complete, read_record
from suspend.sweep.folder import total_strain as strain_of

STATES = ("complete", "running", "interrupted", "waiting", "failed")


def sweep_status(path: str | Path, folder: str | Path | None = None) -> dict[str, Any]:
    """State of a sweep given by its file or its folder; plain types only.

    points: folder, parameters, seed, state (one of STATES), strain, total_strain, seconds, seconds_left (or None),
    failures, message. Raises ConfigurationError, StorageError.
    """
    path = Path(path)
    if path.is_dir():
        base, source = Folder(path), ""
        content = base.manifest()
        if not content:
            raise StorageError(f"{path} holds no sweep ({MANIFEST} is missing): give the folder of one, or its file")
        entries = [
            _Entry(base.path / e["folder"], None, e["parameters"], e["seed"], e.get("group"), e.get("chosen", False))
            for e in content["points"]
        ]
        groups = content.get("adaptive", [])
        source, former, retries = content["source"], content["no_longer_in_the_file"], content.get("retries", RETRIES)
    else:
        from suspend.sweep.run import prepare

        call = prepare(path, folder)
        base, source, former, retries = call.folder, str(path), call.former, call.sweep.retries
        group_of = {point.key: group for group in call.groups for point in group.points}
        entries = [
            _Entry(call.places[p.key], p.config, p.parameters, p.seed, *_place_in(call, group_of.get(p.key), p))
            for p in call.points
        ]
        groups = [describe(call, group) for group in call.groups]
    points = [entry.describe(retries) for entry in entries]
    return {
        "sweep": str(base.path),
        "file": source,
        "running": holder(base.path, SweepLock.NAME),
        "counts": {state: sum(point["state"] == state for point in points) for state in STATES},
        "seconds": sum(point["seconds"] for point in points),
        "points": points,
        "no_longer_in_the_file": former,
        "adaptive": groups,
    }


def _place_in(call, group: Group | None, point) -> tuple[str | None, bool]:
    """Key of a point's group, and whether it was added to it."""
    if group is None:
        return None, False
    return group.key, value_of(point, call.sweep.adaptive.key) in group.chosen


class _Entry:
    def __init__(self, folder: Path, config, parameters: dict, seed: int, group: str | None, chosen: bool):
        self.folder, self.config, self.parameters, self.seed = folder, config, parameters, seed
        self.group, self.chosen = group, chosen

    def describe(self, retries: int) -> dict[str, Any]:
        config = self.config or self._stored()
        record = read_record(self.folder)
        complete = config is not None and is_complete(self.folder, config)
        state = "complete" if complete else self._state(record, retries)
        total = record.total_strain or (strain_of(config) if config is not None else 0.0)
        gained, spent = record.strain - record.began, record.seconds - record.began_seconds
        left = spent / gained * (total - record.strain) if state == "running" and gained > 0.0 else None
        return {
            "folder": self.folder.name,
            "parameters": self.parameters,
            "seed": self.seed,
            "state": state,
            "strain": record.strain,
            "total_strain": total,
            "seconds": record.seconds,
            "seconds_left": left,
            "failures": record.failures,
            "message": record.message if state != "complete" else "",
        } | ({} if self.group is None else {"group": self.group, "chosen": self.chosen})

    def _stored(self):
        try:
            return loads((self.folder / CONFIGURATION).read_text(encoding="utf-8"))
        except (OSError, ValueError, ConfigurationError):
            return None

    def _state(self, record, retries: int) -> str:
        if at_work(self.folder) is not None:
            return "running"
        if record.failures > retries:
            return "failed"
        return "interrupted" if record.updated else "waiting"


def status_lines(status: dict[str, Any]) -> list[str]:
    """The table of `suspend sweep status`."""
    counts = ", ".join(f"{count} {state}" for state, count in status["counts"].items() if count)
    lines = [f"{status['sweep']}: {len(status['points'])} points: {counts}"]
    if status["running"]:
        lines.append(f"a call is at work ({status['running']})")
    finished = [point["seconds"] for point in status["points"] if point["state"] == "complete" and point["seconds"]]
    if finished:
        median = _time(statistics.median(finished))
        lines.append(f"run time {_time(status['seconds'])} in all, median of the complete points {median}")
    width = max([len(point["folder"]) for point in status["points"]] + [5])
    lines.append(f"{'point'.ljust(width)}  {'state':11} {'strain':>15} {'run time':>9} {'left':>9}")
    for point in status["points"]:
        strain = f"{point['strain']:.4g}/{point['total_strain']:.4g}"
        left = "" if point["seconds_left"] is None else _time(point["seconds_left"])
        lines.append(
            f"{point['folder'].ljust(width)}  {point['state'].ljust(11)} {strain.rjust(15)} "
            f"{_time(point['seconds']).rjust(9)} {left.rjust(9)}".rstrip()
        )
        if point["message"]:
            lines.append(f"    failures: {point['failures']}, the last: {point['message']}")
    lines += [line_of(group) for group in status["adaptive"]]
    if status["no_longer_in_the_file"]:
        lines.append("no longer in the file, kept: " + ", ".join(status["no_longer_in_the_file"]))
    return lines


def _time(seconds: float) -> str:
    minutes, rest = divmod(round(seconds), 60)
    hours, minutes = divmod(minutes, 60)
    return f"{hours}:{minutes:02d}:{rest:02d}" if hours else f"{minutes}:{rest:02d}"
