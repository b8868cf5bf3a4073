"""From YAML text, a dict or `--set` to a tree of items that know where they were written.

Scalars are read by the rules of YAML 1.2: `1e-3` is a number (YAML 1.1, and so PyYAML, takes it for text),
010 is ten, 1:30 is text. Beyond them `1_000` is 1000, and yes, no, on, off are switches.
"""

from __future__ import annotations

import math
import numbers
import re
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import yaml

from suspend.errors import ConfigurationError

DEPTH = 4  # nothing in a configuration is nested deeper than a list in a section
SWITCHES = {"true": True, "yes": True, "on": True, "false": False, "no": False, "off": False}
INTEGER = re.compile(r"[-+]?[0-9]+(_[0-9]+)*", re.ASCII)


@dataclass
class Item:
    """A value, or a mapping or list of items, with the place it comes from and the text it was written as."""

    value: Any  # None, bool, int, float, str, list[Item], dict[str, Item]
    where: str  # file.yaml:12 | --set | <dict>
    text: str

    @property
    def found(self) -> str:
        """The value for an error message."""
        if self.value is None:
            return "nothing (null)"
        if isinstance(self.value, dict):
            return "a section of keys"
        if isinstance(self.value, list):
            return f"a list of {len(self.value)}"
        text = self.text if len(self.text) <= 60 else self.text[:57] + "..."
        return repr(text) if isinstance(self.value, str) else text


class Problems:
    """Everything found wrong so far; raised as one error."""

    def __init__(self, source: str):
        self.source = source
        self.lines: list[str] = []

    def add(self, where: str, key: str, message: str) -> None:
        """Note a problem of `key` at `where`; the same problem counts once."""
        line = f"{where}: {key}: {message}" if key else f"{where}: {message}"
        if line not in self.lines:
            self.lines.append(line)

    def raise_any(self) -> None:
        """Raise one ConfigurationError that lists all problems, if there are any."""
        if len(self.lines) == 1:
            raise ConfigurationError(self.lines[0])
        if self.lines:
            head = f"{len(self.lines)} errors in the configuration {self.source}"
            raise ConfigurationError("\n  ".join([head, *self.lines]))


class _Loader(yaml.SafeLoader):
    """Leaves every plain scalar as text; `scalar` gives it its type."""

    yaml_implicit_resolvers: dict = {}  # noqa: RUF012 (the name and type PyYAML asks for)


def parse(text: str, source: str, problems: Problems, deepest: int = DEPTH) -> Item | None:
    """Tree of a YAML text, None if it is empty. Raises ConfigurationError where it is no YAML.

    deepest : levels of nesting allowed; beyond them a problem is noted.
    """
    try:
        node = yaml.compose(text, Loader=_Loader)
    except yaml.YAMLError as error:
        raise ConfigurationError(_syntax_error(error, source)) from None
    except RecursionError:
        raise ConfigurationError(f"{source}: nested too deeply for a configuration") from None
    return None if node is None else _from_node(node, source, problems, deepest)


def from_python(value: Any, where: str, depth: int = 0) -> Item:
    """Tree of nested dicts and lists of plain values."""
    if depth > DEPTH:
        raise ConfigurationError(f"{where}: nested too deeply for a configuration")
    if hasattr(value, "tolist"):  # NumPy scalars and arrays, without importing NumPy
        value = value.tolist()
    if isinstance(value, Mapping):
        return Item({str(k): from_python(v, where, depth + 1) for k, v in value.items()}, where, "")
    if isinstance(value, list | tuple):
        return Item([from_python(v, where, depth + 1) for v in value], where, "")
    if value is None or isinstance(value, bool | str):
        return Item(value, where, str(value))
    if isinstance(value, numbers.Integral):
        return Item(int(value), where, str(value))
    if isinstance(value, numbers.Real):
        return Item(float(value), where, repr(float(value)))
    return Item(value, where, repr(value))


def scalar(text: str) -> bool | int | float | str | None:
    """Value of a plain (unquoted) scalar."""
    if text in ("", "~") or text.lower() == "null":
        return None
    if text.lower() in SWITCHES:
        return SWITCHES[text.lower()]
    if text.lower().lstrip("+-") in (".nan", ".inf"):
        return math.nan  # neither is allowed anywhere
    if not text.isascii():
        return text
    if INTEGER.fullmatch(text) and len(text) < 1000:
        return int(text)
    try:
        return float(text)
    except ValueError:
        return text


def _from_node(node: yaml.Node, source: str, problems: Problems, left: int) -> Item | None:
    line = source if source.startswith("--") else f"{source}:{node.start_mark.line + 1}"
    if left < 0:
        problems.add(line, "", "nested too deeply for a configuration")
        return None
    tag = node.tag.replace("tag:yaml.org,2002:", "!!")
    if tag not in ("!!str", "!!map", "!!seq"):
        problems.add(line, "", f"tag {tag} is not allowed; write the plain value")
        return None
    if isinstance(node, yaml.ScalarNode):
        value = scalar(node.value) if node.style is None else node.value
        return Item(value, line, node.value)
    if isinstance(node, yaml.SequenceNode):
        items = [_from_node(child, source, problems, left - 1) for child in node.value]
        return Item([item for item in items if item is not None], line, "")
    return Item(_mapping(node, source, problems, left), line, "")


def _mapping(node: yaml.MappingNode, source: str, problems: Problems, left: int) -> dict[str, Item]:
    items: dict[str, Item] = {}
    first: dict[str, int] = {}
    for name, child in node.value:
        number = name.start_mark.line + 1
        line = source if source.startswith("--") else f"{source}:{number}"
        if not isinstance(name, yaml.ScalarNode):
            problems.add(line, "", "a key must be a plain word")
            continue
        if name.value in first:
            message = f"this key is given twice (first in line {first[name.value]}); keep one of them"
            problems.add(line, name.value, message)
            continue
        first[name.value] = number
        item = _from_node(child, source, problems, left - 1)
        if item is not None:
            item.where = line  # of the key: a value may begin lines below it
            items[name.value] = item
    return items


def _syntax_error(error: yaml.YAMLError, source: str) -> str:
    mark = getattr(error, "problem_mark", None)
    where = source if mark is None or source.startswith("--") else f"{source}:{mark.line + 1}"
    problem = getattr(error, "problem", None) or str(error).splitlines()[0]
    if r"'\t'" in problem:
        return f"{where}: a tab is used where YAML allows only spaces; replace it with spaces"
    if "unacceptable character" in str(error) or "special characters" in str(error):
        return f"{where}: this is no text file (unprintable characters); a YAML file is needed"
    if "expected a single document" in str(error):
        return f"{where}: a second YAML document begins here (---); a file holds one configuration"
    column = "" if mark is None else f", column {mark.column + 1}"
    return f"{where}: this is not valid YAML: {problem}{column}"
