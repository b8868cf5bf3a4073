"""Stiff and extreme scenes, each run twice: outcome, error against a tighter run, steps, time.

    python benchmarks/extremes.py [--only TEXT] [--short] [--output benchmarks/results/extremes.csv]

Every scene runs near field and with far field, at its tolerance and at a thirtieth of it; errors are those of the shear
stress (largest difference relative to the largest stress, over the samples of the first 3.2 units of strain, beyond
which neighbouring trajectories part) and of the positions (rms, at the last cycle's end within them, or the first's).
A scene that may stop does so with an error that names step, pair, gap and remedy. `--short`: the scenes of a minute.
"""

from __future__ import annotations

import argparse
import math
import time
from dataclasses import dataclass, field

import numpy as np

from suspend.config import from_dict
from suspend.dynamics import Overlap
from suspend.errors import SuspendError
from suspend.initial import InitialConfiguration, prepare_initial
from suspend.io.csv_text import write_csv_file
from suspend.scene import make_units
from suspend.simulation import Simulation

TIGHTER = 1.0 / 30.0
COMPARED = 3.2  # units of strain
EDGE = 12.0  # radii: cell of the few spheres placed by hand


@dataclass(frozen=True)
class Scene:
    """A scene: keys that differ from the usual, positions where they are placed by hand, and whether it may stop."""

    name: str
    keys: dict = field(default_factory=dict)
    positions: np.ndarray | None = None
    may_stop: bool = False
    long: bool = False


def line(count: int, gap: float) -> np.ndarray:
    """Spheres in a row, oblique to flow and gradient."""
    direction = np.array([1.0, -1.0, 0.3]) / math.sqrt(2.09)
    return 0.5 * EDGE + np.outer((np.arange(count) - 0.5 * (count - 1)) * (2.0 + gap), direction)


def tetrahedron(gap: float) -> np.ndarray:
    """Four spheres, all pairs at one gap, turned out of the axes."""
    corners = np.array([[1, 1, 1], [1, -1, -1], [-1, 1, -1], [-1, -1, 1]]) * (2.0 + gap) / math.sqrt(8.0)
    turn, _ = np.linalg.qr(np.array([[1.0, 0.2, 0.3], [0.1, 1.0, 0.4], [0.2, 0.5, 1.0]]))
    return 0.5 * EDGE + corners @ turn


def lattice(gap: float) -> np.ndarray:
    """27 spheres on a simple cubic lattice that fills the cell."""
    places = np.arange(3) * (2.0 + gap)
    return np.array(np.meshgrid(places, places, places)).reshape(3, -1).T + 0.1


def scenes() -> list[Scene]:
    """All scenes."""
    bare, steady = {"repulsion": None}, _steady(1.0)
    found = [Scene(f"pair at {gap:g} a", bare | steady, line(2, gap)) for gap in (1e-3, 1e-6, 1e-9, 1e-12)]
    found += [Scene(f"chain of 5 at {gap:g} a", bare | steady, line(5, gap)) for gap in (1e-6, 1e-9, 1e-11)]
    found += [Scene(f"tetrahedron at {gap:g} a", bare | steady, tetrahedron(gap)) for gap in (1e-6, 1e-9, 1e-11)]
    found += [Scene("simple cubic lattice at 1e-6 a", bare | steady, lattice(1e-6))]
    found += [Scene("pair in contact", bare | steady, line(2, 0.0), may_stop=True)]
    found += [Scene("pair that overlaps", bare | steady, line(2, -1e-3), may_stop=True)]
    found += [Scene(f"1/kappa = {length:g} a", _repulsion(10.0, length)) for length in (1e-2, 1e-3, 1e-4, 1e-5)]
    found += [Scene(f"F0 = {force:g}", _repulsion(force, 1e-2)) for force in (0.0, 0.1, 1e4)]
    found += [Scene("F0 = 1e8, gamma0 = 0.1", _repulsion(1e8, 1e-2) | _amplitude(0.1))]
    found += [Scene(f"gamma0 = {amplitude:g}", _amplitude(amplitude)) for amplitude in (1e-6, 1e-3, 10.0)]
    found += [Scene("gamma0 = 100", _amplitude(100.0) | {"duration": {"strain": 20.0}}, long=True)]
    found += [Scene(f"phi = {phi:g}", _phi(phi)) for phi in (1e-6, 0.01, 0.5, 0.55)]
    found += [Scene("phi = 0.5, F0 = 0", _phi(0.5) | _repulsion(0.0, 1e-2))]
    found += [Scene("phi = 0.60, gamma0 = 0.1", _phi(0.6) | _amplitude(0.1))]
    found += [Scene("phi = 0.60, gamma0 = 0.8", _phi(0.6), may_stop=True, long=True)]
    found += [Scene(f"N = {number}", _number(number)) for number in (1, 2, 3)]
    found += [Scene("phi = 0.5, steady", _phi(0.5) | _steady(3.0))]
    found += [Scene("F0 = 1, steady", _repulsion(1.0, 1e-2) | _steady(3.0))]
    found += [Scene("100 units of steady shear", _steady(100.0), long=True)]
    found += [Scene("phase 1.2", {"flow": {"type": "oscillatory", "amplitude": 0.8, "phase": 1.2}})]
    found += [Scene(f"tolerance {value:g}", {"tolerance": value}) for value in (1e-1, 1e-7)]
    return found


def _repulsion(force: float, length: float) -> dict:
    return {"repulsion": {"force": force, "debye_length": length}}


def _amplitude(amplitude: float) -> dict:
    return {"flow": {"type": "oscillatory", "amplitude": amplitude}, "duration": {"cycles": 1}}


def _steady(strain: float) -> dict:
    return {"flow": {"type": "steady"}, "duration": {"strain": strain}}


def _phi(phi: float) -> dict:
    return {"particles": {"number": 40, "volume_fraction": phi, "initial": "quenched" if phi > 0.1 else "equilibrium"}}


def _number(number: int) -> dict:
    return {"particles": {"number": number, "volume_fraction": 0.4}}


def simulation_of(scene: Scene, far_field: str, tolerance: float) -> Simulation:
    """A run of the scene, at its start."""
    usual = {
        "seed": 1,
        "particles": {"number": 40, "volume_fraction": 0.4, "initial": "quenched"},
        "flow": {"type": "oscillatory", "amplitude": 0.8},
        "duration": {"cycles": 1},
        "repulsion": {"force": 10.0, "debye_length": 0.01},
        "output": {"samples_per_cycle": 32},
    }
    tree = usual | scene.keys | {"far_field": far_field, "tolerance": tolerance}
    if scene.positions is None:
        config = from_dict(tree)
        start: InitialConfiguration = prepare_initial(config, ".")
        simulation = Simulation(config, 1, start.length)
        simulation.start(start.positions, start.tilt)
        return simulation
    number = len(scene.positions)
    edge = 3 * 2.0 * (1.0 + 5e-7) if number == 27 else EDGE
    tree["particles"] = {"number": number, "volume_fraction": number * 4.0 * math.pi / (3.0 * edge**3)}
    config = from_dict(tree)
    simulation = Simulation(config, 1, edge)
    simulation.start(scene.positions / make_units(config).length, 0.0)
    return simulation


@dataclass
class Outcome:
    """What a run gave."""

    stress: np.ndarray
    position: np.ndarray | None
    smallest: float  # ln h
    steps: int
    seconds: float
    stop: str = ""


def outcome_of(scene: Scene, far_field: str, tolerance: float) -> Outcome:
    """Run the scene to its end, or to its error."""
    stress, smallest, steps, began = [], math.inf, 0, time.monotonic()
    position = None
    try:
        simulation = simulation_of(scene, far_field, tolerance)
        while simulation.state.cycle < simulation.flow.cycles:
            simulation.begin_cycle()
            while simulation.events:
                simulation.step()
                steps += 1
                smallest = min([smallest, *simulation.state.touching.log_gap])
            gap = simulation.suspension.counters.minimum_gap
            smallest = min(smallest, math.log(gap)) if 0.0 < gap < math.inf else smallest
            cycle, period = simulation.state.cycle, simulation.flow.period(simulation.state.cycle)
            record = simulation.end_cycle()
            early = [simulation.flow.accumulated(cycle, period * phase) <= COMPARED for phase in record["phase"]]
            stress.append((record["stress_hydrodynamic"][:, 3] + record["stress_interparticle"][:, 3])[early])
            if simulation.flow.accumulated(cycle, period) <= COMPARED * (1.0 + 1e-9) or position is None:
                position = simulation._unwrapped()
        stop = ""
    except (SuspendError, Overlap) as error:  # `suspend run` refuses a start that overlaps; here the evaluation does
        stop = f"{type(error).__name__}: {error}"
    series = np.concatenate(stress) if stress else np.empty(0)
    return Outcome(series, position, smallest, steps, time.monotonic() - began, stop)


def row_of(scene: Scene, far_field: str) -> list:
    """One line of the table."""
    tolerance = scene.keys.get("tolerance", 1e-3)
    found = outcome_of(scene, far_field, tolerance)
    if found.stop:
        verdict = "may stop" if scene.may_stop else "FAILED"
        return [scene.name, far_field, verdict, "", "", "", found.steps, f"{found.seconds:.1f}", found.stop]
    truth = outcome_of(scene, far_field, max(TIGHTER * tolerance, 1e-9))
    stress = position = math.nan
    if not truth.stop and len(truth.stress):
        stress = np.abs(found.stress - truth.stress).max() / max(np.abs(truth.stress).max(), 1e-300)
        position = math.sqrt(np.mean(np.sum((found.position - truth.position) ** 2, axis=1)))
    gap = "" if found.smallest == math.inf else f"{found.smallest:.1f}"
    figures = [gap, f"{stress:.1e}", f"{position:.1e}", found.steps, f"{found.seconds:.1f}"]
    return [scene.name, far_field, "ends", *figures, truth.stop]


HEAD = ["scene", "far_field", "outcome", "ln_smallest_gap", "stress_error", "position_error[a]", "steps", "time[s]"]
HEAD += ["error"]


def main() -> None:
    """Run the scenes and write the table as it grows."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--only", default="")
    parser.add_argument("--short", action="store_true")
    parser.add_argument("--output", default="benchmarks/results/extremes.csv")
    given = parser.parse_args()
    rows = []
    for scene in scenes():
        if given.only not in scene.name or (given.short and scene.long):
            continue
        for far_field in ("self", "ewald"):
            rows.append(row_of(scene, far_field))
            print(" | ".join(str(cell)[:160] for cell in rows[-1]), flush=True)
            write_csv_file(given.output, [HEAD, *rows])
    failed = [row for row in rows if row[2] == "FAILED"]
    print(f"{len(rows)} scenes, {len(failed)} failed")
    raise SystemExit(bool(failed))


if __name__ == "__main__":
    main()
