"""`analyze`: moduli of every cycle of a stored run, averages over the last ones, as table, CSV or JSON."""

from __future__ import annotations

import math
import os
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any

import numpy as np

from suspend.analysis.blocks import direction_begins
from suspend.analysis.dynamics import cyclic_diffusivities
from suspend.analysis.laos import Laos
from suspend.analysis.lissajous import mean_waveforms
from suspend.analysis.moduli import Harmonics, Moduli, read_harmonics
from suspend.analysis.normal_stresses import NormalStresses
from suspend.analysis.rheology import block_row, cycle_row, normalised_signals
from suspend.analysis.samples import cycle_samples, default_window, read_scales
from suspend.analysis.spectrum import PowerSpectrum
from suspend.analysis.steady import SIGNIFICANCE, SteadyAverage, ratio_average, steady_average, summarise
from suspend.analysis.tables import format_analysis
from suspend.errors import ConfigurationError
from suspend.io import Run
from suspend.io.csv_text import write_csv_file
from suspend.missing import largest, plain, smallest

_PAPER_DRIFT = 100.0  # total strain past which the paper still sees eta_r', eta_r'' change (gamma0 < 3.2)


@dataclass(frozen=True)
class Analysis:
    """Moduli of the complete cycles of a run (or averages over the blocks of a run without oscillation).

    `columns` are the headers "quantity[unit]" of `values` (cycles, columns), see `cycle_row` and
    `block_row`; `analysis["eta_r_prime"]` is one column (the unit may be left out). `cycles` counts from 0,
    as `Run.cycle`. `last` is the number of cycles at the end over which averages are taken. `waveforms`
    holds the normalised signals of the first and the last cycle, `notes` what is missing or must be known to
    read the numbers. Oscillatory shear with a complete cycle has also `harmonics` (Fourier coefficients by part),
    `laos` (Chebyshev measures) and `spectrum` (of the mean cycle); they are None otherwise.
    """

    path: str
    flow: str
    scales: dict[str, float]
    columns: tuple[str, ...] = ()
    values: np.ndarray = field(default_factory=lambda: np.empty((0, 0)))
    last: int = 0
    waveforms: dict[int, dict[str, np.ndarray]] = field(default_factory=dict)
    statistics: dict[str, float] = field(default_factory=dict)
    notes: tuple[str, ...] = ()
    harmonics: Harmonics | None = None
    laos: Laos | None = None
    spectrum: PowerSpectrum | None = None

    def __getitem__(self, name: str) -> np.ndarray:
        """Column `name` (cycles,), with or without "[unit]". Raises KeyError."""
        for i, column in enumerate(self.columns):
            if name in (column, column.partition("[")[0]):
                return self.values[:, i]
        raise KeyError(f"no column {name!r}; there are {', '.join(self.columns) or 'none'}")

    def __contains__(self, name: str) -> bool:
        return any(name in (column, column.partition("[")[0]) for column in self.columns)

    @property
    def oscillatory(self) -> bool:
        """True for oscillatory shear, False for block averages."""
        return self.flow == "oscillatory"

    @property
    def cycles(self) -> np.ndarray:
        """Numbers of the cycles (or blocks), from 0."""
        return np.arange(len(self.values))

    @property
    def total_strain(self) -> np.ndarray:
        """gamma_tot at the end of each cycle; quiescent: time times reference rate."""
        return self["total_strain"]

    @property
    def d_cyc(self) -> np.ndarray:
        """D_cyc of each cycle; NaN where it is not known."""
        return self["D_cyc"]

    @cached_property
    def steady(self) -> dict[str, SteadyAverage]:
        """Average of each column over the last `last` cycles by name without unit: error bar, drift test.

        Where the harmonics are known, ratios are those of averages and |nu_n| magnitudes of the average nu_n. Blocks
        before the last reversal of the shear enter only where `last` reaches back to them.
        """
        if not self.last:
            return {}
        begin = min(_direction_begins(self.columns, self.values), len(self.values) - self.last)
        names = [name.partition("[")[0] for name in self.columns]
        found = {
            name: steady_average(self[name][begin:], self.last)
            for name in names
            if name not in ("total_strain", "shear_rate")
        }
        if "N1" in found and self.flow != "quiescent":
            shear = np.abs(self["sigma_xy"])[begin:]
            for name in ("N1", "N2"):
                found[f"{name}_over_shear"] = ratio_average(self[name][begin:], shear, self.last)
        if self.harmonics is not None:
            better = Moduli().use(self.harmonics).steady() | NormalStresses().use(self.harmonics).steady()
            found |= {name: better[name] for name in found if name in better}
        return found

    def averages(self) -> dict[str, dict[str, float]]:
        """By column: mean, standard_error and change over the last `last` cycles, and the drift test.

        standard_error includes the correlation between cycles (see `suspend.analysis.steady`), `effective` is the
        number of independent cycles that amounts to; `change` is the slope of a straight line through the averaged
        values times the length of their window: larger than the error, the run is still evolving. `drift` is the
        like change over the last half of the run, `p_value` the probability of such a trend without drift,
        `drifting` whether that is below 1 %, `verdict` also whether steadiness can be told at all. NaN where too few
        values exist (error, change: 3, p_value: 4).
        """
        rows = {}
        for column in self.columns:
            found = self.steady.get(column.partition("[")[0])
            if found is not None:
                rows[column] = {
                    "mean": found.mean,
                    "standard_error": found.error,
                    "change": _change(self[column][len(self.values) - self.last :]),
                    "effective": found.effective,
                    "drift": found.change,
                    "p_value": found.p_value,
                    "drifting": found.drifting,
                    "verdict": found.verdict,
                }
        return rows

    def table(self) -> str:
        """Text for the terminal: moduli per cycle, averages, harmonics, parts, cost, notes."""
        return format_analysis(self)

    def as_dict(self) -> dict[str, Any]:
        """Everything but the waveforms as plain types fit for JSON; what is not a finite number is None."""
        return {
            "run": self.path,
            "flow": self.flow,
            "parameters": plain(self.scales),
            "cycles": len(self.values),
            "columns": {name: plain(self[name].tolist()) for name in self.columns},
            "averages": {"cycles": self.last, "quantities": plain(self.averages())},
            "drift": plain(self._drift()),
            **{name: plain(content) for name, content in self._measures().items()},
            "statistics": plain(self.statistics),
            "notes": list(self.notes),
        }

    def _drift(self) -> dict[str, Any]:
        tested = {name: found for name, found in self.steady.items() if math.isfinite(found.p_value)}
        reference = max((found.reference for found in tested.values()), default=0)
        return {
            "cycles": reference,
            "significance": SIGNIFICANCE,
            "tested": len(tested),
            "drifting": [name for name, found in tested.items() if found.drifting],
            "slow": [name for name, found in tested.items() if found.verdict == "slow"],
        }

    def _measures(self) -> dict[str, Any]:
        if self.harmonics is None:
            ratios = {name: found for name, found in self.steady.items() if name.endswith("_over_shear")}
            return {"normal_stresses": {"blocks": self.last, "averages": summarise(ratios)}} if ratios else {}
        spectrum = self.spectrum.table() | {"harmonic": self.spectrum.orders}
        return {
            "normal_stresses": NormalStresses().use(self.harmonics).summary(),
            "laos": self.laos.summary(),
            "spectrum": self.spectrum.summary() | {name: row.tolist() for name, row in spectrum.items()},
        }

    def write_csv(self, path: os.PathLike | str) -> None:
        """Write cycle numbers and columns under a header "quantity[unit]"; atomic. Raises StorageError."""
        rows = ([cycle, *row] for cycle, row in enumerate(self.values.tolist()))
        write_csv_file(path, [["cycle", *self.columns], *rows])


def analyze(path: os.PathLike | str, last: int | None = None) -> Analysis:
    """Analyse a run directory or trajectory file, also while the run goes on.

    `last`: how many of the last complete cycles are averaged; by default an eighth of them and at least
    four; without oscillation the last half (of the blocks after a reversal). Cycles are read a few at a
    time, so that memory does not grow with the run. Without a complete cycle the result is empty and its
    notes say so. Raises StorageError (path), ConfigurationError (`last`, too few samples a cycle),
    NumericalError (stress not finite).
    """
    with Run(path) as run:
        return analyze_run(run, last, str(path))


def analyze_run(run: Run, last: int | None = None, path: str = "") -> Analysis:
    """`analyze` for a run that is open already."""
    flow, scales = read_scales(run)
    if last is not None and not 1 <= last <= run.cycles:
        raise ConfigurationError(f"cannot average over the last {last} cycles: the run has {run.cycles} complete ones")
    make_row = cycle_row if flow == "oscillatory" else block_row
    rows, waveforms, columns = [], {}, ()
    for record in cycle_samples(run):
        row = make_row(record, scales)
        columns = tuple(row)
        rows.append(list(row.values()))
        if record["index"] in (0, run.cycles - 1):
            waveforms[record["index"]] = normalised_signals(record, scales)
    values = np.array(rows, float).reshape(len(rows), len(columns))
    notes = _progress_notes(run, flow)
    if rows and flow == "oscillatory":
        d_cyc = _diffusivities(run, scales)
        values[:, columns.index("D_cyc[-]")] = d_cyc
        notes += _diffusivity_notes(run, d_cyc)
    window = last if last is not None else _default_window(columns, values)
    content = (path, flow, scales, columns, values, window, waveforms, _cost(run))
    if not rows or flow != "oscillatory":
        analysis = Analysis(*content)
    else:
        mean = mean_waveforms(run, window)
        harmonics = read_harmonics(run, window)
        laos, spectrum = Laos().use(harmonics).use_waveform(mean), PowerSpectrum().use_waveform(mean)
        analysis = Analysis(*content, harmonics=harmonics, laos=laos, spectrum=spectrum)
    return replace(analysis, notes=(*notes, *_drift_notes(analysis)))


def _diffusivities(run: Run, scales: Mapping) -> np.ndarray:
    """D_cyc (cycles,); NaN for a cycle whose end is not stored (yet)."""
    starts = (frame for chunk in run.cycle_start_unwrapped() for frame in chunk)
    found = np.fromiter(cyclic_diffusivities(starts, scales["gamma0"], scales["radius"]), float)[: run.cycles]
    return np.concatenate([found, np.full(run.cycles - len(found), np.nan)])


def _default_window(columns: tuple[str, ...], values: np.ndarray) -> int:
    if "shear_rate[rate]" in columns and len(values):  # do not average across a reversal
        return int(max((len(values) - _direction_begins(columns, values)) // 2, 1))
    return default_window(len(values))


def _direction_begins(columns: tuple[str, ...], values: np.ndarray) -> int:
    if "shear_rate[rate]" not in columns or not len(values):
        return 0
    return direction_begins(values[:, columns.index("shear_rate[rate]")])


def _drift_notes(analysis: Analysis) -> list[str]:
    """Whether the averages are those of a steady state."""
    labels = {
        "eta_r_prime": "eta_r'",
        "eta_r_double_prime": "eta_r''",
        "eta_r": "eta_r",
        "N2_nu0": "N2:nu0",
        "N2": "N2",
    }
    found = {label: analysis.steady[name] for name, label in labels.items() if name in analysis.steady}
    tested = {label: each for label, each in found.items() if each.verdict != "unknown"}
    if not tested:
        unit = "cycles" if analysis.oscillatory else "blocks"
        return [f"too few {unit} for a test of drift: the state may still be evolving"] if found else []
    end = analysis.total_strain[-1]
    begin = analysis.total_strain[len(analysis.values) - max(each.reference for each in tested.values())]
    changes = {
        verdict: ", ".join(
            f"{label} by {each.change:.2g} (now {each.mean:.4g})"
            for label, each in tested.items()
            if each.verdict == verdict
        )
        for verdict in ("drifting", "slow")
    }
    notes = []
    if changes["drifting"]:
        like = (
            "; the paper's runs drift past total strain 100 too" if analysis.oscillatory and end > _PAPER_DRIFT else ""
        )
        notes.append(
            f"not steady: from total strain {begin:.4g} to {end:.4g} there is a drift of {changes['drifting']}{like}"
        )
    if changes["slow"]:
        notes.append(
            f"not shown to be steady: from total strain {begin:.4g} to {end:.4g} there are changes as slow as that, "
            f"which may be drift or fluctuation, of {changes['slow']}"
        )
    if not notes and analysis.oscillatory and end < _PAPER_DRIFT:
        notes.append(f"no drift was found, but total strain {end:.4g} is short: the paper's runs drift past 100")
    return notes


def _progress_notes(run: Run, flow: str) -> list[str]:
    unit = "cycle" if flow == "oscillatory" else "block of strain"
    if run.cycles == 0:
        return [f"no complete {unit} is stored yet: nothing to analyse; let the run go on"]
    notes = [] if run.finished else ["the run is not finished: these are its complete cycles so far"]
    if run.finished and run.meta.get("end"):
        notes.append(f"how the run ended: {run.meta['end']}")
    if run.stored > run.cycles:
        notes.append(f"the last {unit} is not complete and is left out")
    return notes


def _diffusivity_notes(run: Run, d_cyc: np.ndarray) -> list[str]:
    if not np.isnan(d_cyc).any():
        return []
    if int(run.meta["number"]) < 2:
        return ["D_cyc needs two spheres: it is the displacement relative to the mean"]
    missing = np.isnan(d_cyc).sum()
    return [f"D_cyc of {missing} cycle(s) is not known: the positions at the end are not stored (yet)"]


def _cost(run: Run) -> dict[str, float]:
    """Solver statistics of all cycles: totals of counts, extremes of gaps and error estimates."""
    reduce = {"minimum_gap": smallest, "position_error": largest}
    columns = run.statistics() if run.stored else {}
    columns.pop("d_cyc", None)  # a result, not a cost
    reduced = {name: reduce.get(name, np.sum)(column) for name, column in columns.items() if len(column)}
    return {name: np.asarray(value).item() for name, value in reduced.items()}


def _change(values: np.ndarray) -> float:
    order = np.flatnonzero(np.isfinite(values))
    if len(order) < 3:
        return math.nan
    return float(np.polyfit(order, values[order], 1)[0] * (order[-1] - order[0]))
