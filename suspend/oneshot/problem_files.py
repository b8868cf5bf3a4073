"""From a scene file to a mobility problem: a configuration (YAML, its start), or an npz archive of arrays."""

from __future__ import annotations

import difflib
import zipfile
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from suspend.config import Config, from_dict, load
from suspend.errors import ConfigurationError, StorageError
from suspend.oneshot.problems import Motions, mobility_problem
from suspend.oneshot.scene import Method, PeriodicScene, number_of, vectors_of

ARRAYS = ("positions", "L", "shift", "tilt", "forces", "torques", "shear_rate", "radius", "a")
SETTABLE = ("far_field", "ewald", "lubrication", "solver")  # of a configuration, for a scene of arrays
ARREST = 1e-12  # of Gamma: the shear rate at the turning point of an oscillation is this but for rounding


@dataclass(frozen=True)
class Problem:
    """A mobility problem and where it comes from. Loads, rate and answer in units of radius, viscosity and rate.

    pair_stress : -1/2 sum (x_i - x_j) F_ij of the configuration's pair forces, xy component, summed over spheres;
    ignored : what the file holds and the problem does not use.
    """

    source: str
    scene: PeriodicScene
    method: Method
    forces: np.ndarray
    torques: np.ndarray
    shear_rate: float
    pair_stress: float = 0.0
    ignored: tuple[str, ...] = ()

    def solve(self) -> Motions:
        """The answer; eta_r includes the stress of the pair forces. Raises what `mobility_problem` raises."""
        answer = mobility_problem(self.scene, self.forces, self.torques, self.shear_rate, self.method)
        if answer.eta_r is None or self.pair_stress == 0.0:
            return answer
        contribution = 6.0 * np.pi * self.pair_stress / (self.scene.edge**3 * self.shear_rate)
        return replace(answer, eta_r=answer.eta_r + contribution)


@dataclass(frozen=True)
class Choices:
    """What the user asks for besides the scene; None leaves it to the file (an npz: ewald, with lubrication)."""

    far_field: str | None = None
    lubrication: bool = True
    accuracy: float = 1e-6
    overrides: tuple[str, ...] = ()
    threads: int = 1

    def configured(self) -> list[str]:
        """All choices as overrides of a configuration."""
        result = []
        if self.far_field is not None:
            result.append(f"far_field={self.far_field}")
            if self.far_field != "ewald":  # what the file says of the far field that is off
                result += ["ewald=null", "solver.far_tolerance=null"]
        if not self.lubrication:
            result.append("lubrication.enabled=false")
        return result + list(self.overrides)

    def method(self, config: Config) -> Method:
        """How to solve at these choices in the place of the configuration's own tolerances."""
        return method_of(config, self.named(), self.accuracy, self.threads)

    def named(self) -> set[str]:
        """Keys that --set gives."""
        return {entry.partition("=")[0].strip() for entry in self.overrides}


def read_problem(path: str | Path, choices: Choices | None = None) -> Problem:
    """The mobility problem of a scene file: `.npz` arrays, anything else a configuration in YAML.

    Raises ConfigurationError (not a usable scene) and StorageError (cannot be read).
    """
    choices = choices or Choices()
    if "tolerance" in choices.named():
        raise ConfigurationError(
            "--set: tolerance: is that of a run; the accuracy of a solution is --accuracy"
        )
    path = Path(path)
    return _from_npz(path, choices) if path.suffix.lower() == ".npz" else _from_configuration(path, choices)


def method_of(config: Config, named: set[str], accuracy: float, threads: int) -> Method:
    """Method of a configuration at the accuracy asked for.

    The tolerances of a run count only where they are among the keys `named` by --set.
    """
    solver, ewald = config.solver, config.ewald
    if ewald is not None and not {"ewald", "ewald.tolerance"} & named:
        ewald = replace(ewald, tolerance=None)
    return Method(
        far_field=config.far_field,
        lubrication=config.lubrication,
        accuracy=accuracy,
        ewald=ewald,
        near_tolerance=solver.tolerance if "solver.tolerance" in named else None,
        far_tolerance=solver.far_tolerance if "solver.far_tolerance" in named else None,
        max_iterations=solver.max_iterations,
        threads=threads,
    )


def _from_configuration(path: Path, choices: Choices) -> Problem:
    config = load(path, choices.configured())
    method = choices.method(config)
    from suspend.flow import make_flow
    from suspend.initial import prepare_initial

    initial, rate = prepare_initial(config, config.directory), make_flow(config).rate(0, 0.0)
    scene = PeriodicScene(initial.positions, initial.length, initial.tilt)
    load_each = np.zeros((scene.number, 6))
    if config.external is not None:
        load_each += np.concatenate([config.external.force, config.external.torque])
    stress = _add_pair_forces(config, scene, load_each)
    return Problem(
        source=str(path),
        scene=scene,
        method=method,
        forces=load_each[:, :3],
        torques=load_each[:, 3:],
        shear_rate=rate if abs(rate) > ARREST else 0.0,
        pair_stress=stress,
    )


def _add_pair_forces(config: Config, scene: PeriodicScene, loads: np.ndarray) -> float:
    """Add repulsion and contact to `loads` (N, 6); returns the xy stress, summed over the spheres."""
    from suspend.core.pairs import PlacedPairs
    from suspend.forces import interaction_range, pair_force, pair_forces
    from suspend.hydro.neighbours import find_pairs
    from suspend.hydro.rows import split_rows

    force = pair_force(config.repulsion, config.contact)
    reach = interaction_range(force)
    if reach <= 0.0:
        return 0.0
    position, tilt = scene.wrapped(), scene.reduced_tilt
    pairs, offset = find_pairs(position, scene.edge, tilt, reach)
    placed = PlacedPairs(pairs, offset, position, scene.edge, tilt)
    stress, _ = pair_forces(split_rows(offset, 1), placed, force, reach, loads)
    return float(stress[3])


def _from_npz(path: Path, choices: Choices) -> Problem:
    for name in sorted(choices.named()):
        if name.partition(".")[0] not in SETTABLE:
            known = ", ".join(SETTABLE)
            raise ConfigurationError(
                f"--set: {name}: has no part in a scene of arrays; what counts is {known}"
            )
    arrays = _read_arrays(path)
    try:
        scene, forces, torques, rate = _problem_of(arrays)
    except ConfigurationError as error:
        raise ConfigurationError(f"{path}: {error}") from None
    base = {
        "particles": {"number": 2, "volume_fraction": 0.1},  # the arrays say what these are
        "flow": {"type": "quiescent"},
        "duration": {"strain": 1.0},
        "far_field": "ewald",
    }
    config = from_dict(base, source="--set", overrides=choices.configured())
    ignored = tuple(sorted(set(arrays) - set(ARRAYS)))
    return Problem(str(path), scene, choices.method(config), forces, torques, rate, ignored=ignored)


def _read_arrays(path: Path) -> dict[str, np.ndarray]:
    try:
        with np.load(path, allow_pickle=False) as archive:
            arrays = {name: archive[name] for name in archive.files}
    except FileNotFoundError:
        raise StorageError(f"{path}: no such file") from None
    except (OSError, EOFError, ValueError, TypeError, KeyError, AttributeError, zipfile.BadZipFile) as error:
        raise StorageError(
            f"{path}: cannot be read as an npz archive of arrays, it is damaged or of another kind"
            f" ({type(error).__name__}: {error})"
        ) from error
    return arrays


def _problem_of(arrays: dict[str, np.ndarray]) -> tuple[PeriodicScene, np.ndarray, np.ndarray, float]:
    """Scene, forces, torques, shear rate of the arrays; ConfigurationError says which array is wrong and how."""
    _check_names(arrays)
    edge = number_of("L", arrays["L"])
    if edge <= 0.0:
        raise ConfigurationError(f"L: found {edge:g}; must be > 0")
    for name in ("radius", "a"):
        if name in arrays and (np.size(arrays[name]) == 0 or np.any(np.asarray(arrays[name]) != 1.0)):
            raise ConfigurationError(
                f"{name}: must be 1: lengths are in sphere radii; divide positions, L and shift by the radius"
            )
    tilt = number_of("tilt", arrays.get("tilt", 0.0))
    if "shift" in arrays:
        shift = number_of("shift", arrays["shift"])
        if not 0.0 <= shift < edge:
            raise ConfigurationError(
                f"shift: found {shift:g}; must be >= 0 and < L = {edge:g} (add or subtract L)"
            )
        tilt = shift / edge
    scene = PeriodicScene(arrays["positions"], edge, tilt)
    nothing = np.zeros((scene.number, 3))
    forces = vectors_of("forces", arrays.get("forces", nothing), scene.number)
    torques = vectors_of("torques", arrays.get("torques", nothing), scene.number)
    return scene, forces, torques, number_of("shear_rate", arrays.get("shear_rate", 0.0))


def _check_names(arrays: dict[str, np.ndarray]) -> None:
    for name in sorted(set(arrays) - set(ARRAYS)):
        close = difflib.get_close_matches(name, [known for known in ARRAYS if len(known) > 1], 1, 0.75)
        if close and close[0] not in arrays:
            raise ConfigurationError(f"{name}: unknown array; did you mean {close[0]}?")
    for name in ("positions", "L"):
        if name not in arrays:
            raise ConfigurationError(
                f"no array '{name}' (found {', '.join(arrays) or 'nothing'}); needed are positions (N, 3) and L,"
                " optional shift, forces (N, 3), torques (N, 3) and shear_rate"
            )
    if "tilt" in arrays and "shift" in arrays:
        raise ConfigurationError("holds both tilt and shift (= tilt L); keep one of them")
