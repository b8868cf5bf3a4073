"""The sheared periodic cell in kernels."""

from __future__ import annotations

import math

from suspend.core.jit import kernel


@kernel
def wrap_and_count(position, image, edge, tilt):
    """Move every sphere into the cell and count the cell vectors removed in `image` (both in place).

    position (N, 3) float64, image (N, 3) int32; position + image . cell vectors is unchanged.
    """
    for i in range(position.shape[0]):
        n2 = math.floor(position[i, 1] / edge)
        n1 = math.floor((position[i, 0] - tilt * position[i, 1]) / edge)
        n3 = math.floor(position[i, 2] / edge)
        position[i, 0] -= edge * (n1 + tilt * n2)
        position[i, 1] -= edge * n2
        position[i, 2] -= edge * n3
        image[i, 0] += n1
        image[i, 1] += n2
        image[i, 2] += n3
