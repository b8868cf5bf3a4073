"""The section `adaptive` of a sweep file: amplitudes are added until the bound on gamma_c is narrow enough."""

from __future__ import annotations

import difflib
import math
from dataclasses import asdict, dataclass, field
from typing import Any

from suspend.config.schema import every_key
from suspend.config.tree import Item, Problems

KEYS = ("key", "width", "points", "signatures")
REFINED = "flow.amplitude"
WIDTH, POINTS = 0.05, 12
LEAST_WIDTH, MOST_WIDTH = 0.005, 1.0
MOST_POINTS = 1000
LEAST_VALUES = 3  # to begin with: a place needs two sides


def _all_signatures() -> tuple[str, ...]:
    from suspend.analysis.refinement import SIGNATURES  # the analysis takes its time to import

    return tuple(SIGNATURES)


@dataclass(frozen=True)
class AdaptiveSection:
    """What is asked for.

    key: what is refined; width: of the bound, (high - low)/middle; points: values added at most to a group;
    signatures: quantities by name, see `suspend.analysis.refinement.SIGNATURES`.
    """

    key: str = REFINED
    width: float = WIDTH
    points: int = POINTS
    signatures: tuple[str, ...] = field(default_factory=_all_signatures)

    def as_dict(self) -> dict[str, Any]:
        """Plain types, as kept with the sweep."""
        return asdict(self) | {"signatures": list(self.signatures)}


def read_adaptive(item: Item, problems: Problems) -> AdaptiveSection | None:
    """The section as written; problems are noted, and None is returned where there is one."""
    if not isinstance(item.value, dict):
        problems.add(item.where, "adaptive", f"found {item.found}; must be a section of keys: {', '.join(KEYS)}")
        return None
    before = len(problems.lines)
    values: dict[str, Any] = {}
    for name, child in item.value.items():
        if name not in KEYS:
            close = difflib.get_close_matches(name.lower(), KEYS, 1, 0.6)
            hint = f"did you mean {close[0]}?" if close else f"there are {', '.join(KEYS)}"
            problems.add(child.where, f"adaptive.{name}", f"unknown key; {hint}")
        elif child.value is not None:
            found, allowed = _CHECKS[name](child)
            values[name] = found
            if found is None:
                problems.add(child.where, f"adaptive.{name}", f"found {child.found}; must be {allowed}")
    return AdaptiveSection(**values) if len(problems.lines) == before else None


def check_blocks(section: AdaptiveSection, blocks: list, problems: Problems, where: str) -> None:
    """Some block must vary the key, over values enough to begin with, and not zipped to other keys."""
    found = False
    for block in blocks:
        for axis in block.axes:
            names = [name for name, _ in axis[0]] if axis else []
            if section.key not in names:
                continue
            found = True
            if len(names) > 1:
                problems.add(block.where, "adaptive", f"{section.key} is zipped to other keys; put it into vary")
            elif len(axis) < LEAST_VALUES:
                text = f"{section.key} has {len(axis)} value(s) in vary; {LEAST_VALUES} or more are needed"
                problems.add(block.where, "adaptive", text)
    if not found:
        problems.add(where, "adaptive", f"{section.key} is not varied; give {LEAST_VALUES} or more values in vary")


def _key(item: Item):
    info = every_key().get(item.value) if isinstance(item.value, str) else None
    right = info is not None and info.kind == "number"
    return item.value if right else None, f"a key of the configuration that holds a number, such as {REFINED}"


def _width(item: Item):
    value = item.value
    right = isinstance(value, int | float) and not isinstance(value, bool) and math.isfinite(value)
    right = right and LEAST_WIDTH <= value <= MOST_WIDTH
    return float(value) if right else None, f"a number from {LEAST_WIDTH:g} to {MOST_WIDTH:g}: 0.05 for 5 %"


def _points(item: Item):
    value = item.value
    right = isinstance(value, int) and not isinstance(value, bool) and 1 <= value <= MOST_POINTS
    return value if right else None, f"an integer from 1 to {MOST_POINTS}"


def _signatures(item: Item):
    names = [str(each.value) for each in item.value] if isinstance(item.value, list) else []
    known = _all_signatures()
    right = bool(names) and len(set(names)) == len(names) and all(name in known for name in names)
    return tuple(names) if right else None, f"a list, each once, of {', '.join(known)}"


_CHECKS = {"key": _key, "width": _width, "points": _points, "signatures": _signatures}
