"""Runs with known stresses and displacements, for the tests of the analysis and the figures."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from suspend.config import from_dict
from suspend.io import RunStore

EDGE = 30.0


def configuration(flow: dict, duration: dict, number: int = 4, radius: float = 1.0) -> str:
    """YAML text of a resolved configuration."""
    particles = {"number": number, "volume_fraction": 0.1, "radius": radius}
    return from_dict(
        {"particles": particles, "fluid": {"viscosity": 2.0}, "flow": flow, "duration": duration}
    ).to_yaml()


def stress(shear, xx=0.0, yy=0.0, zz=0.0) -> np.ndarray:
    """Stress samples (n, 6) with the given components."""
    shear = np.asarray(shear, float)
    made = np.zeros((len(shear), 6))
    made[:, 0], made[:, 1], made[:, 2], made[:, 3] = xx, yy, zz, shear
    return made


def oscillatory_record(index: int, scales: dict, parts: dict, n: int = 64, unwrapped=None) -> dict:
    """A cycle whose stress parts are functions of theta, the phase of the strain, returning (n, 6).

    The fluid's own stress is eta0 times the rate. `unwrapped` (N, 3): positions at the cycle's start.
    """
    phase = np.arange(n) / n
    theta = 2.0 * np.pi * phase + scales["phase"]
    rate = scales["gamma0"] * scales["omega"] * np.cos(theta)
    record = samples(index, phase, (index + phase) * 2.0 * np.pi / scales["omega"], rate)
    record["strain"] = scales["gamma0"] * np.sin(theta)
    record["stress_fluid"] = stress(scales["viscosity"] * rate)
    record |= {"stress_" + name: function(theta) for name, function in parts.items()}
    return record | frames(record, np.zeros((4, 3)) if unwrapped is None else unwrapped)


def steady_record(index: int, scales: dict, hydrodynamic: np.ndarray, sign: float = 1.0) -> dict:
    """A block of unit strain at the rate `sign` x scales["rate"]; the interparticle stress is zero."""
    n = len(hydrodynamic)
    phase, rate = np.arange(n) / n, np.full(n, sign * scales["rate"])
    record = samples(index, phase, (index + phase) / scales["rate"], rate)
    record["strain"] = rate * record["time"]
    record["stress_fluid"] = stress(scales["viscosity"] * rate)
    record |= {"stress_hydrodynamic": hydrodynamic, "stress_interparticle": np.zeros((n, 6))}
    return record | frames(record, np.zeros((4, 3)))


def samples(index: int, phase, time, rate) -> dict:
    """The part of a record that is the same in all flows."""
    return {"index": index, "complete": True, "time": time, "rate": rate, "phase": phase}


def frames(record: dict, unwrapped: np.ndarray) -> dict:
    """One frame at the start of a cycle, and solver statistics."""
    image = np.floor(unwrapped / EDGE).astype(np.int32)
    return {
        "frame_time": record["time"][:1],
        "frame_strain": record["strain"][:1],
        "frame_phase": np.zeros(1),
        "tilt": np.zeros(1),
        "position": (unwrapped - image * EDGE)[None],
        "image": image[None],
        "unwrapped": unwrapped[None],
        "statistics": {"evaluations": 100, "minimum_gap": 1e-3 / (record["index"] + 1), "overlaps": 0},
    }


def write_run(path: Path, config: str, records: list[dict], final: np.ndarray | None = None) -> Path:
    """Store the records with the program's own writer; `final` (N, 3): positions at the end, run finished."""
    number = records[0]["unwrapped"].shape[1] if records else 4
    with RunStore.create(path, config, {"number": number, "L": EDGE, "radius": 1.0}) as store:
        for record in records:
            store.append_cycle(record)
            store.save({"positions": record["unwrapped"][0]})
        if final is not None:
            last = records[-1]
            end = frames(last, final)
            end |= {"frame_time": last["time"][-1:] + 1e-3}
            store.finish({"positions": final}, end)
    return path
