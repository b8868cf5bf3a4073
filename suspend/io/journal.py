"""`cycles.journal`: completed cycles that are not in trajectory.h5 yet, appended one by one.

HDF5 files cannot be extended safely under kill -9, so a finished cycle first goes here, with one write
that costs as much as the cycle and no more; from time to time the journal is moved into a fresh copy of
trajectory.h5.
Layout: header (magic, version, run id), then per cycle a frame (magic, index, complete, samples, frames,
length, crc32) and its bytes (`codec.pack`). A torn or damaged tail ends the journal: nothing behind it is
believed.
"""

from __future__ import annotations

import os
import struct
import zlib
from pathlib import Path
from typing import NamedTuple

from suspend.conventions import FORMAT_VERSION
from suspend.errors import StorageError
from suspend.io.codec import pack, unpack
from suspend.io.files import append_or_restore, storage_errors

_HEADER = struct.Struct("<16sI32s")
_FRAME = struct.Struct("<4sqqqqqI")
_MAGIC = b"suspend journal\n"
_FRAME_MAGIC = b"CYCL"
_CHUNK = 1 << 22
JOURNAL_REMEDY = (
    "move it away and run again: the run then continues from the last cycle in trajectory.h5, with the same results"
)


class Entry(NamedTuple):
    """One cycle in the journal: its counts and where its bytes lie."""

    cycle: int
    complete: bool
    samples: int
    frames: int
    offset: int
    length: int


class Journal:
    """Reading side: scans the file once, then hands out one record at a time.

    The file is held open, so a journal that the writer removes meanwhile stays readable. An absent file is an
    empty journal. Raises StorageError for a foreign file or a newer format.
    """

    def __init__(self, path: Path):
        self.path, self.run_id, self.entries, self.end = path, "", [], 0
        try:
            self._descriptor = os.open(path, os.O_RDONLY)
        except FileNotFoundError:
            self._descriptor = -1
            return
        except OSError as error:
            raise StorageError(f"cannot read {path}: {error.strerror}") from error
        try:
            self._scan()
        except BaseException:
            self.close()
            raise

    def _scan(self) -> None:
        with storage_errors("read", self.path):
            header = os.pread(self._descriptor, _HEADER.size, 0)
            if len(header) < _HEADER.size:
                return  # killed while the file was created: no cycle in it
            magic, version, run_id = _HEADER.unpack(header)
            if magic != _MAGIC or version > FORMAT_VERSION:
                raise StorageError(
                    f"{self.path} is no journal of suspend, or of a newer format; move it away"
                )
            self.run_id, self.end = run_id.decode("ascii", "replace"), _HEADER.size
            while (entry := self._entry_at(self.end)) is not None:
                self._check_continues(entry)
                self.entries.append(entry)
                self.end = entry.offset + entry.length

    def _check_continues(self, entry: Entry) -> None:
        """Each cycle follows the one before; only an incomplete one may be there again, longer."""
        last = self.entries[-1] if self.entries else None
        if last is not None and entry.cycle != last.cycle + last.complete:
            raise StorageError(
                f"{self.path}: cycle {entry.cycle} follows cycle {last.cycle}: it was changed from outside; "
                f"{JOURNAL_REMEDY}"
            )

    def _entry_at(self, position: int) -> Entry | None:
        frame = os.pread(self._descriptor, _FRAME.size, position)
        if len(frame) < _FRAME.size:
            return None
        magic, cycle, complete, samples, frames, length, crc = _FRAME.unpack(frame)
        offset = position + _FRAME.size
        if magic != _FRAME_MAGIC or length < 0 or os.fstat(self._descriptor).st_size < offset + length:
            return None
        found = 0
        for start in range(offset, offset + length, _CHUNK):
            found = zlib.crc32(os.pread(self._descriptor, min(_CHUNK, offset + length - start), start), found)
        return Entry(cycle, bool(complete), samples, frames, offset, length) if found == crc else None

    def read(self, entry: Entry) -> dict:
        """The record of `entry`, as it was appended. Raises StorageError."""
        with storage_errors("read", self.path):
            parts, start = [], entry.offset
            while start < entry.offset + entry.length:
                parts.append(os.pread(self._descriptor, entry.offset + entry.length - start, start))
                if not parts[-1]:
                    raise StorageError(f"{self.path} became shorter while it was read")
                start += len(parts[-1])
            return unpack(b"".join(parts))

    def close(self) -> None:
        """Close the file; harmless when done twice."""
        if self._descriptor >= 0:
            os.close(self._descriptor)
            self._descriptor = -1


def append_record(path: Path, run_id: str, record: dict) -> int:
    """Append one record (to a new journal when absent); returns its size in bytes. Raises StorageError.

    After an error the journal is as before.
    """
    pieces = pack(record)
    length, crc = sum(len(piece) for piece in pieces), 0
    for piece in pieces:
        crc = zlib.crc32(piece, crc)
    frame = _FRAME.pack(
        _FRAME_MAGIC,
        record["index"],
        record["complete"],
        len(record["time"]),
        len(record["frame_time"]),
        length,
        crc,
    )
    with storage_errors(f"append cycle {record['index']} to", path):
        try:
            fresh = os.stat(path).st_size < _HEADER.size
        except FileNotFoundError:
            fresh = True
        if fresh:
            path.unlink(missing_ok=True)
        header = _HEADER.pack(_MAGIC, FORMAT_VERSION, run_id.encode()) if fresh else b""
        append_or_restore(path, [header + frame, *pieces])
    return length


def truncate_journal(path: Path, end: int) -> None:
    """Cut the journal behind byte `end` (from `Journal.end` or an entry). Raises StorageError."""
    with storage_errors("shorten", path):
        os.truncate(path, end)


def size_of(path: Path) -> int:
    """Bytes of the journal, 0 where there is none. Raises StorageError."""
    with storage_errors("read", path):
        try:
            return os.stat(path).st_size
        except FileNotFoundError:
            return 0
