"""All results of a sweep as one table: a row a point, with every analysed scalar, its error, cost and state."""

from __future__ import annotations

import json
import re
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import h5py
import numpy as np

import suspend
from suspend.errors import ConfigurationError, NumericalError, StorageError
from suspend.io import Run
from suspend.io.csv_text import csv_text, write_csv_file
from suspend.io.files import replace_atomically, replace_text, storage_errors
from suspend.io.reader import TRAJECTORY
from suspend.missing import NOTE, plain
from suspend.sweep.status import sweep_status

CACHE = "analysis.json"
FORMAT = 1  # of what the cache holds
FORMATS = (".csv", ".h5")
UNITS = {"minimum_gap": "a", "position_error": "a", "wall_time": "s"}


def collect(
    path: str | Path, last: int | None = None, say: Callable[[str], None] = lambda text: None
) -> list[dict[str, Any]]:
    """Rows of the table of a sweep (its folder or file), one a point, also where it is not complete or failed.

    last : cycles averaged at the end of each run (default as `suspend analyze`); say(text) : told of each point that
    is analysed and of what cannot be. What was analysed is kept with the point. Raises ConfigurationError,
    StorageError.
    """
    status = sweep_status(path)
    base = Path(status["sweep"])
    groups = {group["key"]: group["verdict"] for group in status["adaptive"]}
    rows = []
    for point in status["points"]:
        folder = base / point["folder"]
        row = {"point": point["folder"]} | {name: _cell(value) for name, value in point["parameters"].items()}
        row |= {
            "seed": point["seed"],
            "state": point["state"],
            "strain_done[-]": point["strain"],
            "run_time[s]": point["seconds"],
            "failures": point["failures"],
            "message": point["message"],
        }
        row |= _refined(point, groups)
        rows.append(row | (point_scalars(folder, last, say) if (folder / TRAJECTORY).is_file() else {}))
    return rows


def _refined(point: Mapping[str, Any], groups: Mapping[str, Mapping]) -> dict[str, Any]:
    """Of a point of an adaptive sweep: whether it was added, and the bound on gamma_c of its group so far."""
    if point.get("group") not in groups:
        return {}
    verdict = groups[point["group"]]
    bound = {f"gamma_c_{end}[-]": verdict.get(end) for end in ("low", "high")}
    return {"added": str(point["chosen"]).lower(), **bound}


def _cell(value: Any) -> Any:
    return value if value is None or isinstance(value, str | int | float) else json.dumps(value)


def point_scalars(folder: Path, last: int | None, say: Callable[[str], None]) -> dict[str, Any]:
    """Scalars of one run by "name[unit]", from its kept analysis where nothing has changed since."""
    try:
        with Run(folder) as run:
            stamp = [FORMAT, suspend.__version__, run.run_id, run.cycles, last]
    except StorageError as error:
        return {"message": str(error)}
    kept = _kept(folder, stamp)
    if kept is not None:
        return kept
    if stamp[3] == 0:
        return {}
    say(f"analysing {folder.name}")
    try:
        content = plain(_analyse(folder, min(last, stamp[3]) if last else None))
    except (ConfigurationError, NumericalError, StorageError) as error:
        say(f"{folder.name}: {error}")
        return {"message": f"not analysed: {error}"}
    with storage_errors("write", folder / CACHE):
        replace_text(folder / CACHE, json.dumps({"stamp": stamp, "scalars": content}), sync=False)
    return content


def _kept(folder: Path, stamp: list) -> dict[str, Any] | None:
    try:
        content = json.loads((folder / CACHE).read_text(encoding="utf-8"))
        return content["scalars"] if content["stamp"] == stamp else None
    except (OSError, ValueError, KeyError, TypeError):
        return None


def _analyse(folder: Path, last: int | None) -> dict[str, Any]:
    """Every scalar that the analysis has of a run."""
    from suspend.analysis.collection import Collection
    from suspend.analysis.sections import dynamics_section, structure_section
    from suspend.analysis.summary import analyze

    analysis = analyze(folder, last)
    content = analysis.as_dict()
    row: dict[str, Any] = {"cycles": content["cycles"], "averaged_cycles": content["averages"]["cycles"]}
    row["total_strain[-]"] = float(analysis.total_strain[-1])
    for name, found in content["averages"]["quantities"].items():
        bare, unit = _split(name)
        row |= {name: found["mean"], f"{bare}_error{unit}": found["standard_error"]}
    row["drifting"] = " ".join(content["drift"]["drifting"])
    if analysis.oscillatory:
        for name, column in Collection(last=last).compute([folder]).table().items():
            if name not in ("run", "setup", "seed[-]", "averaged_cycles[-]", "drifting"):
                row.setdefault("motion" if name == "state" else name, column[0])
    row |= _averages("", content.get("normal_stresses", {}).get("averages", {}), row)
    row |= _averages("laos_", content.get("laos", {}).get("parts", {}).get("total", {}), row)
    row |= _numbers("spectrum_", content.get("spectrum", {}))
    row |= {f"{name}{_unit(name)}": value for name, value in content["statistics"].items()}
    if analysis.oscillatory:
        for title, values in dynamics_section(folder).items():
            if title != "notes":
                row |= _numbers(_snake(title) + "_", values)
    try:
        row |= _numbers("structure_", structure_section(folder)["Microstructure"])
    except (ConfigurationError, NumericalError) as missing:
        row["structure_note"] = str(missing)
    row["notes"] = "; ".join(content["notes"])
    return row


def _averages(prefix: str, content: Mapping, row: Mapping) -> dict[str, Any]:
    """Means and errors of quantities that the row has not got yet."""
    known = {_split(name)[0] for name in row}
    found: dict[str, Any] = {}
    for name, value in content.items():
        bare, unit = _split(name)
        if isinstance(value, Mapping) and "mean" in value and f"{prefix}{bare}" not in known:
            found |= {f"{prefix}{name}": value["mean"], f"{prefix}{bare}_error{unit}": value.get("error")}
    return found


def _numbers(prefix: str, content: Mapping) -> dict[str, Any]:
    return {
        f"{prefix}{name}": value
        for name, value in content.items()
        if value is None or isinstance(value, str | bool | int | float | np.number)
    }


def _split(name: str) -> tuple[str, str]:
    bare, bracket, unit = name.partition("[")
    return bare, bracket + unit


def _unit(name: str) -> str:
    return f"[{UNITS[name]}]" if name in UNITS else ""


def _snake(name: str) -> str:
    return re.sub(r"(?<!^)(?=[A-Z])", "_", name).lower()


def columns_of(rows: list[dict[str, Any]]) -> list[str]:
    """Names of all columns, in the order in which rows bring them."""
    return list(dict.fromkeys(name for row in rows for name in row))


def table_text(rows: list[dict[str, Any]]) -> str:
    """The table as CSV."""
    return csv_text(_lines(rows))


def _lines(rows: list[dict[str, Any]]) -> list[list[Any]]:
    names = columns_of(rows)
    # Ten digits are more than any error bar, and keep the file of a large sweep small.
    return [names, *([_short(row.get(name)) for name in names] for row in rows)]


def _short(value: Any) -> Any:
    return float(f"{value:.10g}") if isinstance(value, float) else "" if value is None else value


def write_table(rows: list[dict[str, Any]], path: str | Path) -> None:
    """Write the table as CSV, or HDF5 (one dataset a column) where the name ends in .h5; atomic.

    Raises ConfigurationError (another suffix), StorageError.
    """
    path = Path(path)
    check_format(path)
    if path.suffix.lower() == ".csv":
        write_csv_file(path, _lines(rows))
        return

    def fill(temporary: Path) -> None:
        with h5py.File(temporary, "w") as file:
            file.attrs["missing"] = NOTE
            for name in columns_of(rows):
                _write_column(file, name, [row.get(name) for row in rows])

    with storage_errors("write", path):
        replace_atomically(path, fill, sync=True)


def check_format(path: str | Path) -> None:
    """Raises ConfigurationError where a table cannot be written to a file of this name."""
    if Path(path).suffix.lower() not in FORMATS:
        raise ConfigurationError(f"{path}: a table is written to {' or '.join(FORMATS)} (CSV or HDF5); name it so")


def _write_column(file: h5py.File, name: str, values: list[Any]) -> None:
    bare, unit = _split(name)
    bare = bare if bare not in file else name.replace("/", "_per_")
    if any(isinstance(value, str) for value in values):
        text = ["" if value is None else str(value).encode("utf-8", "backslashreplace").decode() for value in values]
        data = file.create_dataset(bare, data=text, dtype=h5py.string_dtype())
    elif values and all(isinstance(value, int) for value in values):
        data = file.create_dataset(bare, data=np.array(values))
    else:
        data = file.create_dataset(bare, data=np.array([np.nan if v is None else float(v) for v in values]))
    if unit:
        data.attrs["unit"] = unit.strip("[]")
