"""The one compiler setting of the package.

`error_model="numpy"` keeps host and device arithmetic alike (inf instead of an exception) and is faster.
The only freedom given to the compiler is the fused multiply-add. With `reassoc`, code compiled in the process and the
same code loaded from the cache summed in different orders (and no faster), so runs were not reproducible bit for bit.
"""

from __future__ import annotations

from numba import njit

scalar = njit(error_model="numpy", cache=True)
_FUSED = {"contract"}
kernel = njit(error_model="numpy", cache=True, nogil=True, fastmath=_FUSED)
parallel_kernel = njit(error_model="numpy", cache=True, parallel=True, fastmath=_FUSED)
