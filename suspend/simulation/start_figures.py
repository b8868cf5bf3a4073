"""Figures that show what kind of start a run has, each beside that of the hard-sphere fluid at equilibrium."""

from __future__ import annotations

import math
from typing import NamedTuple

from suspend.fluctuations import (
    ALL_PAIRS,
    FREEZING,
    MINIMUM_RANGE,
    SMALLEST,
    equilibrium_exponent,
    equilibrium_structure_factor,
    holds_range,
    smallest_wave_structure,
    variance_exponent,
)
from suspend.initial import InitialConfiguration
from suspend.missing import text
from suspend.structure import bond_order, carnahan_starling, contact_value

DENSEST_FLUID = 0.62  # volume fraction up to which its figures are given
FEWEST = 30  # spheres, below which density fluctuations say nothing


class Compared(NamedTuple):
    """A figure and that of the fluid; NaN where there is none."""

    value: float
    equilibrium: float


class StartFigures(NamedTuple):
    """Of a starting configuration: its kind, structure near contact and at the longest waves, order, smallest gap."""

    kind: str  # "equilibrium", "quenched" or "file"
    effective_volume_fraction: float  # that of the fluid compared with: the spheres with their minimum gap
    contact_value: Compared  # g(r) at contact
    s_qmin: Compared  # S at the smallest wave number, mean over three waves
    beta0: Compared  # exponent of the number variance over [2 a, L/4]
    beta0_note: str  # why there is no beta0; empty where there is one
    global_q6: float
    crystal_fraction: float
    minimum_gap: float
    unstirred: str  # why the long waves are not at equilibrium although the kind says so; else empty

    def meta(self) -> dict:
        """What is stored with the run: names of plain values, left out where there is none."""
        named = ((name, getattr(self, name)) for name in ("contact_value", "s_qmin", "beta0"))
        compared = {name: pair for name, pair in named if math.isfinite(pair.value)}
        values = {
            "start_kind": self.kind,
            **{f"start_{name}": pair.value for name, pair in compared.items()},
            **{f"start_{name}_equilibrium": pair.equilibrium for name, pair in compared.items()},
            "start_beta0_note": self.beta0_note,
            "start_q6": self.global_q6,
            "start_crystal_fraction": self.crystal_fraction,
            "start_long_waves_note": self.unstirred,
        }
        return {n: v for n, v in values.items() if v != "" and not (isinstance(v, float) and math.isnan(v))}

    def line(self) -> str:
        """The same for a reader, in one line."""
        fluid = "equilibrium fluid" if self.effective_volume_fraction <= FREEZING else "metastable fluid"
        named = (("g(contact)", self.contact_value), ("S(qmin)", self.s_qmin), ("beta0", self.beta0))
        parts = [f"{name} {_beside(pair, fluid)}" for name, pair in named if math.isfinite(pair.value)]
        if self.beta0_note:
            parts.append(f"no beta0 ({self.beta0_note})")
        parts += [f"Q6 {self.global_q6:.3g}", f"smallest gap {text(self.minimum_gap, '.3g', ' a')}"]
        what = "configuration of a file" if self.kind == "file" else f"{self.kind} packing"
        return f"start: {what}, " + ", ".join(parts) + (f"; {self.unstirred}" if self.unstirred else "")


def _beside(pair: Compared, fluid: str) -> str:
    return f"{pair.value:.3g}" + (f" ({fluid} {pair.equilibrium:.3g})" if math.isfinite(pair.equilibrium) else "")


def start_figures(initial: InitialConfiguration, minimum_gap: float | None) -> StartFigures:
    """The figures of a prepared start; minimum_gap in radii, that asked of a packing, None for a file.

    beta0 visits every pair (about 10 s at N = 40,000) and is left out beyond; the fluid's figures end at a volume
    fraction of 0.62, above freezing they are those of the metastable fluid.
    """
    x, length, tilt, packing = initial.positions, initial.length, initial.tilt, initial.packing
    diameter = 2.0 + (minimum_gap or 0.0)
    phi = len(x) * math.pi / 6.0 * (diameter / length) ** 3
    contact = packing if packing is not None else contact_value(x, length, tilt, diameter)
    order = packing if packing is not None else bond_order(x, length, tilt)
    note = _no_exponent(len(x), length)
    beta = math.nan if note else variance_exponent(x, length, tilt)
    fluid = [math.nan] * 3
    if phi <= DENSEST_FLUID:
        longest = float(equilibrium_structure_factor(2.0 * math.pi / length, phi, diameter))
        exponent = math.nan if note else equilibrium_exponent(len(x), length, phi, diameter)
        fluid = [carnahan_starling(phi), longest, exponent]
    return StartFigures(
        packing.kind if packing is not None else "file",
        phi,
        Compared(contact.contact_value if packing is not None else contact.value, fluid[0]),
        Compared(smallest_wave_structure(x, length, tilt) if len(x) >= FEWEST else math.nan, fluid[1]),
        Compared(beta, fluid[2]),
        note,
        order.global_q6,
        order.crystal_fraction,
        math.nan if initial.minimum_gap is None else initial.minimum_gap,
        _unstirred(packing),
    )


def _no_exponent(number: int, length: float) -> str:
    if not holds_range(length):
        return f"L/4 is {0.25 * length:.3g} a, below {MINIMUM_RANGE * SMALLEST:g} a"
    if number < FEWEST:
        return f"fewer than {FEWEST} spheres"
    return f"more than {ALL_PAIRS} spheres" if number > ALL_PAIRS else ""


def _unstirred(packing) -> str:
    if packing is None or packing.kind != "equilibrium" or packing.long_waves:
        return ""
    return (
        f"its longest waves are not at equilibrium: stirred by {packing.rms_travel:.3g} a, "
        f"which would take {packing.needed_travel:.3g} a"
    )
