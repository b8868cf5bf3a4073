"""`make_figure`: from a name and runs to files."""

from __future__ import annotations

import os
from collections.abc import Iterable
from pathlib import Path
from typing import NamedTuple

from suspend.errors import ConfigurationError
from suspend.figures.page import write_page, write_tables
from suspend.figures.registry import FigureKind, figure_kind
from suspend.figures.runs import Runs, open_runs, oscillatory

FORMATS = ("png", "pdf")
MOVIES = ("gif", "mp4")


class Drawn(NamedTuple):
    """Files that were written, and what must be known to read them."""

    paths: list[Path]
    notes: list[str]


def make_figure(
    name: str,
    paths: Iterable[os.PathLike | str],
    output: os.PathLike | str | None = None,
    formats: Iterable[str] | None = None,
    *,
    with_csv: bool = True,
    last: int | None = None,
    **options,
) -> Drawn:
    """Draw the figure `name` from the runs at `paths`; the files written, the pictures first, and the notes.

    output: a name with or without suffix, or a folder; NAME in the current folder by default. formats: "png", "pdf"
    (both by default, unless the suffix of `output` says one), for the animation "gif" or "mp4". with_csv: write the
    columns behind each panel beside it. last: cycles that steady-state values are averaged over. options: those of
    the figure (cycle, phase, colour). Raises ConfigurationError, StorageError, NumericalError.
    """
    kind = figure_kind(name)
    unknown = [key for key, value in options.items() if value is not None and key not in kind.options]
    if unknown:
        raise ConfigurationError(f"{kind.name} takes no --{unknown[0]}" + _taken(kind))
    allowed = MOVIES if kind.name == "animation" else FORMATS
    stem, formats = _names(kind, output, list(formats) if formats else None, allowed)
    runs = open_runs(paths, last)
    _check_number(kind, runs)
    given = {key: value for key, value in options.items() if value is not None}
    panels = [builder(runs, **given) for builder in kind.builders()]
    if kind.name == "animation":
        written = []
        for suffix in formats:
            written.append(stem.with_name(f"{stem.name}.{suffix}"))
            panels[0].write(written[-1])
        return Drawn(written + (write_tables(panels, stem) if with_csv else []), runs.notes)
    return Drawn(write_page(panels, panels[0].size or kind.size, stem, formats, with_csv), runs.notes)


def _taken(kind: FigureKind) -> str:
    return f"; it takes {', '.join('--' + option for option in kind.options)}" if kind.options else ""


def _names(kind: FigureKind, output, formats: list[str] | None, allowed: tuple[str, ...]) -> tuple[Path, list[str]]:
    """The path without suffix, and the suffixes to write."""
    path = Path(output) if output is not None else Path(kind.name)
    if path.is_dir() or (output is not None and os.fspath(output).endswith(os.sep)):
        path.mkdir(parents=True, exist_ok=True)
        path = path / kind.name
    default = list(allowed[:1]) if kind.name == "animation" else list(allowed)
    suffix = path.suffix.lower()[1:]
    if suffix in (*FORMATS, *MOVIES):
        if suffix not in allowed:
            raise ConfigurationError(f"cannot write {kind.name} to {path}: its formats are {', '.join(allowed)}")
        path, default = path.with_suffix(""), [suffix]
    wrong = [f for f in formats or [] if f not in allowed]
    if wrong:
        raise ConfigurationError(f"cannot write {kind.name} as {wrong[0]}: its formats are {', '.join(allowed)}")
    return path, formats or default


def _check_number(kind: FigureKind, runs: Runs) -> None:
    """Raise where a curve against amplitude has one amplitude only."""
    if not kind.many:
        return
    amplitudes = {float(f"{member.gamma0:.9g}") for member in oscillatory(runs)}
    if len(amplitudes) < 2:
        raise ConfigurationError(
            f"{kind.name} shows several strain amplitudes, but the {len(runs)} run(s) given have one, gamma0 = "
            f"{min(amplitudes):g}: give runs with different flow.amplitude, or choose a figure of one run "
            "(`suspend plot --list`)"
        )
