"""A sweep on this machine: single-threaded processes on all cores, longest first, within the memory."""

from __future__ import annotations

import signal
import subprocess
import time
from collections.abc import Callable
from dataclasses import dataclass, field, replace

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
from suspend.sweep.process import start_process
from suspend.sweep.worker import DISK

SHORTEST = 1.0  # seconds left in which nothing is begun any more
POLL = 0.1  # seconds between looks at the processes
REPORT = 0.5  # seconds between reports
BUSY = 2.0  # seconds between looks at a point that a process of an earlier call still computes


@dataclass
class Running:
    """A process at work on a task."""

    task: Task
    process: subprocess.Popen
    started: float
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
    """Where the sweep is, for a display."""

    total: int
    done: int
    running: list[Running]
    waiting: int
    failed: list[Task]


class LocalSweep:
    """Runs tasks until all are done or failed for good, or something stops it.

    event(kind, task, text) is called when a task starts, ends, is stopped, is to be tried again or fails; report(state)
    twice a second. Raises Interrupted (work is left), NumericalError (all else done, points failed for good),
    StorageError (the disk is full or fails).
    """

    def __init__(self, folder: Folder, workers: int, memory: float, retries: int):
        self.folder, self.workers, self.memory, self.retries = folder, workers, memory, retries
        self.running: list[Running] = []
        self.failed: list[Task] = []
        self.event: Callable = lambda kind, task, text: None
        self.report: Callable = lambda state: None

    def go(self, tasks: list[Task], done: int, max_time: float | None) -> None:
        """Run all tasks; `done` were complete before."""
        self.total, self.done = len(tasks) + done, done
        self.failed = [task for task in tasks if task.record.failures > self.retries]
        self.waiting = sorted((t for t in tasks if t not in self.failed), key=lambda t: -t.remaining)
        self._busy: dict[str, float] = {}
        reported = 0.0
        with Stop(max_time) as stop:
            stop.keep()
            try:
                while (self.waiting or self.running) and stop.check() is None:
                    self._start(stop)
                    self._collect()
                    if time.monotonic() - reported > REPORT:
                        reported = time.monotonic()
                        self._say()
                    time.sleep(POLL)
            finally:
                self._end()
            if self.waiting:
                left = len(self.waiting)
                raise Interrupted(
                    f"stopped ({stop.reason}): {self.done} of {self.total} points complete, {left} left; "
                    "the same command goes on"
                )
        self._say()
        if self.failed:
            raise NumericalError(failure_text([(t.folder.name, t.record.message) for t in self.failed], self.total))

    def _say(self) -> None:
        for each in self.running:
            each.record = read_record(each.task.folder)
        self.report(State(self.total, self.done, list(self.running), len(self.waiting), list(self.failed)))

    def _start(self, stop: Stop) -> None:
        """Start the longest tasks that fit."""
        if stop.deadline is not None and stop.deadline - time.monotonic() < SHORTEST:
            return
        for task in list(self.waiting):
            if len(self.running) >= self.workers:
                return
            taken = sum(each.task.memory for each in self.running)
            if self.running and taken + task.memory > self.memory:
                continue
            if self._is_busy(task):
                continue
            self.waiting.remove(task)
            self.running.append(self._launch(task, stop))

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

    def _launch(self, task: Task, stop: Stop) -> Running:
        write_configuration(task.folder, task.point.config)
        task.record = read_record(task.folder)
        left = None if stop.deadline is None else max(stop.deadline - time.monotonic(), 1e-3)
        process = start_process(task.folder, self.folder.path, task.point.config.directory, left)
        self.event("start", task, "")
        return Running(task, process, time.monotonic(), task.record, task.record)

    def _collect(self) -> None:
        for each in list(self.running):
            code = each.process.poll()
            if code is None:
                continue
            self.running.remove(each)
            self._close(each)
            self._ended(each.task, each.began, code)

    @staticmethod
    def _close(each: Running) -> None:
        each.process.stdin.close()

    def _ended(self, task: Task, began: Record, code: int) -> None:
        """Sort a task by how its process ended."""
        record = task.record = read_record(task.folder)
        if code == 0 and is_complete(task.folder, task.point.config):
            self.done += 1
            self.event("done", task, "")
            return
        if code == Interrupted.exit_code:
            self.waiting.append(task)
            self.event("stopped", task, "")
            return
        if code == DISK:  # of all points, and none counts it
            self.waiting.append(task)
            raise StorageError(record.message or f"the disk is full or fails; {task.folder / LOG} has more")
        if code < 0 or record.running or record.failures <= began.failures:
            record = task.record = self._died(task, began, record, code)
        if record.failures > self.retries:
            self.failed.append(task)
            self.event("failed", task, record.message)
        else:
            self.waiting.append(task)
            self.event("again", task, record.message)

    def _died(self, task: Task, began: Record, record: Record, code: int) -> Record:
        """Its process ended without a word: that counts against the retries unless it had come further."""
        cause = f"killed by signal {-code}" if code < 0 else f"ended with exit code {code}"
        if code == 0:
            cause = "ended, but the run is not complete"
        message = f"its process {cause}; {task.folder / LOG} has its last words"
        further = record.strain > began.strain
        record = replace(record, running=False, failures=0 if further else began.failures + 1, message=message)
        write_record(task.folder, record)
        return record

    def _end(self) -> None:
        """Stop what runs, wait for the checkpoints, and sort it."""
        for each in self.running:
            each.process.terminate()
            each.process.send_signal(signal.SIGCONT)  # one that is suspended would never hear of it
        codes = [each.process.wait() for each in self.running]
        ended, self.running = self.running, []
        for each, code in zip(ended, codes, strict=True):
            self._close(each)
            # On its way into the run a process has nothing to save and goes at once; the disk is known to be full.
            stopped = code < 0 or code == DISK
            self._ended(each.task, each.began, Interrupted.exit_code if stopped else code)
