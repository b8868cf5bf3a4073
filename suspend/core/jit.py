"""The one compiler setting of the package.

`error_model="numpy"` keeps host and device arithmetic alike (inf instead of an exception) and is faster.
`reassoc` lets the compiler vectorise sums on the CPU; the order of summation is then fixed at compile time,
so results stay bit-identical from run to run on one machine.
"""

from __future__ import annotations

from numba import njit

scalar = njit(error_model="numpy", cache=True)
_SUMS = {"contract", "reassoc", "nsz"}
kernel = njit(error_model="numpy", cache=True, nogil=True, fastmath=_SUMS)
parallel_kernel = njit(error_model="numpy", cache=True, parallel=True, fastmath=_SUMS)
