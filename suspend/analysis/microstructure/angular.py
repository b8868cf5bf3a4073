"""Angular distribution of the neighbours at given distances, on the sphere of directions.

Orientation of the paper: the flow has the same velocity along latitudes, so the pole is the gradient direction
y, and longitude 0 is the flow direction x; longitudes -90 and +90 degrees are +z and -z (right-handed with the
pole up): there separations are perpendicular to the flow.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from suspend.analysis.microstructure.pair_distribution import CENTRES, pair_reach, peaks_of
from suspend.analysis.microstructure.snapshot import LAST, FrameQuantity, Frames, Snapshot
from suspend.errors import ConfigurationError

_RADIAL = 0.05  # radii, width of the distance bins
_LATITUDE = np.deg2rad(15.0)  # the paper's: no neighbours beyond it ...
_RING = np.deg2rad(30.0)  # ... but near longitudes +-90 degrees: taken as nearer than this to that great circle
_FINER = 8  # parts of a cell per direction, for the share of it that lies off the rings


def directions(vector: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Longitude and latitude (P,) in radians of vectors (P,3), oriented as in the module's docstring."""
    length = np.linalg.norm(vector, axis=1)
    latitude = np.arcsin(np.clip(vector[:, 1] / length, -1.0, 1.0))
    return np.arctan2(-vector[:, 2], vector[:, 0]), latitude


class AngularMaps(FrameQuantity):
    """Directions of neighbours at r +- `half_width` relative to an isotropic distribution of as many, on the sphere.

    `radii` (radii of the spheres): by default the first three peaks of g(r) of the same frames. `at` gives the
    map at any other distance within the reach (10 a or L/2), such as that of the initial configuration at the
    peaks of the final one. Cells have equal solid angle: `longitudes` columns x `latitudes` rows of equal
    height in sin(latitude).
    """

    def __init__(
        self,
        frames: Frames = LAST,
        radii=None,
        half_width: float = 0.1,
        longitudes: int = 30,
        latitudes: int = 18,
        centres: int | None = CENTRES,
    ):
        self.frames, self.half_width, self.centres, self._radii = frames, half_width, centres, radii
        self._shape = (longitudes, latitudes)

    def begin(self) -> None:
        """Forget earlier results."""
        self._counts, self._ideal, self._frames = None, 0.0, 0

    def add(self, snapshot: Snapshot) -> None:
        """Count the neighbours of one configuration by distance and direction."""
        reach = pair_reach(snapshot, None)
        if self._counts is None:
            self._edges = _RADIAL * np.arange(int(round(reach / _RADIAL, 9)) + 1)
            self._counts = np.zeros((len(self._edges) - 1, *self._shape))
        pairs, centres = snapshot.pairs(reach, self.centres)
        longitude, latitude = directions(pairs.vector)
        bins = (self._edges, self.longitude_edges, np.sin(self.latitude_edges))
        sample = np.column_stack([pairs.distance, longitude, np.sin(latitude)])
        self._counts += np.histogramdd(sample, bins)[0]
        shells = 4.0 * np.pi / 3.0 * np.diff(self._edges**3)
        self._ideal = self._ideal + centres * (snapshot.number - 1) / snapshot.length**3 * shells
        self._frames += 1

    @property
    def longitude_edges(self) -> np.ndarray:
        """Edges of the columns in radians, -pi to pi."""
        return np.linspace(-np.pi, np.pi, self._shape[0] + 1)

    @property
    def latitude_edges(self) -> np.ndarray:
        """Edges of the rows in radians, -pi/2 to pi/2."""
        return np.arcsin(np.linspace(-1.0, 1.0, self._shape[1] + 1))

    @property
    def radii(self) -> np.ndarray:
        """Distances of the maps in radii; NaN for a peak that does not stand out."""
        if self._radii is not None:
            return np.asarray(self._radii, float)
        counts = self._counts.sum(axis=(1, 2))
        r = 0.5 * (self._edges[1:] + self._edges[:-1])
        with np.errstate(invalid="ignore", divide="ignore"):
            return peaks_of(r, counts / self._ideal, np.sqrt(2.0 * counts * self._frames) / self._ideal, _RADIAL)

    def at(self, radius: float) -> np.ndarray:
        """Map (longitudes, latitudes) at `radius` +- half_width, 1 for isotropy; NaN without neighbours there.

        The shell is rounded to whole distance bins of 0.05 a.
        """
        low, high = (int(round(value / _RADIAL, 0)) for value in (radius - self.half_width, radius + self.half_width))
        if not 0 <= low < high <= len(self._edges) - 1:
            raise ConfigurationError(f"no directions at r = {radius:g} a: pairs are known up to {self._edges[-1]:g} a")
        counts = self._counts[low:high].sum(axis=0)
        return counts / counts.mean() if counts.sum() else np.full(self._shape, np.nan)

    @property
    def maps(self) -> np.ndarray:
        """The maps at `radii`, shape (number of radii, longitudes, latitudes)."""
        unknown = np.full(self._shape, np.nan)
        return np.stack([self.at(r) if np.isfinite(r) else unknown for r in self.radii])

    def off_rings(self, radius: float) -> float:
        """Density relative to isotropy off the paper's two rings: at latitudes beyond +-15 degrees and more than
        30 degrees from the great circle of longitudes +-90 (the plane perpendicular to the flow). 0: depleted."""
        columns, rows = (_FINER * count for count in self._shape)
        longitude = (np.arange(columns) + 0.5) / columns * 2.0 * np.pi - np.pi
        height = (np.arange(rows) + 0.5) / rows * 2.0 - 1.0  # sin(latitude)
        along_flow = np.abs(np.cos(longitude))[:, None] * np.sqrt(1.0 - height**2)
        off = (np.abs(height) > np.sin(_LATITUDE)) & (along_flow > np.sin(_RING))
        share = off.reshape(self._shape[0], _FINER, self._shape[1], _FINER).mean(axis=(1, 3))
        return float((self.at(radius) * share).sum() / share.sum())

    def table(self) -> dict[str, np.ndarray]:
        """r, longitude, latitude (middles, degrees) and relative density of every cell of every map."""
        longitude = np.rad2deg(0.5 * (self.longitude_edges[1:] + self.longitude_edges[:-1]))
        sines = np.sin(self.latitude_edges)
        latitude = np.rad2deg(np.arcsin(0.5 * (sines[1:] + sines[:-1])))
        grid = np.meshgrid(self.radii, longitude, latitude, indexing="ij")
        names = ("r[a]", "longitude[deg]", "latitude[deg]")
        return {name: part.ravel() for name, part in zip(names, grid, strict=True)} | {
            "density[isotropic]": self.maps.ravel()
        }

    def plot(self, ax, radius: float | None = None, top: float | None = None) -> None:
        """Map at `radius` (default: the first) into axes of projection "aitoff"; darker is denser."""
        if ax.name != "aitoff":
            raise ConfigurationError('angular maps need axes made with projection="aitoff"')
        radius = self.radii[0] if radius is None else radius
        if not np.isfinite(radius):
            ax.set_title("no peak", fontsize="small")
            return
        density = self.at(radius)
        top = max(2.0, float(np.nanquantile(density, 0.98))) if top is None else top
        mesh = (self.longitude_edges, self.latitude_edges, density.T)
        ax.pcolormesh(*mesh, cmap="Blues", vmin=0.0, vmax=top, rasterized=True)
        ax.grid(True, linewidth=0.3)
        ax.tick_params(labelsize="x-small")
        ax.set_title(f"$r/a = {radius:.2f}$", fontsize="small")

    def summary(self) -> dict[str, Any]:
        """Relative density off the two rings at each peak."""
        return {
            f"off_rings_peak{i + 1}[isotropic]": self.off_rings(r) if np.isfinite(r) else float("nan")
            for i, r in enumerate(self.radii)
        }
