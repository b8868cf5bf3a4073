"""A stored run whose spheres move through sheared cells, for the tests of exports and reports."""

from __future__ import annotations

import numpy as np
from synthetic_runs import EDGE, configuration, oscillatory_record, stress, write_run

SCALES = {"gamma0": 0.8, "omega": 1.0, "viscosity": 2.0, "phase": 0.0, "radius": 1.0}
FLOW = {"type": "oscillatory", "amplitude": 0.8}
NUMBER = 12
PARTS = {
    "hydrodynamic": lambda t: stress(3.0 * np.cos(t) - 0.1 * np.cos(3 * t), yy=0.2 * np.cos(2 * t) - 0.3),
    "interparticle": lambda t: stress(0.2 * np.sin(t)),
}


def vectors(tilt: float) -> np.ndarray:
    return EDGE * np.array([[1.0, 0.0, 0.0], [tilt, 1.0, 0.0], [0.0, 0.0, 1.0]])


def sheared_frames(seed: int, tilts: list[float]) -> dict[str, np.ndarray]:
    """Positions anywhere in space, brought into cells of the given tilts by plain linear algebra."""
    random = np.random.default_rng(seed)
    rows = {"tilt": np.array(tilts), "position": [], "image": [], "unwrapped": []}
    for tilt in tilts:
        lattice = random.uniform(-2.0, 3.0, (NUMBER, 3))
        lattice[:2] = [[0.5, 0.999, 0.5], [0.5, 0.001, 0.5]]  # a pair across the boundary that shifts
        image = np.floor(lattice)
        rows["position"].append((lattice - image) @ vectors(tilt))
        rows["image"].append(image.astype(np.int32))
        rows["unwrapped"].append(lattice @ vectors(tilt))
    return {name: np.array(values) for name, values in rows.items()}


def sheared_record(cycle: int, *, particle_stress: bool = False, samples: int = 64) -> dict:
    """One cycle with frames at phases 0 and 1/4, in cells of tilt 0 or 0.2 and 0.8 - 1 = -0.2."""
    tilts = [0.0 if cycle % 2 else 0.2, -0.2]
    record = oscillatory_record(cycle, SCALES, PARTS, samples, np.zeros((NUMBER, 3)))
    at = [0, samples // 4]
    record |= {"frame_time": record["time"][at], "frame_strain": record["strain"][at]}
    record |= {"frame_phase": record["phase"][at]} | sheared_frames(cycle, tilts)
    if particle_stress:
        shape = (samples, NUMBER, 6)
        record["particle_stress"] = np.random.default_rng(100 + cycle).normal(size=shape)
    return record


def sheared_run(path, cycles: int = 3, *, particle_stress: bool = False, finished: bool = True, **options):
    """Store such a run; a finished one has a last frame in which no stress was sampled."""
    config = configuration(FLOW, {"cycles": max(cycles, 1)}, number=NUMBER)
    records = [sheared_record(k, particle_stress=particle_stress, **options) for k in range(cycles)]
    return write_run(path, config, records, np.random.default_rng(9).random((NUMBER, 3)) if finished else None)
