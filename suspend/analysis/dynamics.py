"""Irreversible displacement from cycle to cycle: the per-cycle self-diffusivity D_cyc."""

from __future__ import annotations

from collections.abc import Iterable, Iterator

import numpy as np


def mean_square_displacement(before: np.ndarray, after: np.ndarray, radius: float = 1.0) -> np.ndarray:
    """<(Delta_alpha/a)^2> (3,) along x, y, z over all spheres, relative to the displacement of their centre.

    before, after (N, 3): unwrapped positions at equal strain, in the units of `radius`, so that the flow
    itself displaces nothing. The mean displacement is removed: it moves the suspension as a whole
    (sedimentation under an external force, and the displacement along x that follows a shift along y), which
    mixes nothing. For N independent walkers this lowers the mean by the factor 1 - 1/N, which is not
    corrected. NaN for fewer than two spheres: one sphere has no motion relative to itself.
    """
    before, after = np.asarray(before, float), np.asarray(after, float)
    if before.shape != after.shape or before.ndim != 2 or before.shape[1] != 3:
        raise ValueError(f"positions of shapes {before.shape} and {after.shape}, expected (N, 3) twice")
    if len(before) < 2:
        return np.full(3, np.nan)
    displacement = (after - before) / radius
    displacement -= displacement.mean(axis=0)
    return np.mean(displacement**2, axis=0)


def cyclic_diffusivity(before: np.ndarray, after: np.ndarray, gamma0: float, radius: float = 1.0) -> float:
    """D_cyc of one cycle, <(Delta_i/a)^2> = 2 D_cyc 4 gamma0: per unit of accumulated strain, dimensionless.

    before, after: see `mean_square_displacement`, one full cycle apart. NaN for fewer than two spheres.
    """
    return float(mean_square_displacement(before, after, radius).sum() / (8.0 * gamma0))


def cyclic_diffusivities(starts: Iterable[np.ndarray], gamma0: float, radius: float = 1.0) -> Iterator[float]:
    """D_cyc of each cycle, from unwrapped positions (N, 3) at consecutive cycle starts and the end.

    Streams: at most two frames are held at a time. K frames give K - 1 values.
    """
    before = None
    for after in starts:
        if before is not None:
            yield cyclic_diffusivity(before, after, gamma0, radius)
        before = after
