"""Read-only access to one `trajectory.h5`: header, per-cycle index, rows of any field."""

from __future__ import annotations

import math
from contextlib import suppress
from pathlib import Path
from typing import Any

import h5py
import numpy as np

from suspend.conventions import FORMAT_VERSION
from suspend.errors import StorageError
from suspend.io import h5md
from suspend.io.consistency import contradiction
from suspend.io.files import storage_errors
from suspend.missing import known


def _real(value) -> float:
    """A number that may be missing, which is NaN."""
    return math.nan if value is None else float(value)


class TrajectoryFile:
    """An open trajectory file. Raises StorageError: absent, damaged, foreign, newer format, contradictory contents."""

    def __init__(self, path: Path):
        self.path = path
        self._file = _open(path)
        try:
            with self.reading():
                self._load_header()
        except BaseException:
            self.close()
            raise

    def _load_header(self) -> None:
        parameters = self._file["parameters"]
        version = int(parameters.attrs["format_version"])
        if version > FORMAT_VERSION:
            raise StorageError(
                f"{self.path} has format {version}, this version reads up to {FORMAT_VERSION}: "
                "use a newer suspend"
            )
        self.format_version = version
        self.run_id = str(parameters.attrs["run_id"])
        self.finished = bool(parameters.attrs["finished"])
        self.config_yaml = h5md.get_configuration(self._file)
        self.meta = h5md.read_meta(parameters["meta"])
        self.number, self.length = int(self.meta["number"]), _real(self.meta["L"])
        radius = _real(self.meta.get("radius", 1.0))
        if not (math.isfinite(radius) and radius > 0.0):
            raise StorageError(f"{self.path} is damaged: the radius is {radius:g}; restore it from a copy")
        what = contradiction(self._file, self.number, self.length)
        if what:
            raise StorageError(
                f"{self.path}: its contents contradict each other: {what}; restore the file from a copy, or start the "
                "run anew"
            )
        self.index, self.complete, self.sample_end, self.frame_end = (
            self._file[f"cycles/{name}"][:] for name in ("index", "complete", "sample_end", "frame_end")
        )
        self.frame_rows = len(self._file[h5md.FRAME_STEP]) if h5md.FRAME_STEP in self._file else 0
        self._paths = self._field_paths()

    def _field_paths(self) -> dict[str, str]:
        paths = {"time": h5md.SAMPLE_TIME, "frame_time": h5md.FRAME_TIME}
        paths |= {name: path + "/value" for name, path in h5md.PATHS.items()}
        per_frame = {path.rsplit("/", 1)[1] for path in h5md.PATHS.values() if path.startswith(h5md.SPHERES)}
        for name in self._file["rheology"]:
            paths[name] = f"rheology/{name}/value"
        for name in self._file[h5md.SPHERES]:
            if name not in per_frame | {"box"}:
                paths[name] = f"{h5md.SPHERES}/{name}/value"
        return paths if self.frame_rows else {}

    def reading(self):
        """Context that turns failures of a damaged file into StorageError."""
        return _Reading(self.path)

    @property
    def stored(self) -> int:
        """Number of cycles in the file, an incomplete last one included."""
        return len(self.index)

    @property
    def completed(self) -> int:
        """Number of complete cycles in the file."""
        return int(np.count_nonzero(self.complete))

    def fields(self) -> list[str]:
        """Names of all fields with rows per sample or per frame."""
        return list(self._paths)

    def sample_fields(self) -> list[str]:
        """Names of the time series a record holds."""
        derived = {"cycle", "frame_time", *h5md.PATHS}
        return [name for name in self._paths if name not in derived]

    def is_frame_field(self, name: str) -> bool:
        """True where `name` has one row per frame."""
        return name == "frame_time" or name in h5md.PATHS

    def ends(self, name: str) -> np.ndarray:
        """Row behind the last one of each cycle for field `name`."""
        return self.frame_end if self.is_frame_field(name) else self.sample_end

    def rows(self, name: str, start: int, stop: int) -> np.ndarray:
        """Rows start to stop of a field. Raises StorageError on damage."""
        with self.reading():
            return self._file[self._paths[name]][start:stop]

    def row_layout(self, name: str) -> tuple[np.dtype, tuple[int, ...]]:
        """Type and row shape of a field."""
        dataset = self._file[self._paths[name]]
        return dataset.dtype, dataset.shape[1:]

    def bounds(self, name: str, first: int, last: int) -> tuple[int, int]:
        """Rows of cycles first to last (exclusive) of a field."""
        ends = self.ends(name)
        return (int(ends[first - 1]) if first else 0), (int(ends[last - 1]) if last else 0)

    def record(self, cycle: int) -> dict[str, Any]:
        """The record of one cycle, as it was given to the writer."""
        names = [*self.sample_fields(), *h5md.FRAME_FIELDS]
        record: dict[str, Any] = {"index": int(self.index[cycle]), "complete": bool(self.complete[cycle])}
        record |= {name: self.rows(name, *self.bounds(name, cycle, cycle + 1)) for name in names}
        record["statistics"] = {
            name: column[0].item() for name, column in self.statistics(cycle, cycle + 1).items()
        }
        return record

    def statistics(self, first: int, last: int) -> dict[str, np.ndarray]:
        """Solver statistics of cycles first to last (exclusive), one array per name."""
        with self.reading():
            group = self._file["cycles/statistics"]
            return {name: known(group[name][first:last]) for name in group}

    def checkpoint(self) -> bytes | None:
        """The copy of the checkpoint belonging to the last cycle in the file, or None."""
        with self.reading():
            return h5md.get_checkpoint(self._file)

    def close(self) -> None:
        """Close the file; harmless when done twice."""
        self._file.close()


# what h5py raises, or what follows where it returns something else than was written (a group for a dataset)
_DAMAGE = (OSError, RuntimeError, LookupError, ValueError, TypeError, AttributeError, ArithmeticError)


class _Reading:
    def __init__(self, path: Path):
        self._path = path

    def __enter__(self) -> None:
        return None

    def __exit__(self, kind, error, trace) -> None:
        if isinstance(error, _DAMAGE):
            raise StorageError(f"{self._path} is damaged or no trajectory of suspend ({error})") from error


def _open(path: Path) -> h5py.File:
    # plain errors (absent, folder, permission) before HDF5 words them
    with storage_errors("read", path), open(path, "rb") as handle:
        empty = not handle.read(1)
    if empty:
        raise StorageError(f"{path} is empty: no trajectory of suspend")
    try:
        return h5py.File(path, "r")
    except OSError as error:
        # File systems without locks need none here, as the file is never modified in place. Not at once: HDF5
        # refuses to open a file twice in one process (MDAnalysis beside us) with different ideas of locking.
        with suppress(OSError):
            return h5py.File(path, "r", locking=False)
        raise StorageError(f"{path} is no HDF5 file, or truncated: {error}") from error
