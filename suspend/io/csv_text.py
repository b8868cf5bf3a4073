"""CSV text, written in one place so that no table can smuggle a formula into a spreadsheet."""

from __future__ import annotations

import csv
import io
import os
from collections.abc import Iterable
from pathlib import Path
from typing import Any, TextIO

from suspend.io.files import replace_text, storage_errors
from suspend.missing import has_value

_CONTROLS = str.maketrans({"\t": r"\t", "\r": r"\r", "\n": r"\n"})  # spreadsheets skip them, line readers break on them
_EXECUTED = ("=", "+", "-", "@")  # first characters by which spreadsheets take text for a formula


def cell(value: Any) -> Any:
    """The value as a cell: text that a spreadsheet would execute gets an apostrophe in front, which makes it text.

    Text that is a number stays one (-0.5); bytes of file names that are no text appear as \\udcXX. What has no value
    (`suspend.missing`) is an empty cell.
    """
    if not isinstance(value, str):
        return value if has_value(value) else ""
    value = value.encode("utf-8", "backslashreplace").decode().translate(_CONTROLS)
    return "'" + value if value.startswith(_EXECUTED) and not _is_number(value) else value


def _is_number(text: str) -> bool:
    try:
        float(text)
    except ValueError:
        return False
    return text == text.strip()


def write_rows(file: TextIO, rows: Iterable[Iterable[Any]]) -> None:
    """Write the rows to an open text file, one line each. Raises OSError."""
    csv.writer(file, lineterminator="\n").writerows(map(cell, row) for row in rows)


def csv_text(rows: Iterable[Iterable[Any]]) -> str:
    """The rows as CSV text."""
    buffer = io.StringIO()
    write_rows(buffer, rows)
    return buffer.getvalue()


def write_csv_file(path: os.PathLike | str, rows: Iterable[Iterable[Any]], *, sync: bool = True) -> None:
    """Write the rows to the file at `path`, as `replace_atomically`. Raises StorageError."""
    path = Path(path)
    with storage_errors("write", path):
        replace_text(path, csv_text(rows), sync=sync)
