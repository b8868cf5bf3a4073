"""A sweep on the workers of a Dask cluster, which share the folder: one single-threaded process a point.

Dask finds the workers, carries points to them and tells when one is gone. Which point goes where is said here, as on
one machine: a point never starts where the version is another or the folder is not the same, nor while a process that
has lost its worker still writes the point's checkpoint.
"""

from __future__ import annotations

import os
import socket
import time
import uuid
from collections import Counter
from collections.abc import Callable
from concurrent.futures import CancelledError
from contextlib import suppress
from dataclasses import dataclass, replace
from math import inf
from pathlib import Path
from typing import TYPE_CHECKING, Any

from distributed import Client, Future, KilledWorker

import suspend
from suspend.core.kernel_cache import source_stamp
from suspend.errors import ConfigurationError, Interrupted
from suspend.sweep.course import POLL, Course, Outcome, Running
from suspend.sweep.folder import Folder, Record, read_record
from suspend.sweep.lease import Lease
from suspend.sweep.prediction import Task, check_memory
from suspend.sweep.remote import compute_point
from suspend.sweep.scheduler import CONNECT

if TYPE_CHECKING:
    from suspend.sweep.batch_jobs import BatchJobs

PATIENCE = 20.0  # seconds without a worker after which that is said
LOOK = 1.0  # seconds between looks at the workers
FETCH = 30.0  # seconds in which a worker hands over how a process ended
GRACE = 60.0  # seconds for the checkpoints at the end
QUIET = 60.0  # seconds without news of a point after which nobody computes it, where locks do not say so
LOST = 3  # workers a point may lose in succession without having come further, before that is its failure
LEAST = 30.0  # seconds a worker must have left for a point to start there


@dataclass(frozen=True)
class Worker:
    """A worker that may compute.

    name : of its job; memory : bytes; until : when points stop there, by the monotonic clock here.
    """

    address: str
    name: str
    host: str
    threads: int
    memory: float
    until: float


class ClusterSweep(Course):
    """Computes on all workers of a scheduler, `most` points at a time; `jobs` brings the workers, or others do.

    note(text) : told of workers. Raises as Course, ConfigurationError where a worker is unfit before anything started.
    """

    def __init__(self, folder: Folder, client: Client, retries: int, most: float = inf, jobs: BatchJobs | None = None):
        super().__init__(Folder(folder.path.resolve()), retries)
        self.client, self.most = client, most
        self.workers: dict[str, Worker] = {}
        self.jobs = jobs
        self.note: Callable[[str], None] = lambda text: None
        self._said = False
        self._examined: dict[str, Future | None] = {}  # None: the answer was taken
        self._locks, self._begun, self._looked, self._opened = True, False, 0.0, time.monotonic()
        self._losses: dict[str, tuple[float, int]] = {}  # by key: strain at the last, how many without progress
        self._news: dict[str, tuple[float, float]] = {}  # by key: the record's last change, when it was seen

    def go(self, tasks: list[Task], done: int, max_time: float | None) -> None:
        """Run all tasks; `done` were complete before. The sweep's lock must be held."""
        self.lease = Lease(self.folder.path)
        try:
            super().go(tasks, done, max_time)
        finally:
            self.lease.remove()

    # --- the workers ------------------------------------------------------------------------------------------------

    def _look(self) -> None:
        self.lease.renew()
        if time.monotonic() - self._looked < LOOK:
            return
        self._looked = time.monotonic()
        if self.client.status not in ("running", "connecting"):  # Dask has given up
            raise Interrupted(f"stopped (the connection to the scheduler is lost): {self.summary()}")
        try:
            threads = self.client.nthreads(callback_timeout=CONNECT) if self._is_connected() else None
        except (OSError, TimeoutError):
            threads = None
        if threads is None:
            return
        self.workers = {address: worker for address, worker in self.workers.items() if address in threads}
        self._examined = {address: future for address, future in self._examined.items() if address in threads}
        for address in threads.keys() - self._examined.keys():
            self._examined[address] = self.client.submit(
                _examiner(str(self.folder.path), self.lease.token),
                key=f"suspend-worker-{uuid.uuid4()}", workers=[address], allow_other_workers=False,
            )  # fmt: skip
        for address, future in self._examined.items():
            if future is not None and future.status in ("finished", "error"):
                self._examined[address] = None
                self._take(address, threads[address], _answer(future))
        if self.workers and not (self._begun or self._is_examining()):
            largest = max(worker.memory for worker in self.workers.values())
            check_memory(self.waiting, largest, "start workers with a higher --memory-limit")
        if not (self._said or self.workers or self._is_examining()) and time.monotonic() - self._opened > PATIENCE:
            self._said = True
            there = f"{len(threads)} there, none of them has answered" if threads else "none there yet"
            self.note(f"waiting for workers: {there}")
        self._adjust_jobs()

    def _is_connected(self) -> bool:
        return self.client.status == "running"

    def _is_examining(self) -> bool:
        """Whether workers have not answered yet, of those that there were at first."""
        late = time.monotonic() - self._opened > CONNECT
        return not late and any(future is not None for future in self._examined.values())

    def _adjust_jobs(self) -> None:
        if self.jobs is None:
            return
        at_work = {each.place.address for each in self.running}
        idle = [worker.name for address, worker in self.workers.items() if address not in at_work]
        waiting = len(self.waiting)
        self.jobs.adjust(waiting + len(self.running), waiting, idle, len(self.workers))

    def _take(self, address: str, threads: int, answer: dict[str, Any]) -> None:
        """Take a worker that has answered, if it is fit."""
        problem = _problem(answer, self.folder.path)
        if problem and not self._begun:
            raise ConfigurationError(f"worker {address} {problem}; nothing was started")
        if problem:
            self.note(f"worker {address} is left out: it {problem}")
            return
        left = answer["seconds_left"]
        until = inf if left is None else time.monotonic() + left
        self.workers[address] = Worker(address, answer["name"], answer["host"], threads, answer["memory"], until)
        if self._locks and not answer["locks"]:
            self._locks = False
            self.note(
                f"file locks of this folder do not reach {answer['host']}: a point whose worker is lost goes on only "
                f"after {QUIET:.0f} s without news of it; start no second call on another machine"
            )

    def _where(self) -> str:
        return f"{len(self.workers)} worker" + "s" * (len(self.workers) != 1)

    # --- where a task goes ------------------------------------------------------------------------------------------

    def _is_full(self) -> bool:
        if not self._is_connected() or (self._is_examining() and not self._begun):
            return True  # nothing is started before all that are there are known to be fit
        return len(self.running) >= min(self.most, sum(worker.threads for worker in self._lasting()))

    def _lasting(self) -> list[Worker]:
        """The workers that have time enough left for a point."""
        now = time.monotonic()
        return [worker for worker in self.workers.values() if worker.until - now > LEAST]

    def _place(self, task: Task) -> Worker | None:
        """The worker with room that has most threads to spare."""
        count, memory = Counter(), Counter()
        for each in self.running:
            count[each.place.address] += 1
            memory[each.place.address] += each.task.memory
        free = [
            worker for worker in self._lasting()
            if count[worker.address] < worker.threads and memory[worker.address] + task.memory <= worker.memory
        ]  # fmt: skip
        return max(free, key=lambda worker: worker.threads - count[worker.address], default=None)

    def _is_busy(self, task: Task) -> bool:
        return super()._is_busy(task) or not (self._locks or self._is_quiet(task))

    def _is_quiet(self, task: Task) -> bool:
        """Whether the point's record, if it was left by a process at work, has not changed for a while."""
        record = read_record(task.folder)
        if not record.running:
            return True
        now = time.monotonic()
        updated, since = self._news.get(task.point.key, (-1.0, now))
        self._news[task.point.key] = (record.updated, since if record.updated == updated else now)
        return now - self._news[task.point.key][1] > QUIET

    def _begin(self, task: Task, place: Worker, seconds: float | None) -> Future:
        self._begun = True
        directory = os.path.abspath(task.point.config.directory)
        return self.client.submit(
            compute_point, str(task.folder.resolve()), str(self.folder.path), directory, self.lease.token, seconds,
            key=f"suspend-point-{uuid.uuid4()}", workers=[place.address], allow_other_workers=False,
        )  # fmt: skip

    # --- how it ends ------------------------------------------------------------------------------------------------

    def _outcome(self, each: Running) -> Outcome | None:
        future = each.handle
        if not self._is_connected() or (future.status == "pending" and each.place.address in self.workers):
            return None
        if future.status == "finished":
            with suppress(OSError, TimeoutError, CancelledError):
                return _received(future.result(timeout=FETCH))
        record = read_record(each.task.folder)
        if future.status == "error":
            error = future.exception()
            if not isinstance(error, KilledWorker):
                return Outcome(1, record, message=f"{type(error).__name__} on worker {each.place.address}: {error}")
        future.cancel(force=True)
        return Outcome(None, record)

    def _ended(self, each: Running, outcome: Outcome) -> None:
        """A lost worker is no failure of the point, unless it loses one after the other without coming further."""
        task, key = each.task, each.task.point.key
        if outcome.code is not None:
            self._losses.pop(key, None)
            if outcome.code == Interrupted.exit_code:
                self._busy[key] = time.monotonic()  # what stopped it may be there still: no start at once
            super()._ended(each, outcome)
            return
        strain, count = self._losses.get(key, (each.began.strain, 0))
        count = 1 if outcome.record.strain > strain else count + 1
        self._losses[key] = (outcome.record.strain, count)
        if count > LOST:
            del self._losses[key]
            text = f"its worker was lost {count} times in succession before it came further"
            super()._ended(each, replace(outcome, message=text))
            return
        task.record = outcome.record
        self.waiting.append(task)
        self.event("again", task, f"its worker {each.place.address} on {each.place.host} was lost")

    def _stop(self) -> list[Outcome]:
        """End the lease and wait for what the workers answer; those that do not stop by themselves."""
        self.lease.end()
        deadline = time.monotonic() + GRACE
        outcomes: dict[int, Outcome] = {}
        silent = dict(enumerate(self.running))
        while silent and time.monotonic() < deadline:
            gone = self.client.status not in ("running", "connecting")
            for number, each in list(silent.items()):
                found = Outcome(None, read_record(each.task.folder)) if gone else self._outcome(each)
                if found is not None:
                    outcomes[number] = found
                    del silent[number]
            time.sleep(POLL)
        if silent:
            names = ", ".join(each.task.folder.name for each in silent.values())
            self.note(f"no answer from the workers of {names}; they stop by themselves")
        outcomes |= {number: Outcome(None, read_record(each.task.folder)) for number, each in silent.items()}
        return [outcomes[number] for number in range(len(self.running))]


def _examiner(sweep_folder: str, token: str) -> Callable:
    """What is run on a worker to learn what it is. A function within one: it is sent whole, suspend may be missing."""

    def examine():
        import socket

        from distributed import get_worker

        try:
            from suspend.sweep.remote import describe
        except Exception as error:
            return {"host": socket.gethostname(), "problem": f"{type(error).__name__}: {error}"}
        worker = get_worker()
        limit = float(worker.memory_manager.memory_limit or float("inf"))
        return describe(sweep_folder, token) | {"name": worker.name, "memory": limit}

    return examine


def _answer(future: Future) -> dict[str, Any]:
    try:
        return future.result(timeout=FETCH)
    except Exception as error:
        return {"host": "its machine", "problem": f"{type(error).__name__}: {error}"}


def _problem(answer: dict[str, Any], folder: Path) -> str:
    """Why a worker with this answer cannot compute, "" where it can."""
    on = f"on {answer['host']}"
    same = "install the same version in the environment that its workers are started from"
    if "problem" in answer:
        return f"{on} cannot import suspend {suspend.__version__} ({answer['problem']}): {same}"
    if answer["version"] != suspend.__version__:
        return f"{on} has suspend {answer['version']}, this is {suspend.__version__}: {same}"
    if answer["sources"] != source_stamp():
        return f"{on} has suspend {answer['version']} with other sources than {socket.gethostname()}: {same}"
    if not answer["visible"]:
        return f"{on} does not see {folder}: put the sweep on a file system that all machines share (-o DIR)"
    return ""


def _received(answer: dict[str, Any]) -> Outcome:
    return Outcome(**(answer | {"record": Record(**answer["record"])}))
