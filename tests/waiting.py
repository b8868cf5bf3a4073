"""Waiting for what another process does: for the event itself, since a loaded machine takes any time for it."""

from __future__ import annotations

import time
from collections.abc import Callable
from pathlib import Path

LIMIT = 1800.0  # seconds after which it is taken never to happen; no test is about a time


def wait_until(happened: Callable, process=None):
    """Return what `happened` returns once that is true. Fails after LIMIT, or where `process` has ended before."""
    deadline = time.monotonic() + LIMIT
    while True:
        ended = process is not None and process.poll() is not None
        found = happened()
        if found:
            return found
        assert not ended, f"the process ended with exit code {process.returncode}"
        assert time.monotonic() < deadline, "it has not happened in half an hour"
        time.sleep(0.02)


def cycles_in(folder: Path) -> int:
    """Completed cycles of all runs in and below `folder`, by the lines of their tables."""
    return sum(max(0, path.read_bytes().count(b"\n") - 1) for path in Path(folder).rglob("moduli.csv"))
