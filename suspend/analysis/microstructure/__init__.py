"""Microstructure of the configurations of a run: pairs, clusters, density fluctuations, order, contacts.

Every quantity chooses its frames (`first`, `last`, `spaced`), reads them one at a time, and works in the sheared
cell. `microstructure` computes all of them in one pass.
"""

from suspend.analysis.microstructure.angular import AngularMaps
from suspend.analysis.microstructure.bond_order import BondOrderEvolution
from suspend.analysis.microstructure.contacts import Contacts
from suspend.analysis.microstructure.nearest_graph import (
    NearestNeighbourGraph,
    NeighbourDistances,
    nearest_clusters,
    shape_factor,
)
from suspend.analysis.microstructure.number_variance import BetaFit, NumberVariance, fit_beta, number_variance
from suspend.analysis.microstructure.overview import Microstructure, microstructure
from suspend.analysis.microstructure.pair_distribution import PairDistribution, ShearPlaneDistribution
from suspend.analysis.microstructure.snapshot import (
    FrameQuantity,
    Frames,
    Snapshot,
    compute_together,
    first,
    last,
    read_snapshot,
    spaced,
)
from suspend.analysis.microstructure.structure_factor import Hyperuniformity, StructureFactor

__all__ = [
    "AngularMaps",
    "BetaFit",
    "BondOrderEvolution",
    "Contacts",
    "FrameQuantity",
    "Frames",
    "Hyperuniformity",
    "Microstructure",
    "NearestNeighbourGraph",
    "NeighbourDistances",
    "NumberVariance",
    "PairDistribution",
    "ShearPlaneDistribution",
    "Snapshot",
    "StructureFactor",
    "compute_together",
    "first",
    "fit_beta",
    "last",
    "microstructure",
    "nearest_clusters",
    "number_variance",
    "read_snapshot",
    "shape_factor",
    "spaced",
]
