"""Power spectrum of the stress within a cycle."""

from __future__ import annotations

from typing import Any, Self

import numpy as np

from suspend.analysis.lissajous import SIGNALS, mean_waveforms
from suspend.analysis.quantity import Quantity
from suspend.analysis.rheology import fourier_coefficients
from suspend.analysis.samples import chosen_window, oscillatory_scales
from suspend.io import Run


class PowerSpectrum(Quantity):
    """Power of each harmonic of sigma_xy, N1 and N2 of the mean waveform of the last cycles, by part.

    power_n = |c_n|^2/2, power_0 = c_0^2, so that their sum is the mean square of the signal (Parseval) as far as
    the samples resolve it: n up to (samples - 1)/2. In units of (eta0 gamma0 omega)^2.
    last: number of cycles averaged (default: an eighth, at least four).
    """

    def __init__(self, last: int | None = None):
        self.last = last

    def compute(self, run: Run) -> Self:
        """Compute from an open run; errors as `mean_waveforms`."""
        oscillatory_scales(run)
        return self.use_waveform(mean_waveforms(run, chosen_window(run, self.last)))

    def use_waveform(self, waveforms: dict[str, np.ndarray]) -> Self:
        """Compute from waveforms that `mean_waveforms` gave."""
        theta = waveforms["theta"]
        names = [name for name in waveforms if name.startswith(SIGNALS)]
        rows = fourier_coefficients(theta, np.stack([waveforms[n] for n in names]), (len(theta) - 1) // 2)
        self.coefficients = dict(zip(names, rows, strict=True))
        return self

    @property
    def orders(self) -> np.ndarray:
        """n = 0, 1, 2, ..."""
        return np.arange(len(self.coefficients["shear"]))

    def power(self, signal: str = "shear", part: str = "total") -> np.ndarray:
        """Power of each harmonic (H + 1,) of signal "shear", "N1" or "N2"."""
        found = np.abs(self.coefficients[signal if part == "total" else f"{signal}_{part}"]) ** 2
        return np.concatenate([found[:1], found[1:] / 2.0])

    @property
    def fifth(self) -> float:
        """eta_5'/eta_1' of the mean waveform."""
        viscous = self.coefficients["shear"].real
        return float(viscous[5] / viscous[1]) if viscous[1] else float("nan")

    def summary(self) -> dict[str, Any]:
        """eta_5'/eta_1', intensities |c_n/c_1| of the shear stress, share of even harmonics in its power."""
        shear = np.abs(self.coefficients["shear"])
        power = self.power()
        oscillating = power[1:].sum()
        return {
            "eta5_over_eta1": self.fifth,
            **{f"I{n}_over_I1": float(shear[n] / shear[1]) if shear[1] else float("nan") for n in (2, 3, 4, 5, 7, 9)},
            "even_share": float(power[2::2].sum() / oscillating) if oscillating else float("nan"),
        }

    def table(self) -> dict[str, np.ndarray]:
        """One row per harmonic: eta_n', G_n', and the power of every signal and part."""
        columns = {"harmonic": self.orders}
        columns["eta_n_prime[eta0]"] = self.coefficients["shear"].real
        columns["G_n_prime[eta0*omega]"] = -self.coefficients["shear"].imag
        for name in self.coefficients:
            signal, _, part = name.partition("_")
            columns[f"power_{name}[(eta0*gamma0*omega)^2]"] = self.power(signal, part or "total")
        return columns

    def plot(self, ax) -> None:
        """Power of sigma_xy and N2 against the harmonic, logarithmic."""
        for name, label in (("shear", r"$\sigma_{xy}$"), ("N2", r"$N_2$")):
            ax.semilogy(self.orders, np.maximum(self.power(name), 1e-32), marker="o", label=label)
        ax.set_xlabel("$n$")
        ax.set_ylabel(r"power / $(\eta_0\gamma_0\omega)^2$")
        ax.legend()
