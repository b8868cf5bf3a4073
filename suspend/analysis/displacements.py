"""Displacements of the spheres between equal strains: D_cyc, its tensor, and clouds after a part of a cycle."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any, Self

import numpy as np

from suspend.analysis.quantity import Quantity
from suspend.analysis.summary import read_scales
from suspend.errors import ConfigurationError, StorageError
from suspend.io import Run

AXES = ("x", "y", "z")
COMPONENT_PAIRS = ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2))
_FRAME_BYTES = 16 << 20  # cycle starts held at a time
_SAME_PHASE = 1e-9  # of a cycle
_SAME_STRAIN = 1e-9  # of gamma0


def oscillatory_scales(run: Run) -> dict[str, float]:
    """Scales of an oscillatory run, see `read_scales`. Raises ConfigurationError for any other flow."""
    flow, scales = read_scales(run)
    if flow != "oscillatory":
        raise ConfigurationError(
            f"{run.path}: cycles are compared in oscillatory shear only, this run is {flow} shear: use "
            "SelfDiffusion of suspend.analysis.diffusion"
        )
    return scales


def cycle_starts(run: Run) -> Iterator[np.ndarray]:
    """Unwrapped positions (N, 3) at the cycle starts and at the end of the last complete cycle, one by one.

    At equal strain, in the run's unit of length. Memory: 16 MB or two frames. The end is absent while the run goes on.
    """
    chunk = max(1, _FRAME_BYTES // (24 * int(run.meta["number"])))
    wanted = run.cycles + 1
    for frames in run.cycle_start_unwrapped(chunk):
        yield from frames[:wanted]
        wanted -= min(len(frames), wanted)
        if wanted == 0:
            return


def cycle_displacements(run: Run, radius: float) -> Iterator[np.ndarray]:
    """Displacement (N, 3) of every sphere over each complete cycle, in radii, relative to the mean displacement."""
    before = None
    for after in cycle_starts(run):
        if before is not None:
            yield relative_displacement(before, after, radius)
        before = after


def relative_displacement(before: np.ndarray, after: np.ndarray, radius: float = 1.0) -> np.ndarray:
    """Displacement (N, 3) in radii relative to the mean one, which mixes nothing (see `mean_square_displacement`)."""
    displacement = (after - before) / radius
    return displacement - displacement.mean(axis=0)


def require_spheres(run: Run, least: int = 2) -> None:
    """Raise ConfigurationError where the run has fewer spheres than a displacement relative to the mean needs."""
    number = int(run.meta["number"])
    if number < least:
        raise ConfigurationError(
            f"{run.path}: {number} sphere(s); displacements relative to their mean need {least} or more"
        )


class CyclicDiffusivity(Quantity):
    """D_cyc of every cycle and its tensor D_ab = <Delta_a Delta_b>/(2 gamma_cyc a^2), gamma_cyc = 4 gamma0.

    The trace of the tensor is the paper's D_cyc, <(Delta/a)^2> = 2 D_cyc gamma_cyc: the sum over the three directions,
    not their mean. Displacements are relative to the mean one of the cycle, which lowers D by the factor 1 - 1/N.
    The error is the standard error of the mean over spheres taken as independent: too small where they move together.
    """

    def compute(self, run: Run) -> Self:
        """Compute from the positions at the cycle starts; ConfigurationError without oscillation or for one sphere."""
        scales = oscillatory_scales(run)
        require_spheres(run)
        unit = 8.0 * scales["gamma0"]
        tensors, errors = [], []
        for displacement in cycle_displacements(run, scales["radius"]):
            number = len(displacement)
            tensors.append(displacement.T @ displacement / (number * unit))
            squares = np.einsum("ij,ij->i", displacement, displacement)
            errors.append(squares.std(ddof=1) / (np.sqrt(number) * unit))
        self._tensor, self._errors = np.array(tensors).reshape(-1, 3, 3), np.array(errors)
        self._gamma0, self._missing = scales["gamma0"], run.cycles - len(tensors)
        return self

    @property
    def tensor(self) -> np.ndarray:
        """D_ab (cycles, 3, 3) per unit of accumulated strain, in a^2: symmetric, trace D_cyc."""
        return self._tensor

    @property
    def d_cyc(self) -> np.ndarray:
        """D_cyc (cycles,), dimensionless."""
        return np.trace(self._tensor, axis1=1, axis2=2)

    @property
    def standard_error(self) -> np.ndarray:
        """Standard error of D_cyc (cycles,) over the spheres, dimensionless."""
        return self._errors

    @property
    def total_strain(self) -> np.ndarray:
        """gamma_tot = 4 gamma0 n_cyc at the end of each cycle, dimensionless."""
        return 4.0 * self._gamma0 * np.arange(1, len(self._tensor) + 1)

    @property
    def notes(self) -> list[str]:
        """What is missing."""
        if self._missing <= 0:
            return []
        return [f"D_cyc of {self._missing} cycle(s) is not known: the positions at the end are not stored (yet)"]

    def table(self) -> dict[str, np.ndarray]:
        """Columns total_strain, D_cyc, its standard error, and the six components."""
        columns = {"total_strain[-]": self.total_strain, "D_cyc[-]": self.d_cyc}
        columns["D_cyc_standard_error[-]"] = self.standard_error
        for a, b in COMPONENT_PAIRS:
            columns[f"D_{AXES[a]}{AXES[b]}[-]"] = self._tensor[:, a, b]
        return columns

    def summary(self) -> dict[str, Any]:
        """D_cyc of the last cycle, its error and components."""
        if not len(self._tensor):
            return {"cycles": 0, "notes": self.notes}
        last = {name.removesuffix("[-]"): float(column[-1]) for name, column in self.table().items()}
        return {"cycles": len(self._tensor), **last, "notes": self.notes}

    def plot(self, ax) -> None:
        """D_cyc and the diagonal of its tensor against accumulated strain, logarithmic."""
        ax.loglog(self.total_strain, self.d_cyc, color="black", label=r"$D_\mathrm{cyc}$")
        for a, color in enumerate(("#0072B2", "#E69F00", "#009E73")):
            ax.loglog(self.total_strain, self._tensor[:, a, a], color=color, lw=0.8, label=f"$D_{{{AXES[a] * 2}}}$")
        ax.set_xlabel(r"$\gamma_\mathrm{tot}$")
        ax.set_ylabel(r"$D_\mathrm{cyc}$")
        ax.legend(frameon=False)


class DisplacementCloud(Quantity):
    """Displacements of all spheres between two phases of a cycle: the dispersion after half a cycle by default.

    cycle : 0 for the first, negative from the end; start, stop : fractions of the cycle at which positions were
    stored (output.position_phases), stop = 1 the cycle's end. Displacements are in radii and relative to their mean.
    Where the strains at the two phases differ, the flow's own displacement, the integral of y d(gamma), is taken off
    with y varying linearly between the two stored heights: exact only for such a path, and `notes` says so.
    """

    def __init__(self, cycle: int = 0, start: float = 0.0, stop: float = 0.5):
        if not 0.0 <= start < stop <= 1.0:
            raise ConfigurationError(
                f"start = {start:g}, stop = {stop:g}: needed is 0 <= start < stop <= 1 (of a cycle)"
            )
        self.cycle, self.start, self.stop = cycle, start, stop

    def compute(self, run: Run) -> Self:
        """Compute from two stored frames; ConfigurationError where they are not stored."""
        scales = oscillatory_scales(run)
        require_spheres(run)
        if not -run.cycles <= self.cycle < run.cycles:
            raise ConfigurationError(f"{run.path}: there is no cycle {self.cycle}, {run.cycles} are complete")
        index = self.cycle % run.cycles
        before, after = (run.frame(frame_number(run, index, phase)) for phase in (self.start, self.stop))
        first, last = before["unwrapped"], after["unwrapped"].copy()
        strain = after["strain"] - before["strain"]
        self._sheared = abs(strain) > _SAME_STRAIN * scales["gamma0"]
        if self._sheared:
            last[:, 0] -= strain * 0.5 * (first[:, 1] + last[:, 1])
        self._cloud = relative_displacement(first, last, scales["radius"])
        self._index, self._gamma0 = index, scales["gamma0"]
        return self

    @property
    def displacements(self) -> np.ndarray:
        """Displacements (N, 3) along flow, gradient and vorticity, in radii."""
        return self._cloud

    @property
    def tensor(self) -> np.ndarray:
        """Second moments <Delta_a Delta_b> (3, 3), in a^2."""
        return self._cloud.T @ self._cloud / len(self._cloud)

    @property
    def principal(self) -> np.ndarray:
        """Root mean square displacements along the principal axes of `tensor` (3,), in radii, largest first."""
        return np.sqrt(np.linalg.eigvalsh(self.tensor)[::-1].clip(min=0.0))

    @property
    def inclination(self) -> float:
        """Angle of the longest axis of the cloud in the shear plane from the flow direction, degrees in (-90, 90].

        NaN for a round cloud.
        """
        plane = self.tensor[:2, :2]
        twice, difference = 2.0 * plane[0, 1], plane[0, 0] - plane[1, 1]
        if twice == 0.0 and difference == 0.0:
            return float("nan")
        return float(np.degrees(0.5 * np.arctan2(twice, difference)))

    @property
    def elongation(self) -> float:
        """Ratio of the longest to the shortest rms displacement in the shear plane; NaN for a line."""
        low, high = np.linalg.eigvalsh(self.tensor[:2, :2]).clip(min=0.0)
        return float(np.sqrt(high / low)) if low > 0.0 else float("nan")

    @property
    def notes(self) -> list[str]:
        """How the numbers are to be read."""
        if not self._sheared:
            return []
        return ["strain differs between the two phases: the flow's displacement is removed for a straight path in y"]

    def table(self) -> dict[str, np.ndarray]:
        """One row a sphere."""
        return {f"delta_{axis}[a]": self._cloud[:, k] for k, axis in enumerate(AXES)}

    def summary(self) -> dict[str, Any]:
        """Root mean squares, inclination and elongation of the cloud."""
        rms = {f"rms_{axis}[a]": float(value) for axis, value in zip(AXES, np.sqrt(np.diag(self.tensor)), strict=True)}
        shape = {"inclination[degrees]": self.inclination, "elongation[-]": self.elongation}
        which = {"cycle": self._index, "start": self.start, "stop": self.stop, "gamma0": self._gamma0}
        return which | rms | shape | {"notes": self.notes}

    def plot(self, ax) -> None:
        """The cloud in the shear plane."""
        ax.scatter(self._cloud[:, 0], self._cloud[:, 1], s=4.0, color="#0072B2", alpha=0.6, linewidths=0)
        ax.set_aspect("equal")
        ax.set_xlabel(r"$\Delta_x/a$")
        ax.set_ylabel(r"$\Delta_y/a$")


def frame_number(run: Run, cycle: int, phase: float) -> int:
    """Number of the frame at `phase` (0 to 1) of `cycle`, for `Run.frame`; an error where it is not stored."""
    if abs(phase - 1.0) < _SAME_PHASE:
        cycle, phase = cycle + 1, 0.0
    cycles, phases = run.series("frame_cycle"), run.series("frame_phase")
    found = np.flatnonzero((cycles == cycle) & (np.abs(phases - phase) < _SAME_PHASE))
    if found.size:
        return int(found[0])
    if phase == 0.0 and cycle == run.stored and run.n_frames > len(cycles):
        return run.n_frames - 1
    if phase == 0.0:
        raise StorageError(f"{run.path}: the positions at the start of cycle {cycle} are not stored (yet)")
    stored = ", ".join(f"{value:g}" for value in np.unique(phases[cycles == cycle]))
    raise ConfigurationError(
        f"{run.path}: no positions at phase {phase:g} of cycle {cycle} (there are {stored or 'none'}): run with "
        f"output.position_phases: [0.0, {phase:g}]"
    )
