"""Lissajous curves: stress against rate and strain, normal stress differences against strain, by part."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any, Self

import numpy as np

from suspend.analysis.quantity import Quantity
from suspend.analysis.rheology import cycle_theta, stress_parts, stress_signals
from suspend.analysis.samples import cycle_samples, oscillatory_scales
from suspend.errors import ConfigurationError
from suspend.io import Run

SIGNALS = ("shear", "N1", "N2")
_LABELS = {
    "strain": r"$\gamma/\gamma_0$",
    "rate": r"$\dot\gamma/\gamma_0\omega$",
    "shear": r"$\sigma_{xy}/\eta_0\gamma_0\omega$",
    "N1": r"$N_1/\eta_0\gamma_0\omega$",
    "N2": r"$N_2/\eta_0\gamma_0\omega$",
}


def mean_waveforms(run: Run, cycles: int | Sequence[int]) -> dict[str, np.ndarray]:
    """Waveforms averaged over the last `cycles` cycles, or over the cycles of the given numbers; each (n,).

    theta (radians), strain (gamma/gamma0), rate (gdot/(gamma0 omega)), then shear, N1, N2 of the total stress and
    shear_PART, N1_PART, N2_PART of its parts, divided by eta0 gamma0 omega. Negative numbers count from the end.
    Raises ConfigurationError (another flow, no such cycle, cycles of different sampling), StorageError,
    NumericalError.
    """
    scales = oscillatory_scales(run)
    numbers = _numbers(run, cycles)
    unit = scales["viscosity"] * scales["gamma0"] * scales["omega"]
    sums: dict[str, np.ndarray] = {}
    for record in _records(run, numbers):
        found = {"theta": cycle_theta(record, scales)}
        found["strain"] = np.asarray(record["strain"]) / scales["gamma0"]
        found["rate"] = np.asarray(record["rate"]) / (scales["gamma0"] * scales["omega"])
        for part, stress in stress_parts(record).items():
            tail = "" if part == "total" else "_" + part
            found |= {n + tail: row / unit for n, row in zip(SIGNALS, stress_signals(stress), strict=True)}
        if not sums:
            sums = {name: np.zeros(len(found["theta"])) for name in found}
            phases = found["theta"]
        if len(phases) != len(found["theta"]) or np.abs(phases - found["theta"]).max(initial=0.0) > 1e-8:
            raise ConfigurationError(
                f"cycle {record['index']} of {run.path} is not sampled at the phases of cycle {numbers[0]}: samples "
                "are missing"
            )
        for name, column in found.items():
            sums[name] += column / len(numbers)
    return sums


def _records(run: Run, numbers: list[int]) -> Iterator[dict[str, Any]]:
    breaks = np.flatnonzero(np.diff(numbers) != 1) + 1
    for span in np.split(numbers, breaks):  # of consecutive cycles, which are read together
        yield from cycle_samples(run, int(span[0]), int(span[-1]) + 1)


def _numbers(run: Run, cycles: int | Sequence[int]) -> list[int]:
    if isinstance(cycles, int | np.integer):
        if not 1 <= cycles <= run.cycles:
            raise ConfigurationError(f"{run.path}: cannot average the last {cycles} of {run.cycles} complete cycles")
        return list(range(run.cycles - int(cycles), run.cycles))
    wrong = [k for k in cycles if not -run.cycles <= k < run.cycles]
    if wrong or not len(cycles):
        raise ConfigurationError(f"{run.path}: no cycle {wrong or 'named'}; it has {run.cycles} complete ones")
    return sorted({int(k) % run.cycles for k in cycles})


class Lissajous(Quantity):
    """Closed curves of the stress in chosen cycles.

    cycles: how many of the last cycles to average, or a list of cycle numbers (negative: from the end).
    x "rate" or "strain" and y "shear", "N1" or "N2" with part "total", "hydrodynamic", ... choose what `plot` draws.
    """

    def __init__(self, cycles: int | Sequence[int] = 1, x: str = "rate", y: str = "shear", part: str = "total"):
        if x not in ("rate", "strain") or y not in SIGNALS:
            raise ConfigurationError(f"no curve of {y!r} against {x!r}: {', '.join(SIGNALS)} against rate or strain")
        self.cycles, self.x, self.y, self.part = cycles, x, y, part

    def compute(self, run: Run) -> Self:
        """Compute from an open run; errors as `mean_waveforms`."""
        self.waveforms = mean_waveforms(run, self.cycles)
        return self

    @property
    def parts(self) -> tuple[str, ...]:
        """Parts of the stress: total, hydrodynamic, interparticle, flow_driven where stored."""
        return ("total", *(name[6:] for name in self.waveforms if name.startswith("shear_")))

    def signal(self, name: str, part: str = "total") -> np.ndarray:
        """Samples (n,) of theta, strain, rate (no parts), shear, N1, N2. Raises ConfigurationError."""
        key = name if part == "total" else f"{name}_{part}"
        if key not in self.waveforms:
            raise ConfigurationError(f"no {part} part of {name}; parts are {', '.join(self.parts)}")
        return self.waveforms[key]

    def curve(self) -> tuple[np.ndarray, np.ndarray]:
        """x and y (n + 1,) of the closed curve that `plot` draws, dimensionless."""
        x, y = self.signal(self.x), self.signal(self.y, self.part)
        return np.append(x, x[0]), np.append(y, y[0])

    def viscous_stress(self, part: str = "total") -> np.ndarray:
        """sigma''(theta) (n,), the single-valued function of the rate in the shear stress (Cho et al. 2005).

        Part of the stress that is even under time reversal about zero strain and odd over half a cycle.
        """
        return self._split(part).real

    def elastic_stress(self, part: str = "total") -> np.ndarray:
        """sigma'(theta) (n,), the single-valued function of the strain; sigma' + sigma'' is the odd stress."""
        return self._split(part).imag

    def _split(self, part: str) -> np.ndarray:
        theta, stress = self.signal("theta"), self.signal("shear", part)
        orders = np.arange(1, (len(theta) - 1) // 2 + 1, 2)
        waves = np.exp(1j * np.outer(theta, orders))
        coefficients = 2.0 / len(theta) * (stress @ np.conj(waves))
        return waves.real @ coefficients.real - 1j * (waves.imag @ coefficients.imag)

    def dissipation(self, part: str = "total") -> float:
        """Work per cycle and volume over pi eta0 gamma0^2 omega: the area of stress against strain; eta_1'/eta0."""
        return float(2.0 * np.mean(self.signal("shear", part) * self.signal("rate")))

    def summary(self) -> dict[str, Any]:
        """Extremes of the signals and the dissipated work by part."""
        found = {f"dissipation_{part}": self.dissipation(part) for part in self.parts}
        for name in SIGNALS:
            found |= {f"{name}_minimum": float(self.signal(name).min())}
            found |= {f"{name}_maximum": float(self.signal(name).max())}
        return found

    def table(self) -> dict[str, np.ndarray]:
        """One row per sample; stresses in units of eta0 gamma0 omega."""
        units = {"theta": "rad", "strain": "gamma0", "rate": "gamma0*omega"}
        return {f"{k}[{units.get(k, 'eta0*gamma0*omega')}]": column for k, column in self.waveforms.items()}

    def plot(self, ax) -> None:
        """The closed curve of y against x."""
        ax.plot(*self.curve())
        ax.set_xlabel(_LABELS[self.x])
        ax.set_ylabel(_LABELS[self.y])
