"""Made values of the five quantities against amplitude, with a known critical amplitude and scatter over seeds."""

from __future__ import annotations

import math

import numpy as np


def drawn_values(gamma0: float, critical: float, seeds: int, scatter: float, random) -> dict[str, np.ndarray]:
    """Values (seeds,) at an amplitude; all extrema, the onset and the steepest rise of ln D_cyc lie at `critical`.

    scatter 1: 0.3 % of eta_r', 0.002 of -eta3'/eta1', 10 % of -nu0, 0.3 of ln |nu4/nu2| and of ln D_cyc. ln D_cyc rises
    from -13 by 8 over a tenth of the amplitude; eta_r' is steeper above its minimum than below.
    """
    u = math.log(gamma0 / critical)
    noise = scatter * random.normal(size=(5, seeds))
    return {
        "eta_r_prime": (3.0 + u * u * (1.0 if u < 0.0 else 1.5)) * (1.0 + 0.003 * noise[0]),
        "minus_eta3_over_eta1": 0.05 - 0.04 * u * u + 0.002 * noise[1],
        "minus_N2_nu0": max(0.0, 0.15 * (gamma0 - critical)) * (1.0 + 0.1 * noise[2]),
        "nu4_over_nu2": 10.0 / (1.0 + 60.0 * u * u) * np.exp(0.3 * noise[3]),
        "D_cyc": np.exp(-13.0 + 8.0 / (1.0 + math.exp(-u / 0.12)) + 0.3 * noise[4]),
    }
