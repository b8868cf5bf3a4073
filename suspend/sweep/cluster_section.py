"""The section `cluster` of a sweep file: the batch system whose jobs compute the points."""

from __future__ import annotations

import difflib
from dataclasses import dataclass

from suspend.config.tree import Item, Problems
from suspend.config.wall_time import EXAMPLES, wall_seconds
from suspend.sweep.sizes import memory_bytes

KINDS = {"slurm": "sbatch", "pbs": "qsub", "sge": "qsub"}  # each with the command that submits
KEYS = ("kind", "workers", "cores", "memory", "walltime", "queue", "account", "directives", "prologue", "interface")
SAME = {"partition": "queue"}  # Slurm's word
MEMORY = 2e9  # bytes a core
WALL_TIME = 4 * 3600.0  # s
LEAST_TIME = 300.0  # s; start-up and compilation take a minute


@dataclass(frozen=True)
class ClusterSection:
    """Jobs of a batch system; each holds `cores` points at a time.

    workers : points at a time in all; memory : bytes of a job; walltime : s of a job; queue, account, interface : None
    leaves the site's default; directives : lines for the head of the job script, without #SBATCH; prologue : lines of
    shell before the work.
    """

    kind: str
    workers: int
    cores: int = 1
    memory: float = MEMORY
    walltime: float = WALL_TIME
    queue: str | None = None
    account: str | None = None
    directives: tuple[str, ...] = ()
    prologue: tuple[str, ...] = ()
    interface: str | None = None

    @property
    def memory_of_point(self) -> float:
        """Bytes there are for one point."""
        return self.memory / self.cores


def read_cluster(item: Item, problems: Problems) -> ClusterSection | None:
    """The section as written; problems are noted, and None is returned where there is one."""
    if not isinstance(item.value, dict):
        problems.add(item.where, "cluster", f"found {item.found}; must be a section of keys: {', '.join(KEYS)}")
        return None
    before = len(problems.lines)
    found: dict[str, Item] = {}
    for written, child in item.value.items():
        name = SAME.get(written, written)
        if name not in KEYS:
            close = difflib.get_close_matches(name.lower(), (*KEYS, *SAME), 1, 0.6)
            hint = f"did you mean {close[0]}?" if close else f"there are {', '.join(KEYS)}"
            problems.add(child.where, f"cluster.{written}", f"unknown key; {hint}")
        elif name in found:
            problems.add(child.where, f"cluster.{written}", "is given twice (partition and queue are the same)")
        elif child.value is not None:
            found[name] = child
    values = _values(item, found, problems)
    return ClusterSection(**values) if len(problems.lines) == before else None


def _values(item: Item, found: dict[str, Item], problems: Problems) -> dict:
    values = {}
    for name, least in (("workers", 1), ("cores", 1)):
        if name in found:
            values[name] = _count(name, found[name], least, problems)
    for name in ("queue", "account", "interface"):
        if name in found:
            values[name] = _line(name, found[name], problems)
    for name in ("directives", "prologue"):
        if name in found:
            values[name] = _lines(name, found[name], problems)
    values["kind"] = _kind(item, found.get("kind"), problems)
    if "workers" not in found:
        problems.add(item.where, "cluster.workers", "is missing; must be how many points are computed at a time")
    values["memory"] = MEMORY * (values.get("cores") or 1)
    if "memory" in found:
        values["memory"] = memory_bytes(found["memory"].text)
        if values["memory"] is None:
            text = f"found {found['memory'].found}; must be a size such as 8 GB or 500 MB, of one job"
            problems.add(found["memory"].where, "cluster.memory", text)
    if "walltime" in found:
        values["walltime"] = wall_seconds(found["walltime"].text)
        if values["walltime"] is None or values["walltime"] < LEAST_TIME:
            text = f"found {found['walltime'].found}; must be a time of at least 5 minutes such as {EXAMPLES}"
            problems.add(found["walltime"].where, "cluster.walltime", text)
    return values


def _kind(item: Item, kind: Item | None, problems: Problems) -> str | None:
    allowed = ", ".join(KINDS)
    if kind is None:
        problems.add(item.where, "cluster.kind", f"is missing; must be one of {allowed}")
    elif kind.value not in KINDS:
        problems.add(kind.where, "cluster.kind", f"found {kind.found}; must be one of {allowed}")
    else:
        return kind.value
    return None


def _count(name: str, item: Item, least: int, problems: Problems) -> int | None:
    if isinstance(item.value, int) and not isinstance(item.value, bool) and least <= item.value <= 100_000:
        return item.value
    problems.add(item.where, f"cluster.{name}", f"found {item.found}; must be an integer of at least {least}")
    return None


def _line(name: str, item: Item, problems: Problems) -> str | None:
    simple = not isinstance(item.value, list | dict)
    text = item.text.strip() if simple else ""
    if text and "\n" not in text:
        return text
    problems.add(item.where, f"cluster.{name}", f"found {item.found}; must be one line of text")
    return None


def _lines(name: str, item: Item, problems: Problems) -> tuple[str, ...]:
    if not isinstance(item.value, list):
        problems.add(item.where, f"cluster.{name}", f"found {item.found}; must be a list of lines")
        return ()
    return tuple(filter(None, (_line(name, each, problems) for each in item.value)))
