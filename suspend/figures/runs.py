"""The runs a figure is drawn from: opened once, grouped by volume fraction and amplitude, averaged over seeds."""

from __future__ import annotations

import math
import os
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import NamedTuple

import numpy as np

from suspend.analysis.summary import Analysis, analyze_run, read_scales
from suspend.errors import ConfigurationError, StorageError
from suspend.io import Run
from suspend.io.reader import TRAJECTORY

_SAME = 1e-9  # relative: parameters closer than this are equal


class Point(NamedTuple):
    """A steady-state value at one volume fraction and amplitude, over all its seeds."""

    gamma0: float
    value: float
    error: float
    runs: int


@dataclass(frozen=True)
class Member:
    """One run: its parameters, and its analysis when asked for."""

    path: Path
    flow: str
    scales: dict[str, float]
    far_field: bool
    seed: int
    last: int | None = None

    @property
    def phi(self) -> float:
        """Volume fraction."""
        return self.scales["volume_fraction"]

    @property
    def gamma0(self) -> float:
        """Strain amplitude."""
        return self.scales["gamma0"]

    @property
    def number(self) -> int:
        """Number of spheres."""
        return int(self.scales["number"])

    @property
    def name(self) -> str:
        """Name of the run's folder."""
        return self.path.name if self.path.is_dir() else self.path.parent.name or str(self.path)

    @cached_property
    def analysis(self) -> Analysis:
        """Moduli of every cycle. Raises ConfigurationError where there is no complete cycle."""
        with self.open() as run:
            last = min(self.last, run.cycles) if self.last and run.cycles else None
            found = analyze_run(run, last, str(self.path))
        if not len(found.values):
            raise ConfigurationError(f"nothing to draw for {self.path}: {'; '.join(found.notes)}")
        return found

    def open(self) -> Run:
        """The stored run; close it."""
        return Run(self.path)

    def steady(self, column: str) -> tuple[float, float]:
        """Mean of a column over the last cycles and its standard error (NaN for one cycle)."""
        if column not in self.analysis:
            return math.nan, math.nan
        name = next(c for c in self.analysis.columns if c.partition("[")[0] == column)
        average = self._averages[name]
        return average["mean"], average["standard_error"]

    @cached_property
    def _averages(self) -> dict:
        return self.analysis.averages()


class Runs(Sequence):
    """Members in the order of volume fraction, amplitude, far field and seed."""

    def __init__(self, members: Iterable[Member]):
        self.members = sorted(members, key=lambda m: (m.phi, m.scales.get("gamma0", 0.0), m.far_field, m.seed))

    def __len__(self) -> int:
        return len(self.members)

    def __getitem__(self, i):
        return self.members[i]

    def __iter__(self) -> Iterator[Member]:
        return iter(self.members)

    @property
    def only(self) -> Member:
        """The only run, where the figure is of one run. Raises ConfigurationError for more."""
        if len(self) > 1:
            raise ConfigurationError(
                f"this figure is of one run, but {len(self)} were given: {', '.join(m.name for m in self)}; give one"
            )
        return self.members[0]

    def families(self) -> dict[tuple[float, bool], list[list[Member]]]:
        """(phi, far field) -> groups of equal amplitude (several seeds), in the order of the amplitude."""
        found: dict[tuple[float, bool], list[list[Member]]] = {}
        for member in self:
            groups = found.setdefault((round(member.phi, 6), member.far_field), [])
            if groups and math.isclose(groups[-1][0].gamma0, member.gamma0, rel_tol=_SAME):
                groups[-1].append(member)
            else:
                groups.append([member])
        return found

    def amplitudes(self, phi: float | None = None) -> list[Member]:
        """One run for each amplitude (its first seed), of the volume fraction nearest to `phi`."""
        keys = list(self.families())
        key = keys[0] if phi is None else min(keys, key=lambda k: (abs(k[0] - phi), k[1]))
        return [group[0] for group in self.families()[key]]


def open_runs(paths: Iterable[os.PathLike | str], last: int | None = None) -> Runs:
    """The runs at the paths: folders of runs, trajectory files, or folders that hold folders of runs.

    `last`: how many of the last cycles steady-state values are averaged over. Each run is opened once to read its
    parameters. Raises StorageError (missing, truncated, foreign), ConfigurationError (no runs).
    """
    found = [inner for path in paths for inner in _expand(Path(path))]
    if not found:
        raise ConfigurationError("no runs were given: give the folders of one run or more")
    seen, members = set(), []
    for path in found:
        real = path.resolve()
        if real not in seen:
            seen.add(real)
            members.append(_member(path, last))
    return Runs(members)


def _expand(path: Path) -> list[Path]:
    if not path.is_dir() or (path / TRAJECTORY).exists():
        return [path]
    inner = sorted(p for p in path.iterdir() if (p / TRAJECTORY).exists())
    if not inner:
        raise StorageError(f"{path} holds no run: neither a {TRAJECTORY} nor folders with one")
    return inner


def _member(path: Path, last: int | None) -> Member:
    with Run(path) as run:
        flow, scales = read_scales(run)
        config = run.config
        return Member(path, flow, scales, config.get("far_field") == "ewald", int(config.get("seed", 0)), last)


def oscillatory(runs: Runs) -> Runs:
    """The runs, if all are of oscillatory shear. Raises ConfigurationError."""
    other = [m for m in runs if m.flow != "oscillatory"]
    if other:
        raise ConfigurationError(
            f"this figure is of oscillatory shear, but the flow of {other[0].path} is {other[0].flow!r} (flow.type)"
        )
    return runs


def points(groups: list[list[Member]], column: str) -> list[Point]:
    """Steady-state values of a column against amplitude, averaged over seeds.

    The error is the standard error over the seeds where there are several, else that over the cycles of the one run.
    """
    found = []
    for group in groups:
        values, errors = np.array([member.steady(column) for member in group]).T
        known = np.isfinite(values)
        if not known.any():
            continue
        count = int(known.sum())
        error = values[known].std(ddof=1) / math.sqrt(count) if count > 1 else errors[known][0]
        found.append(Point(group[0].gamma0, float(values[known].mean()), float(error), count))
    return found
