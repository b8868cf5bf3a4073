"""The threads of the kernels: how many a scene is cut into, and whether they can be started here."""

from __future__ import annotations

import os

import numba

from suspend.errors import ConfigurationError, SuspendError

THREADED_FROM = 2000  # spheres from which a second thread pays (benchmarks/bench_evaluation.py)
ALWAYS_THERE = "workqueue"  # the layer that Numba brings itself
_FORKED = (
    "this process was forked after its parent had computed: the threads of the kernels do not exist here and nothing "
    'would be computed. Start processes with "spawn": multiprocessing.get_context("spawn").Pool(...), or '
    'ProcessPoolExecutor(mp_context=multiprocessing.get_context("spawn")); or fork before the first computation'
)
_forked = False


def _after_fork() -> None:
    """In the child: were the threads of the kernels running in the parent?"""
    global _forked
    try:
        numba.threading_layer()
    except ValueError:  # no parallel kernel has run
        return
    _forked = True


if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=_after_fork)


def start_threads(number: int, threads: int) -> int:
    """Threads that a scene of `number` spheres is cut into, at most `threads`, ready to compute; the others sleep.

    Raises SuspendError in a process forked after a computation, ConfigurationError where NUMBA_THREADING_LAYER asks
    for a layer that is not there (one thread needs none: it takes Numba's own).
    """
    if _forked:
        raise SuspendError(_FORKED)
    used = min(threads, numba.config.NUMBA_NUM_THREADS) if number >= THREADED_FROM else 1
    try:
        numba.set_num_threads(used)  # idle threads would spin
    except ValueError as error:
        if used > 1:
            raise ConfigurationError(
                f"the environment has NUMBA_THREADING_LAYER={numba.config.THREADING_LAYER}, which cannot be loaded: "
                "unset it, install that layer, or compute with one thread (--threads 1)"
            ) from error
        numba.config.THREADING_LAYER = ALWAYS_THERE
        numba.set_num_threads(used)
    return used
