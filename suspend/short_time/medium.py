"""Long waves of the mobility: those of force- and torque-loaded spheres in a uniform medium of viscosity eta.

    z . W z = (6 pi/V eta) sum over 0 < |k| <= K of |(1 - kk/k^2) f(k)|^2 / k^2
    f(k) = sum_j e^{-i k.x_j} [j0(k) F_j + (i/2) s1(k) k x T_j],    j0 = sin k/k, s1 = 3 (sin k - k cos k)/k^3

It is the wave sum of the periodic mobility with Faxen's factors, cut off at K, for eta0 -> eta. A quadratic form
with a known trace, close to the mobility of the suspension in what spheres far apart do to each other.
"""

from __future__ import annotations

import math

import numpy as np

from suspend.box import cell_vectors

CUTOFF = math.pi  # K, 1/radii: the first zero of j0
LARGEST_WORK = 5 * 10**7  # wave vectors times spheres; the cutoff is lowered where it would be more
BLOCK = 256  # wave vectors at a time


class Medium:
    """Waves in a medium between spheres at `position` (N, 3) in a cell of `edge` and `tilt` (radii)."""

    def __init__(self, position: np.ndarray, edge: float, tilt: float, viscosity: float):
        self.position = position
        number, volume = len(position), edge**3
        affordable = (12.0 * math.pi**2 * LARGEST_WORK / (number * volume)) ** (1.0 / 3.0)
        self.waves = half_space_waves(edge, tilt, min(CUTOFF, affordable))
        k2 = np.einsum("ka,ka->k", self.waves, self.waves)
        k = np.sqrt(k2)
        scale = np.sqrt(2.0 * 6.0 * math.pi / (volume * viscosity * k2))  # 2: for k and -k
        self._force = scale * np.sin(k) / k
        self._torque = scale * 0.5 * 3.0 * (np.sin(k) - k * np.cos(k)) / (k2 * k)
        self._k2 = k2
        # Traces: a sphere's own |(1 - kk/k^2) f|^2 sums to 2 over unit forces, to 2 k^2 over unit torques.
        self.traces = 2.0 * number * np.array([np.sum(self._force**2), np.sum(self._torque**2 * k2)])

    def forms(self, loads: np.ndarray) -> np.ndarray:
        """F . (W z)_F and T . (W z)_T of loads z (p, N, 6) = [F, T]; shape (p, 2). They share the cross term."""
        probes, number, _ = loads.shape
        flat = loads.transpose(1, 0, 2).reshape(number, 6 * probes)
        result = np.zeros((probes, 2))
        for first in range(0, len(self.waves), BLOCK):
            part = slice(first, first + BLOCK)
            waves = self.waves[part]
            phases = np.exp(-1j * (waves @ self.position.T))
            sums = (phases @ flat).reshape(len(waves), probes, 6)
            force = self._force[part, None, None] * self._transverse(sums[:, :, :3], part)
            turned = np.cross(waves[:, None, :], sums[:, :, 3:])
            torque = 1j * self._torque[part, None, None] * turned
            cross = np.real(np.einsum("kpa,kpa->p", force.conj(), torque))
            result[:, 0] += np.einsum("kpa,kpa->p", force.conj(), force).real + cross
            result[:, 1] += np.einsum("kpa,kpa->p", torque.conj(), torque).real + cross
        return result

    def _transverse(self, vectors: np.ndarray, part: slice) -> np.ndarray:
        waves = self.waves[part]
        along = np.einsum("ka,kpa->kp", waves, vectors) / self._k2[part, None]
        return vectors - along[:, :, None] * waves[:, None, :]


def half_space_waves(edge: float, tilt: float, largest: float) -> np.ndarray:
    """Reciprocal vectors (m, 3) of the sheared cell with 0 < |k| <= largest, one of each pair k, -k."""
    reciprocal = 2.0 * math.pi * np.linalg.inv(cell_vectors(edge, tilt)).T  # rows
    reach = np.floor(largest * np.linalg.norm(cell_vectors(edge, tilt), axis=1) / (2.0 * math.pi)).astype(int)
    axes = [np.arange(-n, n + 1) for n in reach]
    n = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)
    upper = (n[:, 2] > 0) | ((n[:, 2] == 0) & ((n[:, 1] > 0) | ((n[:, 1] == 0) & (n[:, 0] > 0))))
    waves = n[upper] @ reciprocal
    return waves[np.einsum("ka,ka->k", waves, waves) <= largest**2]
