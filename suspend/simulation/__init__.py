"""A run from configuration to files: cycles, records, checkpoints, signals, resuming.

    from suspend.config import load
    from suspend.simulation import run
    summary = run(load("configs/demo.yaml"), "demo-run")
"""

from __future__ import annotations

from suspend.plan import Plan, make_plan
from suspend.simulation.in_memory import Simulation
from suspend.simulation.progress import ProgressState
from suspend.simulation.start import run
from suspend.simulation.summary import Summary

__all__ = ["Plan", "ProgressState", "Simulation", "Summary", "make_plan", "run"]
