"""xarray, pandas and netCDF: labelled arrays for those who go on in Python. The packages are optional."""

from __future__ import annotations

import importlib.util
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from suspend.analysis.summary import analyze_run
from suspend.conventions import COMPONENTS
from suspend.errors import ConfigurationError
from suspend.export.frames import FrameChoice
from suspend.export.tables import STRESS_UNIT, UNITS, UNITS_SAID, sample_columns, sample_names
from suspend.io import Run

if TYPE_CHECKING:
    import pandas
    import xarray

AXES = ("x", "y", "z")


class FrameVariable(NamedTuple):
    """How an attribute of `ExportFrame` appears in a dataset."""

    attribute: str
    dimensions: tuple[str, ...]
    unit: str
    kind: str = "f8"


FRAME_VARIABLES = {
    "frame_time": FrameVariable("time", (), "time"),
    "frame_strain": FrameVariable("strain", (), "-"),
    "frame_phase": FrameVariable("phase", (), "cycles"),
    "frame_cycle": FrameVariable("cycle", (), "-", "i8"),
    "tilt": FrameVariable("tilt", (), "-"),
    "vectors": FrameVariable("vectors", ("vector", "axis"), "length"),
    "position": FrameVariable("position", ("sphere", "axis"), "length"),
    "image": FrameVariable("image", ("sphere", "axis"), "-", "i4"),
}


def require(*packages: str) -> None:
    """Raise ConfigurationError where an optional package is not installed."""
    missing = [name for name in packages if importlib.util.find_spec(name) is None]
    if missing:
        way = f"pip install {' '.join(packages)}, or suspend[data]"
        raise ConfigurationError(f"this needs {' and '.join(missing)}: {way}")


def to_pandas(run: Run, table: str = "cycles") -> pandas.DataFrame:
    """Moduli of every cycle ("cycles", indexed by cycle) or the time series ("samples") as a data frame.

    Columns are named "quantity[unit]". Raises ConfigurationError (pandas is not installed, no cycle yet).
    """
    require("pandas")
    import pandas

    if table == "samples":
        return pandas.DataFrame(dict(c for name in sample_names(run) for c in sample_columns(run, name)))
    analysis = analyze_run(run, path=str(run.path))
    frame = pandas.DataFrame(analysis.values, columns=list(analysis.columns))
    frame.index.name = "cycle"
    return frame


def to_xarray(run: Run, choice: FrameChoice | None = None) -> xarray.Dataset:
    """Time series (dimension sample), moduli (dimension cycle) and chosen frames (dimension frame) as a dataset.

    `choice`: frames whose positions are wanted, all of them in memory; None for none. Every variable has the
    attribute "units". Raises ConfigurationError (xarray is not installed, no cycle yet).
    """
    require("xarray")
    import xarray

    data: dict[str, tuple] = {}
    for name in sample_names(run):
        values = run.series(name)
        dimensions = ("sample",) if values.ndim == 1 else ("sample", "component")
        label = "sample_cycle" if name == "cycle" else name  # "cycle" is a dimension
        data[label] = (dimensions, values, {"units": UNITS.get(name, STRESS_UNIT)})
    analysis = analyze_run(run, path=str(run.path))
    for column, values in zip(analysis.columns, analysis.values.T, strict=True):
        name, _, unit = column.rstrip("]").partition("[")
        data["cycle_" + name] = (("cycle",), values, {"units": unit})
    coordinates = {"component": list(COMPONENTS), "cycle": np.arange(len(analysis.values))}
    if choice is not None:
        frames = list(choice)
        data |= {
            name: (("frame", *v.dimensions), np.stack([getattr(f, v.attribute) for f in frames]), {"units": v.unit})
            for name, v in FRAME_VARIABLES.items()
        }
        coordinates["axis"] = list(AXES)
    facts = {"title": "suspend run", "run_id": run.run_id, "units": UNITS_SAID, "configuration": run.config_yaml}
    return xarray.Dataset(data, coordinates, facts)


def write_netcdf(run: Run, choice: FrameChoice | None, path: Path, notes: list[str]) -> None:
    """Write `to_xarray` as netCDF 4, the frames one after the other. Raises OSError, ConfigurationError."""
    import h5netcdf

    notes += analyze_run(run).notes
    dataset = to_xarray(run)
    if choice is None:
        dataset.to_netcdf(path, engine="h5netcdf")
        return
    dataset.assign_coords(axis=list(AXES)).to_netcdf(path, engine="h5netcdf")
    sizes = {"frame": len(choice), "sphere": choice.number, "axis": 3, "vector": 3}
    with h5netcdf.File(path, "a") as file:
        for name in ("frame", "sphere", "vector"):
            file.dimensions[name] = sizes[name]
        for name, v in FRAME_VARIABLES.items():
            shape = [sizes[d] for d in v.dimensions]
            made = file.create_variable(name, ("frame", *v.dimensions), v.kind, chunks=(1, *shape) if shape else None)
            made.attrs["units"] = v.unit
        for i, frame in enumerate(choice):
            for name, v in FRAME_VARIABLES.items():
                file[name][i] = getattr(frame, v.attribute)
