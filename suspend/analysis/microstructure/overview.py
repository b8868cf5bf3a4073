"""All of the microstructure of a run in one pass over its frames."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

from suspend.analysis.microstructure.angular import AngularMaps
from suspend.analysis.microstructure.bond_order import BondOrderEvolution
from suspend.analysis.microstructure.contacts import Contacts
from suspend.analysis.microstructure.nearest_graph import NearestNeighbourGraph, NeighbourDistances
from suspend.analysis.microstructure.number_variance import NumberVariance
from suspend.analysis.microstructure.pair_distribution import PairDistribution, ShearPlaneDistribution
from suspend.analysis.microstructure.snapshot import FrameQuantity, compute_together, first, last, read_snapshot, spaced
from suspend.analysis.microstructure.structure_factor import StructureFactor

if TYPE_CHECKING:
    from suspend.io import Run


@dataclass(frozen=True)
class Microstructure:
    """Quantities by name ("..._first": initial configuration, "..._last": average over the last cycles).

    `notes` say which quantities the run cannot give, and why.
    """

    quantities: dict[str, FrameQuantity] = field(default_factory=dict)
    notes: tuple[str, ...] = ()

    def __getitem__(self, name: str) -> FrameQuantity:
        return self.quantities[name]

    def summary(self) -> dict[str, Any]:
        """Scalars of all quantities; those of two sets of frames as "initial_NAME" and "NAME"."""
        result = {}
        for name, quantity in self.quantities.items():
            prefix = "initial_" if name.endswith("_first") else ""
            result |= {prefix + key: value for key, value in quantity.summary().items()}
        return result


def microstructure(run: Run, last_frames: int = 8, spaced_frames: int = 24, phase: float = 0.0) -> Microstructure:
    """Compute every quantity of this package for an open run, at one phase of the cycle.

    Averages take the last `last_frames` frames of that phase, evolutions at most `spaced_frames` frames, dense at
    the start. What the run cannot give (a cell too small for the number variance, one sphere) is left out and
    named in the notes. Raises ConfigurationError where there is no frame of that phase.
    """
    ends = {"first": first(1, phase), "last": last(last_frames, phase)}
    evolution = spaced(spaced_frames, phase)
    wanted: dict[str, FrameQuantity] = {}
    for name, frames in ends.items():
        wanted[f"pair_distribution_{name}"] = PairDistribution(frames)
        wanted[f"angular_maps_{name}"] = AngularMaps(frames)
        wanted[f"shear_plane_{name}"] = ShearPlaneDistribution(frames)
        wanted[f"graph_{name}"] = NearestNeighbourGraph(frames)
        wanted[f"distances_{name}"] = NeighbourDistances(frames)
        wanted[f"structure_factor_{name}"] = StructureFactor(frames)
        wanted[f"contacts_{name}"] = Contacts(frames)
    wanted["number_variance"] = NumberVariance(evolution)
    wanted["bond_order"] = BondOrderEvolution(evolution)
    some = read_snapshot(run, 0) if run.n_frames else None
    reasons = {name: quantity.missing(some) if some else None for name, quantity in wanted.items()}
    notes = [f"{name.replace('_', ' ')}: {reason}" for name, reason in reasons.items() if reason]
    possible = {name: quantity for name, quantity in wanted.items() if not reasons[name]}
    compute_together(run, list(possible.values()))
    return Microstructure(possible, tuple(notes))
