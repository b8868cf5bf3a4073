"""Frames of a run as snapshots in units of the sphere radius, and quantities that read them one at a time."""

from __future__ import annotations

import math
from abc import abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Self

import numpy as np
from scipy.spatial import cKDTree

from suspend.analysis.quantity import Quantity
from suspend.bonds import Pairs
from suspend.box import periodic_images
from suspend.errors import ConfigurationError, NumericalError, StorageError

if TYPE_CHECKING:
    from suspend.io import Run

_PHASE_TOLERANCE = 1e-9


@dataclass
class Snapshot:
    """One configuration: position (N,3) and edge `length` in radii, tilt of the cell, and when it was taken.

    `total_strain` is the accumulated strain gamma_tot. Any tilt is accepted; inside it is brought into
    [-1/2, 1/2) (the same lattice), where the shortest lattice vector is L: up to L/2 no pair is met twice.
    """

    position: np.ndarray
    length: float
    tilt: float = 0.0
    total_strain: float = 0.0
    cycle: int = 0
    phase: float = 0.0

    def __post_init__(self):
        self.tilt -= math.floor(self.tilt + 0.5)
        self.position = np.asarray(self.position, float)
        if not np.isfinite(self.position).all():
            raise NumericalError(f"the positions of cycle {self.cycle} are not finite: the run ends there")

    @property
    def number(self) -> int:
        """Number of spheres N."""
        return len(self.position)

    @property
    def density(self) -> float:
        """Spheres per a^3."""
        return self.number / self.length**3

    @property
    def volume_fraction(self) -> float:
        """phi = N (4/3) pi / (L/a)^3."""
        return 4.0 * math.pi / 3.0 * self.density

    def _images(self, reach: float) -> tuple[np.ndarray, cKDTree, np.ndarray]:
        # one tree serves all quantities of a frame, until one of them asks for a longer reach
        known = self.__dict__.get("_image_cache")
        if known is None or known[0] < reach:
            x, images, owners = periodic_images(self.position, self.length, reach, self.tilt)
            known = self.__dict__["_image_cache"] = (reach, x, cKDTree(images, leafsize=32), owners)
        return known[1:]

    def images(self, reach: float) -> cKDTree:
        """Tree of all images of the spheres closer than `reach` (or further) to the cell, radii."""
        return self._images(reach)[1]

    def pairs(self, reach: float, centres: int | None = None) -> tuple[Pairs, int]:
        """Directed pairs closer than `reach` of at most `centres` spheres with all others, and of how many.

        All spheres where there are no more than `centres` (or it is None), else a fixed random choice.
        """
        cache = self.__dict__.setdefault("_pair_cache", {})
        if (reach, centres) not in cache:
            x, tree, owners = self._images(reach)
            chosen = np.arange(self.number)
            if centres is not None and centres < self.number:
                chosen = np.sort(np.random.default_rng(1).choice(self.number, centres, replace=False))
            found = cKDTree(x[chosen]).sparse_distance_matrix(tree, reach, output_type="ndarray")
            first, second = chosen[found["i"]], owners[found["j"]]
            keep = ~((first == second) & (found["v"] < 0.5 * self.length))  # not itself, but its own images
            vector = tree.data[found["j"][keep]] - x[first[keep]]
            pairs = Pairs(first[keep], second[keep], vector, found["v"][keep])
            cache[reach, centres] = (pairs, len(chosen))
        return cache[reach, centres]

    def nearest(self, k: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """The k <= N-1 nearest other spheres of each: distance, index (N,k) and vector (N,k,3), in order.

        Each sphere counts once, with its nearest image. Raises ConfigurationError for k >= N.
        """
        known = self.__dict__.get("_nearest_cache")
        if known is None or known[0].shape[1] < k:
            known = self.__dict__["_nearest_cache"] = self._find_nearest(k)
        return known[0][:, :k], known[1][:, :k], known[2][:, :k]

    def _find_nearest(self, k: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        if not 1 <= k < self.number:
            raise ConfigurationError(f"{self.number} spheres have no {k}-th neighbour: ask for fewer")
        reach = (3.0 * (k + 1) / (4.0 * math.pi * self.density)) ** (1.0 / 3.0) + 1.0
        while True:
            x, tree, owners = self._images(reach)
            distance, index = tree.query(x, k + 1, distance_upper_bound=reach)
            if np.isfinite(distance[:, -1]).all():
                break
            reach = min(1.3 * reach, 1.5 * self.length)
            if reach >= 0.5 * self.length:  # as far as the own images: few spheres, so look at all of them
                return self._nearest_by_image(k)
        if distance[:, -1].max() >= 0.5 * self.length:
            return self._nearest_by_image(k)
        # column 0 is the sphere itself, or one that lies exactly on it
        own = owners[index] == np.arange(self.number)[:, None]
        own[~own.any(axis=1), -1] = True
        keep = ~own
        distance, index = distance[keep].reshape(-1, k), index[keep].reshape(-1, k)
        return distance, owners[index], tree.data[index] - x[:, None, :]

    def _nearest_by_image(self, k: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        # every point has an image of every sphere within 0.87 L (half the diagonal of the cubic cell)
        pairs, _ = self.pairs(1.01 * self.length)
        other = pairs.first != pairs.second
        first, second = pairs.first[other], pairs.second[other]
        order = np.lexsort((pairs.distance[other], second, first))
        _, start = np.unique(first[order] * self.number + second[order], return_index=True)
        nearest = np.flatnonzero(other)[order[start]]
        shape = (self.number, self.number - 1)
        rank = np.argsort(pairs.distance[nearest].reshape(shape), axis=1, kind="stable")[:, :k]
        nearest = np.take_along_axis(nearest.reshape(shape), rank, axis=1)
        return pairs.distance[nearest], pairs.second[nearest], pairs.vector[nearest]


@dataclass(frozen=True)
class Frames:
    """Which frames of a run a quantity looks at; make it with `first`, `last` or `spaced`.

    `phase`: frames taken at this fraction of the cycle only (0: the stroboscopic configurations of the
    paper); None: every frame.
    """

    which: str
    count: int
    phase: float | None = 0.0

    def select(self, phases: np.ndarray, path: object = "the run") -> np.ndarray:
        """Indices of the chosen frames, ascending. Raises ConfigurationError where there is none."""
        if len(phases) == 0:
            raise ConfigurationError(f"{path} has no position frames: nothing to analyse yet")
        suitable = np.arange(len(phases))
        if self.phase is not None:
            suitable = np.flatnonzero(np.abs(phases - self.phase) < _PHASE_TOLERANCE)
        if len(suitable) == 0:
            present = ", ".join(f"{value:g}" for value in np.unique(phases))
            raise ConfigurationError(
                f"{path} has no position frames at phase {self.phase:g} of the cycle, only at {present}: choose "
                "one of these, or add the phase to output.position_phases and run again"
            )
        if self.which == "first":
            return suitable[: self.count]
        if self.which == "last":
            return suitable[-self.count :]
        ranks = np.geomspace(1, len(suitable), min(self.count, len(suitable))) - 1
        return suitable[np.unique(np.rint(ranks).astype(int))]


def first(count: int = 1, phase: float | None = 0.0) -> Frames:
    """The first frames (by default the initial configuration)."""
    return Frames("first", count, phase)


def last(count: int = 8, phase: float | None = 0.0) -> Frames:
    """The last frames (by default the cycle starts of the last eight cycles, the final frame included)."""
    return Frames("last", count, phase)


def spaced(count: int = 32, phase: float | None = 0.0) -> Frames:
    """At most `count` frames, dense at the start (ranks in geometric progression), first and final included."""
    return Frames("spaced", count, phase)


LAST, SPACED = last(), spaced()


class FrameQuantity(Quantity):
    """A quantity of configurations: chosen frames of a run, read one at a time.

    `frames` chooses them. Configurations that come from elsewhere:
    ``quantity.compute_snapshots([Snapshot(x, L)])``.
    """

    frames: Frames

    def compute(self, run: Run) -> Self:
        """Compute from an open `suspend.io.Run`."""
        compute_together(run, [self])
        return self

    def compute_snapshots(self, snapshots: Sequence[Snapshot]) -> Self:
        """Compute from configurations instead of a run."""
        self.begin()
        for snapshot in snapshots:
            self._check_and_add(snapshot)
        self.finish()
        return self

    def missing(self, snapshot: Snapshot) -> str | None:
        """Why a configuration like this one cannot give the quantity, or None where it can."""
        return "one sphere has no neighbours" if snapshot.number < 2 else None

    @abstractmethod
    def begin(self) -> None:
        """Forget earlier results."""

    @abstractmethod
    def add(self, snapshot: Snapshot) -> None:
        """Take one configuration into account."""

    def _check_and_add(self, snapshot: Snapshot) -> None:
        reason = self.missing(snapshot)
        if reason:
            raise ConfigurationError(reason)
        self.add(snapshot)

    def finish(self) -> None:
        """Turn what was collected into results."""


def compute_together(run: Run, quantities: Sequence[FrameQuantity]) -> None:
    """Compute several quantities in one pass over the frames: each frame is read and its neighbours found once.

    Raises ConfigurationError (no suitable frame), StorageError (stored configuration not usable).
    """
    phases = _phases(run)
    wanted = [set(q.frames.select(phases, run.path).tolist()) for q in quantities]
    for quantity in quantities:
        quantity.begin()
    for i in sorted(set().union(*wanted)):
        snapshot = read_snapshot(run, i)
        for quantity, indices in zip(quantities, wanted, strict=True):
            if i in indices:
                quantity._check_and_add(snapshot)
    for quantity in quantities:
        quantity.finish()


def read_snapshot(run: Run, i: int) -> Snapshot:
    """Frame i of an open run (negative from the end), in units of the radius."""
    frame, (radius, length) = run.frame(i), _scales(run)
    return Snapshot(
        frame["position"] / radius,
        length,
        float(frame["tilt"]),
        accumulated_strain(run.config, float(frame["time"])),
        int(frame["cycle"]),
        float(frame["phase"]),
    )


def _scales(run: Run) -> tuple[float, float]:
    try:
        radius = float(run.meta["radius"])
        return radius, float(run.meta["L"]) / radius
    except (KeyError, TypeError, ValueError, ZeroDivisionError) as error:
        raise StorageError(
            f"{run.path} does not say the radius and the edge of the cell ({error!r}): it was not written by "
            "this version of suspend, or was changed"
        ) from error


def accumulated_strain(config: dict[str, Any], time: float) -> float:
    """gamma_tot(t), the integral of |rate| from 0 to `time` (units of the configuration); dimensionless.

    Oscillatory shear gamma0 sin(omega t + phase): 4 gamma0 per cycle. Other flows: reference rate x time.
    """
    try:
        flow = config["flow"]
        if flow["type"] != "oscillatory":
            return abs(float(flow["rate"])) * time
        omega = flow["omega"] if flow.get("omega") is not None else 2.0 * math.pi * flow["frequency"]
        gamma0, start = float(flow["amplitude"]), float(flow.get("phase") or 0.0)
    except (KeyError, TypeError, ValueError) as error:
        raise StorageError(f"the configuration stored with the run is not usable ({error!r})") from error
    return gamma0 * (_path_of_sine(start + omega * time) - _path_of_sine(start))


def _path_of_sine(theta: float) -> float:
    """Integral of |cos| from 0 to theta."""
    half_turns = math.floor(theta / math.pi + 0.5)
    return 2.0 * half_turns + math.sin(theta - math.pi * half_turns)


def _phases(run: Run) -> np.ndarray:
    phases = run.series("frame_phase") if run.stored and "frame_phase" in run.fields else np.empty(0)
    if run.n_frames > len(phases):  # the final frame lies behind the last cycle
        later = [run.frame(i)["phase"] for i in range(len(phases), run.n_frames)]
        phases = np.append(phases, later)
    return np.asarray(phases, float)


def tabulate_frames(snapshots: Sequence[tuple[float, int]]) -> dict[str, np.ndarray]:
    """Columns total_strain and cycle of the frames of an evolution."""
    strain = np.array([entry[0] for entry in snapshots], float)
    return {"total_strain[-]": strain, "cycle[-]": np.array([entry[1] for entry in snapshots], int)}
