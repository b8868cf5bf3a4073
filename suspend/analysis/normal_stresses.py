"""Normal stress differences of every cycle: nu_0, nu_2, nu_4, the frequency doubling |nu_4|/|nu_2|, by part."""

from __future__ import annotations

import numpy as np

from suspend.analysis.moduli import HarmonicQuantity
from suspend.analysis.steady import SteadyAverage, magnitude_series, ratio_average, ratio_series, steady_average

DIFFERENCES = ("N1", "N2")


class NormalStresses(HarmonicQuantity):
    """N1 and N2 over eta0 gamma0 omega: nu(t) = Re sum_n nu_n exp(i n theta), with N1 = xx - yy, N2 = yy - zz.

    All nu_n are in units of eta0. Averages of |nu_n| are magnitudes of the average complex nu_n, so that noise does
    not add to them.
    """

    def nu(self, n: int, difference: str = "N2", part: str = "total") -> np.ndarray:
        """Complex nu_n/eta0 of each cycle (cycles,); nu_0 is real: the mean over the cycle."""
        return self.harmonics.normal(difference, part)[:, n]

    def mean_per_cycle(self, difference: str = "N2", part: str = "total") -> np.ndarray:
        """nu_0/eta0 of each cycle (cycles,)."""
        return self.nu(0, difference, part).real

    def doubling(self, difference: str = "N2", part: str = "total") -> np.ndarray:
        """|nu_4|/|nu_2| of each cycle (cycles,); NaN where nu_2 vanishes."""
        fourth, second = (np.abs(self.nu(n, difference, part)) for n in (4, 2))
        with np.errstate(divide="ignore", invalid="ignore"):
            return np.where(second > 0.0, fourth / second, np.nan)

    def steady_of(self, difference: str, part: str = "total") -> dict[str, SteadyAverage]:
        """nu_0, |nu_2|, |nu_4| and |nu_4|/|nu_2| of the average over the last cycles."""
        window = self.harmonics.window
        second, fourth = (magnitude_series(self.nu(n, difference, part), window) for n in (2, 4))
        return {
            "nu0": steady_average(self.mean_per_cycle(difference, part), window),
            "nu2_abs": steady_average(second, window),
            "nu4_abs": steady_average(fourth, window),
            "nu4_over_nu2": ratio_average(fourth, second, window),
        }

    def doubling_series(self, difference: str = "N2", part: str = "total") -> np.ndarray:
        """|nu_4|/|nu_2| linearised about the average cycle (cycles,): its mean over the last cycles is the ratio."""
        window = self.harmonics.window
        second, fourth = (magnitude_series(self.nu(n, difference, part), window) for n in (2, 4))
        return ratio_series(fourth, second, window)

    def steady(self) -> dict[str, SteadyAverage]:
        """`steady_of` for both differences and all parts, named N2_nu0, N2_nu4_over_nu2_hydrodynamic, ..."""
        return {
            f"{difference}_{name}" + ("" if part == "total" else "_" + part): average
            for difference in DIFFERENCES
            for part in self.parts
            for name, average in self.steady_of(difference, part).items()
        }

    def table(self) -> dict[str, np.ndarray]:
        """One row per cycle; nu_n in units of eta0."""
        columns = {"cycle": self.cycles, "total_strain[-]": self.total_strain}
        for difference in DIFFERENCES:
            for part in self.parts:
                tail = "" if part == "total" else "_" + part
                columns[f"{difference}_nu0{tail}[eta0]"] = self.mean_per_cycle(difference, part)
                for n in (2, 4):
                    nu = self.nu(n, difference, part)
                    columns[f"{difference}_nu{n}_re{tail}[eta0]"] = nu.real
                    columns[f"{difference}_nu{n}_im{tail}[eta0]"] = nu.imag
                columns[f"{difference}_nu4_over_nu2{tail}[-]"] = self.doubling(difference, part)
        return columns

    def plot(self, ax) -> None:
        """-nu_0/eta0 of N2 and its parts against total strain."""
        for part in self.parts[:3]:
            ax.plot(self.total_strain, -self.mean_per_cycle("N2", part), label=part)
        ax.set_xscale("log")
        ax.set_xlabel(r"$\gamma_\mathrm{tot}$")
        ax.set_ylabel(r"$-\nu_0/\eta_0$")
        ax.legend()
