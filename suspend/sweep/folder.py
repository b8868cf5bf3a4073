"""The folder of a sweep: its points' folders and records, what is complete, who is at work."""

from __future__ import annotations

import json
import os
from collections.abc import Iterable
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

from suspend.config import Config, loads
from suspend.errors import ConfigurationError, StorageError
from suspend.flow import make_flow
from suspend.io.files import DirectoryLock, holder, replace_text, storage_errors
from suspend.io.reader import TRAJECTORY, Run
from suspend.sweep.points import Point, configuration_key

MANIFEST = "sweep.json"
CONFIGURATION = "configuration.yaml"
RECORD = "point.json"
LOG = "suspend.log"
LARGEST = 1 << 24  # bytes of a manifest or record


class SweepLock(DirectoryLock):
    """One call at a time in a sweep's folder; the kernel releases it when its holder dies."""

    NAME = "sweep.lock"


class PointLock(DirectoryLock):
    """One process at a time at a point."""

    NAME = "point.lock"


@dataclass(frozen=True)
class Record:
    """What is remembered of a point between calls.

    failures: counted against the retries; message, code: of the last of them; seconds: run time over all calls;
    strain, total_strain, cycles, updated: how far it is; running: a process has begun and not said how it ended;
    attempt: strain at which, and seconds with which, the present or last process began.
    """

    failures: int = 0
    message: str = ""
    code: int = 0
    seconds: float = 0.0
    strain: float = 0.0
    total_strain: float = 0.0
    cycles: int = 0
    updated: float = 0.0
    running: bool = False
    done: bool = False
    began: float = 0.0
    began_seconds: float = 0.0


def read_record(folder: Path) -> Record:
    """The record in a point's folder; an empty one where there is none that can be read."""
    content = _read_json(folder / RECORD)
    empty = asdict(Record())
    right = {name: content[name] for name, value in empty.items() if type(content.get(name)) is type(value)}
    return replace(Record(), **right)


def write_record(folder: Path, record: Record) -> None:
    """Store a point's record; atomic. Raises StorageError."""
    with storage_errors("write", folder / RECORD):
        replace_text(folder / RECORD, json.dumps(asdict(record)), sync=False)


def _read_json(path: Path) -> dict[str, Any]:
    try:
        if path.stat().st_size > LARGEST:
            return {}
        content = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError, RecursionError):
        return {}
    return content if isinstance(content, dict) else {}


class Folder:
    """The folder of a sweep."""

    def __init__(self, path: os.PathLike | str):
        self.path = Path(path)

    def make(self) -> None:
        """Create it where it is missing. Raises StorageError."""
        with storage_errors("create", self.path):
            self.path.mkdir(parents=True, exist_ok=True)

    def make_within(self, name: str) -> Path:
        """Create a folder in it that is none of a point. Raises StorageError."""
        path = self.path / name
        with storage_errors("create", path):
            path.mkdir(parents=True, exist_ok=True)
        return path

    def lock(self) -> SweepLock:
        """Exclusive use of the sweep. Raises InUseError where another call has it."""
        return SweepLock(self.path)

    def manifest(self) -> dict[str, Any]:
        """What the last call wrote of the sweep; empty where there is none."""
        return _read_json(self.path / MANIFEST)

    def write_manifest(
        self, source: str, entries: list[dict], former: list[str], retries: int, groups: list[dict] | None = None
    ) -> None:
        """Write which points there are, where something changed; groups: of an adaptive sweep. Raises StorageError."""
        content = {"source": source, "retries": retries, "points": entries, "no_longer_in_the_file": former}
        content |= {"adaptive": groups} if groups else {}
        if content == self.manifest():
            return
        with storage_errors("write", self.path / MANIFEST):
            replace_text(self.path / MANIFEST, json.dumps(content, indent=1))

    def place(self, points: Iterable[Point]) -> tuple[dict[str, Path], list[str]]:
        """Folder of each point by its key, and the names of folders that hold points of another file.

        A folder belongs to the point whose configuration it holds, whatever its name: a file in which other keys
        vary, or a version with new keys, finds its runs again.
        """
        places, others = {}, []
        wanted = {point.key: point for point in points}
        names = {point.name: key for key, point in wanted.items()}
        for folder in self._folders():
            if folder.name in names:
                places[names[folder.name]] = folder
            else:
                others.append(folder)
        former = []
        for folder in others:
            key = folder.name.rpartition("_")[2]
            key = key if key in wanted else stored_key(folder)
            if key in wanted and key not in places:
                places[key] = folder
            else:
                former.append(folder.name)
        for key, point in wanted.items():
            places.setdefault(key, self.path / point.name)
        return places, former

    def _folders(self) -> list[Path]:
        if not self.path.is_dir():
            return []
        with storage_errors("read", self.path):
            return sorted(p for p in self.path.iterdir() if p.is_dir() and (p / CONFIGURATION).is_file())


def stored_key(folder: Path) -> str | None:
    """Key of the configuration kept in a point's folder, None where it cannot be told."""
    try:
        return configuration_key(loads((folder / CONFIGURATION).read_text(encoding="utf-8")))
    except (OSError, ValueError, ConfigurationError):
        return None


def write_configuration(folder: Path, config: Config) -> None:
    """Keep the resolved configuration in a point's folder, which is made. Raises StorageError."""
    text = config.to_yaml()
    path = folder / CONFIGURATION
    with storage_errors("write", path):
        folder.mkdir(parents=True, exist_ok=True)
        if not path.is_file() or path.read_text(encoding="utf-8") != text:
            replace_text(path, text)


def total_strain(config: Config) -> float:
    """Accumulated strain of the whole run (time x rate without oscillation)."""
    flow = make_flow(config)
    return float(flow.accumulated(flow.cycles - 1, flow.period(flow.cycles - 1)))


def is_complete(folder: Path, config: Config) -> bool:
    """Whether the run in the folder is finished for the duration asked, or at its steady state where that ends it.

    A damaged run is not.
    """
    if not (folder / TRAJECTORY).is_file():
        return False
    try:
        with Run(folder) as run:
            finished, cycles, stored = run.finished, run.cycles, run.config_yaml
    except StorageError:
        return False
    asked = make_flow(config).cycles
    if cycles > asked and config.flow.type == "oscillatory":
        return True  # it was begun for longer, and stays as it is
    if not finished:
        return False
    if cycles >= asked or _ended_steady(stored, cycles, config.duration.until_steady):
        return True
    # A steady run that was extended keeps its first blocks, so counts others.
    record, asked = read_record(folder), total_strain(config)
    return config.flow.type != "oscillatory" and record.done and record.total_strain >= asked * (1.0 - 1e-9)


def _ended_steady(stored: str, cycles: int, until_steady: float | None) -> bool:
    """Whether a finished run ended at its steady state, by a test no weaker than that asked for.

    What a stricter test has established holds for a weaker one too. Other runs are looked at when they go on.
    """
    if until_steady is None:
        return False
    before = loads(stored, source="the stored configuration")
    strict = before.duration.until_steady
    return strict is not None and strict <= until_steady and cycles < make_flow(before).cycles


def at_work(folder: Path) -> str | None:
    """Who computes this point ("pid 17 on host"), None where nobody does."""
    return holder(folder, PointLock.NAME) or holder(folder)


def failure_text(failed: list[tuple[str, str]], total: int) -> str:
    """What is said of points that failed for good: (folder, message)."""
    lines = [f"{name}: {message or 'unknown'}" for name, message in failed[:5]]
    more = [f"and {len(failed) - 5} more"] if len(failed) > 5 else []
    head = f"{len(failed)} of {total} points failed for good, all others are complete; --retry-failed tries them again"
    return "\n  ".join([head, *lines, *more])
