"""How long and how large the points of a sweep will be, and which of them are to be done."""

from __future__ import annotations

import statistics
from dataclasses import dataclass
from pathlib import Path

from suspend.errors import ConfigurationError
from suspend.plan import make_plan
from suspend.sweep.folder import Record, read_record, total_strain
from suspend.sweep.points import Point


@dataclass
class Task:
    """A point with its folder, its record, and the predictions for it: seconds in all, bytes."""

    point: Point
    folder: Path
    record: Record
    seconds: float
    memory: float

    @property
    def remaining(self) -> float:
        """Predicted seconds to go."""
        return self.seconds - self.predicted_so_far

    @property
    def predicted_so_far(self) -> float:
        """Predicted seconds for the strain that is done: not the whole where a steady state has ended the run."""
        total = total_strain(self.point.config)
        return self.seconds * min(self.record.strain / total, 1.0) if total > 0.0 else 0.0


def make_tasks(points: list[Point], places: dict[str, Path]) -> list[Task]:
    """Tasks of these points. Raises ConfigurationError where one cannot be planned."""
    tasks = []
    for point in points:
        try:
            figures = make_plan(point.config).figures
        except ConfigurationError as error:
            raise ConfigurationError(f"point {point.name} is impossible: {error}; nothing was started") from None
        record = read_record(places[point.key])
        tasks.append(Task(point, places[point.key], record, figures["seconds"], figures["memory_MB"] * 1e6))
    return tasks


def check_memory(tasks: list[Task], memory: float, remedy: str = "raise memory in the sweep file") -> None:
    """Refuse points larger than the memory (bytes); `remedy` would give them more. Raises ConfigurationError."""
    large = [task for task in tasks if task.memory > memory]
    if large:
        worst = max(large, key=lambda task: task.memory)
        raise ConfigurationError(
            f"{len(large)} point(s) need more memory than the {memory / 1e9:.3g} GB there are for the sweep, the "
            f"largest {worst.memory / 1e9:.3g} GB ({worst.point.name}): take a larger machine, fewer spheres, or "
            f"{remedy}; nothing was started"
        )


def pace(complete: list[Task]) -> float | None:
    """Median of measured over predicted run time of complete points, None where there is none."""
    known = [task for task in complete if task.record.seconds > 0 and task.predicted_so_far > 0]
    ratios = [task.record.seconds / task.predicted_so_far for task in known]
    return statistics.median(ratios) if ratios else None


def wall_time(seconds: list[float], workers: int) -> float:
    """Time that tasks of these lengths take on `workers` cores, longest first."""
    ends = [0.0] * workers
    for length in sorted(seconds, reverse=True):
        ends[ends.index(min(ends))] += length
    return max(ends)
