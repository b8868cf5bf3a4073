"""What runs on a worker of a cluster: one point in a process of its own, and what the worker says of its machine."""

from __future__ import annotations

import os
import socket
import time
from dataclasses import asdict
from pathlib import Path
from typing import Any

import suspend
from suspend.config import loads
from suspend.core.kernel_cache import source_stamp
from suspend.errors import Interrupted, SuspendError
from suspend.io.files import holder, is_disk_trouble
from suspend.sweep.course import Outcome, outcome_of
from suspend.sweep.folder import CONFIGURATION, SweepLock, read_record
from suspend.sweep.lease import EXPIRY, LeaseWatch, look_again
from suspend.sweep.process import start_process, stop_process
from suspend.sweep.worker import DISK

POLL = 0.2  # seconds between looks at the process
LOOK = 1.0  # seconds between looks at the lease
JOB_END = "SUSPEND_JOB_END"  # when points stop on this worker, seconds since 1970 by its clock


def compute_point(
    folder: str, sweep_folder: str, directory: str, token: str, seconds: float | None = None, expiry: float = EXPIRY
) -> dict[str, Any]:
    """Compute the point in `folder`, or go on with it, until it ends or the call with this lease does.

    directory : that paths of the configuration are relative to; seconds : at most. Returns the fields of an Outcome.
    """
    watch = LeaseWatch(Path(sweep_folder), token, expiry)
    place = Path(folder)
    limits = [limit for limit in (seconds, seconds_left()) if limit is not None]
    if not watch.is_held() or min(limits, default=1.0) <= 0.0:
        return asdict(Outcome(Interrupted.exit_code, read_record(place)))
    look_again(Path(sweep_folder))
    look_again(place)
    try:
        process = start_process(place, Path(sweep_folder), directory, min(limits, default=None))
        with process.stdin:
            code = _wait(process, watch)
        text = (place / CONFIGURATION).read_text(encoding="utf-8")
        return asdict(outcome_of(code, place, loads(text, directory=directory)))
    except (SuspendError, OSError) as error:
        return asdict(Outcome(DISK if is_disk_trouble(error) else 1, read_record(place), message=str(error)))


def _wait(process, watch: LeaseWatch) -> int:
    looked, stopped = time.monotonic(), False
    while (code := process.poll()) is None:
        if not stopped and time.monotonic() - looked > LOOK:
            looked = time.monotonic()
            if not watch.is_held():
                stopped = True
                stop_process(process)
        time.sleep(POLL)
    return code


def seconds_left() -> float | None:
    """Seconds until points must stop on this worker, None where its job does not say."""
    try:
        return float(os.environ[JOB_END]) - time.time()
    except (KeyError, ValueError):
        return None


def describe(sweep_folder: str, token: str) -> dict[str, Any]:
    """What a call must know of this machine before it starts points here.

    visible : it sees the call's folder; locks : and that the call holds its lock.
    """
    folder = Path(sweep_folder)
    return {
        "host": socket.gethostname(),
        "version": suspend.__version__,
        "sources": source_stamp(),
        "visible": LeaseWatch(folder, token).is_visible(),
        "locks": holder(folder, SweepLock.NAME) is not None,
        "seconds_left": seconds_left(),
    }
