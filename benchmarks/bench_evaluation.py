"""Cost of a velocity evaluation in the paper's oscillatory run, and how it grows with N.

    NUMBA_NUM_THREADS=1 python benchmarks/bench_evaluation.py [--number 500 32000] [--tolerance 1e-6]
        [--far-field ewald]

Runs gamma0 = 0.8, phi = 0.40, cutoff 4 a with integrator.tolerance 1e-3 and prints the time per evaluation of the
last half of the strain (everything included: list, assembly, forces, preconditioner, solve, integrator).
"""

from __future__ import annotations

import argparse
import resource
import time
from dataclasses import asdict
from pathlib import Path

import numpy as np

from suspend.config import load
from suspend.packing import random_packing
from suspend.simulation import Simulation

PAPER = Path(__file__).parent.parent / "configs" / "paper.yaml"


def measure(number: int, tolerance: float, strain: float, threads: int, far_field: str) -> None:
    overrides = [f"particles.number={number}", "output.flow_driven=false", f"far_field={far_field}"]
    overrides.append(f"solver.tolerance={tolerance}" if far_field != "ewald" else f"tolerance={tolerance}")
    packing = random_packing(number, 0.4, 1e-3, 1)
    simulation = Simulation(load(PAPER, overrides), threads, packing.length)
    simulation.start(packing.positions, 0.0)
    times, evaluations, iterations = [], [], []
    begun = False
    while simulation.flow.accumulated(simulation.state.cycle, simulation.state.time) < strain:
        before, clock = asdict(simulation.suspension.counters), time.perf_counter()
        if simulation.between_cycles:
            before = {"evaluations": 0, "iterations": 0}
            simulation.begin_cycle()
        simulation.step()
        after = asdict(simulation.suspension.counters)
        if simulation.flow.accumulated(simulation.state.cycle, simulation.state.time) > 0.5 * strain or begun:
            begun = True
            times.append(time.perf_counter() - clock)
            evaluations.append(after["evaluations"] - before["evaluations"])
            iterations.append(after["iterations"] - before["iterations"])
        if not simulation.events:
            simulation.end_cycle()
    per = np.array(times) / np.array(evaluations)
    print(
        f"N {number}, {far_field}, threads {threads}, tolerance {tolerance:g}: median {1e3 * np.median(per):.3f} ms, "
        f"mean {1e3 * sum(times) / sum(evaluations):.3f} ms per evaluation, {1e6 * np.median(per) / number:.3f} us per "
        f"sphere, {sum(iterations) / sum(evaluations):.1f} iterations, {sum(evaluations)} evaluations, "
        f"{resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024:.0f} MB",
        flush=True,
    )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--number", type=int, nargs="+", default=[500])
    parser.add_argument("--tolerance", type=float, default=1e-6)
    parser.add_argument("--strain", type=float, default=6.4)
    parser.add_argument("--threads", type=int, default=1)
    parser.add_argument("--far-field", choices=("self", "ewald"), default="self")
    arguments = parser.parse_args()
    for number in arguments.number:
        measure(number, arguments.tolerance, arguments.strain, arguments.threads, arguments.far_field)


if __name__ == "__main__":
    main()
