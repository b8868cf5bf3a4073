"""Fourier moduli of all cycles of a run by part of the stress, and their steady-state averages."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Self

import numpy as np

from suspend.analysis.quantity import Quantity
from suspend.analysis.rheology import HARMONICS, cycle_theta, fourier_coefficients, stress_parts, stress_signals
from suspend.analysis.samples import chosen_window, cycle_samples, oscillatory_scales
from suspend.analysis.steady import SteadyAverage, ratio_average, steady_average, summarise
from suspend.errors import ConfigurationError
from suspend.io import Run


@dataclass(frozen=True)
class Harmonics:
    """Fourier coefficients of the stress of each complete cycle, divided by eta0 gamma0 omega.

    coefficients: by part (total, hydrodynamic, interparticle, flow_driven where stored) complex
    (cycles, 3, H + 1): c_n of sigma_xy, N1, N2 = Re sum_n c_n exp(i n theta), theta the phase of the strain.
    scales: gamma0, omega, phase, viscosity, radius, number, volume_fraction. window: cycles averaged at the end.
    """

    coefficients: dict[str, np.ndarray]
    scales: dict[str, float]
    window: int

    @property
    def parts(self) -> tuple[str, ...]:
        """Names of the parts, "total" first; flow_driven is contained in hydrodynamic."""
        return tuple(self.coefficients)

    @property
    def cycles(self) -> int:
        """Number of complete cycles."""
        return len(self.coefficients["total"])

    @property
    def total_strain(self) -> np.ndarray:
        """gamma_tot = 4 gamma0 n_cyc at the end of each cycle (cycles,)."""
        return 4.0 * self.scales["gamma0"] * np.arange(1, self.cycles + 1)

    def viscous(self, part: str = "total") -> np.ndarray:
        """eta_n'/eta0 (cycles, H + 1); index 0 is the mean of sigma_xy."""
        return self._of(part)[:, 0].real

    def elastic(self, part: str = "total") -> np.ndarray:
        """G_n'/(eta0 omega) (cycles, H + 1)."""
        return -self._of(part)[:, 0].imag

    def normal(self, difference: str, part: str = "total") -> np.ndarray:
        """nu_n/eta0 (cycles, H + 1), complex, of difference "N1" or "N2"."""
        return self._of(part)[:, {"N1": 1, "N2": 2}[difference]]

    def _of(self, part: str) -> np.ndarray:
        if part not in self.coefficients:
            raise ConfigurationError(f"no part {part!r} of the stress is stored; there are {', '.join(self.parts)}")
        return self.coefficients[part]


def read_harmonics(run: Run, last: int | None = None, harmonics: int = HARMONICS) -> Harmonics:
    """Fourier coefficients of all complete cycles of a run under oscillatory shear.

    last: cycles to average over (default: an eighth, at least four). Raises ConfigurationError (another flow, no
    complete cycle, too few or missing samples: the message names the cycle), StorageError, NumericalError.
    """
    scales, window = oscillatory_scales(run), chosen_window(run, last)
    unit = scales["viscosity"] * scales["gamma0"] * scales["omega"]
    found: dict[str, list[np.ndarray]] = {}
    for record in cycle_samples(run):
        parts = stress_parts(record)
        signals = np.stack([stress_signals(stress) for stress in parts.values()])
        try:
            rows = fourier_coefficients(cycle_theta(record, scales), signals, harmonics) / unit
        except ConfigurationError as error:
            raise ConfigurationError(f"cycle {record['index']} of {run.path}: {error}") from error
        for name, row in zip(parts, rows, strict=True):
            found.setdefault(name, []).append(row)
    return Harmonics({name: np.stack(rows) for name, rows in found.items()}, scales, window)


class HarmonicQuantity(Quantity):
    """A quantity computed from the Fourier coefficients of the cycles.

    last: number of cycles at the end that averages are taken over; None: an eighth of them, at least four.
    """

    def __init__(self, last: int | None = None):
        self.last = last

    def compute(self, run: Run) -> Self:
        """Compute from an open run; errors as `read_harmonics`."""
        return self.use(read_harmonics(run, self.last))

    def use(self, harmonics: Harmonics) -> Self:
        """Compute from coefficients that were read already; their window is averaged over."""
        self.harmonics = harmonics
        return self

    @property
    def cycles(self) -> np.ndarray:
        """Numbers of the cycles, from 0."""
        return np.arange(self.harmonics.cycles)

    @property
    def total_strain(self) -> np.ndarray:
        """gamma_tot at the end of each cycle."""
        return self.harmonics.total_strain

    @property
    def parts(self) -> tuple[str, ...]:
        """Parts of the stress: total, hydrodynamic, interparticle, flow_driven where stored."""
        return self.harmonics.parts

    def steady(self) -> dict[str, SteadyAverage]:
        """Averages over the last cycles by name, each with error bar and drift test."""
        raise NotImplementedError

    def summary(self) -> dict[str, Any]:
        """Number of averaged cycles, and `steady` as plain types."""
        return {"cycles": self.harmonics.window, "averages": summarise(self.steady())}


class Moduli(HarmonicQuantity):
    """eta_n' and G_n' of every cycle (equation (1) of the paper), their evolution and steady state."""

    @property
    def eta_r_prime(self) -> np.ndarray:
        """eta_r' = eta_1'/eta0 of each cycle, the relative viscosity."""
        return self.harmonics.viscous()[:, 1]

    @property
    def eta_r_double_prime(self) -> np.ndarray:
        """eta_r'' = G_1'/(eta0 omega) of each cycle, the relative elastic response."""
        return self.harmonics.elastic()[:, 1]

    @property
    def thinning(self) -> np.ndarray:
        """-eta_3'/eta_1' of each cycle, positive for shear thinning within the cycle."""
        return -self._over_first(3)

    @property
    def fifth(self) -> np.ndarray:
        """eta_5'/eta_1' of each cycle."""
        return self._over_first(5)

    def _over_first(self, n: int) -> np.ndarray:
        viscous = self.harmonics.viscous()
        with np.errstate(divide="ignore", invalid="ignore"):
            return viscous[:, n] / viscous[:, 1]

    def steady(self) -> dict[str, SteadyAverage]:
        """eta_r', eta_r'', -eta3'/eta1', eta5'/eta1' (ratios of averages), and eta_1', G_1' of the parts."""
        window, viscous = self.harmonics.window, self.harmonics.viscous()
        found = {
            "eta_r_prime": steady_average(self.eta_r_prime, window),
            "eta_r_double_prime": steady_average(self.eta_r_double_prime, window),
            "minus_eta3_over_eta1": ratio_average(-viscous[:, 3], viscous[:, 1], window),
            "eta5_over_eta1": ratio_average(viscous[:, 5], viscous[:, 1], window),
        }
        for part in self.parts[1:]:
            found[f"eta1_prime_{part}"] = steady_average(self.harmonics.viscous(part)[:, 1], window)
            found[f"G1_prime_{part}"] = steady_average(self.harmonics.elastic(part)[:, 1], window)
        return found

    def table(self) -> dict[str, np.ndarray]:
        """One row per cycle; eta in units of eta0, G of eta0 omega."""
        columns = {
            "cycle": self.cycles,
            "total_strain[-]": self.total_strain,
            "eta_r_prime[-]": self.eta_r_prime,
            "eta_r_double_prime[-]": self.eta_r_double_prime,
            "minus_eta3_over_eta1[-]": self.thinning,
            "eta5_over_eta1[-]": self.fifth,
        }
        for part in self.parts[1:]:
            columns[f"eta1_prime_{part}[eta0]"] = self.harmonics.viscous(part)[:, 1]
            columns[f"G1_prime_{part}[eta0*omega]"] = self.harmonics.elastic(part)[:, 1]
        return columns

    def plot(self, ax) -> None:
        """eta_r' and eta_r'' against total strain, logarithmic in strain."""
        ax.plot(self.total_strain, self.eta_r_prime, label=r"$\eta_r^\prime$")
        ax.plot(self.total_strain, self.eta_r_double_prime, label=r"$\eta_r^{\prime\prime}$")
        ax.set_xscale("log")
        ax.set_xlabel(r"$\gamma_\mathrm{tot}$")
        ax.set_ylabel(r"$\eta_r^\prime,\ \eta_r^{\prime\prime}$")
        ax.legend()
