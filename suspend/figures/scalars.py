"""One number for every sphere of a stored frame: what pictures of configurations are coloured by."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from suspend.conventions import COMPONENTS
from suspend.errors import ConfigurationError

if TYPE_CHECKING:
    from suspend.io import Run

STRESS = "stress"
DISPLACEMENT = "displacement"
_STRESSES = {f"stress-{name}": np.eye(6)[i] for i, name in enumerate(COMPONENTS)} | {
    STRESS: np.eye(6)[COMPONENTS.index("xy")],
    "n1": np.array([1.0, -1.0, 0.0, 0.0, 0.0, 0.0]),
    "n2": np.array([0.0, 1.0, -1.0, 0.0, 0.0, 0.0]),
    "pressure": np.array([-1.0, -1.0, -1.0, 0.0, 0.0, 0.0]) / 3.0,
}
NAMES = (*_STRESSES, DISPLACEMENT, "none")
_SAME_PHASE = 1e-9  # of a cycle


@dataclass(frozen=True)
class Scalar:
    """A scalar of the spheres by name, its label, its column "name[unit]" and whether it has a sign.

    The stress of a sphere is its share of the bulk stress times the number of spheres, so that the mean over the
    spheres is the bulk stress without the fluid's own; in units of eta0 times the reference rate.
    """

    name: str
    label: str
    column: str
    signed: bool


def scalar_kind(name: str, run: Run) -> Scalar:
    """The scalar called `name`: one of NAMES, or a stored series with one number for every sphere.

    Raises ConfigurationError where there is none, or the run did not store what it needs.
    """
    name = name.lower() if name.lower() in NAMES else name
    fields = run.fields if run.stored else []
    if name in _STRESSES:
        if "particle_stress" not in fields:
            raise ConfigurationError(
                f"{run.path}: the stress of every sphere is not stored; run with output.particle_stress: true, or "
                f"colour by {DISPLACEMENT} or none (--colour)"
            )
        short = name.removeprefix("stress-").removeprefix(STRESS) or "xy"
        symbol = {"n1": "N_{1,i}", "n2": "N_{2,i}", "pressure": "p_i"}.get(short, rf"\sigma_{{{short},i}}")
        rate = r"\gamma_0\omega" if _oscillatory(run) else r"|\dot\gamma|"
        return Scalar(name, rf"$N\,{symbol}/\eta_0{rate}$", f"{name}[eta0*rate]", True)
    if name == DISPLACEMENT:
        if not _oscillatory(run):
            raise ConfigurationError(f"{run.path}: displacements over a cycle need oscillatory shear (flow.type)")
        return Scalar(name, r"$|\Delta_i|/a$ over the cycle", f"{name}[a]", False)
    if name == "none":
        return Scalar(name, "", "", False)
    if name not in fields or np.shape(run.series(name, 0, 1))[1:] != (int(run.meta["number"]),):
        raise ConfigurationError(
            f"{run.path}: no scalar {name!r} of the spheres is stored; there are {', '.join(NAMES)}, "
            "and stored series with one number for every sphere"
        )
    return Scalar(name, name, f"{name}[units of the configuration]", True)


def _oscillatory(run: Run) -> bool:
    return run.config["flow"]["type"] == "oscillatory"


def scalar_of_frame(scalar: Scalar, run: Run, frame: dict, scales: dict) -> np.ndarray:
    """Its values (N,) at a frame. Raises ConfigurationError where no sample was taken at the frame's phase."""
    number = len(frame["position"])
    if scalar.name == "none":
        return np.zeros(number)
    if scalar.name == DISPLACEMENT:
        return _displacement(run, frame["cycle"], scales["radius"])
    name = "particle_stress" if scalar.name in _STRESSES else scalar.name
    k = frame["cycle"]
    if k >= run.stored:
        raise ConfigurationError(f"{run.path}: no stresses are stored at the final frame; choose an earlier cycle")
    phases = run.series("phase", k, k + 1)
    found = np.flatnonzero(np.abs(phases - frame["phase"]) < _SAME_PHASE)
    if not found.size:
        raise ConfigurationError(
            f"{run.path}: no stress sample at phase {frame['phase']:g} of cycle {k}; run with output.position_phases "
            f"that are multiples of 1/output.samples_per_cycle = 1/{len(phases)}"
        )
    row = run.series(name, k, k + 1)[found[0]]
    if name != "particle_stress":
        return row
    rate = scales["gamma0"] * scales["omega"] if "omega" in scales else abs(scales["rate"])
    return number * (row @ _STRESSES[scalar.name]) / (scales["viscosity"] * rate)


def _displacement(run: Run, cycle: int, radius: float) -> np.ndarray:
    """|Delta|/a of every sphere from the start of `cycle` to that of the next, relative to the mean."""
    from suspend.analysis.displacements import frame_number, relative_displacement

    ends = [run.frame(frame_number(run, cycle, phase))["unwrapped"] for phase in (0.0, 1.0)]
    return np.linalg.norm(relative_displacement(*ends, radius), axis=1)
