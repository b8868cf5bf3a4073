"""Do the parts of a `trajectory.h5` fit together? Asked once, when it is opened, before anything is computed from it.

Sizes, types and cycle numbers are compared; of the positions and stresses themselves nothing is read.
"""

from __future__ import annotations

import math
from collections.abc import Iterator

import h5py
import numpy as np

from suspend.conventions import COMPONENTS
from suspend.io import h5md
from suspend.io.schema import SAMPLE_FIELDS

_SHAPES = {"position": ("number", 3), "image": ("number", 3), "unwrapped": ("number", 3), "edges": (3, 3)}
_CYCLES = {"index": "iu", "complete": "b", "sample_end": "iu", "frame_end": "iu"}
_NUMBERS = "biuf"  # kinds of NumPy types: real numbers and truth values
_SAME = 1e-9  # relative: edges of the cell closer than this are equal


def contradiction(file: h5py.File, number: int, length: float) -> str | None:
    """What in the file of `number` spheres in a cell of edge `length` cannot be true; None where all fits.

    Raises what h5py raises where a part is missing or no dataset.
    """
    if number < 1 or not (math.isfinite(length) and length > 0.0):
        return f"the number of spheres is {number}, the edge L of the cell {length:g}; both must be positive numbers"
    checks = (_elsewhere, _cycles, lambda f: _tables(f, number), _owners, lambda f: _edges(f, length))
    return next((found for check in checks if (found := check(file))), None)


def _elsewhere(file: h5py.File) -> str | None:
    """A run is one file: what is kept in others can be absent, changed, or another run's."""
    found = []

    def visit(name: str, link) -> None:
        if isinstance(link, h5py.ExternalLink):
            found.append(f"{name} lies in another file ({link.filename})")
        elif isinstance(link, h5py.HardLink):
            item = file[name]
            if isinstance(item, h5py.Dataset) and (item.external or item.is_virtual):
                found.append(f"the data of {name} lie in another file")

    file.visititems_links(visit)
    return found[0] if found else None


def _cycles(file: h5py.File) -> str | None:
    """The table of the cycles in itself."""
    group = file["cycles"]
    stored = len(group["index"])
    for name, kinds in _CYCLES.items():
        if (found := _unfit(group[name], stored, ())) or (found := _wrong_kind(group[name], kinds)):
            return found
    for name in group["statistics"]:
        if found := _unfit(group["statistics"][name], stored, ()):
            return found
    if "overlaps" in group["statistics"] and (found := _wrong_kind(group["statistics/overlaps"], "iu")):
        return found
    index, complete = group["index"][:], group["complete"][:]
    if not np.array_equal(index, np.arange(stored)):
        k = int(np.flatnonzero(index != np.arange(stored))[0])
        return f"row {k} of cycles/index is cycle {index[k]}"
    if not complete[:-1].all():
        return f"cycle {int(np.flatnonzero(~complete)[0])} is not complete, yet others follow it"
    for name in ("sample_end", "frame_end"):
        ends = np.concatenate([[0], group[name][:]])
        if (np.diff(ends) <= 0).any():
            k = int(np.flatnonzero(np.diff(ends) <= 0)[0])
            return f"cycles/{name} of cycle {k} is {ends[k + 1]}, before it {ends[k]}: each cycle has rows of its own"
    return None


def _tables(file: h5py.File, number: int) -> str | None:
    """Every series against the rows that the table of cycles gives it."""
    if h5md.FRAME_STEP not in file:
        return "cycles are listed, but there are no positions" if len(file["cycles/index"]) else None
    samples, frames = (_last(file[f"cycles/{name}"]) for name in ("sample_end", "frame_end"))
    stored = len(file[h5md.FRAME_STEP])
    if stored not in (frames, frames + 1):  # the final frame lies behind the last cycle
        return f"there are {stored} frames of positions, but the cycles have {frames}"
    for name, path in h5md.PATHS.items():
        shape = tuple(number if size == "number" else size for size in _SHAPES.get(name, ()))
        if found := _unfit_element(file, path, stored, shape):
            return found
    # a run that ended at once has frames, but no samples yet
    for path, shape in _series(file, number) if samples else ():
        if found := _unfit_element(file, path, samples, shape):
            return found
    return None


def _series(file: h5py.File, number: int) -> Iterator[tuple[str, tuple[int | None, ...]]]:
    """Path and shape of a row of every time series; None: any size."""
    for name in dict.fromkeys([*(n for n in SAMPLE_FIELDS if n != "time"), "cycle", *file["rheology"]]):
        yield f"rheology/{name}", (len(COMPONENTS),) if name.startswith("stress_") else ()
    for name in file[h5md.SPHERES]:
        path = f"{h5md.SPHERES}/{name}"
        if path != h5md.CELL and path not in h5md.PATHS.values():
            yield path, (number, None)


def _owners(file: h5py.File) -> str | None:
    """The number of its cycle, which every row carries, against the table of cycles."""
    stored = len(file["cycles/index"])
    for path, name in (("rheology/cycle", "sample_end"), (h5md.PATHS["frame_cycle"], "frame_end")):
        ends = file[f"cycles/{name}"][:]
        rows = file[path + "/value"][: _last(ends)] if stored else np.empty(0)
        expected = np.repeat(np.arange(stored), np.diff(ends, prepend=0))
        if not np.array_equal(rows, expected):
            i = int(np.flatnonzero(rows != expected)[0])
            return f"row {i} of {path} belongs to cycle {rows[i]}, by cycles/{name} to cycle {expected[i]}"
    return None


def _edges(file: h5py.File, length: float) -> str | None:
    path = h5md.PATHS["edges"] + "/value"
    if path not in file or not len(file[path]):
        return None
    edges = np.diagonal(file[path][0])
    if not np.allclose(edges, length, rtol=_SAME, atol=0.0):
        return f"L is {length:.9g}, but the cell in {path} has the edges {', '.join(f'{edge:.9g}' for edge in edges)}"
    return None


def _unfit_element(file: h5py.File, path: str, rows: int, shape: tuple[int | None, ...]) -> str | None:
    if path not in file:
        return f"{path} is missing"
    parts = [("value", shape), ("step", ()), ("time", ())]
    return next((found for part, row in parts if (found := _unfit(file[path][part], rows, row))), None)


def _unfit(dataset: h5py.Dataset, rows: int, shape: tuple[int | None, ...]) -> str | None:
    """Why this is no dataset of `rows` rows of real numbers of that shape."""
    name, found = dataset.name.lstrip("/"), dataset.shape
    if not found or found[0] != rows:
        return f"{name} has {found[0] if found else 'no'} rows instead of {rows}"
    if len(found) != len(shape) + 1 or any(
        size not in (None, have) for size, have in zip(shape, found[1:], strict=True)
    ):
        return f"a row of {name} has {_shown(found[1:])} instead of {_shown(shape)}"
    return _wrong_kind(dataset, _NUMBERS)


def _shown(shape: tuple[int | None, ...]) -> str:
    return " x ".join("any number" if size is None else str(size) for size in shape or (1,)) + " values"


def _wrong_kind(dataset: h5py.Dataset, kinds: str) -> str | None:
    if dataset.dtype.kind not in kinds:
        return f"{dataset.name.lstrip('/')} has the type {dataset.dtype}, which is not the one it is written with"
    return None


def _last(ends) -> int:
    return int(ends[-1]) if len(ends) else 0
