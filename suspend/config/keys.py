"""What the configuration knows about a key: type, default, unit, allowed values, meaning.

A key is declared once, as a dataclass field of `physics`, `numerics` or `schema` whose metadata holds a `Key`;
validation, the reference file and `suspend init` are made from it.
"""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass
from typing import Any, NamedTuple

REQUIRED = object()  # stands for "no default"


class Only(NamedTuple):
    """Condition for a key or section to exist: `key` has one of `values` (or, negated, none of them).

    `key` is a sibling, or with `top` a key of the top level.
    """

    key: str
    values: tuple[str, ...]
    negated: bool = False
    top: bool = False

    def holds(self, value: Any) -> bool:
        """Whether the key exists when its sibling has this value."""
        return (value in self.values) != self.negated


@dataclass(frozen=True)
class Key:
    """One key. `default` REQUIRED: must be given; None: may be null. `example` is for the reference file."""

    kind: str  # integer, number, switch, choice, text, numbers, integers
    meaning: str
    unit: str = ""
    default: Any = REQUIRED
    least: float | None = None
    above: float | None = None
    most: float | None = None
    below: float | None = None
    choices: tuple[str, ...] = ()
    refused: tuple[tuple[str, str], ...] = ()  # values a user may try in good faith, and why they are refused
    former: tuple[tuple[str, str], ...] = ()  # values still read, and what they are called now
    length: int | None = None  # of a list
    only: Only | None = None
    group: str | None = None  # of keys with this name one and only one is given
    example: Any = None
    symbols: tuple[str, ...] = ()  # what the key is called in papers and other codes

    @property
    def required(self) -> bool:
        """Whether there is no default."""
        return self.default is REQUIRED

    @property
    def allowed(self) -> str:
        """The allowed values in words."""
        bounds = " and ".join(
            f"{sign} {limit if isinstance(limit, int) else format(limit, '.7g')}"
            for sign, limit in ((">=", self.least), (">", self.above), ("<=", self.most), ("<", self.below))
            if limit is not None
        )
        null = " or null" if self.default is None and self.group is None else ""
        if self.kind == "choice":
            return " | ".join(self.choices) + null
        if self.kind == "numbers":
            count = f"a list of {self.length} numbers" if self.length else "a list of numbers"
            return f"{count} {bounds}".strip() + null
        if self.kind == "integers":
            return f"a list of {self.length} integers {bounds}".strip() + null
        words = {"integer": "an integer", "number": "a number", "switch": "true | false", "text": "text"}
        return f"{words[self.kind]} {bounds}".strip() + null

    def within(self, value: float) -> bool:
        """Whether a number lies in the allowed range."""
        return (
            (self.least is None or value >= self.least)
            and (self.above is None or value > self.above)
            and (self.most is None or value <= self.most)
            and (self.below is None or value < self.below)
        )


class Section(NamedTuple):
    """A section: its dataclass, what it is for, and whether the term is off where it is absent or null.

    A section with a condition `only` is there, with its defaults, where that holds, and nowhere else.
    """

    cls: type
    meaning: str
    optional: bool = False
    only: Only | None = None


def key(kind: str, meaning: str, **properties: Any) -> Any:
    """Dataclass field of a key; `properties` are those of `Key`."""
    return _field(properties.get("default", REQUIRED), key=Key(kind, meaning, **properties))


def section(cls: type, meaning: str, *, optional: bool = False, only: Only | None = None) -> Any:
    """Dataclass field of a section; an optional one is None where the term is off."""
    return _field(None if optional else REQUIRED, section=Section(cls, meaning, optional, only))


def _field(default: Any, **metadata: Any) -> Any:
    if default is REQUIRED:
        return dataclasses.field(metadata=metadata)
    if isinstance(default, tuple):
        return dataclasses.field(default_factory=lambda: default, metadata=metadata)
    return dataclasses.field(default=default, metadata=metadata)


def keys_of(cls: type) -> dict[str, Key]:
    """Keys of a section's (or the root's) dataclass in order of declaration."""
    return {f.name: f.metadata["key"] for f in dataclasses.fields(cls) if "key" in f.metadata}


def sections_of(cls: type) -> dict[str, Section]:
    """Sections of the root's dataclass in order of declaration."""
    return {f.name: f.metadata["section"] for f in dataclasses.fields(cls) if "section" in f.metadata}
