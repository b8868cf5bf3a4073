"""Stored runs for the figures: known stresses, a perturbed lattice that diffuses, frames within cycles."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from synthetic_runs import EDGE, oscillatory_record, stress, write_run

from suspend.config import from_dict

VISCOSITY, OMEGA = 2.0, 1.0
SIDE = 5  # spheres along an edge of the lattice
NUMBER = SIDE**3


def eta_r(gamma0: float, phi: float) -> float:
    """Relative viscosity given to the run, smallest at gamma0 = 1."""
    return 2.0 + 5.0 * phi + (gamma0 - 1.0) ** 2


def thinning(gamma0: float) -> float:
    """-eta_3'/eta_1' given to the run, largest at gamma0 = 0.8."""
    return 0.05 - 0.1 * (gamma0 - 0.8) ** 2


def minus_nu0(gamma0: float) -> float:
    """-nu_0/eta0 given to the run, with its onset at 0.9."""
    return max(0.0, gamma0 - 0.9)


def doubling(gamma0: float) -> float:
    """|nu_4|/|nu_2| given to the run."""
    return 0.1 / (0.01 + abs(gamma0 - 0.8))


def lattice(random: np.random.Generator) -> np.ndarray:
    """A simple cubic lattice that fills the cell, every sphere shifted a little."""
    grid = np.stack(np.meshgrid(*(np.arange(SIDE),) * 3, indexing="ij"), axis=-1).reshape(-1, 3)
    return EDGE / SIDE * (grid + 0.5) + 0.3 * random.normal(size=(NUMBER, 3))


def make_run(path: Path, gamma0: float, phi: float = 0.4, seed: int = 1, cycles: int = 6, **more) -> Path:
    """A finished run; `phases`: where positions are stored; `particle_stress`: also the stress of every sphere."""
    phases = np.array(more.pop("phases", (0.0, 0.5)))
    with_stress = more.pop("particle_stress", False)
    random = np.random.default_rng([seed, int(1000 * gamma0)])
    scales = {"gamma0": gamma0, "omega": OMEGA, "viscosity": VISCOSITY, "phase": 0.0}
    unit = VISCOSITY * gamma0 * OMEGA

    def hydrodynamic(theta):
        first = eta_r(gamma0, phi)
        shear = (first - 1.0) * np.cos(theta) - first * thinning(gamma0) * np.cos(3.0 * theta)
        n2 = 0.1 / doubling(gamma0) * np.cos(2.0 * theta) + 0.1 * np.cos(4.0 * theta)
        return unit * stress(shear, -0.1 + 0.3 * np.cos(2.0 * theta), n2, 0.0)

    def interparticle(theta):
        return unit * stress(0.0 * theta, 0.0, np.full(len(theta), -minus_nu0(gamma0)), 0.0)

    parts = {"hydrodynamic": hydrodynamic, "interparticle": interparticle}
    start, records = lattice(random), []
    for k in range(cycles):
        record = oscillatory_record(k, scales, parts, 32, start)
        add_frames(record, gamma0, start, phases, random)
        if with_stress:
            bulk = record["stress_hydrodynamic"] + record["stress_interparticle"]
            share = random.dirichlet(np.full(NUMBER, 5.0))
            record["particle_stress"] = bulk[:, None, :] * share[None, :, None]
        records.append(record)
        start = start + 0.05 * gamma0 * random.normal(size=start.shape)
    tree = {
        "seed": seed,
        "particles": {"number": NUMBER, "volume_fraction": phi},
        "fluid": {"viscosity": VISCOSITY},
        "flow": {"type": "oscillatory", "amplitude": gamma0},
        "duration": {"cycles": cycles},
    }
    return write_run(path, from_dict(tree | more).to_yaml(), records, start)


def add_frames(record: dict, gamma0: float, start: np.ndarray, phases: np.ndarray, random) -> None:
    """Frames at the phases: the spheres move with the flow and, within the cycle, a little at random."""
    strain = gamma0 * np.sin(2.0 * np.pi * phases)
    unwrapped = np.stack([start + 0.02 * (p > 0.0) * random.normal(size=start.shape) for p in phases])
    unwrapped[:, :, 0] += strain[:, None] * unwrapped[:, :, 1]
    tilt = (strain + 0.5) % 1.0 - 0.5
    image = np.zeros(unwrapped.shape, np.int32)
    image[..., 1:] = np.floor(unwrapped[..., 1:] / EDGE)
    x = unwrapped[..., 0] - tilt[:, None] * unwrapped[..., 1]
    image[..., 0] = np.floor(x / EDGE)
    position = unwrapped - EDGE * image
    position[..., 0] -= tilt[:, None] * EDGE * image[..., 1]
    record |= {
        "frame_time": (record["index"] + phases) * 2.0 * np.pi / OMEGA,
        "frame_strain": strain,
        "frame_phase": phases,
        "tilt": tilt,
        "position": position,
        "image": image,
        "unwrapped": unwrapped,
    }
