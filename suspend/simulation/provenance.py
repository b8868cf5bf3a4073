"""What a run directory says of its making: sizes, units, machine, versions."""

from __future__ import annotations

import os
import platform
import time

import h5py
import numba
import numpy as np
import scipy

import suspend
from suspend.config import Config
from suspend.conventions import FORMAT_VERSION
from suspend.scene import make_units


def provenance(config: Config, initial, threads: int) -> dict:
    """Attributes of the run `config` starts from `initial` (`suspend.initial`), in the configuration's units."""
    units = make_units(config)
    return {
        "number": config.particles.number,
        "L": initial.length * units.length,
        "radius": units.length,
        "viscosity": units.viscosity,
        "rate": units.rate,
        "seed": config.seed,
        "threads": threads,
        "format_version": FORMAT_VERSION,
        "start_tilt": initial.tilt,
        **({} if initial.minimum_gap is None else {"start_minimum_gap": initial.minimum_gap}),
        "machine": platform.machine(),
        "processor": platform.processor() or "unknown",
        "cores": os.cpu_count() or 1,
        "created": time.strftime("%Y-%m-%dT%H:%M:%SZ", time.gmtime()),
        "versions": {
            "suspend": suspend.__version__,
            "python": platform.python_version(),
            "numpy": np.__version__,
            "scipy": scipy.__version__,
            "numba": numba.__version__,
            "h5py": h5py.__version__,
        },
    }
