"""Who computes a sweep beyond this machine: the workers of a Dask scheduler, or jobs of a batch system."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import ExitStack
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING

from suspend.errors import ConfigurationError
from suspend.sweep.cluster_section import ClusterSection
from suspend.sweep.points import check_points
from suspend.sweep.prediction import check_memory, make_tasks
from suspend.sweep.run import Call

if TYPE_CHECKING:
    from suspend.sweep.batch_jobs import BatchJobs


class Crew:
    """A context within which `compute` may be called, again too where points were added; jobs stay between.

    scheduler : an address or a scheduler file; else section : the jobs to ask for. Entering it checks what can be
    checked before anything is written. Raises ConfigurationError, StorageError.
    """

    def __init__(self, scheduler: str | None, section: ClusterSection | None):
        self.scheduler, self.section = scheduler, section
        self._opened = ExitStack()
        self.jobs: BatchJobs | None = None

    def __enter__(self) -> Crew:
        """Connect, or see that jobs can be submitted."""
        _check_installed("distributed" if self.scheduler is not None else "dask_jobqueue")
        if self.scheduler is not None:
            from suspend.sweep.scheduler import connect

            self.client = self._opened.enter_context(connect(self.scheduler))
        else:
            from suspend.sweep.batch_jobs import check_submission

            check_submission(self.section)
        return self

    def __exit__(self, *error: object) -> None:
        """Disconnect; jobs are given back."""
        self._opened.close()

    def compute(self, call: Call, max_time: float | None, event: Callable, report: Callable, note: Callable) -> None:
        """Compute what is left; the sweep's lock must be held. Raises as `ClusterSweep`."""
        from suspend.sweep.cluster import ClusterSweep

        check_points(call.left)
        tasks = make_tasks(call.left, call.places)
        if self.scheduler is not None:
            sweep = ClusterSweep(call.folder, self.client, call.sweep.retries)
        else:
            check_memory(tasks, self.section.memory, "raise cluster.memory in the sweep file")
            sweep = self._with_jobs(call, note)
        sweep.event, sweep.report, sweep.note = event, report, note
        sweep.go(tasks, call.done, max_time)

    def _with_jobs(self, call: Call, note: Callable):
        from suspend.sweep.batch_jobs import BatchJobs
        from suspend.sweep.cluster import ClusterSweep

        if self.jobs is None:
            self.jobs = BatchJobs(self.section, Path(call.sweep.source).stem, call.folder.path.resolve(), note)
            self._opened.callback(self.jobs.close)
            self.client = self._opened.enter_context(self.jobs.client())
        self.jobs.note = note
        return ClusterSweep(call.folder, self.client, call.sweep.retries, self.section.workers, self.jobs)


def _check_installed(module: str) -> None:
    if find_spec(module) is None:
        raise ConfigurationError(
            "computing on other machines needs Dask, which is not installed: pip install 'suspend[cluster]', or "
            "compute here (without --scheduler, with --local); nothing was started"
        )
