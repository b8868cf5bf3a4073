"""The near field on demand: its law is known from the start, its functions are made when a pair first feels them."""

from __future__ import annotations

from functools import cached_property
from typing import TYPE_CHECKING, NamedTuple

if TYPE_CHECKING:
    from suspend.core.pairs import PairTable
    from suspend.hydro.nearfield import NearField
    from suspend.hydro.neighbours import VerletList


class Lubrication(NamedTuple):
    """Where the functions of a pair end (centre distance, radii), how, and the gap below which they are frozen."""

    cutoff: float
    at_cutoff: str = "shifted"  # or "hard" or "tapered", see `suspend.hydro.nearfield.pair_table`
    frozen: float = 0.0  # radii; 0 = never

    def table(self, odd: bool = False) -> PairTable:
        """The functions, `suspend.hydro.nearfield.pair_table`; its errors. The shipped table is read once."""
        from suspend.hydro.nearfield import pair_table

        return pair_table(self.cutoff, self.at_cutoff, self.frozen, odd)


class NearFieldOnDemand:
    """The near field of a scene: nothing is imported, read or allocated before two spheres come within its reach.

    law : `Lubrication`, None = off; drags, threads : as of `suspend.hydro.nearfield.NearField`.
    """

    def __init__(self, law: Lubrication | None, drags: tuple[float, float], threads: int):
        self.law, self.drags, self.threads = law, drags, threads

    def of(self, pairs: VerletList, position, tilt: float) -> NearField | None:
        """The near field with a list just built at these positions (N, 3); None where it can act on no pair of it."""
        if self.law is None or not pairs.holds(position, tilt, self.law.cutoff):
            return None
        self._made.use_list(pairs.pairs, pairs.offset)
        return self._made

    @cached_property
    def _made(self) -> NearField:
        from suspend.hydro.nearfield import NearField

        return NearField(self.law.table(), self.drags, self.threads)

    @cached_property
    def odd_table(self) -> PairTable:
        """The functions for the stress of every sphere."""
        return self.law.table(odd=True)
