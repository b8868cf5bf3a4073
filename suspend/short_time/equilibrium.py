"""Scenes of random packings (`suspend.packing`), and the structure factor of their longest waves."""

from __future__ import annotations

import math

import numpy as np

from suspend.oneshot.scene import PeriodicScene
from suspend.packing import PACKINGS
from suspend.short_time.medium import half_space_waves

WAVES = 9  # the longest: of edges and face diagonals of a cube


def packed_scene(
    kind: str, number: int, volume_fraction: float, seed: int, minimum_gap: float = 0.0
) -> PeriodicScene:
    """One packing of hard spheres, surface gaps >= minimum_gap (radii); kind "equilibrium" or "quenched".

    The same seed gives the same bits. Raises what `suspend.packing.random_packing` raises.
    """
    packing = PACKINGS[kind](number, volume_fraction, minimum_gap, seed)
    return PeriodicScene(packing.positions, packing.length)


def long_wave_structure(scene: PeriodicScene) -> float:
    """S(k) = |sum_j e^{-i k.x_j}|^2 / N, mean over the nine longest waves of the cell; near S(0) in a fluid."""
    waves = half_space_waves(scene.edge, scene.reduced_tilt, 2.0 * math.pi / scene.edge * 2.3)
    order = np.argsort(np.einsum("ka,ka->k", waves, waves), kind="stable")[:WAVES]
    sums = np.exp(-1j * (waves[order] @ scene.wrapped().T)).sum(axis=1)
    return float(np.mean(np.abs(sums) ** 2) / scene.number)
