"""Gaps of nearly touching pairs: a state of their own beside the positions.

Two smooth spheres that are pressed together approach as d(ln h)/dt = v_n/h: their gap h shrinks exponentially but
never closes, and v_n/h changes slowly however small h is. Positions in double precision hold no gap below 1e-15 times
the cell, and a Runge-Kutta step in positions has an error that does not know of h. So ln h of every pair closer than
`CLOSE` is integrated with the same stages, kept from step to step, and what the velocities are computed from. The
positions of each stage are moved along the lines of centres until their gaps agree, down to `PINNED`; that displacement
is of the size of the step's own error.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np

from suspend.core.jit import kernel
from suspend.core.pairs import LOG_STIFFEST, HeldPairs, place_held, separation

CLOSE = 1e-3  # radii: gap below which a pair is kept
PINNED = 1e-8  # radii: smallest gap of the positions
ROUND_OFF = 2.0**-52  # radii: of a distance of two radii
ACCURACY = 1e-2  # of the positions' gaps, relative, but not below a tenth of PINNED
SWEEPS = 400


@dataclass
class TouchingPairs:
    """Pairs closer than `CLOSE` between steps: rows (K, 5) as in the neighbour list, and ln h (K,)."""

    rows: np.ndarray = field(default_factory=lambda: np.empty((0, 5), np.int32))
    log_gap: np.ndarray = field(default_factory=lambda: np.empty(0))

    def flip(self, flips: int) -> None:
        """Name the images by a cell whose tilt is lower by `flips`."""
        self.rows[:, 2] += flips * self.rows[:, 3]

    def wrap(self, image: np.ndarray) -> None:
        """Name the images after spheres were shifted back by `image` (N, 3) cell vectors."""
        self.rows[:, 2:] += image[self.rows[:, 1]] - image[self.rows[:, 0]]

    def held(self) -> HeldPairs | None:
        """For an evaluation; None where nothing touches."""
        return HeldPairs(self.rows, self.log_gap) if len(self.rows) else None


@kernel
def _close_rows(pairs, log_gap, position, edge, tilt, below):
    chosen = np.empty(pairs.shape[0], np.int64)
    found_log = np.empty(pairs.shape[0])
    found = 0
    reach2 = (2.0 + below) ** 2
    for p in range(pairs.shape[0]):
        if pairs[p, 0] == pairs[p, 1]:
            continue
        t = log_gap[p]
        if t != t:
            dx, dy, dz = separation(pairs, p, position, edge, tilt)
            r2 = dx * dx + dy * dy + dz * dz
            if r2 >= reach2 or r2 <= 4.0:  # contact and overlap are for the evaluation to refuse
                continue
            t = math.log(max(math.sqrt(r2) - 2.0, ROUND_OFF))
        elif t >= math.log(below):
            continue
        chosen[found] = p
        found_log[found] = t
        found += 1
    return chosen[:found], found_log[:found]


@kernel
def _rates(rows, log_gap, position, edge, tilt, velocity, shear_rate, rate):
    for p in range(rows.shape[0]):
        i, j = rows[p, 0], rows[p, 1]
        d = separation(rows, p, position, edge, tilt)
        r2 = d[0] * d[0] + d[1] * d[1] + d[2] * d[2]
        # At contact; the gap's own share of the affine motion is added without a division by h.
        approach = 0.0
        for c in range(3):
            approach += (velocity[j, c] - velocity[i, c]) * d[c]
        approach /= math.sqrt(r2)
        affine = shear_rate * d[1] * d[0] / r2
        rate[p] = (approach + 2.0 * affine) * math.exp(-max(log_gap[p], LOG_STIFFEST)) + affine


@kernel
def _hold(rows, position, edge, tilt, log_gap, limits):
    """Gauss-Seidel over the pairs; returns the largest excess of a gap over its allowance that is left."""
    accuracy, pinned, sweeps = limits
    worst = 0.0
    for _ in range(sweeps):
        worst = 0.0
        for p in range(rows.shape[0]):
            i, j = rows[p, 0], rows[p, 1]
            d = separation(rows, p, position, edge, tilt)
            r = math.sqrt(d[0] * d[0] + d[1] * d[1] + d[2] * d[2])
            gap = max(math.exp(log_gap[p]), pinned)
            excess = r - 2.0 - gap
            worst = max(worst, abs(excess) / max(accuracy * gap, 0.1 * pinned))
            for c in range(3):
                shift = 0.5 * excess * d[c] / r
                position[i, c] += shift
                position[j, c] -= shift
        if worst <= 1.0:
            break
    return worst


class CloseGaps:
    """The pairs that are closer than `CLOSE` at the start of a step, and the logarithms of their gaps.

    verlet : neighbour list; before : the touching pairs kept so far; position (N, 3); tilt and shear_rate : functions
    of time.
    """

    def __init__(self, verlet, before: TouchingPairs, position: np.ndarray, time: float, tilt, shear_rate):
        self.edge, self.tilt, self.shear_rate = verlet.edge, tilt, shear_rate
        pairs = verlet.pairs
        known = place_held(pairs, verlet.offset, HeldPairs(before.rows, before.log_gap))
        chosen, self.log_gap = _close_rows(pairs, known, position, self.edge, tilt(time), CLOSE)
        self.rows = pairs[chosen]

    def __len__(self) -> int:
        return len(self.rows)

    def held(self, change=0.0) -> HeldPairs:
        """The gaps after ln h has changed by `change`, for an evaluation."""
        return HeldPairs(self.rows, self.log_gap + change)

    def after(self, change) -> TouchingPairs:
        """The pairs to be kept after a step."""
        return TouchingPairs(self.rows.copy(), self.log_gap + change)

    def rates(self, held: HeldPairs, position: np.ndarray, time: float, velocity: np.ndarray) -> np.ndarray:
        """d(ln h)/dt of each pair at the gaps `held`, velocities (N, 6) relative to the undisturbed flow."""
        rate = np.empty(len(self.rows))
        tilt, shear_rate = self.tilt(time), self.shear_rate(time)
        _rates(self.rows, held.log_gap, position, self.edge, tilt, velocity, shear_rate, rate)
        return rate

    def hold(self, position: np.ndarray, time: float, held: HeldPairs) -> float:
        """Move spheres (N, 3), in place, until the gaps are those of `held`; returns what is left (1: as allowed)."""
        limits = (ACCURACY, PINNED, SWEEPS)
        return _hold(self.rows, position, self.edge, self.tilt(time), held.log_gap, limits)
