"""The points of a sweep: every combination resolved to a configuration, checked, named."""

from __future__ import annotations

import hashlib
import itertools
import json
import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any

from suspend.config import Config
from suspend.config.load import assemble
from suspend.config.schema import every_key
from suspend.config.tree import Item
from suspend.errors import ConfigurationError, SuspendError
from suspend.sweep.file import Block, Sweep

MOST_POINTS = 100_000
DIGITS = 10  # of the hash in a folder's name
NAMED = 3  # impossible points named with each problem


@dataclass(frozen=True)
class Point:
    """One run of the sweep. `parameters`: what the file varies, by dotted key; `key`: hash without the duration."""

    name: str
    key: str
    config: Config
    parameters: dict[str, Any]

    @property
    def seed(self) -> int:
        """The seed of its starting configuration."""
        return self.config.seed


def resolve(sweep: Sweep) -> list[Point]:
    """All points, each once. Raises ConfigurationError that names every impossible point."""
    shown = shown_keys(sweep)
    points: dict[str, Point] = {}
    problems: dict[str, list[str]] = {}
    count = 0
    for block in sweep.blocks:
        for assignments in combinations(block):
            count += 1
            if count > MOST_POINTS:
                raise ConfigurationError(f"{sweep.source}: more than {MOST_POINTS} points; leave out some values")
            add_point(block, assignments, shown, points, problems)
    if problems:
        raise ConfigurationError(_impossible(sweep, count, problems))
    if not points:
        raise ConfigurationError(f"{sweep.source}: holds no point")
    return list(points.values())


def add_point(block: Block, assignments: list, shown: list[str], points: dict, problems: dict) -> None:
    """Resolve one combination of a block and put it into `points` by its key; what is wrong goes into `problems`."""
    values = {name: _value(item) for name, item in assignments}
    label = _label(values, shown)
    try:
        config = assemble(block.base, assignments, label, block.directory)
    except ConfigurationError as error:
        text = str(error)
        lines = text.split("\n  ")[1:] if text.startswith(tuple("0123456789")) and "\n  " in text else [text]
        for line in lines:
            problems.setdefault(line, []).append(label)
        return
    key = configuration_key(config)
    before = points.get(key)
    if before is not None and before.config.duration != config.duration:
        line = (
            f"{block.where}: duration: points that differ in duration only are one run, which goes on to the longest: "
            "give one duration"
        )
        problems.setdefault(line, []).append(label)
        return
    if before is not None and config.particles.minimum_gap is None and before.config.directory != config.directory:
        line = (
            f"{block.where}: particles.initial: found {config.particles.initial!r} in two folders, {config.directory} "
            f"and {before.config.directory}: give the files different names"
        )
        problems.setdefault(line, []).append(label)
        return
    parameters = {name: values[name] for name in shown if name in values and name != "seed"}
    points.setdefault(key, Point(f"{label}_{key}", key, config, parameters))


def combinations(block: Block) -> Iterator[list[tuple[str, Item]]]:
    """Values for the keys of a block, one list a point."""
    fixed = list(block.fixed.items())
    seeds = [()] if block.seeds is None else [(("seed", item),) for item in block.seeds]
    for choice in itertools.product(*block.axes, seeds):
        yield fixed + [entry for part in choice for entry in part]


def shown_keys(sweep: Sweep) -> list[str]:
    """Keys in which points may differ, in the order of the file; the seed comes last."""
    found: dict[str, None] = {}
    fixed = [{name: repr(_value(item)) for name, item in block.fixed.items()} for block in sweep.blocks]
    for block in sweep.blocks:
        for axis in block.axes:
            found |= dict.fromkeys(name for choice in axis[:1] for name, _ in choice)
        found |= dict.fromkeys(
            name for name in block.fixed if len({each.get(name) for each in fixed}) > 1
        )
    if any(block.seeds is not None for block in sweep.blocks):
        found["seed"] = None
    return list(found)


def _value(item: Item) -> Any:
    if isinstance(item.value, list):
        return [_value(entry) for entry in item.value]
    if isinstance(item.value, dict):
        return {name: _value(entry) for name, entry in item.value.items()}
    return item.value


def short_name(key: str) -> str:
    """What a key is called in the names of folders: its usual symbol or its last word."""
    info = every_key().get(key)
    last = key.rpartition(".")[2]
    symbol = info.symbols[0] if info is not None and info.symbols else last
    return symbol if key in ("particles.volume_fraction", "flow.amplitude", "particles.number") else last


def _label(values: Mapping[str, Any], shown: list[str]) -> str:
    short = [short_name(name) for name in shown]
    # Two keys of one last word are told apart by their sections.
    names = [word if short.count(word) == 1 else key.replace(".", "-") for key, word in zip(shown, short, strict=True)]
    parts = [f"{name}-{_text(values[key])}" for key, name in zip(shown, names, strict=True) if key in values]
    return "_".join(parts)[:120] or "base"


def _text(value: Any) -> str:
    if isinstance(value, float):
        text = f"{value:g}" if float(f"{value:g}") == value else repr(value)
    elif isinstance(value, dict):
        text = "-".join(_text(entry) for entry in value.values())
    elif isinstance(value, list):
        text = ",".join(_text(entry) for entry in value)
    else:
        text = "off" if value is None else str(value)
    return re.sub(r"[^A-Za-z0-9.,+-]+", "-", text).strip(".")[:40]


def configuration_key(config: Config) -> str:
    """Hash of the resolved configuration without its duration: a longer duration extends the same run."""
    content = config.to_dict()
    del content["duration"]
    return hashlib.sha256(json.dumps(content, sort_keys=True).encode()).hexdigest()[:DIGITS]


def _impossible(sweep: Sweep, count: int, problems: dict[str, list[str]]) -> str:
    labels = {label for each in problems.values() for label in each}
    head = f"{sweep.source}: {len(labels)} of {count} points are impossible, nothing was started"
    lines = []
    for line, points in problems.items():
        names = "all points" if len(points) == count and count > 1 else ", ".join(points[:NAMED])
        more = f" and {len(points) - NAMED} more" if names != "all points" and len(points) > NAMED else ""
        lines.append(f"{line} ({names}{more})")
    return "\n  ".join([head, *lines])


def check_points(points: list[Point]) -> None:
    """Check what needs other files: the starting configurations that are read. Raises what they raise."""
    from suspend.initial import prepare_initial
    from suspend.sweep.starts import made_from_seed

    seen = set()
    for point in points:
        particles = point.config.particles
        if made_from_seed(point.config):
            continue
        spheres = (particles.number, particles.volume_fraction)
        place = (point.config.directory, particles.initial, particles.frame, *spheres)
        if place in seen:
            continue
        seen.add(place)
        try:
            prepare_initial(point.config, point.config.directory)
        except SuspendError as error:
            raise type(error)(f"point {point.name}: {error}; nothing was started") from None
