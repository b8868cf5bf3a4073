"""Kill -9 and full disks: nothing completed is lost, every failure is one clear message."""

from __future__ import annotations

import errno
import os
import random
import resource
import shutil
import signal
import subprocess
import time
from pathlib import Path

import numpy as np
import pytest
from io_records import CONFIG, META, assert_same, final_frame, record, state
from test_io_store import TABLE, assert_holds, write

import suspend.io.files
import suspend.io.h5md
from suspend.errors import StorageError
from suspend.io import Run, RunStore, holds_run


def simulate(directory: Path, cycles: int, interval: float, done=lambda cycle: None) -> None:
    """What a resumable simulation does: create or open, continue from the stored state, finish."""
    if holds_run(directory):
        store = RunStore.open(directory, TABLE, interval=interval)
    else:
        store = RunStore.create(directory, CONFIG, META, TABLE, interval=interval)
        store.save(state(0))
    with store:
        if store.finished and store.cycles_done < cycles:
            store.update_configuration(f"cycles: {cycles}")
        found = store.load_state()[0]
        assert_same(found, state(store.cycles_done))
        for k in range(store.cycles_done, cycles):
            store.append_cycle(record(k))
            store.save(state(k + 1))
            done(k + 1)
        store.finish(state(cycles), final_frame(cycles))


def in_child(work) -> tuple[int, int]:
    """Run `work(report)` in a forked process; returns wait status and the last reported number."""
    read, write_end = os.pipe()
    pid = os.fork()
    if pid == 0:
        status = 70
        try:
            os.close(read)
            work(lambda number: os.write(write_end, bytes([number])))
            status = 0
        finally:
            os._exit(status)
    os.close(write_end)
    _, status = os.waitpid(pid, 0)
    with open(read, "rb") as pipe:
        reported = pipe.read()
    return status, reported[-1] if reported else 0


def check_survivor(directory: Path, acknowledged: int) -> int:
    """After a kill all acknowledged cycles are there, bit for bit; trajectory.h5 alone is valid."""
    if not (directory / "trajectory.h5").exists():
        assert acknowledged == 0
        return 0
    with Run(directory / "trajectory.h5") as run:
        alone = run.cycles
        for k in range(alone):
            assert_same(run.cycle(k), record(k))
    with Run(directory) as run:
        assert run.cycles >= max(acknowledged, alone)
        for k in range(run.cycles):
            assert_same(run.cycle(k), record(k))
        starts = [a for a in run.cycle_start_unwrapped()]
        assert sum(map(len, starts)) in (run.cycles, run.cycles + 1)
        return run.cycles


def assert_finished(directory: Path, reference: Path, cycles: int) -> None:
    """The resumed run equals the uninterrupted one in everything a user reads."""
    assert_holds(directory, cycles)
    with Run(directory) as run, Run(reference) as whole:
        assert run.finished and run.n_frames == whole.n_frames
        for a, b in zip(run.frames(), whole.frames(), strict=True):
            assert_same(a, b)
    assert (directory / "moduli.csv").read_bytes() == (reference / "moduli.csv").read_bytes()
    assert sorted(p.name for p in directory.iterdir()) == sorted(p.name for p in reference.iterdir())


POINTS = (  # every operation of the writer that changes the disk
    (os, "replace"),
    (os, "fsync"),
    (os, "truncate"),
    (os, "ftruncate"),
    (os, "posix_fallocate"),
    (os, "mkdir"),
    (Path, "unlink"),
    (shutil, "copyfile"),
    (suspend.io.files, "write_all"),
    (suspend.io.h5md, "truncate"),
    (suspend.io.h5md, "append"),
    (suspend.io.h5md, "append_frames"),
    (suspend.io.h5md, "set_checkpoint"),
    (suspend.io.h5md, "set_configuration"),
)


def kill_at(number: int) -> None:
    """Arrange that the process kills itself just before its operation `number` (a write: within it)."""
    count = [0]

    def wrap(owner, name):
        original = getattr(owner, name)

        def wrapped(*args, **kwargs):
            count[0] += 1
            if count[0] == number:
                if name == "write_all":
                    data = memoryview(args[1]).cast("B")
                    args[0].write(data[: data.nbytes // 2])
                os.kill(os.getpid(), signal.SIGKILL)
            return original(*args, **kwargs)

        setattr(owner, name, wrapped)

    for owner, name in POINTS:
        wrap(owner, name)


@pytest.mark.parametrize(("done", "cycles", "interval"), [(0, 2, 0.0), (0, 2, 1e9), (1, 2, 0.0), (1, 2, 1e9)])
def test_kill_before_each_operation(tmp_path, done, cycles, interval):
    """Killed before (or half-way through) its 1st, 2nd, 3rd ... disk operation until it finishes untouched:
    whatever the instant, no acknowledged cycle is lost and the resumed run equals the uninterrupted one."""
    simulate(tmp_path / "whole", cycles, interval)
    for number in range(1, 1000):
        directory = tmp_path / f"killed{number}"

        if done:  # the kills then hit the extension of a finished run
            simulate(directory, done, interval)

        def work(report, number=number, directory=directory):
            kill_at(number)
            simulate(directory, cycles, interval, report)

        status, acknowledged = in_child(work)
        check_survivor(directory, max(done, acknowledged))
        if os.waitstatus_to_exitcode(status) == 0:
            break
        assert os.waitstatus_to_exitcode(status) == -signal.SIGKILL
        simulate(directory, cycles, interval)
        assert_finished(directory, tmp_path / "whole", cycles)
        shutil.rmtree(directory)
    assert number > 20


def test_kill_at_random_instants_again_and_again(tmp_path):
    """One run killed from outside at random instants, resumed each time, loses no acknowledged cycle.

    Each attempt may complete twelve cycles, so that there are kills however late they come; they come after a random
    one of these, and a random share of a cycle later.
    """
    simulate(tmp_path / "whole", 60, 0.01)
    instants = random.Random(5)
    directory, kills = tmp_path / "run", 0
    for _ in range(200):
        read, write_end = os.pipe()
        allowed, allow = os.pipe()
        os.write(allow, bytes(11))  # it waits behind the twelfth
        pid = os.fork()
        if pid == 0:
            try:
                os.close(read)
                os.close(allow)
                simulate(
                    directory, 60, 0.01,
                    lambda k, fd=write_end, limit=allowed: (os.write(fd, bytes([k])), os.read(limit, 1)),
                )  # fmt: skip
            finally:
                os._exit(0)
        os.close(write_end)
        os.close(allowed)
        begun, reported, wanted = time.monotonic(), b"", instants.randint(1, 8)
        while len(reported) < wanted and (report := os.read(read, 1)):  # nothing: it is finished
            reported += report
        pause = (time.monotonic() - begun) / wanted
        time.sleep(instants.uniform(0.0, pause))
        os.kill(pid, signal.SIGKILL)
        _, status = os.waitpid(pid, 0)
        os.close(allow)
        with open(read, "rb") as pipe:
            reported += pipe.read()
        kills += os.waitstatus_to_exitcode(status) == -signal.SIGKILL
        check_survivor(directory, reported[-1] if reported else 0)
        if reported and reported[-1] == 60:
            break
    simulate(directory, 60, 0.01)
    assert_finished(directory, tmp_path / "whole", 60)
    assert kills > 3


def test_reading_while_the_run_goes_on(tmp_path):
    """A reader opened at any moment sees a consistent run: cycles never go back, every record is right."""
    pid = os.fork()
    if pid == 0:
        try:
            simulate(tmp_path / "run", 100, 0.0)
        finally:
            os._exit(0)
    seen = 0
    while os.waitpid(pid, os.WNOHANG) == (0, 0):
        if holds_run(tmp_path / "run"):
            with Run(tmp_path / "run") as run:
                assert run.cycles >= seen
                seen = run.cycles
                if seen:
                    assert_same(run.cycle(seen - 1), record(seen - 1))
    assert_holds(tmp_path / "run", 100)


@pytest.mark.parametrize("limit", [10_000, 30_000, 4_700_000])
def test_full_disk_is_one_clear_error_and_earlier_data_stay(tmp_path, limit):
    """A file size limit stands for a full disk (EFBIG for ENOSPC): StorageError, no debris, run resumable."""
    directory = tmp_path / "run"
    write(directory, 2, finish=False)

    def work(report):
        signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
        resource.setrlimit(resource.RLIMIT_FSIZE, (limit, limit))
        try:
            simulate(directory, 200, 0.05, report)
        except StorageError as error:
            os._exit(4 if "limit" in str(error) and str(directory) in str(error) else 5)

    status, acknowledged = in_child(work)
    assert os.waitstatus_to_exitcode(status) == 4
    assert check_survivor(directory, acknowledged) >= 2
    assert not list(directory.glob("*.tmp"))
    simulate(directory, 200, 10.0)
    assert_holds(directory, 200)


@pytest.mark.parametrize("free", [100_000, 3_000_000])
def test_really_full_file_system(tmp_path, free):
    """On a tmpfs that is filled while it goes on the run ends with "the disk is full", and continues once there is
    space.
    """
    mount = tmp_path / "small"
    mount.mkdir()
    made = subprocess.run(["mount", "-t", "tmpfs", "-o", "size=12m", "tmpfs", mount], capture_output=True)
    if made.returncode:
        pytest.skip("mounting needs privileges")
    try:

        def fill(cycle):
            if cycle == 2:
                (mount / "ballast").write_bytes(b"x" * (12 * 2**20 - 800_000 - free))

        with pytest.raises(StorageError, match="disk is full"):
            simulate(mount / "run", 250, 0.02, fill)
        cycles = check_survivor(mount / "run", 2)
        assert not list((mount / "run").glob("*.tmp"))
        (mount / "ballast").unlink()
        simulate(mount / "run", cycles + 5, 10.0)
        assert_holds(mount / "run", cycles + 5)
    finally:
        subprocess.run(["umount", mount], check=True)


@pytest.mark.parametrize("limit", [0, 5_000])
def test_no_space_to_begin_with_leaves_nothing_behind(tmp_path, limit):
    """A run that cannot even write its header: StorageError, and the folder it made is gone again."""

    def work(report):
        resource.setrlimit(resource.RLIMIT_FSIZE, (limit, limit))
        try:
            RunStore.create(tmp_path / "run", CONFIG, META)
        except StorageError as error:
            os._exit(4 if "limit" in str(error) else 5)

    assert os.waitstatus_to_exitcode(in_child(work)[0]) == 4
    assert not (tmp_path / "run").exists()


def test_space_in_the_file_is_reused(tmp_path):
    """Rewriting the trajectory after every cycle may not make it 1.3 x larger than once at the end."""
    for name, interval in (("often", 0.0), ("once", 1e9)):
        with RunStore.create(tmp_path / name, CONFIG, META | {"number": 500}, interval=interval) as store:
            for k in range(60):
                store.append_cycle(record(k, 500))
                store.save({"of varying size": np.zeros(20_000 * (k % 3))})
            store.finish({}, final_frame(60, 500))
    often, once = ((tmp_path / name / "trajectory.h5").stat().st_size for name in ("often", "once"))
    assert often < 1.3 * once


def test_failing_journal_write_leaves_the_journal_as_it_was(tmp_path, monkeypatch):
    """A write that fails half-way is undone, and the same store can go on once there is space."""
    with RunStore.create(tmp_path / "run", CONFIG, META) as store:
        store.append_cycle(record(0))
        store.save(state(1))
        size = (tmp_path / "run/cycles.journal").stat().st_size

        def fail(handle, data):
            handle.write(data[: len(data) // 2])
            raise OSError(errno.ENOSPC, "No space left on device")

        with monkeypatch.context() as patch, pytest.raises(StorageError, match="disk is full"):
            patch.setattr(suspend.io.files, "write_all", fail)
            store.append_cycle(record(1))
        assert (tmp_path / "run/cycles.journal").stat().st_size == size
        store.append_cycle(record(1))
        store.save(state(2))
    assert_holds(tmp_path / "run", 2)
