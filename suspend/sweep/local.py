"""A sweep on this machine: single-threaded processes on all cores, longest first, within the memory."""

from __future__ import annotations

import subprocess

from suspend.sweep.course import Course, Outcome, Running, outcome_of
from suspend.sweep.folder import Folder
from suspend.sweep.prediction import Task
from suspend.sweep.process import start_process, stop_process

HERE = "this machine"


class LocalSweep(Course):
    """`workers` processes at a time, which together take at most `memory` bytes."""

    def __init__(self, folder: Folder, workers: int, memory: float, retries: int):
        super().__init__(folder, retries)
        self.workers, self.memory = workers, memory

    def _is_full(self) -> bool:
        return len(self.running) >= self.workers

    def _place(self, task: Task) -> str | None:
        taken = sum(each.task.memory for each in self.running)
        return None if self.running and taken + task.memory > self.memory else HERE

    def _begin(self, task: Task, place: str, seconds: float | None) -> subprocess.Popen:
        return start_process(task.folder, self.folder.path, task.point.config.directory, seconds)

    def _outcome(self, each: Running) -> Outcome | None:
        code = each.handle.poll()
        if code is None:
            return None
        each.handle.stdin.close()
        return outcome_of(code, each.task.folder, each.task.point.config)

    def _stop(self) -> list[Outcome]:
        for each in self.running:
            stop_process(each.handle)
        for each in self.running:
            each.handle.wait()
        return [self._outcome(each) for each in self.running]

