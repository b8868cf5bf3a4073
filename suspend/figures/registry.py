"""The names of the figures, what each shows and needs, and which panels it is made of."""

from __future__ import annotations

import difflib
from dataclasses import dataclass
from importlib import import_module

from suspend.errors import ConfigurationError
from suspend.figures.style import DOUBLE, SINGLE

_WIDE, _TALL, _SMALL = (DOUBLE, 3.0), (SINGLE, 3.2), (SINGLE, 2.5)


@dataclass(frozen=True)
class FigureKind:
    """A figure by name: panels as "module:Class", size in inches, and what `suspend plot --list` says of it.

    number: that of the paper's figure or panel, also a name for it; "" for a figure the paper does not have.
    many: whether it is of several runs (amplitudes); a single one makes no curve. options: what its panel takes.
    """

    name: str
    number: str
    meaning: str
    panels: tuple[str, ...]
    size: tuple[float, float] = _SMALL
    many: bool = False
    options: tuple[str, ...] = ()

    def builders(self) -> list[type]:
        """The classes of the panels."""
        found = []
        for entry in self.panels:
            module, _, name = entry.partition(":")
            found.append(getattr(import_module("suspend.figures." + module), name))
        return found


_EVOLUTION, _STEADY, _THINNING = "viscosity:ViscosityEvolution", "viscosity:SteadyViscosity", "viscosity:Thinning"
_N2, _DOUBLING = "normal_stresses:SecondDifference", "normal_stresses:Doubling"
_LOOPS = "normal_stresses:SecondLissajous"
_SPREADING, _FINAL = "diffusivity:DiffusivityEvolution", "diffusivity:FinalDiffusivity"
_DIAGRAM = "phase_diagram:TransitionDiagram"
_CLUSTERS, _NEIGHBOURS = "structure:Clusters", "structure:NeighbourDistance"
_BETA = "structure:NumberVarianceExponent"
_PICTURE, _MOVIE = ("cycle", "phase", "colour"), ("cycle", "colour")
_COLOURED = "coloured by stress (or --colour)"

FIGURES = tuple(
    FigureKind(name, number, meaning, panels if isinstance(panels, tuple) else (panels,), *more)
    for name, number, meaning, panels, *more in (
        (
            "snapshot",
            "1",
            f"spheres in the sheared cell over a cycle, {_COLOURED}",
            "snapshot:Snapshot",
            (DOUBLE, 1.6),
            False,
            _PICTURE,
        ),
        (
            "animation",
            "",
            f"the sheared cell over a cycle as GIF or MP4, {_COLOURED}",
            "animation:Animation",
            _SMALL,
            False,
            _MOVIE,
        ),
        (
            "viscosity",
            "2",
            "viscosity: evolution, steady value, shear thinning",
            (_EVOLUTION, _STEADY, _THINNING),
            _WIDE,
            True,
        ),
        ("viscosity-evolution", "2a", "eta_r', eta_r'' against total strain; the last half cycle", _EVOLUTION, _TALL),
        ("viscosity-amplitude", "2b", "steady eta_r' against amplitude", _STEADY, _SMALL, True),
        ("thinning", "2c", "-eta3'/eta1' against amplitude", _THINNING, _SMALL, True),
        (
            "n1",
            "3",
            "average N1 against amplitude, and its hydrodynamic part",
            "normal_stresses:FirstDifference",
            _TALL,
            True,
        ),
        ("n2", "4", "N2: average, frequency doubling, Lissajous curves", (_N2, _DOUBLING, _LOOPS), _WIDE, True),
        ("n2-average", "4a", "average N2 against amplitude, whole and interparticle", _N2, _SMALL, True),
        ("n2-doubling", "4b", "|nu4|/|nu2| of N2 against amplitude, whole and hydrodynamic", _DOUBLING, _TALL, True),
        ("n2-lissajous", "4c", "N2 against strain over a cycle", _LOOPS, _TALL),
        (
            "dynamics",
            "5",
            "D_cyc in time and against amplitude, phase diagram",
            (_SPREADING, _FINAL, _DIAGRAM),
            _WIDE,
            True,
        ),
        (
            "diffusivity-evolution",
            "5a",
            "D_cyc against total strain; displacements over half a cycle",
            _SPREADING,
            _TALL,
        ),
        (
            "diffusivity-amplitude",
            "5b",
            "final D_cyc against amplitude, and the bounds on gamma_c",
            _FINAL,
            _SMALL,
            True,
        ),
        ("phase-diagram", "5c", "bounds on gamma_c from the rheology against volume fraction", _DIAGRAM, _SMALL, True),
        (
            "angular-maps",
            "6",
            "directions of neighbours at three peaks of g(r), initial and final",
            "maps:DirectionMaps",
            (SINGLE, 3.0),
        ),
        (
            "clusters",
            "7",
            "nearest-neighbour graph, distances, number variance",
            (_CLUSTERS, _NEIGHBOURS, _BETA),
            (DOUBLE, 2.7),
        ),
        ("cluster-distributions", "", "sizes and shapes in the nearest-neighbour graph", _CLUSTERS, (SINGLE, 2.8)),
        ("neighbour-distance", "7a", "mean distance to the k-th neighbour, initial and final", _NEIGHBOURS),
        ("number-variance", "7b", "exponent beta of the number variance in time, and its fit", _BETA),
        (
            "pair-distribution",
            "",
            "g(r) and g in the shear plane",
            ("structure:Pairs", "structure:ShearPlane"),
            (DOUBLE, 2.7),
        ),
        ("structure-factor", "", "S(q), initial and final", "structure:Scattering"),
    )
)


def figure_kind(name: str) -> FigureKind:
    """The figure called `name`, or whose number in the paper it is ("2b", "fig2b"). Raises ConfigurationError."""
    wanted = name.lower().replace("_", "-")
    short = wanted.removeprefix("figure").removeprefix("fig").lstrip("-.")
    for kind in FIGURES:
        if wanted == kind.name or (kind.number and short == kind.number):
            return kind
    near = difflib.get_close_matches(wanted, [kind.name for kind in FIGURES], n=1, cutoff=0.5)
    hint = f"did you mean {near[0]}? " if near else ""
    raise ConfigurationError(f"there is no figure {name!r}: {hint}`suspend plot --list` prints the names")
