"""Reading and validating configurations: YAML text or dict, then overrides, then one `Config` or one error.

All problems are collected and raised together as one ConfigurationError; each names file and line (or --set),
key, what was found and what is allowed.
"""

from __future__ import annotations

import copy
import difflib
import math
import os
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from suspend.config.checks import check_consistency
from suspend.config.keys import Key, Only, Section, keys_of, sections_of
from suspend.config.physics import FORMERLY, PACKED
from suspend.config.schema import Config, every_key
from suspend.config.tree import Item, Problems, from_python, parse, scalar
from suspend.errors import ConfigurationError, StorageError

LARGEST_FILE = 1 << 20  # bytes; a configuration has a few thousand


def load(path: str | os.PathLike, overrides: Sequence[str] = ()) -> Config:
    """Configuration of a YAML file with `overrides` such as "flow.amplitude=0.4" applied.

    Raises ConfigurationError (missing, a folder, no YAML, not valid), StorageError where it cannot be read.
    """
    path = Path(path)
    return loads(read_text(path), source=str(path), overrides=overrides, directory=str(path.parent))


def loads(text: str, source: str = "<string>", overrides: Sequence[str] = (), directory: str = ".") -> Config:
    """Configuration of a YAML text, called `source` in errors; its paths start from `directory`."""
    problems = Problems(source)
    root = parse(text, source, problems)
    if root is None and not problems.lines:
        raise ConfigurationError(f"{source}: is empty; `suspend init FILE` writes a configuration")
    if root is not None and not isinstance(root.value, dict):
        raise ConfigurationError(f"{root.where}: found {root.found}; a configuration has lines 'key: value'")
    return _configure(root or Item({}, source, ""), problems, overrides, directory)


def from_dict(
    data: Mapping[str, Any], source: str = "<dict>", overrides: Sequence[str] = (), directory: str = "."
) -> Config:
    """Configuration of nested dicts with the keys of the YAML file; validated like one."""
    if not isinstance(data, Mapping):
        raise ConfigurationError(f"{source}: found {type(data).__name__}; a mapping is needed")
    return _configure(from_python(data, source), Problems(source), overrides, directory)


def assemble(root: Item, assignments: Sequence[tuple[str, Item]], source: str, directory: str = ".") -> Config:
    """Configuration of a tree with values put at dotted keys, which keep their own places in errors.

    root : not changed; source : its name in errors. Raises ConfigurationError.
    """
    root, problems, assigned = copy.deepcopy(root), Problems(source), set()
    for name, item in assignments:
        _assign(root, name, copy.deepcopy(item), assigned, problems)
    return _configure(root, problems, (), directory)


def read_text(path: Path) -> str:
    """Text of a configuration file. Raises ConfigurationError (missing, a folder, large, no UTF-8), StorageError."""
    try:
        if path.is_dir():
            raise ConfigurationError(f"{path}: is a folder; a configuration file (YAML) is needed")
        with open(path, "rb") as file:
            data = file.read(LARGEST_FILE + 1)
    except FileNotFoundError:
        hint = f"`suspend init {path}` writes a configuration to start from"
        raise ConfigurationError(f"{path}: no such file; {hint}") from None
    except (OSError, ValueError) as error:
        reason = getattr(error, "strerror", None) or error
        raise StorageError(f"{path}: the configuration cannot be read: {reason}") from error
    if len(data) > LARGEST_FILE:
        raise ConfigurationError(f"{path}: larger than {LARGEST_FILE} bytes, no configuration file")
    try:
        return data.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        line = data[: error.start].count(b"\n") + 1
        message = f"{path}:{line}: this is no UTF-8 text ({error.reason}); a YAML file is needed"
        raise ConfigurationError(message) from None


def _configure(root: Item, problems: Problems, overrides: Sequence[str], directory: str) -> Config:
    assigned: set[str] = set()
    for override in overrides:
        _override(root, override, assigned, problems)
    reader = _Reader(problems)
    values = reader.root(root)
    _place_start(values["particles"], reader.places, problems, directory)
    check_consistency(values, reader.places, problems)
    problems.raise_any()
    for name, part in sections_of(Config).items():
        if values[name] is not None:
            values[name] = part.cls(**values[name])
    return Config(**values, directory=directory)


def _place_start(particles: dict, places: Mapping[str, str], problems: Problems, directory: str) -> None:
    """A starting file typed with --set belongs to the current folder: make it relative to that of the configuration."""
    initial = particles.get("initial")
    if places.get("particles.initial") != "--set" or initial in (None, *PACKED, FORMERLY) or os.path.isabs(initial):
        return
    beside = os.path.join(directory, initial)
    if not os.path.exists(initial) and os.path.exists(beside) and not os.path.samefile(directory or ".", "."):
        problems.add(
            "--set",
            "particles.initial",
            f"found {initial}; it is not in the current folder, to which what is typed belongs; there is {beside}, "
            "beside the configuration",
        )
    elif os.path.abspath(directory) != os.getcwd():
        particles["initial"] = os.path.relpath(initial, directory)


def _override(root: Item, override: str, assigned: set[str], problems: Problems) -> None:
    """Put "section.key=value" into the tree."""
    name, equals, text = override.partition("=")
    name = name.strip()
    if not equals or not name:
        problems.add("--set", "", f"found {override!r}; must be key=value, such as flow.amplitude=0.4")
        return
    try:
        item = parse(text, "--set", problems) or Item(None, "--set", "")
    except ConfigurationError as error:
        problems.add("--set", name, f"found {text!r}; {str(error).partition(': ')[2]}")
        return
    item.where = "--set"
    _assign(root, name, item, assigned, problems)


def _assign(root: Item, name: str, item: Item, assigned: set[str], problems: Problems) -> None:
    """Put an item at a dotted key. It replaces the other key of an exclusive pair, unless that is `assigned` too."""
    assigned.add(name)
    section, dot, inner = name.partition(".")
    if not dot:
        root.value[name] = item
        return
    part = sections_of(Config).get(section)
    key = keys_of(part.cls).get(inner) if part else None
    if key is None:
        hint = _suggestion(inner, section) if part else _suggestion(name, "")
        problems.add(item.where, name, f"unknown key{hint}")
        return
    parent = root.value.get(section)
    if parent is None or not isinstance(parent.value, dict):
        parent = root.value[section] = Item({}, item.where, "")
    if key.group is not None and item.value is not None:
        for other, info in keys_of(part.cls).items():
            if info.group == key.group and other in parent.value and f"{section}.{other}" not in assigned:
                del parent.value[other]
    parent.value[inner] = item


class _Reader:
    """Checks a tree key by key; `places` remembers where each value was written."""

    def __init__(self, problems: Problems):
        self.problems = problems
        self.places: dict[str, str] = {}
        self.top: dict[str, Any] = {}  # values of the top-level keys

    def root(self, item: Item) -> dict[str, Any]:
        """Values of the whole configuration: sections are dicts, None where a term is off."""
        keys, sections = keys_of(Config), sections_of(Config)
        self.places[""] = item.where
        for name, child in item.value.items():
            if name not in keys and name not in sections:
                self.problems.add(child.where, name, f"unknown key{_suggestion(name, '')}")
        values = self._keys(item, keys, "")
        self.top = dict(values)
        for name, part in sections.items():
            values[name] = self._section(name, part, item.value.get(name))
        return values

    def _section(self, name: str, part: Section, item: Item | None) -> dict[str, Any] | None:
        switch = "enabled" in keys_of(part.cls)
        if switch and item is not None and (item.value is None or isinstance(item.value, bool)):
            # off as every other term that can be off; the section's other keys keep their defaults
            item = Item({"enabled": Item(bool(item.value), item.where, item.text)}, item.where, "")
        absent = item is None or item.value is None or (part.optional and item.value is False)
        if part.only is not None and part.only.key not in self.top:
            return None  # the deciding key is itself wrong
        there = part.only is not None and part.only.holds(self.top[part.only.key])
        if part.only is not None and not there and not absent:
            self.problems.add(item.where, name, _misplaced(part.only, self.top[part.only.key], ""))
            return None
        if absent and part.optional and not there:
            return None
        if absent:
            item = Item({}, item.where if item else self.places[""].partition(":")[0], "")
        if not isinstance(item.value, dict):
            off = ", or off where the term is off" if part.optional or switch else ""
            known = ", ".join(keys_of(part.cls))
            message = f"found {item.found}; must be a section with the keys {known}{off}"
            self.problems.add(item.where, name, message)
            return None if part.optional else {}
        self.places[name] = item.where
        keys = keys_of(part.cls)
        for inner, child in item.value.items():
            if inner not in keys:
                self.problems.add(child.where, f"{name}.{inner}", f"unknown key{_suggestion(inner, name)}")
        return self._keys(item, keys, name)

    def _keys(self, item: Item, keys: Mapping[str, Key], section: str) -> dict[str, Any]:
        values: dict[str, Any] = {}
        # A key that decides whether others exist comes before them in the schema.
        for name, key in keys.items():
            child = item.value.get(name)
            dotted = f"{section}.{name}" if section else name
            self.places[dotted] = child.where if child else item.where
            deciding = self.top if key.only is not None and key.only.top else values
            if key.only is not None and key.only.key not in deciding:
                continue  # the deciding key is itself wrong: nothing can be said about this one
            if key.only is not None and not key.only.holds(deciding[key.only.key]):
                values[name] = None
                if child is not None and child.value is not None:
                    message = _misplaced(key.only, deciding[key.only.key], section)
                    self.problems.add(child.where, dotted, message)
            elif key.group is not None:
                self._member(name, keys, item, section, values)
            else:
                self._plain(dotted, name, key, child, item.where, values)
        return values

    def _plain(self, dotted: str, name: str, key: Key, child: Item | None, where: str, values: dict) -> None:
        if child is None and key.required:
            self.problems.add(where, dotted, f"is missing; must be {key.allowed}{_unit(key)} ({key.meaning})")
        elif child is None or (child.value is None and key.default is None):
            values[name] = key.default
        else:
            self._value(dotted, name, key, child, values)

    def _member(self, name: str, keys: Mapping[str, Key], item: Item, section: str, values: dict) -> None:
        """One of several keys that exclude each other; the first of them in the schema sees to all."""
        members = [other for other, key in keys.items() if key.group == keys[name].group]
        if name != members[0]:
            return
        given = [m for m in members if m in item.value and item.value[m].value is not None]
        values.update(dict.fromkeys(members))
        if len(given) > 1:
            found = ", ".join(f"{m}: {item.value[m].text}" for m in given)
            where = item.value[given[-1]].where
            message = f"{' and '.join(given)} exclude each other, found {found}; keep one of them"
            self.problems.add(where, f"{section}.{given[-1]}", message)
        for member in given:
            self._value(f"{section}.{member}", member, keys[member], item.value[member], values)
        if given:
            return
        for member in members:
            if keys[member].default is not None:
                values[member] = keys[member].default
                return
        choice = " or ".join(f"{section}.{m} ({keys[m].allowed})" for m in members)
        self.problems.add(item.where, section, f"one key is missing: {choice}")

    def _value(self, dotted: str, name: str, key: Key, item: Item, values: dict) -> None:
        value = convert(key, item)
        if value is not None:
            values[name] = value
            return
        self.problems.add(item.where, dotted, _complaint(key, item))


def convert(key: Key, item: Item) -> Any:
    """The value of `item` as `key` wants it, None if it is not allowed."""
    value = item.value
    if key.kind == "integer":
        right = isinstance(value, int) and not isinstance(value, bool) and key.within(value)
        return value if right else None
    if key.kind == "number":
        return _number(key, value)
    if key.kind == "switch":
        return value if isinstance(value, bool) else None
    if key.kind == "choice":
        return value if isinstance(value, str) and value in key.choices else None
    if key.kind == "text":
        right = isinstance(value, str) and value.strip() and "\0" not in value
        return dict(key.former).get(value, value) if right else None
    if not isinstance(value, list) or not value or (key.length is not None and len(value) != key.length):
        return None
    if key.kind == "integers":
        result = tuple(entry.value for entry in value)
        whole = all(isinstance(n, int) and not isinstance(n, bool) and key.within(n) for n in result)
        return result if whole else None
    result = tuple(_number(key, entry.value) for entry in value)
    return None if None in result else result


def _number(key: Key, value: Any) -> float | None:
    if isinstance(value, bool) or not isinstance(value, int | float):
        return None
    try:
        number = float(value)
    except OverflowError:
        return None
    return number + 0.0 if math.isfinite(number) and key.within(number) else None  # + 0.0: -0.0 is 0.0


def _complaint(key: Key, item: Item) -> str:
    for value, reason in key.refused:
        if item.value == value:
            return f"found {item.found}; {reason}"
    found = item.found
    if isinstance(item.value, list):
        entries = [entry.found for entry in item.value]
        found = "[" + ", ".join(entries[:8]) + (", ..." if len(entries) > 8 else "") + "]"
    message = f"found {found}; must be {key.allowed}{_unit(key)}"
    if item.value is None and not key.required:
        return message + "; leave the key out for its default"
    if key.kind in ("integer", "number") and isinstance(item.value, str) and _is_number(scalar(item.text)):
        return message + ", without quotes"
    if isinstance(item.value, float) and not math.isfinite(item.value):
        return message + "; it is not finite"
    if key.kind == "integer" and isinstance(item.value, float) and item.value.is_integer():
        return message + f"; write {int(item.value)}"
    if key.kind == "text" and not isinstance(item.value, str | dict | list | None):
        return message + "; put it in quotes"
    if key.kind == "choice" and isinstance(item.value, str):
        close = difflib.get_close_matches(item.value.lower().replace("_", "-"), key.choices, 1)
        return message + (f"; did you mean {close[0]}?" if close else "")
    return message


def _is_number(value: Any) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool)


def _unit(key: Key) -> str:
    return f" [{key.unit}]" if key.unit else ""


def _misplaced(only: Only, decided: str, section: str) -> str:
    condition = f"{'not ' if only.negated else ''}{' | '.join(only.values)}"
    decider = f"{section}.{only.key}" if section and not only.top else only.key
    return f"does not belong here: {decider} is {decided}, must be {condition}; remove it or set it to null"


def _suggestion(name: str, section: str) -> str:
    """What an unknown key of `section` ('' = top level) may have been meant to be, and what there is."""
    top = [*keys_of(Config), *sections_of(Config)]
    known = list(keys_of(sections_of(Config)[section].cls)) if section else top
    wanted = name.lower().replace("-", "_")
    dotted = "." in wanted and not section  # of a key in a section that there is not: no top-level key
    close = difflib.get_close_matches(wanted.rpartition(".")[2] if section else wanted, known, 1, 0.7)
    close = [] if dotted else close
    if close:
        return f"; did you mean {close[0]}?"
    table = every_key()
    symbol = [d for d, key in table.items() if wanted in key.symbols]
    elsewhere = [d for d in table if d.rpartition(".")[2] == wanted.rpartition(".")[2]]
    near = difflib.get_close_matches(wanted, table, 1, 0.7)
    last = difflib.get_close_matches(wanted, [d.rpartition(".")[2] for d in table], 1, 0.8)
    near = near or [d for d in table if last and d.rpartition(".")[2] == last[0]]
    for found in (near, symbol, elsewhere) if dotted else (symbol, elsewhere, near):
        if found:
            return f"; did you mean {' or '.join(found[:3])}?"
    return f"; {section + ' has' if section else 'there are'} {', '.join(known)}"
