"""Products and time of velocity evaluations with far field, cold and warm, in the paper's oscillatory run.

    NUMBA_NUM_THREADS=1 python benchmarks/bench_coupled.py [--csv benchmarks/results/coupled.csv]

Runs gamma0 = 0.8 with far field to total strain 6.4 (`--strain`, whole cycles), then measures 40 evaluations of the
run as it goes on (warm: started from the extrapolation of earlier ones) and repeats each with an empty history
(cold), N = 500, seed 1. `accurate` products are with the mobility of the tolerance asked, `coarse` with that of the
inner iteration.
The parts are the medians of one evaluation: list excluded, `place` prepares the mobility, `solve` is all products.
"""

from __future__ import annotations

import argparse
import csv
import time
from pathlib import Path

import numpy as np

from suspend.config import load
from suspend.dynamics import History
from suspend.initial import prepare_initial
from suspend.simulation import Simulation

PAPER = Path(__file__).parent.parent / "configs" / "paper.yaml"
COLUMNS = ("phi", "tolerance", "start", "evaluations", "accurate", "accurate_max", "coarse", "place_ms", "solve_ms",
           "evaluation_ms")  # fmt: skip


class Clock:
    """Wraps a method and keeps the time of every call."""

    def __init__(self, owner, name: str):
        self.times: list[float] = []
        inner = getattr(owner, name)

        def timed(*arguments, **named):
            started = time.perf_counter()
            result = inner(*arguments, **named)
            self.times.append(time.perf_counter() - started)
            return result

        setattr(owner, name, timed)


def developed(phi: float, tolerance: float, number: int, strain: float) -> Simulation:
    """A run brought to a total strain (whole cycles) at the usual tolerance, to go on at `tolerance`."""
    overrides = [f"particles.number={number}", f"particles.volume_fraction={phi}", "output.flow_driven=false"]
    content = None
    for accuracy in (1e-3, tolerance):
        far = ["far_field=ewald", f"solver.far_tolerance={accuracy}", f"ewald.tolerance={accuracy}"]
        config = load(PAPER, [*overrides, *far])
        initial = prepare_initial(config, config.directory)
        simulation = Simulation(config, 1, initial.length)
        if content is not None:
            simulation.load(content, None)
            return simulation
        simulation.start(initial.positions, initial.tilt)
        while simulation.flow.accumulated(simulation.state.cycle, 0.0) < strain - 1e-9:
            simulation.begin_cycle()
            while simulation.events:
                simulation.step()
            simulation.end_cycle()
        content, _ = simulation.dump()
    raise AssertionError


def measure(phi: float, tolerance: float, number: int, strain: float) -> list[tuple]:
    simulation = developed(phi, tolerance, number, strain)
    suspension = simulation.suspension
    place, solve = Clock(suspension.far, "place"), Clock(suspension.far, "solve")
    rows = {"warm": [], "cold": []}
    inner = suspension.evaluate

    def both(*arguments):
        kept = suspension.history
        suspension.history = History(length=kept.length)
        counted(arguments, "cold")
        suspension.history = kept
        return counted(arguments, "warm")

    def counted(arguments, start):
        solver = suspension.far.solver
        before = solver.products, solver.coarse_products
        started = time.perf_counter()
        velocity = inner(*arguments)
        elapsed = time.perf_counter() - started
        rows[start].append(
            (solver.products - before[0], solver.coarse_products - before[1], place.times[-1], solve.times[-1], elapsed)
        )
        return velocity

    simulation.begin_cycle()
    suspension.evaluate = both
    while len(rows["warm"]) < 44 and simulation.events:
        simulation.step()
    result = []
    for start in ("cold", "warm"):
        found = np.array(rows[start][4:])  # the first evaluations compile and fill the history
        p = np.median(found, axis=0)
        result.append((phi, tolerance, start, len(found), p[0], int(found[:, 0].max()), p[1], *(1e3 * p[2:])))
    return result


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--number", type=int, default=500)
    parser.add_argument("--strain", type=float, default=6.4)
    parser.add_argument("--phi", type=float, nargs="+", default=[0.3, 0.4, 0.5])
    parser.add_argument("--tolerance", type=float, nargs="+", default=[1e-3, 1e-4, 1e-6])
    parser.add_argument("--csv", type=Path)
    arguments = parser.parse_args()
    rows = []
    print("phi  tolerance start evaluations accurate (max) coarse  place ms  solve ms  evaluation ms (medians)")
    for phi in arguments.phi:
        for tolerance in arguments.tolerance:
            for row in measure(phi, tolerance, arguments.number, arguments.strain):
                rows.append(row)
                print("{:<4g} {:<9g} {:<5} {:<11} {:<5g} ({})      {:<6g} {:>7.2f}  {:>8.2f}  {:>8.2f}".format(*row))
    if arguments.csv:
        with arguments.csv.open("w", newline="") as file:
            writer = csv.writer(file)
            writer.writerow(COLUMNS)
            writer.writerows([[f"{x:.4g}" if isinstance(x, float) else x for x in row] for row in rows])


if __name__ == "__main__":
    main()
