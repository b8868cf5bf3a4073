"""Equilibrium fluids of hard spheres: random packings in which the long density waves have relaxed, too.

`suspend.packing` stirs until every sphere has travelled a diameter: enough for the structure near contact, too
little for density waves as long as the cell, which keep some of the scatter of the random points they began as,
S = 1 instead of S(0) (at phi <= 0.2 S was found two times too large). Sedimentation depends on them. A density wave
decays like exp(-D k^2 t/S(k)), its share in S twice as fast, while a sphere travels sqrt(6 D t).
"""

from __future__ import annotations

import math

import numpy as np

from suspend.core.packing_kernels import metropolis
from suspend.oneshot.scene import PeriodicScene
from suspend.packing import FREEZING, ROUNDING, random_packing, spatial_order
from suspend.short_time.literature import structure_factor_at_zero
from suspend.short_time.medium import half_space_waves

DECAY = 2.0  # exponents by which the longest wave decays: its excess in S falls to 2 %
BLOCK = 20  # sweeps between adjustments of the trial step
WAVES = 9  # the longest: of edges and face diagonals of a cube


def equilibrium_scene(number: int, volume_fraction: float, seed: int, minimum_gap: float = 0.0) -> PeriodicScene:
    """One configuration of the hard-sphere fluid, surface gaps >= minimum_gap (radii).

    At equilibrium up to phi = 0.494; above, the glass that `suspend.packing.random_packing` makes. The same seed
    gives the same bits. Raises what `random_packing` raises.
    """
    packing = random_packing(number, volume_fraction, minimum_gap, seed)
    position, edge = packing.positions, packing.length
    effective = packing.effective_volume_fraction
    if effective <= FREEZING:
        target = needed_travel(effective, edge)
        if target > packing.rms_travel:
            position = _stir(position, edge, (2.0 + minimum_gap) * (1.0 + ROUNDING), target, seed)
    return PeriodicScene(position, edge)


def needed_travel(volume_fraction: float, edge: float) -> float:
    """Rms displacement of a sphere in which the longest wave decays by `DECAY`: sqrt(6 DECAY S(0)) L/2 pi."""
    return math.sqrt(6.0 * DECAY * structure_factor_at_zero(volume_fraction)) * edge / (2.0 * math.pi)


def _stir(position: np.ndarray, edge: float, diameter: float, target: float, seed: int) -> np.ndarray:
    """Positions after Metropolis sweeps in which the spheres travel `target` (rms)."""
    position = position.copy()
    travel = np.zeros_like(position)
    state = np.random.SeedSequence([seed, 2]).generate_state(1, np.uint64)
    step = 0.1
    while np.mean(np.sum(travel**2, axis=1)) < target**2:
        accepted = metropolis(position, travel, edge, diameter, step, BLOCK, state)
        step = min(step * min(1.5, max(0.5, (accepted + 0.05) / 0.35)), 0.5 * edge)  # towards 30 % acceptance
    return np.ascontiguousarray(position[spatial_order(position, edge)])


def long_wave_structure(scene: PeriodicScene) -> float:
    """S(k) = |sum_j e^{-i k.x_j}|^2 / N, mean over the nine longest waves of the cell; near S(0) in a fluid."""
    waves = half_space_waves(scene.edge, scene.reduced_tilt, 2.0 * math.pi / scene.edge * 2.3)
    order = np.argsort(np.einsum("ka,ka->k", waves, waves), kind="stable")[:WAVES]
    sums = np.exp(-1j * (waves[order] @ scene.wrapped().T)).sum(axis=1)
    return float(np.mean(np.abs(sums) ** 2) / scene.number)
