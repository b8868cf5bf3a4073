"""Fraction of active spheres: those that do not return to where the cycle began."""

from __future__ import annotations

from typing import Any, Self

import numpy as np

from suspend.analysis.displacements import cycle_displacements, oscillatory_scales, require_spheres
from suspend.analysis.quantity import Quantity
from suspend.errors import ConfigurationError
from suspend.io import Run

_SAFETY = 3.0  # the threshold should be above this multiple of the estimated error of the positions


class ActiveFraction(Quantity):
    """Fraction of spheres displaced by more than `threshold` radii over each cycle, relative to the mean displacement.

    threshold : in radii. The default, 0.01 a, is the range 1/kappa of the paper's repulsion. There is no natural
    value where displacements have no gap in their distribution, so quote it with the number; `notes` warns where the
    run's own estimate of its position error comes near it.
    """

    def __init__(self, threshold: float = 0.01):
        if not threshold > 0.0:
            raise ConfigurationError(
                f"threshold = {threshold:g}: the displacement of an active sphere must be positive"
            )
        self.threshold = threshold

    def compute(self, run: Run) -> Self:
        """Compute from the positions at the cycle starts; ConfigurationError without oscillation or for one sphere."""
        scales = oscillatory_scales(run)
        require_spheres(run)
        limit = self.threshold**2
        self._fraction = np.array(
            [np.mean(np.einsum("ij,ij->i", d, d) > limit) for d in cycle_displacements(run, scales["radius"])]
        )
        self._gamma0, self._number = scales["gamma0"], int(run.meta["number"])
        self._position_error = position_error(run)
        return self

    @property
    def fraction(self) -> np.ndarray:
        """Active fraction (cycles,), 0 to 1."""
        return self._fraction

    @property
    def standard_error(self) -> np.ndarray:
        """Binomial standard error (cycles,), spheres taken as independent; 0 where none or all are active."""
        return np.sqrt(self._fraction * (1.0 - self._fraction) / self._number)

    @property
    def total_strain(self) -> np.ndarray:
        """gamma_tot = 4 gamma0 n_cyc at the end of each cycle, dimensionless."""
        return 4.0 * self._gamma0 * np.arange(1, len(self._fraction) + 1)

    @property
    def notes(self) -> list[str]:
        """Warnings about the threshold."""
        error = self._position_error
        if error is None or self.threshold > _SAFETY * error:
            return []
        return [
            f"threshold {self.threshold:g} a is not above {_SAFETY:g} times the estimated position error of a cycle, "
            f"{error:.2g} a: spheres may count as active for the step error alone"
        ]

    def table(self) -> dict[str, np.ndarray]:
        """Columns total_strain, active_fraction and its standard error."""
        return {
            "total_strain[-]": self.total_strain,
            "active_fraction[-]": self._fraction,
            "active_fraction_standard_error[-]": self.standard_error,
        }

    def summary(self) -> dict[str, Any]:
        """First and last fraction with the threshold."""
        ends = {"first": float(self._fraction[0]), "last": float(self._fraction[-1])} if len(self._fraction) else {}
        return {"threshold[a]": self.threshold, "cycles": len(self._fraction), **ends, "notes": self.notes}

    def plot(self, ax) -> None:
        """Active fraction against accumulated strain."""
        ax.semilogx(self.total_strain, self._fraction, color="#0072B2", marker=".", ms=3)
        ax.set_ylim(-0.02, 1.02)
        ax.set_xlabel(r"$\gamma_\mathrm{tot}$")
        ax.set_ylabel(rf"fraction with $\Delta > {self.threshold:g}\,a$")


def position_error(run: Run) -> float | None:
    """Largest estimated rms position error of a cycle in radii, as the integrator stored it; None where it did not."""
    found = run.statistics().get("position_error") if run.stored else None
    if found is None or not np.isfinite(found).any():
        return None
    return float(np.nanmax(found))
