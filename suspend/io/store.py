"""`RunStore`: the writing side of a run directory. Killed at any instant, it loses no completed cycle.

    trajectory.h5     all cycles up to the last consolidation; always closed and valid, replaced atomically
    cycles.journal    completed cycles since then, appended (see `journal`); absent after a finished run
    checkpoint.npz    the solver's state at the last `save`, replaced atomically
    moduli.csv        one line per completed cycle, repaired on resuming
    run.lock          one writer per directory

Order of writing: record to the journal, state to the checkpoint, line to the table; now and then journal
into trajectory.h5 together with a copy of the checkpoint, and only then the journal is removed. So at any
instant the records reach at least as far as the checkpoint; a record ahead of it is dropped on resuming
and computed again. Per cycle nothing waits for the device: kill -9 cannot lose what the kernel has. A
power cut can; then the copy of the checkpoint in trajectory.h5, written with fsync, is the state to
continue from.
"""

from __future__ import annotations

import os
import shutil
import time
import uuid
from collections.abc import Callable
from pathlib import Path

import h5py
import numpy as np

from suspend.errors import StorageError
from suspend.io import h5md
from suspend.io.checkpoint import read_checkpoint, write_checkpoint
from suspend.io.files import (
    DirectoryLock,
    remove_temporaries,
    replace_atomically,
    storage_errors,
    write_bytes,
)
from suspend.io.journal import JOURNAL_REMEDY, Journal, append_record, size_of, truncate_journal
from suspend.io.reader import CHECKPOINT, JOURNAL, TRAJECTORY, Run
from suspend.io.schema import FRAME_FIELDS, check_record, schema_of, steps
from suspend.io.table import CycleTable

INTERVAL = 10.0  # seconds between consolidations, at least
COPY_SHARE = 0.05  # of the run's time that consolidations may take: large files are rewritten more rarely
END = "end"  # in `meta`: why the run ended
BATCH_BYTES = 32 << 20  # journal bytes in memory at once while consolidating


def holds_run(directory: os.PathLike | str) -> bool:
    """True where `directory` holds a run that can be resumed or extended. Raises StorageError for damage."""
    directory = Path(directory)
    if (directory / CHECKPOINT).exists():
        return True
    if not (directory / TRAJECTORY).exists():
        return False
    with Run(directory) as run:
        return run.stored > 0


class RunStore:
    """Writer of one run directory; made by `create` or `open`, left by `close` or as a context manager.

    `notes` lists what was found and repaired on opening, for the user to see.
    """

    def __init__(self, directory: Path, lock: DirectoryLock, table: CycleTable | None, interval: float):
        self.directory, self._lock, self._table = directory, lock, table
        self._interval, self._cost, self._last = interval, 0.0, time.monotonic()
        self.notes: list[str] = [lock.note] if lock.note else []
        self._content: dict | None = None  # of the checkpoint
        self._schema = None
        self._stored = self.cycles_done = 0
        self._lines: tuple[str, str] = ("", "")
        self._journal_bytes = 0  # as this writer left it

    @classmethod
    def create(
        cls,
        directory: os.PathLike | str,
        config_yaml: str,
        meta: dict,
        table: CycleTable | None = None,
        interval: float = INTERVAL,
    ) -> RunStore:
        """Start a run in a new or empty-of-runs directory (made with its parents).

        `config_yaml`: resolved configuration; `meta`: nested dict of scalars with at least number and L (cell
        edge); `interval`: seconds between rewritings of trajectory.h5 (0: every cycle). Raises StorageError,
        also where the directory holds a run already.
        """
        directory = Path(directory)
        made = _make_folder(directory)
        try:
            lock = DirectoryLock(directory)
        except BaseException:
            if made:
                shutil.rmtree(directory, ignore_errors=True)
            raise
        try:
            if holds_run(directory):
                raise StorageError(f"{directory} holds a run already: resume it or choose another folder")
            store = cls(directory, lock, table, interval)
            store._begin(config_yaml, meta)
        except BaseException:
            lock.release()
            if made:
                shutil.rmtree(directory, ignore_errors=True)
            raise
        return store

    def _files(self) -> list[str]:
        """Names of the files that the holder of the lock writes."""
        return [TRAJECTORY, CHECKPOINT, JOURNAL, *([self._table.name] if self._table else [])]

    def _begin(self, config_yaml: str, meta: dict) -> None:
        self.run_id, self.config_yaml, self.meta, self.finished = uuid.uuid4().hex, config_yaml, meta, False
        path = self.directory / TRAJECTORY
        with storage_errors("create", path):
            remove_temporaries(self.directory, self._files())
            (self.directory / JOURNAL).unlink(missing_ok=True)
            data = h5md.empty_file(config_yaml, meta, self.run_id)
            replace_atomically(path, lambda temporary: write_bytes(temporary, [data]), sync=True)
        if self._table:
            self._table.repair(self.directory, [], 0, None)

    @classmethod
    def open(
        cls, directory: os.PathLike | str, table: CycleTable | None = None, interval: float = INTERVAL
    ) -> RunStore:
        """Open an existing run to continue or extend it; repairs what a kill left. Raises StorageError."""
        directory = Path(directory)
        if not (directory / TRAJECTORY).exists():
            raise StorageError(f"{directory} holds no run ({TRAJECTORY} is missing): check the path")
        lock = DirectoryLock(directory)
        try:
            store = cls(directory, lock, table, interval)
            store._recover()
        except BaseException:
            lock.release()
            raise
        return store

    def _recover(self) -> None:
        with storage_errors("tidy up", self.directory):
            remove_temporaries(self.directory, self._files())
        with Run(self.directory) as run:
            self.run_id, self.config_yaml, self.meta = run.run_id, run.config_yaml, run.meta
            self._content = self._latest_checkpoint(run)
        self.cycles_done = self._content["cycles"] if self._content else 0
        self._drop_journal_from(self.cycles_done)
        self._journal_bytes = size_of(self.directory / JOURNAL)
        with Run(self.directory) as run:
            self._stored, self.finished = run.stored, run.finished
            last = run.cycle(run.stored - 1) if run.stored else None
            self._schema = schema_of(last) if last else None
            if self._table:
                complete = run.cycle(run.cycles - 1) if run.cycles else None
                if self._table.repair(self.directory, run.records(0, run.cycles), run.cycles, complete):
                    self.notes.append(f"{self._table.name} was incomplete and has been written anew")

    def _latest_checkpoint(self, run: Run) -> dict | None:
        path, found = self.directory / CHECKPOINT, []
        copy = run.stored_checkpoint()
        if copy is not None:
            found.append(read_checkpoint(copy, f"the checkpoint in {run.path}"))
        if path.exists():
            try:
                found.append(read_checkpoint(path))
            except StorageError as error:
                if not found:
                    raise
                self.notes.append(f"{error}; continuing from the copy in {run.path.name}")
        if any(content["run_id"] != self.run_id for content in found):
            raise StorageError(f"{path} belongs to another run than {run.path}: move one of them elsewhere")
        usable = [content for content in found if content["cycles"] <= run.cycles]
        if found and not usable:
            raise StorageError(
                f"{path} is at cycle {found[-1]['cycles']}, but only {run.cycles} cycles are stored: those between "
                f"are lost ({JOURNAL} was removed?); restore it, or move {path.name} away and start in another folder"
            )
        if len(usable) < len(found):
            self.notes.append(
                f"the newest checkpoint is ahead of the stored cycles; continuing from {run.path.name}"
            )
        return max(usable, key=lambda content: content["sequence"], default=None)

    def _drop_journal_from(self, cycle: int) -> None:
        path = self.directory / JOURNAL
        journal = Journal(path)
        journal.close()
        behind = [entry for entry in journal.entries if entry.cycle >= cycle]
        if not path.exists():
            return
        if len(behind) == len(journal.entries):
            with storage_errors("remove", path):
                path.unlink()
            return
        kept = [entry for entry in journal.entries if entry.cycle < cycle][-1]
        truncate_journal(path, kept.offset + kept.length)

    @property
    def has_state(self) -> bool:
        """True once a state has been saved."""
        return self._content is not None

    def load_state(self) -> tuple[dict, dict | None]:
        """Saved solver state; partial record of the cycle in progress or None. Raises StorageError."""
        if self._content is None:
            raise StorageError(f"{self.directory} has no checkpoint yet: start the run anew")
        saved = "state" not in self._content  # by this store itself, which keeps no copy in memory
        content = read_checkpoint(self.directory / CHECKPOINT) if saved else self._content
        return content["state"], content["partial"]

    def append_cycle(self, record: dict) -> None:
        """Add the record of a cycle that has ended; call `save` with the state at its end right after.

        Cycles come in order. A last one that is not complete (steady shear of 4.5 strain units) is
        replaced by the record of the same index once the run is extended. Raises StorageError, ValueError
        for a wrong record.
        """
        if record["index"] != self.cycles_done:
            raise ValueError(f"record of cycle {record['index']}, but {self.cycles_done} cycles are complete")
        self._schema = check_record(record, int(self.meta["number"]), self._schema)
        self._check_journal()
        append_record(self.directory / JOURNAL, self.run_id, record)
        self._journal_bytes = size_of(self.directory / JOURNAL)
        self._stored = record["index"] + 1
        if record["complete"]:
            self.cycles_done += 1
            if self._table:
                header, line = self._table.line(record)
                self._lines = (header, self._lines[1] + line)

    def _check_journal(self) -> None:
        """Raises StorageError where another than this writer has removed, shortened or lengthened the journal."""
        path = self.directory / JOURNAL
        found = size_of(path)
        if found != self._journal_bytes:
            raise StorageError(
                f"{path} was changed from outside while the run went on ({found} bytes, {self._journal_bytes} were "
                f"written): completed cycles in it are lost; {JOURNAL_REMEDY}"
            )

    def save(self, state: dict, partial: dict | None = None) -> None:
        """Replace the checkpoint: `state` (nested arrays, scalars) and `partial` record of a begun cycle.

        Then adds the lines of new cycles to the table and consolidates when it is time. Raises StorageError.
        """
        self._save(state, partial)
        pause = max(self._interval, self._cost / COPY_SHARE) if self._interval else 0.0
        if time.monotonic() - self._last >= pause:
            self.consolidate()

    def _save(self, state: dict, partial: dict | None) -> None:
        content = {
            "run_id": self.run_id,
            "sequence": self._content["sequence"] + 1 if self._content else 0,
            "cycles": self.cycles_done,
            "config_yaml": self.config_yaml,
            "state": state,
            "partial": partial,
        }
        write_checkpoint(self.directory / CHECKPOINT, content)
        self._content = {"sequence": content["sequence"], "cycles": self.cycles_done}
        if self._lines[1]:
            self._table.append(self.directory, *self._lines)
            self._lines = ("", "")

    def update_configuration(self, config_yaml: str) -> None:
        """Store a changed configuration (longer duration); the run is then open. Raises StorageError."""
        self.config_yaml = config_yaml
        self.meta.pop(END, None)
        self._rewrite(lambda file: None, finished=False)

    def consolidate(self) -> None:
        """Move the journal into trajectory.h5 and remove it. Needs a `save` after the last cycle.

        Raises StorageError; then all earlier data stay as they were.
        """
        self._rewrite(lambda file: None, finished=self.finished and not (self.directory / JOURNAL).exists())

    def finish(
        self, state: dict, final_frame: dict, partial: dict | None = None, end: str | None = None
    ) -> None:
        """Save, store the final positions as an extra frame, consolidate, and mark the run finished.

        `final_frame`: frame_time, frame_strain, tilt (1,), position, image, unwrapped (1, N, 3), and
        frame_phase (1,) where the last cycle is incomplete (`partial` is then what a longer run continues);
        end: why it ended, kept as `meta["end"]` until the run is extended. Raises StorageError.
        """
        self._save(state, partial)
        self.meta.pop(END, None)
        self.meta |= {} if end is None else {END: end}
        frame = {"index": self.cycles_done, "frame_phase": np.zeros(1), **final_frame}
        if self._stored == self.cycles_done:
            frame["frame_phase"] = np.zeros(1)
        frame = {name: np.asarray(value) for name, value in frame.items() if name in FRAME_FIELDS} | {
            "index": frame["index"]
        }
        self._rewrite(lambda file: self._append_final(file, frame), finished=True)

    def _append_final(self, file: h5py.File, frame: dict) -> None:
        h5md.truncate(file, len(file["cycles/index"]))
        rows = file.get(h5md.FRAME_STEP, ())
        if not len(rows) or rows[-1] != steps(frame["index"], frame["frame_phase"])[0]:
            h5md.append_frames(file, [frame], float(self.meta["L"]))

    def _rewrite(self, change: Callable[[h5py.File], None], finished: bool) -> None:
        started = time.monotonic()
        self._check_journal()
        if self._content is not None and self._content["cycles"] != self.cycles_done:
            raise ValueError("save the state before consolidating")
        path = self.directory / TRAJECTORY
        with storage_errors("write", path, advice="the data stored before are intact"):
            replace_atomically(path, lambda temporary: self._fill(temporary, change, finished), sync=True)
        with storage_errors("remove", self.directory / JOURNAL):
            (self.directory / JOURNAL).unlink(missing_ok=True)
        self._journal_bytes = 0
        self.finished = finished
        self._last = time.monotonic()
        self._cost = self._last - started

    def _fill(self, temporary: Path, change: Callable[[h5py.File], None], finished: bool) -> None:
        shutil.copyfile(self.directory / TRAJECTORY, temporary)
        checkpoint = self.directory / CHECKPOINT
        data = checkpoint.read_bytes() if checkpoint.exists() else None
        journal = Journal(self.directory / JOURNAL)
        try:
            entries = journal.entries
            added = sum(entry.length for entry in entries) + len(data or b"") + 64 * int(self.meta["number"])
            _reserve(
                temporary, int(1.1 * added) + (4 << 20)
            )  # records, state, final frame, partly filled chunks
            with h5py.File(temporary, "r+", locking=False) as file:
                if entries:
                    h5md.truncate(file, entries[0].cycle)
                for batch in _batches(entries):
                    records = [journal.read(entry) for entry in batch]
                    h5md.append(file, records, int(self.meta["number"]), float(self.meta["L"]))
                change(file)
                if data is not None:
                    h5md.set_checkpoint(file, data)
                if h5md.get_configuration(file) != self.config_yaml:
                    h5md.set_configuration(file, self.config_yaml)
                file["parameters"].attrs["finished"] = finished
                h5md.set_meta(file, END, self.meta.get(END))
        finally:
            journal.close()

    def close(self) -> None:
        """Release the directory; writes nothing. Harmless when done twice."""
        self._lock.release()

    def __enter__(self) -> RunStore:
        return self

    def __exit__(self, *_) -> None:
        self.close()


def _make_folder(directory: Path) -> bool:
    """Make the folder and its parents; True where this call made it (and may remove it again)."""
    with storage_errors("create the folder", directory):
        directory.parent.mkdir(parents=True, exist_ok=True)
        try:
            directory.mkdir()
        except FileExistsError:
            if not directory.is_dir():
                raise
            return False
    return True


def _reserve(path: Path, added: int) -> None:
    """Give the file `added` bytes more on the device; HDF5 gives back what it does not need. Raises OSError.

    HDF5 can crash when the disk fills up while it writes, so a full disk has to show before.
    """
    with open(path, "r+b") as handle:
        os.posix_fallocate(handle.fileno(), os.fstat(handle.fileno()).st_size, added)


def _batches(entries: list) -> list[list]:
    """Group journal entries so that each group stays below BATCH_BYTES (or is a single cycle)."""
    groups: list[list] = []
    size = 0
    for entry in entries:
        if not groups or size + entry.length > BATCH_BYTES:
            groups.append([])
            size = 0
        groups[-1].append(entry)
        size += entry.length
    return groups
