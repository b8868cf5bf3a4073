# ruff: noqa: RUF009 (the defaults are dataclasses.field objects)
"""The whole configuration: its sections and the keys of its top level.

Every key is declared once, here or in `physics` and `numerics`: name, type, default, unit, allowed values, meaning.
Objects of these classes are made by `load`, `loads` and `from_dict`, which validate; the classes do not. Keys
that have no meaning in a configuration (an amplitude in steady shear) are None in it.
"""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass
from typing import Any

from suspend.config.keys import key, keys_of, section, sections_of
from suspend.config.numerics import COARSEST, FINEST, WITH_EWALD, Ewald, Integrator, Output, Solver
from suspend.config.physics import Contact, Duration, External, Flow, Fluid, Lubrication, Particles, Repulsion


@dataclass(frozen=True, kw_only=True)
class Config:
    """A complete, validated configuration. Made by `load`, `loads` or `from_dict`.

    `directory` is the folder that `particles.initial` is relative to: no key, and not compared.
    """

    seed: int = key("integer", "seed of everything random", default=1, least=0, most=2**63 - 1)
    particles: Particles = section(Particles, "spheres and their starting configuration")
    fluid: Fluid = section(Fluid, "suspending fluid")
    flow: Flow = section(Flow, "undisturbed flow u = gdot(t) y e_x (x flow, y gradient, z vorticity)")
    duration: Duration = section(Duration, "length of the run")
    tolerance: float = key(
        "number",
        "accuracy of the run; integrator.tolerance, solver.tolerance, solver.far_tolerance and"
        " ewald.tolerance follow from it unless they are given",
        default=1e-3,
        least=FINEST,
        most=COARSEST,
        symbols=("accuracy", "precision"),
    )
    far_field: str = key(
        "choice",
        "ewald: many-body, by an Ewald sum; self: every sphere's own drag and stresslet, the paper's model, in"
        " which not even a pair is exact; identity: the same with the factors of the authors' code (rotational drag"
        " 3/4 and stresslet 9/5 of the right ones)",
        default="self",
        choices=("ewald", "self", "identity"),
        refused=tuple(
            (value, "write far_field: self, each sphere's own drag, where the far field is off; or ewald | identity")
            for value in (None, False, "none", "None", "off")
        ),
    )
    ewald: Ewald | None = section(
        Ewald, "Ewald sum of the far field; all follows from the tolerance", optional=True, only=WITH_EWALD
    )
    lubrication: Lubrication = section(Lubrication, "near-field hydrodynamic interactions of pairs")
    repulsion: Repulsion | None = section(
        Repulsion, "repulsion F0 exp(-(h - gap_shift)/debye_length) of pairs; h surface gap", optional=True
    )
    contact: Contact | None = section(
        Contact, "spring stiffness (gap_shift - h) for h < gap_shift", optional=True
    )
    external: External | None = section(
        External, "force and torque on every sphere, gravity for one", optional=True
    )
    integrator: Integrator = section(Integrator, "time stepping")
    solver: Solver = section(Solver, "iterative solves for the velocities")
    output: Output = section(Output, "what is stored")
    directory: str = dataclasses.field(default=".", compare=False)

    def to_dict(self) -> dict[str, Any]:
        """The keys that apply, as nested dicts of plain values; `from_dict` makes the same of them."""
        result: dict[str, Any] = {}
        for field in dataclasses.fields(self):
            value = getattr(self, field.name)
            if "key" in field.metadata:
                result[field.name] = value
            elif "section" in field.metadata:
                result[field.name] = None if value is None else _plain(value, self)
        return result

    def to_yaml(self) -> str:
        """The resolved configuration, every key that applies, as YAML; `loads` makes the same of it."""
        from suspend.config.render import to_yaml

        return to_yaml(self.to_dict())


def _plain(values: Any, config: Config) -> dict[str, Any]:
    result = {}
    for name, info in keys_of(type(values)).items():
        value = getattr(values, name)
        deciding = config if info.only is not None and info.only.top else values
        missing = info.only is not None and not info.only.holds(getattr(deciding, info.only.key))
        if missing or (info.group is not None and value is None):
            continue
        result[name] = list(value) if isinstance(value, tuple) else value
    return result


def every_key() -> dict[str, tuple]:
    """All keys of the configuration by dotted name."""
    found = dict(keys_of(Config))
    for name, part in sections_of(Config).items():
        found.update({f"{name}.{inner}": info for inner, info in keys_of(part.cls).items()})
    return found
