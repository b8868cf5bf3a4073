"""One starting configuration for all points with the same spheres and seed: made once, kept with the sweep."""

from __future__ import annotations

import dataclasses
import hashlib
import importlib
import json
import time
import zipfile
from pathlib import Path
from typing import Any

import numpy as np

from suspend.config import Config
from suspend.initial import InitialConfiguration, prepare_initial
from suspend.io.files import DirectoryLock, InUseError, replace_atomically, storage_errors

FOLDER = "starts"
PATIENCE = 0.5  # seconds between looks at a start that another point is making


def made_from_seed(config: Config) -> bool:
    """True where the start is made, not read: only then is there a smallest gap to ask for."""
    return config.particles.minimum_gap is not None


def start_key(config: Config) -> str:
    """Hash of all that a made start depends on: the spheres and the seed."""
    content = {"seed": config.seed, "particles": config.to_dict()["particles"]}
    return hashlib.sha256(json.dumps(content, sort_keys=True).encode()).hexdigest()[:10]


class _StartLock(DirectoryLock):
    NAME = "start.lock"


def shared_start(config: Config, sweep_folder: Path) -> InitialConfiguration:
    """The start of this configuration: read from the sweep's folder, or made and stored there.

    Several processes may ask at once; one makes it, the others wait. Raises as `prepare_initial`, StorageError.
    """
    if not made_from_seed(config):
        return prepare_initial(config, config.directory)
    folder = sweep_folder / FOLDER / start_key(config)
    path = folder / "start.npz"
    with storage_errors("create", folder):
        folder.mkdir(parents=True, exist_ok=True)
    while True:
        found = read_start(path)
        if found is not None:
            return found
        try:
            lock = _StartLock(folder)
        except InUseError:
            time.sleep(PATIENCE)
            continue
        try:
            found = read_start(path) or prepare_initial(config, config.directory)
            write_start(path, found)
            return found
        finally:
            lock.release()


def write_start(path: Path, start: InitialConfiguration) -> None:
    """Store a start; atomic. Raises StorageError."""
    content: dict[str, np.ndarray] = {}
    _flatten("", start, content)

    def fill(temporary: Path) -> None:
        with open(temporary, "wb") as file:
            np.savez(file, **content)

    with storage_errors("write", path):
        replace_atomically(path, fill, sync=True)


def read_start(path: Path) -> InitialConfiguration | None:
    """A stored start; None where there is none, or none that this version reads (the seed makes the same again)."""
    try:
        with np.load(path, allow_pickle=False) as file:
            content = {name: file[name] for name in file.files}
        return _restore("", InitialConfiguration, content)
    except (OSError, ValueError, KeyError, TypeError, AttributeError, ImportError, EOFError, zipfile.BadZipFile):
        return None


def _flatten(prefix: str, values: Any, content: dict[str, np.ndarray]) -> None:
    for name in _fields(type(values)):
        value = getattr(values, name)
        if _fields(type(value)):
            kind = type(value)
            content[f"{prefix}{name}"] = np.array(f"{kind.__module__}:{kind.__qualname__}")
            _flatten(f"{prefix}{name}.", value, content)
        elif isinstance(value, np.ndarray):
            content[f"{prefix}{name}"] = value
        else:
            content[f"{prefix}{name}"] = np.array(json.dumps(value.item() if isinstance(value, np.generic) else value))


def _fields(kind: type) -> list[str]:
    """Names of the fields of a named tuple or dataclass, none of anything else."""
    if dataclasses.is_dataclass(kind):
        return [field.name for field in dataclasses.fields(kind)]
    return list(getattr(kind, "_fields", ()))


def _restore(prefix: str, kind: type, content: dict[str, np.ndarray]) -> Any:
    values = {}
    for name in _fields(kind):
        value = content[f"{prefix}{name}"]
        if value.dtype.kind != "U":
            values[name] = value
        elif str(value).startswith("suspend."):
            module, _, inner = str(value).partition(":")
            values[name] = _restore(f"{prefix}{name}.", getattr(importlib.import_module(module), inner), content)
        else:
            entry = json.loads(str(value))
            values[name] = tuple(entry) if isinstance(entry, list) else entry
    return kind(**values)
