"""`suspend sweep`: the file, the points, calls that are stopped, killed, repeated, at once; failures; status."""

from __future__ import annotations

import csv
import errno
import json
import os
import pty
import random
import re
import resource
import select
import shutil
import signal
import subprocess
import sys
import time
from contextlib import suppress
from pathlib import Path

import h5py
import numpy as np
import pytest
from waiting import LIMIT, cycles_in, wait_until

from suspend.analysis.summary import analyze
from suspend.config import loads
from suspend.errors import ConfigurationError, StorageError
from suspend.initial import prepare_initial
from suspend.io import Run
from suspend.io.files import holder, is_disk_trouble
from suspend.sweep import read_sweep, resolve
from suspend.sweep.folder import Folder, PointLock, SweepLock, is_complete, read_record
from suspend.sweep.machine import cores
from suspend.sweep.prediction import wall_time
from suspend.sweep.run import prepare
from suspend.sweep.starts import shared_start, start_key

ROOT = Path(__file__).parents[1]
BASE = """\
base:
  particles: {number: 8, volume_fraction: 0.2}
  flow: {type: oscillatory, amplitude: 0.3}
  duration: {cycles: 2}
  repulsion: {force: 10.0, debye_length: 0.01}
"""
FOUR = BASE + """\
vary:
  particles.volume_fraction: [0.1, 0.2]
  flow.amplitude: [0.3, 0.6]
"""
FOREVER = "cycles: 40000000"


def written(folder, text, name="s.yaml"):
    (folder / name).write_text(text)
    return folder / name


def points_of(folder, text):
    return resolve(read_sweep(written(folder, text)))


def command(*arguments):
    return [sys.executable, "-m", "suspend_cli", "sweep", *map(str, arguments)]


def environment():
    return os.environ | {"PYTHONPATH": os.pathsep.join([str(ROOT), os.environ.get("PYTHONPATH", "")])}


def sweep(folder, *arguments, **options):
    return subprocess.run(
        command(*arguments), capture_output=True, text=True, cwd=folder, env=environment(), timeout=LIMIT, **options
    )


def contents(folder):
    """Positions, stresses and moduli of every point by its folder: all that a repetition would change."""
    found = {}
    for path in sorted(p.parent for p in Path(folder).glob("*/trajectory.h5")):
        with Run(path) as run:
            cycles = [run.cycle(k) for k in range(run.cycles)]
            moduli = (path / "moduli.csv").read_text() if cycles else ""
            found[path.name] = (run.run_id, run.cycles, [c["strain"] for c in cycles], moduli)
    return found


def same(first, second):
    """Whether two runs went bit for bit the same way."""
    return first[1] == second[1] and first[3] == second[3] and all(map(np.array_equal, first[2], second[2]))


# --- the file ---------------------------------------------------------------------------------------------------------


def test_crossed_zipped_ranges_seeds_and_blocks(tmp_path):
    """The points are those counted by hand: 2 x 3 crossed with 2 zipped, 2 seeds; a second block with one seed."""
    points = points_of(
        tmp_path,
        BASE
        + """\
vary:
  particles.volume_fraction: [0.1, 0.2]
  flow.amplitude: {from: 0.1, to: 1.6, steps: 3, spacing: log}
zip:
  - particles.number: [8, 12]
    output.samples_per_cycle: [32, 64]
runs:
  - {set: {far_field: self}, seeds: 2}
  - {set: {far_field: ewald, tolerance: 1e-3}, seeds: [7]}
""",
    )
    assert len(points) == 2 * 3 * 2 * 2 + 2 * 3 * 2
    assert {p.config.flow.amplitude for p in points} == {0.1, 0.4, 1.6}
    pairs = {(p.config.particles.number, p.config.output.samples_per_cycle) for p in points}
    assert pairs == {(8, 32), (12, 64)}
    assert {(p.config.far_field, p.seed) for p in points} == {("self", 1), ("self", 2), ("ewald", 7)}
    assert len({p.name for p in points}) == len({p.key for p in points}) == len(points)
    assert "phi-0.1" in points[0].name and "gamma0-0.1" in points[0].name and "seed-1" in points[0].name


def test_names_tell_keys_of_one_last_word_apart(tmp_path):
    """tolerance and solver.tolerance, both varied, and a section switched off."""
    varied = "{tolerance: [1e-3], solver.tolerance: [1e-6], repulsion: [null, {force: 1, debye_length: 0.1}]}"
    text = f"{BASE}vary: {varied}\n"
    names = [point.name for point in points_of(tmp_path, text)]
    assert names[0].startswith("tolerance-0.001_solver-tolerance-1e-06_repulsion-off_") and len(set(names)) == 2


def test_a_linear_range_of_integers(tmp_path):
    """Ends included, whole numbers for a key that is one."""
    points = points_of(tmp_path, BASE + "vary: {particles.number: {from: 8, to: 11, steps: 4}}\n")
    assert [p.config.particles.number for p in points] == [8, 9, 10, 11]


def test_the_duration_is_no_part_of_the_key(tmp_path):
    """A longer duration goes on with the same run; any other change is another one."""
    (first,) = points_of(tmp_path, BASE + "vary: {flow.amplitude: [0.3]}\n")
    (longer,) = points_of(tmp_path, BASE + "set: {duration.strain: 9}\nvary: {flow.amplitude: [0.3]}\n")
    (other,) = points_of(tmp_path, BASE + "set: {tolerance: 1e-4}\nvary: {flow.amplitude: [0.3]}\n")
    assert first.name == longer.name and longer.config.duration.strain == 9
    assert other.key != first.key


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("", "is no sweep file"),
        ("vary: {flow.amplitude: [1]}\n", "base: is missing"),
        ("base: nowhere.yaml\nvary: {flow.amplitude: [1]}\n", r"s.yaml:1: base: .*nowhere.yaml: no such file"),
        (BASE + "vari: {flow.amplitude: [1]}\n", r"s.yaml:6: vari: unknown key; did you mean vary"),
        (BASE + "flow.amplitude: [1]\n", r"goes into base, set \(one value\) or vary"),
        (BASE + "vary: {flow.amplitude: 0.3}\n", r"vary.flow.amplitude: found 0.3; must be a list or a range"),
        (BASE + "vary: {flow.amplitude: []}\n", "empty list"),
        (BASE + "vary: {flow.amplitud: [0.3]}\n", r"s.yaml:6: flow.amplitud: unknown key; did you mean amplitude"),
        (BASE + "vary: {flow.amplitude: {from: 0, to: 1, steps: 3, spacing: log}}\n", "both ends must be > 0"),
        (BASE + "vary: {flow.amplitude: {from: 0.1, to: 1}}\n", "steps is missing"),
        (BASE + "vary: {flow.amplitude: {from: 0.1, to: 1, steps: 1}}\n", "steps: found 1; must be an int"),
        (BASE + "zip: [{flow.amplitude: [1, 2], particles.number: [8]}]\n", "need equally many values"),
        (BASE + "set: {flow.amplitude: 1}\nvary: {seed: [1, 2]}\n", "give seeds"),
        (BASE + "seeds: 0\n", "seeds: found 0"),
        (BASE + "seeds: [1, 1]\n", "holds a seed twice"),
        (BASE + "runs: {seeds: 3}\n", "must be a list of blocks"),
        (BASE + "runs: [{workers: 3}]\n", "belongs to the top level"),
        (BASE + "workers: 0\n", "workers: found 0"),
        (BASE + "memory: plenty\n", "must be a size such as 8 GB"),
        (BASE + "runs:\n  - vary: {duration.cycles: [1, 2]}\n", "differ in duration only"),
        (BASE + "vary: {flow.amplitude: [1\n", "not valid YAML"),
    ],
)  # fmt: skip
def test_malformed_files(tmp_path, text, expected):
    """One clear error with place and remedy before anything is started."""
    with pytest.raises(ConfigurationError, match=expected):
        points_of(tmp_path, text)


def test_impossible_points_are_all_named_and_nothing_is_started(tmp_path):
    """A volume fraction and an amplitude that cannot be: places in the sweep file, the points, exit code 2."""
    written(tmp_path, BASE + "vary:\n  particles.volume_fraction: [0.2, 0.9]\n  flow.amplitude:\n    - 0.3\n    - -1\n")
    done = sweep(tmp_path, "s.yaml")
    assert done.returncode == 2 and "Traceback" not in done.stderr
    assert "3 of 4 points are impossible, nothing was started" in done.stderr
    assert "s.yaml:7: particles.volume_fraction: found 0.9" in done.stderr
    assert "flow.amplitude: found -1" in done.stderr and "phi-0.2_gamma0--1" in done.stderr
    assert not (tmp_path / "runs").exists()


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        (BASE.replace("number: 8", "initial: gone/run, number: 8") + "seeds: 2\n", "gone/run"),
        (BASE + "memory: 1 MB\n", "need more memory than the 0.001 GB"),
    ],
)
def test_missing_folders_and_too_large_points_start_nothing(tmp_path, text, expected):
    """Found before the first run: a start that is not there, a point beyond the memory."""
    written(tmp_path, text)
    done = sweep(tmp_path, "s.yaml")
    assert done.returncode in (2, 4) and expected in done.stderr and "nothing was started" in done.stderr
    assert not list(tmp_path.glob("runs/s/*/trajectory.h5"))


def test_the_shipped_phase_diagram():
    """169 points: 3 volume fractions x 13 amplitudes, near field with three seeds, far field with one, preset."""
    points = resolve(read_sweep(ROOT / "configs" / "phase_diagram.yaml"))
    fields = [p.config.far_field for p in points]
    assert [fields.count(name) for name in ("self", "ewald", "identity")] == [117, 39, 13]
    assert {p.config.particles.number for p in points} == {500}
    assert {p.config.duration.strain for p in points} == {256}
    assert len({start_key(p.config) for p in points}) == 9  # one a volume fraction and seed


# --- starts, predictions ----------------------------------------------------------------------------------------------


AMPLITUDES = "vary: {flow.amplitude: [0.3, 3.0]}\nseeds: 2\n"


@pytest.mark.parametrize("kind", ["equilibrium", "quenched"])
def test_one_start_for_all_amplitudes(tmp_path, monkeypatch, kind):
    """The start depends on number, volume fraction, gap and seed only, is made once, and read back bit for bit."""
    configs = [p.config for p in points_of(tmp_path, BASE + f"set: {{particles.initial: {kind}}}\n{AMPLITUDES}")]
    made = [prepare_initial(config) for config in configs]
    by_seed = {}
    for config, start in zip(configs, made, strict=True):
        by_seed.setdefault(config.seed, []).append(start.positions)
    assert all(np.array_equal(a, b) for a, b in by_seed.values())
    assert not np.array_equal(by_seed[1][0], by_seed[2][0])
    first = shared_start(configs[0], tmp_path)
    monkeypatch.setattr("suspend.sweep.starts.prepare_initial", lambda *_: pytest.fail("made twice"))
    for config, start in zip(configs, made, strict=True):
        if config.seed == first_seed(configs):
            again = shared_start(config, tmp_path)
            assert np.array_equal(again.positions, first.positions) and np.array_equal(start.positions, first.positions)
            assert again.length == start.length and again.closest_pair == start.closest_pair
            assert type(again.packing) is type(start.packing)


def first_seed(configs):
    return configs[0].seed


def test_longest_first_packs_the_cores():
    """5, 4, 3, 3, 3 on two cores: 5 + 3 and 4 + 3 + 3 with the longest first."""
    assert wall_time([3, 3, 3, 4, 5], 2) == 10
    assert wall_time([1], 4) == 1


# --- calls ------------------------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def complete(tmp_path_factory):
    """A sweep of four points, run undisturbed; what is timed asks for it, too: the kernels are compiled then."""
    folder = tmp_path_factory.mktemp("complete")
    written(folder, FOUR)
    done = sweep(folder, "s.yaml")
    assert done.returncode == 0, done.stderr
    return folder


def test_a_call_completes_and_the_next_has_nothing_to_do(complete):
    """All points complete, a log each; the second call prints nothing, exits with 0 and changes no run."""
    before = contents(complete / "runs/s")
    assert len(before) == 4 and all(cycles == 2 for _, cycles, *_ in before.values())
    for name in before:
        assert "2 cycles" in (complete / "runs/s" / name / "suspend.log").read_text()
    again = sweep(complete, "s.yaml")
    assert (again.returncode, again.stdout, again.stderr) == (0, "", "")
    assert {n: c[0] for n, c in contents(complete / "runs/s").items()} == {n: c[0] for n, c in before.items()}


def test_status_of_folder_and_file(complete):
    """The same from both, as a table and as JSON."""
    found = json.loads(sweep(complete, "status", "runs/s", "--json").stdout)
    assert found["counts"]["complete"] == 4 and len(found["points"]) == 4
    assert found["points"][0]["parameters"] == {"particles.volume_fraction": 0.1, "flow.amplitude": 0.3}
    same_points = json.loads(sweep(complete, "status", "s.yaml", "--json").stdout)["points"]
    assert same_points == found["points"]
    table = sweep(complete, "status", "runs/s").stdout
    assert "4 complete" in table and "4.8/4.8" in table
    nothing = sweep(complete, "status", complete)
    assert nothing.returncode == 4 and "holds no sweep" in nothing.stderr


def test_collect_writes_one_row_a_point(tmp_path, complete):
    """Parameters, state and what `analyze` says of the run, as CSV and HDF5; kept analyses give the same again."""
    assert sweep(complete, "collect", "runs/s", "-o", tmp_path / "t.csv").returncode == 0
    rows = list(csv.DictReader((tmp_path / "t.csv").open()))
    assert [row["point"] for row in rows] == [p.name for p in resolve(read_sweep(complete / "s.yaml"))]
    for row in rows:
        averages = analyze(complete / "runs/s" / row["point"]).averages()
        assert float(row["eta_r_prime[-]"]) == pytest.approx(averages["eta_r_prime[-]"]["mean"], rel=1e-9)
        assert row["flow.amplitude"] in row["point"] and row["state"] == "complete" and row["seed"] == "1"
        assert float(row["minus_N2_nu0[eta0]"]) == pytest.approx(-averages["N2_nu0[eta0]"]["mean"], rel=1e-6, abs=1e-9)
        assert float(row["run_time[s]"]) > 0 and float(row["position_error[a]"]) > 0
        assert float(row["structure_smallest_gap[a]"]) > 0
    again = sweep(complete, "collect", "s.yaml")
    assert again.stdout == (tmp_path / "t.csv").read_text() and again.stderr == ""
    assert sweep(complete, "collect", "runs/s", "-q", "-o", tmp_path / "t.h5").returncode == 0
    with h5py.File(tmp_path / "t.h5") as file:
        np.testing.assert_allclose(file["eta_r_prime"], [float(row["eta_r_prime[-]"]) for row in rows], rtol=1e-9)
        assert file["state"].asstr()[0] == "complete"
    refused = sweep(complete, "collect", "runs/s", "-o", tmp_path / "t.txt")
    assert refused.returncode == 2 and ".csv or .h5" in refused.stderr


def test_collect_has_a_row_for_points_that_have_not_begun(tmp_path, complete):
    """Their parameters and state, nothing else."""
    shutil.copytree(complete, tmp_path, dirs_exist_ok=True)
    written(tmp_path, FOUR.replace("[0.3, 0.6]", "[0.3, 0.6, 0.9]"))
    rows = list(csv.DictReader(sweep(tmp_path, "collect", "s.yaml").stdout.splitlines()))
    waiting = [row for row in rows if row["state"] == "waiting"]
    assert len(rows) == 6 and [row["flow.amplitude"] for row in waiting] == ["0.9", "0.9"]
    assert all(row["eta_r_prime[-]"] == "" for row in waiting)


def test_dry_run_prints_predictions_and_starts_nothing(tmp_path, complete):
    """Time and memory of each point before, what was measured after."""
    written(tmp_path, FOUR)
    done = sweep(tmp_path, "s.yaml", "--dry-run")
    assert done.returncode == 0 and "4 points, 0 complete" in done.stdout and "predicted" in done.stdout
    assert not (tmp_path / "runs").exists()
    assert "times what was predicted" in sweep(complete, "s.yaml", "--dry-run").stdout


def test_a_changed_file_keeps_what_belongs_and_says_what_does_not(tmp_path, complete):
    """One amplitude goes, the name of the other's folder changes with what varies: its run stays, untouched."""
    shutil.copytree(complete, tmp_path, dirs_exist_ok=True)
    before = contents(tmp_path / "runs/s")
    changed = BASE.replace("amplitude: 0.3", "amplitude: 0.6")
    changed += "vary: {particles.volume_fraction: [0.1, 0.2]}\nseeds: 1\n"
    written(tmp_path, changed)
    done = sweep(tmp_path, "s.yaml")
    assert done.returncode == 0 and "no longer in s.yaml, kept but not run" in done.stderr
    gone = [name for name in before if "gamma0-0.3" in name]
    assert len(gone) == 2 and all(name in done.stderr for name in gone)
    assert {n: c[0] for n, c in contents(tmp_path / "runs/s").items()} == {n: c[0] for n, c in before.items()}
    assert sweep(tmp_path, "s.yaml").stderr == ""
    written(tmp_path, changed.replace("cycles: 2", "cycles: 3"))
    assert sweep(tmp_path, "s.yaml").returncode == 0
    after = contents(tmp_path / "runs/s")
    assert {n: (c[0], c[1]) for n, c in after.items()} == {n: (c[0], 2 if n in gone else 3) for n, c in before.items()}


def started(folder, *options, **more):
    """A call of the sweep in `folder` as a process that says nothing."""
    return subprocess.Popen(command("s.yaml", "-q", *options), cwd=folder, env=environment(), **more)


def test_a_shorter_duration_leaves_longer_runs_as_they_are(tmp_path, complete):
    """A run that was stopped beyond what is asked for now is complete, not failed."""
    written(tmp_path, BASE.replace("cycles: 2", FOREVER) + "seeds: 1\n")
    process = started(tmp_path)
    wait_until(lambda: cycles_in(tmp_path) > 2, process)
    process.terminate()
    assert process.wait(timeout=LIMIT) == 130
    before = contents(tmp_path / "runs/s")
    assert before and all(content[1] > 2 for content in before.values())
    written(tmp_path, BASE + "seeds: 1\n")
    done = sweep(tmp_path, "s.yaml")
    assert (done.returncode, done.stderr) == (0, "")
    assert {n: c[1] for n, c in contents(tmp_path / "runs/s").items()} == {n: c[1] for n, c in before.items()}


def test_a_terminal_shows_a_table(tmp_path, complete):
    """Redrawn in place: what is complete, running (strain, time left) and waiting; events above it."""
    written(tmp_path, FOUR.replace("cycles: 2", FOREVER))
    main, side = pty.openpty()
    options = {"cwd": tmp_path, "env": environment() | {"TERM": "xterm", "COLUMNS": "120"}, "stdin": subprocess.DEVNULL}
    process = subprocess.Popen(command("s.yaml"), stderr=side, stdout=side, **options)
    os.close(side)
    shown = []

    def read():
        with suppress(OSError):  # the other end is closed
            while select.select([main], [], [], 0.0)[0] and (piece := os.read(main, 65536)):
                shown.append(piece)
        return b"".join(shown).decode(errors="replace")

    wait_until(lambda: re.search(r"gamma0-0.6\S*  +[\d.e+]+/9\.6e\+07 +[\d:]+ left", read()), process)
    process.terminate()
    wait_until(lambda: [read(), process.poll()][1] is not None)
    assert process.returncode == 130
    text = read()
    assert "0/4 complete" in text and "waiting" in text and "\x1b[" in text
    assert "stopped (SIGTERM)" in text


def test_two_calls_at_once(tmp_path, complete):
    """The second leaves quietly with 130, work being left; the runs are as ever.

    A point that the test keeps for itself keeps the first from its end until the second has left.
    """
    (point, *_) = resolve(read_sweep(written(tmp_path, FOUR)))
    folder = tmp_path / "runs/s" / point.name
    folder.mkdir(parents=True)
    lock = PointLock(folder)
    processes = [started(tmp_path, stderr=subprocess.PIPE, text=True) for _ in range(2)]
    wait_until(lambda: any(process.poll() is not None for process in processes))
    lock.release()
    errors = [process.communicate(timeout=LIMIT)[1] for process in processes]
    assert sorted(process.returncode for process in processes) == [0, 130], errors
    assert errors == ["", ""]
    compare(contents(tmp_path / "runs/s"), contents(complete / "runs/s"))


def compare(found, expected):
    assert set(found) == set(expected)
    for name, content in found.items():
        assert same(content, expected[name]), name


def limited(folder, enough, *options, again=lambda: None):
    """Call with --max-time, each time with twice the time, until it was `enough`; the last limit in seconds."""
    seconds = 3.0
    while True:
        done = sweep(folder, "s.yaml", "--max-time", f"{seconds}s", *options)
        assert done.returncode == 130 and "time limit" in done.stderr
        if enough():
            return seconds
        again()
        seconds *= 2.0
        assert seconds < LIMIT


def test_max_time_stops_all_and_the_next_call_goes_on(tmp_path, complete):
    """Exit code 130, a checkpoint each, no cycle begun after the limit; the next call continues."""
    written(tmp_path, FOUR.replace("cycles: 2", FOREVER))
    workers = min(4, cores())

    def counts():
        return {name: content[1] for name, content in contents(tmp_path / "runs/s").items()}

    def all_began():
        return len(counts()) == workers and min(counts().values()) >= 1

    limit = limited(tmp_path, all_began, again=lambda: shutil.rmtree(tmp_path / "runs"))
    cycles = counts()
    for name in cycles:
        with Run(tmp_path / "runs/s" / name) as run:
            times = [run.cycle(k)["statistics"]["wall_time"] for k in range(run.cycles)]
        assert sum(times[:-1]) <= limit and (tmp_path / "runs/s" / name / "checkpoint.npz").is_file()
    limited(tmp_path, lambda: sum(counts().values()) > sum(cycles.values()), "--workers", "1")
    assert all(counts()[name] >= count for name, count in cycles.items())


def test_failures_are_retried_counted_and_reported(tmp_path, complete):
    """A point that cannot be computed is tried 1 + retries times over the calls, then reported with exit code 3."""
    bad = "set: {integrator.max_evaluations: 3, duration.strain: 1}\n"
    if "max_evaluations" not in loads(BASE.replace("base:\n", "").replace("\n  ", "\n").lstrip()).to_yaml():
        pytest.skip("no such key")
    written(tmp_path, BASE + bad + "retries: 1\nruns:\n  - {vary: {flow.amplitude: [0.3]}}\n")
    done = sweep(tmp_path, "s.yaml")
    assert done.returncode == 3 and "1 of 1 points failed for good" in done.stderr and "--retry-failed" in done.stderr
    (folder,) = (p.parent for p in tmp_path.glob("runs/s/*/point.json"))
    record = read_record(folder)
    assert record.failures == 2 and record.message and record.code == 3
    log = (folder / "suspend.log").read_text()
    assert log.count("Error: ") == 2
    again = sweep(tmp_path, "s.yaml")
    assert again.returncode == 3 and (folder / "suspend.log").read_text() == log
    assert json.loads(sweep(tmp_path, "status", "runs/s", "--json").stdout)["counts"]["failed"] == 1
    written(tmp_path, BASE + bad.replace("3, ", "100000, ") + "runs:\n  - {vary: {flow.amplitude: [0.3]}}\n")
    assert sweep(tmp_path, "s.yaml", "--retry-failed", "-q").returncode == 0


def test_a_full_disk_stops_the_sweep_and_counts_against_no_point(tmp_path):
    """Files may grow to 150 kB only: exit code 4 and one message; with room again the sweep goes on."""
    written(tmp_path, BASE.replace("cycles: 2", "cycles: 60") + "seeds: 2\n")
    full = errno.ENOSPC

    def limit():
        resource.setrlimit(resource.RLIMIT_FSIZE, (150_000, resource.RLIM_INFINITY))

    error = StorageError("x")
    error.__cause__ = OSError(full, "full")
    assert is_disk_trouble(error) and not is_disk_trouble(StorageError("x"))
    done = sweep(tmp_path, "s.yaml", preexec_fn=limit)
    assert done.returncode == 4 and done.stderr.count("Error: ") == 1 and "file size limit" in done.stderr
    assert all(read_record(path.parent).failures == 0 for path in tmp_path.glob("runs/s/*/point.json"))
    done = sweep(tmp_path, "s.yaml")
    assert done.returncode == 0, done.stderr


# --- kills ------------------------------------------------------------------------------------------------------------


def processes_of(folder):
    """Pids of the call and its workers in this folder."""
    found = []
    for entry in Path("/proc").iterdir():
        if entry.name.isdigit():
            try:
                words = (entry / "cmdline").read_bytes().split(b"\0")
                here = os.readlink(entry / "cwd") == str(folder)
            except OSError:
                continue
            if here and (b"suspend.sweep.worker" in words or b"suspend_cli" in words):
                found.append(int(entry.name))
    return found


def kill_until(folder, kills, seed):
    """Call the sweep again and again; `kills` times kill -9 the call or a worker at a random moment: some time after
    the call, its first worker or one more cycle is there.
    """
    rng = random.Random(seed)
    for _ in range(kills):
        before = cycles_in(folder)
        there = [
            lambda: processes_of(folder), lambda: len(processes_of(folder)) > 1, lambda n=before: cycles_in(folder) > n,
        ][rng.randrange(3)]  # fmt: skip
        process = started(folder, stderr=subprocess.PIPE)
        wait_until(lambda process=process, there=there: there() or process.poll() is not None)
        time.sleep(rng.uniform(0.0, 1.0))
        alive = processes_of(folder)
        if alive:
            os.kill(rng.choice(alive), signal.SIGKILL)
            if rng.random() < 0.5:
                process.kill()
        else:
            process.kill()
        if process.poll() is None and rng.random() < 0.5:
            process.terminate()
        try:
            process.communicate(timeout=4)  # some calls are left to go on with what was not killed
        except subprocess.TimeoutExpired:
            process.kill()
            process.communicate()
        yield


def check_kills(folder, kills, expected):
    complete_ids = {}
    for _ in kill_until(folder, kills, seed=kills):
        call = prepare(folder / "s.yaml", folder / "runs/s")
        for point in call.points:
            place = call.places[point.key]
            if is_complete(place, point.config):
                with Run(place) as run:
                    stamp = (run.run_id, (place / "trajectory.h5").stat().st_mtime_ns)
                assert complete_ids.setdefault(point.key, stamp) == stamp  # nothing complete is repeated or lost
    # 130: workers of a killed call are writing their checkpoints still
    done = wait_until(lambda: done if (done := sweep(folder, "s.yaml")).returncode != 130 else None)
    assert done.returncode == 0, done.stderr
    compare(contents(folder / "runs/s"), expected)
    assert holder(folder / "runs/s", SweepLock.NAME) is None


def test_kills_lose_nothing(tmp_path, complete):
    """kill -9 of the call or a worker at random moments: the runs end bit for bit as without kills."""
    written(tmp_path, FOUR + "retries: 50\n")
    check_kills(tmp_path, 3, contents(complete / "runs/s"))


@pytest.mark.long
def test_twenty_kills_lose_nothing(tmp_path, complete):
    """The same, 20 kills, 12 points, 40 cycles each."""
    text = FOUR.replace("cycles: 2", "cycles: 60") + "seeds: 3\n"
    for name in ("undisturbed", "killed"):
        (tmp_path / name).mkdir()
        written(tmp_path / name, text + "retries: 50\n")
    assert sweep(tmp_path / "undisturbed", "s.yaml").returncode == 0
    check_kills(tmp_path / "killed", 20, contents(tmp_path / "undisturbed/runs/s"))


def test_workers_stop_when_their_call_is_killed(tmp_path, complete):
    """kill -9 of the call: its workers, which would never end, write a checkpoint and go."""
    written(tmp_path, FOUR.replace("cycles: 2", FOREVER))
    process = started(tmp_path)
    workers = min(4, cores())
    wait_until(lambda: len(list(tmp_path.glob("runs/s/*/moduli.csv"))) == workers, process)
    process.kill()
    process.wait()
    wait_until(lambda: not processes_of(tmp_path))
    assert all(content[1] >= 1 for content in contents(tmp_path / "runs/s").values())
    call = prepare(tmp_path / "s.yaml", tmp_path / "runs/s")
    assert all(holder(call.places[p.key], PointLock.NAME) is None for p in call.points)


def test_suspended_workers_do_not_keep_a_stopped_call(tmp_path, complete):
    """SIGSTOP of a worker, then SIGTERM of the call: it ends with 130 and a checkpoint as ever."""
    written(tmp_path, BASE.replace("cycles: 2", FOREVER) + "seeds: 1\n")
    process = started(tmp_path, stderr=subprocess.PIPE)
    wait_until(lambda: cycles_in(tmp_path), process)
    (worker,) = set(processes_of(tmp_path)) - {process.pid}
    os.kill(worker, signal.SIGSTOP)
    process.terminate()
    try:
        process.communicate(timeout=LIMIT)
    finally:
        os.kill(worker, signal.SIGCONT) if worker in processes_of(tmp_path) else None
    assert process.returncode == 130
    assert all(content[1] >= 1 for content in contents(tmp_path / "runs/s").values())


def crontab_line():
    """Command of the crontab line in the README."""
    readme = (ROOT / "README.md").read_text()
    (line,) = re.findall(r"^ +((?:\S+ ){5}cd \S+ && \S+/suspend sweep .*)$", readme, re.MULTILINE)
    return line.split(" ", 5)[5]


def test_the_crontab_line_of_the_readme(tmp_path, complete):
    """The README's line, run by sh with cron's bare environment until it falls silent: all points complete."""
    text = crontab_line()
    project, program, config = re.match(r"cd (\S+) && (\S+) sweep (\S+)", text).groups()
    home = tmp_path / "home"
    place = Path(project.replace("~", str(home)))
    (place / program).parent.mkdir(parents=True)
    (place / program).write_text(f'#!/bin/sh\nPYTHONPATH="{ROOT}" exec "{sys.executable}" -m suspend_cli "$@"\n')
    (place / program).chmod(0o755)
    (place / config).parent.mkdir()
    written((place / config).parent, FOUR, Path(config).name)
    assert "--max-time" in text
    codes, outputs = [], []
    for number in range(20):
        text = re.sub(r"--max-time \S+", f"--max-time {min(2.0 * 1.5**number, LIMIT)}s", text)
        done = subprocess.run(
            ["/bin/sh", "-c", text], env={"HOME": str(home), "PATH": "/usr/bin:/bin", "SHELL": "/bin/sh"},
            capture_output=True, text=True, timeout=2 * LIMIT,
        )  # fmt: skip
        codes.append(done.returncode)
        outputs.append(done.stdout + done.stderr)
        if done.returncode == 0 and not outputs[-1]:
            break
    assert codes[-1] == 0 and outputs[-1] == "" and set(codes) <= {0, 130}, outputs
    compare(contents(place / "runs" / Path(config).stem), contents(complete / "runs/s"))


def test_the_folder_finds_points_of_older_names(tmp_path, complete):
    """A renamed folder still belongs to the point whose configuration it holds."""
    shutil.copytree(complete / "runs/s", tmp_path / "s")
    points = resolve(read_sweep(complete / "s.yaml"))
    (tmp_path / "s" / points[0].name).rename(tmp_path / "s" / "renamed")
    places, former = Folder(tmp_path / "s").place(points)
    assert places[points[0].key].name == "renamed" and former == []
