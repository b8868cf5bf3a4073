"""Radial distribution function g(r) and its section by the shear plane."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from scipy.ndimage import gaussian_filter1d
from scipy.signal import find_peaks

from suspend.analysis.microstructure.snapshot import LAST, FrameQuantity, Frames, Snapshot
from suspend.errors import ConfigurationError

REACH = 10.0  # of the pairs that are looked at, in radii; L/2 where that is less
CENTRES = 4000  # at most so many spheres per frame are centres; all others are their neighbours
_SMOOTHING = 0.1  # radii: width of the Gaussian with which the peaks are looked for
_PEAK_DISTANCE = 1.2  # radii: nearer maxima are one (split) peak


def pair_reach(snapshot: Snapshot, reach: float | None) -> float:
    """`reach`, by default the smaller of 10 a and L/2; beyond L/2 the periodic images would be counted."""
    half = 0.5 * snapshot.length
    if reach is not None and reach > half * (1.0 + 1e-12):
        raise ConfigurationError(
            f"pairs up to {reach:g} a were asked for, beyond half the edge of the cell {half:.4g} a"
        )
    return min(REACH, half) if reach is None else reach


class PairDistribution(FrameQuantity):
    """g(r) = counted pairs / pairs of an ideal gas of N spheres, averaged over frames and directions.

    `reach`: largest r in radii (default: the smaller of 10 and L/2, the largest distance at which no pair is
    met twice in any cell of tilt <= 1/2); `width` of the bins in radii; `centres`: at most so many random
    spheres per frame are taken as centres (unbiased, only noisier).
    """

    def __init__(
        self, frames: Frames = LAST, reach: float | None = None, width: float = 0.05, centres: int | None = CENTRES
    ):
        self.frames, self.width, self.centres, self._wanted_reach = frames, width, centres, reach

    def begin(self) -> None:
        """Forget earlier results."""
        self._counts, self._edges, self._ideal, self._frames, self._number, self._density = None, None, 0.0, 0, 0, 0.0

    def add(self, snapshot: Snapshot) -> None:
        """Count the pairs of one configuration."""
        reach = pair_reach(snapshot, self._wanted_reach)
        if self._edges is None:
            bins = int(round(reach / self.width, 9))
            self._edges, self._counts = self.width * np.arange(bins + 1), np.zeros(bins)
            self._number, self._density = snapshot.number, snapshot.density
        pairs, centres = snapshot.pairs(reach, self.centres)
        self._counts += np.histogram(pairs.distance, self._edges)[0]
        shells = 4.0 * math.pi / 3.0 * np.diff(self._edges**3)
        self._ideal = self._ideal + centres * (snapshot.number - 1) / snapshot.length**3 * shells
        self._frames += 1

    @property
    def r(self) -> np.ndarray:
        """Middles of the bins, in radii."""
        return 0.5 * (self._edges[1:] + self._edges[:-1])

    @property
    def g(self) -> np.ndarray:
        """Radial distribution function, dimensionless; NaN where N = 1."""
        with np.errstate(invalid="ignore", divide="ignore"):
            return self._counts / self._ideal

    @property
    def error(self) -> np.ndarray:
        """Counting error of g as if all frames showed the same pairs (true for absorbing states), a pair seen
        from both ends counted once: an upper bound where the frames differ."""
        return np.sqrt(2.0 * self._counts * self._frames) / self._ideal

    @property
    def coordination(self) -> np.ndarray:
        """Mean number of neighbours closer than the upper edge of each bin."""
        shells = 4.0 * math.pi / 3.0 * np.diff(self._edges**3)
        density = (self._number - 1) / self._number * self._density
        return np.cumsum(self.g * shells) * density

    @property
    def edges(self) -> np.ndarray:
        """Edges of the bins, in radii."""
        return self._edges

    @property
    def peaks(self) -> np.ndarray:
        """Distances of the first three peaks in radii; NaN for those that do not stand out of the noise."""
        return peaks_of(self.r, self.g, self.error, self.width)

    def table(self) -> dict[str, np.ndarray]:
        """r, g, its error, number of neighbours closer than the bin's end."""
        return {"r[a]": self.r, "g[-]": self.g, "g_error[-]": self.error, "neighbours_within[-]": self.coordination}

    def plot(self, ax) -> None:
        """g against r."""
        ax.step(self.r, self.g, where="mid")
        ax.axhline(1.0, color="0.7", linewidth=0.8, zorder=0)
        ax.set(xlabel=r"$r/a$", ylabel=r"$g(r)$", ylim=(0.0, None))

    def summary(self) -> dict[str, Any]:
        """Peaks and the height of the first one."""
        peaks = {f"g_peak{i + 1}[a]": float(value) for i, value in enumerate(self.peaks)}
        return {**peaks, "g_max[-]": float(np.max(self.g, initial=0.0)), "g_frames": self._frames}


def peaks_of(r: np.ndarray, g: np.ndarray, error: np.ndarray, width: float, count: int = 3) -> np.ndarray:
    """The first `count` maxima of g (n,) smoothed over 0.1 a, at least 1.2 a apart; NaN where there are fewer.

    A peak has to stand out by three times the error that the smoothing leaves. The first, narrow one is taken
    from the histogram itself, within 0.2 a.
    """
    found = np.full(count, np.nan)
    if len(g) < 5 or not np.isfinite(g).all():
        return found
    spread = max(_SMOOTHING / width, 1e-3)
    smooth = gaussian_filter1d(g, spread, mode="nearest")
    left = (
        np.median(error[g > 0.0]) / math.sqrt(max(1.0, 2.0 * math.sqrt(math.pi) * spread)) if (g > 0.0).any() else 0.0
    )
    tops, _ = find_peaks(smooth, distance=max(1.0, _PEAK_DISTANCE / width), prominence=max(3.0 * left, 1e-6))
    found[: len(tops[:count])] = r[tops[:count]]
    if len(tops):
        near = np.flatnonzero(np.abs(r - r[tops[0]]) <= 0.2 + 1e-9)
        found[0] = r[near[np.argmax(g[near])]]
    return found


class ShearPlaneDistribution(FrameQuantity):
    """g(x, y) of the pairs whose separation along z is less than `slab` radii: the section by the shear plane.

    `reach`: largest |x| and |y|; `width` of the square bins; both in radii.
    """

    def __init__(
        self, frames: Frames = LAST, reach: float = 6.0, width: float = 0.2, slab: float = 0.5, centres=CENTRES
    ):
        self.frames, self.width, self.slab, self.centres, self._wanted_reach = frames, width, slab, centres, reach

    def begin(self) -> None:
        """Forget earlier results."""
        self._counts, self._edges, self._ideal = None, None, 0.0

    def add(self, snapshot: Snapshot) -> None:
        """Count the pairs of one configuration."""
        whole = pair_reach(snapshot, None)
        if self._edges is None:
            # the square's corner must lie within the reach of the pairs
            side = min(self._wanted_reach, math.sqrt(max(whole**2 - self.slab**2, 0.0) / 2.0))
            half = int(round(side / self.width, 9))
            self._edges = self.width * np.arange(-half, half + 1)
            self._counts = np.zeros((2 * half, 2 * half))
        pairs, centres = snapshot.pairs(whole, self.centres)
        near = np.abs(pairs.vector[:, 2]) < self.slab
        x, y = pairs.vector[near, 0], pairs.vector[near, 1]
        self._counts += np.histogram2d(x, y, (self._edges, self._edges))[0]
        volume = self.width**2 * 2.0 * self.slab
        self._ideal += centres * (snapshot.number - 1) / snapshot.length**3 * volume

    @property
    def x(self) -> np.ndarray:
        """Middles of the bins along the flow (and along the gradient), in radii."""
        return 0.5 * (self._edges[1:] + self._edges[:-1])

    @property
    def g(self) -> np.ndarray:
        """g(x, y), first index along the flow, second along the gradient."""
        with np.errstate(invalid="ignore", divide="ignore"):
            return self._counts / self._ideal

    def table(self) -> dict[str, np.ndarray]:
        """x, y, g of every bin."""
        x, y = np.meshgrid(self.x, self.x, indexing="ij")
        return {"x[a]": x.ravel(), "y[a]": y.ravel(), "g[-]": self.g.ravel()}

    def plot(self, ax) -> None:
        """Map with the flow to the right and its gradient upwards."""
        top = max(float(np.quantile(self.g[self.g > 0.0], 0.98)), 1.0) if (self.g > 0.0).any() else 1.0
        image = ax.pcolormesh(self._edges, self._edges, self.g.T, vmin=0.0, vmax=top, cmap="cividis", rasterized=True)
        ax.figure.colorbar(image, ax=ax, label=r"$g(x, y)$")
        ax.set(xlabel=r"$x/a$ (flow)", ylabel=r"$y/a$ (gradient)", aspect="equal")
