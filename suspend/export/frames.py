"""Which frames are exported, and a frame as the formats need it."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from suspend.box import cell_vectors
from suspend.errors import ConfigurationError
from suspend.io import Run
from suspend.io.schema import steps

PHASE_TOLERANCE = 1e-9  # of a cycle


@dataclass(frozen=True)
class ExportFrame:
    """One frame in the units of the run's configuration.

    vectors (3, 3): cell vectors as rows, corner at the origin; position (N, 3): in that cell; image (N, 3) int32:
    position + image @ vectors is the unwrapped position; stress (N, 6) or None: stress of each sphere, components
    xx yy zz xy xz yz, whose sum over the spheres is the suspension's less the fluid's own.
    """

    index: int
    step: int
    cycle: int
    time: float
    strain: float
    phase: float
    tilt: float
    vectors: np.ndarray
    position: np.ndarray
    image: np.ndarray
    stress: np.ndarray | None

    def centred(self) -> tuple[np.ndarray, np.ndarray]:
        """Position and image (N, 3) in the cell whose centre is the origin; the unwrapped position is the same.

        Wrapped anew and not shifted by half a cell: half of a tilting cell is not the same point at all times.
        """
        fractions = self.position @ np.linalg.inv(self.vectors)
        shift = np.floor(fractions + 0.5)
        return self.position - shift @ self.vectors, self.image + shift.astype(np.int32)


class FrameChoice:
    """The frames of a run that are wanted, one in memory at a time.

    frames: slice, numbers (negative from the end) or None for all; phase: only frames at this fraction of a cycle.
    Raises ConfigurationError where there are none.
    """

    def __init__(self, run: Run, frames: slice | tuple[int, ...] | None = None, phase: float | None = None):
        self.run = run
        self.edge, self.radius = float(run.meta["L"]), _radius(run)
        self.number = int(run.meta["number"])
        self.has_stress = bool(run.stored) and "particle_stress" in run.fields
        count = run.n_frames
        if count == 0:
            raise ConfigurationError(f"{run.path} holds no positions (yet): nothing to export; let the run go on")
        self.indices = _indices(frames, count, run)
        if phase is not None:
            near = np.abs(_phases(run) - phase) < PHASE_TOLERANCE
            self.indices = [i for i in self.indices if near[i]]
            if not self.indices:
                raise ConfigurationError(
                    f"{run.path}: no chosen frame is at phase {phase:g}; output.position_phases of the run "
                    f"is {run.config.get('output', {}).get('position_phases', 'not known')}"
                )

    def __len__(self) -> int:
        return len(self.indices)

    def __iter__(self) -> Iterator[ExportFrame]:
        for i in self.indices:
            yield self.frame(i)

    def frame(self, i: int) -> ExportFrame:
        """Frame i of the run."""
        stored = self.run.frame(i)
        return ExportFrame(
            index=i,
            step=int(steps(stored["cycle"], stored["phase"])),
            **{name: stored[name] for name in ("cycle", "time", "strain", "phase", "tilt", "position", "image")},
            vectors=cell_vectors(self.edge, stored["tilt"]),
            stress=self._stress(stored["cycle"], stored["phase"]) if self.has_stress else None,
        )

    def _stress(self, cycle: int, phase: float) -> np.ndarray | None:
        """Stress of each sphere at a phase; None where no sample was taken then (the end of the run)."""
        if cycle >= self.run.stored:
            return None
        near = np.flatnonzero(np.abs(self.run.series("phase", cycle, cycle + 1) - phase) < PHASE_TOLERANCE)
        return self.run.sample("particle_stress", cycle, int(near[0])) if near.size else None


def _radius(run: Run) -> float:
    radius = run.meta.get("radius")
    return float(radius if radius is not None else run.config["particles"].get("radius", 1.0))


def _phases(run: Run) -> np.ndarray:
    """Phase of every frame; positions are read of the final one only."""
    phases = run.series("frame_phase")
    return phases if len(phases) == run.n_frames else np.append(phases, run.frame(-1)["phase"])


def _indices(frames: slice | tuple[int, ...] | None, count: int, run: Run) -> list[int]:
    if frames is None or isinstance(frames, slice):
        chosen = list(range(count)[frames or slice(None)])
        if not chosen:
            raise ConfigurationError(f"{run.path} holds {count} frame(s), none of them is in the range chosen")
        return chosen
    wrong = [i for i in frames if not -count <= i < count]
    if wrong:
        raise ConfigurationError(f"{run.path} holds {count} frame(s), there is no frame {wrong[0]}")
    return [i % count for i in frames]
