"""Many runs together: steady-state values of every run, grouped by volume fraction, amplitude and seed."""

from __future__ import annotations

import math
import os
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, NamedTuple, Self

import numpy as np

from suspend.analysis.quantity import Quantity
from suspend.analysis.relaxation import Relaxation
from suspend.analysis.run_paths import find_runs
from suspend.analysis.samples import read_seed
from suspend.analysis.setups import complete_configuration, labels, physics, settings
from suspend.analysis.steady import steady_average
from suspend.analysis.summary import Analysis, analyze_run
from suspend.errors import ConfigurationError, SuspendError, named
from suspend.io import Run

QUANTITIES = ("eta_r_prime", "minus_eta3_over_eta1", "minus_N2_nu0", "nu4_over_nu2", "D_cyc", "N1_nu0")
DRIFT_WATCHED = ("eta_r_prime", "minus_N2_nu0", "D_cyc")
_SAME = 1e-9  # relative: amplitudes and volume fractions closer than this are equal


@dataclass(frozen=True)
class Member:
    """Steady-state values of one run, over its last `last` cycles.

    values, errors: by name (see `Collection`), errors with the correlation of the cycles included; drifting: names of
    DRIFT_WATCHED whose trend over the last half of the run is significant; state: absorbing, diffusing or undecided
    (see `Relaxation`); total_strain: gamma_tot at the end of the last averaged cycle; setup: physics of the run by key;
    settings: all else that may matter (see `suspend.analysis.setups`); notes: those of `analyze`.
    """

    path: str
    phi: float
    gamma0: float
    number: int
    seed: int
    cycles: int
    finished: bool
    last: int
    total_strain: float
    values: dict[str, float]
    errors: dict[str, float]
    drifting: tuple[str, ...]
    state: str
    setup: dict[str, Any]
    notes: tuple[str, ...] = ()
    settings: dict[str, Any] = field(default_factory=dict)


class SeedAverage(NamedTuple):
    """Mean over `count` runs that differ in their seeds, and its standard error."""

    mean: float
    error: float
    count: int


def seed_average(values: Sequence[float], errors: Sequence[float]) -> SeedAverage:
    """Mean of the finite values; error: their scatter over the root of their number, of a single one its own error."""
    values, errors = np.asarray(values, float), np.asarray(errors, float)
    known = np.isfinite(values)
    count = int(known.sum())
    if count == 0:
        return SeedAverage(math.nan, math.nan, 0)
    error = values[known].std(ddof=1) / math.sqrt(count) if count > 1 else errors[known][0]
    return SeedAverage(float(values[known].mean()), float(error), count)


@dataclass(frozen=True)
class Series:
    """Runs of one volume fraction and one setup, by amplitude: `groups[k]` are the runs (seeds) at `gamma0[k]`."""

    phi: float
    setup: str
    groups: tuple[tuple[Member, ...], ...]

    @property
    def gamma0(self) -> np.ndarray:
        """Strain amplitudes (n,), ascending."""
        return np.array([group[0].gamma0 for group in self.groups])

    @property
    def runs(self) -> np.ndarray:
        """Number of runs at each amplitude (n,)."""
        return np.array([len(group) for group in self.groups])

    @property
    def far_field(self) -> bool:
        """Whether its runs have far-field hydrodynamics."""
        return self.groups[0][0].setup.get("far_field") == "ewald"

    @property
    def title(self) -> str:
        """phi = ..., and the setup where the collection holds several."""
        return f"phi = {self.phi:g}" + (f", {self.setup}" if self.setup else "")

    def averages(self, name: str) -> list[SeedAverage]:
        """Average over the runs at each amplitude."""
        found = []
        for group in self.groups:
            values, errors = ([getattr(m, kind).get(name, math.nan) for m in group] for kind in ("values", "errors"))
            found.append(seed_average(values, errors))
        return found

    def mean(self, name: str) -> np.ndarray:
        """Mean over the runs at each amplitude (n,); NaN where none has a value."""
        return np.array([average.mean for average in self.averages(name)])

    def error(self, name: str) -> np.ndarray:
        """Standard error (n,): over the runs where there are several, else that of the single run over its cycles."""
        return np.array([average.error for average in self.averages(name)])


class Collection(Quantity):
    """Steady-state values of many oscillatory runs against amplitude, for each volume fraction.

    last : cycles averaged at the end of each run (default: an eighth of them and at least four, as `analyze`);
    strain : total strain at which the averages end (default: the end of each run; the paper's is 256).
    Values: every column of `analyze` by its name without unit, and
        minus_N2_nu0 = -nu_0/eta0, and nu4_over_nu2 = |<nu_4>|/|<nu_2>| of the coefficients averaged over the cycles
    (the mean of the magnitudes would stay at the level of the noise where a coefficient vanishes).
    Runs with different physics or number of spheres are never averaged: they form different series, and so do runs of
    one volume fraction and amplitude that differ in any other key but seed, duration and output. Runs that cannot be
    used (damaged, no complete cycle, no oscillation) are left out and named in `notes`.
    """

    def __init__(self, last: int | None = None, strain: float | None = None):
        if (last is not None and last < 1) or (strain is not None and not strain > 0.0):
            raise ConfigurationError(f"last = {last}, strain = {strain}: both must be positive")
        self.last, self.strain = last, strain

    def compute(self, run: os.PathLike | str | Iterable[os.PathLike | str]) -> Self:
        """Read all runs, one at a time: paths of run folders, trajectory files, folders of runs, or glob patterns.

        Raises ConfigurationError where a pattern matches nothing or no run is usable, StorageError for a missing path.
        """
        self._notes: list[str] = []
        members = []
        for path in find_runs(run):
            member = self._read(path)
            if member is not None:
                members.append(member)
        if not members:
            raise ConfigurationError("no usable run: " + ("; ".join(self._notes) or "none was given"))
        self._series, along = _arrange(members)
        self._notes += _shared_notes(members, along)
        return self

    def _read(self, path: Path) -> Member | None:
        try:
            with Run(path) as run:
                analysis = analyze_run(run, None, str(path))
                config, finished, seed = complete_configuration(run), run.finished, read_seed(run)
        except SuspendError as error:  # damaged, or its samples are not finite: one run does not hide the others
            self._notes.append(f"left out: {named(path, error)}")
            return None
        why = None
        if not analysis.oscillatory:
            why = f"its flow is {analysis.flow}, not oscillatory"
        elif not len(analysis.values):
            why = "it has no complete cycle"
        if why is None:
            ends = np.flatnonzero(analysis.total_strain <= (self.strain or math.inf) * (1.0 + 1e-9))
            if ends.size:
                return _member(analysis, {**config, "seed": seed}, finished, len(ends), self.last)
            why = f"its first cycle ends beyond total strain {self.strain:g}"
        self._notes.append(f"left out: {path}: {why}")
        return None

    @property
    def members(self) -> list[Member]:
        """All runs, by series, amplitude and seed."""
        return [member for series in self._series for group in series.groups for member in group]

    @property
    def series(self) -> list[Series]:
        """One series for each volume fraction and setup, ascending in volume fraction."""
        return list(self._series)

    @property
    def notes(self) -> list[str]:
        """What was left out, and what must be known to read the numbers."""
        return list(self._notes)

    def __len__(self) -> int:
        return len(self.members)

    def table(self) -> dict[str, np.ndarray]:
        """One row a run: parameters, the quantities with errors, state and drift."""
        rows = [(series, member) for series in self._series for group in series.groups for member in group]
        members = [member for _, member in rows]
        columns = {
            "run": np.array([m.path for m in members]),
            "setup": np.array([series.setup for series, _ in rows]),
            "phi[-]": np.array([m.phi for m in members]),
            "gamma0[-]": np.array([m.gamma0 for m in members]),
            "number[-]": np.array([m.number for m in members]),
            "seed[-]": np.array([m.seed for m in members]),
            "total_strain[-]": np.array([m.total_strain for m in members]),
            "averaged_cycles[-]": np.array([m.last for m in members]),
        }
        for name in QUANTITIES:
            unit = "eta0" if "nu0" in name else "-"
            columns[f"{name}[{unit}]"] = np.array([m.values[name] for m in members])
            columns[f"{name}_error[{unit}]"] = np.array([m.errors[name] for m in members])
        columns["state"] = np.array([m.state for m in members])
        columns["drifting"] = np.array([" ".join(m.drifting) for m in members])
        return columns

    def summary(self) -> dict[str, Any]:
        """The averages over seeds of every series, and the notes."""
        series = [
            {"phi": s.phi, "setup": s.setup, "gamma0": s.gamma0.tolist(), "runs": s.runs.tolist()}
            | {name: s.mean(name).tolist() for name in QUANTITIES}
            | {f"{name}_error": s.error(name).tolist() for name in QUANTITIES}
            for s in self._series
        ]
        return {"runs": len(self), "series": series, "notes": self.notes}

    def plot(self, ax, name: str = "eta_r_prime") -> None:
        """One quantity against amplitude, a curve for each series."""
        for series in self._series:
            ax.errorbar(series.gamma0, series.mean(name), series.error(name), marker="o", ms=4, label=series.title)
        ax.set_xscale("log")
        ax.set_xlabel(r"$\gamma_0$")
        ax.set_ylabel(name)
        ax.legend(frameon=False)


def _member(analysis: Analysis, config: Mapping, finished: bool, cycles: int, last: int | None) -> Member:
    scales, error = analysis.scales, analysis.statistics.get("position_error", 0.0)
    d_cyc, gamma_tot = analysis.d_cyc[:cycles], analysis.total_strain[:cycles]
    window = min(last or max(4, cycles // 8), cycles)
    averages = {name.partition("[")[0]: steady_average(analysis[name][:cycles], window) for name in analysis.columns}
    values = {name: average.mean for name, average in averages.items()}
    errors = {name: average.error for name, average in averages.items()}
    values["minus_N2_nu0"], errors["minus_N2_nu0"] = -values["N2_nu0"], errors["N2_nu0"]
    values["nu4_over_nu2"], errors["nu4_over_nu2"] = _coherent_ratio(values, errors)
    averages["minus_N2_nu0"] = averages["N2_nu0"]
    known = np.isfinite(d_cyc)
    floor = error**2 / (8.0 * scales["gamma0"])
    relaxation = Relaxation().fit(gamma_tot[known], d_cyc[known], floor)
    return Member(
        path=analysis.path,
        phi=scales["volume_fraction"],
        gamma0=scales["gamma0"],
        number=int(scales["number"]),
        seed=config["seed"],
        cycles=cycles,
        finished=finished,
        last=window,
        total_strain=float(gamma_tot[-1]),
        values=values,
        errors=errors,
        drifting=tuple(name for name in DRIFT_WATCHED if averages[name].drifting),
        state=relaxation.state if known.any() else "unknown",
        setup=physics(config),
        settings=settings(config),
        notes=analysis.notes,
    )


def _coherent_ratio(values: Mapping, errors: Mapping) -> tuple[float, float]:
    """|<nu_4>|/|<nu_2>| of N2 and its error from those of the real and imaginary parts."""
    size, relative = {}, {}
    for n in (2, 4):
        parts = (f"N2_nu{n}_re", f"N2_nu{n}_im")
        size[n] = math.hypot(*(values[name] for name in parts))
        relative[n] = math.hypot(*(errors[name] for name in parts)) / size[n] if size[n] > 0.0 else math.nan
    ratio = size[4] / size[2] if size[2] > 0.0 else math.nan
    return ratio, ratio * math.hypot(relative[2], relative[4])


def _arrange(members: Sequence[Member]) -> tuple[list[Series], list[str]]:
    """The series, and keys that differ along a curve."""
    places = [(_rounded(m.phi), _rounded(m.gamma0)) for m in members]
    texts, along = labels(places, [m.setup for m in members], [m.settings for m in members])
    sets: dict[tuple, list[Member]] = {}
    for member, (phi, _), label in zip(members, places, texts, strict=True):
        sets.setdefault((phi, label), []).append(member)
    series = []
    for (_, label), runs in sorted(sets.items()):
        amplitudes: dict[float, list[Member]] = {}
        for member in sorted(runs, key=lambda m: (m.gamma0, m.seed, m.path)):
            amplitudes.setdefault(_rounded(member.gamma0), []).append(member)
        series.append(Series(runs[0].phi, label, tuple(tuple(group) for group in amplitudes.values())))
    return series, along


def _rounded(value: float) -> float:
    """Equal for values that differ by round-off only."""
    return float(f"{value:.9g}")


def _names(members: Sequence[Member], most: int = 6) -> str:
    names = ", ".join(f"{Path(m.path).name} ({m.total_strain:g})" for m in members[:most])
    return names + (f" and {len(members) - most} more" if len(members) > most else "")


def _shared_notes(members: Sequence[Member], along: Sequence[str]) -> list[str]:
    notes = []
    if along:
        notes.append(f"along the curves {', '.join(along)} differ: compare with care")
    going = [m for m in members if not m.finished]
    if going:
        notes.append(f"not finished, their complete cycles so far are used: {_names(going)}")
    ends = np.array([m.total_strain for m in members])
    short = [m for m in members if m.total_strain < 0.95 * ends.max()]
    if short:
        notes.append(f"total strain is {ends.max():g} at most; shorter: {_names(short)}: compare with care")
    twins: dict[tuple, list[str]] = {}
    for m in members:
        key = (_rounded(m.phi), _rounded(m.gamma0), m.seed, repr((sorted(m.setup.items()), sorted(m.settings.items()))))
        twins.setdefault(key, []).append(m.path)
    for paths in twins.values():
        if len(paths) > 1:
            notes.append(
                f"the same parameters and seed more than once: {', '.join(paths)}: their spread is not statistical"
            )
    return notes
