"""Everything a report says about one run, computed once; what cannot be computed is kept with the reason."""

from __future__ import annotations

import os
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from suspend.analysis.activity import ActiveFraction
from suspend.analysis.diffusion import SelfDiffusion
from suspend.analysis.displacements import CyclicDiffusivity, DisplacementCloud
from suspend.analysis.laos import Laos
from suspend.analysis.lissajous import Lissajous
from suspend.analysis.microstructure import (
    BondOrderEvolution,
    Contacts,
    NearestNeighbourGraph,
    NumberVariance,
    PairDistribution,
    compute_together,
    first,
    read_snapshot,
    spaced,
)
from suspend.analysis.microstructure import last as last_frames
from suspend.analysis.moduli import Moduli, read_harmonics
from suspend.analysis.normal_stresses import NormalStresses
from suspend.analysis.quantity import Quantity
from suspend.analysis.relaxation import Relaxation
from suspend.analysis.summary import Analysis, analyze_run
from suspend.errors import SuspendError
from suspend.io import Run, describe

AVERAGED, EVOLVED = 8, 16  # frames that averages and evolutions of the structure are taken from


@dataclass
class Examined:
    """A run, its quantities by name, and what is missing: (what, why).

    counts: samples of each stored cycle; statistics: the solver's, one value per cycle.
    """

    path: str
    facts: dict[str, Any]
    config: dict
    analysis: Analysis
    quantities: dict[str, Quantity] = field(default_factory=dict)
    missing: list[tuple[str, str]] = field(default_factory=list)
    counts: np.ndarray = field(default_factory=lambda: np.empty(0, int))
    statistics: dict[str, np.ndarray] = field(default_factory=dict)

    @property
    def scales(self) -> dict[str, float]:
        """Parameters of the run: gamma0, omega, phase or rate; viscosity, radius, number, volume_fraction."""
        return self.analysis.scales

    @property
    def oscillatory(self) -> bool:
        """Whether there are cycles."""
        return self.analysis.oscillatory

    @property
    def name(self) -> str:
        """Last part of the path that says something."""
        path = os.path.normpath(self.path)
        name = os.path.basename(path)
        return os.path.basename(os.path.dirname(os.path.abspath(path))) if name == "trajectory.h5" else name

    @property
    def far_field(self) -> str:
        """ewald, self or identity."""
        return str(self.config.get("far_field", "not known"))

    def get(self, name: str) -> Any:
        """A quantity, or None where it could not be computed."""
        return self.quantities.get(name)

    @property
    def last_reversal(self) -> int:
        """The first block of those at the end that are sheared in the same direction, and averaged together."""
        direction = np.sign(self.analysis["shear_rate"])
        other = np.flatnonzero(direction != direction[-1])
        return min(int(other[-1]) + 1 if other.size else 0, len(direction) - self.analysis.last)

    @property
    def notes(self) -> list[str]:
        """What the quantities say of themselves."""
        return list(dict.fromkeys(note for q in self.quantities.values() for note in getattr(q, "notes", ())))

    @property
    def last_diffusivity(self) -> tuple[float, float]:
        """D_cyc of the last cycle and its standard error over the spheres; NaN where it is not known."""
        found = self.get("diffusivity")
        if found is None or not len(found.d_cyc):
            return np.nan, np.nan
        return float(found.d_cyc[-1]), float(found.standard_error[-1])

    @property
    def diffusivity_floor(self) -> float:
        """D_cyc that the largest estimated position error of a cycle could make alone; NaN where not known."""
        error = self.statistics.get("position_error")
        if error is None or not len(error) or not self.oscillatory:
            return np.nan
        return float(np.max(error)) ** 2 / (8.0 * self.scales["gamma0"])


def examine(path: os.PathLike | str, last: int | None = None) -> Examined:
    """Compute all a report shows of a run directory or trajectory file.

    last: cycles averaged over (default: an eighth, at least four). Raises StorageError (path), ConfigurationError
    (`last`, samples that cannot be analysed), NumericalError (stress not finite).
    """
    with Run(path) as run:
        found = Examined(str(path), describe(path), run.config, analyze_run(run, last, str(path)))
        found.statistics = run.statistics() if run.stored else {}
        if run.stored:
            found.counts = np.bincount(run.series("cycle"), minlength=run.stored)
        if run.cycles == 0:
            return found
        if found.oscillatory:
            _rheology(found, run, last)
            _dynamics(found, run)
        else:
            _try(found, "self-diffusion", lambda: SelfDiffusion().compute(run), "self_diffusion")
        _structure(found, run)
    return found


def _try(found: Examined, what: str, make, name: str) -> None:
    try:
        found.quantities[name] = make()
    except SuspendError as error:
        found.missing.append((what, str(error)))


def _rheology(found: Examined, run: Run, last: int | None) -> None:
    try:
        harmonics = read_harmonics(run, last)
    except SuspendError as error:
        found.missing.append(("steady-state averages", str(error)))
        return
    found.quantities["moduli"] = Moduli().use(harmonics)
    found.quantities["normal"] = NormalStresses().use(harmonics)
    found.quantities["laos"] = Laos().use(harmonics)
    _try(found, "waveforms of the first cycle", lambda: Lissajous([0]).compute(run), "first_cycle")
    _try(found, "waveforms of the last cycle", lambda: Lissajous(1).compute(run), "last_cycle")


def _dynamics(found: Examined, run: Run) -> None:
    _try(found, "D_cyc", lambda: CyclicDiffusivity().compute(run), "diffusivity")
    diffusivity = found.get("diffusivity")
    if diffusivity is None:
        return
    _try(found, "fraction of active spheres", lambda: ActiveFraction().compute(run), "activity")
    if not len(diffusivity.d_cyc):
        found.missing.append(("D_cyc", "the positions at the end of the first cycle are not stored (yet)"))
        return
    floor = found.diffusivity_floor
    _try(
        found,
        "decay of D_cyc",
        lambda: Relaxation().fit(diffusivity.total_strain, diffusivity.d_cyc, floor if floor > 0.0 else 0.0),
        "relaxation",
    )
    known = len(diffusivity.d_cyc) - 1  # the end of the last cycle may not be stored yet
    _try(found, "displacements over a cycle", lambda: DisplacementCloud(known, 0.0, 1.0).compute(run), "cloud")


def _structure(found: Examined, run: Run) -> None:
    """One pass over few frames: the first, those of the last cycles, and some in between."""
    wanted = {
        "pairs_first": ("pair distribution at the start", PairDistribution(first())),
        "pairs_last": ("pair distribution", PairDistribution(last_frames(AVERAGED))),
        "contacts": ("contacts", Contacts(last_frames(AVERAGED))),
        "graph": ("clusters of nearest neighbours", NearestNeighbourGraph(last_frames(AVERAGED))),
        "bond_order": ("bond order", BondOrderEvolution(spaced(EVOLVED))),
        "variance": ("number variance", NumberVariance(spaced(EVOLVED))),
    }
    try:
        some = read_snapshot(run, 0)
        possible = {}
        for name, (what, quantity) in wanted.items():
            reason = quantity.missing(some)
            if reason:
                found.missing.append((what, reason))
            else:
                possible[name] = quantity
        compute_together(run, list(possible.values()))
    except SuspendError as error:
        found.missing.append(("structure", str(error)))
        return
    found.quantities |= possible
