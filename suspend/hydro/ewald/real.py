"""The real-space part of the Ewald sum: pair scalars of a configuration and their mobility product."""

from __future__ import annotations

import numba
import numpy as np

from suspend.core.ewald_functions import RadialTable
from suspend.core.ewald_pairs import (
    BLOCK,
    LANES,
    LOAD,
    MOTION,
    PackedPairs,
    add_motions,
    apply_rows,
    pack_rows,
    unpack_loads,
)
from suspend.core.jit import parallel_kernel
from suspend.core.pairs import PlacedPairs
from suspend.hydro.rows import split_rows


@parallel_kernel
def _pack(chunks, start, placed, table, packed):
    number = np.zeros(chunks.shape[0] - 1, np.int64)
    for t in numba.prange(chunks.shape[0] - 1):
        number[t] = pack_rows(chunks[t], chunks[t + 1], start, placed, table, packed)
    return number.sum()


@parallel_kernel
def _apply(chunks, packed, unpacked, partial):
    for t in numba.prange(chunks.shape[0] - 1):
        partial[t] = 0.0
        apply_rows(chunks[t], chunks[t + 1], packed, unpacked, partial[t])


class RealPart:
    """Real part of M_ff: pairs (own images included) closer than the table's cutoff, and the self terms.

    Parameters
    ----------
    table : the seven functions of the real part with their cutoff (`suspend.hydro.ewald.radial`)
    self_terms : (force, torque, stresslet) diagonal of the real part
    threads : parts the spheres are cut into; results depend on it in the last digits, not on anything else
    """

    def __init__(self, table: RadialTable, self_terms: tuple[float, float, float], threads: int):
        self.table, self.self_terms, self.threads = table, self_terms, threads
        self.pairs = self.offset = self.packed = None
        self.number_of_pairs = 0  # within the cutoff, at the last `place`

    def use_list(self, pairs: np.ndarray, offset: np.ndarray) -> None:
        """Take a neighbour list (`suspend.hydro.neighbours`) that reaches the cutoff or further."""
        if pairs is self.pairs and offset is self.offset:
            return
        number = offset.shape[0] - 1
        new = self.packed is None or number != self.packed.row.shape[0]
        if new:
            self._unpacked = np.empty((number, LOAD))
            self._partial = np.empty((self.threads, number, MOTION))
        self.pairs, self.offset = pairs, offset
        self._chunks = split_rows(offset, self.threads)
        self._start = np.concatenate([[0], np.cumsum(-(-np.diff(offset) // LANES))]).astype(np.int64)
        blocks = int(self._start[-1])
        if new or blocks > self.packed.other.shape[0]:
            row, other = np.zeros((number, 2), np.int64), np.empty((blocks, LANES), np.int32)
            self.packed = PackedPairs(row, other, np.empty((blocks, BLOCK)))

    def place(self, position: np.ndarray, edge: float, tilt: float) -> None:
        """Scalars of all listed pairs closer than the cutoff at positions (N, 3) (radii) and this tilt."""
        placed = PlacedPairs(self.pairs, self.offset, position, edge, tilt)
        self.number_of_pairs = _pack(self._chunks, self._start, placed, self.table, self.packed)

    def add(self, loads: np.ndarray, result: np.ndarray) -> None:
        """result (N, 11) += real part . loads (N, 11), [U, Omega, E] from [F, T, S], units 6 pi eta0 a^n."""
        unpack_loads(loads, self._unpacked)
        _apply(self._chunks, self.packed, self._unpacked, self._partial)
        add_motions(self._partial, self.self_terms, loads, result)

    @property
    def memory(self) -> int:
        """Bytes held for the pairs and the products, the neighbour list not counted."""
        arrays = (*self.packed, self._unpacked, self._partial, self._start)
        return sum(array.nbytes for array in arrays)
