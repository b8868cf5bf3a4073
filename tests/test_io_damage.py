"""Unusable folders, locks, damaged and foreign files: every failure is one clear message."""

from __future__ import annotations

import os
import shutil
import signal
import tempfile
from pathlib import Path

import h5py
import numpy as np
import pytest
from io_records import CONFIG, META, assert_same, final_frame, record, state
from test_io_store import assert_holds, write

from suspend.errors import StorageError
from suspend.io import Run, RunStore, describe


def test_directory_that_vanishes_is_reported(tmp_path):
    """A folder removed under the run: StorageError naming the file, not a traceback."""
    with RunStore.create(tmp_path / "run", CONFIG, META) as store:
        shutil.rmtree(tmp_path / "run")
        with pytest.raises(StorageError, match="does not exist"):
            store.append_cycle(record(0))
        with pytest.raises(StorageError, match="does not exist"):
            store.save(state(0))


def test_unusable_places_are_refused(tmp_path):
    """A file in the way, a path through a file, a run already there, no run there: each its own message."""
    (tmp_path / "file").write_text("x")
    with pytest.raises(StorageError, match="in the way"):
        RunStore.create(tmp_path / "file", CONFIG, META)
    with pytest.raises(StorageError, match=r"in the way|not a folder"):
        RunStore.create(tmp_path / "file/run", CONFIG, META)
    write(tmp_path / "run", 1)
    with pytest.raises(StorageError, match="holds a run already"):
        RunStore.create(tmp_path / "run", CONFIG, META)
    assert_holds(tmp_path / "run", 1)
    with pytest.raises(StorageError, match="holds no run"):
        RunStore.open(tmp_path)


def test_unwritable_folder():
    """A folder without write permission (tried as an ordinary user): StorageError, nothing left behind."""
    locked = Path(tempfile.mkdtemp())  # below tmp_path only its owner could look
    locked.chmod(0o555)
    pid = os.fork()
    if pid == 0:
        try:
            if os.geteuid() == 0:
                os.seteuid(65534)
            RunStore.create(locked / "run", CONFIG, META)
        except StorageError as error:
            os._exit(4 if "permission denied" in str(error) else 5)
        finally:
            os._exit(6)
    _, status = os.waitpid(pid, 0)
    assert os.waitstatus_to_exitcode(status) == 4
    assert not list(locked.iterdir())
    locked.rmdir()


def test_two_writers_exclude_each_other(tmp_path):
    """The second process gets StorageError naming the first; after a kill the kernel frees the lock."""
    read, write_end = os.pipe()
    pid = os.fork()
    if pid == 0:
        store = RunStore.create(tmp_path / "run", CONFIG, META)
        store.save(state(0))
        os.write(write_end, b"x")
        signal.pause()
    assert os.read(read, 1) == b"x"
    with pytest.raises(StorageError, match=f"in use.*pid {pid}"):
        RunStore.open(tmp_path / "run")
    with pytest.raises(StorageError, match="in use"):
        RunStore.create(tmp_path / "run", CONFIG, META)
    assert f"pid {pid}" in describe(tmp_path / "run")["running"]
    os.kill(pid, signal.SIGKILL)
    os.waitpid(pid, 0)
    with RunStore.open(tmp_path / "run") as store:
        assert_same(store.load_state()[0], state(0))
    os.close(read)
    os.close(write_end)


def truncated(path):
    os.truncate(path, path.stat().st_size * 2 // 3)


def newer(path):
    with h5py.File(path, "r+") as file:
        file["parameters"].attrs["format_version"] = 99


def foreign(path):
    with h5py.File(path, "w") as file:
        file["x"] = np.zeros(3)


@pytest.mark.parametrize(
    ("damage", "message"),
    [
        (truncated, "truncated"),
        (newer, "format 99"),
        (foreign, "no trajectory of suspend"),
        (lambda path: path.write_bytes(b""), "empty"),
        (lambda path: path.write_text("not HDF5 " * 1000), "no HDF5 file"),
        (lambda path: path.unlink(), "does not exist|missing"),
    ],
)
def test_unreadable_trajectories_are_named(tmp_path, damage, message):
    """Truncated, newer, foreign, empty, other format, missing: StorageError with the path."""
    write(tmp_path / "run", 2)
    path = tmp_path / "run/trajectory.h5"
    damage(path)
    for attempt in (Run, describe, RunStore.open):
        with pytest.raises(StorageError, match=message) as caught:
            attempt(tmp_path / "run")
        assert str(tmp_path / "run") in str(caught.value)
    with pytest.raises(StorageError):
        Run(path)
    with pytest.raises(StorageError, match="nowhere"):
        Run(tmp_path / "nowhere")


def test_files_of_two_runs_are_not_mixed(tmp_path):
    """A journal or checkpoint of another run beside a trajectory is refused, not merged."""
    for name in ("a", "b"):
        write(tmp_path / name, 2, finish=False)
    shutil.copy(tmp_path / "b/cycles.journal", tmp_path / "a/cycles.journal")
    with pytest.raises(StorageError, match="another run"):
        Run(tmp_path / "a")
    (tmp_path / "a/cycles.journal").unlink()
    shutil.copy(tmp_path / "b/checkpoint.npz", tmp_path / "a/checkpoint.npz")
    with pytest.raises(StorageError, match="another run"):
        RunStore.open(tmp_path / "a")


def test_damaged_journal_byte_ends_the_journal(tmp_path):
    """A flipped byte fails its checksum: the cycles before it count, those behind it do not."""
    write(tmp_path / "run", 3, finish=False)
    path = tmp_path / "run/cycles.journal"
    data = bytearray(path.read_bytes())
    data[len(data) // 2] ^= 1
    path.write_bytes(data)
    with Run(tmp_path / "run") as run:
        assert run.cycles == 1
        assert_same(run.cycle(0), record(0))


def test_doubled_journal_entries_are_refused_with_the_way_out(tmp_path):
    """Cycle 0, 1, 2, 0, 1, 2: no sequence of cycles. Moved away, as the message says, the rest can be read."""
    write(tmp_path / "run", 3, finish=False)
    path = tmp_path / "run/cycles.journal"
    data = path.read_bytes()
    path.write_bytes(data + data[data.index(b"CYCL") :])
    for opening in (Run, RunStore.open):
        with pytest.raises(StorageError, match=r"cycle 0 follows cycle 2.*move it away and run again"):
            opening(tmp_path / "run")
    path.unlink()
    with Run(tmp_path / "run") as run:
        assert run.cycles == 0


@pytest.mark.parametrize("damage", ["removed", "shortened", "doubled"])
def test_a_journal_changed_during_the_run_is_an_error_at_once(tmp_path, damage):
    """The writer knows how many bytes it left: a lost cycle is never followed by another, nor by "finished"."""
    with RunStore.create(tmp_path / "run", CONFIG, META, interval=1e9) as store:
        for cycle in range(2):
            store.append_cycle(record(cycle))
            store.save(state(cycle + 1))
        path = tmp_path / "run/cycles.journal"
        data = path.read_bytes()
        if damage == "removed":
            path.unlink()
        else:
            path.write_bytes(data[: len(data) // 2] if damage == "shortened" else data + data[data.index(b"CYCL") :])
        with pytest.raises(StorageError, match="changed from outside while the run went on"):
            store.append_cycle(record(2))
        with pytest.raises(StorageError, match="changed from outside while the run went on"):
            store.finish(state(2), final_frame(2))
