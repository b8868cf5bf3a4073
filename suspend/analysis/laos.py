"""Measures of large-amplitude oscillatory shear: Ewoldt, Hosoi & McKinley, J. Rheol. 52, 1427 (2008).

With gamma = gamma0 sin theta the odd part of the stress is sigma' + sigma'', an elastic stress
sigma' = gamma0 sum_n e_n T_n(gamma/gamma0) and a viscous stress sigma'' = gamma0 omega sum_n v_n T_n(rate/(gamma0
omega)), T_n Chebyshev polynomials of the first kind, n odd:
    e_n = (-1)^((n-1)/2) G_n',   v_n = eta_n'.
Tangents and secants of the Lissajous curves:
    G_M' = dsigma/dgamma at gamma = 0 = sum n G_n'                      G_L' = sigma/gamma at gamma0 = sum e_n
    eta_M' = dsigma/drate at rate = 0 = sum (-1)^((n-1)/2) n eta_n'     eta_L' = sigma/rate at gamma0 omega = sum v_n
    S = (G_L' - G_M')/G_L' (> 0: strain stiffening),   T = (eta_L' - eta_M')/eta_L' (> 0: shear thickening).
Here G in units of eta0 omega, eta in units of eta0. Even harmonics, zero in a steady state, are left out, which is
the mean over both half-cycles.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Self

import numpy as np

from suspend.analysis.lissajous import mean_waveforms
from suspend.analysis.moduli import HarmonicQuantity, Harmonics, read_harmonics
from suspend.analysis.steady import SteadyAverage, ratio_average, ratio_series, steady_average
from suspend.io import Run

MODULI = ("G_M", "G_L", "eta_M", "eta_L")
RATIOS = {  # name -> numerator, denominator
    "e3_over_e1": ("e3", "e1"),
    "v3_over_v1": ("v3", "v1"),
    "S": ("G_L-G_M", "G_L"),
    "T": ("eta_L-eta_M", "eta_L"),
}


@dataclass(frozen=True)
class ChebyshevMeasures:
    """Measures of one or of many cycles, from harmonics n = 0..H along the last axis."""

    elastic: np.ndarray
    viscous: np.ndarray

    @property
    def odd(self) -> np.ndarray:
        """Orders 1, 3, 5, ..."""
        return np.arange(1, np.shape(self.elastic)[-1], 2)

    @property
    def _signs(self) -> np.ndarray:
        return 1.0 - 2.0 * (self.odd // 2 % 2)

    @property
    def e(self) -> np.ndarray:
        """e_n for n = 1, 3, ... in units of eta0 omega."""
        return self._signs * self.elastic[..., 1::2]

    @property
    def v(self) -> np.ndarray:
        """v_n for n = 1, 3, ... in units of eta0."""
        return self.viscous[..., 1::2]

    @property
    def G_M(self) -> np.ndarray:
        """G_M', minimum-strain (tangent) modulus."""
        return self.elastic[..., 1::2] @ self.odd

    @property
    def G_L(self) -> np.ndarray:
        """G_L', large-strain (secant) modulus."""
        return self.e.sum(axis=-1)

    @property
    def eta_M(self) -> np.ndarray:
        """eta_M', minimum-rate (tangent) viscosity."""
        return self.v @ (self._signs * self.odd)

    @property
    def eta_L(self) -> np.ndarray:
        """eta_L', large-rate (secant) viscosity."""
        return self.v.sum(axis=-1)

    def series(self, name: str) -> np.ndarray:
        """Measure by name: e1, e3, v1, v3, G_M, ..., or "A-B" of two of them."""
        if "-" in name:
            first, second = name.split("-")
            return self.series(first) - self.series(second)
        if name[1:].isdigit():
            return getattr(self, name[0])[..., int(name[1:]) // 2]
        return getattr(self, name)


def direct_measures(theta: np.ndarray, stress: np.ndarray) -> dict[str, float]:
    """G_M, G_L, eta_M, eta_L by their definition as tangents and secants, from samples instead of harmonics.

    theta (n,) equal phases of one cycle in order; stress (n,) divided by eta0 gamma0 omega; results in units of eta0
    omega and eta0. Polynomials through seven samples give value and slope at strain 0 and at rate 0 of both
    half-cycles, whose mean is taken; their error falls as n^-7 and n^-6 for a smooth stress. What remains between
    these and the sums over harmonics are the harmonics left out of the sums.
    """

    def half_difference(at: float, derivative: int) -> float:
        # in units of theta: d sigma/d gamma = d sigma/d theta/(d gamma/d theta), antisymmetric over half a cycle
        first, second = (_local(theta, stress, point)[derivative] for point in (at, at + np.pi))
        return float(first - second) / 2.0

    return {
        "G_M": half_difference(0.0, 1),
        "G_L": half_difference(np.pi / 2.0, 0),
        "eta_M": -half_difference(np.pi / 2.0, 1),
        "eta_L": half_difference(0.0, 0),
    }


def _local(theta: np.ndarray, values: np.ndarray, at: float) -> tuple[float, float]:
    """Value and slope at phase `at` of the polynomial through the seven nearest of n equally spaced samples."""
    step = 2.0 * np.pi / len(theta)
    place = (at - theta[0]) / step
    nodes = round(place) + np.arange(-3, 4)
    samples = np.asarray(values, float)[nodes % len(theta)]
    taylor = np.linalg.solve(np.vander(nodes - place, increasing=True), samples)
    return taylor[0], taylor[1] / step


class Laos(HarmonicQuantity):
    """Chebyshev ratios, tangent and secant moduli, S and T of every cycle, part of the stress and the average."""

    direct: dict[str, float] | None = None

    def compute(self, run: Run) -> Self:
        """Compute from an open run, the direct measures of the mean waveform included."""
        self.use(read_harmonics(run, self.last))
        return self.use_waveform(mean_waveforms(run, self.harmonics.window))

    def use(self, harmonics: Harmonics) -> Self:
        """Compute from coefficients that were read already; `direct` stays None."""
        self.direct = None
        return super().use(harmonics)

    def use_waveform(self, waveforms: dict[str, np.ndarray]) -> Self:
        """Take the direct measures from the waveforms that `mean_waveforms` gives."""
        self.direct = direct_measures(waveforms["theta"], waveforms["shear"])
        return self

    def measures(self, part: str = "total") -> ChebyshevMeasures:
        """Measures of all cycles, arrays (cycles, ...)."""
        return ChebyshevMeasures(self.harmonics.elastic(part), self.harmonics.viscous(part))

    def steady(self, part: str = "total") -> dict[str, SteadyAverage]:
        """e1, e3, v1, v3, G_M, G_L, eta_M, eta_L of the mean cycle, e3/e1, v3/v1, S, T from their averages."""
        found, window = self.measures(part), self.harmonics.window
        names = ("e1", "e3", "v1", "v3", *MODULI)
        averages = {name: steady_average(found.series(name), window) for name in names}
        for name, (numerator, denominator) in RATIOS.items():
            averages[name] = ratio_average(found.series(numerator), found.series(denominator), window)
        return averages

    def ratio(self, name: str, part: str = "total") -> np.ndarray:
        """e3_over_e1, v3_over_v1, S or T of each cycle, linearised about the average of the last ones."""
        numerator, denominator = (self.measures(part).series(of) for of in RATIOS[name])
        return ratio_series(numerator, denominator, self.harmonics.window)

    def summary(self) -> dict[str, Any]:
        """Averages by part, and the direct measures of the mean cycle (None where no waveform was given)."""
        parts = {part: {k: v.as_dict() for k, v in self.steady(part).items()} for part in self.parts}
        return {"cycles": self.harmonics.window, "parts": parts, "direct": self.direct}

    def table(self) -> dict[str, np.ndarray]:
        """One row per cycle, totals and parts; ratios of the cycle itself, NaN without a denominator."""
        columns = {"cycle": self.cycles, "total_strain[-]": self.total_strain}
        for part in self.parts:
            found, tail = self.measures(part), "" if part == "total" else "_" + part
            for name in MODULI:
                unit = "eta0*omega" if name.startswith("G") else "eta0"
                columns[f"{name}{tail}[{unit}]"] = found.series(name)
            for name, (numerator, denominator) in RATIOS.items():
                with np.errstate(divide="ignore", invalid="ignore"):
                    ratio = found.series(numerator) / found.series(denominator)
                columns[f"{name}{tail}[-]"] = np.where(np.isfinite(ratio), ratio, np.nan)
        return columns

    def plot(self, ax) -> None:
        """v3/v1 and T of the total stress against total strain."""
        columns = self.table()
        for name, label in (("v3_over_v1[-]", r"$v_3/v_1$"), ("T[-]", r"$T$")):
            ax.plot(self.total_strain, columns[name], label=label)
        ax.set_xscale("log")
        ax.set_xlabel(r"$\gamma_\mathrm{tot}$")
        ax.set_ylabel(r"$v_3/v_1,\ T$")
        ax.legend()
