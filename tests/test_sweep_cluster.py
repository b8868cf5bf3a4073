"""Sweeps on other machines: Dask clusters of processes on this one, and a Slurm of a few lines of shell."""

from __future__ import annotations

import json
import math
import os
import re
import shutil
import signal
import subprocess
import sys
import threading
import time
from contextlib import suppress
from importlib.util import find_spec
from pathlib import Path

import numpy as np
import pytest
from waiting import LIMIT, cycles_in, wait_until

from suspend.errors import ConfigurationError
from suspend.io import Run
from suspend.sweep import read_sweep, remote, resolve
from suspend.sweep.cluster_section import ClusterSection
from suspend.sweep.folder import Folder, Record, read_record, write_configuration, write_record
from suspend.sweep.lease import Lease, LeaseWatch
from suspend.sweep.prediction import make_tasks
from suspend.sweep.remote import compute_point
from suspend.sweep.run import prepare

needs_dask = pytest.mark.skipif(
    find_spec("distributed") is None or find_spec("dask_jobqueue") is None, reason="needs Dask: suspend[cluster]"
)
ROOT = Path(__file__).parents[1]
SWEEP = """\
base:
  particles: {number: 8, volume_fraction: 0.2}
  flow: {type: oscillatory, amplitude: 0.3}
  duration: {cycles: 2}
  repulsion: {force: 10.0, debye_length: 0.01}
vary:
  flow.amplitude: [0.3, 0.6, 0.9]
"""
LONG = SWEEP.replace("cycles: 2", "cycles: 40000000")
SECTION = "cluster: {kind: slurm, workers: 2, cores: 2, walltime: 1h}\n"


def written(folder, text):
    (folder / "s.yaml").write_text(text)
    return folder / "s.yaml"


def environment(**more):
    return os.environ | {"PYTHONPATH": os.pathsep.join([str(ROOT), os.environ.get("PYTHONPATH", "")])} | more


def started(folder, *words, **options):
    """A process, with its words in a file of its own."""
    output = open(folder / f"{time.monotonic_ns()}.log", "wb")  # noqa: SIM115 (the process keeps it)
    with output:
        return subprocess.Popen(
            [sys.executable, "-m", *map(str, words)], cwd=folder, env=environment(), stdout=output, stderr=output,
            **options,
        )  # fmt: skip


def sweep(folder, *arguments, **more):
    command = [sys.executable, "-m", "suspend_cli", "sweep", *map(str, arguments)]
    return subprocess.run(command, capture_output=True, text=True, cwd=folder, env=environment(**more), timeout=LIMIT)


def _text(path):
    """What a file holds; nothing where a run that has just begun has not written it yet."""
    return path.read_text() if path.exists() else ""


def contents(folder):
    """Run id, strain at the end of each cycle and moduli of every point by its folder."""
    found = {}
    for path in sorted(Path(folder).glob("*/trajectory.h5")):
        with Run(path.parent) as run:
            cycles = [run.cycle(k)["strain"] for k in range(run.cycles)]
            found[path.parent.name] = (run.run_id, cycles, _text(path.parent / "moduli.csv"))
    return found


def compare(found, expected):
    """Whether all points went bit for bit the same way."""
    assert set(found) == set(expected)
    for name, (_, cycles, moduli) in found.items():
        assert moduli == expected[name][2] and len(cycles) == len(expected[name][1]), name
        assert all(map(np.array_equal, cycles, expected[name][1])), name


class Cluster:
    """A Dask scheduler and workers, processes of this machine."""

    def __init__(self, folder):
        self.folder, self.file = folder, folder / "scheduler.json"
        self.processes = [
            started(folder, "distributed.cli.dask_scheduler", "--host", "127.0.0.1", "--port", "0", "--no-dashboard",
                    "--scheduler-file", self.file)
        ]  # fmt: skip
        self.workers = []
        wait_until(self.file.exists, self.processes[0])

    def start_worker(self, name, *options):
        worker = started(
            self.folder, "distributed.cli.dask_worker", "--scheduler-file", self.file, "--name", name,
            "--nthreads", "1", "--no-dashboard", "--no-nanny", *options,
        )  # fmt: skip
        self.workers.append(worker)
        self.processes.append(worker)
        return worker

    def stop(self):
        for process in self.processes:
            process.kill()
        for process in self.processes:
            process.wait()


@pytest.fixture
def cluster(tmp_path):
    (tmp_path / "cluster").mkdir()
    made = Cluster(tmp_path / "cluster")
    yield made
    made.stop()


def children(pid):
    """Processes that this process started."""
    return [int(word) for path in Path(f"/proc/{pid}/task").glob("*/children") for word in path.read_text().split()]


def suspended_within(worker, cycles):
    """Suspend a point of this worker of which some, but not all cycles are done: its process, None if there is none."""
    for pid in children(worker.pid):
        with suppress(OSError):  # it has ended
            os.kill(pid, signal.SIGSTOP)
            words = Path(f"/proc/{pid}/cmdline").read_bytes().split(b"\0")
            if b"suspend.sweep.worker" in words and 0 < cycles_in(Path(os.fsdecode(words[3]))) < cycles:
                return pid
            os.kill(pid, signal.SIGCONT)
    return None


def forget(folder):
    """Remove what a call has written, for another try."""
    shutil.rmtree(folder / "runs")
    for path in folder.glob("*.log"):
        path.unlink()


# --- a running scheduler ----------------------------------------------------------------------------------------------


@needs_dask
def test_a_killed_worker_changes_nothing(tmp_path, cluster):
    """Two workers, one killed with SIGKILL in the middle of its point: all points complete, bit for bit as a local
    sweep has them, each as one run that went on, none with a failure.
    """
    text = SWEEP.replace("cycles: 2", "cycles: 80")
    for place in ("local", "far"):
        (tmp_path / place).mkdir()
        written(tmp_path / place, text)
    assert sweep(tmp_path / "local", "s.yaml", "-q").returncode == 0
    workers = [cluster.start_worker(name) for name in "ab"]
    while True:  # until a point is caught at work; a call may go by too fast for that
        call = started(tmp_path / "far", "suspend_cli", "sweep", "s.yaml", "--scheduler", cluster.file)
        point = wait_until(lambda call=call: suspended_within(workers[0], 80) or call.poll() is not None)
        if point is not True:
            break
        assert call.returncode == 0
        forget(tmp_path / "far")
    before = {name: content[0] for name, content in contents(tmp_path / "far/runs/s").items()}
    workers[0].kill()
    workers[0].wait()
    os.kill(point, signal.SIGCONT)
    assert call.wait(timeout=LIMIT) == 0, [path.read_text() for path in (tmp_path / "far").glob("*.log")]
    assert not Path(f"/proc/{point}").exists()
    found = contents(tmp_path / "far/runs/s")
    compare(found, contents(tmp_path / "local/runs/s"))
    assert all(found[name][0] == run for name, run in before.items())
    records = [read_record(path.parent) for path in tmp_path.glob("far/runs/s/*/point.json")]
    assert len(records) == 3 and all(record.done and record.failures == 0 for record in records)
    said = "".join(path.read_text() for path in (tmp_path / "far").glob("*.log"))
    assert said.count("was lost") == 1 and said.count(" complete, ") == 4 and "Traceback" not in said
    assert sorted(p.name for p in (tmp_path / "far/runs/s").glob("sweep.*")) == ["sweep.json", "sweep.lock"]


@needs_dask
@pytest.mark.parametrize("how", ["--max-time", "SIGTERM", "scheduler"])
def test_stops_write_checkpoints(tmp_path, cluster, how):
    """A time limit, a signal, a scheduler that is lost: exit code 130, checkpoints of what ran, nothing runs on."""
    written(tmp_path, LONG)
    worker = cluster.start_worker("a", "--nthreads", "2")
    words, limit = ["suspend_cli", "sweep", "s.yaml", "--scheduler", cluster.file], 10.0

    def at_work():
        return len(list(tmp_path.glob("runs/s/*/moduli.csv"))) == 2

    while True:  # until the limit was enough for both to begin
        call = started(tmp_path, *words, *(["--max-time", f"{limit}s"] if how == "--max-time" else []))
        wait_until(lambda call=call: at_work() or call.poll() is not None)
        if at_work():
            break
        assert how == "--max-time" and call.returncode == 130
        forget(tmp_path)
        limit *= 2.0
    points = children(worker.pid)
    if how == "SIGTERM":
        call.send_signal(signal.SIGTERM)
    elif how == "scheduler":
        cluster.processes[0].kill()
    assert call.wait(timeout=LIMIT) == 130
    said = "".join(path.read_text() for path in tmp_path.glob("*.log"))
    reason = {"--max-time": "time limit", "scheduler": "the connection to the scheduler is lost"}.get(how, how)
    assert f"stopped ({reason}): 0 of 3 points complete, 3 left" in said and said.count("Error: ") == 1
    wait_until(lambda: not any(Path(f"/proc/{point}").exists() for point in points))
    runs = contents(tmp_path / "runs/s")
    assert len(runs) == 2 and all(len(cycles) >= 1 for _, cycles, _ in runs.values())
    for path in tmp_path.glob("runs/s/*/point.json"):
        assert read_record(path.parent).failures == 0 and not read_record(path.parent).running
        assert (path.parent / "checkpoint.npz").is_file()


@needs_dask
def test_a_point_that_fails_is_retried_and_reported(tmp_path, cluster):
    """As on one machine: 1 + retries tries, exit code 3, the message of the run."""
    bad = "set: {integrator.max_evaluations: 3, duration.strain: 1}\nretries: 1\n"
    written(tmp_path, SWEEP.replace("[0.3, 0.6, 0.9]", "[0.3]") + bad)
    cluster.start_worker("a")
    done = sweep(tmp_path, "s.yaml", "--scheduler", cluster.file)
    assert done.returncode == 3 and "1 of 1 points failed for good" in done.stderr
    (path,) = tmp_path.glob("runs/s/*/point.json")
    assert read_record(path.parent).failures == 2 and (path.parent / "suspend.log").read_text().count("Error: ") == 2


UNFIT = {
    "lacks suspend": ("import sys\nsys.modules['suspend'] = None\n", r"cannot import suspend .*: install the same"),
    "another version": ("import suspend\nsuspend.__version__ = '0.0.9'\n", r"has suspend 0\.0\.9, this is"),
    "other sources": (
        "import suspend.core.kernel_cache as cache\ncache.source_stamp = lambda: 'x'\n", r"with other sources than",
    ),
    "no shared folder": (
        "import pathlib\n"
        "def own(path, *words, read=pathlib.Path.read_text, **more):\n"
        "    if path.name == 'sweep.lease':\n        raise FileNotFoundError(path)\n"
        "    return read(path, *words, **more)\n"
        "pathlib.Path.read_text = own\n",
        r"does not see \S+/runs/s: put the sweep on a file system that all machines share",
    ),
}  # fmt: skip


@needs_dask
@pytest.mark.parametrize("kind", UNFIT)
def test_unfit_workers(tmp_path, cluster, kind):
    """A worker made unfit by what it loads at its start: a clear error, exit code 2, no point started."""
    preload, expected = UNFIT[kind]
    (tmp_path / "unfit.py").write_text(preload)
    written(tmp_path, SWEEP)
    cluster.start_worker("a", "--preload", tmp_path / "unfit.py")
    done = sweep(tmp_path, "s.yaml", "--scheduler", cluster.file)
    assert done.returncode == 2 and re.search(expected, done.stderr) and "nothing was started" in done.stderr
    assert "Traceback" not in done.stderr and not list(tmp_path.glob("runs/s/*/*.log"))


@needs_dask
def test_a_point_beyond_the_memory_of_all_workers(tmp_path, cluster):
    """Refused before it is started."""
    written(tmp_path, SWEEP.replace("number: 8", "number: 200000"))
    cluster.start_worker("a", "--memory-limit", "800MB")
    done = sweep(tmp_path, "s.yaml", "--scheduler", cluster.file)
    assert done.returncode == 2 and "need more memory than the 0.8 GB" in done.stderr
    assert not list(tmp_path.glob("runs/s/*/*.log"))


@needs_dask
def test_a_scheduler_that_is_not_there(tmp_path):
    """No listener, no scheduler file, a file that is none: a clear error, nothing written."""
    written(tmp_path, SWEEP)
    (tmp_path / "other.json").write_text("{}")
    for place, code, expected in (
        ("tcp://127.0.0.1:9", 2, "no Dask scheduler answers there"),
        ("", 4, "no such scheduler file"),
        ("nowhere.json", 4, "no such scheduler file"),
        ("other.json", 4, "is no scheduler file"),
        ("127.0.0.1:9", 2, "no Dask scheduler answers there"),
        ("what://x:1", 2, "no Dask scheduler answers there"),
    ):
        done = sweep(tmp_path, "s.yaml", "--scheduler", place)
        assert done.returncode == code and expected in done.stderr and "nothing was started" in done.stderr, done.stderr
        assert len(done.stderr.splitlines()) == 1
    assert not (tmp_path / "runs").exists()


@needs_dask
def test_workers_lost_one_after_the_other(tmp_path):
    """Three without progress are no failure, a fourth is; progress in between starts the count anew."""
    from suspend.sweep.cluster import ClusterSweep, Worker
    from suspend.sweep.course import Outcome, Running

    call = prepare(written(tmp_path, SWEEP), tmp_path / "s")
    (task, *_) = make_tasks(call.points, call.places)
    write_configuration(task.folder, task.point.config)
    course = ClusterSweep(Folder(tmp_path / "s"), None, retries=2)
    events = []
    course.event = lambda kind, task, text: events.append((kind, task.record.failures))
    worker = Worker("tcp://x:1", "x", "host", 1, math.inf, math.inf)

    def lose(strain):
        course._ended(Running(task, worker, None, task.record), Outcome(None, Record(strain=strain, running=True)))

    for strain in (0.0, 0.0, 0.5, 0.5, 0.5):
        lose(strain)
    assert events == [("again", 0)] * 5 and len(course.waiting) == 5
    lose(0.5)
    assert events[-1] == ("again", 1) and "lost 4 times" in read_record(task.folder).message


@needs_dask
def test_without_locks_a_lost_point_waits_for_silence(tmp_path, monkeypatch):
    """Where no lock of the folder reaches the workers, a record that still changes is one of a process at work."""
    from suspend.sweep import cluster

    call = prepare(written(tmp_path, SWEEP), tmp_path / "s")
    (task, *_) = make_tasks(call.points, call.places)
    write_configuration(task.folder, task.point.config)
    course = cluster.ClusterSweep(Folder(tmp_path / "s"), None, retries=2)
    course._locks = False
    assert not course._is_busy(task)  # never begun
    now = [100.0]
    monkeypatch.setattr(cluster.time, "monotonic", lambda: now[0])
    for seconds in (0, 50, 100):  # news each time
        now[0] += 50
        write_record(task.folder, Record(running=True, updated=float(seconds)))
        assert course._is_busy(task)
    now[0] += cluster.QUIET - 1
    assert course._is_busy(task)
    now[0] += 2
    assert not course._is_busy(task)
    course._locks = True
    write_record(task.folder, Record(running=True, updated=1.0))
    assert not course._is_busy(task)  # the lock would be held


# --- the lease --------------------------------------------------------------------------------------------------------


def test_the_lease_of_a_call(tmp_path):
    """Seen with its own token only, until it ends, is removed, or falls silent."""
    lease = Lease(tmp_path)
    watch, other = LeaseWatch(tmp_path, lease.token), LeaseWatch(tmp_path, "0" * 16)
    assert watch.is_visible() and watch.is_held() and not other.is_visible() and not other.is_held()
    brief = LeaseWatch(tmp_path, lease.token, expiry=0.3)
    assert brief.is_held()
    time.sleep(0.4)
    assert not brief.is_held() and watch.is_held()
    lease._renewed -= 60
    lease.renew()
    assert brief.is_held()
    lease.end()
    assert not watch.is_held()
    lease.remove()
    assert list(tmp_path.iterdir()) == []
    assert not LeaseWatch(tmp_path, lease.token, expiry=0.0).is_held()


@pytest.mark.parametrize("how", ["ends", "falls silent"])
def test_points_stop_when_their_call_does(tmp_path, monkeypatch, how):
    """Without Dask: the process of a point ends with a checkpoint once the lease ends or is renewed no more."""
    (point, *_) = resolve(read_sweep(written(tmp_path, LONG)))
    folder = tmp_path / "s" / point.name
    write_configuration(folder, point.config)
    lease, answers, watches = Lease(tmp_path / "s"), [], []

    def watch(*words):
        watches.append(LeaseWatch(*words))
        return watches[-1]

    monkeypatch.setattr(remote, "LeaseWatch", watch)
    words = (str(folder), str(tmp_path / "s"), str(tmp_path), lease.token, None, LIMIT)
    thread = threading.Thread(target=lambda: answers.append(compute_point(*words)))
    thread.start()
    wait_until(lambda: cycles_in(folder) or not thread.is_alive())
    lease._renewed -= 60
    lease.renew()
    assert watches[0].is_held() and thread.is_alive()
    if how == "ends":
        lease.end()
    else:
        watches[0].expiry = 0.5
    thread.join(timeout=LIMIT)
    (answer,) = answers
    assert answer["code"] == 130 and answer["record"]["failures"] == 0 and answer["record"]["strain"] > 0
    assert (folder / "checkpoint.npz").is_file()
    assert compute_point(*words[:3], "another", None, 1.0)["code"] == 130  # of a call that is gone
    lease.remove()


def test_a_worker_at_the_end_of_its_job_starts_nothing(tmp_path, monkeypatch):
    """What the job script exports says when points stop."""
    (point, *_) = resolve(read_sweep(written(tmp_path, LONG)))
    folder = tmp_path / "s" / point.name
    write_configuration(folder, point.config)
    lease = Lease(tmp_path / "s")
    words = (str(folder), str(tmp_path / "s"), str(tmp_path), lease.token)
    monkeypatch.setenv("SUSPEND_JOB_END", str(time.time() - 1))
    assert compute_point(*words)["code"] == 130 and not (folder / "suspend.log").exists()
    for seconds in (2, 20, 200):  # none may be left when it is looked at
        monkeypatch.setenv("SUSPEND_JOB_END", str(time.time() + seconds))
        assert compute_point(*words)["code"] == 130
        if (folder / "suspend.log").exists():
            break
    assert "time limit" in (folder / "suspend.log").read_text()
    lease.remove()


# --- batch systems ----------------------------------------------------------------------------------------------------


SCRIPTS = {
    "slurm": ["#SBATCH -p long", "#SBATCH -A physics", "#SBATCH --cpus-per-task=8", "#SBATCH --mem=15G",
              "#SBATCH -t 36:00:00", "#SBATCH --constraint=x", "#SBATCH -n 1"],
    "pbs": ["#PBS -q long", "#PBS -A physics", "#PBS -l select=1:ncpus=8:mem=15GB", "#PBS -l walltime=36:00:00",
            "#PBS --constraint=x"],
    "sge": ["#$ -q long", "#$ -P physics", "#$ -l h_rt=36:00:00", "#$ --constraint=x"],
}  # fmt: skip


@needs_dask
@pytest.mark.parametrize("kind", SCRIPTS)
def test_job_scripts(tmp_path, kind):
    """Every key of the section is in the script, in the words of each system's manual; shell can read it."""
    from suspend.sweep.batch_jobs import make_cluster

    section = ClusterSection(
        kind, 64, 8, 16e9, 36 * 3600.0, "long", "physics", ("--constraint=x",), ("module load x",), "lo"
    )
    made = make_cluster(section, "a sweep", tmp_path / "jobs", [])
    script = made.job_script()
    made.close()
    lines = script.splitlines()
    assert not [line for line in SCRIPTS[kind] if line not in lines], script
    head = re.match(r"#!.*\n\n?(#.*\n)+", script).group()  # directives are read up to the first command
    assert all(line in head for line in SCRIPTS[kind])
    assert "module load x" in lines and str(tmp_path / "jobs") in head and "suspend-a_sweep"[:15] in head
    export = lines.index("export SUSPEND_JOB_END=$(( $(date +%s) + 129510 ))")
    (command,) = (number for number, line in enumerate(lines) if "distributed.cli.dask_worker" in line)
    assert lines.index("module load x") < export < command
    for words in ("--nthreads 8", "--memory-limit 14.90GiB", "--interface lo", "--lifetime 129570s", sys.executable):
        assert words in lines[command]
    assert "--nworkers" not in lines[command]
    subprocess.run(["bash", "-n"], input=script, text=True, check=True)


@needs_dask
def test_sge_is_asked_for_cores_by_a_parallel_environment(tmp_path, monkeypatch):
    """Its name is the site's: several cores without it are an error."""
    from suspend.sweep.batch_jobs import check_submission

    slurm(tmp_path, "qsub")
    monkeypatch.setenv("PATH", f"{tmp_path / 'bin'}:{os.environ['PATH']}")
    with pytest.raises(ConfigurationError, match=r'directives: \["-pe NAME 8"\]'):
        check_submission(ClusterSection("sge", 64, 8))
    check_submission(ClusterSection("sge", 64, 8, directives=("-pe smp 8",)))
    check_submission(ClusterSection("sge", 64, 1))


SBATCH = """\
#!/bin/bash
# Runs the script at once, in a session of its own, and says so as Slurm does.
cp "$1" "@/job-$$.sh"
setsid bash "@/job-$$.sh" > "@/job-$$.out" 2>&1 < /dev/null &
echo $! > "@/job-$$.pid"
echo "Submitted batch job $$"
"""
SCANCEL = """\
#!/bin/bash
echo "$1" >> "@/cancelled"
kill -TERM -- "-$(cat "@/job-$1.pid")"
"""


def slurm(folder, name="sbatch", script=SBATCH):
    """The PATH with a batch system of a few lines of shell."""
    (folder / "bin").mkdir(exist_ok=True)
    for command, text in ((name, script), ("scancel", SCANCEL)):
        (folder / "bin" / command).write_text(text.replace("@", str(folder)))
        (folder / "bin" / command).chmod(0o755)
    return f"{folder / 'bin'}:{os.environ['PATH']}"


@needs_dask
def test_jobs_of_a_batch_system_compute_the_sweep(tmp_path):
    """The section makes jobs, their workers compute all points as a local sweep does, and the jobs are given back."""
    for place in ("local", "far"):
        (tmp_path / place).mkdir()
        written(tmp_path / place, SWEEP + SECTION)
    assert sweep(tmp_path / "local", "s.yaml", "-q", "--local").returncode == 0
    done = sweep(tmp_path / "far", "s.yaml", PATH=slurm(tmp_path))
    assert done.returncode == 0, done.stderr + "".join(path.read_text() for path in tmp_path.glob("job-*.out"))
    compare(contents(tmp_path / "far/runs/s"), contents(tmp_path / "local/runs/s"))
    (job,) = tmp_path.glob("job-*.pid")  # 2 points at a time, 2 cores a job
    assert (tmp_path / "cancelled").read_text().split() == [job.stem.removeprefix("job-")]
    wait_until(lambda: not alive_in_session(int(job.read_text())))
    again = sweep(tmp_path / "far", "s.yaml", PATH=slurm(tmp_path))
    assert (again.returncode, again.stdout, again.stderr) == (0, "", "")


def alive_in_session(leader):
    return subprocess.run(["pgrep", "-s", str(leader)], capture_output=True).returncode == 0


@needs_dask
def test_a_batch_system_that_takes_no_job(tmp_path):
    """Its words, exit code 2, and no waiting for workers that never come."""
    written(tmp_path, SWEEP + SECTION)
    refusing = "#!/bin/bash\necho 'sbatch: error: Invalid account' >&2\nexit 1\n"
    done = sweep(tmp_path, "s.yaml", PATH=slurm(tmp_path, script=refusing))
    assert done.returncode == 2 and "sbatch takes no job of this sweep: sbatch: error: Invalid account" in done.stderr
    assert done.stderr.count("Error") == 1 and "Traceback" not in done.stderr


@needs_dask
def test_no_batch_system_here(tmp_path):
    """The section on a machine without sbatch: an error that says --local, nothing written; --local computes here."""
    written(tmp_path, SWEEP + SECTION)
    done = sweep(tmp_path, "s.yaml", PATH="/nowhere")
    assert done.returncode == 2 and "sbatch is not on the PATH" in done.stderr and "--local" in done.stderr
    assert not (tmp_path / "runs").exists()
    plan = sweep(tmp_path, "s.yaml", "--dry-run").stdout
    assert "2 core(s) of slurm jobs" in plan
    assert "slurm" not in sweep(tmp_path, "s.yaml", "--dry-run", "--local").stdout


# --- without Dask -----------------------------------------------------------------------------------------------------


def python(folder, text):
    return subprocess.run(
        [sys.executable, "-c", text], capture_output=True, text=True, cwd=folder, env=environment(), timeout=LIMIT
    )


def test_without_dask_the_extra_is_named(tmp_path):
    """As where it is not installed: an error that says what to install, for an address and for a section."""
    written(tmp_path, SWEEP + SECTION)
    hidden = "import sys\nsys.modules.update(dict.fromkeys(['dask', 'distributed', 'dask_jobqueue']))\n"
    for more in ([], ["--scheduler", "tcp://127.0.0.1:9"]):
        call = f"{hidden}from suspend_cli.main import main\nmain(['sweep', 's.yaml', *{more}])\n"
        done = python(tmp_path, call)
        assert done.returncode == 2 and "pip install 'suspend[cluster]'" in done.stderr and len(done.stderr) < 300
    assert not (tmp_path / "runs").exists()


def test_a_local_sweep_imports_no_dask(tmp_path):
    """Neither the call nor the processes of its points do."""
    written(tmp_path, SWEEP.replace("[0.3, 0.6, 0.9]", "[0.3]"))
    found = "json.dumps([n for n in sys.modules if n.split('.')[0] in ('dask', 'distributed', 'dask_jobqueue')])"
    call = "import json, sys\nfrom suspend_cli.main import cli\ncli.main(['sweep', 's.yaml'], standalone_mode=False)\n"
    done = python(tmp_path, f"{call}print({found})")
    assert done.returncode == 0 and json.loads(done.stdout) == [], done.stderr
    worker = "import json, sys\nimport suspend.sweep.worker, suspend.simulation, suspend.sweep.starts\n"
    assert json.loads(python(tmp_path, f"{worker}print({found})").stdout) == []


def test_options_that_contradict_each_other(tmp_path):
    """Refused with exit code 2 before anything is written."""
    written(tmp_path, SWEEP + SECTION)
    place = ["--scheduler", "tcp://127.0.0.1:9"]
    for options in (
        [*place, "--local"], [*place, "--workers", "2"], [*place, "--point", "1"], [*place, "--dry-run"],
        ["--workers", "2"],
    ):  # fmt: skip
        done = sweep(tmp_path, "s.yaml", *options)
        assert done.returncode == 2 and "Error: " in done.stderr and "--" in done.stderr, options
    assert not (tmp_path / "runs").exists()
