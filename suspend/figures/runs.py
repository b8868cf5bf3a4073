"""The runs a figure is drawn from: found once, read when a panel asks for them."""

from __future__ import annotations

import math
import os
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

from suspend.analysis.collection import Collection
from suspend.analysis.run_paths import find_runs
from suspend.analysis.samples import read_scales, read_seed
from suspend.errors import ConfigurationError, SuspendError, named
from suspend.io import Run

_SAME = 1e-6  # relative: parameters closer than this are equal
PAPER_FRACTION = 0.40  # of the figures that show one volume fraction


@dataclass(frozen=True)
class Member:
    """One run: where it is, and the parameters that figures choose it by."""

    path: Path
    flow: str
    scales: dict[str, float]
    far_field: bool
    seed: int
    cycles: int

    @property
    def phi(self) -> float:
        """Volume fraction."""
        return self.scales["volume_fraction"]

    @property
    def gamma0(self) -> float:
        """Strain amplitude; NaN without oscillation."""
        return self.scales.get("gamma0", math.nan)

    @property
    def number(self) -> int:
        """Number of spheres."""
        return int(self.scales["number"])

    def open(self) -> Run:
        """The stored run; close it."""
        return Run(self.path)


class Runs(Sequence):
    """The runs, in the order of volume fraction, amplitude, far field and seed.

    notes: runs that could not be read and are left out; steady-state averages are over the last `last` cycles.
    """

    def __init__(self, members: Iterable[Member], last: int | None = None, notes: Iterable[str] = ()):
        self.members = sorted(members, key=lambda m: (m.phi, m.scales.get("gamma0", 0.0), m.far_field, m.seed))
        self.last, self._notes = last, list(notes)

    def __len__(self) -> int:
        return len(self.members)

    def __getitem__(self, i):
        return self.members[i]

    def __iter__(self) -> Iterator[Member]:
        return iter(self.members)

    @property
    def notes(self) -> list[str]:
        """What was left out or must be known to read the figure."""
        return [*self._notes, *(self.collection.notes if "collection" in self.__dict__ else [])]

    @property
    def only(self) -> Member:
        """The only run, where the figure is of one run. Raises ConfigurationError for more."""
        if len(self) > 1:
            names = ", ".join(str(m.path) for m in self.members[:4]) + (", ..." if len(self) > 4 else "")
            raise ConfigurationError(f"this figure is of one run, but {len(self)} were given: {names}; give one")
        return self.members[0]

    @cached_property
    def collection(self) -> Collection:
        """Steady-state values of all runs."""
        return Collection(last=self.last).compute([m.path for m in oscillatory(self)])

    def amplitudes(self, phi: float = PAPER_FRACTION) -> list[Member]:
        """One run for each amplitude (its first seed) at the volume fraction nearest to `phi`.

        Of setups (far field, N, ...) that with the most amplitudes, then the most runs; a note says which was taken.
        """
        members = oscillatory(self).members
        if len(members) == 1:
            return list(members)
        series = self.collection.series
        nearest = min(series, key=lambda s: abs(s.phi - phi)).phi
        near = [s for s in series if math.isclose(s.phi, nearest, rel_tol=_SAME)]
        best = max(near, key=lambda s: (len(s.groups), int(s.runs.sum())))
        if len(series) > 1 or (best.runs > 1).any():
            note = f"evolution and Lissajous curves are of one run (the first seed) at each amplitude of {best.title}"
            self._notes += [note] if note not in self._notes else []
        by_path = {str(m.path): m for m in members}
        return [by_path[group[0].path] for group in best.groups]

    def nearest(self, gamma0: float, phi: float = PAPER_FRACTION) -> Member:
        """The run nearest to the amplitude, then to the volume fraction; the larger one of equals."""
        return min(oscillatory(self), key=lambda m: (abs(m.phi - phi), abs(math.log(m.gamma0 / gamma0)), -m.number))


def open_runs(paths: Iterable[os.PathLike | str], last: int | None = None) -> Runs:
    """The runs at the paths: run folders, trajectory files, folders that hold runs, or glob patterns.

    `last`: how many of the last cycles steady-state values are averaged over. Each run is opened once to read its
    parameters; one that cannot be read, or has no complete cycle, is left out and noted if there are others. Raises
    StorageError (missing, truncated, foreign), ConfigurationError (no runs).
    """
    found = find_runs(list(paths))
    if not found:
        raise ConfigurationError("no runs were given: give the folders of one run or more")
    members, problems = [], []
    for path in found:
        try:
            members.append(_member(path))
        except SuspendError as error:
            problems.append((path, error))
    if not members:
        raise problems[0][1]
    notes = [f"left out: {named(path, error)}" for path, error in problems]
    if any(m.cycles for m in members):
        notes += [f"left out: {m.path}: it has no complete cycle" for m in members if not m.cycles]
        members = [m for m in members if m.cycles]
    return Runs(members, last, notes)


def _member(path: Path) -> Member:
    with Run(path) as run:
        flow, scales = read_scales(run)
        config = run.config
        return Member(path, flow, scales, config.get("far_field") == "ewald", read_seed(run), run.cycles)


def oscillatory(runs: Runs) -> Runs:
    """The runs, if all are of oscillatory shear. Raises ConfigurationError."""
    other = [m for m in runs if m.flow != "oscillatory"]
    if other:
        raise ConfigurationError(
            f"this figure is of oscillatory shear, but the flow of {other[0].path} is {other[0].flow} (flow.type)"
        )
    return runs


def cycles_of(run: Run, path: Path) -> int:
    """Number of complete cycles. Raises ConfigurationError for none."""
    if not run.cycles:
        raise ConfigurationError(f"{path}: no complete cycle is stored yet: nothing to draw; let the run go on")
    return run.cycles
