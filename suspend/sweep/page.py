"""`write_sweep_page`: one self-contained page about a sweep (or several), also while it runs."""

from __future__ import annotations

import json
import os
from collections.abc import Iterable
from html import escape
from pathlib import Path
from typing import Any
from urllib.parse import quote

from suspend.analysis.collection import Member
from suspend.errors import SuspendError, named
from suspend.io.files import replace_text, storage_errors
from suspend.io.reader import TRAJECTORY
from suspend.report import write_report
from suspend.report.page import check_target, document
from suspend.report.text import UNKNOWN, duration, number, table
from suspend.sweep.folder import LOG
from suspend.sweep.page_results import QUANTITIES, Results
from suspend.sweep.points import short_name
from suspend.sweep.runs import complete_points, left_out, sweeps_at
from suspend.sweep.status import STATES

RUN_PAGE = "report.html"  # of a run, in its folder, where somebody had it written
_SYMBOLS = {"gamma0": "γ<sub>0</sub>", "phi": "φ"}


def write_sweep_page(
    sweeps: Iterable[os.PathLike | str],
    target: os.PathLike | str,
    *,
    last: int | None = None,
    title: str | None = None,
    each: bool = False,
) -> list[str]:
    """Write one page about sweeps (their folders or files); returns what is left out of the results.

    States, failures, a table of all points with links to their folders (relative to the page), and what the complete
    points show together. Only reads the sweeps, which may be going on; each: but writes a page about its run into the
    folder of every complete point that has none since the run was changed. Atomic. last: cycles averaged over at the
    end of each run. Raises ConfigurationError (suffix, a file that is no sweep), StorageError.
    """
    target = check_target(target)
    found = sweeps_at(sweeps)
    complete = [folder for status in found for folder in complete_points(status)]
    unread = [note for path in complete for note in _own_page(Path(path), last)] if each else []
    results = Results(complete, last)
    here = Path(os.path.abspath(target)).parent
    names = ", ".join(Path(os.path.abspath(status["sweep"])).name for status in found)
    body = [_summary(status) for status in found]
    body += [_failures(found, here), *results.html()]
    body += [_points(status, here, results.members) for status in found]
    missing = [*(note for status in found for note in left_out(status)), *unread]
    body += [_notes([*missing, *results.notes()]), _legend()]
    page = document(title or f"{'Sweep' if len(found) == 1 else 'Sweeps'} {names}", body)
    with storage_errors("write", target):
        replace_text(target, page)
    return missing


def _own_page(folder: Path, last: int | None) -> list[str]:
    """Write the page of a run where it is older than the run or missing; why it could not be."""
    page = folder / RUN_PAGE
    try:
        if page.is_file() and page.stat().st_mtime_ns > (folder / TRAJECTORY).stat().st_mtime_ns:
            return []
        return write_report([folder], page, last=last)
    except (OSError, SuspendError) as error:
        return [f"no page of its own: {named(folder, error)}"]


def _summary(status: dict[str, Any]) -> str:
    counts = ", ".join(f"<b>{count}</b> {state}" for state, count in status["counts"].items() if count)
    lines = [f"{len(status['points'])} points: {counts}; run time {duration(status['seconds'])} in all."]
    if status["running"]:
        lines.append(f"A call is at work ({escape(status['running'])}).")
    going = [p for p in status["points"] if p["state"] == "running"]
    for point in going:
        left = "" if point["seconds_left"] is None else f", {duration(point['seconds_left'])} left"
        lines.append(
            f"Running: {escape(point['folder'])}, total strain {number(point['strain'])} of "
            f"{number(point['total_strain'])}{left}."
        )
    if status["no_longer_in_the_file"]:
        lines.append("No longer in the file, kept: " + escape(", ".join(status["no_longer_in_the_file"])) + ".")
    place = escape(status["sweep"]) + (f", from {escape(status['file'])}" if status["file"] else "")
    return f'<p class="soft">{place}</p>' + "".join(f"<p>{line}</p>" for line in lines)


def _failures(found: list[dict[str, Any]], here: Path) -> str:
    """Points that failed, for good or to be tried again, with their last message."""
    items = []
    for status in found:
        for point in status["points"]:
            if point["state"] != "failed" and not point["message"]:
                continue
            again = "" if point["state"] == "failed" else f", {escape(point['state'])}"
            times = f"{point['failures']} time{'' if point['failures'] == 1 else 's'}"
            message = escape(point["message"] or "unknown").replace("\n", "<br>")
            items.append(f"<li>{_name(status, point, here)} (failed {times}{again}): {message}</li>")
    if not items:
        return ""
    return f'<div class="notice" id="failures"><h3>Failures</h3><ul>{"".join(items)}</ul></div>'


def _name(status: dict[str, Any], point: dict[str, Any], here: Path) -> str:
    """The point's name, a link where its folder is."""
    folder = Path(status["sweep"]) / point["folder"]
    return _link(folder, here, point["folder"]) if folder.is_dir() else escape(point["folder"])


def _link(path: Path, here: Path, text: str) -> str:
    relative = quote(Path(os.path.relpath(os.path.abspath(path), here)).as_posix())
    return f'<a href="{escape("./" + relative + ("/" if path.is_dir() else ""))}">{escape(text)}</a>'


def _points(status: dict[str, Any], here: Path, members: dict[str, Member]) -> str:
    points = status["points"]
    keys = list(dict.fromkeys(key for point in points for key in point["parameters"]))
    head = ["Point", *(_SYMBOLS.get(short_name(key), escape(short_name(key))) for key in keys), "Seed", "State"]
    head += ["Total strain", "Run time", *QUANTITIES.values(), "Files"]
    rows = [_point_cells(status, point, keys, here, members) for point in points]
    note = '<p class="soft">Means over the last cycles of each run. Names lead to the folders.</p>'
    name = escape(Path(status["sweep"]).name)
    return f'<section class="points"><h2>Points of {name}</h2>\n{note}{table(rows, head, kind="dense")}</section>'


def _point_cells(status, point: dict[str, Any], keys: list[str], here: Path, members: dict[str, Member]) -> list[str]:
    folder = Path(status["sweep"]) / point["folder"]
    member = members.get(str(folder))
    values = [UNKNOWN] * len(QUANTITIES)
    if member is not None:
        values = [number(member.values[name]) for name in QUANTITIES]
    linked = [(folder / name, text) for name, text in ((LOG, "log"), (RUN_PAGE, "report"))]
    files = [_link(path, here, text) for path, text in linked if path.is_file()]
    strain, asked = number(point["strain"]), number(point["total_strain"] or None)
    return [
        _name(status, point, here),
        *(_parameter(point["parameters"].get(key, "")) for key in keys),
        str(point["seed"]),
        point["state"],
        asked if point["state"] == "complete" else f"{strain} of {asked}" if point["strain"] else UNKNOWN,
        duration(point["seconds"]),
        *values,
        ", ".join(files) or UNKNOWN,
    ]


def _parameter(value: Any) -> str:
    if value is None:
        return "off"
    return f"{value:g}" if isinstance(value, float) else escape(value if isinstance(value, str) else json.dumps(value))


def _notes(notes: list[str]) -> str:
    if not notes:
        return ""
    items = "".join(f"<li>{escape(note)}</li>" for note in notes)
    return f'<section id="notes"><h2>Notes</h2><ul class="soft">{items}</ul></section>'


def _legend() -> str:
    return (
        '<footer class="soft"><p>Points are complete where their runs reached the duration asked; only these enter the '
        f"results. States: {', '.join(STATES)}. Lengths in sphere radii a, stresses in units of η<sub>0</sub> times "
        "γ<sub>0</sub>ω; N<sub>1</sub> = σ<sub>xx</sub> − σ<sub>yy</sub>, N<sub>2</sub> = σ<sub>yy</sub> − "
        "σ<sub>zz</sub>, compression is negative; ν<sub>0</sub> is the mean of N<sub>k</sub>/γ<sub>0</sub>ω over the "
        "cycle. ⟨(Δ/a)<sup>2</sup>⟩ = 8 D<sub>cyc</sub>γ<sub>0</sub> over a cycle.</p></footer>"
    )
