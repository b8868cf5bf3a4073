"""Configurations as YAML text: plain (`to_yaml`), or with unit, default and meaning (`commented`)."""

from __future__ import annotations

import json
import re
import textwrap
from collections.abc import Mapping
from typing import Any

from suspend.config.keys import Key, Section, keys_of, sections_of
from suspend.config.schema import Config
from suspend.config.tree import scalar

WIDTH = 110
COLUMN = 30  # of the comments
PLAIN = re.compile(r"[A-Za-z./~][\w./~-]*", re.ASCII)


def to_yaml(values: Mapping[str, Any]) -> str:
    """YAML of nested plain values, readable by any YAML 1.1 or 1.2 parser, floats with all their digits."""
    lines = []
    for name, value in values.items():
        if isinstance(value, Mapping):
            lines.append(f"{name}:")
            lines += [f"  {inner}: {literal(entry)}" for inner, entry in value.items()]
        else:
            lines.append(f"{name}: {literal(value)}")
    return "\n".join(lines) + "\n"


def literal(value: Any) -> str:
    """One value in YAML."""
    if value is None:
        return "null"
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, float):
        text = repr(value)
        # Without a point, 1e-09 is text to a YAML 1.1 parser.
        return text.replace("e", ".0e") if "e" in text and "." not in text else text
    if isinstance(value, list | tuple):
        return "[" + ", ".join(literal(entry) for entry in value) + "]"
    if isinstance(value, str):
        return value if PLAIN.fullmatch(value) and isinstance(scalar(value), str) else json.dumps(value)
    return str(value)


def commented(head: str, on: tuple[str, ...] = ()) -> str:
    """A configuration with every key: those that are off, or that exclude others, commented out.

    head : comment at the top. on : optional sections that are switched on.
    """
    parts = ["\n".join(f"# {line}".rstrip() for line in head.strip().splitlines())]
    chosen = _chosen(Config)
    singles = {name: _line(name, info, 0, chosen) for name, info in keys_of(Config).items()}
    sections = {name: _section(name, part, name in on) for name, part in sections_of(Config).items()}
    order = [name for name in Config.__dataclass_fields__ if name in singles or name in sections]
    parts += [{**singles, **sections}[name] for name in order]
    return "\n\n".join(parts) + "\n"


def _section(name: str, part: Section, on: bool) -> str:
    state = "" if not part.optional else " (optional: on)" if on else f" (optional: off; {_remedy(part)})"
    lines = _wrapped(f"{part.meaning}{state}", "# ")
    body = [f"{name}:"]
    chosen = _chosen(part.cls)
    body += [_line(inner, info, 2, chosen) for inner, info in keys_of(part.cls).items()]
    if part.optional and not on:
        body = [f"# {line}" for entry in body for line in entry.splitlines()]
    return "\n".join(lines + body)


def _remedy(part: Section) -> str:
    if part.only is None:
        return "uncomment to switch it on"
    return f"only if {part.only.key} is {' | '.join(part.only.values)}, which switches it on"


def _chosen(cls: type) -> dict[str, Any]:
    """The values in the text: example or default; one only of keys that exclude each other."""
    values: dict[str, Any] = {}
    groups = set()
    for name, info in keys_of(cls).items():
        deciding = _chosen(Config) if info.only is not None and info.only.top else values
        if info.only is not None and not info.only.holds(deciding.get(info.only.key)):
            continue
        if info.group is not None:
            if info.group in groups or (info.default is None and name == "cycles"):
                continue
            groups.add(info.group)
        values[name] = _shown(info)
    return values


def _shown(info: Key) -> Any:
    return info.example if info.required or (info.group and info.default is None) else info.default


def _line(name: str, info: Key, indent: int, chosen: Mapping[str, Any]) -> str:
    """`key: value  # meaning [unit]; default; allowed`, commented out if the key is not in `chosen`."""
    entry = f"{' ' * indent}{'' if name in chosen else '# '}{name}: {literal(_shown(info))}"
    if info.group is not None and name not in chosen:
        default = f"instead of {' | '.join(k for k in info.group.split(' | ') if k != name)}"
    elif info.required or (info.group is not None and info.default is None):
        default = "required"
    else:
        default = f"default {literal(info.default)}"
    notes = [info.meaning + (f" [{info.unit}]" if info.unit else ""), default, info.allowed]
    if info.only is not None:
        where = ("not " if info.only.negated else "") + " | ".join(info.only.values)
        notes.append(f"only if {info.only.key} is {where}")
    margin = max(COLUMN, len(entry) + 2)
    comment = textwrap.wrap("; ".join(notes), WIDTH - margin - 2)
    lines = [entry.ljust(margin) + "# " + comment[0]]
    lines += [" " * margin + "# " + rest for rest in comment[1:]]
    return "\n".join(lines)


def _wrapped(text: str, prefix: str) -> list[str]:
    return [prefix + line for line in textwrap.wrap(text, WIDTH - len(prefix))]
