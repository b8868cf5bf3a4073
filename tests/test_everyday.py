"""What jobs, scripts and notebooks do: forks, threads, logs, unset variables, a scheduler's times."""

from __future__ import annotations

import importlib.util
import io
import math
import os
import subprocess
import sys
import threading
from types import SimpleNamespace

import pytest
from waiting import LIMIT

from suspend.io import Run
from suspend.io.h5md import empty_file
from suspend.io.table import CycleTable
from suspend_cli.options import FEATURES, DurationType
from suspend_cli.progress import Progress

FORK = """
import multiprocessing, sys
from suspend.config import from_dict
from suspend.simulation import run
config = from_dict({"particles": {"number": 2001, "volume_fraction": 0.01}, "flow": {"type": "oscillatory",
    "amplitude": 0.01}, "duration": {"cycles": 1}, "output": {"samples_per_cycle": 24}})
import numba
from suspend.core.jit import parallel_kernel
@parallel_kernel
def f(x):
    for i in numba.prange(len(x)):
        x[i] = i
import numpy as np
f(np.zeros(9))
def child(folder):
    try:
        run(config, folder)
    except Exception as error:
        return type(error).__name__ + ": " + str(error)
with multiprocessing.get_context("fork").Pool(1) as pool:
    print(pool.apply(child, (sys.argv[1],)))
"""


def test_a_fork_after_a_computation_is_an_error(tmp_path):
    """In the child the kernels would compute nothing: an error that says spawn."""
    (tmp_path / "f.py").write_text(FORK)
    command = [sys.executable, str(tmp_path / "f.py"), str(tmp_path / "r")]
    done = subprocess.run(command, capture_output=True, text=True, timeout=LIMIT)
    assert done.stdout.startswith("SuspendError") and "spawn" in done.stdout, done.stderr


def test_threads_make_their_files_side_by_side():
    """Empty trajectories made by several threads at once do not clash."""
    failed = []

    def make():
        try:
            for _ in range(30):
                empty_file("a: 1\n", {"L": 3.0}, "id")
        except Exception as error:
            failed.append(error)

    threads = [threading.Thread(target=make) for _ in range(8)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert not failed, failed[0]


def logged(fractions, seconds, quiet=False):
    """Lines printed for states `seconds` apart on a stream that is no terminal."""
    stream, now = io.StringIO(), [0.0]
    progress = Progress(stream, quiet=quiet, clock=lambda: now[0])
    for fraction in fractions:
        for compiling in (True, False):
            progress.update(
                SimpleNamespace(
                    cycle=int(100 * fraction), cycles=100, strain=fraction, total_strain=1.0, fraction=fraction,
                    minimum_gap=1e-3, iterations=1, evaluations=1, compiling=compiling, initial_fraction=0.0,
                )
            )
        now[0] += seconds
    return stream.getvalue().splitlines()


def test_a_job_log_shows_how_far_it_is():
    """A fast run: one line a tenth; a slow one: one a minute; compiling once; quiet nothing."""
    steps = [k / 1000 for k in range(1001)]
    fast = logged(steps, 0.01)
    assert len(fast) == 11 and fast[0].startswith("compiling")
    assert fast[1].startswith("cycle 10/100, 10 %, strain 0.1/1, 0:0") and "left, smallest gap 1.0e-03 a" in fast[1]
    slow = logged([k / 1e6 for k in range(1000)], 1.0)
    assert len(slow) == 1 + 999 // 60
    assert logged(steps, 0.01, quiet=True) == []


@pytest.mark.parametrize(
    ("text", "seconds"),
    [("00:10:00", 600), ("1:30", 90), ("1-12:00:00", 129600), ("2-03", 183600), ("0-00:05", 300), ("90", 90)],
)
def test_times_of_schedulers(text, seconds):
    """HH:MM:SS, MM:SS, D-HH:MM:SS, D-HH, D-HH:MM; a bare number stays seconds."""
    assert DurationType().convert(text, None, None) == seconds


def called(folder, *arguments, **environment):
    """The command line in a process of its own."""
    command = [sys.executable, "-m", "suspend_cli", *arguments]
    return subprocess.run(
        command, capture_output=True, text=True, cwd=folder, env={**os.environ, **environment}
    )


def test_empty_names_are_refused(tmp_path):
    """An unset variable is not the current folder."""
    for arguments in (("run", "a.yaml", "-o", ""), ("analyze", ""), ("analyze", ".", "--csv", ""), ("report", "")):
        done = called(tmp_path, *arguments, PYTHONPATH=os.environ.get("PYTHONPATH", os.getcwd()))
        assert done.returncode == 2 and "empty name" in done.stderr, done.stderr
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("value", ["0", "-1", "x", "2.5"])
def test_a_number_of_threads_numba_does_not_take(value):
    """NUMBA_NUM_THREADS: a message with the variable, no traceback."""
    done = called(".", "analyze", "nowhere", NUMBA_NUM_THREADS=value)
    assert done.returncode == 2 and "NUMBA_NUM_THREADS" in done.stderr and "Traceback" not in done.stderr


def test_what_does_not_exist_is_an_empty_cell():
    """eta_r of a quiescent block: no number, no NaN."""
    table = CycleTable("v.csv", lambda record: {"eta_r[-]": math.nan, "N1": 2.0})
    assert table.line({"index": 3})[1] == "3,,2.0\n"


@pytest.mark.parametrize("closed", ["<&-", ">&-", "2>&-", "<&- >&- 2>&-"])
def test_commands_need_no_stream(tmp_path, closed):
    """A daemon's process may have none: results are in the files, errors in the exit code, files hold no messages."""
    (tmp_path / "c.yaml").write_text(
        "{particles: {number: 4, volume_fraction: 0.1}, flow: {type: steady}, duration: {strain: 1.0}}"
    )
    python = f"{sys.executable} -m suspend_cli"

    def shell(command):
        return subprocess.run(["sh", "-c", f"{python} {command} {closed}"], cwd=tmp_path, timeout=LIMIT).returncode

    assert shell("run c.yaml -o r") == 0
    assert shell("analyze r --csv t.csv") == 0
    assert (tmp_path / "t.csv").read_text().startswith("cycle,")
    assert shell("info r") == 0
    assert shell("analyze nowhere") == 4
    with Run(tmp_path / "r") as stored:
        assert stored.finished


@pytest.mark.parametrize("layer", ["nonsense", "tbb"])
def test_a_threading_layer_that_is_not_there(tmp_path, layer):
    """One thread needs none and computes; more say which variable is wrong, exit code 2."""
    if layer == "tbb" and importlib.util.find_spec("tbb"):
        pytest.skip("TBB is installed")
    (tmp_path / "c.yaml").write_text(
        "{particles: {number: 2000, volume_fraction: 0.001}, flow: {type: steady}, duration: {strain: 0.01},"
        " output: {samples_per_cycle: 2}}"
    )
    command = [sys.executable, "-m", "suspend_cli", "run", "c.yaml", "--set", "lubrication.enabled=false"]
    environment = os.environ | {"NUMBA_THREADING_LAYER": layer, "NUMBA_NUM_THREADS": "2"}
    for threads, code in (("1", 0), ("2", 2)):
        done = subprocess.run(
            [*command, "-o", f"r{threads}", "--threads", threads],
            cwd=tmp_path, env=environment, capture_output=True, text=True, timeout=LIMIT,
        )  # fmt: skip
        assert done.returncode == code, done.stderr
        assert "Traceback" not in done.stderr
    assert f"NUMBA_THREADING_LAYER={layer}" in done.stderr


def test_processor_features_are_names_with_signs():
    """What LLVM takes passes; this pattern is all that stands before it."""
    for good in ("+avx2", "+avx2,-avx512f", "+sse4.1"):
        assert FEATURES.fullmatch(good)
    assert not FEATURES.fullmatch("")
