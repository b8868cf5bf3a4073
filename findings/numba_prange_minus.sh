#!/usr/bin/env bash
# Numba: the index of a prange loop that starts at 0 is unsigned once the loop runs in parallel. Differences with it are
# right, but its negative is 2^64 - i: -i is 1.8e19 while 0 - i is -1. A wave number written that way is right
# without parallel=True, and with it for i = 0 only.
. "$(dirname "$0")/common.bash"
install numba==0.68.1 numpy==2.4.6
measure <<'END'
import numba
import numpy as np
from finding import as_found, versions

versions("numba", "numpy")


def negative(out):
    for i in numba.prange(len(out)):
        out[i] = -i


def difference(out):
    for i in numba.prange(len(out)):
        out[i] = 0 - i


results = {}
for function in (negative, difference):
    for parallel in (False, True):
        out = np.zeros(3)
        numba.njit(parallel=parallel)(function)(out)
        results[function.__name__, parallel] = out.tolist()
        print(f"{function.__name__}, parallel={parallel}: {out.tolist()}")
EXACT = [0.0, -1.0, -2.0]
as_found("0 - i is right in both", results["difference", False] == results["difference", True] == EXACT)
as_found("-i is right in a serial loop", results["negative", False] == EXACT)
as_found("-i is 2^64 - i in a parallel one", results["negative", True] == [0.0, 2.0**64, 2.0**64])
END
