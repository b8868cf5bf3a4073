"""Phase diagram of the reversible-irreversible transition: gamma_c against volume fraction."""

from __future__ import annotations

import math
from typing import Any, Self

import numpy as np

from suspend.analysis.collection import Collection
from suspend.analysis.quantity import Quantity
from suspend.analysis.signatures import Range, Signatures
from suspend.errors import ConfigurationError

PREFACTOR, EXPONENT = 0.14, 1.93  # gamma_c = 0.14 phi^-1.93, experiments of Pine et al., Nature 438, 997 (2005)
_LEVEL = (2.5, 97.5)


def experimental_fit(phi: np.ndarray | float) -> np.ndarray | float:
    """gamma_c = 0.14 phi^-1.93, the fit to experiments that the paper compares with."""
    return PREFACTOR * np.asarray(phi, float) ** -EXPONENT


class PhaseDiagram(Quantity):
    """Bounds on gamma_c for each volume fraction and setup of a `Collection`, against 0.14 phi^-1.93.

    The bound is the intersection of the signatures (`Signatures`, same parameters). Where they exclude each other there
    is none, and the interval that most of them share stands in `agreement` and the notes, not in the bound.
    A power law gamma_c = C phi^-n through the bounded points of one setup: with gamma_c uniform within each bound
    (and, where seeds are several, the bound drawn from the bootstrap), `draws` least-squares lines in the logarithms
    give the median of n and C and their 95 % interval; only with two or more volume fractions.
    """

    def __init__(self, points: int = 3, resamples: int = 1000, seed: int = 0, draws: int = 4000):
        if draws < 1:
            raise ConfigurationError(f"draws = {draws} must be positive")
        self.points, self.resamples, self.seed, self.draws = points, resamples, seed, draws

    def compute(self, run: Collection) -> Self:
        """Compute from a collection that has been computed."""
        self._signatures = [
            Signatures(self.points, self.resamples, self.seed).compute(series)
            for series in run.series
            if len(series.groups) > 0
        ]
        return self

    @property
    def signatures(self) -> list[Signatures]:
        """The signatures of each series, ascending in volume fraction."""
        return list(self._signatures)

    @property
    def phi(self) -> np.ndarray:
        """Volume fractions (n,)."""
        return np.array([s.series.phi for s in self._signatures])

    @property
    def bounds(self) -> list[Range | None]:
        """Bound on gamma_c of each series, or None."""
        return [s.bound for s in self._signatures]

    @property
    def reference(self) -> np.ndarray:
        """0.14 phi^-1.93 of each series (n,)."""
        return experimental_fit(self.phi)

    @property
    def agrees(self) -> list[bool | None]:
        """Whether 0.14 phi^-1.93 lies in the bound; None without a bound."""
        return [
            None if bound is None else bool(bound.low < value < bound.high)
            for bound, value in zip(self.bounds, self.reference, strict=True)
        ]

    def power_law(self, setup: str | None = None) -> dict[str, Any] | None:
        """Prefactor C and exponent n of gamma_c = C phi^-n with 95 % intervals, for one setup (default: the only one).

        None with fewer than two volume fractions that have a closed bound. Raises ConfigurationError where there are
        several setups and none is named.
        """
        setups = {s.series.setup for s in self._signatures}
        if setup is None and len(setups) > 1:
            raise ConfigurationError(f"several setups: name one of {', '.join(sorted(setups))}")
        chosen = [s for s in self._signatures if setup is None or s.series.setup == setup]
        chosen = [s for s in chosen if s.bound is not None and s.bound.bracketed]
        if len({s.series.phi for s in chosen}) < 2:
            return None
        random = np.random.default_rng(self.seed)
        logs = np.log([s.series.phi for s in chosen])
        drawn = np.log(np.stack([self._draw(s, random) for s in chosen], axis=1))
        centred = logs - logs.mean()
        slope = drawn @ centred / (centred @ centred)
        level = drawn.mean(axis=1) - slope * logs.mean()
        exponent, prefactor = -slope, np.exp(level)
        return {
            "exponent": float(np.median(exponent)),
            "exponent_interval": np.percentile(exponent, _LEVEL).tolist(),
            "prefactor": float(np.median(prefactor)),
            "prefactor_interval": np.percentile(prefactor, _LEVEL).tolist(),
            "volume_fractions": len(chosen),
        }

    def _draw(self, signatures: Signatures, random: np.random.Generator) -> np.ndarray:
        low = np.full(self.draws, signatures.bound.low)
        high = np.full(self.draws, signatures.bound.high)
        found = signatures.bootstrap_bounds()
        if len(found):
            pick = random.integers(0, len(found), self.draws)
            low, high = found[pick, 0], found[pick, 1]
        return low + (high - low) * random.random(self.draws)

    @property
    def notes(self) -> list[str]:
        """Notes of all series, with their names."""
        return [f"{s.series.title}: {note}" for s in self._signatures for note in s.notes]

    def table(self) -> dict[str, np.ndarray]:
        """One row a series: phi, setup, the bound (and 95 % of those of resampled seeds), 0.14 phi^-1.93, the middle of

        the bound over it, steepest rise of D_cyc.
        """
        nothing = Range(math.nan, math.nan, math.nan)
        bounds, rises = [b or nothing for b in self.bounds], [s.rise or nothing for s in self._signatures]
        best = np.array([b.best for b in bounds])
        seeds = [s.confidence("gamma_c") or {} for s in self._signatures]
        return {
            "phi[-]": self.phi,
            "setup": np.array([s.series.setup for s in self._signatures]),
            "gamma_c_low[-]": np.array([b.low for b in bounds]),
            "gamma_c_high[-]": np.array([b.high for b in bounds]),
            "gamma_c_seeds_low[-]": np.array([s.get("low", math.nan) for s in seeds]),
            "gamma_c_seeds_high[-]": np.array([s.get("high", math.nan) for s in seeds]),
            "experimental_fit[-]": self.reference,
            "ratio[-]": best / self.reference,
            "signatures_agreeing[-]": np.array([s.agreement[0] for s in self._signatures]),
            "signatures_found[-]": np.array([s.agreement[1] for s in self._signatures]),
            "rise_low[-]": np.array([r.low for r in rises]),
            "rise_high[-]": np.array([r.high for r in rises]),
        }

    def summary(self) -> dict[str, Any]:
        """Signatures of every series, the power laws and the notes."""
        laws = {setup: self.power_law(setup) for setup in sorted({s.series.setup for s in self._signatures})}
        rows = [
            s.summary() | {"experimental_fit": float(value), "within_bound": agrees}
            for s, value, agrees in zip(self._signatures, self.reference, self.agrees, strict=True)
        ]
        return {"series": rows, "power_laws": laws, "notes": self.notes}

    def plot(self, ax) -> None:
        """The bounds as bars and the experimental fit."""
        for phi, bound in zip(self.phi, self.bounds, strict=True):
            if bound is not None and bound.bracketed:
                ax.plot([phi, phi], [bound.low, bound.high], marker="o", mfc="white", color="#0072B2")
        low, high = min(self.phi.min(), 0.25), max(self.phi.max(), 0.55)
        grid = np.linspace(low, high, 100)
        ax.plot(grid, experimental_fit(grid), ls="--", color="black", label=r"$0.14\,\phi^{-1.93}$")
        ax.set_xlabel(r"$\phi$")
        ax.set_ylabel(r"$\gamma_c$")
        ax.legend(frameon=False)
