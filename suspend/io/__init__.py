"""Files of a run: writing them safely, reading them back, telling what they hold."""

from __future__ import annotations

from suspend.io.describe import describe
from suspend.io.reader import Run
from suspend.io.store import RunStore, holds_run
from suspend.io.table import CycleTable

__all__ = ["CycleTable", "Run", "RunStore", "describe", "holds_run"]
