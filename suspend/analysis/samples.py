"""Time series of complete cycles from the files of a run, and the scales that make them dimensionless."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Any

import numpy as np

from suspend.analysis.rheology import PARTS
from suspend.errors import ConfigurationError, StorageError
from suspend.io import Run

_SAMPLE_FIELDS = ("time", "strain", "rate", "phase", "stress_fluid", *("stress_" + part for part in PARTS))
_NEEDED = ("time", "strain", "rate", "phase", "stress_fluid", "stress_hydrodynamic", "stress_interparticle")
_CHUNK = 32  # cycles read at a time


def read_scales(run: Run) -> tuple[str, dict[str, float]]:
    """Kind of flow, and what the moduli are normalised with, from the configuration stored with the run.

    Oscillatory: gamma0, omega, phase; otherwise rate; always viscosity, radius, number, volume_fraction.
    Raises StorageError where the configuration lacks one of them.
    """
    config = run.config
    try:
        flow, particles = config["flow"], config["particles"]
        scales = {name: particles[name] for name in ("number", "volume_fraction", "radius")}
        scales["viscosity"] = config["fluid"]["viscosity"]
        if flow["type"] == "oscillatory":
            omega = flow["omega"] if flow.get("omega") is not None else 2.0 * math.pi * flow["frequency"]
            scales |= {"gamma0": flow["amplitude"], "omega": omega, "phase": flow["phase"]}
        else:
            scales["rate"] = flow["rate"]
        scales = {name: int(v) if name == "number" else float(v) for name, v in scales.items()}
        for name, value in scales.items():
            if not math.isfinite(value) or (name not in ("phase", "rate") and value <= 0.0):
                raise ValueError(f"{name} = {value:g}")
        return str(flow["type"]), scales
    except (KeyError, TypeError, ValueError, OverflowError) as error:
        raise _unusable(run, error) from error


def read_seed(run: Run) -> int:
    """Seed of the run, 0 where none is stored. Raises StorageError where it is no number."""
    try:
        return int(run.config.get("seed") or 0)
    except (TypeError, ValueError, OverflowError) as error:
        raise _unusable(run, error) from error


def _unusable(run: Run, error: Exception) -> StorageError:
    return StorageError(
        f"the configuration stored with the run {getattr(run, 'path', '')} is not usable ({error!r}): "
        "it was not written by this version of suspend, or was changed"
    )


def oscillatory_scales(run: Run) -> dict[str, float]:
    """Scales of a run under oscillatory shear with a complete cycle. Raises ConfigurationError for others."""
    flow, scales = read_scales(run)
    if flow != "oscillatory":
        raise ConfigurationError(
            f"{run.path}: its flow is {flow}, but Fourier moduli need oscillatory shear; `suspend analyze` prints "
            "averages over blocks for it"
        )
    if run.cycles == 0:
        raise ConfigurationError(f"{run.path}: no complete cycle is stored yet; let the run go on")
    return scales


def chosen_window(run: Run, last: int | None) -> int:
    """Number of cycles at the end to average over: `last`, or an eighth of them and at least four.

    Raises ConfigurationError where the run has fewer than `last`.
    """
    if last is not None and not 1 <= last <= run.cycles:
        raise ConfigurationError(f"cannot average over the last {last} cycles: the run has {run.cycles} complete ones")
    return last if last is not None else default_window(run.cycles)


def default_window(cycles: int) -> int:
    """An eighth of the cycles, at least four (or all of fewer)."""
    return int(min(cycles, max(4, cycles // 8)))


def cycle_samples(run: Run, first: int = 0, last: int | None = None) -> Iterator[dict[str, Any]]:
    """Time series of complete cycles first to last (exclusive, default all); positions are not read.

    Raises StorageError where one of them is missing.
    """
    last = run.cycles if last is None else last
    names = [name for name in _SAMPLE_FIELDS if last > first and name in run.fields]
    missing = [name for name in _NEEDED if last > first and name not in names]
    if missing:
        raise StorageError(
            f"{run.path}: {', '.join(missing)} is missing, which every run stores; restore the file from a copy, or "
            "start the run anew"
        )
    for begin in range(first, last, _CHUNK):
        end = min(begin + _CHUNK, last)
        series = {name: run.series(name, begin, end) for name in names}
        owner = run.series("cycle", begin, end)
        for k in range(begin, end):
            rows = slice(*np.searchsorted(owner, (k, k + 1)))
            yield {"index": k} | {name: column[rows] for name, column in series.items()}
