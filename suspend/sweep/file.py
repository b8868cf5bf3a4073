"""The sweep file: a base configuration, what varies, seeds, and how to run it. Strict, with places in all errors."""

from __future__ import annotations

import difflib
import math
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path

from suspend.config.load import read_text
from suspend.config.schema import every_key
from suspend.config.tree import Item, Problems, parse
from suspend.errors import ConfigurationError
from suspend.sweep.adaptive_section import AdaptiveSection, check_blocks, read_adaptive
from suspend.sweep.cluster_section import ClusterSection, read_cluster
from suspend.sweep.sizes import memory_bytes

DEPTH = 7  # a list within a section within the base of a block
BLOCK_KEYS = ("base", "set", "vary", "zip", "seeds")
TOP_KEYS = (*BLOCK_KEYS, "runs", "workers", "retries", "memory", "cluster", "adaptive")
RANGE_KEYS = ("from", "to", "steps", "spacing")
MOST_VALUES = 100_000
RETRIES = 2

Axis = list[tuple[tuple[str, Item], ...]]  # choices, each of values for one or more keys


@dataclass
class Block:
    """Points made by crossing axes: `axes[k]` holds the choices of one key, or of several zipped together."""

    where: str
    base: Item
    directory: str  # that paths in the base are relative to
    fixed: dict[str, Item] = field(default_factory=dict)
    axes: list[Axis] = field(default_factory=list)
    seeds: list[Item] | None = None


@dataclass
class Sweep:
    """A sweep file as read; `workers` and `memory` (bytes) are None where the machine decides."""

    source: str
    blocks: list[Block]
    workers: int | None = None
    retries: int = RETRIES
    memory: float | None = None
    cluster: ClusterSection | None = None
    adaptive: AdaptiveSection | None = None


def read_sweep(path: str | Path) -> Sweep:
    """Read a sweep file. Raises ConfigurationError with all problems and their lines, StorageError."""
    path = Path(path)
    try:
        text = read_text(path)
    except ConfigurationError as error:
        if not path.exists():
            raise ConfigurationError(f"{path}: no such sweep file") from None
        raise error
    problems = Problems(str(path))
    root = parse(text, str(path), problems, DEPTH)
    if root is None or not isinstance(root.value, dict):
        problems.raise_any()
        raise ConfigurationError(f"{path}: is no sweep file; it needs the keys base and vary, or runs")
    sweep = _Reader(path, problems).sweep(root)
    _raise(problems, path)
    return sweep


def _raise(problems: Problems, path: Path) -> None:
    if len(problems.lines) > 1:
        head = f"{len(problems.lines)} errors in the sweep file {path}"
        raise ConfigurationError("\n  ".join([head, *problems.lines]))
    problems.raise_any()


class _Reader:
    """Turns the tree into blocks; problems are collected."""

    def __init__(self, path: Path, problems: Problems):
        self.path, self.problems = path, problems
        self.bases: dict[str, Item | None] = {}

    def sweep(self, root: Item) -> Sweep:
        """The whole file."""
        top = self._known(root, TOP_KEYS, "")
        blocks = []
        listed = top.get("runs")
        if listed is None:
            blocks.append(self._block(root.where, top, {}))
        elif not isinstance(listed.value, list) or not listed.value:
            self.problems.add(listed.where, "runs", f"found {listed.found}; must be a list of blocks (- vary: ...)")
        else:
            for item in listed.value:
                if not isinstance(item.value, dict):
                    self.problems.add(item.where, "runs", f"found {item.found}; a block has keys, such as vary")
                else:
                    blocks.append(self._block(item.where, top, self._known(item, BLOCK_KEYS, "runs")))
        workers, retries = self._count(top, "workers", 1), self._count(top, "retries", 0)
        found = [block for block in blocks if block is not None]
        cluster = read_cluster(top["cluster"], self.problems) if "cluster" in top else None
        adaptive = read_adaptive(top["adaptive"], self.problems) if "adaptive" in top else None
        if adaptive is not None:
            check_blocks(adaptive, found, self.problems, top["adaptive"].where)
        return Sweep(
            str(self.path), found, workers, RETRIES if retries is None else retries, self._memory(top.get("memory")),
            cluster, adaptive,
        )  # fmt: skip

    def _known(self, item: Item, keys: tuple[str, ...], within: str) -> dict[str, Item]:
        for name, child in item.value.items():
            if name in keys:
                continue
            close = difflib.get_close_matches(name.lower(), keys, 1, 0.6)
            hint = f"; did you mean {close[0]}?" if close else f"; there are {', '.join(keys)}"
            if "." in name or name in {key.partition(".")[0] for key in every_key()}:
                hint = "; a key of the configuration goes into base, set (one value) or vary (several)"
            elif name in TOP_KEYS:
                hint = "; it belongs to the top level of the file"
            self.problems.add(child.where, f"{within}.{name}" if within else name, f"unknown key{hint}")
        return {name: child for name, child in item.value.items() if name in keys and child.value is not None}

    def _block(self, where: str, top: dict[str, Item], own: dict[str, Item]) -> Block | None:
        base = own.get("base") or top.get("base")
        if base is None:
            self.problems.add(where, "base", "is missing; must be the path of a configuration, or one written out")
            return None
        tree, directory = self._base(base)
        fixed = self._mapping(top.get("set"), "set") | self._mapping(own.get("set"), "set")
        varied = self._mapping(top.get("vary"), "vary") | self._mapping(own.get("vary"), "vary")
        axes = {name: self._axis(name, item) for name, item in varied.items()}
        zipped = [self._zipped(group) for group in self._groups(own.get("zip") or top.get("zip"))]
        self._once(where, axes, zipped, own.get("set"))
        fixed = {name: item for name, item in fixed.items() if name not in axes}
        seeds = own.get("seeds") or top.get("seeds")
        return None if tree is None else Block(
            where, tree, directory, fixed, [*axes.values(), *zipped], self._seeds(seeds)
        )

    def _base(self, item: Item) -> tuple[Item | None, str]:
        here = self.path.parent
        if isinstance(item.value, dict):
            return item, str(here)
        if not isinstance(item.value, str):
            self.problems.add(item.where, "base", f"found {item.found}; must be a path or a configuration written out")
            return None, ""
        path = here / item.value
        if item.value not in self.bases:
            self.bases[item.value] = None
            try:
                tree = parse(read_text(path), str(path), self.problems)
            except ConfigurationError as error:
                self.problems.add(item.where, "base", f"{error} (paths start from the sweep file's folder)")
                return None, ""
            if tree is None or not isinstance(tree.value, dict):
                self.problems.add(item.where, "base", f"{path} is no configuration")
            else:
                self.bases[item.value] = tree
        return self.bases[item.value], str(path.parent)

    def _mapping(self, item: Item | None, name: str) -> dict[str, Item]:
        if item is None:
            return {}
        if not isinstance(item.value, dict):
            self.problems.add(item.where, name, f"found {item.found}; must be lines of KEY: values")
            return {}
        return dict(self._flat(item, name))

    def _flat(self, item: Item, name: str) -> Iterator[tuple[str, Item]]:
        """Keys of set and vary; sections may also be written nested."""
        sections = {key.partition(".")[0] for key in every_key() if "." in key}
        for key, child in item.value.items():
            if key == "seed":
                self.problems.add(child.where, f"{name}.seed", "give seeds: a number of seeds or a list")
            elif key in sections and isinstance(child.value, dict):
                yield from ((f"{key}.{inner}", value) for inner, value in child.value.items())
            else:
                yield key, child

    def _axis(self, name: str, item: Item) -> Axis:
        values = self._range(name, item) if isinstance(item.value, dict) else item.value
        if not isinstance(values, list):
            self.problems.add(
                item.where, f"vary.{name}",
                f"found {item.found}; must be a list or a range {{from, to, steps, spacing}}; one value goes into set",
            )  # fmt: skip
            return []
        if not values:
            self.problems.add(item.where, f"vary.{name}", "found an empty list; give at least one value")
        return [((name, value),) for value in values]

    def _range(self, name: str, item: Item) -> list[Item]:
        place, parts = f"vary.{name}", item.value
        unknown = [key for key in parts if key not in RANGE_KEYS]
        missing = [key for key in RANGE_KEYS[:3] if key not in parts]
        if unknown or missing:
            what = f"unknown key {unknown[0]}" if unknown else f"{missing[0]} is missing"
            example = "{from: 0.1, to: 10, steps: 9, spacing: linear | log}"
            self.problems.add(item.where, place, f"{what}; a range is {example}")
            return [item]
        spacing = parts["spacing"].value if "spacing" in parts else "linear"
        numbers = [parts[key].value for key in RANGE_KEYS[:3]]
        if any(isinstance(n, bool) or not isinstance(n, int | float) or not math.isfinite(n) for n in numbers):
            self.problems.add(item.where, place, "from, to and steps must be numbers")
            return [item]
        low, high, steps = numbers
        wrong = None
        if spacing not in ("linear", "log"):
            wrong = f"spacing: found {parts['spacing'].found}; must be linear or log"
        elif not isinstance(steps, int) or not 2 <= steps <= MOST_VALUES:
            wrong = f"steps: found {parts['steps'].found}; must be an integer of at least 2 (the ends count)"
        elif spacing == "log" and (low <= 0 or high <= 0):
            wrong = f"found {low:g} to {high:g}; both ends must be > 0 with spacing: log"
        elif low == high:
            wrong = "from and to are the same"
        if wrong:
            self.problems.add(item.where, place, wrong)
            return [item]
        info = every_key().get(name)
        whole = info is not None and info.kind == "integer"
        return [_number(value, whole, item.where) for value in _spaced(low, high, steps, spacing)]

    def _groups(self, item: Item | None) -> list[Item]:
        if item is None:
            return []
        return item.value if isinstance(item.value, list) else [item]

    def _zipped(self, group: Item) -> Axis:
        columns = self._mapping(group, "zip")
        axes = [self._axis(name, item) for name, item in columns.items()]
        lengths = {name: len(axis) for name, axis in zip(columns, axes, strict=True)}
        if len(set(lengths.values())) > 1:
            found = ", ".join(f"{name} {count}" for name, count in lengths.items())
            self.problems.add(group.where, "zip", f"keys zipped together need equally many values, found {found}")
            return []
        return [tuple(entry for part in parts for entry in part) for parts in zip(*axes, strict=True)]

    def _once(self, where: str, axes: dict, zipped: list[Axis], fixed: Item | None) -> None:
        names = list(axes) + [name for axis in zipped if axis for name, _ in axis[0]]
        for name in sorted({name for name in names if names.count(name) > 1}):
            self.problems.add(where, name, "is both in vary and zip, or zipped twice; keep one of them")
        for name in self._mapping(fixed, "set"):
            if name in names:
                self.problems.add(where, name, "is both set and varied for these runs; keep one of them")

    def _seeds(self, item: Item | None) -> list[Item] | None:
        if item is None:
            return None
        if isinstance(item.value, int) and not isinstance(item.value, bool):
            if not 1 <= item.value <= MOST_VALUES:
                self.problems.add(item.where, "seeds", f"found {item.value}; must be at least 1, or a list of seeds")
                return None
            return [Item(n + 1, item.where, str(n + 1)) for n in range(item.value)]
        if not isinstance(item.value, list) or not item.value:
            self.problems.add(item.where, "seeds", f"found {item.found}; must be how many, or a list such as [1, 2, 3]")
            return None
        values = [entry.value for entry in item.value]
        if len({repr(value) for value in values}) < len(values):
            self.problems.add(item.where, "seeds", "holds a seed twice: two equal runs tell nothing new")
        return item.value

    def _count(self, top: dict[str, Item], name: str, least: int) -> int | None:
        item = top.get(name)
        if item is None:
            return None
        if not isinstance(item.value, int) or isinstance(item.value, bool) or not least <= item.value <= 10_000:
            self.problems.add(item.where, name, f"found {item.found}; must be an integer of at least {least}")
            return None
        return item.value

    def _memory(self, item: Item | None) -> float | None:
        if item is None:
            return None
        size = memory_bytes(item.text)
        if size is None:
            self.problems.add(item.where, "memory", f"found {item.found}; must be a size such as 8 GB or 500 MB")
        return size


def _spaced(low: float, high: float, steps: int, spacing: str) -> Iterator[float]:
    for k in range(steps):
        t = k / (steps - 1)
        if k in (0, steps - 1):
            yield (low, high)[k > 0]
        elif spacing == "log":
            yield low ** (1.0 - t) * high**t
        else:
            yield low + (high - low) * t


def _number(value: float, whole: bool, where: str) -> Item:
    # Twelve digits: 0.3, not 0.30000000000000004, in the names of folders.
    value = round(value) if whole else float(f"{value:.12g}")
    return Item(value, where, repr(value))
