"""Bond-orientational order of degree 6 over the frames of a run: does the suspension crystallise?"""

from __future__ import annotations

from typing import Any

import numpy as np

from suspend.analysis.microstructure.snapshot import SPACED, FrameQuantity, Frames, Snapshot, tabulate_frames
from suspend.bonds import BOND_RANGE, BondOrder, bond_order_of_pairs

CRYSTALLISED = 0.1  # share of crystalline spheres above which a configuration is called crystallised


class BondOrderEvolution(FrameQuantity):
    """Global Q6, mean local q6 and the share of crystalline spheres, frame by frame (definitions: `bond_order`).

    Bonds join spheres closer than `reach` radii (default 2.8, about the first minimum of g(r)). Global Q6 is near
    zero in a fluid, 0.5745 in fcc, 0.4848 in hcp, 0.3536 in sc, 0.5107 in bcc with 14 neighbours.
    """

    def __init__(self, frames: Frames = SPACED, reach: float = BOND_RANGE):
        self.frames, self.reach = frames, reach

    def begin(self) -> None:
        """Forget earlier results."""
        self._results: list[BondOrder] = []
        self._when = []

    def add(self, snapshot: Snapshot) -> None:
        """Evaluate one configuration."""
        pairs, _ = snapshot.pairs(self.reach)
        self._results.append(bond_order_of_pairs(pairs, snapshot.number))
        self._when.append((snapshot.total_strain, snapshot.cycle))

    @property
    def global_q6(self) -> np.ndarray:
        """|<Y6>| over all bonds, per frame."""
        return np.array([result.global_q6 for result in self._results])

    @property
    def local_q6(self) -> np.ndarray:
        """Mean over the spheres of |<Y6>| over their own bonds, per frame."""
        return np.array([result.local_q6 for result in self._results])

    @property
    def crystal_fraction(self) -> np.ndarray:
        """Share of spheres with at least 7 parallel q6 bonds, per frame."""
        return np.array([result.crystal_fraction for result in self._results])

    @property
    def crystallised(self) -> bool:
        """True where more than a tenth of the spheres of the last frame are crystalline."""
        return bool(self.crystal_fraction[-1] > CRYSTALLISED)

    @property
    def total_strain(self) -> np.ndarray:
        """gamma_tot of the frames."""
        return tabulate_frames(self._when)["total_strain[-]"]

    def table(self) -> dict[str, np.ndarray]:
        """gamma_tot, cycle, Q6, q6, crystalline share."""
        return tabulate_frames(self._when) | {
            "Q6[-]": self.global_q6,
            "q6[-]": self.local_q6,
            "crystalline[share]": self.crystal_fraction,
        }

    def plot(self, ax) -> None:
        """Q6 and the crystalline share against gamma_tot."""
        ax.plot(self.total_strain, self.global_q6, "o-", markersize=3, label=r"$Q_6$")
        ax.plot(self.total_strain, self.crystal_fraction, "s--", markersize=3, label="crystalline share")
        ax.set(xlabel=r"$\gamma_{tot}$", ylim=(0.0, None))
        ax.legend()

    def summary(self) -> dict[str, Any]:
        """Values of the first and the last frame."""
        return {
            "Q6_first[-]": float(self.global_q6[0]),
            "Q6_last[-]": float(self.global_q6[-1]),
            "q6_last[-]": float(self.local_q6[-1]),
            "crystalline_last[share]": float(self.crystal_fraction[-1]),
            "crystallised": self.crystallised,
        }
