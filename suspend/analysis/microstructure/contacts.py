"""Contacts and gaps: how many neighbours a sphere has closer than a given gap, and how gaps are distributed."""

from __future__ import annotations

from typing import Any

import numpy as np

from suspend.analysis.microstructure.snapshot import LAST, FrameQuantity, Frames, Snapshot, tabulate_frames
from suspend.missing import smallest

_SMALLEST_GAP, _LARGEST_GAP = 1e-5, 1.0  # radii


class Contacts(FrameQuantity):
    """Mean number of neighbours Z(h) with a surface gap below h, density of gaps, contact number at `gap`.

    `gap` in radii: what counts as a contact (default 0.03 a: at F0 = 10 F_stk and a Debye length of 0.01 a the
    repulsion is F_stk at 0.023 a). Gaps are binned in `per_decade` bins a decade from 1e-5 a to a; smaller and
    negative ones count in Z and are reported as overlaps and as the smallest gap.
    """

    def __init__(self, frames: Frames = LAST, gap: float = 0.03, per_decade: int = 8):
        self.frames, self.gap, self.per_decade = frames, gap, per_decade

    def begin(self) -> None:
        """Forget earlier results."""
        decades = round(np.log10(_LARGEST_GAP / _SMALLEST_GAP))
        self._edges = np.geomspace(_SMALLEST_GAP, _LARGEST_GAP, decades * self.per_decade + 1)
        self._counts, self._below, self._spheres = np.zeros(len(self._edges) - 1), 0, 0
        self._number, self._free, self._smallest, self._overlaps, self._when = [], [], [], [], []

    def add(self, snapshot: Snapshot) -> None:
        """Count the gaps of one configuration."""
        pairs, _ = snapshot.pairs(2.0 + _LARGEST_GAP)
        gaps = pairs.distance - 2.0
        self._counts += np.histogram(gaps, self._edges)[0]
        self._below += int(np.count_nonzero(gaps < self._edges[0]))
        self._spheres += snapshot.number
        touching = np.bincount(pairs.first[gaps < self.gap], minlength=snapshot.number)
        self._number.append(touching.mean())
        self._free.append(np.mean(touching == 0))
        self._smallest.append(smallest(gaps))
        self._overlaps.append(int(np.count_nonzero(gaps < 0.0)) // 2)
        self._when.append((snapshot.total_strain, snapshot.cycle))

    @property
    def gaps(self) -> np.ndarray:
        """Edges of the gap bins, in radii."""
        return self._edges

    @property
    def cumulative(self) -> np.ndarray:
        """Z(h): mean number of neighbours with a gap below each of `gaps`."""
        return (self._below + np.concatenate([[0.0], np.cumsum(self._counts)])) / self._spheres

    @property
    def density(self) -> np.ndarray:
        """dZ/dh in each bin, 1/a."""
        return self._counts / self._spheres / np.diff(self._edges)

    @property
    def contact_number(self) -> np.ndarray:
        """Mean number of contacts of a sphere, per frame."""
        return np.array(self._number)

    @property
    def without_contact(self) -> np.ndarray:
        """Share of the spheres without contact, per frame."""
        return np.array(self._free)

    @property
    def smallest_gap(self) -> np.ndarray:
        """Smallest gap per frame, in radii; NaN where none is below a, negative for an overlap."""
        return np.array(self._smallest)

    @property
    def overlaps(self) -> np.ndarray:
        """Number of overlapping pairs per frame."""
        return np.array(self._overlaps)

    @property
    def total_strain(self) -> np.ndarray:
        """gamma_tot of the frames."""
        return tabulate_frames(self._when)["total_strain[-]"]

    def table(self) -> dict[str, np.ndarray]:
        """Upper end of each gap bin, density of gaps in it, number of neighbours up to it."""
        return {"gap[a]": self._edges[1:], "density[1/a]": self.density, "neighbours_within[-]": self.cumulative[1:]}

    def evolution_table(self) -> dict[str, np.ndarray]:
        """Contact number, share without contact, smallest gap per frame."""
        return tabulate_frames(self._when) | {
            "contacts[-]": self.contact_number,
            "without_contact[share]": self.without_contact,
            "smallest_gap[a]": self.smallest_gap,
        }

    def plot(self, ax) -> None:
        """Z(h) against h."""
        ax.plot(self._edges, self.cumulative, "-")
        ax.axvline(self.gap, color="0.6", linestyle=":")
        ax.set(xlabel=r"gap $h/a$", ylabel=r"neighbours within $h$", xscale="log")

    def summary(self) -> dict[str, Any]:
        """Means over the frames."""
        return {
            "contact_gap[a]": self.gap,
            "contact_number[-]": float(self.contact_number.mean()),
            "without_contact[share]": float(self.without_contact.mean()),
            "smallest_gap[a]": smallest(self.smallest_gap),
            "overlapping_pairs": int(self.overlaps.max()),
        }
