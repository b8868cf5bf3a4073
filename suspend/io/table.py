"""The table that grows while a run goes on (`moduli.csv`, `viscosity.csv`): one line per completed cycle."""

from __future__ import annotations

import csv
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from pathlib import Path

from suspend.io.csv_text import csv_text
from suspend.io.files import append_or_restore, replace_text, storage_errors
from suspend.missing import has_value


@dataclass(frozen=True)
class CycleTable:
    """A CSV file with one line per completed cycle.

    `row(record)` gives an ordered mapping from column header (quantity and unit) to number; the first column,
    "cycle", is added here. Numbers are written with all their digits.
    """

    name: str
    row: Callable[[dict], dict[str, float]]

    def line(self, record: dict) -> tuple[str, str]:
        """Header and line of one cycle."""
        values = self.row(record)
        return _csv(["cycle", *values]), _csv([record["index"], *(_number(v) for v in values.values())])

    def append(self, directory: Path, header: str, lines: str) -> None:
        """Append complete lines with one write; a new file gets the header. Raises StorageError."""
        path = directory / self.name
        with storage_errors("append to", path):
            text = lines if path.exists() and path.stat().st_size else header + lines
            append_or_restore(path, [text.encode()])

    def repair(self, directory: Path, records: Iterable[dict], count: int, last: dict | None) -> bool:
        """Rewrite the file where it does not hold exactly `count` lines ending with that of record `last`.

        `records` are iterated only for that. True where it was rewritten. Raises StorageError.
        """
        path = directory / self.name
        if count == 0 or last is None:
            with storage_errors("remove", path):
                found = path.exists()
                path.unlink(missing_ok=True)
            return found
        if self._intact(path, count, *self.line(last)):
            return False
        lines = [self.line(record) for record in records if record["complete"]]
        text = lines[0][0] + "".join(line for _, line in lines)
        with storage_errors("repair", path):
            replace_text(path, text)
        return True

    def _intact(self, path: Path, count: int, header: str, last: str) -> bool:
        try:
            lines = path.read_text(encoding="utf-8").splitlines(keepends=True)
        except (OSError, UnicodeDecodeError):
            return False
        width = len(next(csv.reader([header])))
        rows = list(csv.reader(lines[1:]))
        return (
            len(rows) == count
            and lines[0] == header
            and lines[-1] == last
            and all(len(row) == width and row[0] == str(i) for i, row in enumerate(rows))
        )


def _csv(cells: list) -> str:
    return csv_text([cells])


def _number(value: float) -> str:
    value = value.item() if hasattr(value, "item") else value
    return repr(value) if has_value(value) else ""
