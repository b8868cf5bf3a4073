"""The one compiler setting of the package, and the cache of what it compiled.

`error_model="numpy"` keeps host and device arithmetic alike (inf instead of an exception) and is faster.
The only freedom given to the compiler is the fused multiply-add. With `reassoc`, code compiled in the process and the
same code loaded from the cache summed in different orders (and no faster), so runs were not reproducible bit for bit.

The cache saves time and is never needed: see `suspend.core.kernel_cache`.
"""

from __future__ import annotations

from numba import njit

from suspend.core.kernel_cache import cached

_FUSED = {"contract"}


def _compiler(**settings):
    def decorate(function):
        return cached(njit(error_model="numpy", **settings)(function))

    return decorate


scalar = _compiler()
kernel = _compiler(nogil=True, fastmath=_FUSED)
parallel_kernel = _compiler(parallel=True, fastmath=_FUSED)
# Without a cache: it becomes part of its callers (a call in a loop over lanes would keep the loop scalar).
inlined = njit(error_model="numpy", inline="always")
