"""From panels to files: lay them out, letter them, write PNG, PDF and the CSV behind each."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from suspend.figures.panel import Columns, Panel
from suspend.figures.style import journal
from suspend.io.csv_text import write_csv_file
from suspend.io.files import replace_atomically, storage_errors

if TYPE_CHECKING:
    from collections.abc import Iterable

    from matplotlib.figure import Figure


def draw_page(panels: list[Panel], size: tuple[float, float], columns: int = 3) -> Figure:
    """The panels side by side, `columns` in a row at most, lettered where there are several.

    size: width and height in inches. Call inside `journal()`.
    """
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=size, layout="constrained")
    FigureCanvasAgg(figure)
    if len(panels) == 1:
        panels[0].draw(figure)
        return figure
    rows = [panels[i : i + columns] for i in range(0, len(panels), columns)]
    parts = figure.subfigures(len(rows), 1, squeeze=False)[:, 0]
    letters = iter("abcdefgh")
    for part, row in zip(parts, rows, strict=True):
        pages = part.subfigures(1, len(row), squeeze=False, width_ratios=[p.aspect for p in row])[0]
        for page, panel in zip(pages, row, strict=True):
            panel.draw(page)
            page.axes[0].set_title(f"({next(letters)})", loc="left", pad=3)
    return figure


def write_page(
    panels: list[Panel], size: tuple[float, float], stem: Path, formats: Iterable[str], with_csv: bool
) -> list[Path]:
    """Write STEM.png, STEM.pdf and the CSV of every panel; the paths. Atomic each. Raises StorageError."""
    written = []
    with journal():
        figure = draw_page(panels, size)
        for kind in formats:
            path = stem.with_name(f"{stem.name}.{kind}")
            with storage_errors("write the figure", path):
                replace_atomically(
                    path, lambda temporary, kind=kind: figure.savefig(temporary, format=kind), sync=False
                )
            written.append(path)
    return written + (write_tables(panels, stem) if with_csv else [])


def write_tables(panels: list[Panel], stem: Path) -> list[Path]:
    """STEM.csv of one panel, STEM_a.csv, STEM_b.csv of several, insets with their name behind."""
    written = []
    for letter, panel in zip("abcdefgh", panels, strict=False):
        for suffix, columns in panel.tables().items():
            tail = "_".join(part for part in (letter if len(panels) > 1 else "", suffix) if part)
            path = stem.with_name(stem.name + (f"_{tail}" if tail else "") + ".csv")
            write_columns(path, columns)
            written.append(path)
    return written


def write_columns(path: Path, columns: Columns) -> None:
    """A header "name[unit]" and one row a value; atomic. Raises StorageError."""
    rows = zip(*(column.tolist() for column in columns.values()), strict=True)
    write_csv_file(path, [columns, *rows], sync=False)
