"""Wave part of the far-field mobility: spreading, fast Fourier transforms, scaling, interpolation.

    u_hat(k) = (6 pi/V) W(k)/k^2 (I - kk/k^2) f_hat(k), k != 0,
    f_hat(k) = sum_j e^{-ik.x_j} [F_q (1 - k^2/15) - i k_p C_qp],

and [U; Omega; E] by the conjugate functional, so that the operator is symmetric and positive semidefinite to
round-off on any grid. Spectral Ewald method (Lindbo & Tornberg 2011), here with windows that follow the sheared
lattice and with force, torque and stresslet in the same three components.

The transforms leave out lines of modes beyond kmax: along axis 1 for all rows of a slab of planes, along axis 2
only for n1 <= n1max, along axis 3 only for |n2| <= n2max as well.
"""

from __future__ import annotations

import itertools
import math
from concurrent.futures import ThreadPoolExecutor

import numba
import numpy as np
import pyfftw

from suspend.core.grid import (
    Stencil,
    apply_modes,
    blocks,
    close_rows,
    gather_rows,
    locate_rows,
    open_rows,
    scale_modes,
    sort_by_block,
    spread_planes,
    weight_rows,
)
from suspend.core.jit import parallel_kernel
from suspend.core.lanes import LANES_4, LANES_8
from suspend.errors import ConfigurationError
from suspend.hydro.ewald.split import Split
from suspend.hydro.ewald.windows import Window, largest_modes

SLAB_BYTES = 1 << 18  # of real grid in one transform: what stays in the cache between axes 1 and 2


@parallel_kernel
def _locate(cuts, position, edge, tilt, shape, support, base, fraction):
    for t in numba.prange(cuts.shape[0] - 1):
        locate_rows(cuts[t], cuts[t + 1], position, edge, tilt, shape, support, base, fraction)


@parallel_kernel
def _weigh(cuts, base, fraction, scale, polynomials, stencil, lanes):
    for t in numba.prange(cuts.shape[0] - 1):
        weight_rows(cuts[t], cuts[t + 1], base, fraction, scale, polynomials, stencil, lanes)


@parallel_kernel
def _spread(slabs, stencil, loads, tilt, grid, length, support, lanes):
    for t in numba.prange(slabs.shape[0] - 1):
        planes = (slabs[t], slabs[t + 1])
        spread_planes(planes, stencil, loads, tilt, grid, length, support, lanes)
        close_rows(planes, grid, length, support)


@parallel_kernel
def _scale(slabs, table, edge, tilt, inverse2, scaling):
    for t in numba.prange(slabs.shape[0] - 1):
        scale_modes((slabs[t], slabs[t + 1]), table, edge, tilt, inverse2, scaling)


@parallel_kernel
def _apply(slabs, scaling, edge, tilt, modes):
    for t in numba.prange(slabs.shape[0] - 1):
        apply_modes((slabs[t], slabs[t + 1]), scaling, edge, tilt, modes)


@parallel_kernel
def _gather(cuts, slabs, stencil, tilt, grid, length, support, result, lanes):
    for t in numba.prange(slabs.shape[0] - 1):
        open_rows((slabs[t], slabs[t + 1]), grid, length, support)
    for t in numba.prange(cuts.shape[0] - 1):
        gather_rows(cuts[t], cuts[t + 1], stencil, tilt, grid, support, result, lanes)


def _cut(total: int, parts: int) -> np.ndarray:
    return (np.arange(parts + 1) * total // parts).astype(np.int64)


class _Transforms:
    """Planned transforms between `grid` (real space) and `modes` (M3, M2, 3, n1max + 1).

    Planned with FFTW_ESTIMATE, which always chooses the same plan, and in pieces that do not depend on the
    number of threads, so that results are the same bit for bit.
    """

    def __init__(self, shape: tuple[int, int, int], row: int, largest: tuple[int, int, int], threads: int):
        m1, m2, m3 = shape
        n1, n2, _ = largest
        self.grid = pyfftw.zeros_aligned((m3, m2, 3, row))
        self.half = pyfftw.zeros_aligned((m3, m2, 3, m1 // 2 + 1), dtype="complex128")
        self.modes = pyfftw.zeros_aligned((m3, m2, 3, n1 + 1), dtype="complex128")
        self.idle = self.half[..., n1 + 1 :]
        step = max(1, SLAB_BYTES // (24 * m2 * row))
        self.slabs = [slice(z, min(z + step, m3)) for z in range(0, m3, step)]
        self.forward, self.backward = [], []
        for slab in self.slabs:
            real, half = self.grid[slab, :, :, :m1], self.half[slab]
            used, modes = self.half[slab, :, :, : n1 + 1], self.modes[slab]
            self.forward.append((self._plan(real, half, 3), self._plan(used, modes, 1)))
            self.backward.append((self._plan(modes, used, 1, False), self._plan(half, real, 3, False)))
        columns = [(y, min(y + 4, n2 + 1)) for y in range(0, n2 + 1, 4)]
        columns += [(y, min(y + 4, m2)) for y in range(m2 - n2, m2, 4)]
        self.along = [[self._plan(self.modes[:, a:b], self.modes[:, a:b], 0, way) for a, b in columns]
                      for way in (True, False)]  # fmt: skip
        self.threads = threads
        self.pool = ThreadPoolExecutor(threads - 1) if threads > 1 else None

    @staticmethod
    def _plan(source, target, axis, forward=True):
        direction = "FFTW_FORWARD" if forward else "FFTW_BACKWARD"
        flags = ("FFTW_ESTIMATE", "FFTW_DESTROY_INPUT")
        return pyfftw.FFTW(source, target, axes=(axis,), direction=direction, flags=flags, threads=1)

    def _each(self, work, pieces):
        """One run of pieces a thread: handing over every piece by itself costs as much as its transform."""
        cuts = _cut(len(pieces), self.threads)
        runs = [pieces[first:last] for first, last in itertools.pairwise(cuts)]
        others = [self.pool.submit(self._all, work, run) for run in runs[1:]]
        self._all(work, runs[0])
        for other in others:
            other.result()

    @staticmethod
    def _all(work, pieces):
        for piece in pieces:
            work(piece)

    @staticmethod
    def _run(plan):
        plan.execute()

    @staticmethod
    def _run_two(plans):
        plans[0].execute()
        plans[1].execute()

    def _slab_back(self, s):
        self.backward[s][0].execute()
        self.idle[self.slabs[s]] = 0.0  # the forward transform left modes beyond n1max there
        self.backward[s][1].execute()

    def to_modes(self) -> None:
        """Grid -> modes (lines beyond n2max are left without their transform along axis 3)."""
        self._each(self._run_two, self.forward)
        self._each(self._run, self.along[0])

    def to_grid(self) -> None:
        """Modes -> grid, not normalised."""
        self._each(self._run, self.along[1])
        self._each(self._slab_back, range(len(self.slabs)))


class WavePart:
    """Wave part of the mobility of spheres in a sheared periodic cell: `place` first, then `add`.

    Parameters
    ----------
    edge : cell edge L, radii
    split : W(k) and kmax (`suspend.hydro.ewald.split`)
    grid : points (M1, M2, M3) along the lattice vectors; M > 2 n_max and M >= support on each axis
    window : `suspend.hydro.ewald.windows.Window`
    threads : parts the work is cut into; results do not depend on it

    Loads (N, 11) = [F, T, S] on the fluid, results (N, 11) = [U, Omega, E], stresslet and strain rate in the
    basis `FIVE`, units 6 pi eta0 a^n. Memory: 72 bytes a sphere and point of the padded support (576 at P <= 8),
    and 48 + 48 n1max/M1 bytes a grid point.
    """

    def __init__(self, edge: float, split: Split, grid, window: Window, threads: int = 1):
        self.edge, self.split, self.window, self.threads = float(edge), split, window, threads
        self.shape = tuple(int(m) for m in grid)
        self.largest = largest_modes(split.kmax, edge)
        for axis, (m, n) in enumerate(zip(self.shape, self.largest, strict=True)):
            if m < max(2 * n + 1, window.support):
                raise ConfigurationError(
                    f"far_field grid: {m} points along axis {axis + 1}; modes up to {n} and a window of "
                    f"{window.support} points need at least {max(2 * n + 1, window.support)}"
                )
        self.lanes = LANES_4 if window.support <= 4 else LANES_8
        width = len(self.lanes)
        padded = -(-window.support // width) * width
        polynomials = window.polynomials()
        self._polynomials = np.zeros((*polynomials.shape[:2], padded))
        self._polynomials[..., : window.support] = polynomials
        row = -(-(self.shape[0] + padded) // 8) * 8
        self.transforms = _Transforms(self.shape, row, self.largest, threads)
        self.slabs = _cut(self.shape[2], threads)
        self.scaling = np.zeros((self.shape[2], self.shape[1], self.largest[0] + 1))
        self._inverse2 = tuple(self._inverse_transform2(m) for m in self.shape)
        self.tilt = self.stencil = self._cuts = None

    def _inverse_transform2(self, m: int) -> np.ndarray:
        """1/w_hat^2 by element of a transform of size m."""
        return self.window.transform(2.0 * np.pi * np.fft.fftfreq(m)) ** -2.0

    def place(self, position: np.ndarray, tilt: float) -> None:
        """Prepare products at these positions (N, 3), in radii, wrapped or not, and this tilt."""
        number = len(position)
        if self.stencil is None or len(self.stencil.sphere) != number:
            self._allocate(number)
        if tilt != self.tilt:
            _scale(self.slabs, self.split.table, self.edge, tilt, self._inverse2, self.scaling)
            self.tilt = tilt
        base, fraction = self._base, self._fraction
        support = self.window.support
        _locate(self._cuts, position, self.edge, tilt, self.shape, support, base, fraction)
        sort_by_block(base, self.shape, self.stencil.first, self.stencil.sphere)
        scale = tuple(m / self.edge for m in self.shape)
        _weigh(self._cuts, base, fraction, scale, self._polynomials, self.stencil, self.lanes)

    def _allocate(self, number: int) -> None:
        self._cuts = _cut(number, self.threads)
        self._base, self._fraction = np.empty((number, 3), np.int64), np.empty((number, 3))
        self.stencil = Stencil(
            np.empty(number, np.int64),
            np.empty((number, 3), np.int64),
            np.empty((number, 3, 3, self._polynomials.shape[2])),
            np.zeros(math.prod(blocks(self.shape)) + 1, np.int64),
        )

    def add(self, loads: np.ndarray, result: np.ndarray) -> None:
        """result += wave part . loads, both (N, 11), each sphere's own part included."""
        transforms, support, length = self.transforms, self.window.support, self.shape[0]
        grid, tilt = transforms.grid, self.tilt
        _spread(self.slabs, self.stencil, loads, tilt, grid, length, support, self.lanes)
        transforms.to_modes()
        _apply(self.slabs, self.scaling, self.edge, tilt, transforms.modes)
        transforms.to_grid()
        _gather(self._cuts, self.slabs, self.stencil, tilt, grid, length, support, result, self.lanes)
