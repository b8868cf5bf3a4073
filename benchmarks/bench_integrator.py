"""Error of the integrator against its cost, from states of the paper's oscillatory run.

    NUMBA_NUM_THREADS=1 python benchmarks/bench_integrator.py [--amplitude 0.8]

From six states of a run at phi = 0.40 the motion over a strain of 0.2 is compared with a converged reference
(tsitouras at tolerance 1e-8, velocities to 1e-10): rms position error in radii, and evaluations per unit strain.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np
from scipy.optimize import brentq

from suspend.config import load
from suspend.integrators import METHODS
from suspend.motion import Motion, State, StepSettings
from suspend.packing import random_packing
from suspend.simulation import Simulation

PAPER = Path(__file__).parent.parent / "configs" / "paper.yaml"
STRAIN = 0.2


def states(amplitude: float, packing) -> list[tuple]:
    """(cycle, time, positions, flips, step) at uneven phases of cycles 1 to 3."""
    simulation = Simulation(load(PAPER, [f"flow.amplitude={amplitude}"]), 1, packing.length)
    simulation.start(packing.positions, 0.0)
    found = []
    for cycle in range(4):
        simulation.begin_cycle()
        wanted = [0.07, 0.43] if cycle else []
        while simulation.events:
            phase = simulation.state.time / simulation.flow.period(0)
            if wanted and phase >= wanted[0]:
                wanted.pop(0)
                s = simulation.state
                found.append((cycle, s.time, s.position.copy(), s.flips, s.size))
            simulation.step()
        simulation.end_cycle()
    return found


def advance(amplitude: float, packing, state, method: str, tolerance: float, solver: float):
    """Positions after a strain of 0.2, and velocity evaluations used."""
    config = load(PAPER, [f"flow.amplitude={amplitude}", f"solver.tolerance={solver}"])
    simulation = Simulation(config, 1, packing.length)
    cycle, time, position, flips, size = state
    motion = Motion(simulation.suspension, simulation.flow, METHODS[method], StepSettings(tolerance))
    moving = State(position.copy(), np.zeros(position.shape, np.int32), np.zeros((len(position), 6)), cycle, time,
                   flips, size)  # fmt: skip
    flow, begun = simulation.flow, simulation.flow.accumulated(cycle, time)
    end = brentq(lambda t: flow.accumulated(cycle, t) - begun - STRAIN, time, time + 40.0 * amplitude, xtol=1e-14)
    moving.velocity = motion.evaluate(moving, moving.position, time)
    events = [end]
    while events:
        motion.advance(moving, events, lambda *_: None)
    return moving.position, simulation.suspension.counters.evaluations


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--amplitude", type=float, default=0.8)
    amplitude = parser.parse_args().amplitude
    packing = random_packing(500, 0.4, 1e-3, 1)
    chosen = states(amplitude, packing)
    reference = [advance(amplitude, packing, s, "tsitouras", 1e-8, 1e-10)[0] for s in chosen]
    for method, tolerances in (("bogacki-shampine", (3e-3, 1e-3, 3e-4, 1e-4)), ("tsitouras", (1e-2, 1e-3, 1e-4))):
        for tolerance in tolerances:
            results = [advance(amplitude, packing, s, method, tolerance, 1e-5) for s in chosen]
            errors = [np.sqrt(np.mean(np.sum((x - r) ** 2, 1))) for (x, _), r in zip(results, reference, strict=True)]
            cost = np.mean([n for _, n in results]) / STRAIN
            print(f"gamma0 {amplitude:g} {method} tolerance {tolerance:g}: {cost:.0f} evaluations per unit strain, "
                  f"rms error {max(errors):.2g} a at most, {np.median(errors):.2g} a median", flush=True)  # fmt: skip


if __name__ == "__main__":
    main()
