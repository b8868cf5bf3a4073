"""Made-up cycles for the tests of the files: every number depends on the seed and the cycle alone."""

from __future__ import annotations

import numpy as np

CONFIG = "seed: 7\nflow:\n  type: oscillatory\n  amplitude: 0.8\nduration:\n  cycles: 4\n"
META = {
    "number": 5,
    "radius": 1.0,
    "L": 7.1 / 3.0,
    "viscosity": 1e-3,
    "omega": None,
    "seed": 7,
    "threads": 2,
    "created": "2024-01-01T00:00:00Z",
    "versions": {"suspend": "0.1.0", "python": "3.11"},
}


def record(
    cycle: int, number: int = 5, n: int = 8, frames: int = 2, *, complete: bool = True, **extra
) -> dict:
    """A record with random bits; `particle_stress=True` and `flow_driven=True` add the optional series."""
    random = np.random.default_rng([11, cycle, n])
    phase = np.arange(n) / n
    made = {
        "index": cycle,
        "complete": complete,
        "time": cycle + phase,
        "strain": np.sin(2 * np.pi * phase),
        "rate": np.cos(2 * np.pi * phase),
        "phase": phase,
    }
    for name in ("fluid", "hydrodynamic", "interparticle") + (
        ("flow_driven",) if extra.get("flow_driven") else ()
    ):
        made["stress_" + name] = random.normal(size=(n, 6))
    if extra.get("particle_stress"):
        made["particle_stress"] = random.normal(size=(n, number, 6))
    frame_phase = np.arange(frames) / frames
    made |= {
        "frame_time": cycle + frame_phase,
        "frame_strain": random.normal(size=frames),
        "frame_phase": frame_phase,
        "tilt": random.uniform(-0.5, 0.5, frames),
        "position": random.random((frames, number, 3)),
        "image": random.integers(-3, 3, (frames, number, 3), dtype=np.int32),
        "unwrapped": random.normal(size=(frames, number, 3)),
        "statistics": {
            "evaluations": int(random.integers(100, 999)),
            "minimum_gap": float(random.random() * 1e-3),
            "overlaps": 0,
            "wall_time": float(random.random()),
        },
    }
    return made


def final_frame(cycles: int, number: int = 5) -> dict:
    """The frame behind the last of `cycles` complete cycles: the first one of the next cycle."""
    following = record(cycles, number)
    names = ("frame_time", "frame_strain", "tilt", "position", "image", "unwrapped")
    return {name: following[name][:1] for name in names}


def state(cycle: int, number: int = 5) -> dict:
    """A solver state after `cycle` cycles: arrays, awkward scalars, nesting."""
    random = np.random.default_rng([13, cycle])
    return {
        "positions": random.normal(size=(number, 3)),
        "pairs": random.integers(0, number, (7, 2), dtype=np.int32),
        "empty": np.empty((0, 3)),
        "controller": {"step": 0.1 + 0.2, "last_error": float("nan"), "stage": None, "first": True},
        "bits": 2**127 + cycle,
        "cycle": cycle,
    }


def assert_same(a: dict, b: dict) -> None:
    """Equal keys, types, shapes and bits, nested."""
    assert set(a) == set(b)
    for key, value in a.items():
        if isinstance(value, dict):
            assert_same(value, b[key])
        elif isinstance(value, np.ndarray):
            assert value.dtype == b[key].dtype and value.shape == b[key].shape, key
            assert value.tobytes() == b[key].tobytes(), key
        else:
            assert type(value) is type(b[key]) and (value == b[key] or value != value), key
