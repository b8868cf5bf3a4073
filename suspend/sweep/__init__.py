"""Families of runs: one file says what to vary, calls as often as it takes compute what is missing.

    from suspend.sweep import read_sweep, resolve, Folder
    points = resolve(read_sweep("configs/phase_diagram.yaml"))
"""

from __future__ import annotations

from suspend.sweep.file import Sweep, read_sweep
from suspend.sweep.folder import Folder
from suspend.sweep.points import Point, resolve

__all__ = ["Folder", "Point", "Sweep", "read_sweep", "resolve"]
