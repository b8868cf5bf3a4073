"""What is shown of a run while it goes on."""

from __future__ import annotations

from dataclasses import dataclass


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
