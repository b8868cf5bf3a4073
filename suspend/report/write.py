"""`write_report`: runs in, one HTML file out."""

from __future__ import annotations

import os
from collections.abc import Iterable
from html import escape
from pathlib import Path

from suspend.errors import ConfigurationError, StorageError, SuspendError, named
from suspend.io.files import replace_text, storage_errors
from suspend.report import tables
from suspend.report.drawing import figures_of
from suspend.report.examine import Examined, examine
from suspend.report.findings import Finding, checked, findings
from suspend.report.overview import Row, overview, row_of
from suspend.report.page import check_target, document
from suspend.report.text import number, preformatted, unfolding

_FLOWS = {"oscillatory": "oscillatory shear", "steady": "steady shear", "reversal": "shear with reversals"}


def write_report(
    runs: Iterable[os.PathLike | str], target: os.PathLike | str, *, last: int | None = None, title: str | None = None
) -> list[str]:
    """Write one self-contained page about the runs (folders or trajectory files); returns what was left out.

    last: cycles averaged over (default: an eighth of a run's, at least four). Runs are read one after the other, so
    memory does not grow with their number but for the page itself. Runs that cannot be read are listed on the page
    with the reason. Atomic. Raises ConfigurationError (suffix, no runs), StorageError (target, no readable run).
    """
    target, paths = check_target(target), _unique(runs)
    if not paths:
        raise ConfigurationError("no runs were given: give the folders of one run or more")
    sections, rows, failed = [], [], []
    for path in paths:
        try:
            run = examine(path, last)
            warnings = findings(run)
            sections.append(_section(run, warnings, f"run-{len(rows) + 1}"))
            rows.append(row_of(run, warnings, f"run-{len(rows) + 1}"))
        except SuspendError as error:
            failed.append((path, error))
    if not rows:
        raise failed[0][1] if len(failed) == 1 else StorageError(
            f"none of the {len(failed)} runs can be read; the first: {failed[0][1]}"
        )
    page = _page(title or _title(rows), rows, sections, [named(path, error) for path, error in failed])
    with storage_errors("write", target):
        replace_text(target, page)
    return [f"left out: {named(path, error)}" for path, error in failed]


def _unique(runs: Iterable[os.PathLike | str]) -> list[Path]:
    found: dict[Path, Path] = {}
    for path in map(Path, runs):
        found.setdefault(path.resolve(), path)
    return list(found.values())


def _title(rows: list[Row]) -> str:
    return f"Report on {rows[0].name}" if len(rows) == 1 else f"Report on {len(rows)} runs"


def _page(title: str, rows: list[Row], sections: list[str], failed: list[str]) -> str:
    body = []
    if failed:
        items = "".join(f"<li>{escape(error)}</li>" for error in failed)
        body.append(f'<div class="notice"><h3>Not read</h3><ul>{items}</ul></div>')
    if len(rows) > 1:
        body.append(overview(rows))
    return document(title, [*body, *sections, _legend()])


def _section(run: Examined, warnings: list[Finding], anchor: str) -> str:
    parts = [f'<section class="run" id="{anchor}">', f"<h2>{escape(run.name)}</h2>", f"<p>{_facts(run)}</p>"]
    parts.append(f'<p class="soft">{escape(run.path)}</p>')
    parts.append(_notices(run, warnings))
    blocks = [
        ("Results", tables.results(run)),
        ("Figures", _figures(run)),
        ("Parts of the stress", tables.parts(run)),
        ("Harmonics of the shear stress", tables.harmonics(run)),
        ("Error estimates", tables.errors(run)),
        ("Run time and cost", tables.cost(run)),
    ]
    parts += [f"<h3>{name}</h3>\n{content}" for name, content in blocks if content]
    parts.append(unfolding("Configuration", preformatted(run.facts["config_yaml"])))
    parts.append(unfolding("Origin of the run", tables.provenance(run)))
    return "\n".join([*parts, "</section>"])


def _figures(run: Examined) -> str:
    drawn = figures_of(run)
    return '<div class="figures">' + "\n".join(drawn) + "</div>" if drawn else ""


def _facts(run: Examined) -> str:
    scales, done = run.scales, len(run.analysis.values)
    facts = [_FLOWS.get(run.analysis.flow, escape(run.analysis.flow))]
    facts += [f"φ&nbsp;=&nbsp;{scales['volume_fraction']:.4g}", f"N&nbsp;=&nbsp;{scales['number']}"]
    if run.oscillatory:
        facts += [f"γ<sub>0</sub>&nbsp;=&nbsp;{scales['gamma0']:g}", f"ω&nbsp;=&nbsp;{scales['omega']:g}"]
    else:
        facts.append(f"rate&nbsp;=&nbsp;{scales['rate']:g}")
    facts.append(f"far field {escape(run.far_field)}")
    unit = "cycle" if run.oscillatory else "block"
    facts.append(f"{done} complete {unit}{'' if done == 1 else 's'}")
    if done:
        facts.append(f"total strain {number(float(run.analysis.total_strain[-1]))}")
    return ", ".join(facts)


def _notices(run: Examined, warnings: list[Finding]) -> str:
    found = ""
    if warnings:
        items = "".join(f"<li><b>{name}</b>: {text}</li>" for name, text in warnings)
        found += f'<div class="notice"><h3>Warnings</h3><ul>{items}</ul></div>'
    elif run.analysis.cycles.size:
        found += f'<p class="fine">No warnings: {", ".join(checked(run))}.</p>'
    missing = [*run.missing]
    if not run.analysis.cycles.size:
        missing += [("results", note) for note in run.analysis.notes]
    if missing:
        items = "".join(f"<li><b>{escape(what)}</b>: {escape(why)}</li>" for what, why in missing)
        found += f'<div class="notice"><h3>Missing</h3><ul>{items}</ul></div>'
    return found + "".join(f'<p class="soft">Note: {escape(note)}.</p>' for note in run.notes)


def _legend() -> str:
    return (
        '<footer class="soft"><p>Lengths in sphere radii a, stresses in units of the fluid\'s viscosity η<sub>0</sub> '
        "times γ<sub>0</sub>ω (or the rate). σ<sub>xy</sub> = γ<sub>0</sub>&thinsp;Σ "
        "(G<sub>n</sub>′ sin nθ + ωη<sub>n</sub>′ cos nθ), strain γ = "
        "γ<sub>0</sub> sin θ; N<sub>k</sub>/γ<sub>0</sub>ω = Re Σ ν<sub>n</sub> "
        "e<sup>inθ</sup>, N<sub>1</sub> = σ<sub>xx</sub> − σ<sub>yy</sub>, N<sub>2</sub> = "
        "σ<sub>yy</sub> − σ<sub>zz</sub>; compression is negative. ⟨(Δ/a)<sup>2</sup>⟩ "
        "= 8 D<sub>cyc</sub>γ<sub>0</sub> over a cycle. ± is one standard error.</p></footer>"
    )
