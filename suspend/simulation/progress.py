"""What is shown of a run while it goes on."""

from __future__ import annotations

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

    def on_start(self, _event) -> None:
        self.report()

    def on_end(self, _event) -> None:
        pass


def while_compiling(report: Callable[[], None]):
    """Context in which `report()` is called whenever Numba begins to compile a kernel.

    Kernels that are in memory or loaded from Numba's cache are not compiled, so do not count.
    """
    return event.install_listener("numba:compile", _Compilations(report))
