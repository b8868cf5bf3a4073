"""What keys must satisfy together. Each check sees the values that are right by themselves.

The frequency is resolved to omega here, too, and the tolerances that follow from the run's.
"""

from __future__ import annotations

import difflib
import itertools
import math
import os
from collections.abc import Callable
from typing import Any

from suspend.config.numerics import FINEST, NEAR_SHARE
from suspend.config.physics import DENSEST_RANDOM, FORMERLY, PACKED
from suspend.config.tree import Problems

NOISE = 10.0  # largest far-field tolerance over the integrator's: at 100 no step is accepted (N = 100, phi = 0.3)
HARMONICS = 9  # analysed of the stress; a Fourier sum of n samples resolves harmonics below n/2
DENSEST_WITH_GAP = 0.62  # of a random packing, its minimum gap counted as part of the spheres

LARGEST_EDGE = 1e9  # radii

Values = dict[str, Any]
Complain = Callable[[str, str], None]


def check_consistency(values: Values, places: dict[str, str], problems: Problems) -> None:
    """Check all combinations, add what is wrong to `problems`, and resolve flow.frequency to flow.omega.

    values : nested values; a key with an error is absent. places : where each dotted key was written.
    """

    def complain(key: str, message: str) -> None:
        problems.add(places.get(key, places[""]), key, message)

    for check in (
        _cell, _packing, _initial, _frequency, _duration, _ewald, _lubrication, _contact, _integrator, _output,
    ):  # fmt: skip
        check(values, complain)
    _resolve_tolerances(values)
    _noise(values, complain)


def _all(section: Values | None, *names: str) -> list | None:
    """Values of these keys, None if any is absent or null."""
    found = [(section or {}).get(name) for name in names]
    return None if None in found else found


def _cell(values: Values, complain: Complain) -> None:
    found = _all(values["particles"], "number", "volume_fraction")
    if not found:
        return
    thinnest = found[0] * 4.0 * math.pi / (3.0 * LARGEST_EDGE**3)
    if found[1] < thinnest:
        complain(
            "particles.volume_fraction",
            f"found {found[1]:g}; must be >= {thinnest:.3g} for {found[0]} spheres: beyond a cell edge of"
            f" {LARGEST_EDGE:g} radii double precision does not hold the gaps between spheres (to 1e-7 radii)",
        )


def _packing(values: Values, complain: Complain) -> None:
    found = _all(values["particles"], "volume_fraction", "initial")
    if not found or found[1] not in PACKED:
        return
    phi, gap = found[0], values["particles"].get("minimum_gap")
    if phi > DENSEST_RANDOM:
        complain(
            "particles.volume_fraction",
            f"found {phi:g}; random configurations are made up to {DENSEST_RANDOM:g}: lower it, or read the"
            " configuration from a file with particles.initial",
        )
    elif gap is not None and phi * (1.0 + 0.5 * gap) ** 3 > DENSEST_WITH_GAP:
        largest = 2.0 * ((DENSEST_WITH_GAP / phi) ** (1.0 / 3.0) - 1.0)
        complain(
            "particles.minimum_gap",
            f"found {gap:g}; must be <= {largest:.3g} for a random packing of volume fraction {phi:g}",
        )


def _initial(values: Values, complain: Complain) -> None:
    initial = values["particles"].get("initial")
    if initial is None or initial in PACKED or os.sep in initial or "." in initial:
        return
    # A word without suffix is a folder, or a misspelt name of what is made here.
    close = difflib.get_close_matches(initial.lower(), [*PACKED, FORMERLY], 1, 0.7)
    if close:
        meant = " or ".join(PACKED) if close[0] == FORMERLY else close[0]
        complain("particles.initial", f"found {initial!r}; did you mean {meant}? (A folder: ./{initial})")


def _frequency(values: Values, complain: Complain) -> None:
    flow = values["flow"]
    frequency = flow.get("frequency")
    if frequency is not None:
        flow.update(omega=2.0 * math.pi * frequency, frequency=None)
    found = _all(flow, "amplitude", "omega")
    if found and not 1e-30 <= found[0] * found[1] <= 1e30:
        product = found[0] * found[1]
        complain("flow.amplitude", f"amplitude x omega is {product:g}; must be 1e-30 to 1e30")


def _duration(values: Values, complain: Complain) -> None:
    flow, duration = values["flow"], values["duration"]
    kind, cycles, strain = flow.get("type"), duration.get("cycles"), duration.get("strain")
    if kind is not None and kind != "oscillatory" and cycles is not None:
        complain("duration.cycles", f"flow.type is {kind}: give duration.strain instead")
    if kind is not None and kind != "oscillatory" and duration.get("until_steady") is not None:
        complain(
            "duration.until_steady",
            f"flow.type is {kind}: the test compares cycles of oscillatory flow; leave it out, duration.strain ends the"
            " run",
        )
    found = _all(flow, "reversal_strain")
    if found and strain is not None and found[0] >= strain:
        complain(
            "flow.reversal_strain",
            f"found {found[0]:g}; must be below duration.strain, {strain:g}, the end of the run",
        )


def _ewald(values: Values, complain: Complain) -> None:
    if values.get("far_field") != "ewald":
        return
    found = _all(values["particles"], "number", "volume_fraction")
    if found:
        edge = (found[0] * 4.0 * math.pi / (3.0 * found[1])) ** (1.0 / 3.0)
        if edge < 2.0:
            complain(
                "particles.number",
                f"{found[0]} at volume fraction {found[1]:g} fill a cell of edge {edge:.4g} radii, in which a"
                " sphere overlaps its own image (edge < 2): the cell is too small for far_field: ewald; take"
                " more spheres or a lower volume fraction",
            )
    found = _all(values["ewald"], "grid", "support")
    if found and min(found[0]) < found[1]:
        complain("ewald.grid", f"found {list(found[0])}; must be >= ewald.support, {found[1]}, everywhere")


def _resolve_tolerances(values: Values) -> None:
    """Put what follows from the run's tolerance in the place of null."""
    tolerance = values.get("tolerance")
    if tolerance is None:
        return
    shares = [("integrator", "tolerance", 1.0), ("solver", "tolerance", NEAR_SHARE)]
    for section, name, share in shares:
        if values[section] is not None and values[section].get(name, 0.0) is None:
            values[section][name] = share * tolerance
    if values.get("far_field") != "ewald":
        return
    finer = min(tolerance, values["integrator"].get("tolerance", tolerance))
    for section, name, least in (("solver", "far_tolerance", 0.0), ("ewald", "tolerance", FINEST)):
        if values[section] is not None and values[section].get(name, 0.0) is None:
            values[section][name] = max(finer, least)


def _noise(values: Values, complain: Complain) -> None:
    """Errors of the far field that jump from step to step must not drown the integrator's estimate."""
    found = _all(values["integrator"], "tolerance")
    if values.get("far_field") != "ewald" or not found or values["integrator"].get("step") is not None:
        return
    for section, name in (("solver", "far_tolerance"), ("ewald", "tolerance")):
        given = (values[section] or {}).get(name)
        if given is not None and given > max(NOISE * found[0], FINEST):
            complain(
                f"{section}.{name}",
                f"found {given:g}; must be at most {NOISE:g} x integrator.tolerance, {found[0]:g}: its error would be"
                " taken for the step's, and no step be small enough. Lower it, or set `tolerance` alone",
            )


def _lubrication(values: Values, complain: Complain) -> None:
    found = _all(values["lubrication"], "cutoff", "minimum_gap")
    if found and found[1] >= found[0] - 2.0:
        complain(
            "lubrication.minimum_gap",
            f"found {found[1]:g}; must be below lubrication.cutoff - 2 = {found[0] - 2.0:g}",
        )


def _contact(values: Values, complain: Complain) -> None:
    gap_shift = _all(values["contact"], "gap_shift")
    found = _all(values["lubrication"], "enabled", "minimum_gap")
    if gap_shift and found and gap_shift[0] == 0.0 and found[0] and found[1] == 0.0:
        complain(
            "contact",
            "can never act: spheres touch only at gap 0, where lubrication is infinite. Freeze lubrication"
            " below a gap (lubrication.minimum_gap: 1e-3) or let contact begin at one (contact.gap_shift),"
            " or leave the contact section out",
        )


def _integrator(values: Values, complain: Complain) -> None:
    integrator = values["integrator"]
    if integrator.get("method") in ("rk2", "rk4") and "step" in integrator and integrator["step"] is None:
        complain(
            "integrator.step",
            f"is missing: {integrator['method']} has no error estimate; give a fixed step, or take method"
            " bogacki-shampine or tsitouras",
        )
    limits = _all(integrator, "min_step", "max_step")
    if limits and limits[0] >= limits[1]:
        message = f"found {limits[0]:g}; must be below integrator.max_step, {limits[1]:g}"
        complain("integrator.min_step", message)


def _output(values: Values, complain: Complain) -> None:
    samples, kind = values["output"].get("samples_per_cycle"), values["flow"].get("type")
    if kind == "oscillatory" and samples is not None and samples <= 2 * HARMONICS:
        complain(
            "output.samples_per_cycle",
            f"found {samples}; must be > {2 * HARMONICS}: harmonics 1 to {HARMONICS} are analysed",
        )
    phases = values["output"].get("position_phases")
    if phases and (phases[0] != 0.0 or any(a >= b for a, b in itertools.pairwise(phases))):
        complain(
            "output.position_phases",
            f"found {list(phases)}; must begin with 0.0, the cycle's start, and increase",
        )
