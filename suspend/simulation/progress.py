"""What is shown of a run while it goes on."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass

from numba.core import event


@dataclass
class ProgressState:
    """What a progress bar shows."""

    cycle: int
    cycles: int
    strain: float
    total_strain: float
    fraction: float
    minimum_gap: float
    iterations: int
    evaluations: int
    elapsed: float
    compiling: bool
    initial_fraction: float


class _Compilations(event.Listener):
    def __init__(self, report: Callable[[], None]):
        self.report = report
        self.seconds = 0.0  # spent in compilations that have ended
        self._begun: list[float] = []  # a compilation holds those of the kernels it calls

    def on_start(self, _event) -> None:
        self._begun.append(time.monotonic())
        self.report()

    def on_end(self, _event) -> None:
        begun = self._begun.pop()
        if not self._begun:
            self.seconds += time.monotonic() - begun


def while_compiling(report: Callable[[], None]):
    """Context in which `report()` is called whenever Numba begins to compile a kernel; its `seconds` are those spent.

    Kernels that are in memory or loaded from Numba's cache are not compiled, so do not count.
    """
    return event.install_listener("numba:compile", _Compilations(report))
