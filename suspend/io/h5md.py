"""Layout of `trajectory.h5` (H5MD 1.1) and how cycles are added to it and cut from it.

    /h5md                       version, author, creator
    /particles/spheres          position (wrapped), image, position_unwrapped, box/edges: {step, time, value}
                                per frame; particle_stress and other (n, N, m) series per sample
    /observables                strain, phase, tilt, cycle: {step, time, value} per frame
    /rheology/NAME              strain, rate, phase, cycle, stress_...: {step, time, value} per sample
    /cycles                     index, complete, sample_end, frame_end; statistics/NAME: one row per cycle;
                                statistics/d_cyc (oscillatory) is relative to the mean displacement of the
                                spheres, as D_cyc of the analysis: the drift of the whole is taken off
    /parameters                 configuration (YAML text); attributes: seed, versions, units, ...
    /restart/checkpoint         the bytes of checkpoint.npz at the last cycle in this file

Time series live outside /observables on purpose: MDAnalysis indexes everything under /observables by the
number of the position frame and would show the wrong sample. Elements of one table share step and time by
hard links. `step` counts millionths of a cycle. Nothing is compressed: positions would shrink
by 15 %, for many times the writing time. NaN is a quantity without a value (`suspend.missing`).
"""

from __future__ import annotations

import getpass
import math
import uuid

import h5py
import numpy as np

from suspend.conventions import COMPONENTS, FORMAT_VERSION
from suspend.io.schema import FRAME_FIELDS, sample_fields, steps
from suspend.missing import NOTE, known, plain

UNITS = (
    "those of the configuration: length as particles.radius, viscosity as fluid.viscosity, time as "
    "1/flow.omega or 1/flow.rate; stress = viscosity/time; strain and phase (fraction of a cycle) are numbers"
)
SPHERES, CELL = "particles/spheres", "particles/spheres/box"
PATHS = {  # elements per frame
    "position": SPHERES + "/position",
    "image": SPHERES + "/image",
    "unwrapped": SPHERES + "/position_unwrapped",
    "edges": CELL + "/edges",
    "frame_strain": "observables/strain",
    "frame_phase": "observables/phase",
    "tilt": "observables/tilt",
    "frame_cycle": "observables/cycle",
}
FRAME_STEP, FRAME_TIME = PATHS["position"] + "/step", PATHS["position"] + "/time"
SAMPLE_STEP, SAMPLE_TIME = "rheology/strain/step", "rheology/strain/time"


def element_path(name: str, row_shape: tuple[int, ...], number: int) -> str:
    """Path of a field's H5MD element; per-sphere series go to the particles group."""
    if name in PATHS:
        return PATHS[name]
    per_sphere = len(row_shape) == 2 and row_shape[0] == number
    return f"{SPHERES if per_sphere else 'rheology'}/{name}"


def empty_file(config_yaml: str, meta: dict, run_id: str) -> bytes:
    """Bytes of an empty trajectory; `meta` (nested, scalars and lists) becomes attributes."""
    # Files in memory of one name clash, as of two runs in threads of one process.
    with h5py.File(f"empty-{uuid.uuid4().hex}", "w", driver="core", backing_store=False) as file:
        header = file.create_group("h5md")
        header.attrs["version"] = np.array([1, 1], np.int32)
        header.create_group("author").attrs["name"] = _user()
        creator = header.create_group("creator")
        creator.attrs["name"] = "suspend"
        creator.attrs["version"] = str(meta.get("versions", {}).get("suspend", "unknown"))
        box = file.create_group(CELL)
        box.attrs["dimension"] = 3
        box.attrs["boundary"] = ["periodic"] * 3
        for name in ("observables", "rheology", "cycles/statistics", "restart"):
            file.create_group(name)
        for name, dtype in (("index", "i8"), ("complete", "?"), ("sample_end", "i8"), ("frame_end", "i8")):
            _series(file, f"cycles/{name}", np.dtype(dtype), ())
        parameters = file.create_group("parameters")
        parameters.attrs.update(
            format_version=FORMAT_VERSION,
            units=UNITS,
            missing=NOTE,
            components=list(COMPONENTS),
            finished=False,
            run_id=run_id,
        )
        _write_meta(parameters.create_group("meta"), meta)
        set_configuration(file, config_yaml)
        file.flush()
        return file.id.get_file_image()


def _user() -> str:
    try:
        return getpass.getuser()
    except (OSError, KeyError):  # containers without a password entry
        return "unknown"


def _write_meta(group: h5py.Group, tree: dict) -> None:
    for key, value in tree.items():
        if isinstance(value, dict):
            _write_meta(group.create_group(key), value)
        else:
            group.attrs[key] = h5py.Empty("f4") if value is None else value


def set_meta(file: h5py.File, name: str, value: str | None) -> None:
    """Put one entry into the stored `meta`; None takes it away."""
    attributes = file["parameters/meta"].attrs
    if value is None:
        attributes.pop(name, None)
    elif attributes.get(name) != value:
        attributes[name] = value


def read_meta(group: h5py.Group) -> dict:
    """The nested dict `empty_file` was given as `meta`."""
    tree = {key: _plain(group.attrs[key]) for key in group.attrs}
    return tree | {key: read_meta(group[key]) for key in group}


def _plain(value):
    return None if isinstance(value, h5py.Empty) else plain(value)


def set_configuration(file: h5py.File, config_yaml: str) -> None:
    """Replace the stored configuration text."""
    if "configuration" in file["parameters"]:
        del file["parameters/configuration"]
    file["parameters"].create_dataset("configuration", data=config_yaml, dtype=h5py.string_dtype())


def get_configuration(file: h5py.File) -> str:
    """The stored configuration text."""
    return file["parameters/configuration"].asstr()[()]


def set_checkpoint(file: h5py.File, data: bytes) -> None:
    """Replace the stored copy of the checkpoint.

    It is overwritten in place and never shortened: HDF5 forgets freed space when a file is closed.
    """
    if "checkpoint" not in file["restart"]:
        file.create_dataset("restart/checkpoint", (0,), np.uint8, maxshape=(None,), chunks=(1 << 16,))
    dataset = file["restart/checkpoint"]
    dataset.resize((max(len(data), len(dataset)),))
    dataset[: len(data)] = np.frombuffer(data, np.uint8)
    dataset.attrs["length"] = len(data)


def get_checkpoint(file: h5py.File) -> bytes | None:
    """The stored copy of the checkpoint, or None before the first consolidation."""
    if "restart/checkpoint" not in file:
        return None
    dataset = file["restart/checkpoint"]
    return dataset[: dataset.attrs["length"]].tobytes()


def truncate(file: h5py.File, cycle: int) -> None:
    """Drop `cycle` and all later cycles, and with them the final frame behind the last cycle."""
    kept = min(cycle, len(file["cycles/index"]))
    ends = {
        name: int(file[f"cycles/{name}"][kept - 1]) if kept else 0 for name in ("sample_end", "frame_end")
    }
    for element in _elements(file):
        rows = ends["frame_end" if element.name.lstrip("/") in PATHS.values() else "sample_end"]
        for part in ("step", "time", "value"):
            _resize(element[part], rows)
    for dataset in _cycle_datasets(file):
        _resize(dataset, kept)


def _resize(dataset: h5py.Dataset, rows: int) -> None:
    if len(dataset) != rows:
        dataset.resize(rows, axis=0)


def _elements(file: h5py.File) -> list[h5py.Group]:
    found = []

    def visit(name, item):
        if isinstance(item, h5py.Group) and "value" in item and "step" in item:
            found.append(item)

    for root in ("particles", "observables", "rheology"):
        file[root].visititems(visit)
    return found


def _cycle_datasets(file: h5py.File) -> list[h5py.Dataset]:
    group = file["cycles"]
    return [
        item
        for sub in (group, group["statistics"])
        for item in sub.values()
        if isinstance(item, h5py.Dataset)
    ]


def append(file: h5py.File, records: list[dict], number: int, length: float) -> None:
    """Append cycles of `number` spheres in a cell of edge `length`; they must follow what the file holds."""
    if not records:
        return
    first = records[0]
    step = np.concatenate([steps(r["index"], r["phase"]) for r in records])
    _extend(file, SAMPLE_STEP, step)
    _extend(file, SAMPLE_TIME, _joined(records, "time"))
    for name in sample_fields(first):
        if name != "time":
            path = element_path(name, np.shape(first[name])[1:], number)
            _extend_element(file, path, _joined(records, name), SAMPLE_STEP, SAMPLE_TIME)
    cycle = np.concatenate([np.full(len(r["time"]), r["index"], np.int64) for r in records])
    _extend_element(file, "rheology/cycle", cycle, SAMPLE_STEP, SAMPLE_TIME)
    append_frames(file, records, length)
    for name in first["statistics"]:
        _extend(file, f"cycles/statistics/{name}", known(np.array([r["statistics"][name] for r in records])))
    for name in ("index", "complete"):
        _extend(file, f"cycles/{name}", np.array([r[name] for r in records]))
    for name, key in (("sample_end", "time"), ("frame_end", "frame_time")):
        ends = file[f"cycles/{name}"]
        start = int(ends[-1]) if len(ends) else 0
        _extend(file, f"cycles/{name}", start + np.cumsum([len(r[key]) for r in records]))


def append_frames(file: h5py.File, records: list[dict], length: float) -> None:
    """Append the frames of the records (or of a final frame, shaped like a record with K = 1)."""
    _extend(file, FRAME_STEP, np.concatenate([steps(r["index"], r["frame_phase"]) for r in records]))
    _extend(file, FRAME_TIME, _joined(records, "frame_time"))
    for name in FRAME_FIELDS[1:]:
        _extend_element(file, PATHS[name], _joined(records, name), FRAME_STEP, FRAME_TIME)
    tilt = _joined(records, "tilt")
    edges = np.zeros((len(tilt), 3, 3))
    edges[:, [0, 1, 2], [0, 1, 2]] = length
    edges[:, 1, 0] = tilt * length  # rows are the cell vectors
    cycle = np.concatenate([np.full(len(r["frame_time"]), r["index"], np.int64) for r in records])
    _extend_element(file, PATHS["edges"], edges, FRAME_STEP, FRAME_TIME)
    _extend_element(file, PATHS["frame_cycle"], cycle, FRAME_STEP, FRAME_TIME)


def _joined(records: list[dict], name: str) -> np.ndarray:
    # one cycle alone may be large (stress of every sphere): no copy then
    return records[0][name] if len(records) == 1 else np.concatenate([r[name] for r in records])


def _extend_element(file: h5py.File, path: str, rows: np.ndarray, step: str, time: str) -> None:
    _extend(file, path + "/value", rows)
    for name, shared in (("step", step), ("time", time)):
        if name not in file[path]:
            file[path][name] = file[shared]  # a hard link


def _extend(file: h5py.File, path: str, rows: np.ndarray) -> None:
    dataset = file[path] if path in file else _series(file, path, rows.dtype, rows.shape[1:])
    start = len(dataset)
    dataset.resize(start + len(rows), axis=0)
    dataset[start:] = rows


def _series(file: h5py.File, path: str, dtype: np.dtype, row_shape: tuple[int, ...]) -> h5py.Dataset:
    row_bytes = dtype.itemsize * math.prod(row_shape)
    rows = int(
        np.clip((1 << 16) // max(row_bytes, 1), 1, 512)
    )  # chunks of 64 KiB, or one row where that is more
    return file.create_dataset(
        path, (0, *row_shape), dtype, maxshape=(None, *row_shape), chunks=(rows, *row_shape)
    )
