"""What a one-shot problem is given: spheres in a periodic cell, a flow, a method; all of it validated."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np

from suspend.box import wrap
from suspend.config.schema import COARSEST, FINEST, Ewald, Lubrication
from suspend.errors import ConfigurationError
from suspend.structure import smallest_distance

FARTHEST = 1e9  # radii
LOST = "beyond, double precision does not hold the gaps between spheres (to 1e-7 radii); wrap the positions"
COINCIDENT = 1e-6  # radii: centres closer than this have no line of centres
FAR_FIELDS = ("ewald", "self", "identity")
SHARE = 0.1  # of the accuracy asked for: each solve and the Ewald sum are done to it


@dataclass(frozen=True)
class PeriodicScene:
    """Equal spheres of radius 1 in the cell with vectors (edge,0,0), (tilt edge, edge, 0), (0,0,edge).

    positions : (N, 3), anywhere (they are wrapped for computing); edge : L in radii; tilt : any number, the
    shift of the upper image divided by L; all lengths up to FARTHEST. Raises ConfigurationError for what is no such
    scene.
    """

    positions: np.ndarray
    edge: float
    tilt: float = 0.0

    def __post_init__(self) -> None:
        positions = vectors_of("positions", self.positions)
        if len(positions) == 0:
            raise ConfigurationError("positions: hold no spheres (N = 0)")
        edge, tilt = number_of("edge (L)", self.edge), number_of("tilt", self.tilt)
        if edge <= 0.0:
            raise ConfigurationError(f"edge (L): found {edge:g}; must be > 0")
        _check_resolved(positions, edge, tilt)
        positions.setflags(write=False)
        object.__setattr__(self, "positions", positions)
        object.__setattr__(self, "edge", edge)
        object.__setattr__(self, "tilt", tilt)

    @property
    def number(self) -> int:
        """Number of spheres N."""
        return len(self.positions)

    @property
    def density(self) -> float:
        """Spheres per volume, N / L^3."""
        return self.number / self.edge**3

    @property
    def volume_fraction(self) -> float:
        """phi = (4/3) pi N / L^3."""
        return 4.0 / 3.0 * math.pi * self.density

    @property
    def reduced_tilt(self) -> float:
        """The tilt in [-1/2, 1/2) that spans the same lattice."""
        return self.tilt - math.floor(self.tilt + 0.5)

    def wrapped(self) -> np.ndarray:
        """Positions in the cell of the reduced tilt, (N, 3)."""
        return wrap(self.positions, self.edge, self.reduced_tilt)

    def closest(self) -> tuple[float, int, int]:
        """Smallest surface gap (radii) and its two spheres, counted from 0 (equal: a sphere and its image)."""
        distance, first, second = smallest_distance(self.positions, self.edge, self.reduced_tilt)
        return distance - 2.0, min(first, second), max(first, second)


@dataclass(frozen=True)
class Method:
    """How a one-shot problem is solved.

    far_field : `ewald`, `self` or `identity`; lubrication : `suspend.config.Lubrication` (its default: cutoff 4,
    shifted); accuracy : relative error of the answer, 1e-10 to 1e-2. Each solve and the Ewald sum are done to a
    tenth of it (the Ewald sum to 1e-10 at best, its round-off) unless near_tolerance, far_tolerance or
    ewald.tolerance say otherwise. ewald : `suspend.config.Ewald`, choices by hand.
    """

    far_field: str = "ewald"
    lubrication: Lubrication = field(default_factory=Lubrication)
    accuracy: float = 1e-6
    ewald: Ewald | None = None
    near_tolerance: float | None = None
    far_tolerance: float | None = None
    max_iterations: int = 2000
    threads: int = 1

    def __post_init__(self) -> None:
        if self.far_field not in FAR_FIELDS:
            raise ConfigurationError(f"far_field: found {self.far_field!r}; must be {' | '.join(FAR_FIELDS)}")
        if not FINEST <= self.accuracy <= COARSEST:
            raise ConfigurationError(
                f"accuracy: found {self.accuracy:g}; must be from {FINEST:g} (finer is lost in round-off) to"
                f" {COARSEST:g}"
            )
        if self.ewald is not None and self.far_field != "ewald":
            raise ConfigurationError(
                f"ewald: far_field is {self.far_field}, must be ewald for it to mean anything"
            )

    @property
    def near_target(self) -> float:
        """Relative error (energy norm) of a near-field solve."""
        return self.near_tolerance if self.near_tolerance is not None else SHARE * self.accuracy

    @property
    def far_target(self) -> float:
        """Relative true residual of a solve with the far field."""
        return self.far_tolerance if self.far_tolerance is not None else SHARE * self.accuracy

    @property
    def ewald_target(self) -> float:
        """Relative error of a mobility product."""
        given = self.ewald.tolerance if self.ewald is not None else None
        return given if given is not None else max(SHARE * self.accuracy, FINEST)

    def check(self, scene: PeriodicScene) -> None:
        """Raise ConfigurationError where this method cannot be used for a scene."""
        gap, first, second = scene.closest()
        pair = f"spheres {first} and {second} (counted from 0)"
        if first == second:
            pair = f"sphere {first} (counted from 0) and its own periodic image"
        if gap < COINCIDENT - 2.0:
            raise ConfigurationError(f"{pair} are at the same place (distance {gap + 2.0:.3g} radii)")
        if self.far_field == "ewald" and scene.edge < 2.0:
            raise ConfigurationError(
                f"edge (L): {scene.edge:g} radii is too small a cell for far_field: ewald; must be >= 2, or each"
                " sphere overlaps its own image"
            )
        if self.lubrication.enabled and self.lubrication.minimum_gap <= 0.0 and gap <= 0.0:
            raise ConfigurationError(
                f"{pair} touch or overlap, gap {gap:.3g} radii; lubrication has no meaning there: separate them,"
                " freeze lubrication below a gap with lubrication.minimum_gap, or leave lubrication out"
            )


def _check_resolved(positions: np.ndarray, edge: float, tilt: float) -> None:
    """Refuse lengths so large that double precision has lost the gaps between the spheres."""
    for name, value in (("edge (L)", edge), ("tilt times the edge", tilt * edge)):
        if abs(value) > FARTHEST:
            raise ConfigurationError(f"{name}: found {value:g}; must be at most {FARTHEST:g} radii: {LOST}")
    far = np.flatnonzero(np.abs(positions).max(axis=1) > FARTHEST)
    if len(far):
        raise ConfigurationError(
            f"positions: sphere {far[0]} (counted from 0) is at {positions[far[0]]}; coordinates must be at most "
            f"{FARTHEST:g} radii: {LOST}"
        )


def number_of(name: str, value) -> float:
    """One finite real number, else ConfigurationError."""
    array = floats_of(name, value)
    if array.size != 1:
        raise ConfigurationError(f"{name}: has shape {array.shape}, must be one number")
    return float(array.reshape(()))


def vectors_of(name: str, value, number: int | None = None) -> np.ndarray:
    """(N, 3) finite float64, a copy; ConfigurationError otherwise or where N is not `number`."""
    array = floats_of(name, value)
    wanted = "(N, 3)" if number is None else f"({number}, 3)"
    if array.size == 0 and number is None:
        return np.empty((0, 3))
    if array.ndim != 2 or array.shape[1] != 3 or (number is not None and len(array) != number):
        raise ConfigurationError(f"{name}: has shape {array.shape}, must be {wanted}")
    return np.array(array, dtype=float, order="C")


def floats_of(name: str, value) -> np.ndarray:
    """Finite real numbers as a float64 array, else ConfigurationError."""
    try:
        array = np.asarray(value)
    except ValueError as error:
        raise ConfigurationError(f"{name}: is no array of numbers ({error})") from None
    if array.dtype.kind not in "fiu":
        raise ConfigurationError(f"{name}: is of type {array.dtype}, must be real numbers")
    broken = np.argwhere(~np.isfinite(array))
    if len(broken):
        where = f" of sphere {broken[0][0]} (counted from 0)" if array.ndim == 2 else ""
        raise ConfigurationError(f"{name}: {len(broken)} entries are not finite, the first{where}")
    return array.astype(float)


def strain_rate_tensor(strain_rate) -> np.ndarray:
    """Strain rate E (3, 3): None = no flow; a number = simple shear u = rate y e_x; or a tensor.

    The tensor must be symmetric and traceless (to 1e-12 of its size). Raises ConfigurationError.
    """
    if strain_rate is None:
        return np.zeros((3, 3))
    array = floats_of("strain_rate", strain_rate)
    if array.size == 1:
        tensor = np.zeros((3, 3))
        tensor[0, 1] = tensor[1, 0] = 0.5 * float(array.reshape(()))
        return tensor
    if array.shape != (3, 3):
        raise ConfigurationError(f"strain_rate: has shape {array.shape}, must be a shear rate or (3, 3)")
    size = np.abs(array).max()
    if np.abs(array - array.T).max() > 1e-12 * size:
        raise ConfigurationError("strain_rate: is not symmetric; the vorticity of a flow moves spheres with it and"
                                 " has no part in the problem")  # fmt: skip
    if abs(np.trace(array)) > 1e-12 * size:
        raise ConfigurationError(
            f"strain_rate: has the trace {np.trace(array):g}, must be 0 (incompressible)"
        )
    return array
