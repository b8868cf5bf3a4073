"""Near-field resistance of a configuration: assembly, loads, velocity solve, stresslets.

    (R_self + R_nf) U' = F_P + R_FE^nf : E          U' relative to the undisturbed flow
    S = -R_SU^nf U' + (R_SE^self + R_SE^nf) : E     (Brady's sign), summed over the spheres

R_nf = sum over pairs closer than the cutoff of [exact two-sphere resistance - inverse of the two-sphere FTS
mobility] (Durlofsky, Brady & Bossis 1987). Exact for a pair only with the far field, whose FTS mobility gives back what
is subtracted here; beside R_self alone, the paper's model, it is not. Internal units of `suspend.conventions`.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numba
import numpy as np

from suspend.core.jit import parallel_kernel
from suspend.core.pairs import (
    STRIDE,
    WIDTH,
    ActivePairs,
    HeldPairs,
    PairTable,
    PlacedPairs,
    assemble_rows,
    evaluate_combined,
    place_held,
    strain_loads_rows,
    stresslet_of_each,
    stresslet_rows,
)
from suspend.errors import ConfigurationError, NumericalError
from suspend.hydro.rows import split_rows
from suspend.hydro.table import largest_gap, load_table
from suspend.solvers.conjugate_gradient import Goal, conjugate_gradient
from suspend.solvers.incomplete import factorise
from suspend.solvers.stiff_clusters import factorise_clusters

_NAMES = ("XA", "YA", "YB", "XC", "YC", "XG", "YG", "YH", "XM", "YM", "ZM")


def _combinations(odd: bool) -> np.ndarray:
    """Matrix (16, 24) from the table's functions to the combined ones of `suspend.core.pairs.COMBINED`.

    odd : with XG+, YG+, YH- in the places of XG-, YG-, YH+ (for the difference of a pair's stresslets).
    """
    sign = -1 if odd else 1

    def parity(name: str, other: int) -> np.ndarray:
        row = np.zeros(24)
        first = 2 * _NAMES.index(name)
        row[first], row[first + 1] = 1.0, other
        return row

    rows = []
    for tensor in ("A", "C"):
        for other in (1, -1):
            x, y = parity("X" + tensor, other), parity("Y" + tensor, other)
            rows += [0.5 * (x - y), 0.5 * y]
    spin = [0.5 * parity("YB", 1), 0.5 * parity("YB", -1)]
    strain = [parity("XG", -sign), parity("YG", -sign), parity("YH", sign)]
    strain += [parity("XM", 1), parity("YM", 1), parity("ZM", 1)]
    return np.array(rows[:4] + spin + rows[4:] + strain)


def pair_table(
    cutoff: float, at_cutoff: str = "shifted", frozen: float = 0.0, odd: bool = False
) -> PairTable:
    """Combined functions for a cutoff (centre distance, radii) and what happens there.

    at_cutoff : `hard` leaves the functions as they are, `shifted` subtracts their value at the cutoff,
    `tapered` shifts and multiplies by a twice differentiable factor over the last tenth of the range. odd :
    see `_combinations`.
    """
    table = load_table()
    if not 2.0 < cutoff <= 2.0 + largest_gap(table) + 1e-12:
        raise ConfigurationError(
            f"lubrication.cutoff: {cutoff:g} radii; "
            f"the two-sphere table covers 2 < cutoff <= {2 + largest_gap(table):g}"
        )
    combine = _combinations(odd)
    coefficients = np.ascontiguousarray(np.einsum("cf,kdf->kdc", combine, table.coefficients))
    singular = np.stack([combine @ table.g1, combine @ table.g2])
    start = 2.0 + 0.9 * (cutoff - 2.0) if at_cutoff == "tapered" else cutoff
    packed = PairTable(table.t0, table.inv_dt, coefficients, singular, cutoff, start, frozen)
    if at_cutoff != "hard":
        value = np.empty(WIDTH)
        gap = max(cutoff - 2.0, frozen)
        evaluate_combined(packed, math.log(gap), 1.0 / gap, value)
        coefficients[:, 0, :] -= value
    return packed


@dataclass
class Solution:
    """Velocities (N, 6) relative to the undisturbed flow, and what they cost."""

    velocity: np.ndarray
    iterations: int
    error: float  # estimated relative error, energy norm


@parallel_kernel
def _assemble(chunks, placed, log_gap, table, active, scalars):
    smallest = np.full(chunks.shape[0] - 1, np.inf)
    for t in numba.prange(chunks.shape[0] - 1):
        smallest[t] = assemble_rows(chunks[t], chunks[t + 1], placed, log_gap, table, active, scalars)
    return smallest.min()


@parallel_kernel
def _strain_loads(chunks, active, scalars, strain_rate, load):
    partial = np.zeros((chunks.shape[0] - 1, load.shape[0], 6))
    for t in numba.prange(chunks.shape[0] - 1):
        strain_loads_rows(chunks[t], chunks[t + 1], active, scalars, strain_rate, partial[t])
    for t in range(chunks.shape[0] - 1):
        load += partial[t]


@parallel_kernel
def _stresslet(chunks, active, scalars, velocity, strain_rate):
    partial = np.zeros((chunks.shape[0] - 1, 6))
    for t in numba.prange(chunks.shape[0] - 1):
        stresslet_rows(chunks[t], chunks[t + 1], active, scalars, velocity, strain_rate, partial[t])
    return partial  # summed outside: a reduction in here would depend on the number of threads


class NearField:
    """Near-field hydrodynamics of spheres with lubrication; `assemble` first, then loads, solve, stresslet.

    Parameters
    ----------
    table : functions with cutoff, from `pair_table`
    drag, rotational_drag : diagonal of R_self in units of 6 pi eta0 a^n (1 and 4/3; `identity`: 1 and 1)
    self_stresslet : R_SE of a lone sphere (10/9; `identity`: 2)
    threads : parts the spheres are cut into
    """

    def __init__(self, table: PairTable, drags: tuple[float, float], threads: int):
        self.table, self.drags, self.threads = table, drags, threads
        self.active = self.scalars = self.chunks = self.factor = None

    def use_list(self, pairs: np.ndarray, offset: np.ndarray) -> None:
        """Take a new neighbour list (`suspend.hydro.neighbours`); drops the preconditioner's arrays."""
        self.pairs, self.offset = pairs, offset
        self.chunks = split_rows(offset, self.threads)
        number = offset.shape[0] - 1
        self.active = ActivePairs(
            np.zeros((number, 2), np.int64), np.empty(len(pairs), np.int32), np.empty(len(pairs))
        )
        self.scalars = np.empty((len(pairs), STRIDE))

    def assemble(self, position: np.ndarray, edge: float, tilt: float, held: HeldPairs | None = None) -> float:
        """Scalars of all pairs at these positions; returns the smallest gap (inf without pairs).

        held : pairs whose gaps are given by their logarithms, whatever the positions say (`suspend.gaps`).
        """
        placed = PlacedPairs(self.pairs, self.offset, position, edge, tilt)
        self.log_gap = np.empty(0) if held is None else place_held(self.pairs, self.offset, held)
        return _assemble(self.chunks, placed, self.log_gap, self.table, self.active, self.scalars)

    def strain_loads(self, strain_rate: np.ndarray) -> np.ndarray:
        """R_FE : E, shape (N, 6)."""
        load = np.zeros((self.offset.shape[0] - 1, 6))
        _strain_loads(self.chunks, self.active, self.scalars, strain_rate, load)
        return load

    def precondition(self, below: float) -> None:
        """New factorisations from the present scalars: incomplete of pairs with gap < `below`, exact of clusters."""
        self.factor = factorise(self.active, self.scalars, below, self.chunks, *self.drags)
        self.clusters = factorise_clusters(self.active, self.scalars, self.drags, len(self.chunks) - 1)

    def solve(self, load, start, tolerance: float, floor2: float, limit: int) -> Solution:
        """Velocities (N, 6) for `load` (N, 6), started from `start`; raises NumericalError at the limit."""
        velocity = start.copy()
        goal = Goal(tolerance, floor2, limit)
        iterations, error = conjugate_gradient(
            self.chunks, self.active, self.scalars, self.factor, self.clusters, load, velocity, goal
        )
        if not error <= tolerance:
            raise NumericalError(
                "the velocity solve did not converge: "
                f"estimated relative error {error:.3g} after {iterations} "
                f"iterations, asked for {tolerance:.3g} (solver.tolerance, solver.max_iterations)"
            )
        return Solution(velocity, iterations, error)

    def stresslet(self, velocity: np.ndarray, strain_rate: np.ndarray) -> np.ndarray:
        """Sum over the spheres of -R_SU^nf velocity + R_SE^nf : E, six components."""
        return _stresslet(self.chunks, self.active, self.scalars, velocity, strain_rate).sum(axis=0)

    def stresslet_of_each(self, odd: PairTable, position, edge, tilt, velocity, strain_rate) -> np.ndarray:
        """The same for every sphere, (N, 6), at the positions of the last `assemble`.

        odd : `pair_table(..., odd=True)` of the same cutoff.
        """
        difference = np.empty_like(self.scalars)
        active = ActivePairs(*(np.empty_like(array) for array in self.active))
        placed = PlacedPairs(self.pairs, self.offset, position, edge, tilt)
        _assemble(self.chunks, placed, self.log_gap, odd, active, difference)
        each = np.zeros((len(position), 6))
        stresslet_of_each(self.active, self.scalars, difference, velocity, strain_rate, each)
        return each
