"""A script for Slurm that computes a sweep as an array of jobs, one a point, without anything at work beside them."""

from __future__ import annotations

import math
import os
import shlex
import sys
from pathlib import Path

from suspend.config.wall_time import clock
from suspend.sweep.cluster_section import ClusterSection
from suspend.sweep.points import check_points
from suspend.sweep.prediction import check_memory, make_tasks
from suspend.sweep.run import Call

LOGS = "slurm"  # folder of the jobs' output, in the sweep's
USUAL_LIMIT = 1000  # tasks of an array that sites allow unless they say more
NOTICE = 60  # seconds before the end at which Slurm says so
RESTARTS = 100
HOUR = 3600.0
LONGEST = 24 * HOUR  # asked for by ourselves; what is left goes on in the next start
LEAST_MEMORY = 1e9  # bytes of a job; Python with its libraries takes a third

SCRIPT = r"""#!/bin/bash
# Points of the sweep @NAME@ that were not complete when this was written, one a job. Submit it with sbatch, as often
# as it takes: complete points end at once, interrupted ones go on, one that is being computed is left alone.
@HEAD@

export NUMBA_NUM_THREADS=1 OMP_NUM_THREADS=1 OPENBLAS_NUM_THREADS=1 MKL_NUM_THREADS=1
@PROLOGUE@cd @HERE@ || exit 4

points=(
@POINTS@
)
point=${points[${SLURM_ARRAY_TASK_ID:?is not set: submit this script with sbatch}]}

near_end=
child=
# Slurm's notice that the time is nearly up, sent to this shell only; then TERM from scancel and preemption.
trap 'near_end=yes; [ -z "$child" ] || kill -USR1 "$child" 2>/dev/null' USR1
trap '[ -z "$child" ] || kill -TERM "$child" 2>/dev/null' TERM
@COMMAND@ --point "$point" -q &
child=$!
while kill -0 "$child" 2>/dev/null; do
    wait "$child"  # a signal ends the waiting, not the run
done
wait "$child"
code=$?

# 130: stopped with a checkpoint; 138: USR1 before Python had started.
if [ -n "$near_end" ] && { [ "$code" -eq 130 ] || [ "$code" -eq 138 ]; }; then
    if [ "${SLURM_RESTART_COUNT:-0}" -lt @RESTARTS@ ]; then
        scontrol requeue "$SLURM_JOB_ID" && exit 0
    fi
fi
exit "$code"
"""


def slurm_array(call: Call, file: str | Path) -> tuple[str, list[str]]:
    """The script for what is left, and what its user should know. Makes the folder of the sweep.

    The section `cluster` gives queue, account, time, memory, directives and prologue where its kind is slurm.
    Raises ConfigurationError, StorageError.
    """
    check_points(call.left)
    tasks = make_tasks(call.left, call.places)
    section = call.sweep.cluster
    section = section if section is not None and section.kind == "slurm" else None
    if section is not None:
        check_memory(tasks, section.memory_of_point, "raise cluster.memory in the sweep file")
    folder = call.folder.path.resolve()
    call.folder.make_within(LOGS)
    memory = section.memory_of_point if section else max([LEAST_MEMORY, *(1.5 * task.memory for task in tasks)])
    longest = max((task.remaining for task in tasks), default=0.0)
    seconds = section.walltime if section else min(HOUR * max(math.ceil(2.0 * longest / HOUR), 1), LONGEST)
    names = [shlex.quote(call.places[task.point.key].name) for task in tasks]
    command = [sys.executable, "-m", "suspend_cli", "sweep", "run", str(Path(file).resolve()), "-o", str(folder)]
    parts = {
        "NAME": Path(file).stem.replace("\n", " "),
        "HEAD": "\n".join(_head(Path(file).stem, folder, len(tasks), memory, seconds, section)),
        "PROLOGUE": "".join(f"{line}\n" for line in (section.prologue if section else ())),
        "HERE": shlex.quote(os.getcwd()),
        "POINTS": "\n".join(names),
        "COMMAND": shlex.join(command),
        "RESTARTS": str(RESTARTS),
    }
    script = SCRIPT
    for name, text in parts.items():
        script = script.replace(f"@{name}@", text, 1)
    return script, _notes(len(tasks), longest, seconds)


def _head(name: str, folder: Path, count: int, memory: float, seconds: float, section: ClusterSection | None):
    at_once = f"%{section.workers}" if section else ""
    name = "".join(c if c.isalnum() or c in "-_." else "_" for c in name)
    output = f"{str(folder).replace('%', '%%')}/{LOGS}/%A_%a.out"
    options = [
        f"--job-name={name}",
        f"--array=0-{max(count - 1, 0)}{at_once}",
        "--ntasks=1",
        "--cpus-per-task=1",
        f"--mem={math.ceil(memory / 2**20)}M",
        f"--time={clock(seconds)}",
        f"--signal=B:USR1@{NOTICE}",
        "--requeue",
        "--open-mode=append",
        f'--output="{output}"',
    ]
    if section and section.queue:
        options.append(f"--partition={section.queue}")
    if section and section.account:
        options.append(f"--account={section.account}")
    return [f"#SBATCH {option}" for option in [*options, *(section.directives if section else ())]]


def _notes(count: int, longest: float, seconds: float) -> list[str]:
    notes = []
    if count > USUAL_LIMIT:
        notes.append(
            f"{count} jobs in one array: many sites allow {USUAL_LIMIT} (scontrol show config | grep MaxArraySize); "
            f"submit parts with sbatch --array=0-{USUAL_LIMIT - 1} and so on"
        )
    if longest > seconds:
        notes.append(
            f"the longest point takes about {clock(longest)}, a job ends after {clock(seconds)}: it is put back into "
            "the queue and goes on"
        )
    return notes
