"""Gaps of nearly touching pairs, kept on the solution of their own equation while the spheres move.

Two smooth spheres that are pressed together approach as d(ln h)/dt = v_n/h: their gap h shrinks exponentially but
never closes, and v_n/h changes slowly however small h is. A Runge-Kutta step in positions has an error that does
not know of h and overlaps the spheres as soon as it exceeds it. So ln h of every pair closer than `CLOSE` is
integrated with the same stages, and the positions of each stage are moved along the lines of centres until the
gaps agree; the displacement is of the size of the step's own error.
"""

from __future__ import annotations

import math

import numpy as np

from suspend.core.jit import kernel
from suspend.core.pairs import separation
from suspend.errors import NumericalError

CLOSE = 1e-3  # radii: gap below which a pair is kept
SMALLEST = 1e-12  # radii: positions in double precision hold no smaller gap
ACCURACY = 1e-2  # of the gaps held, relative
SWEEPS = 400


@kernel
def _close_rows(pairs, position, edge, tilt, below):
    chosen = np.empty(pairs.shape[0], np.int64)
    gap = np.empty(pairs.shape[0])
    found = 0
    reach2 = (2.0 + below) ** 2
    for p in range(pairs.shape[0]):
        dx, dy, dz = separation(pairs, p, position, edge, tilt)
        r2 = dx * dx + dy * dy + dz * dz
        if r2 < reach2 and pairs[p, 0] != pairs[p, 1]:
            chosen[found] = p
            gap[found] = math.sqrt(r2) - 2.0
            found += 1
    return chosen[:found], gap[:found]


@kernel
def _rates(rows, position, edge, tilt, velocity, shear_rate, rate):
    for p in range(rows.shape[0]):
        i, j = rows[p, 0], rows[p, 1]
        d = separation(rows, p, position, edge, tilt)
        r = math.sqrt(d[0] * d[0] + d[1] * d[1] + d[2] * d[2])
        approach = shear_rate * d[1] * d[0]
        for c in range(3):
            approach += (velocity[j, c] - velocity[i, c]) * d[c]
        rate[p] = approach / (r * (r - 2.0))


@kernel
def _hold(rows, position, edge, tilt, log_gap, accuracy, sweeps):
    """Gauss-Seidel over the pairs; returns the largest relative error of a gap that is left."""
    worst = 0.0
    for _ in range(sweeps):
        worst = 0.0
        for p in range(rows.shape[0]):
            i, j = rows[p, 0], rows[p, 1]
            d = separation(rows, p, position, edge, tilt)
            r = math.sqrt(d[0] * d[0] + d[1] * d[1] + d[2] * d[2])
            gap = math.exp(log_gap[p])
            excess = r - 2.0 - gap
            worst = max(worst, abs(excess) / gap)
            for c in range(3):
                shift = 0.5 * excess * d[c] / r
                position[i, c] += shift
                position[j, c] -= shift
        if worst <= accuracy:
            break
    return worst


class CloseGaps:
    """The pairs that are closer than `CLOSE` at the start of a step, and the logarithms of their gaps.

    pairs : neighbour list rows (i, j, n1, n2, n3); position (N, 3); tilt and shear_rate : functions of time.
    """

    def __init__(self, pairs: np.ndarray, position: np.ndarray, edge: float, time: float, tilt, shear_rate):
        self.edge, self.tilt, self.shear_rate = edge, tilt, shear_rate
        chosen, gap = _close_rows(pairs, position, edge, tilt(time), CLOSE)
        self.rows, self.log_gap = pairs[chosen], np.log(gap)

    def __len__(self) -> int:
        return len(self.rows)

    def rates(self, position: np.ndarray, time: float, velocity: np.ndarray) -> np.ndarray:
        """d(ln h)/dt of each pair, velocities (N, 6) relative to the undisturbed flow."""
        rate = np.empty(len(self.rows))
        _rates(self.rows, position, self.edge, self.tilt(time), velocity, self.shear_rate(time), rate)
        return rate

    def hold(self, position: np.ndarray, time: float, change: np.ndarray) -> None:
        """Move spheres (N, 3), in place, until ln h of every pair has changed by `change` since the start."""
        log_gap = self.log_gap + change
        smallest = float(np.min(log_gap))
        if smallest < math.log(SMALLEST):
            raise NumericalError(
                f"spheres are pressed together to a gap of {math.exp(smallest):.1e} a, less than double precision "
                "holds: smooth spheres do not keep apart here. Set lubrication.minimum_gap (roughness) or contact, "
                "or raise repulsion.force"
            )
        _hold(self.rows, position, self.edge, self.tilt(time), log_gap, ACCURACY, SWEEPS)
