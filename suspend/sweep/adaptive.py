"""Adaptive sweeps: when a group is complete, the bound on gamma_c decides which amplitudes are added to it.

A group is what differs in the refined key and the seed only. What is added follows from the group's complete runs
alone; it is kept in the sweep's manifest, so that every later call has the same points. Where the manifest is lost,
the choices are made again one after the other, from the same runs, and find the folders that are there.
"""

from __future__ import annotations

import hashlib
import json
import math
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from suspend.config import Config
from suspend.config.load import assemble
from suspend.config.tree import Item
from suspend.errors import ConfigurationError, NumericalError
from suspend.io.files import InUseError
from suspend.sweep.file import Block, Sweep
from suspend.sweep.points import Point, add_point, combinations, shown_keys

UNITS = {"minus_N2_nu0": "eta0"}


@dataclass
class Group:
    """Points that differ in the refined key and the seed only.

    key: hash of what they have in common; parameters: of that what the file varies; members: for each seed the block
    and the values of all other keys; chosen: values that were added; verdict: what the runs said when they were
    examined last, empty before.
    """

    key: str
    parameters: dict[str, Any]
    members: dict[str, tuple[Block, list[tuple[str, Item]]]] = field(default_factory=dict)
    points: list[Point] = field(default_factory=list)
    chosen: list[float] = field(default_factory=list)
    verdict: dict[str, Any] = field(default_factory=dict)

    def stamp(self, section) -> str:
        """Of its points and of what is asked for: changes where it must be examined again."""
        content = [section.as_dict(), sorted(point.key for point in self.points)]
        return hashlib.sha256(json.dumps(content).encode()).hexdigest()[:10]


def make_groups(sweep: Sweep, points: list[Point]) -> list[Group]:
    """The groups of a sweep with a section `adaptive`, none of others."""
    groups: dict[str, Group] = {}
    if sweep.adaptive is None:
        return []
    refined = sweep.adaptive.key
    of_point = {group_key(point.config, refined): point for point in reversed(points)}
    for block in sweep.blocks:
        for assignments in combinations(block):
            rest = [(name, item) for name, item in assignments if name != refined]
            if len(rest) == len(assignments) or not _varies(block, refined):
                continue
            text = repr([(name, item.text) for name, item in rest])
            if any(text in group.members for group in groups.values()):
                continue
            key = group_key(assemble(block.base, assignments, sweep.source, block.directory), refined)
            common = {name: value for name, value in of_point[key].parameters.items() if name != refined}
            groups.setdefault(key, Group(key, common)).members[text] = (block, rest)
    _sort_points(groups, points, refined)
    return list(groups.values())


def _varies(block: Block, refined: str) -> bool:
    return any(axis and axis[0][0][0] == refined for axis in block.axes)


def _sort_points(groups: dict[str, Group], points: list[Point], refined: str) -> None:
    for point in points:
        group = groups.get(group_key(point.config, refined))
        if group is not None and point not in group.points:
            group.points.append(point)


def group_key(config: Config, refined: str) -> str:
    """Hash of a configuration without seed, duration and the refined key."""
    content = config.to_dict()
    del content["duration"], content["seed"]
    section, _, name = refined.rpartition(".")
    (content[section] if section else content).pop(name, None)
    return hashlib.sha256(json.dumps(content, sort_keys=True).encode()).hexdigest()[:10]


def value_of(point: Point, refined: str) -> float:
    """The refined key of a point."""
    section, _, name = refined.rpartition(".")
    return float(getattr(getattr(point.config, section) if section else point.config, name))


def adopt(call) -> None:
    """Take over what the manifest holds of each group, with the points that were added. Raises ConfigurationError."""
    if not call.groups:
        return
    manifest, known = call.folder.manifest(), {point.key for point in call.points}
    kept = {entry["key"]: entry for entry in manifest.get("adaptive", [])}
    for group in call.groups:
        entry = kept.get(group.key, {})
        chosen = [x for x in entry.get("chosen", ()) if isinstance(x, float)]
        if len(chosen) >= len(group.chosen):
            group.verdict = entry.get("verdict", group.verdict)
            add(call, group, [x for x in chosen if x not in group.chosen])
    order = {entry["key"]: number for number, entry in enumerate(manifest.get("points", []))}
    before, added = ([p for p in call.points if (p.key in known) is here] for here in (True, False))
    call.points = before + sorted(added, key=lambda p: order.get(p.key, len(order)))  # numbers stay those of --point


def add(call, group: Group, values: list[float]) -> None:
    """Add points with these values of the refined key to a group, one a seed."""
    if not values:
        return
    shown, problems = shown_keys(call.sweep), {}
    points = {point.key: point for point in call.points}
    for value in values:
        for block, rest in group.members.values():
            item = Item(value, block.where, repr(value))
            add_point(block, [*rest, (call.sweep.adaptive.key, item)], shown, points, problems)
    if problems:
        raise ConfigurationError(f"{call.sweep.source}: adaptive: " + "; ".join(problems))
    added = [point for key, point in points.items() if key not in {p.key for p in call.points}]
    group.chosen += values
    call.points = list(points.values())
    call.places, call.former = call.folder.place(call.points)
    call.left += call.incomplete(added)
    _sort_points({group.key: group}, added, call.sweep.adaptive.key)


def refinable(call) -> list[Group]:
    """Groups whose points are all complete and not examined yet."""
    left = {point.key for point in call.left}
    return [
        group
        for group in call.groups
        if not any(point.key in left for point in group.points)
        and group.verdict.get("stamp") != group.stamp(call.sweep.adaptive)
    ]


def refine(call, say: Callable[[str], None] = lambda text: None) -> bool:
    """Examine the complete groups and add what they ask for; whether that was anything. The sweep's lock must be held.

    say(text): told of each bound. Raises StorageError.
    """
    groups = refinable(call)
    added = False
    for group in groups:
        stamp, decision = group.stamp(call.sweep.adaptive), examine(call, group)
        bound = decision.bound
        group.verdict = {
            "stamp": stamp, "low": _finite(bound.low), "high": _finite(bound.high), "width": _finite(bound.width),
            "signatures": list(bound.agreeing), "narrow": decision.narrow, "reason": decision.reason,
            "next": list(decision.amplitudes),
        }  # fmt: skip
        add(call, group, list(decision.amplitudes))
        added = added or bool(decision.amplitudes)
        say(line_of(describe(call, group)))
    if groups:
        call.write()
    return added


def _finite(value: float) -> float | None:
    return value if math.isfinite(value) else None


def examine(call, group: Group):
    """The `Decision` of `suspend.analysis.refinement` about a group; kept analyses are read, others made."""
    from suspend.analysis.refinement import decide
    from suspend.sweep.collect import point_scalars

    section = call.sweep.adaptive
    rows: dict[float, list[dict]] = {}
    for point in sorted(group.points, key=lambda p: (value_of(p, section.key), p.seed)):
        scalars = point_scalars(call.places[point.key], None, lambda text: None)
        rows.setdefault(value_of(point, section.key), []).append(scalars)
    values: dict[str, list] = {}
    errors: dict[str, list] = {}
    for name in section.signatures:
        unit = f"[{UNITS.get(name, '-')}]"
        for found, column in ((values, name + unit), (errors, f"{name}_error{unit}")):
            found[name] = [np.array([_number(row.get(column)) for row in each]) for each in rows.values()]
    return decide(np.array(list(rows)), values, errors, section.width, section.points - len(group.chosen))


def _number(value: Any) -> float:
    return float(value) if isinstance(value, int | float) else math.nan


def refine_now(call, say: Callable[[str], None]) -> None:
    """Examine complete groups outside of a computation, where no other call has the lock. Raises StorageError."""
    if not refinable(call):
        return
    try:
        lock = call.folder.lock()
    except InUseError:  # whoever has it does this
        return
    try:
        adopt(call)
        refine(call, say)
    finally:
        lock.release()


def rounds(call, compute: Callable[[float | None], None], max_time: float | None, say: Callable[[str], None]) -> None:
    """Compute, choose, compute what was chosen, until nothing is added; compute(seconds left). Raises as `compute`."""
    from suspend.sweep.run import is_due

    started = time.monotonic()
    while True:
        failed = None
        try:
            if is_due(call):
                compute(None if max_time is None else max(max_time - (time.monotonic() - started), 1e-3))
                call.look()
        except NumericalError as error:  # points failed for good: other groups go on
            failed = error
            call.look()
        if not refine(call, say):
            break
    if failed is not None:
        raise failed


def describe(call, group: Group) -> dict[str, Any]:
    """A group for status and manifest, plain types."""
    left = {point.key for point in call.left}
    return {
        "key": group.key, "parameters": group.parameters, "refined": call.sweep.adaptive.key,
        "asked": call.sweep.adaptive.as_dict(), "points": len(group.points),
        "left": sum(point.key in left for point in group.points), "chosen": group.chosen, "verdict": group.verdict,
    }  # fmt: skip


def group_lines(call) -> list[str]:
    """One line a group; says also which will be examined by the next call."""
    ready = {group.key for group in refinable(call)}
    lines = [line_of(describe(call, group)) for group in call.groups]
    notes = [" (to be examined)" if group.key in ready else "" for group in call.groups]
    return [line + note for line, note in zip(lines, notes, strict=True)]


def line_of(group: dict[str, Any]) -> str:
    """One line about a group, as `describe` gives it."""
    name = ", ".join(f"{key} {value}" for key, value in group["parameters"].items()) or "all points"
    verdict, asked = group["verdict"], group["asked"]
    head = f"{name}: critical {group['refined']} "
    if not verdict:
        return head + f"not examined yet; its {group['points']} points come first"
    if verdict["low"] is None or verdict["high"] is None:
        bound = "not bounded"
    else:
        width = "open" if verdict["width"] is None else f"{100.0 * verdict['width']:.3g} % wide"
        count = f"{len(verdict['signatures'])} of {len(asked['signatures'])} signatures"
        bound = f"({verdict['low']:.4g}, {verdict['high']:.4g}), {width}, {100.0 * asked['width']:g} % asked, {count}"
    more = f"next: {', '.join(f'{x:g}' for x in verdict['next'])}" if verdict["next"] else verdict["reason"]
    return f"{head}{bound}; {len(group['chosen'])} value(s) added; {more}"
