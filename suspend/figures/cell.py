"""Drawing of a configuration in its sheared cell: the projection onto the shear plane, nearest spheres on top."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from suspend.box import cell_vectors, wrap
from suspend.errors import ConfigurationError
from suspend.figures.runs import Member
from suspend.figures.scalars import DISPLACEMENT, Scalar, scalar_kind, scalar_of_frame
from suspend.figures.style import DIVERGING, SEQUENTIAL

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.collections import EllipseCollection

_EXTREME = 98.0  # percentile of the magnitude at which the colours end
_MANY = 3000  # more discs are a picture inside a PDF, not shapes
_PLAIN = "#9ecae1"  # of spheres that nothing is known of


@dataclass(frozen=True)
class Picture:
    """A frame to draw, lengths in radii: centres (N, 3) in the cell of shear `tilt`, the whole strain."""

    cycle: int
    phase: float
    strain: float
    tilt: float
    edge: float
    centres: np.ndarray
    values: np.ndarray

    @property
    def corners(self) -> np.ndarray:
        """The cell's outline in the shear plane (5, 2)."""
        x, y = cell_vectors(self.edge, self.tilt)[:2, :2]
        return np.array([0 * x, x, x + y, y, 0 * x])

    @property
    def extent(self) -> tuple[float, float, float, float]:
        """xmin, xmax, ymin, ymax with room for the spheres at the edge."""
        low, high = self.corners.min(axis=0) - 1.3, self.corners.max(axis=0) + 1.3
        return low[0], high[0], low[1], high[1]


def pictures(
    member: Member, colour: str, cycle: int | None, phases: list[float] | None
) -> tuple[Scalar, list[Picture]]:
    """Frames of one cycle (the last complete one by default) at the given phases (default: all that are stored).

    Raises ConfigurationError: no such cycle, phases that are not stored, scalars that are not.
    """
    with member.open() as run:
        if not run.cycles:
            raise ConfigurationError(f"{member.path}: no complete cycle is stored yet: nothing to draw")
        last = run.cycles - 1
        if colour.lower() == DISPLACEMENT and not run.finished:
            last = max(last - 1, 0)  # the end of the last cycle is not stored yet
        index = last if cycle is None else cycle
        if not -run.cycles <= index < run.cycles:
            raise ConfigurationError(f"{member.path}: there is no cycle {cycle}: {run.cycles} are complete, from 0")
        index %= run.cycles
        scalar = scalar_kind(colour, run)
        rows = np.flatnonzero(run.series("frame_cycle") == index)
        stored = run.series("frame_phase")[rows]
        if phases is not None:
            rows = rows[[_nearest(stored, phase, member) for phase in phases]]
        found = [_picture(run, run.frame(int(i)), scalar, member.scales) for i in rows]
    return scalar, found


def _nearest(stored: np.ndarray, phase: float, member: Member) -> int:
    row = int(np.argmin(np.abs(stored - phase)))
    if abs(stored[row] - phase) > 1e-6:
        raise ConfigurationError(
            f"{member.path}: no positions at phase {phase:g} (stored: {', '.join(f'{p:g}' for p in stored)}); "
            f"run with {phase:g} in output.position_phases"
        )
    return row


def _picture(run, frame: dict, scalar: Scalar, scales: dict) -> Picture:
    radius = scales["radius"]
    edge = float(run.meta["L"]) / radius
    tilt = frame["tilt"] + round(frame["strain"] - frame["tilt"])  # the strain, up to the tilt at the start
    centres = wrap(frame["position"] / radius, edge, tilt)
    values = scalar_of_frame(scalar, run, frame, scales)
    return Picture(frame["cycle"], frame["phase"], frame["strain"], tilt, edge, centres, values)


def colour_limits(scalar: Scalar, found: list[Picture]) -> tuple[float, float]:
    """Range of the colours over all pictures: symmetric for a signed scalar."""
    magnitude = np.concatenate([np.abs(p.values) for p in found])
    top = float(np.percentile(magnitude[np.isfinite(magnitude)], _EXTREME)) if np.isfinite(magnitude).any() else 1.0
    return (-top if scalar.signed else 0.0, top or 1.0) if top else (-1.0 if scalar.signed else 0.0, 1.0)


def draw_cell(ax: Axes, picture: Picture, scalar: Scalar, limits: tuple[float, float]) -> EllipseCollection:
    """Spheres as discs of their own size, farthest first, and the outline of the cell; no axes."""
    from matplotlib.collections import EllipseCollection

    order = np.argsort(picture.centres[:, 2], kind="stable")
    size = np.full(len(order), 2.0)
    drawn = EllipseCollection(
        size, size, 0.0 * size, units="xy", offsets=picture.centres[order, :2], offset_transform=ax.transData
    )
    drawn.set(edgecolor="#222222", linewidth=0.3 if len(order) < _MANY else 0.1, rasterized=len(order) > _MANY)
    if scalar.name == "none":
        drawn.set_facecolor(_PLAIN)
    else:
        drawn.set_array(picture.values[order])
        drawn.set_cmap(DIVERGING if scalar.signed else SEQUENTIAL)
        drawn.set_clim(*limits)
    ax.add_collection(drawn)
    ax.plot(*picture.corners.T, color="black", linewidth=0.7, linestyle="--")
    low_x, high_x, low_y, high_y = picture.extent
    ax.set(xlim=(low_x, high_x), ylim=(low_y, high_y), aspect="equal")
    ax.set_axis_off()
    return drawn


def picture_table(scalar: Scalar, found: list[Picture]) -> dict[str, np.ndarray]:
    """One row for each sphere of each picture."""
    sizes = [len(p.values) for p in found]
    columns = {
        "cycle[-]": np.repeat([p.cycle for p in found], sizes),
        "phase[cycles]": np.repeat([p.phase for p in found], sizes),
        "strain[-]": np.repeat([p.strain for p in found], sizes),
        "cell_shear[-]": np.repeat([p.tilt for p in found], sizes),
        "cell_edge[a]": np.repeat([p.edge for p in found], sizes),
        "sphere[-]": np.concatenate([np.arange(n) for n in sizes]),
    }
    columns |= {f"{axis}[a]": np.concatenate([p.centres[:, k] for p in found]) for k, axis in enumerate("xyz")}
    return columns if scalar.name == "none" else columns | {scalar.column: np.concatenate([p.values for p in found])}
