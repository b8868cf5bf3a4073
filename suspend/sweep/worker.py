"""The process of one point: `python -m suspend.sweep.worker POINT SWEEP DIRECTORY [SECONDS]`.

It ends with a checkpoint when its standard input closes, that is, when the call that started it is gone.
"""

from __future__ import annotations

import contextlib
import os
import signal
import sys
import threading
import time
import traceback
from dataclasses import replace
from pathlib import Path

DISK = 74  # exit code where the disk is full or fails (EX_IOERR)
EVERY = 1.0  # seconds between records of the progress


def main(arguments: list[str]) -> int:
    """Compute the point; returns the exit code of `suspend run`, 1 for a defect."""
    folder, sweep_folder, directory = Path(arguments[0]), Path(arguments[1]), arguments[2]
    max_time = float(arguments[3]) if len(arguments) > 3 else None
    threading.Thread(target=_watch_parent, daemon=True).start()
    from suspend.errors import Interrupted, SuspendError
    from suspend.io.files import InUseError, is_disk_trouble

    try:
        run_point(folder, sweep_folder, directory, max_time)
    except InUseError as error:  # the work of another process, and no failure
        _log(f"{error}")
        return Interrupted.exit_code
    except SuspendError as error:
        with contextlib.suppress(OSError):
            _log(f"Error: {error}")
        return DISK if is_disk_trouble(error) else error.exit_code
    except MemoryError as error:
        _log(f"Error: not enough memory ({error})")
        return 3
    except Exception:
        traceback.print_exc()
        return 1
    return 0


def run_point(folder: Path, sweep_folder: Path, directory: str = ".", max_time: float | None = None) -> None:
    """Compute the point whose configuration is in `folder`, or go on with it, and keep its record.

    directory : that paths of the configuration are relative to; max_time : seconds, the start-up included.
    Raises as `suspend.simulation.run`, after counting the failure; a disk that is full is no failure of the point.
    """
    from suspend.errors import Interrupted, SuspendError
    from suspend.io.files import is_disk_trouble
    from suspend.sweep.folder import PointLock, read_record, write_record

    lock = PointLock(folder)
    try:
        before = read_record(folder)
        record = replace(
            before, running=True, done=False, began=before.strain, began_seconds=before.seconds, updated=time.time()
        )
        write_record(folder, record)
        progress = _Progress(folder, record)
        try:
            _simulate(folder, sweep_folder, directory, max_time, progress)
        except Interrupted:
            progress.write(running=False)
            raise
        except (SuspendError, MemoryError) as error:
            code = error.exit_code if isinstance(error, SuspendError) else 3
            counted = before.failures + (not is_disk_trouble(error))
            progress.write(running=False, failures=counted, message=str(error), code=code)
            raise
        except Exception as error:
            message = f"a defect of suspend: {type(error).__name__}: {error}; please report it with the log"
            progress.write(running=False, failures=before.failures + 1, message=message, code=1)
            raise
        progress.write(running=False, done=True, failures=0, message="", code=0)
    finally:
        lock.release()


def _simulate(folder: Path, sweep_folder: Path, directory: str, max_time: float | None, progress: _Progress) -> None:
    from suspend.config import loads
    from suspend.simulation import run
    from suspend.sweep.folder import CONFIGURATION
    from suspend.sweep.starts import shared_start

    text = (folder / CONFIGURATION).read_text(encoding="utf-8")
    config = loads(text, source=str(folder / CONFIGURATION), directory=directory)
    if max_time is not None:
        max_time = max(max_time - (time.monotonic() - progress.started), 1e-3)
    summary = run(
        config, folder, max_time=max_time, progress=progress.update, message=_log,
        prepare=lambda wanted: shared_start(wanted, sweep_folder),
    )  # fmt: skip
    figures = summary.as_dict()
    progress.started += figures["compiling_seconds"]  # once on a machine, and no part of what a point costs
    progress.record = replace(
        progress.record, strain=figures["total_strain"], total_strain=figures["total_strain"], cycles=figures["cycles"]
    )
    for line in summary.lines():
        _log(line)


class _Progress:
    """Keeps the record of a point while it runs."""

    def __init__(self, folder: Path, record):
        self.folder, self.record = folder, record
        self.started, self.written = time.monotonic(), 0.0

    def update(self, state) -> None:
        """Take over the state of the run, once a second."""
        now = time.monotonic()
        self.record = replace(
            self.record, strain=float(state.strain), total_strain=float(state.total_strain), cycles=int(state.cycle)
        )
        if now - self.written >= EVERY:
            self.written = now
            self.write()

    def write(self, **changes) -> None:
        """Write the record with some changes."""
        from suspend.sweep.folder import write_record

        seconds = self.record.began_seconds + time.monotonic() - self.started
        self.record = replace(self.record, seconds=seconds, updated=time.time(), **changes)
        write_record(self.folder, self.record)


def _log(text: str) -> None:
    print(f"{time.strftime('%Y-%m-%d %H:%M:%S')} {text}", flush=True)


def _watch_parent() -> None:
    """Stop as on SIGTERM, with a checkpoint, when the call that started this process is gone."""
    while True:
        try:
            if os.read(0, 1) == b"":
                break
        except OSError:
            break
    os.kill(os.getpid(), signal.SIGTERM)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
