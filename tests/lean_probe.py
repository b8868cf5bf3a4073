"""What a run used, in a process of its own: modules, compiled kernels, work done. Called by tests and benchmarks.

    python lean_probe.py CONFIGURATION.json FOLDER

Prints JSON. A kernel that was never compiled nor loaded from the cache has no signature, so was never launched.
"""

from __future__ import annotations

import gc
import json
import resource
import sys
import time


def kernels() -> list[str]:
    """Names of all kernels of the package with a compiled signature, as module.function."""
    from numba.core.dispatcher import Dispatcher

    found = [item for item in gc.get_objects() if isinstance(item, Dispatcher) and item.overloads]
    names = {f"{item.py_func.__module__}.{item.py_func.__name__}" for item in found}
    return sorted(name for name in names if name.startswith("suspend."))


def main(tree: dict, folder: str) -> dict:
    begin = time.perf_counter()
    from suspend.config import from_dict
    from suspend.simulation import run

    imported = time.perf_counter()
    run(from_dict(tree), folder, threads=1)
    done = time.perf_counter()
    modules, used = sorted(sys.modules), kernels()
    from suspend.io import Run

    with Run(folder) as stored:
        statistics = {name: float(column.sum()) for name, column in stored.statistics().items()}
        fields = stored.fields
    return {
        "modules": modules,
        "kernels": used,
        "statistics": statistics,
        "fields": fields,
        "import_seconds": imported - begin,
        "run_seconds": done - imported,
        "cycle_seconds": statistics["wall_time"],
        "megabytes": resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1e3,
    }


if __name__ == "__main__":
    with open(sys.argv[1], encoding="utf-8") as file:
        print(json.dumps(main(json.load(file), sys.argv[2])))
