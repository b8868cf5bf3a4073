"""The HTML document around a report: head, style sheet, title, and when it was made."""

from __future__ import annotations

import os
import time
from collections.abc import Iterable
from html import escape
from pathlib import Path

import suspend
from suspend.errors import ConfigurationError
from suspend.report.style import CSS

SUFFIXES = (".html", ".htm")


def check_target(path: os.PathLike | str) -> Path:
    """The path, if a page can be written there. Raises ConfigurationError."""
    target = Path(path)
    if target.suffix.lower() not in SUFFIXES:
        raise ConfigurationError(f"cannot write a report to {target}: its name must end in {' or '.join(SUFFIXES)}")
    if target.is_dir():
        raise ConfigurationError(f"cannot write a report to {target}: it is a folder; give the name of a file")
    return target


def document(title: str, body: Iterable[str]) -> str:
    """A whole page: `title` as plain text, `body` as pieces of HTML."""
    made = time.strftime("%Y-%m-%d %H:%M UTC", time.gmtime())
    head = (
        '<!DOCTYPE html>\n<html lang="en">\n<head>\n<meta charset="utf-8">\n'
        '<meta name="viewport" content="width=device-width, initial-scale=1">\n'
        f'<title>{escape(title)}</title>\n<link rel="icon" href="data:,">\n<style>{CSS}</style>\n</head>\n<body>\n'
    )
    version = f'<p class="soft">{made}, suspend {suspend.__version__}</p></header>'
    header = [f"<header><h1>{escape(title)}</h1>", version]
    return head + "\n".join([*header, *body]) + "\n</body>\n</html>\n"
