#!/usr/bin/env bash
# freud: the grid of GaussianDensity in a tilted cell is one of x, y, z over (L, L, L), not of the cell's own axes, so a
# Fourier transform of it is no S(q) of the sheared cell. Read as x, y, z it is wrong as well, by more than half of the
# peak in places. In the cube it agrees with brute force over images to single precision.
. "$(dirname "$0")/common.bash"
install freud-analysis==3.4.0 numpy==2.4.6
measure <<'END'
import itertools

import freud
import numpy as np
from finding import as_found, sheared_cell, versions

versions("freud-analysis", "numpy")
EDGE, WIDTH, REACH, SIGMA = 10.0, 40, 3.0, 0.6
fractions = np.random.default_rng(1).random((5, 3)) - 0.5
mids = (np.arange(WIDTH) + 0.5) / WIDTH - 0.5
grid = np.stack(np.meshgrid(mids, mids, mids, indexing="ij"), axis=-1)


def density(points, x, cell):
    total = np.zeros(points.shape[:-1])
    for sphere, n in itertools.product(x, itertools.product((-2, -1, 0, 1, 2), (-1, 0, 1), (-1, 0, 1))):
        square = ((points - sphere - np.array(n) @ cell) ** 2).sum(-1)
        total += np.where(square < REACH**2, np.exp(-square / (2 * SIGMA**2)), 0.0)
    return total / (2 * np.pi * SIGMA**2) ** 1.5


errors = {}
for tilt in (0.0, 0.5, -0.5):
    cell = sheared_cell(EDGE, tilt)
    x = fractions @ cell
    found = freud.density.GaussianDensity(WIDTH, REACH, SIGMA).compute((freud.box.Box(*3 * [EDGE], tilt, 0, 0), x)).density
    peak = found.max()
    errors[tilt] = [np.abs(found - density(points, x, cell)).max() / peak for points in (grid @ cell, grid * EDGE)]
    print(f"tilt {tilt:4}: largest error / peak, grid read along the cell's axes {errors[tilt][0]:.2g}, "
          f"read as x, y, z {errors[tilt][1]:.2g}")
as_found("right in the cube", max(errors[0.0]) < 1e-5)
as_found("wrong along the cell's axes under tilt", min(errors[0.5][0], errors[-0.5][0]) > 0.5)
as_found("nearer as x, y, z, and not right either", all(0.05 < errors[s][1] < errors[s][0] for s in (0.5, -0.5)))
END
