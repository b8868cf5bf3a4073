"""What a reader must know before trusting the numbers: unfinished, drifting, crystallised, under-resolved, ..."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from suspend.analysis.steady import SteadyAverage, steady_average
from suspend.report.examine import Examined
from suspend.report.text import number, percent

JUDGED = 100  # spheres from which on order says something
FEW_SAMPLES = 32  # a cycle
TAIL = 0.01  # of the first harmonic, in the highest odd ones: what lies above folds onto the lower ones
LATE = 100.0  # total strain after which the responses of the paper still drift
SETTLED = 0.01  # relative change that does not matter
NOISE = 10.0  # D_cyc must exceed by this what the integrator's error could make


class Finding(NamedTuple):
    """A warning: short name, and what was found as HTML."""

    name: str
    text: str


def findings(run: Examined) -> list[Finding]:
    """All warnings about a run, the gravest first."""
    found = [*_progress(run), *_samples(run), *_overlaps(run)]
    if run.analysis.cycles.size:
        found += [*_drift(run), *_resolution(run), *_noise(run)] if run.oscillatory else _drift_of_blocks(run)
    return [*found, *_crystal(run)]


def checked(run: Examined) -> list[str]:
    """What `findings` could look for in this run, in words."""
    steadiness = run.get("moduli") is not None or "eta_r" in run.analysis
    possible = {
        "finished": True,
        "steady": steadiness,
        "resolved": run.get("moduli") is not None,
        "without overlaps": "overlaps" in run.statistics,
        "not crystallised": run.get("bond_order") is not None and run.scales["number"] >= JUDGED,
    }
    return [name for name, looked in possible.items() if looked]


def _progress(run: Examined):
    unit = "cycle" if run.oscillatory else "block"
    done = len(run.analysis.values)
    if not run.facts["finished"]:
        who = f", and goes on ({run.facts['running']})" if run.facts["running"] else ""
        text = f"it has not reached its configured duration{who}; {done} {unit}(s) are complete"
        yield Finding("unfinished run", text)
    if run.facts["incomplete_cycle"]:
        yield Finding("incomplete last " + unit, f"the last {unit} is not complete and is left out")
    if 0 < done < 4:
        yield Finding("too few " + unit + "s", f"{done} complete {unit}(s): no statistical error, no test for drift")


def _samples(run: Examined):
    expected = run.config.get("output", {}).get("samples_per_cycle")
    counts = run.counts[: len(run.analysis.values)]
    if expected is None or not counts.size or not run.oscillatory:
        return
    wrong = np.flatnonzero(counts != expected)
    if wrong.size:
        yield Finding(
            "missing samples",
            f"{wrong.size} cycle(s) do not hold the {expected} samples of the configuration, the first is "
            f"cycle {wrong[0]} with {counts[wrong[0]]}",
        )


def _overlaps(run: Examined):
    count = int(np.sum(run.statistics.get("overlaps", 0)))
    if count:
        yield Finding("overlaps", f"{number(count)} time(s) spheres overlapped when the stress was sampled")
    contacts = run.get("contacts")
    if contacts is not None and contacts.overlaps.max(initial=0):
        gap = number(float(contacts.smallest_gap.min()), 3)
        yield Finding("overlaps", f"spheres overlap in the last stored positions (smallest gap {gap}&nbsp;a)")


def _drift(run: Examined):
    moduli = run.get("moduli")
    if moduli is None:
        return
    averages = moduli.steady()
    scale = abs(averages["eta_r_prime"].mean)
    for name, label in (("eta_r_prime", "η<sub>r</sub>′"), ("eta_r_double_prime", "η<sub>r</sub>″")):
        average = averages[name]
        if average.drifting and abs(average.change) > SETTLED * scale:
            yield Finding("not steady", _drifting(label, average, scale))
        elif average.verdict == "slow" and abs(average.change) > SETTLED * scale:
            text = f"{label} changes as slowly as the last {average.reference} cycles are long: drift or noise"
            yield Finding("steadiness not known", text)
    late = _since(run, moduli.eta_r_prime)
    if late is not None:
        yield late


def _drift_of_blocks(run: Examined):
    if run.analysis.flow == "quiescent":
        return
    values = run.analysis["eta_r"][run.last_reversal :]
    average = steady_average(values, run.analysis.last)
    if average.drifting and abs(average.change) > SETTLED * abs(average.mean):
        yield Finding("not steady", _drifting("η<sub>r</sub>", average, abs(average.mean), "blocks"))


def _drifting(label: str, average: SteadyAverage, scale: float, unit: str = "cycles") -> str:
    return (
        f"{label} changes by {number(average.change, 3)} ({percent(average.change / scale)} of the viscosity) "
        f"over the last {average.reference} {unit}, by chance with probability {number(average.p_value, 2)}"
    )


def _since(run: Examined, values: np.ndarray) -> Finding | None:
    """The viscosity at the end against that at total strain 100."""
    strain = run.analysis.total_strain
    if strain[-1] < 1.5 * LATE:
        return None
    there = int(np.searchsorted(strain, LATE * (1.0 + 1e-9)))  # cycles that end before
    window = max(4, there // 8)
    if there < 8:
        return None
    before = steady_average(values[:there], window)
    after = steady_average(values, min(window, len(values)))
    change = after.mean - before.mean
    error = math.hypot(after.error, before.error)
    if not abs(change) > max(3.0 * error, SETTLED * abs(after.mean)):
        return None
    return Finding(
        "drifted",
        f"η<sub>r</sub>′ has changed by {percent(change / before.mean)} since total strain {LATE:g} "
        f"(from {number(before.mean)} to {number(after.mean)}, {number(abs(change) / error, 2)} standard errors)",
    )


def _resolution(run: Examined):
    samples = int(run.counts[-1]) if run.counts.size else 0
    tail = highest_harmonics(run)
    if samples < FEW_SAMPLES:
        text = f"{samples} samples a cycle; {FEW_SAMPLES} or more resolve the ninth harmonic well"
        yield Finding("under-resolved", text)
    elif tail > TAIL:
        yield Finding(
            "under-resolved",
            f"harmonics 7 and 9 of σ<sub>xy</sub> still have {percent(tail).lstrip('+')} of the first: what lies "
            f"above the ninth is not seen, and above the {samples // 2}th ({samples} samples a cycle) folds down",
        )


def highest_harmonics(run: Examined) -> float:
    """Largest of harmonics 7 and 9 of the shear stress relative to the first, of the averaged cycle; NaN unknown."""
    moduli = run.get("moduli")
    if moduli is None:
        return math.nan
    coefficients = moduli.harmonics.coefficients["total"][-moduli.harmonics.window :, 0].mean(axis=0)
    return float(np.abs(coefficients[[7, 9]]).max() / np.abs(coefficients[1])) if coefficients[1] else math.nan


def _noise(run: Examined):
    floor, (last, _) = run.diffusivity_floor, run.last_diffusivity
    if math.isfinite(floor) and math.isfinite(last) and last < NOISE * floor:
        yield Finding(
            "D<sub>cyc</sub> near the integrator's error",
            f"the last D<sub>cyc</sub> is {number(last, 3)}; the estimated position error of a cycle alone could make "
            f"{number(floor, 3)}: lower the tolerance to tell an absorbing state from a diffusing one",
        )


def _crystal(run: Examined):
    order = run.get("bond_order")
    if order is None or run.scales["number"] < JUDGED:
        return
    if order.crystallised:  # not by Q6, which is 1/sqrt(bonds) in a gas: large where there are few
        share, q6 = 100.0 * order.crystal_fraction, order.global_q6
        yield Finding(
            "crystallised",
            f"Q<sub>6</sub> is {number(float(q6[-1]), 3)} at the end (at the start {number(float(q6[0]), 3)}), "
            f"{share[-1]:.0f}&nbsp;% of the spheres are crystalline (at the start {share[0]:.0f}&nbsp;%)",
        )
