"""One point at a time, and the script for Slurm's arrays run by bash with a Slurm of a few lines of shell."""

from __future__ import annotations

import os
import re
import signal
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from waiting import LIMIT, cycles_in, wait_until

from suspend.config.wall_time import clock, wall_seconds
from suspend.errors import ConfigurationError
from suspend.io import Run
from suspend.sweep import read_sweep, resolve
from suspend.sweep.folder import PointLock, read_record

ROOT = Path(__file__).parents[1]
SWEEP = """\
base:
  particles: {number: 8, volume_fraction: 0.2}
  flow: {type: oscillatory, amplitude: 0.3}
  duration: {cycles: 2}
  repulsion: {force: 10.0, debye_length: 0.01}
vary: {flow.amplitude: [0.3, 0.6, 0.9]}
"""
LONG = SWEEP.replace("cycles: 2", "cycles: 40000000")
CLUSTER = """\
cluster:
  kind: slurm
  workers: 64
  memory: 3 GiB
  walltime: 1-12:00:00
  partition: long
  account: physics
  directives: ["--constraint=haswell"]
  prologue: ["export MARK=here"]
"""


def environment(**more):
    return os.environ | {"PYTHONPATH": os.pathsep.join([str(ROOT), os.environ.get("PYTHONPATH", "")])} | more


def sweep(folder, *arguments):
    command = [sys.executable, "-m", "suspend_cli", "sweep", *map(str, arguments)]
    return subprocess.run(command, capture_output=True, text=True, cwd=folder, env=environment(), timeout=LIMIT)


def written(folder, text):
    (folder / "s.yaml").write_text(text)
    return folder / "s.yaml"


def strains(folder):
    """Strain at the end of each cycle and the moduli of every point by its folder."""
    found = {}
    for path in sorted(Path(folder).glob("*/trajectory.h5")):
        with Run(path.parent) as run:
            cycles = [run.cycle(k)["strain"] for k in range(run.cycles)]
        found[path.parent.name] = (cycles, (path.parent / "moduli.csv").read_text())
    return found


def same(first, second):
    return first[1] == second[1] and all(map(np.array_equal, first[0], second[0]))


@pytest.fixture(scope="module")
def complete(tmp_path_factory):
    """The sweep, run without disturbance."""
    folder = tmp_path_factory.mktemp("complete")
    written(folder, SWEEP)
    done = sweep(folder, "s.yaml")
    assert done.returncode == 0, done.stderr
    return strains(folder / "runs/s")


# --- one point --------------------------------------------------------------------------------------------------------


def test_one_point_by_number_name_and_key(tmp_path, complete):
    """Each way computes that point alone, as the whole sweep does; a complete one is left in silence."""
    points = resolve(read_sweep(written(tmp_path, SWEEP)))
    for which, point in zip((1, points[1].name, points[2].key), points, strict=True):
        done = sweep(tmp_path, "s.yaml", "--point", which)
        assert done.returncode == 0, done.stderr
        found = strains(tmp_path / "runs/s")
        assert point.name in found and same(found[point.name], complete[point.name])
    assert len(found) == 3
    done = sweep(tmp_path, "s.yaml", "--point", 2)
    assert (done.returncode, done.stdout, done.stderr) == (0, "", "")
    assert sweep(tmp_path, "s.yaml").stderr == ""
    assert "3 complete" in sweep(tmp_path, "status", "runs/s").stdout


@pytest.mark.parametrize("which", ["0", "4", "gamma0-0.31", ""])
def test_a_point_that_is_not_there(tmp_path, which):
    """One message with the range, exit code 2, nothing written."""
    written(tmp_path, SWEEP)
    done = sweep(tmp_path, "s.yaml", "--point", which)
    assert done.returncode == 2 and "a number from 1 to 3 or a name" in done.stderr and "Traceback" not in done.stderr
    assert not (tmp_path / "runs").exists()


def test_a_point_that_another_process_computes_is_left_alone(tmp_path):
    """Exit code 130, work being left; nothing is counted as a failure."""
    (point, *_) = resolve(read_sweep(written(tmp_path, SWEEP)))
    folder = tmp_path / "runs/s" / point.name
    folder.mkdir(parents=True)
    lock = PointLock(folder)
    done = sweep(tmp_path, "s.yaml", "--point", "1")
    lock.release()
    assert done.returncode == 130 and f"pid {os.getpid()}" in done.stderr and "nothing was started" in done.stderr
    assert read_record(folder).failures == 0


def test_points_at_once_beside_each_other(tmp_path, complete):
    """Three calls, a point each, one of them twice: all complete, as the sweep computes them."""
    written(tmp_path, SWEEP)
    command = [sys.executable, "-m", "suspend_cli", "sweep", "s.yaml", "-q", "--point"]
    calls = [
        subprocess.Popen([*command, k], cwd=tmp_path, env=environment(), stderr=subprocess.PIPE, text=True)
        for k in ("1", "2", "3", "3")
    ]
    errors = [call.communicate(timeout=LIMIT)[1] for call in calls]
    codes = [call.returncode for call in calls]
    assert codes[:2] == [0, 0] and 0 in codes[2:] and set(codes[2:]) <= {0, 130}, errors
    found = strains(tmp_path / "runs/s")
    assert set(found) == set(complete) and all(same(found[name], complete[name]) for name in found)


def test_options_that_contradict_each_other(tmp_path):
    """Refused with exit code 2 before the file is read."""
    written(tmp_path, SWEEP)
    for options in (["--point", "1", "--dry-run"], ["--script", "x"], ["--point", "1", "--workers", "2"]):
        done = sweep(tmp_path, "s.yaml", *options)
        assert done.returncode == 2 and "Error: --" in done.stderr, options


# --- the script -------------------------------------------------------------------------------------------------------


def emit(folder, *options):
    done = sweep(folder, "s.yaml", "--emit", "slurm-array", "--script", "job.sh", *options)
    assert done.returncode == 0, done.stderr
    assert subprocess.run(["bash", "-n", "job.sh"], cwd=folder, capture_output=True).returncode == 0
    return (folder / "job.sh").read_text()


def slurm(folder):
    """Environment of jobs: an scontrol that writes down what it is asked."""
    (folder / "bin").mkdir(exist_ok=True)
    scontrol = folder / "bin" / "scontrol"
    scontrol.write_text(f'#!/bin/sh\necho "$@" >> "{folder}/requeued"\n')
    scontrol.chmod(0o755)
    path = f"{folder / 'bin'}:{os.environ['PATH']}"
    return environment(PATH=path, SLURM_JOB_ID="17", SLURM_ARRAY_JOB_ID="10")


def test_the_array_computes_the_sweep(tmp_path, complete):
    """One job a point: each exits with 0 and its run is that of the sweep; then there is nothing to submit."""
    written(tmp_path, SWEEP)
    text = emit(tmp_path)
    assert "#SBATCH --array=0-2\n" in text and "--signal=B:USR1@60" in text and "--requeue" in text
    for task in range(3):
        done = subprocess.run(
            ["bash", "job.sh"], cwd=tmp_path, env=slurm(tmp_path) | {"SLURM_ARRAY_TASK_ID": str(task)},
            capture_output=True, text=True, timeout=LIMIT,
        )  # fmt: skip
        assert done.returncode == 0, done.stderr
        assert len(strains(tmp_path / "runs/s")) == task + 1
    found = strains(tmp_path / "runs/s")
    assert set(found) == set(complete) and all(same(found[name], complete[name]) for name in found)
    nothing = sweep(tmp_path, "s.yaml", "--emit", "slurm-array")
    assert nothing.returncode == 0 and nothing.stdout == "" and "nothing to submit" in nothing.stderr


def start_job(folder, **more):
    """A job that has completed a cycle."""
    before = cycles_in(folder)
    process = subprocess.Popen(
        ["bash", "job.sh"], cwd=folder, env=slurm(folder) | {"SLURM_ARRAY_TASK_ID": "1"} | more,
        stderr=subprocess.PIPE, text=True,
    )  # fmt: skip
    wait_until(lambda: cycles_in(folder) > before, process)
    return process


def test_a_job_near_its_end_checkpoints_and_goes_back_to_the_queue(tmp_path):
    """USR1 to the script alone, as Slurm sends it: a checkpoint, `scontrol requeue`, and the next start goes on."""
    written(tmp_path, LONG)
    emit(tmp_path)
    process = start_job(tmp_path)
    process.send_signal(signal.SIGUSR1)
    assert process.wait(timeout=LIMIT) == 0, process.stderr.read()
    assert (tmp_path / "requeued").read_text() == "requeue 17\n"
    (before,) = strains(tmp_path / "runs/s").values()
    process = start_job(tmp_path)
    process.send_signal(signal.SIGUSR1)
    assert process.wait(timeout=LIMIT) == 0, process.stderr.read()
    (after,) = strains(tmp_path / "runs/s").values()
    assert len(after[0]) > len(before[0]) > 0 and after[1].startswith(before[1])
    (record,) = (read_record(path.parent) for path in tmp_path.glob("runs/s/*/point.json"))
    assert record.failures == 0 and not record.running


@pytest.mark.parametrize(("number", "more"), [(signal.SIGTERM, {}), (signal.SIGUSR1, {"SLURM_RESTART_COUNT": "100"})])
def test_a_cancelled_job_is_not_queued_again(tmp_path, number, more):
    """TERM (scancel, preemption), and a job restarted too often: a checkpoint, exit code 130, no requeue."""
    written(tmp_path, LONG)
    emit(tmp_path)
    process = start_job(tmp_path, **more)
    process.send_signal(number)
    assert process.wait(timeout=LIMIT) == 130
    assert not (tmp_path / "requeued").exists()


def test_the_section_shapes_the_script(tmp_path):
    """Queue, account, time, memory, points at a time and directives; prologue before the work."""
    written(tmp_path, SWEEP + CLUSTER)
    text = emit(tmp_path)
    for option in (
        "--array=0-2%64", "--mem=3072M", "--time=36:00:00", "--partition=long", "--account=physics",
        "--constraint=haswell",
    ):  # fmt: skip
        assert f"#SBATCH {option}\n" in text
    assert text.index("export MARK=here") < text.index("points=(")
    head = re.match(r"#!.*\n(#.*\n)+", text).group()  # Slurm reads directives up to the first command
    assert "--constraint=haswell" in head
    assert sweep(tmp_path, "s.yaml", "--emit", "slurm-array", "-q").stdout == text


def test_places_with_spaces_and_percent_signs(tmp_path):
    """The script quotes them for the shell, and for Slurm, to which % is special."""
    folder = tmp_path / "my 50% 'runs'"
    folder.mkdir()
    written(folder, SWEEP)
    text = emit(folder)
    assert "my 50%% 'runs'" in text
    done = subprocess.run(
        ["bash", "job.sh"], cwd=folder, env=slurm(tmp_path) | {"SLURM_ARRAY_TASK_ID": "0"}, timeout=LIMIT,
    )  # fmt: skip
    assert done.returncode == 0 and len(strains(folder / "runs/s")) == 1


@pytest.mark.parametrize(
    ("section", "expected"),
    [
        ("cluster: slurm\n", "must be a section of keys"),
        ("cluster: {workers: 4}\n", "cluster.kind: is missing; must be one of slurm, pbs, sge"),
        ("cluster: {kind: lsf, workers: 4}\n", "s.yaml:7: cluster.kind: found 'lsf'; must be one of slurm, pbs, sge"),
        ("cluster: {kind: slurm}\n", "cluster.workers: is missing"),
        ("cluster: {kind: slurm, workers: 0}\n", "cluster.workers: found 0"),
        ("cluster: {kind: slurm, workers: 4, wallime: 1h}\n", "did you mean walltime"),
        ("cluster: {kind: slurm, workers: 4, walltime: soon}\n", "cluster.walltime: found 'soon'"),
        ("cluster: {kind: slurm, workers: 4, walltime: 60}\n", "at least 5 minutes"),
        ("cluster: {kind: slurm, workers: 4, memory: much}\n", "cluster.memory: found 'much'"),
        ("cluster: {kind: slurm, workers: 4, queue: a, partition: b}\n", "given twice"),
        ("cluster: {kind: slurm, workers: 4, directives: -x}\n", "cluster.directives: found '-x'; must be a list"),
        ('cluster: {kind: slurm, workers: 4, prologue: ["a\\nb"]}\n', "one line of text"),
    ],
)  # fmt: skip
def test_malformed_sections(tmp_path, section, expected):
    """One clear error with its place."""
    with pytest.raises(ConfigurationError, match=re.escape(expected)):
        read_sweep(written(tmp_path, SWEEP + section))


def test_a_point_beyond_the_memory_of_a_job(tmp_path):
    """Refused before a script is written."""
    written(tmp_path, SWEEP + "cluster: {kind: slurm, workers: 4, cores: 100, memory: 100 MB}\n")
    done = sweep(tmp_path, "s.yaml", "--emit", "slurm-array", "--script", "job.sh")
    assert done.returncode == 2 and "need more memory" in done.stderr and not (tmp_path / "job.sh").exists()


def test_wall_times_of_more_than_a_day():
    """Hours go on counting, as Slurm and PBS read them."""
    assert wall_seconds("1-12") == 36 * 3600 and clock(36 * 3600) == "36:00:00" and clock(59.6) == "00:01:00"
