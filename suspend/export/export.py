"""`export`: one call for every format; the suffix decides."""

from __future__ import annotations

import os
from collections.abc import Callable
from pathlib import Path

from suspend.errors import ConfigurationError
from suspend.export.frames import FrameChoice
from suspend.io import Run
from suspend.io.files import replace_atomically, storage_errors

TRAJECTORIES = (".gsd", ".xyz", ".extxyz", ".h5md")
TABLES = (".csv", ".json")
FORMATS = (*TRAJECTORIES, *TABLES, ".nc")
CONTENTS = ("cycles", "samples")
_OWN_FILES = ("moduli.csv", "viscosity.csv")  # a run keeps them in its folder


def check_target(run: os.PathLike | str, target: os.PathLike | str) -> Path:
    """The target as a path, if it can be one. Raises ConfigurationError, before anything is read."""
    target = Path(target)
    if target.suffix.lower() not in FORMATS:
        raise ConfigurationError(
            f"cannot export to {target}: its name ends in {target.suffix or 'no suffix'!r}, "
            f"but exports are {', '.join(FORMATS)}"
        )
    if target.is_dir():
        raise ConfigurationError(f"cannot export to {target}: it is a folder; give the name of a file")
    if target.name in _OWN_FILES and target.absolute().parent == Path(run).absolute():
        raise ConfigurationError(f"cannot export to {target}: the run keeps its own table there; choose another name")
    return target


def export(
    run: os.PathLike | str,
    target: os.PathLike | str,
    *,
    frames: slice | tuple[int, ...] | None = None,
    phase: float | None = None,
    table: str = "cycles",
) -> list[str]:
    """Write a run directory or trajectory file to `target`; returns notes on what is missing.

    .gsd, .xyz, .extxyz, .h5md (for MDAnalysis): positions; .csv, .json: moduli per cycle (`table` "samples": the
    time series); .nc: time series and moduli, with positions where `frames` or `phase` is given (needs xarray and
    h5netcdf).
    frames: which ones, as a slice or numbers (negative from the end), default all; phase: only those at
    this fraction of a cycle. One frame (one cycle of the tables) is in memory at a time. Atomic: the target is the
    old file or the complete new one. Raises ConfigurationError (suffix, frames that are not there, missing
    package), StorageError, NumericalError (stress not finite).
    """
    target = check_target(run, target)
    if table not in CONTENTS:
        raise ConfigurationError(f"table: found {table!r}; must be {' or '.join(CONTENTS)}")
    suffix = target.suffix.lower()
    positions = frames is not None or phase is not None
    if positions and suffix in TABLES:
        raise ConfigurationError(f"{target}: frames are for trajectories ({', '.join(TRAJECTORIES)}) and .nc")
    notes: list[str] = []
    with Run(run) as opened:
        choice = FrameChoice(opened, frames, phase) if positions or suffix in TRAJECTORIES else None
        fill = _filler(suffix, opened, choice, table, notes)
        with storage_errors("write", target):
            replace_atomically(target, fill, sync=True)
    return notes


def _filler(suffix: str, run: Run, choice: FrameChoice | None, table: str, notes: list[str]) -> Callable[[Path], None]:
    """What fills the temporary file; packages are imported here, before anything is written."""
    if suffix == ".gsd":
        from suspend.export.gsd_files import write_gsd

        return lambda path: write_gsd(choice, path, notes)
    if suffix in (".xyz", ".extxyz"):
        from suspend.export.xyz_files import write_xyz

        return lambda path: write_xyz(choice, path, notes)
    if suffix == ".h5md":
        from suspend.export.h5md_files import write_h5md

        return lambda path: write_h5md(choice, path, notes)
    if suffix == ".csv":
        from suspend.export.tables import write_csv

        return lambda path: write_csv(run, path, table, notes)
    if suffix == ".json":
        from suspend.export.tables import write_json

        return lambda path: write_json(run, path, table, notes)
    from suspend.export.arrays import require, write_netcdf

    require("xarray", "h5netcdf")
    return lambda path: write_netcdf(run, choice, path, notes)
