"""The configuration: strict, validated, with every key declared once, in `physics`, `numerics` and `schema`.

Example: `config = load("configs/paper.yaml", ["flow.amplitude=0.4"]); print(config.to_yaml())`.
"""

from __future__ import annotations

from suspend.config.load import from_dict, load, loads
from suspend.config.schema import (
    Config,
    Contact,
    Duration,
    Ewald,
    External,
    Flow,
    Fluid,
    Integrator,
    Lubrication,
    Output,
    Particles,
    Repulsion,
    Solver,
)

__all__ = [
    "Config",
    "Contact",
    "Duration",
    "Ewald",
    "External",
    "Flow",
    "Fluid",
    "Integrator",
    "Lubrication",
    "Output",
    "Particles",
    "Repulsion",
    "Solver",
    "from_dict",
    "load",
    "loads",
]
