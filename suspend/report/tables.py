"""The tables of a report: results with their errors, parts, numerics, cost, configuration."""

from __future__ import annotations

import math
from html import escape

import numpy as np

from suspend.analysis.rheology import HARMONICS
from suspend.analysis.steady import SteadyAverage, steady_average
from suspend.missing import has_value, smallest
from suspend.report.examine import Examined
from suspend.report.findings import highest_harmonics
from suspend.report.text import UNKNOWN, duration, number, percent, table, with_error

_RESULTS = {  # label: (quantity, name of its average)
    "η<sub>r</sub>′, relative viscosity": ("moduli", "eta_r_prime"),
    "η<sub>r</sub>″, relative elasticity": ("moduli", "eta_r_double_prime"),
    "−η<sub>3</sub>′/η<sub>1</sub>′": ("moduli", "minus_eta3_over_eta1"),
    "η<sub>5</sub>′/η<sub>1</sub>′": ("moduli", "eta5_over_eta1"),
    "ν<sub>0</sub>/η<sub>0</sub> of N<sub>1</sub>": ("normal", "N1_nu0"),
    "ν<sub>0</sub>/η<sub>0</sub> of N<sub>2</sub>": ("normal", "N2_nu0"),
    "|ν<sub>4</sub>|/|ν<sub>2</sub>| of N<sub>2</sub>": ("normal", "N2_nu4_over_nu2"),
    "e<sub>3</sub>/e<sub>1</sub>": ("laos", "e3_over_e1"),
    "v<sub>3</sub>/v<sub>1</sub>": ("laos", "v3_over_v1"),
    "S, strain-stiffening ratio": ("laos", "S"),
    "T, shear-thickening ratio": ("laos", "T"),
}


def results(run: Examined) -> str:
    """Steady-state averages with errors and drift, then the dynamics and the structure."""
    parts = [_averages(run), _dynamics(run)]
    return "\n".join(part for part in parts if part)


def _averages(run: Examined) -> str:
    if run.get("moduli") is not None:
        steady = {name: run.get(name).steady() for name in ("moduli", "normal", "laos")}
        entries = [(label, steady[kind][name]) for label, (kind, name) in _RESULTS.items()]
    elif run.analysis.cycles.size and not run.oscillatory:
        columns = [c for c in run.analysis.columns if not c.startswith(("total_strain", "shear_rate"))]
        since = run.last_reversal
        entries = [(_block_label(c), steady_average(run.analysis[c][since:], run.analysis.last)) for c in columns]
    else:
        return ""
    unit = "cycles" if run.oscillatory else "blocks"
    head = ("Quantity", "Mean ± standard error", "Independent " + unit, "Change", "Chance of it")
    count = entries[0][1]
    caption = (
        f'<p class="soft">Over the last {run.analysis.last} of {len(run.analysis.values)} {unit}, their correlation '
        f"included in the error. Change: of the straight line through the last {count.reference} {unit}; chance: "
        "probability of such a change without drift.</p>"
    )
    return caption + table([(label, *_average_cells(average)) for label, average in entries], head)


def _block_label(column: str) -> str:
    """Label of a column of block averages: the quantity, and which part of the stress it is of."""
    name, _, unit = column.rstrip("]").partition("[")
    base = next(base for base in _BLOCK_LABELS if name.startswith(base))
    part = name.removeprefix(base).strip("_").replace("_", " ")
    unit = "" if unit == "-" else f" [{escape(unit.replace('eta0', 'η0').replace('*', ' × '))}]"
    return _BLOCK_LABELS[base] + (f", {part}" if part else "") + unit


_BLOCK_LABELS = {
    "eta_r": "η<sub>r</sub>, relative viscosity",
    "sigma_xy": "σ<sub>xy</sub>",
    "N1": "N<sub>1</sub>",
    "N2": "N<sub>2</sub>",
}


def _average_cells(average: SteadyAverage) -> tuple[str, ...]:
    chance = number(average.p_value, 2)
    return (
        with_error(average.mean, average.error),
        number(average.effective, 3) if math.isfinite(average.error) else UNKNOWN,
        number(average.change, 2),
        f"<b>{chance}</b>" if average.drifting else chance,
    )


def _dynamics(run: Examined) -> str:
    rows: list[tuple[str, ...]] = []
    last, error = run.last_diffusivity
    if math.isfinite(last):
        rows.append(("D<sub>cyc</sub> of the last cycle", with_error(last, error)))
    relaxation, activity = run.get("relaxation"), run.get("activity")
    if relaxation is not None:
        slope = with_error(*relaxation.late_slope)
        rows.append(("State, from the decay of D<sub>cyc</sub>", f"{relaxation.state} (late slope {slope})"))
        if relaxation.best is not None:
            strain = number(relaxation.relaxation_strain, 3)
            rows.append(("Form of the decay", f"{relaxation.family}; relaxation strain {strain}"))
    if activity is not None and len(activity.fraction):
        value = with_error(float(activity.fraction[-1]), float(activity.standard_error[-1]))
        rows.append((f"Spheres displaced by more than {activity.threshold:g}&nbsp;a in the last cycle", value))
    diffusion = run.get("self_diffusion")
    if diffusion is not None:
        for k, axis in ((1, "yy"), (2, "zz")):
            value = with_error(float(diffusion.tensor[k, k]), float(diffusion.standard_error[k, k]))
            rows.append((f"D<sub>{axis}</sub>/γ&#775;a<sup>2</sup>", value))
    rows += _structure(run)
    return table(rows, kind="words") if rows else ""


def _structure(run: Examined) -> list[tuple[str, str]]:
    rows = []
    order, variance, graph, contacts = (run.get(name) for name in ("bond_order", "variance", "graph", "contacts"))
    if order is not None:
        share = 100.0 * order.crystal_fraction
        ends = [f"{number(float(order.global_q6[i]), 3)}, {share[i]:.1f}&nbsp;%" for i in (0, -1)]
        rows.append(("Q<sub>6</sub> and crystalline spheres, start → end", " → ".join(ends)))
    if variance is not None:
        ends = [with_error(float(variance.beta[i]), float(variance.error[i])) for i in (0, -1)]
        rows.append(("Exponent β of the number variance, start → end", " → ".join(ends)))
    if graph is not None:
        share = 100.0 * float(np.mean(graph.sizes < 4))
        text = f"{number(float(graph.sizes.mean()), 3)} spheres on average, {share:.0f}&nbsp;% of less than 4"
        rows.append(("Clusters of nearest neighbours", text))
    if contacts is not None:
        text = f"{number(float(contacts.contact_number.mean()), 3)} per sphere"
        rows.append((f"Contacts (gap below {contacts.gap:g}&nbsp;a)", text))
    return rows


def harmonics(run: Examined) -> str:
    """eta_n' and G_n' with errors."""
    moduli = run.get("moduli")
    if moduli is None:
        return ""
    found, window, rows = moduli.harmonics, moduli.harmonics.window, []
    for n in range(1, HARMONICS + 1):
        values = (steady_average(column[:, n], window) for column in (found.viscous(), found.elastic()))
        rows.append((str(n), *(with_error(value.mean, value.error) for value in values)))
    return table(rows, ("n", "η<sub>n</sub>′/η<sub>0</sub>", "G<sub>n</sub>′/η<sub>0</sub>ω"))


def parts(run: Examined) -> str:
    """The stress by origin."""
    moduli, normal = run.get("moduli"), run.get("normal")
    if moduli is None:
        return ""
    rheology, differences, rows = moduli.steady(), normal.steady(), []
    names = {"total": "total", "flow_driven": "… of which driven by the flow alone"}
    for part in sorted(moduli.parts, key=("total", "hydrodynamic", "flow_driven", "interparticle").index):
        tail = "" if part == "total" else "_" + part
        cells = [rheology["eta_r" + "_prime" if not tail else "eta1_prime" + tail]]
        cells.append(rheology["eta_r_double_prime" if not tail else "G1_prime" + tail])
        cells += [differences[f"{difference}_nu0{tail}"] for difference in ("N1", "N2")]
        rows.append((names.get(part, part), *(with_error(cell.mean, cell.error) for cell in cells)))
    head = ("Part of the stress", "η<sub>1</sub>′/η<sub>0</sub>", "G<sub>1</sub>′/η<sub>0</sub>ω")
    head += tuple(f"ν<sub>0</sub>/η<sub>0</sub> of N<sub>{n}</sub>" for n in "12")
    note = '<p class="soft">total = fluid (1 in η<sub>1</sub>′) + hydrodynamic + interparticle.</p>'
    return table(rows, head) + note


def errors(run: Examined) -> str:
    """What the numerics may be wrong by, beside the statistical errors."""
    config, rows = run.config, []
    integrator, solver = config.get("integrator", {}), config.get("solver", {})
    text = "<code>tolerance</code>, the others follow from it"
    rows.append(("Accuracy asked for", number(config.get("tolerance")), text))
    rows.append(_integrator_row(integrator))
    position = run.statistics.get("position_error")
    if position is not None and len(position):
        unit = "cycle" if run.oscillatory else "block"
        text = f"largest of all {unit}s (rms over spheres; in the last {unit} {number(float(position[-1]), 3)}&nbsp;a)"
        rows.append((f"Position error of a {unit}, estimated", f"{number(float(np.max(position)), 3)}&nbsp;a", text))
    if math.isfinite(run.diffusivity_floor):
        last, text = run.last_diffusivity[0], "that this position error alone could make"
        if math.isfinite(last) and run.diffusivity_floor > 0.0:
            text += f"; the last D<sub>cyc</sub> is {number(last / run.diffusivity_floor, 2)} times it"
        rows.append(("D<sub>cyc</sub> of that error", number(run.diffusivity_floor, 3), text))
    rows.append(("Near-field velocity solve", number(solver.get("tolerance")), "relative error, energy norm"))
    if run.far_field == "ewald":
        rows.append(("Coupled velocity solve", number(solver.get("far_tolerance")), "true relative residual"))
        product = config.get("ewald", {}).get("tolerance")
        rows.append(("Ewald sum", number(product), "relative error of a mobility product"))
    else:
        text = "an approximation: no hydrodynamics beyond the near field's cutoff"
        rows.append(("Far field", escape(run.far_field), text))
    tail = highest_harmonics(run)
    if math.isfinite(tail):
        text = "largest of harmonics 7 and 9 of the stress over the first: how well a cycle is resolved"
        rows.append(("Highest harmonics", number(tail, 2), text))
    moduli = run.get("moduli")
    if moduli is not None:
        average = moduli.steady()["eta_r_prime"]
        if math.isfinite(average.error):
            text = f"standard error over {average.cycles} cycles, worth {number(average.effective, 3)} independent ones"
            relative = percent(average.error / abs(average.mean)).lstrip("+")
            rows.append(("η<sub>r</sub>′, statistical", relative, text))
    return table(rows, kind="words")


def _integrator_row(integrator: dict) -> tuple[str, str, str]:
    method = escape(str(integrator.get("method", "not known")))
    if integrator.get("step") is not None:
        return ("Time step", number(integrator["step"]), f"{method}, fixed: no error control")
    return ("Integrator", number(integrator.get("tolerance")), f"{method}, rms position error per unit of strain [a]")


def cost(run: Examined) -> str:
    """Wall time and what it was spent on."""
    columns = run.statistics
    if not columns:
        return ""
    total = {name: float(np.sum(column)) for name, column in columns.items()}
    strain = float(run.analysis.total_strain[-1]) if run.analysis.cycles.size else math.nan
    meta, rows = run.facts["meta"], []
    if "wall_time" in total:
        text = f"{duration(total['wall_time'] / strain)} per unit of strain" if strain > 0.0 else ""
        rows.append(("Wall time", duration(total["wall_time"]), text))
    if "evaluations" in total:
        text = f"{number(total['evaluations'] / strain, 3)} per unit of strain" if strain > 0.0 else ""
        if total.get("wall_time"):
            text += f", {duration(total['wall_time'] / max(total['evaluations'], 1.0))} each"
        rows.append(("Velocity evaluations", number(int(total["evaluations"])), text))
        if "iterations" in total:
            each = total["iterations"] / max(total["evaluations"], 1.0)
            rows.append(("Solver iterations", number(int(total["iterations"])), f"{number(each, 3)} an evaluation"))
    if "steps" in total:
        rejected = int(total.get("rejected_error", 0)), int(total.get("rejected_overlap", 0))
        text = f"{number(rejected[0])} rejected for their error, {number(rejected[1])} for overlaps"
        rows.append(("Steps", number(int(total["steps"])), text))
    if "minimum_gap" in columns:
        gap = smallest(columns["minimum_gap"])
        text = "of all samples and steps" if has_value(gap) else "no two spheres were near each other"
        rows.append(("Smallest gap", number(gap, 3) + ("&nbsp;a" if has_value(gap) else ""), text))
    machine = f"{meta.get('threads', '?')} thread(s), {meta.get('cores', '?')} cores, {meta.get('machine', '')}"
    rows.append(("Machine", escape(machine), escape(f"begun {meta.get('created', 'at an unknown time')}")))
    text = f"{number(run.facts['frames'])} frames, {number(run.facts['samples'])} samples"
    rows.append(("On disk", f"{run.facts['bytes'] / 1e6:.3g}&nbsp;MB", text))
    return table(rows, kind="words")


def provenance(run: Examined) -> str:
    """Facts of the run besides its configuration."""
    rows = [(escape(name), escape(str(value))) for name, value in _flat(run.facts["meta"])]
    return table([("run id", escape(run.facts["run_id"])), *rows], kind="words")


def _flat(tree: dict, prefix: str = ""):
    for name, value in tree.items():
        if isinstance(value, dict):
            yield from _flat(value, f"{prefix}{name} ")
        else:
            yield prefix + name.replace("_", " "), value
