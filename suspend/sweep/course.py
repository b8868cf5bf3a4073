"""The course of a sweep, wherever its points are computed: longest first, failures counted, stops with checkpoints."""

from __future__ import annotations

import time
from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from suspend.config import Config
from suspend.errors import Interrupted, NumericalError, StorageError
from suspend.simulation.stop import Stop
from suspend.sweep.folder import (
    LOG,
    Folder,
    Record,
    at_work,
    failure_text,
    is_complete,
    read_record,
    write_configuration,
    write_record,
)
from suspend.sweep.prediction import Task
from suspend.sweep.worker import DISK

SHORTEST = 1.0  # seconds left in which nothing is begun any more
POLL = 0.1  # seconds between looks at the processes
REPORT = 0.5  # seconds between reports
BUSY = 2.0  # seconds between looks at a point that a process of an earlier call still computes


@dataclass(frozen=True)
class Outcome:
    """How a process ended. code: its exit code, < 0 for a signal, None: not known, its machine was lost.

    record: of the point, as it left it; complete: the run is finished; message: where its record does not say it.
    """

    code: int | None
    record: Record
    complete: bool = False
    message: str = ""


def outcome_of(code: int, folder: Path, config: Config) -> Outcome:
    """The outcome as the point's folder tells it."""
    return Outcome(code, read_record(folder), code == 0 and is_complete(folder, config))


@dataclass
class Running:
    """A process at work on a task. place, handle: where it is and what it is, in the words of the kind of course."""

    task: Task
    place: Any
    handle: Any
    began: Record
    record: Record = field(default_factory=Record)

    @property
    def left(self) -> float | None:
        """Seconds to go at its present pace, None while it is unknown."""
        gained = self.record.strain - self.began.strain
        if gained <= 0.0 or self.record.total_strain <= 0.0:
            return None
        spent = self.record.seconds - self.record.began_seconds
        return spent / gained * max(self.record.total_strain - self.record.strain, 0.0)


@dataclass
class State:
    """Where the sweep is, for a display. where: what there is to compute on, if that may change."""

    total: int
    done: int
    running: list[Running]
    waiting: int
    failed: list[Task]
    where: str = ""


class Course(ABC):
    """Runs tasks until all are done or failed for good, or something stops it.

    event(kind, task, text) is called when a task starts, ends, is stopped, is to be tried again or fails; report(state)
    twice a second. Raises Interrupted (work is left), NumericalError (all else done, points failed for good),
    StorageError (the disk is full or fails).
    """

    def __init__(self, folder: Folder, retries: int):
        self.folder, self.retries = folder, retries
        self.running: list[Running] = []
        self.failed: list[Task] = []
        self.waiting: list[Task] = []
        self.event: Callable = lambda kind, task, text: None
        self.report: Callable = lambda state: None
        self._busy: dict[str, float] = {}

    @abstractmethod
    def _place(self, task: Task) -> Any:
        """Where there is room for this task now, None where there is not."""

    @abstractmethod
    def _is_full(self) -> bool:
        """Whether there is room for no task at all."""

    @abstractmethod
    def _begin(self, task: Task, place: Any, seconds: float | None) -> Any:
        """Start its process there, for at most `seconds`; returns the handle."""

    @abstractmethod
    def _outcome(self, each: Running) -> Outcome | None:
        """How its process ended, None while it runs."""

    @abstractmethod
    def _stop(self) -> list[Outcome]:
        """Stop what runs and wait for the checkpoints; the outcomes in the order of `running`."""

    def _look(self) -> None:  # noqa: B027 (on one machine there is nothing to look at)
        """Called in every round, before tasks are started."""

    def _where(self) -> str:
        return ""

    def go(self, tasks: list[Task], done: int, max_time: float | None) -> None:
        """Run all tasks; `done` were complete before."""
        self.total, self.done = len(tasks) + done, done
        self.failed = [task for task in tasks if task.record.failures > self.retries]
        self.waiting = sorted((t for t in tasks if t not in self.failed), key=lambda t: -t.remaining)
        reported = 0.0
        with Stop(max_time) as stop:
            stop.keep()
            try:
                while (self.waiting or self.running) and stop.check() is None:
                    self._look()
                    self._start(stop)
                    self._collect()
                    if time.monotonic() - reported > REPORT:
                        reported = time.monotonic()
                        self._say()
                    time.sleep(POLL)
            finally:
                self._end()
            if self.waiting:
                raise Interrupted(f"stopped ({stop.reason}): {self.summary()}")
        self._say()
        if self.failed:
            raise NumericalError(failure_text([(t.folder.name, t.record.message) for t in self.failed], self.total))

    def summary(self) -> str:
        """How far the sweep is, for who stops it."""
        left = len(self.waiting) + len(self.running)
        return f"{self.done} of {self.total} points complete, {left} left; the same command goes on"

    def _say(self) -> None:
        for each in self.running:
            each.record = read_record(each.task.folder)
        running, failed = list(self.running), list(self.failed)
        self.report(State(self.total, self.done, running, len(self.waiting), failed, self._where()))

    def _start(self, stop: Stop) -> None:
        """Start the longest tasks that fit."""
        if stop.deadline is not None and stop.deadline - time.monotonic() < SHORTEST:
            return
        for task in list(self.waiting):
            if self._is_full():
                return
            place = self._place(task)
            if place is None or self._is_busy(task):
                continue
            self.waiting.remove(task)
            self.running.append(self._launch(task, place, stop))

    def _is_busy(self, task: Task) -> bool:
        """A process that an earlier, killed call left behind is still writing its checkpoint."""
        now = time.monotonic()
        if now - self._busy.get(task.point.key, -BUSY) < BUSY:
            return True
        if at_work(task.folder) is None:
            self._busy.pop(task.point.key, None)
            return False
        self._busy[task.point.key] = now
        return True

    def _launch(self, task: Task, place: Any, stop: Stop) -> Running:
        write_configuration(task.folder, task.point.config)
        # What a process said last may be newer than what a network file system shows of it.
        task.record = max(task.record, read_record(task.folder), key=lambda record: record.updated)
        left = None if stop.deadline is None else max(stop.deadline - time.monotonic(), 1e-3)
        handle = self._begin(task, place, left)
        self.event("start", task, "")
        return Running(task, place, handle, task.record, task.record)

    def _collect(self) -> None:
        for each in list(self.running):
            outcome = self._outcome(each)
            if outcome is not None:
                self.running.remove(each)
                self._ended(each, outcome)

    def _ended(self, each: Running, outcome: Outcome) -> None:
        """Sort a task by how its process ended."""
        task, record, code = each.task, outcome.record, outcome.code
        task.record = record
        if code == 0 and outcome.complete:
            self.done += 1
            self.event("done", task, "")
            return
        if code == Interrupted.exit_code:
            self.waiting.append(task)
            self.event("stopped", task, "")
            return
        if code == DISK:  # of all points, and none counts it
            self.waiting.append(task)
            said = outcome.message or record.message
            raise StorageError(said or f"the disk is full or fails; {task.folder / LOG} has more")
        if code is None or code < 0 or record.running or record.failures <= each.began.failures:
            record = task.record = self._died(task, each.began, outcome)
        if record.failures > self.retries:
            self.failed.append(task)
            self.event("failed", task, record.message)
        else:
            self.waiting.append(task)
            self.event("again", task, record.message)

    def _died(self, task: Task, began: Record, outcome: Outcome) -> Record:
        """Its process ended without a word: that counts against the retries unless it had come further."""
        code = outcome.code
        cause = f"its process ended with exit code {code}"
        if code is None or code < 0:
            cause = "its machine was lost" if code is None else f"its process was killed by signal {-code}"
        if code == 0:
            cause = "its process ended, but the run is not complete"
        message = outcome.message or f"{cause}; {task.folder / LOG} has its last words"
        further = outcome.record.strain > began.strain
        failures = 0 if further else began.failures + 1
        record = replace(outcome.record, running=False, failures=failures, message=message)
        write_record(task.folder, record)
        return record

    def _end(self) -> None:
        """Stop what runs, and sort it."""
        outcomes = self._stop()
        ended, self.running = self.running, []
        for each, outcome in zip(ended, outcomes, strict=True):
            code = outcome.code
            # On its way into the run a process has nothing to save and goes at once; the disk is known to be full.
            stopped = code is None or code < 0 or code == DISK
            self._ended(each, replace(outcome, code=Interrupted.exit_code) if stopped else outcome)
