"""Starting configurations: a packing made here, or read from GSD, extended XYZ, npz or a run of ours.

Whatever the source, positions come out wrapped into the cell (L,0,0), (tilt L, L, 0), (0,0,L) with its
corner at the origin and tilt in [-1/2, 1/2).
"""

from __future__ import annotations

import math
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from suspend.box import wrap
from suspend.config.physics import PACKED
from suspend.configuration_files import READERS, RawFrame, read_run, unreadable, unusable
from suspend.structure import smallest_distance

if TYPE_CHECKING:
    from suspend.config import Config
    from suspend.packing import Packing

CELL_TOLERANCE = 1e-5  # relative, of the cell's shape: GSD holds float32, text files few digits
FRACTION_TOLERANCE = 1e-4  # relative, between the volume fractions of file and configuration
FARTHEST = 1e6  # cells: beyond, the place within the cell is lost in rounding (worse than 1e-10 L)
COINCIDENT = 1e-6  # radii: centres closer than this have no line of centres


class InitialConfiguration(NamedTuple):
    """A configuration to start from; lengths in the file's unit when just loaded, in radii when prepared."""

    positions: np.ndarray  # (N,3), wrapped into the cell
    length: float  # L
    tilt: float  # in [-1/2, 1/2)
    radius: float | None  # of the spheres, where the file says so; 1 from `prepare_initial`
    source: str  # the path, or the kind of packing
    minimum_gap: float | None = None  # radii, over all pairs and images; None from `load_configuration`
    closest_pair: tuple[int, int] | None = None  # the spheres it is between, counted from 0
    packing: Packing | None = None  # the report of a packing made here


def load_configuration(path: str | Path, frame: int = -1) -> InitialConfiguration:
    """Read one frame of a configuration file; lengths in the file's unit.

    .gsd (HOOMD schema; centred cell shifted to the origin), .xyz/.extxyz (extended XYZ with Lattice and pos,
    radius if there), .npz (positions (N,3), L, optional tilt or shift = tilt L, optional radius), .h5/.h5md
    (H5MD) or the folder of a run. The cell must be cubic, sheared at most in xy. Raises StorageError for a
    file that is missing, truncated or not what its name says, ConfigurationError for one of no use here.
    """
    path = Path(path)
    if not path.exists():
        raise unreadable(path, "no such file or folder")
    suffix = path.suffix.lower()
    if not path.is_dir() and suffix not in READERS:
        raise unusable(
            path,
            f"unknown kind of file '{path.suffix}'; known are {', '.join(READERS)} and the folder of a run",
        )
    if path.is_dir() and not (path / "trajectory.h5").is_file():
        raise unreadable(path, "the folder holds no trajectory.h5, so it is no run")
    raw = read_run(path, frame) if path.is_dir() else READERS[suffix](path, frame)
    _check_positions(raw.positions, path)
    length, tilt = _cubic_cell(raw.vectors, path)
    _check_far_away(raw, length, path)
    positions = wrap(raw.positions - raw.origin, length, tilt)
    return InitialConfiguration(positions, length, tilt, _common_radius(raw, path), str(path))


def prepare_initial(config: Config, base_directory: str | Path = ".") -> InitialConfiguration:
    """The starting configuration that `config.particles` asks for, lengths in sphere radii.

    'equilibrium' and 'quenched' make a packing of `suspend.packing` with config.seed. Otherwise `particles.initial` is
    a path relative to `base_directory`; its lengths are divided by the radius the file gives, else by
    particles.radius; number and volume fraction must be those of the configuration (to 1e-4; the file's own cell is
    kept).
    Raises ConfigurationError where they are not, where centres coincide, and where spheres overlap although
    lubrication (not frozen by lubrication.minimum_gap) has no meaning there and no contact term is on.
    """
    particles = config.particles
    if particles.initial in PACKED:
        from suspend.packing import PACKINGS

        packing = PACKINGS[particles.initial](
            particles.number, particles.volume_fraction, particles.minimum_gap, config.seed
        )
        gap, first, second = smallest_distance(packing.positions, packing.length)
        return InitialConfiguration(
            packing.positions, packing.length, 0.0, 1.0, packing.kind, gap - 2.0, (first, second), packing
        )
    loaded = load_configuration(Path(base_directory) / particles.initial, particles.frame)
    radius = loaded.radius if loaded.radius is not None else particles.radius
    positions, length = loaded.positions / radius, loaded.length / radius
    _check_agreement(len(positions), length, radius, particles, loaded.source)
    # Dividing can round a coordinate just below the edge up to it.
    positions = wrap(positions, length, loaded.tilt)
    distance, first, second = smallest_distance(positions, length, loaded.tilt)
    _check_overlap(distance, first, second, config, loaded.source)
    return InitialConfiguration(
        positions, length, loaded.tilt, 1.0, loaded.source, distance - 2.0, (first, second)
    )


def _check_positions(positions: np.ndarray, source: Path) -> None:
    if positions.ndim != 2 or positions.shape[1] != 3:
        raise unusable(source, f"positions have shape {positions.shape}, must be (N, 3)")
    if len(positions) == 0:
        raise unusable(source, "holds no spheres")
    broken = np.flatnonzero(~np.isfinite(positions).all(axis=1))
    if len(broken):
        raise unusable(
            source,
            f"{len(broken)} position(s) are not finite numbers, the first of "
            f"sphere {broken[0]} (counted from 0): {positions[broken[0]]}",
        )


def _check_far_away(raw: RawFrame, length: float, source: Path) -> None:
    """Refuse what lies so many cells away that rounding has moved it within the cell."""
    cells = np.abs(raw.positions - raw.origin).max(axis=1) / length
    if not cells.max() <= FARTHEST:
        worst = int(np.argmax(np.where(np.isfinite(cells), cells, np.inf)))
        raise unusable(
            source,
            f"sphere {worst} (counted from 0) lies {cells[worst]:.3g} cells away, must be at most {FARTHEST:g}: "
            "rounding has moved it within the cell; write wrapped positions",
        )
    if not abs(raw.vectors[1, 0]) <= FARTHEST * length:
        raise unusable(
            source,
            f"the tilt is {raw.vectors[1, 0] / length:.3g}, must be at most {FARTHEST:g}: rounding has spoilt its "
            "fraction; write it reduced to -1/2 to 1/2",
        )


def _cubic_cell(vectors: np.ndarray, source: Path) -> tuple[float, float]:
    """Edge and tilt in [-1/2, 1/2) of the cell with these vectors (rows); an error if it is another cell."""
    vectors = np.asarray(vectors, dtype=float)
    length = float(vectors[0, 0])
    if not (np.isfinite(vectors).all() and length > 0.0):
        raise unusable(source, f"cell vectors {vectors.tolist()} are not finite with a positive edge")
    allowed = length * np.eye(3)
    allowed[1, 0] = vectors[1, 0]
    if np.max(np.abs(vectors - allowed)) > CELL_TOLERANCE * length:
        raise unusable(
            source,
            f"cell vectors {vectors.tolist()} are not (L,0,0), (tilt L, L, 0), "
            "(0,0,L); only a cubic cell sheared in xy can be used",
        )
    tilt = float(vectors[1, 0]) / length
    return length, tilt - math.floor(tilt + 0.5)


def _common_radius(raw: RawFrame, source: Path) -> float | None:
    """The one radius of all spheres, None where the file gives none."""
    if raw.radii is None:
        return None
    radii = np.atleast_1d(np.asarray(raw.radii, dtype=float))
    if radii.shape not in ((1,), (len(raw.positions),)):
        raise unusable(source, f"radius has shape {radii.shape}, must be one number or one a sphere")
    low, high = float(radii.min()), float(radii.max())
    if not (np.isfinite(radii).all() and low > 0.0):
        raise unusable(source, f"radii must be positive, found {low:g} to {high:g}")
    if high - low > 1e-6 * high:
        raise unusable(source, f"radii range from {low:g} to {high:g}; only equal spheres can be used")
    return float(radii[0])


def _check_agreement(number: int, length: float, radius: float, particles, source: str) -> None:
    if number != particles.number:
        raise unusable(source, f"holds {number} spheres, but particles.number is {particles.number}")
    found = number * (4.0 / 3.0) * math.pi / length**3
    if abs(found - particles.volume_fraction) > FRACTION_TOLERANCE * particles.volume_fraction:
        raise unusable(
            source,
            f"its volume fraction is {found:.8g} ({number} spheres of radius "
            f"{radius:g} in a cell of edge {length * radius:g}), but particles.volume_fraction is "
            f"{particles.volume_fraction:.8g}; correct that key, particles.radius or the file",
        )


def _check_overlap(distance: float, first: int, second: int, config: Config, source: str) -> None:
    pair = f"spheres {first} and {second} (counted from 0)"
    if first == second:
        pair = f"sphere {first} (counted from 0) and its own periodic image"
    if distance < COINCIDENT:
        raise unusable(source, f"{pair} are at the same place (distance {distance:.3g} radii)")
    lubrication = config.lubrication
    defined = config.contact is not None or not lubrication.enabled or lubrication.minimum_gap > 0.0
    if distance <= 2.0 and not defined:
        raise unusable(
            source,
            f"{pair} touch or overlap, gap {distance - 2.0:.3g} radii; "
            "lubrication has no meaning there: separate them, add a contact section, or freeze lubrication "
            "below a gap with lubrication.minimum_gap",
        )
