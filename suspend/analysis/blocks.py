"""Steady and reversed shear: viscosity and normal stress differences per block of strain, and their averages."""

from __future__ import annotations

from typing import Any, Self

import numpy as np

from suspend.analysis.quantity import Quantity
from suspend.analysis.rheology import block_row
from suspend.analysis.samples import cycle_samples, read_scales
from suspend.analysis.steady import SteadyAverage, ratio_average, steady_average, summarise
from suspend.errors import ConfigurationError
from suspend.io import Run

_PARTS = ("", "_hydrodynamic", "_interparticle", "_flow_driven")


def direction_begins(rate: np.ndarray) -> int:
    """First block after the last change of the shear's direction; 0 without one."""
    direction = np.sign(rate)
    changed = np.flatnonzero(direction != direction[-1:])
    return int(changed[-1]) + 1 if changed.size else 0


class SteadyStresses(Quantity):
    """eta_r = sigma_xy/(eta0 rate), N1, N2 of each block of about one unit of strain, and their averages.

    last: number of blocks at the end to average over (default: the last half of those after the last reversal).
    The averages, with error bar and drift test, never reach back across a reversal.
    """

    def __init__(self, last: int | None = None):
        self.last = last

    def compute(self, run: Run) -> Self:
        """Compute from an open run. Raises ConfigurationError (another flow, no block, `last`), NumericalError."""
        flow, scales = read_scales(run)
        if flow not in ("steady", "reversal"):
            raise ConfigurationError(f"{run.path}: its flow is {flow}, but averages over blocks need steady shear")
        if run.cycles == 0:
            raise ConfigurationError(f"{run.path}: no complete block of strain is stored yet; let the run go on")
        rows = [block_row(record, scales) for record in cycle_samples(run)]
        self.columns = {name: np.array([row[name] for row in rows]) for name in rows[0]}
        self.begin = direction_begins(self.columns["shear_rate[rate]"])
        usable = run.cycles - self.begin
        if self.last is not None and not 1 <= self.last <= usable:
            raise ConfigurationError(f"{run.path}: cannot average over the last {self.last} of {usable} blocks")
        self.window = self.last if self.last is not None else max(usable // 2, 1)
        return self

    @property
    def total_strain(self) -> np.ndarray:
        """Accumulated strain at the end of each block."""
        return self.columns["total_strain[-]"]

    @property
    def viscosity(self) -> np.ndarray:
        """eta_r of each block, positive in both directions."""
        return self.columns["eta_r[-]"]

    def normal(self, difference: str, part: str = "total") -> np.ndarray:
        """N1 or N2 of each block in units of eta0 times the rate; a part (hydrodynamic, ...) or the total."""
        tail = "" if part == "total" else "_" + part
        return self.columns[f"{difference}{tail}[eta0*rate]"]

    def steady(self) -> dict[str, SteadyAverage]:
        """eta_r, N1, N2 by part (names as the columns), and N1/|sigma_xy|, N2/|sigma_xy| of the total."""
        found, after = {}, slice(self.begin, None)
        for tail in _PARTS:
            for name in (f"eta_r{tail}[-]", f"N1{tail}[eta0*rate]", f"N2{tail}[eta0*rate]"):
                if name in self.columns:
                    found[name.partition("[")[0]] = steady_average(self.columns[name][after], self.window)
        shear = np.abs(self.columns["sigma_xy[eta0*rate]"])[after]
        for difference in ("N1", "N2"):
            found[f"{difference}_over_shear"] = ratio_average(self.normal(difference)[after], shear, self.window)
        return found

    def summary(self) -> dict[str, Any]:
        """Number of averaged blocks, and `steady` as plain types."""
        return {"blocks": self.window, "averages": summarise(self.steady())}

    def table(self) -> dict[str, np.ndarray]:
        """One row per block."""
        return {"block": np.arange(len(self.viscosity)), **self.columns}

    def plot(self, ax) -> None:
        """eta_r against strain."""
        ax.plot(self.total_strain, self.viscosity)
        ax.set_xlabel(r"$\gamma_\mathrm{tot}$")
        ax.set_ylabel(r"$\eta_r$")
