"""`Run`: read a finished or a running simulation, cycle by cycle or as long series, with bounded memory."""

from __future__ import annotations

import os
from collections.abc import Iterator
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from suspend.errors import StorageError
from suspend.io.h5md import FRAME_FIELDS
from suspend.io.journal import JOURNAL_REMEDY, Journal
from suspend.io.trajectory import TrajectoryFile
from suspend.missing import known

TRAJECTORY, CHECKPOINT, JOURNAL = "trajectory.h5", "checkpoint.npz", "cycles.journal"

_SECTIONS = ("particles", "fluid", "flow", "duration", "output", "integrator", "solver")  # mappings in every run


class Run:
    """The stored part of a run, opened from its directory or from a trajectory file alone.

    From a directory, completed cycles that are not in trajectory.h5 yet are included, also while the run
    goes on; what is seen is the state at opening. Units: those of the configuration. Raises StorageError
    where the path is missing, truncated, foreign or of a newer format. Use it as a context manager or
    call `close`.
    """

    def __init__(self, path: os.PathLike | str):
        path = Path(path)
        if not path.exists():
            raise StorageError(
                f"{path} does not exist: give the output directory of a run or its {TRAJECTORY}"
            )
        self._journal = None
        if path.is_dir():
            # the journal first: cycles that leave it meanwhile are then found in the trajectory
            self._journal = Journal(path / JOURNAL)
            path = path / TRAJECTORY
        self.path = path
        try:
            self._base = TrajectoryFile(path)
        except BaseException:
            self.close()
            raise
        try:
            self._merge()
        except BaseException:
            self.close()
            raise

    def _merge(self) -> None:
        self._base_cycles, self._tail = self._base.stored, {}
        entries = self._journal.entries if self._journal else []
        if not entries:
            return
        if self._journal.run_id != self._base.run_id:
            raise StorageError(
                f"{self._journal.path} belongs to another run than {self.path}: move one of them elsewhere"
            )
        last = entries[-1]
        if (last.cycle + last.complete, last.cycle + 1) <= (self._base.completed, self._base.stored):
            return  # all of them are in the trajectory already
        first = entries[0].cycle
        if first > self._base.stored:
            raise StorageError(
                f"{self.path} holds {self._base.stored} cycles, {self._journal.path} begins behind them, at cycle "
                f"{first}: cycles are missing; restore the two files that belong together, or {JOURNAL_REMEDY}"
            )
        self._base_cycles = first
        self._tail = {entry.cycle: entry for entry in entries}

    def __enter__(self) -> Run:
        return self

    def __exit__(self, *_) -> None:
        self.close()

    def close(self) -> None:
        """Close the files; harmless when done twice."""
        for part in (self._journal, getattr(self, "_base", None)):
            if part is not None:
                part.close()

    @property
    def config_yaml(self) -> str:
        """The resolved configuration, as YAML text."""
        return self._base.config_yaml

    @cached_property
    def config(self) -> dict:
        """The resolved configuration, parsed. Raises StorageError where the text is no mapping."""
        try:
            tree = yaml.safe_load(self.config_yaml)
        except yaml.YAMLError as error:
            raise StorageError(f"{self.path}: the stored configuration is no valid YAML ({error})") from error
        if not isinstance(tree, dict):
            raise StorageError(f"{self.path}: the stored configuration is no mapping")
        wrong = [name for name in _SECTIONS if not isinstance(tree.get(name, {}), dict)]
        if wrong:
            raise StorageError(f"{self.path}: the stored configuration is damaged: {wrong[0]} holds no keys")
        return tree

    @property
    def meta(self) -> dict:
        """Facts of the run: number, radius, L, viscosity, versions, seed, ... as given to the writer."""
        return self._base.meta

    @property
    def run_id(self) -> str:
        """Random name of this run, the same in all its files."""
        return self._base.run_id

    @property
    def finished(self) -> bool:
        """True where the run reached its configured duration, or the steady state that ends it."""
        return self._base.finished and not self._tail

    @property
    def stored(self) -> int:
        """Number of stored cycles, an incomplete last one (steady shear of 4.5 strain units) included."""
        return max(self._tail, default=self._base_cycles - 1) + 1

    @property
    def cycles(self) -> int:
        """Number of complete cycles."""
        complete = int(np.count_nonzero(self._base.complete[: self._base_cycles]))
        return complete + sum(entry.complete for entry in self._tail.values())

    @property
    def pending(self) -> int:
        """Number of cycles still in the journal."""
        return len(self._tail)

    @property
    def n_samples(self) -> int:
        """Number of samples in all stored cycles."""
        return self._base.bounds("time", 0, self._base_cycles)[1] + sum(
            e.samples for e in self._tail.values()
        )

    @property
    def n_frames(self) -> int:
        """Number of position frames, the final one included."""
        return self._base_frames + sum(entry.frames for entry in self._tail.values())

    @property
    def _base_frames(self) -> int:
        # the final frame lies behind the last cycle; the first frame of a following cycle replaces it
        return (
            self._base.bounds("frame_time", 0, self._base_cycles)[1] if self._tail else self._base.frame_rows
        )

    def cycle(self, k: int) -> dict[str, Any]:
        """Record of cycle k (0-based; negative from the end), bit for bit as written. Raises IndexError.

        Statistics without a value are NaN, also where an older version wrote an infinity.
        """
        cycles = self.stored
        if not -cycles <= k < cycles:
            raise IndexError(f"cycle {k} of {cycles}")
        k %= cycles
        if k < self._base_cycles:
            return self._base.record(k)
        record = self._journal.read(self._tail[k])
        return record | {"statistics": {name: known(value) for name, value in record["statistics"].items()}}

    def records(self, first: int = 0, last: int | None = None) -> Iterator[dict[str, Any]]:
        """Records of cycles first to last (exclusive; default all stored), one in memory at a time."""
        for k in range(*self._range(first, last)):
            yield self.cycle(k)

    def _range(self, first: int, last: int | None) -> tuple[int, int]:
        last = self.stored if last is None else last
        if not 0 <= first <= last <= self.stored:
            raise IndexError(f"cycles {first} to {last} of {self.stored}")
        return first, last

    @property
    def fields(self) -> list[str]:
        """Names that `series` accepts."""
        if self._base.stored:
            return self._base.fields()
        names = [name for name in self.cycle(0) if name not in ("index", "complete", "statistics")]
        return [*names, "cycle", "frame_cycle"] if names else []

    def series(self, name: str, first: int = 0, last: int | None = None) -> np.ndarray:
        """Field `name` of cycles first to last (exclusive; default all stored) joined along its first axis.

        One row per sample (time, strain, stress_...) or per frame (frame_time, tilt, position, ...;
        without the final frame); "cycle" and "frame_cycle" give the cycle of each row. Raises KeyError
        for other names.
        """
        first, last = self._range(first, last)
        if self.stored == 0 or name not in self.fields:
            raise KeyError(
                f"no field {name!r} in {self.path}; there are {', '.join(self.fields or ['none'])}"
            )
        split = min(last, self._base_cycles)
        parts = []
        if first < split:
            parts.append(self._base.rows(name, *self._base.bounds(name, first, split)))
        parts += [self._tail_rows(name, k) for k in range(max(first, self._base_cycles), last)]
        if not parts:
            return self.series(name, 0, 1)[:0]
        return parts[0] if len(parts) == 1 else np.concatenate(parts)

    def sample(self, name: str, cycle: int, i: int) -> np.ndarray:
        """Time series `name` at sample i of a cycle, without reading the others. Raises IndexError, KeyError."""
        if not 0 <= cycle < self.stored:
            raise IndexError(f"cycle {cycle} of {self.stored}")
        if cycle >= self._base_cycles:
            return self.cycle(cycle)[name][i]
        start, stop = self._base.bounds(name, cycle, cycle + 1)
        if not 0 <= i < stop - start:
            raise IndexError(f"sample {i} of {stop - start}")
        return self._base.rows(name, start + i, start + i + 1)[0]

    def _tail_rows(self, name: str, k: int) -> np.ndarray:
        record = self.cycle(k)
        if name in ("cycle", "frame_cycle"):
            return np.full(len(record["time" if name == "cycle" else "frame_time"]), k, np.int64)
        return record[name]

    def frame(self, i: int) -> dict[str, Any]:
        """Frame i (negative from the end): time, strain, phase, tilt, cycle; position, image, unwrapped.

        Raises IndexError.
        """
        if not -self.n_frames <= i < self.n_frames:
            raise IndexError(f"frame {i} of {self.n_frames}")
        return next(self.frames(i % self.n_frames, i % self.n_frames + 1))

    def frames(self, first: int = 0, last: int | None = None) -> Iterator[dict[str, Any]]:
        """Frames first to last (exclusive; default all, the final one included), one in memory at a time."""
        last = self.n_frames if last is None else min(last, self.n_frames)
        for i in range(first, min(last, self._base_frames)):
            yield _frame(
                {name: self._base.rows(name, i, i + 1) for name in (*FRAME_FIELDS, "frame_cycle")}, 0
            )
        start = self._base_frames
        for k, entry in self._tail.items():
            wanted = range(max(first, start), min(last, start + entry.frames))
            if wanted:
                record = self.cycle(k)
                record["frame_cycle"] = np.full(entry.frames, k, np.int64)
                yield from (_frame(record, i - start) for i in wanted)
            start += entry.frames

    def cycle_start_unwrapped(self, chunk: int = 64) -> Iterator[np.ndarray]:
        """Unwrapped positions at the cycle starts, the final frame of whole cycles included, in order.

        Yields arrays (m, N, 3) with m <= chunk, float64; joined they have one row per cycle start.
        """
        phases = self._base.rows("frame_phase", 0, self._base_frames) if self._base_frames else np.empty(0)
        starts = np.flatnonzero(phases == 0.0)
        for i in range(0, len(starts), chunk):
            part = starts[i : i + chunk]
            yield np.concatenate([self._base.rows("unwrapped", *span) for span in _spans(part)])
        rows: list[np.ndarray] = []
        for k in self._tail:
            record = self.cycle(k)
            rows += [record["unwrapped"][j] for j in np.flatnonzero(record["frame_phase"] == 0.0)]
            if len(rows) >= chunk:
                yield np.stack(rows)
                rows = []
        if rows:
            yield np.stack(rows)

    def stored_checkpoint(self) -> bytes | None:
        """The copy of checkpoint.npz inside the trajectory file, or None."""
        return self._base.checkpoint()

    def statistics(self) -> dict[str, np.ndarray]:
        """Solver statistics, one array per name with one value per stored cycle."""
        columns = self._base.statistics(0, self._base_cycles) if self._base.stored else {}
        tail = [self.cycle(k)["statistics"] for k in self._tail]
        if not tail:
            return columns
        return {
            name: np.concatenate([columns[name], new]) if name in columns else new
            for name, new in ((name, np.array([row[name] for row in tail])) for name in tail[0])
        }


def _spans(rows: np.ndarray) -> list[tuple[int, int]]:
    """Runs of consecutive row numbers as (start, stop)."""
    breaks = np.flatnonzero(np.diff(rows) != 1) + 1
    return [(int(run[0]), int(run[-1]) + 1) for run in np.split(rows, breaks)]


def _frame(record: dict, i: int) -> dict[str, Any]:
    names = ("frame_time", "frame_strain", "frame_phase", "frame_cycle", "tilt")
    scalars = {name.removeprefix("frame_"): record[name][i].item() for name in names}
    return scalars | {name: record[name][i] for name in ("position", "image", "unwrapped")}
