"""Reasons to stop a run early: a signal, the time limit."""

from __future__ import annotations

import signal
import threading
import time


class Stop:
    """Set by SIGINT, SIGTERM or the time limit; the run looks at it after every step."""

    def __init__(self, max_time: float | None):
        self.reason: str | None = None
        self.deadline = time.monotonic() + max_time if max_time is not None else None
        self._before: dict = {}

    def __enter__(self) -> Stop:
        if threading.current_thread() is threading.main_thread():
            for number in (signal.SIGINT, signal.SIGTERM):
                self._before[number] = signal.signal(number, self._receive)
        return self

    def __exit__(self, *_) -> None:
        for number, handler in self._before.items():
            signal.signal(number, handler)

    def _receive(self, number, _frame) -> None:
        self.reason = signal.Signals(number).name

    def check(self) -> str | None:
        """Why to stop, None to go on."""
        if self.reason is None and self.deadline is not None and time.monotonic() > self.deadline:
            self.reason = "time limit"
        return self.reason
