"""Where the command starts: signals first, then the imports.

Importing takes a second, in which an exception raised by a signal ends in a traceback, or is swallowed. There is
nothing to lose then, so the process just leaves.
"""

from __future__ import annotations

import os
import signal
import sys

NAMES = ("SIGINT", "SIGTERM", "SIGUSR1", "SIGHUP")  # those of `suspend.simulation.stop`
CODE = 130  # of `suspend.errors.Interrupted`, not imported yet


def main() -> None:
    """Entry point of the command `suspend`."""
    open_streams()
    receive_signals()
    from suspend_cli.main import main as run_commands

    run_commands()


def open_streams() -> None:
    """Give a process started without one of its three streams (a daemon, some batch systems) the null device for it.

    Otherwise the next file opened gets the stream's number, and whatever a library prints ends in that file.
    """
    for number, (name, mode) in enumerate((("stdin", "r"), ("stdout", "w"), ("stderr", "w"))):
        try:
            os.fstat(number)
        except OSError:
            opened = os.open(os.devnull, os.O_RDWR)
            if opened != number:
                os.dup2(opened, number)
                os.close(opened)
        if getattr(sys, name) is None:
            setattr(sys, name, open(number, mode, encoding="utf-8", closefd=False))  # noqa: SIM115 (for the process)


def receive_signals() -> None:
    """Leave with exit code 130 on a signal; but SIGINT, one that is ignored stays so, as SIGHUP under nohup."""
    for name in NAMES:
        number = getattr(signal, name, None)
        if number is None:
            continue
        # Shells start background jobs of scripts with SIGINT ignored; sent to a command, it still means stop.
        if number == signal.SIGINT or signal.getsignal(number) is not signal.SIG_IGN:
            signal.signal(number, _leave)


def _leave(_number, frame) -> None:
    """Through the ordinary way out where it works, at once before it is there or while something is imported."""
    files = set()
    while frame is not None:
        files.add(frame.f_code.co_filename)
        frame = frame.f_back
    guarded = os.path.join(os.path.dirname(__file__), "errors.py") in files
    # what is raised within an import, or where the compiler calls back from C, is printed or swallowed there
    swallowed = "<frozen importlib._bootstrap>" in files or any(f"{os.sep}llvmlite{os.sep}" in f for f in files)
    if guarded and not swallowed:
        raise KeyboardInterrupt
    os.write(2, b"\nError: interrupted\n")
    os._exit(CODE)
