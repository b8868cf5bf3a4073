"""Jobs of a batch system as workers of a sweep, made by dask-jobqueue from the section `cluster` of its file."""

from __future__ import annotations

import math
import shlex
import shutil
import sys
import time
from collections.abc import Callable
from pathlib import Path

import dask
from dask_jobqueue import PBSCluster, SGECluster, SLURMCluster
from dask_jobqueue.core import JobQueueCluster
from distributed import Client
from distributed.deploy.spec import ProcessInterface

from suspend.config.wall_time import clock
from suspend.errors import ConfigurationError
from suspend.sweep.cluster_section import KINDS, ClusterSection
from suspend.sweep.remote import JOB_END
from suspend.sweep.scheduler import silence

CLUSTERS = {"slurm": SLURMCluster, "pbs": PBSCluster, "sge": SGECluster}
LOGS = "jobs"  # folder of the jobs' output, in the sweep's
CHECKPOINTS = 90.0  # seconds before the end of a job at which its points stop
CLOSING = 30.0  # seconds before the end of a job at which its worker goes
ADJUST = 10.0  # seconds between looks at the number of jobs
IDLE = 60.0  # seconds after which a job without points is given back, where none are waiting
AGAIN = 600.0  # seconds until more jobs are asked for than the batch system took
SILENCE = 600.0  # seconds without any worker after which that is said
NAME = 15  # letters of a job's name that every PBS takes


def check_submission(section: ClusterSection) -> None:
    """Raises ConfigurationError where jobs of this section cannot be submitted from this machine."""
    command = KINDS[section.kind]
    if shutil.which(command) is None:
        raise ConfigurationError(
            f"the section cluster asks for jobs of {section.kind}, but {command} is not on the PATH of this machine: "
            "call where jobs are submitted, or give --local to compute here; nothing was started"
        )
    parallel = any(line.split()[:1] == ["-pe"] for line in section.directives)
    if section.kind == "sge" and section.cores > 1 and not parallel:
        raise ConfigurationError(
            f"cluster.cores: found {section.cores}; SGE gives several cores by a parallel environment, whose name is "
            f'the site\'s: add directives: ["-pe NAME {section.cores}"]; nothing was started'
        )


def make_cluster(section: ClusterSection, name: str, logs: Path, refused: list[str]) -> JobQueueCluster:
    """A cluster without jobs yet; what the batch system says against a job is added to `refused`.

    A job is one Dask worker with a thread a point: points are processes of their own, none can take the worker along.
    What the section leaves out is taken from the site's configuration of dask-jobqueue (jobqueue.yaml).
    """
    site = {key: dask.config.get(f"jobqueue.{section.kind}.{key}", None) for key in _SITE}
    account = "project" if section.kind == "sge" else "account"
    name = "".join(c if c.isalnum() or c in "-_." else "_" for c in f"suspend-{name}")[:NAME]
    until = math.floor(section.walltime - CHECKPOINTS)
    end = f"export {JOB_END}=$(( $(date +%s) + {until} ))"
    options = {
        "cores": section.cores,
        "processes": 1,
        "memory": f"{math.ceil(section.memory)}B",
        "walltime": clock(section.walltime),
        "queue": section.queue,
        account: section.account,
        "interface": section.interface,
        "job_extra_directives": [*(site["job-extra-directives"] or []), *section.directives],
        "job_script_prologue": [*(site["job-script-prologue"] or []), *section.prologue, end],
        "worker_extra_args": [*(site["worker-extra-args"] or []), "--lifetime", f"{section.walltime - CLOSING:.0f}s"],
        "job_name": name,
        "python": site["python"] or shlex.quote(sys.executable),
        # Directives cannot name a folder with a space in it; the batch system then has its own place.
        "log_directory": None if any(c.isspace() for c in str(logs)) else str(logs),
        "scheduler_options": {"dashboard_address": ":0"} | (site["scheduler-options"] or {}),
    }
    silence()
    kind = CLUSTERS[section.kind]
    job = type("Job", (_Job, kind.job_cls), {"refused": refused})
    return kind(job_cls=job, silence_logs="critical", **options)


_SITE = ("job-extra-directives", "job-script-prologue", "worker-extra-args", "python", "scheduler-options")


class _Job:
    """Keeps the reason why a job was not taken, which otherwise goes to a log of Dask's."""

    refused: list[str]

    async def start(self):
        """Submit the job."""
        try:
            await super().start()
        except (RuntimeError, ValueError, OSError) as error:
            lines = [line.strip() for line in str(error).splitlines() if line.strip()]
            said = lines[lines.index("stderr:") + 1 :] if "stderr:" in lines else lines
            self.refused.append(" ".join(said or lines))
            await ProcessInterface.start(self)  # as if it were waiting in the queue; `adjust` takes it out


class BatchJobs:
    """The jobs of a sweep: asked for while points wait, given back when there is nothing to do for them."""

    def __init__(self, section: ClusterSection, name: str, folder: Path, note: Callable[[str], None]):
        self.section, self.logs = section, folder / LOGS
        self.refused: list[str] = []
        self.note = note
        self.cluster = make_cluster(section, name, self.logs, self.refused)
        self._limit, self._limited = math.inf, 0.0
        self._idle: dict[str, float] = {}
        self._adjusted, self._silent_since = 0.0, time.monotonic()

    def client(self) -> Client:
        """A client of their scheduler, which is at work in this process."""
        return Client(self.cluster, set_as_default=False)

    def close(self) -> None:
        """Give all jobs back."""
        self.cluster.close()

    def adjust(self, points: int, waiting: int, idle: list[str], workers: int) -> None:
        """See to it that there are jobs for this many points, of which some are waiting.

        idle : names of workers without points. Raises ConfigurationError where the batch system takes no job at all.
        """
        now = time.monotonic()
        if now - self._adjusted < ADJUST:
            return
        self._adjusted = now
        self._mind_refusals(workers)
        if waiting:
            self._idle = {}
            wanted = math.ceil(min(points, self.section.workers) / self.section.cores)
            self.cluster.scale(jobs=max(min(wanted, self._limit), len(self.cluster.worker_spec)))
        else:
            self._give_back(idle)
        if workers:
            self._silent_since = now
        elif now - self._silent_since > SILENCE:
            self._silent_since = now
            self.note(f"no worker yet from {len(self.cluster.worker_spec)} job(s); their output goes to {self.logs}")

    def _mind_refusals(self, workers: int) -> None:
        now = time.monotonic()
        if self.refused:
            said, refused = self.refused[-1], [n for n, job in self.cluster.workers.items() if job.job_id is None]
            self.refused.clear()
            taken = len(self.cluster.worker_spec) - len(refused)
            if not (taken or workers):
                command = KINDS[self.section.kind]
                raise ConfigurationError(f"{command} takes no job of this sweep: {said}; nothing was started")
            self.note(f"{self.section.kind} took {taken} job(s), and no more: {said}")
            self._limit, self._limited = taken, now
            self.cluster.sync(self.cluster.scale_down, refused)
        elif now - self._limited > AGAIN:
            self._limit = math.inf

    def _give_back(self, idle: list[str]) -> None:
        now = time.monotonic()
        self._idle = {name: self._idle.get(name, now) for name in idle}
        over = [name for name, since in self._idle.items() if now - since > IDLE]
        if over:
            self.cluster.sync(self.cluster.scale_down, over)
