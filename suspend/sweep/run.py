"""One call of a sweep: check everything, see what is left, compute it until it is done or time is up."""

from __future__ import annotations

import difflib
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from pathlib import Path

from suspend.errors import ConfigurationError, Interrupted, NumericalError
from suspend.io.files import InUseError
from suspend.sweep.adaptive import Group, adopt, describe, make_groups, value_of
from suspend.sweep.file import Sweep, read_sweep
from suspend.sweep.folder import Folder, at_work, failure_text, is_complete, read_record, write_record
from suspend.sweep.points import Point, check_points, resolve


@dataclass
class Call:
    """A sweep as this call finds it: nothing has been started or written yet."""

    sweep: Sweep
    folder: Folder
    points: list[Point]
    places: dict[str, Path]
    former: list[str]  # folders whose points are not in the file any more
    left: list[Point] = field(default_factory=list)  # not complete
    groups: list[Group] = field(default_factory=list)  # of an adaptive sweep

    @property
    def done(self) -> int:
        """Number of complete points."""
        return len(self.points) - len(self.left)

    def look(self) -> None:
        """See again what is complete: another call may have been at work."""
        self.left = self.incomplete(self.left)

    def incomplete(self, points: list[Point]) -> list[Point]:
        """Those of the points that are not complete."""
        return [point for point in points if not is_complete(self.places[point.key], point.config)]

    def write(self) -> None:
        """Write what the sweep is into its folder, with the lock held. Raises StorageError."""
        group_of = {point.key: group for group in self.groups for point in group.points}
        entries = []
        for point in self.points:
            entry = {"folder": self.places[point.key].name, "key": point.key, "parameters": point.parameters}
            entry["seed"] = point.seed
            if point.key in group_of:
                group = group_of[point.key]
                entry["group"] = group.key
                entry["chosen"] = value_of(point, self.sweep.adaptive.key) in group.chosen
            entries.append(entry)
        groups = [describe(self, group) for group in self.groups]
        self.folder.write_manifest(self.sweep.source, entries, self.former, self.sweep.retries, groups)

    @property
    def changed(self) -> bool:
        """Whether points have gone from the file since the last call."""
        return self.former != self.folder.manifest().get("no_longer_in_the_file", [])


def prepare(file: str | Path, folder: str | Path | None = None) -> Call:
    """Read and check a sweep file and look at its folder (default: runs/NAME of NAME.yaml); changes nothing.

    Raises ConfigurationError, StorageError.
    """
    sweep = read_sweep(file)
    points = resolve(sweep)
    folder = Folder(folder if folder is not None else Path("runs") / Path(file).stem)
    places, former = folder.place(points)
    call = Call(sweep, folder, points, places, former, groups=make_groups(sweep, points))
    call.left = call.incomplete(points)
    adopt(call)
    return call


def open_call(call: Call, retry_failed: bool = False) -> None:
    """Write what the sweep is into its folder, with the lock held. Raises StorageError."""
    adopt(call)  # what another call has added meanwhile
    call.write()
    if retry_failed:
        forget_failures(call)


def forget_failures(call: Call) -> None:
    """Let points that failed for good be tried again. Raises StorageError."""
    for point in call.left:
        folder = call.places[point.key]
        record = read_record(folder)
        if record.failures:
            write_record(folder, replace(record, failures=0))


def pick(call: Call, which: str) -> Call:
    """The call restricted to one point: its number from 1 in the order of the file, its name, its folder or its key.

    Raises ConfigurationError.
    """
    for number, point in enumerate(call.points, 1):
        if which in (str(number), point.name, call.places[point.key].name, point.key):
            return replace(call, points=[point], left=[each for each in call.left if each.key == point.key])
    close = difflib.get_close_matches(which, [point.name for point in call.points], 1, 0.6)
    hint = f", such as {close[0]}" if close else "; --dry-run lists them"
    raise ConfigurationError(
        f"{call.sweep.source} has no point {which!r}: give a number from 1 to {len(call.points)} or a name{hint}"
    )


def compute_one(call: Call, which: str, retry_failed: bool, max_time: float | None, event: Callable) -> None:
    """Compute one point in this call; any number of such calls may be at work beside each other.

    Raises as `LocalSweep`, Interrupted where another process computes the point.
    """
    one = pick(call, which)
    if not is_due(one, retry_failed):
        return
    call.folder.make()
    try:
        lock = call.folder.lock()
    except InUseError:  # whoever has it has written what the sweep is
        pass
    else:
        try:
            open_call(call)
        finally:
            lock.release()
    (point,) = one.left
    folder = call.places[point.key]
    busy = at_work(folder)
    if busy is not None:
        raise Interrupted(f"{folder} is being computed ({busy}), nothing was started")
    if retry_failed:
        forget_failures(one)
    compute(one, 1, max_time, event)


def is_due(call: Call, retry_failed: bool = False) -> bool:
    """Whether there is something to compute. Raises NumericalError where only failed points are left."""
    if retry_failed or not call.left:
        return bool(call.left)
    records = {point.key: read_record(call.places[point.key]) for point in call.left}
    failed = [p for p in call.left if records[p.key].failures > call.sweep.retries]
    if len(failed) < len(call.left):
        return True
    messages = [(call.places[p.key].name, records[p.key].message) for p in failed]
    raise NumericalError(failure_text(messages, len(call.points)))


def compute(
    call: Call,
    workers: int | None = None,
    max_time: float | None = None,
    event: Callable | None = None,
    report: Callable | None = None,
) -> None:
    """Compute what is left on this machine; the sweep's lock must be held. Raises as `LocalSweep`."""
    from suspend.sweep.local import LocalSweep
    from suspend.sweep.machine import cores, free_memory
    from suspend.sweep.prediction import check_memory, make_tasks

    check_points(call.left)
    tasks = make_tasks(call.left, call.places)
    memory = call.sweep.memory or free_memory()
    check_memory(tasks, memory)
    local = LocalSweep(call.folder, workers or call.sweep.workers or cores(), memory, call.sweep.retries)
    local.event, local.report = event or local.event, report or local.report
    local.go(tasks, call.done, max_time)


def abandoned(call: Call) -> list[str]:
    """Points at which a process of an earlier call is still at work."""
    return [p.name for p in call.left if at_work(call.places[p.key])]
