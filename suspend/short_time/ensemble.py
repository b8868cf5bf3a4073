"""Short-time properties of an ensemble: means, errors, finite-size correction, literature."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator
from dataclasses import asdict, dataclass

import numpy as np

from suspend.errors import ConfigurationError
from suspend.fluctuations import structure_factor_at_zero
from suspend.oneshot.scene import Method, PeriodicScene
from suspend.short_time import literature
from suspend.short_time.equilibrium import long_wave_structure, packed_scene
from suspend.short_time.estimators import Measured, Solve, measure
from suspend.structure import bond_order, carnahan_starling, contact_value

PROBES = 8  # random loads a configuration


@dataclass(frozen=True)
class Property:
    """One property over its dilute value.

    error : standard error of the mean from the scatter of the configurations, None with one.
    inner_error : standard error of the mean from the scatter within a configuration, over the random loads (D_s and
    D_r: their part of `error`; 0 for exact traces) or over directions (eta_inf and U).
    corrected : with the finite-size correction, None where there is none to make.
    """

    name: str
    value: float
    error: float | None
    inner_error: float
    corrected: float | None
    literature: float | None
    source: str  # of the literature; empty where there is none
    samples: tuple[float, ...]  # mean of each configuration

    @property
    def best(self) -> float:
        """The value to compare with an infinite suspension."""
        return self.value if self.corrected is None else self.corrected

    @property
    def deviation(self) -> float | None:
        """Relative deviation of `best` from the literature."""
        return None if self.literature is None else self.best / self.literature - 1.0


@dataclass(frozen=True)
class Structure:
    """Whether the configurations are a fluid at equilibrium (means over them)."""

    contact_value: float  # g(2a), NaN where too few pairs
    contact_error: float
    equilibrium_contact_value: float  # Carnahan & Starling
    long_waves: float  # S(k) of the longest waves; at equilibrium about S(0)
    long_waves_error: float | None  # from the scatter of the configurations, None with one
    global_q6: float
    crystal_fraction: float


@dataclass(frozen=True)
class ShortTimeProperties:
    """The four properties of an ensemble and how they were obtained."""

    number: int
    volume_fraction: float
    configurations: int
    probes: int  # a configuration; 0: exact traces
    solves: int
    far_field: str
    lubrication: bool
    accuracy: float
    finite_size_shift: float | None  # of D_s/D0; that of U/U0 has the factor structure_factor
    structure_factor: float  # S(0), Carnahan & Starling
    structure: Structure
    properties: tuple[Property, ...]

    def __getitem__(self, name: str) -> Property:
        """The property `eta_inf`, `D_s`, `D_r` or `U`."""
        return next(p for p in self.properties if p.name == name)

    def as_dict(self) -> dict:
        """Everything as plain values, for JSON."""
        content = asdict(self)
        content["properties"] = {
            p.name: {k: v for k, v in asdict(p).items() if k != "name"} | {"deviation": p.deviation}
            for p in self.properties
        }
        return content


def short_time_properties(
    scenes: Iterable[PeriodicScene], method: Method, probes: int = PROBES, seed: int = 1, progress=None
) -> ShortTimeProperties:
    """Mean properties of scenes with the same number of spheres and cell.

    seed : of the random loads; progress : called with the number of configurations done, or None. Raises
    ConfigurationError without a scene, for scenes that differ in number or cell, and for probes < 2.
    """
    from suspend.short_time.solver import ConfigurationSolver

    if probes < 2:
        raise ConfigurationError(f"probes: found {probes}; must be >= 2, or the random loads give no error bar")
    measured, structures, first = [], [], None
    for scene in scenes:
        first = first or scene
        if (scene.number, round(scene.edge, 6)) != (first.number, round(first.edge, 6)):
            raise ConfigurationError("configurations of one ensemble must have the same number of spheres and cell")
        random = np.random.default_rng([seed, len(measured)])
        solve: Solve = ConfigurationSolver(scene, method)
        measured.append(measure(solve, scene, probes, random, method.far_field == "ewald"))
        structures.append(_structure(scene))
        if progress is not None:
            progress(len(measured))
    if first is None:
        raise ConfigurationError("no configuration to compute properties of")
    return _summary(first, method, measured, structures)


def equilibrium_scenes(
    number: int, volume_fraction: float, configurations: int, seed: int, minimum_gap: float = 0.0
) -> Iterator[PeriodicScene]:
    """Independent configurations of the hard-sphere fluid, made one by one (`suspend.packing.random_packing`)."""
    return packed_scenes("equilibrium", number, volume_fraction, configurations, seed, minimum_gap)


def packed_scenes(
    kind: str, number: int, volume_fraction: float, configurations: int, seed: int, minimum_gap: float = 0.0
) -> Iterator[PeriodicScene]:
    """Independent packings of a kind, "equilibrium" or "quenched", made one by one (`packed_scene`)."""
    for entropy in np.random.SeedSequence(seed).generate_state(configurations):
        yield packed_scene(kind, number, volume_fraction, int(entropy), minimum_gap)


def _structure(scene: PeriodicScene) -> tuple[float, ...]:
    position, tilt = scene.wrapped(), scene.reduced_tilt
    contact = contact_value(position, scene.edge, tilt)
    order = bond_order(position, scene.edge, tilt)
    waves = long_wave_structure(scene)
    return contact.value, contact.error, waves, order.global_q6, order.crystal_fraction


def _mean_structure(phi: float, structures: list) -> Structure:
    g, g_error, waves, q6, crystal = np.array(structures).T
    count = len(g)
    return Structure(
        float(g.mean()),
        float(np.sqrt(np.mean(g_error**2) / count)),
        carnahan_starling(phi),
        float(waves.mean()),
        float(waves.std(ddof=1) / math.sqrt(count)) if count > 1 else None,
        float(q6.mean()),
        float(crystal.mean()),
    )


def _summary(scene: PeriodicScene, method: Method, measured: list[Measured], structures: list) -> ShortTimeProperties:
    phi, number = scene.volume_fraction, scene.number
    viscosities = np.array([m.viscosities for m in measured])
    viscosity = float(viscosities.mean())
    periodic = method.far_field == "ewald"
    shift = literature.finite_size_shift(phi, number, viscosity) if periodic else None
    compressibility = structure_factor_at_zero(phi)
    diffusion = np.array([m.diffusion for m in measured])  # (configurations, probes, 2)
    exact = measured[0].exact
    rows = (
        _property("eta_inf", viscosities, phi, None),
        _property("D_s", diffusion[:, :, 0], phi, shift),
        _property("D_r", diffusion[:, :, 1], phi, None),
        _property(
            "U", np.array([m.settling for m in measured]), phi, shift * compressibility if periodic else None
        ),
    )
    return ShortTimeProperties(
        number,
        phi,
        len(measured),
        0 if exact else diffusion.shape[1],
        sum(m.solves for m in measured),
        method.far_field,
        method.lubrication.enabled,
        method.accuracy,
        shift,
        compressibility,
        _mean_structure(phi, structures),
        rows,
    )


def _property(name: str, samples: np.ndarray, phi: float, shift: float | None) -> Property:
    """Mean and errors of `samples` (configurations, directions or random loads)."""
    means = samples.mean(axis=1)
    value, count = float(means.mean()), len(means)
    error = float(means.std(ddof=1) / math.sqrt(count)) if count > 1 else None
    inner = 0.0
    if samples.shape[1] > 1:
        inner = math.sqrt(np.mean(samples.var(axis=1, ddof=1)) / samples.shape[1] / count)
    fit = literature.fit(name, phi)
    corrected = None if shift is None else value + shift
    expected = None if fit is None else fit.value
    source = "" if fit is None else fit.source
    return Property(name, value, error, inner, corrected, expected, source, tuple(means.tolist()))
