"""Readers of configuration files: GSD, extended XYZ, npz, H5MD. They return what the file says, unchecked.

Every reader takes (path, frame) and returns a `RawFrame`; a file that cannot be read is a StorageError, a
frame that is not there a ConfigurationError. Cells may be of any shape; `suspend.initial` says which serve.
"""

from __future__ import annotations

import contextlib
import itertools
import re
import zipfile
from collections import deque
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import NamedTuple

import numpy as np

from suspend.errors import ConfigurationError, StorageError


class RawFrame(NamedTuple):
    """One frame as the file holds it, in its unit of length."""

    positions: np.ndarray  # (N,3)
    vectors: np.ndarray  # (3,3), rows are the cell vectors
    origin: np.ndarray  # (3,), corner of the cell
    radii: np.ndarray | None  # (N,) or scalar


def read_npz(path: Path, frame: int) -> RawFrame:
    """NumPy archive: positions (N,3), L, perhaps tilt (or shift = tilt L) and radius (scalar or (N,))."""
    with _reading(path, "npz archive"), np.load(path, allow_pickle=False) as archive:
        arrays = {name: archive[name] for name in archive.files}
    for name in ("positions", "L"):
        if name not in arrays:
            raise unusable(
                path,
                f"no array '{name}' (found {', '.join(arrays) or 'nothing'}); needed "
                "are positions (N,3) and L, optional are tilt or shift (= tilt L) and radius",
            )
    if "tilt" in arrays and "shift" in arrays:
        raise unusable(path, "holds both tilt and shift; keep one of them")
    _frame_index(frame, 1, path)
    length = _number(arrays["L"], "L", path)
    shift = _number(arrays.get("shift", 0.0), "shift", path)
    if "tilt" in arrays:
        shift = _number(arrays["tilt"], "tilt", path) * length
    vectors = np.array([[length, 0.0, 0.0], [shift, length, 0.0], [0.0, 0.0, length]])
    positions = _floats(arrays["positions"], "positions", path)
    radii = _floats(arrays["radius"], "radius", path) if "radius" in arrays else None
    return RawFrame(positions, vectors, np.zeros(3), radii)


def read_gsd(path: Path, frame: int) -> RawFrame:
    """GSD file of the HOOMD schema: the cell is centred at the origin; diameters are used where stored.

    The schema's default diameter 1 is never stored, and so counts as not given. Single precision: positions
    are known to about 1e-7 L.
    """
    try:
        import gsd.hoomd
    except ImportError as error:
        raise unreadable(path, "reading GSD needs `pip install gsd`") from error
    with _reading(path, "GSD file"), gsd.hoomd.open(path, "r") as trajectory:
        index = _frame_index(frame, len(trajectory), path)
        snapshot = trajectory[index]
        stored = trajectory.file.chunk_exists(index, "particles/diameter") or trajectory.file.chunk_exists(
            0, "particles/diameter"
        )
        box = snapshot.configuration.box
        positions = snapshot.particles.position
        diameters = snapshot.particles.diameter
    if box is None or positions is None:
        raise unusable(path, f"frame {index} has no box or no positions")
    lx, ly, lz, xy, xz, yz = (float(value) for value in box)
    vectors = np.array([[lx, 0.0, 0.0], [xy * ly, ly, 0.0], [xz * lz, yz * lz, lz]])
    radii = 0.5 * np.asarray(diameters, dtype=float) if stored and len(diameters) else None
    return RawFrame(np.asarray(positions, dtype=float), vectors, -0.5 * vectors.sum(axis=0), radii)


def read_xyz(path: Path, frame: int) -> RawFrame:
    """Extended XYZ: Lattice="ax ay az bx ... cz", Properties with pos:R:3 (and radius:R:1), Origin, pbc."""
    with _reading(path, "text file"), open(path, encoding="utf-8") as lines:
        # Negative frames count from the end: as many as that are kept while reading.
        kept: deque = deque(maxlen=1 if frame >= 0 else -frame)
        count = 0
        for comment, rows in _xyz_frames(lines, path):
            kept.append((comment, rows))
            count += 1
            if count == frame + 1:
                break
    _frame_index(frame, count, path)
    comment, rows = kept[0]
    keys = {key.lower(): quoted or bare for key, quoted, bare in XYZ_KEY.findall(comment)}
    if "lattice" not in keys:
        raise unusable(
            path, 'no Lattice="ax ay az bx by bz cx cy cz" in the comment line, so the cell is unknown'
        )
    if "f" in keys.get("pbc", "").lower():
        raise unusable(path, f"pbc is '{keys['pbc']}'; only fully periodic cells can be used")
    vectors = _xyz_numbers(keys["lattice"].split(), 9, "Lattice", path).reshape(3, 3)
    origin = _xyz_numbers(keys.get("origin", "0 0 0").split(), 3, "Origin", path)
    columns, width = _xyz_columns(keys.get("properties", "species:S:1:pos:R:3"), path)
    table = [row.split() for row in rows]
    for number, row in enumerate(table):
        if len(row) < width:
            raise unreadable(
                path, f"sphere {number} (counted from 0) has {len(row)} columns, Properties names {width}"
            )
    positions = [value for row in table for value in row[columns["pos"] : columns["pos"] + 3]]
    radii = [row[columns["radius"]] for row in table] if "radius" in columns else None
    return RawFrame(
        _xyz_numbers(positions, 3 * len(table), "pos", path).reshape(-1, 3),
        vectors,
        origin,
        None if radii is None or not radii else _xyz_numbers(radii, len(table), "radius", path),
    )


def read_run(path: Path, frame: int) -> RawFrame:
    """Folder of a run of ours or its trajectory.h5; from a folder also cycles that are not in that file yet.

    The radius is particles.radius of the run's own configuration.
    """
    from suspend.io import Run

    with Run(path) as run, _reading(path, "run"):
        stored = run.frame(_frame_index(frame, run.n_frames, path))
        length, shift = float(run.meta["L"]), float(stored["tilt"]) * float(run.meta["L"])
        radius = float(run.config["particles"].get("radius", 1.0))
    vectors = np.array([[length, 0.0, 0.0], [shift, length, 0.0], [0.0, 0.0, length]])
    return RawFrame(np.asarray(stored["position"], dtype=float), vectors, np.zeros(3), np.array(radius))


def read_h5md(path: Path, frame: int) -> RawFrame:
    """H5MD file: position and box/edges of /particles/spheres or its only group; ours go to `read_run`.

    Positions (frames,N,3) are taken in the stored cell of the same frame: edges (frames,3,3) with the cell
    vectors as rows, (frames,3) for a cuboid, or the same without frames for a fixed cell.
    """
    import h5py

    # Locks are for writers in place; a run replaces its file as a whole.
    with _reading(path, "HDF5 file"), h5py.File(path, "r", locking=False) as file:
        ours = "h5md/creator" in file and file["h5md/creator"].attrs.get("name") == "suspend"
        if not ours:
            positions, edges = _h5md_frame(file, path, frame)
    if ours:
        return read_run(path, frame)
    edges = np.asarray(edges, dtype=float)
    vectors = np.diag(edges) if edges.shape == (3,) else edges
    if vectors.shape != (3, 3):
        raise unusable(path, f"box edges have shape {edges.shape}, must be (3,) or (3, 3)")
    return RawFrame(positions, vectors, np.zeros(3), None)


def _h5md_frame(file, path: Path, frame: int) -> tuple[np.ndarray, np.ndarray]:
    """Positions (N,3) and edges (3,3) or (3,) of one frame of an open H5MD file."""
    groups = list(file["particles"]) if "particles" in file else []
    name = "spheres" if "spheres" in groups else groups[0] if len(groups) == 1 else None
    if name is None:
        raise unusable(path, f"no group /particles/spheres (in /particles: {', '.join(groups) or '-'})")
    group = file["particles"][name]
    for needed in ("position/value", "box/edges"):
        if needed not in group:
            raise unusable(path, f"no /particles/{name}/{needed}")
    position, edges = group["position/value"], group["box/edges"]
    index = _frame_index(frame, len(position), path)
    edges = edges["value"][index] if "value" in edges else edges[()]
    positions = np.asarray(position[index], dtype=float)
    return positions, edges


READERS: dict[str, Callable[[Path, int], RawFrame]] = {
    ".gsd": read_gsd,
    ".xyz": read_xyz,
    ".extxyz": read_xyz,
    ".npz": read_npz,
    ".h5": read_h5md,
    ".h5md": read_h5md,
}

XYZ_KEY = re.compile(r"""([A-Za-z_][\w-]*)\s*=\s*(?:["'{\[]([^"'}\]]*)["'}\]]|(\S+))""")


def unusable(path: Path | str, what: str) -> ConfigurationError:
    """Error to raise for a sound file that cannot be used here."""
    return ConfigurationError(f"initial configuration {path}: {what}")


def unreadable(path: Path | str, what: str) -> StorageError:
    """Error to raise for a file that is missing, damaged or not what its name says."""
    return StorageError(f"initial configuration {path}: {what}")


@contextlib.contextmanager
def _reading(path: Path, kind: str) -> Iterator[None]:
    """Turn whatever a library raises on an unreadable file into a StorageError that names the file."""
    try:
        yield
    except (OSError, EOFError, ValueError, TypeError, KeyError, RuntimeError, zipfile.BadZipFile) as error:
        # A missing import or our own errors pass; these are what gsd, h5py, zipfile and numpy raise.
        raise unreadable(
            path,
            f"cannot be read as {kind}, it is truncated, damaged or of another kind "
            f"({type(error).__name__}: {error})",
        ) from error


def _frame_index(frame: int, frames: int, path: Path) -> int:
    """Index >= 0 of `frame`, which may count from the end."""
    if not -frames <= frame < frames:
        raise unusable(path, f"particles.frame is {frame}, but the file holds {frames} frame(s)")
    return frame % frames


def _floats(values: np.ndarray, name: str, path: Path) -> np.ndarray:
    if values.dtype.kind not in "fiu":
        raise unusable(path, f"'{name}' is of type {values.dtype}, not numbers")
    return values.astype(float)


def _number(value, name: str, path: Path) -> float:
    array = _floats(np.asarray(value), name, path)
    if array.size != 1:
        raise unusable(path, f"'{name}' has shape {array.shape}, must be one number")
    return float(array.reshape(()))


def _xyz_frames(lines: Iterator[str], path: Path) -> Iterator[tuple[str, list[str]]]:
    """Comment and rows of each frame; StorageError where the text ends too early."""
    number = 0
    for head in lines:
        if not head.strip():
            continue
        if not _whole(head.strip()):
            raise unreadable(
                path, f"frame {number} must begin with the number of spheres, found '{head.strip()[:40]}'"
            )
        size = int(head)
        comment = next(lines, None)
        rows = list(itertools.islice(lines, size))
        if comment is None or len(rows) < size or not all(row.strip() for row in rows):
            raise unreadable(
                path,
                f"truncated, frame {number} announces {size} spheres and holds "
                f"{sum(1 for row in rows if row.strip())}; frames before it can be read with particles.frame",
            )
        yield comment, rows
        number += 1


def _xyz_columns(properties: str, path: Path) -> tuple[dict[str, int], int]:
    """First column of each property, and the number of columns."""
    fields = properties.split(":")
    if len(fields) % 3 or not all(_whole(width) and int(width) > 0 for width in fields[2::3]):
        raise unreadable(path, f"Properties={properties} is not name:type:columns:..., with one column or more each")
    columns, kinds, width = {}, {}, 0
    for name, kind, size in zip(fields[0::3], fields[1::3], fields[2::3], strict=True):
        if name.lower() in columns:
            raise unusable(path, f"Properties={properties} names {name} twice")
        columns[name.lower()], kinds[name.lower()] = width, f"{kind}:{int(size)}".lower()
        width += int(size)
    if kinds.get("pos") != "r:3":
        raise unusable(path, f"Properties={properties} has no pos:R:3")
    if kinds.get("radius", "r:1") not in ("r:1", "i:1"):
        raise unusable(path, f"Properties={properties}: radius must be one number a sphere, radius:R:1")
    return columns, width


def _whole(text: str) -> bool:
    """Whether a text is a whole number >= 0 in plain digits, of a size that a file can hold."""
    return text.isascii() and text.isdigit() and len(text) < 16


def _xyz_numbers(words: list[str], size: int, name: str, path: Path) -> np.ndarray:
    try:
        values = np.array(words, dtype=float)
    except ValueError as error:
        raise unreadable(path, f"{name} holds no number ({error})") from error
    if len(values) != size:
        raise unreadable(path, f"{name} has {len(values)} numbers, must have {size}")
    return values
