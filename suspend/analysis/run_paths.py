"""Where the runs are: folders, folders of folders, trajectory files, glob patterns."""

from __future__ import annotations

import glob
import os
from collections.abc import Iterable, Iterator
from pathlib import Path

from suspend.errors import ConfigurationError, StorageError
from suspend.io.reader import TRAJECTORY


def find_runs(paths: os.PathLike | str | Iterable[os.PathLike | str]) -> list[Path]:
    """Runs at the paths: run folders, trajectory files, folders that hold runs, or glob patterns; each once."""
    if isinstance(paths, str | os.PathLike):
        paths = [paths]
    found: dict[Path, Path] = {}
    for given in paths:
        for path in _expand(os.fspath(given)):
            found.setdefault(path.resolve(), path)
    return list(found.values())


def _expand(given: str) -> Iterator[Path]:
    path = Path(given)
    if path.exists():
        inner = sorted(p for p in path.iterdir() if (p / TRAJECTORY).exists()) if path.is_dir() else []
        yield from [path] if (path / TRAJECTORY).exists() or not inner else inner
        return
    if not glob.has_magic(given):
        raise StorageError(f"{given} does not exist: give run folders, a folder that holds them, or a glob pattern")
    matches = [Path(match) for match in sorted(glob.glob(given))]
    runs = [match for match in matches if match.is_file() or (match / TRAJECTORY).exists()]
    folders = [match for match in runs if match.is_dir()]  # a pattern may match the runs' summaries beside them
    if not runs:
        raise ConfigurationError(f"{given} matches no run")
    yield from folders or runs
