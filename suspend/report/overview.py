"""Many runs on one page: a table with links, and the steady state against the amplitude."""

from __future__ import annotations

import math
from html import escape
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from suspend.figures.style import curve_style, errors_or_none, log_axis_of
from suspend.figures.style import number as short
from suspend.report.drawing import figure
from suspend.report.examine import Examined
from suspend.report.findings import Finding
from suspend.report.text import UNKNOWN, duration, number, table

if TYPE_CHECKING:
    from matplotlib.axes import Axes

_CURVES = {  # what is drawn against the amplitude: (title, label of the axis, sign)
    "eta_r_prime": ("Viscosity", r"$\eta_r^\prime$", 1.0),
    "minus_eta3_over_eta1": ("Shear thinning", r"$-\eta_3^\prime/\eta_1^\prime$", 1.0),
    "N2_nu0": ("Average N<sub>2</sub>", r"$-\nu_0/\eta_0$ of $N_2$", -1.0),
    "N2_nu4_over_nu2": ("Frequency doubling of N<sub>2</sub>", r"$|\nu_4|/|\nu_2|$", 1.0),
    "d_cyc": ("D<sub>cyc</sub> of the last cycle", r"$D_\mathrm{cyc}$", 1.0),
}
_NOT_KNOWN = (math.nan, math.nan)
_LOGARITHMIC = {"N2_nu4_over_nu2", "d_cyc"}


class Row(NamedTuple):
    """What the overview keeps of a run: values maps a name to (mean, standard error)."""

    name: str
    anchor: str
    flow: str
    phi: float
    gamma0: float
    number: int
    far_field: str
    strain: float
    values: dict[str, tuple[float, float]]
    q6: float
    seconds: float
    warnings: tuple[str, ...]


def row_of(run: Examined, warnings: list[Finding], anchor: str) -> Row:
    """The row of a run."""
    values = {"d_cyc": run.last_diffusivity}
    for kind in ("moduli", "normal"):
        if run.get(kind) is not None:
            values |= {name: (a.mean, a.error) for name, a in run.get(kind).steady().items() if name in _SHOWN}
    if not run.oscillatory and run.analysis.cycles.size:
        values["eta_r_prime"] = _block_viscosity(run)
    scales = run.scales
    return Row(
        run.name,
        anchor,
        run.analysis.flow,
        scales["volume_fraction"],
        scales.get("gamma0", math.nan),
        int(scales["number"]),
        run.far_field,
        float(run.analysis.total_strain[-1]) if run.analysis.cycles.size else 0.0,
        values,
        float(run.get("bond_order").global_q6[-1]) if run.get("bond_order") is not None else math.nan,
        float(np.sum(run.statistics["wall_time"])) if "wall_time" in run.statistics else math.nan,
        tuple(dict.fromkeys([warning.name for warning in warnings] + ["missing data"] * bool(run.missing))),
    )


_SHOWN = {"eta_r_prime", "eta_r_double_prime", "minus_eta3_over_eta1", "N2_nu0", "N2_nu4_over_nu2"}


def _block_viscosity(run: Examined) -> tuple[float, float]:
    averages = run.analysis.averages()
    found = averages.get("eta_r[-]", {"mean": math.nan, "standard_error": math.nan})
    return found["mean"], found["standard_error"]


def overview(rows: list[Row]) -> str:
    """Table of all runs, and their steady state against the amplitude where there is more than one."""
    head = ("Run", "φ", "γ<sub>0</sub>", "N", "Far field", "Total strain", "η<sub>r</sub>′")
    head += ("−η<sub>3</sub>′/η<sub>1</sub>′", "−ν<sub>0</sub>/η<sub>0</sub>")
    head += ("|ν<sub>4</sub>|/|ν<sub>2</sub>|", "D<sub>cyc</sub>", "Q<sub>6</sub>", "Time", "Warnings")
    body = table([_cells(row) for row in rows], head, kind="dense")
    note = '<p class="soft">Averages over the last cycles of each run; their errors are in its section.</p>'
    return f'<section id="overview"><h2>All runs</h2>\n{note}{body}\n{_figures(rows)}</section>'


def _cells(row: Row) -> tuple[str, ...]:
    def value(name: str, sign: float = 1.0) -> str:
        return number(sign * row.values.get(name, _NOT_KNOWN)[0], 3)

    return (
        f'<a href="#{row.anchor}">{escape(row.name)}</a>',
        f"{row.phi:.4g}",
        f"{row.gamma0:g}" if math.isfinite(row.gamma0) else UNKNOWN,
        str(row.number),
        escape(row.far_field),
        number(row.strain),
        number(row.values.get("eta_r_prime", _NOT_KNOWN)[0]),
        value("minus_eta3_over_eta1"),
        value("N2_nu0", -1.0),
        value("N2_nu4_over_nu2"),
        value("d_cyc"),
        number(row.q6, 3),
        duration(row.seconds),
        ", ".join(row.warnings) or "none",
    )


def _figures(rows: list[Row]) -> str:
    families: dict[tuple[float, str, int], list[Row]] = {}
    for row in rows:
        if math.isfinite(row.gamma0):
            families.setdefault((round(row.phi, 4), row.far_field, row.number), []).append(row)
    if len({row.gamma0 for family in families.values() for row in family}) < 2:
        return ""
    drawn = []
    for name, (title, label, sign) in _CURVES.items():
        caption = "Against the amplitude; bars are standard errors of each run."
        drawn.append(figure(lambda ax, n=name, s=sign, lab=label: _curves(ax, families, n, s, lab), title, caption))
    return '<h3>Against the amplitude</h3><div class="figures">' + "\n".join(drawn) + "</div>"


def _curves(ax: Axes, families: dict, name: str, sign: float, label: str) -> None:
    fields, sizes = (len({key[k] for key in families}) > 1 for k in (1, 2))
    shown = []
    for index, ((phi, far, size), family) in enumerate(sorted(families.items())):
        known = sorted((r.gamma0, *r.values[name]) for r in family if math.isfinite(r.values.get(name, _NOT_KNOWN)[0]))
        if not known:
            continue
        gamma0, mean, error = np.array(known).T
        mean = sign * mean
        text = rf"$\phi = {short(phi)}$" + (f", {far}" if fields else "") + (f", $N = {size}$" if sizes else "")
        ax.errorbar(gamma0, mean, errors_or_none(error), label=text, **curve_style(index))
        shown.append((gamma0, mean))
    ax.set_xlabel(r"$\gamma_0$")
    ax.set_ylabel(label)
    if shown:
        log_axis_of(ax, "x", np.concatenate([g for g, _ in shown]))
        if name in _LOGARITHMIC:
            log_axis_of(ax, "y", np.concatenate([m for _, m in shown]), 2.0)
        ax.legend(loc="best")
