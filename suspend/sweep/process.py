"""Start and stop of the process that computes one point, on this machine or on a worker of a cluster."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from pathlib import Path

import suspend
from suspend.io.files import storage_errors
from suspend.sweep.folder import LOG

THREADS = ("NUMBA_NUM_THREADS", "OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")


def start_process(folder: Path, sweep_folder: Path, directory: str, seconds: float | None) -> subprocess.Popen:
    """Begin to compute the point in `folder`, or go on with it, for at most `seconds`; its words go to the point's log.

    The process stops with a checkpoint when its standard input closes, so also when this process dies.
    directory : that paths of the configuration are relative to. Raises StorageError.
    """
    command = [sys.executable, "-m", "suspend.sweep.worker", str(folder), str(sweep_folder), directory]
    if seconds is not None:
        command.append(f"{seconds:.3f}")
    log = folder / LOG
    with storage_errors("write", log):
        output = open(log, "ab")  # noqa: SIM115 (the process keeps it)
    with output:
        return subprocess.Popen(
            command, stdin=subprocess.PIPE, stdout=output, stderr=output, env=worker_environment(),
            start_new_session=True,  # Ctrl-C reaches the calling process alone, which then stops the others
        )  # fmt: skip


def stop_process(process: subprocess.Popen) -> None:
    """Ask for a checkpoint and the end."""
    process.terminate()
    process.send_signal(signal.SIGCONT)  # one that is suspended would never hear of it


def worker_environment() -> dict[str, str]:
    """Environment of a process: one thread, and this package where it is."""
    place = str(Path(suspend.__file__).resolve().parent.parent)
    paths = [place, *filter(None, os.environ.get("PYTHONPATH", "").split(os.pathsep))]
    return os.environ | dict.fromkeys(THREADS, "1") | {"PYTHONPATH": os.pathsep.join(dict.fromkeys(paths))}
