"""Cutting the spheres into runs of equal work, one a thread."""

from __future__ import annotations

import numpy as np


def split_rows(offset: np.ndarray, parts: int) -> np.ndarray:
    """Cut the spheres into `parts` runs with about the same number of pairs: (parts + 1,) bounds."""
    number = offset.shape[0] - 1
    work = offset + np.arange(number + 1)
    bounds = np.searchsorted(work, work[-1] * np.arange(parts + 1) / parts)
    bounds[0], bounds[-1] = 0, number
    return bounds.astype(np.int64)
