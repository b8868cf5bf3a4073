"""Reasons to stop a run early: a signal, the time limit."""

from __future__ import annotations

import os
import signal
import threading
import time

from suspend.errors import Interrupted

# From the keyboard, from a scheduler (its last word, its warning), from a terminal that is gone.
SIGNALS = [
    getattr(signal, name) for name in ("SIGINT", "SIGTERM", "SIGUSR1", "SIGHUP") if hasattr(signal, name)
]


AGAIN = 0.05  # seconds until a signal whose exception was swallowed is looked at again


class _Leave(BaseException):
    """Raised out of start-up, packing or compilation; no handler of Exception on the way may take it."""


class Stop:
    """Set by a signal or the time limit; the run looks at it after every step.

    Until `keep` is called there is nothing a checkpoint would save, and a signal ends the block at once with
    Interrupted. A signal other than SIGINT that is ignored on entry, as SIGHUP is under nohup, stays ignored.
    """

    def __init__(self, max_time: float | None):
        self.reason: str | None = None
        self.deadline = time.monotonic() + max_time if max_time is not None else None
        self._before: dict = {}
        self._at_once = True
        self._again: threading.Timer | None = None

    def __enter__(self) -> Stop:
        if threading.current_thread() is threading.main_thread():
            for number in SIGNALS:
                # Shells start background jobs of scripts with SIGINT ignored; sent to a run, it still means stop.
                if number == signal.SIGINT or signal.getsignal(number) is not signal.SIG_IGN:
                    self._before[number] = signal.signal(number, self._receive)
        return self

    def __exit__(self, kind, *_) -> None:
        self._at_once = False
        if self._again is not None:
            self._again.cancel()
        for number, handler in self._before.items():
            # None: a handler that was not set from Python cannot be set from it again.
            signal.signal(number, signal.SIG_DFL if handler is None else handler)
        if kind is not None and issubclass(kind, _Leave):
            raise Interrupted(
                f"stopped ({self.reason}) before the first step, nothing is lost; the same command goes on"
            ) from None

    def keep(self) -> None:
        """From now on there is something to save: signals wait for `check`."""
        self._at_once = False

    def _receive(self, number, frame) -> None:
        self.reason = signal.Signals(number).name
        if not self._at_once:
            return
        # What is raised within a callback from C (the compiler's, a finalizer) is printed and dropped there.
        self._again = threading.Timer(AGAIN, os.kill, (os.getpid(), number))
        self._again.daemon = True
        self._again.start()
        if not within_compiler(frame):
            raise _Leave

    def check(self) -> str | None:
        """Why to stop, None to go on."""
        if self.reason is None and self.deadline is not None and time.monotonic() > self.deadline:
            self.reason = "time limit"
        return self.reason


def within_compiler(frame) -> bool:
    """True where `frame` or one of its callers belongs to the compiler's Python side, which C calls back."""
    while frame is not None:
        if f"{os.sep}llvmlite{os.sep}" in frame.f_code.co_filename:
            return True
        frame = frame.f_back
    return False
