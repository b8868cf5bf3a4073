"""The command line: exit codes, stdout and stderr, options, progress. The simulation is made up here."""

import contextlib
import io
import json
import os
import pty
import signal
import subprocess
import sys
from pathlib import Path
from types import ModuleType, SimpleNamespace

import pytest
from synthetic_runs import configuration, oscillatory_record, write_run
from waiting import LIMIT, wait_until

from suspend.errors import ConfigurationError, Interrupted, NumericalError, StorageError
from suspend_cli.main import main
from suspend_cli.options import FIGURES, DurationType
from suspend_cli.progress import Progress, clock_time, render

CONFIGS = Path(__file__).parent.parent / "configs"
DEMO = str(CONFIGS / "demo.yaml")
SCALES = {"gamma0": 0.8, "omega": 1.0, "phase": 0.0, "viscosity": 2.0}


def suspend(*arguments, **options):
    """The command in a process of its own."""
    command = [sys.executable, "-m", "suspend_cli", *map(str, arguments)]
    return subprocess.run(command, capture_output=True, text=True, **options)


def call(*arguments):
    """The command in this process; returns its exit code."""
    with pytest.raises(SystemExit) as stop:
        main([str(argument) for argument in arguments])
    return stop.value.code


class Result:
    """A Plan or Summary."""

    def __init__(self, name):
        self.name = name

    def lines(self):
        return [f"{self.name} line 1", f"{self.name} line 2"]

    def as_dict(self):
        return {"name": self.name, "gap": float("nan")}


@pytest.fixture
def simulation(monkeypatch):
    """A made-up `suspend.simulation`; `calls` holds what `run` was called with, `error` what it raises."""
    module = ModuleType("suspend.simulation")
    module.calls, module.error = [], None

    def run(config, directory, **options):
        module.calls.append((config, directory, options))
        options["message"]("a message")
        if module.error is not None:
            raise module.error
        return Result("summary")

    module.run, module.make_plan = run, lambda config: Result("plan")
    monkeypatch.setitem(sys.modules, "suspend.simulation", module)
    return module


@pytest.fixture
def finished_run(tmp_path):
    """A run directory of two cycles of a Newtonian fluid, written with the program's own writer."""
    text = configuration({"type": "oscillatory", "amplitude": 0.8}, {"cycles": 2})
    parts = dict.fromkeys(
        ("hydrodynamic", "interparticle"), lambda theta: [[0, 0, 0, 0, 0, 0]] + 0 * theta[:, None]
    )
    records = [oscillatory_record(k, SCALES, parts) for k in range(2)]
    return write_run(tmp_path / "run", text, records, final=records[-1]["unwrapped"][0])


def test_help_is_light():
    """`--help` imports neither NumPy nor numba nor HDF5, which take most of a second."""
    code = (
        "import sys\nfrom suspend_cli.main import main\ntry:\n  main(['--help'])\nexcept SystemExit: pass\n"
    )
    code += "print(sorted({'numpy', 'numba', 'scipy', 'h5py', 'matplotlib', 'yaml'} & set(sys.modules)))"
    printed = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout
    assert printed.splitlines()[-1] == "[]"


@pytest.mark.parametrize("command", [[], ["run"], ["analyze"], ["info"], ["init"]])
def test_every_command_has_help_with_an_example(command):
    result = suspend(*command, "--help")
    assert result.returncode == 0 and result.stderr == ""
    assert "Examples:" in result.stdout and f"suspend {' '.join(command)}" in result.stdout
    assert max(map(len, result.stdout.splitlines())) <= 100


def test_version():
    import suspend as package

    assert suspend("--version").stdout == f"suspend {package.__version__}\n"


@pytest.mark.parametrize(
    ("arguments", "found"),
    [
        (["run"], "Missing argument 'CONFIG'"),
        (["walk"], "No such command 'walk'"),
        (["run", DEMO, "--threads", "0"], "found 0; must be an integer from 1 to"),
        (["run", DEMO, "--threads", "100000"], "found 100000; must be an integer from 1 to"),
        (["run", DEMO, "--threads", "two"], "found two; must be"),
        (["run", DEMO, "--max-time", "soon"], "found 'soon'; must be a time > 0"),
        (["run", DEMO, "--max-time", "0"], "found '0'; must be a time > 0"),
        (["run", "missing.yaml"], "missing.yaml: no such file; `suspend init missing.yaml`"),
        (["run", "."], "is a folder"),
        (
            ["run", DEMO, "--set", "flow.amplitud=1"],
            "--set: flow.amplitud: unknown key; did you mean amplitude?",
        ),
        (["run", DEMO, "--set", "far_field=ewld", "--dry-run"], "must be ewald | self | identity; did you mean"),
        (["analyze", "run", "--plot", "a.jpeg"], "must end in .png, .pdf"),
        (["analyze", "run", "--last", "0"], "0 is not in the range"),
        (["init", "."], "is a folder"),
    ],
)
def test_wrong_use_exits_2_and_leaves_nothing(arguments, found, tmp_path):
    result = suspend(*arguments, cwd=tmp_path)
    assert result.returncode == 2
    assert found in result.stderr and "Traceback" not in result.stderr
    assert result.stdout == "" and list(tmp_path.iterdir()) == []


def test_all_errors_of_a_configuration_are_printed_at_once(tmp_path):
    path = tmp_path / "a.yaml"
    path.write_text("seed: x\nparticles: {number: 5, volume_fraction: 2}\n")
    result = suspend("run", path)
    assert result.returncode == 2
    assert result.stderr.startswith(
        f"Error: 4 errors in the configuration {path}\n  {path}:1: seed: found 'x'"
    )


@pytest.mark.parametrize("command", ["info", "analyze"])
def test_a_run_that_is_not_there_exits_4(command, tmp_path):
    result = suspend(command, tmp_path / "missing")
    assert result.returncode == 4
    assert (
        result.stderr.startswith("Error: ")
        and "missing" in result.stderr
        and "Traceback" not in result.stderr
    )


def test_init_writes_a_configuration_that_runs(tmp_path, simulation, capsys):
    """What `init` writes is valid, is not overwritten without --force, and goes to stdout for -."""
    path = tmp_path / "new" / "config.yaml"
    assert call("init", path) == 0
    assert os.stat(path).st_mode & 0o444 == 0o444 & ~_umask()
    text = path.read_text()
    assert call("run", path, "--dry-run") == 0
    path.write_text("mine")
    assert call("init", path) == 2
    assert "exists already; --force" in capsys.readouterr().err
    assert path.read_text() == "mine"
    assert call("init", path, "--force") == 0
    assert path.read_text() == text
    assert [p.name for p in path.parent.iterdir()] == ["config.yaml"]
    capsys.readouterr()
    assert call("init", "-") == 0
    assert capsys.readouterr().out == text


def _umask():
    mask = os.umask(0)
    os.umask(mask)
    return mask


def test_init_into_a_file_used_as_a_folder_exits_4(tmp_path):
    (tmp_path / "file").write_text("")
    result = suspend("init", tmp_path / "file" / "config.yaml")
    assert result.returncode == 4 and "cannot write" in result.stderr


def test_run_passes_on_what_it_is_told(simulation, capsys):
    """Arguments arrive resolved; results go to stdout, messages to stderr."""
    assert (
        call("run", DEMO, "--set", "seed=7", "--max-time", "1h30m", "--threads", "1", "--resume", "-o", "x")
        == 0
    )
    ((config, directory, options),) = simulation.calls
    assert (config.seed, directory) == (7, Path("x"))
    assert (options["resume"], options["threads"], options["max_time"]) == (True, 1, 5400.0)
    printed = capsys.readouterr()
    assert printed.out == "summary line 1\nsummary line 2\n"
    assert printed.err.splitlines()[1:] == ["a message"] and DEMO in printed.err


def test_run_by_default(simulation):
    """The same command again means: continue if there is something to continue (resume None)."""
    assert call("run", DEMO) == 0
    ((_, directory, options),) = simulation.calls
    assert directory == Path("runs/demo")
    assert (options["resume"], options["threads"], options["max_time"]) == (None, None, None)
    assert callable(options["progress"])  # stderr is no terminal here: lines of a log


def test_quiet_and_json(simulation, capsys):
    assert call("run", DEMO, "--quiet") == 0
    assert capsys.readouterr() == ("", "")
    assert call("run", DEMO, "--quiet", "--json") == 0
    assert json.loads(capsys.readouterr().out) == {"name": "summary", "gap": None}
    assert call("run", DEMO, "--dry-run") == 0
    assert capsys.readouterr() == ("plan line 1\nplan line 2\n", "")
    assert call("run", DEMO, "--dry-run", "--json") == 0
    assert json.loads(capsys.readouterr().out)["name"] == "plan"
    assert len(simulation.calls) == 2


@pytest.mark.parametrize(
    ("error", "code"),
    [
        (ConfigurationError("wrong"), 2),
        (NumericalError("wrong"), 3),
        (StorageError("wrong"), 4),
        (Interrupted("wrong"), 130),
        (KeyboardInterrupt(), 130),
        (MemoryError("wrong"), 3),
        (OSError(28, "wrong"), 4),
    ],
)
def test_errors_end_in_one_message_and_their_exit_code(simulation, capsys, error, code):
    simulation.error = error
    assert call("run", DEMO, "--quiet") == code
    printed = capsys.readouterr()
    assert printed.out == "" and printed.err.strip().count("\n") == 0
    assert printed.err.strip().startswith("Error: ") and (
        "wrong" in printed.err or "interrupted" in printed.err
    )


def test_a_traceback_on_demand(simulation, capsys, monkeypatch):
    simulation.error = NumericalError("wrong")
    monkeypatch.setenv("SUSPEND_DEBUG", "1")
    assert call("run", DEMO) == 3
    assert "Traceback" in capsys.readouterr().err


def test_a_defect_shows_its_traceback_and_exits_1(simulation, capsys):
    simulation.error = ZeroDivisionError("defect")
    assert call("run", DEMO) == 1
    assert "Traceback" in (printed := capsys.readouterr().err) and "please report" in printed


def test_a_closed_pipe_is_quiet():
    """`suspend init - | head -1`: no message, no traceback; 1 is what click exits with."""
    process = subprocess.Popen(
        [sys.executable, "-m", "suspend_cli", "init", "-"], stdout=subprocess.PIPE, stderr=subprocess.PIPE
    )
    process.stdout.close()
    assert process.stderr.read() == b""
    assert process.wait() == 1


@pytest.mark.skipif(not os.path.exists("/dev/full"), reason="needs /dev/full")
def test_a_full_disk_behind_stdout_exits_4():
    with open("/dev/full", "w") as full:
        command = [sys.executable, "-m", "suspend_cli", "init", "-"]
        result = subprocess.run(command, stdout=full, stderr=subprocess.PIPE, text=True)
    assert result.returncode == 4
    assert result.stderr.startswith("Error: ") and result.stderr.count("\n") == 1


def test_threads_reach_numba_before_it_is_imported():
    """numba reads NUMBA_NUM_THREADS once; --threads must set it before."""
    code = (
        "import sys, types, os\nsys.modules['suspend.simulation'] = m = types.ModuleType('m')\n"
        "def run(*a, **k):\n  import numba\n  print(numba.config.NUMBA_NUM_THREADS, k['threads'])\n"
        "  sys.exit(0)\n"
        f"m.run = run\nfrom suspend_cli.main import main\nmain(['run', {DEMO!r}, '--threads', '1'])"
    )
    environment = {name: value for name, value in os.environ.items() if name != "NUMBA_NUM_THREADS"}
    command = [sys.executable, "-c", code]
    printed = subprocess.run(command, stdout=subprocess.PIPE, text=True, check=True, env=environment)
    assert printed.stdout.split() == ["1", "1"]


@pytest.mark.parametrize(
    ("written", "seconds"),
    [
        ("90", 90),
        ("90s", 90),
        ("10m", 600),
        ("2h", 7200),
        ("1h30m", 5400),
        ("1.5h", 5400),
        ("1d", 86400),
        ("0.5", 0.5),
    ],
)
def test_wall_times(written, seconds):
    assert DurationType().convert(written, None, None) == seconds


def test_completion_offers_commands_and_keys():
    words = {"COMP_WORDS": "suspend run a.yaml --set flow.", "COMP_CWORD": "4"}
    result = suspend(env={**os.environ, **words, "_SUSPEND_COMPLETE": "bash_complete"})
    assert "plain,flow.amplitude=" in result.stdout.splitlines()


def test_analyze_with_all_its_outputs(finished_run, tmp_path):
    """The pure fluid of the made-up run has eta_r' = 1: sigma = eta0 gdot."""
    table = suspend("analyze", finished_run)
    assert table.returncode == 0 and table.stderr == ""
    csv_path, figure = tmp_path / "m.csv", tmp_path / "m.png"
    result = suspend("analyze", finished_run, "--json", "--csv", csv_path, "--plot", figure, "--last", 1)
    assert result.returncode == 0
    content = json.loads(result.stdout)
    assert content["cycles"] == 2 and content["averages"]["cycles"] == 1
    name = next(column for column in content["columns"] if column.startswith("eta_r_prime"))
    assert content["columns"][name] == pytest.approx([1.0, 1.0], abs=1e-12)
    assert csv_path.read_text().startswith("cycle,") and figure.read_bytes().startswith(b"\x89PNG")
    assert result.stderr.splitlines() == [f"columns written to {csv_path}", f"figure written to {figure}"]
    assert suspend("analyze", finished_run, "--last", 3).returncode == 2
    assert suspend("analyze", finished_run, "--csv", tmp_path / "no" / "m.csv").returncode == 4


def test_figures_are_those_that_can_be_drawn():
    from suspend.plots import FORMATS

    assert FIGURES == FORMATS


def test_info(finished_run):
    text = suspend("info", finished_run)
    assert text.returncode == 0 and text.stderr == ""
    lines = {line[:16].strip(): line for line in text.stdout.splitlines()}
    assert "finished" in lines["state"] and "2 of 2" in lines["cycles"]
    assert "oscillatory, amplitude 0.8" in text.stdout and "volume fraction 0.1" in text.stdout
    content = json.loads(suspend("info", finished_run, "--json").stdout)
    assert content["cycles_total"] == 2 and content["configuration"]["flow"]["amplitude"] == 0.8


STATE = SimpleNamespace(
    cycle=12, cycles=80, strain=38.4, total_strain=256.0, fraction=0.15, minimum_gap=1.23e-3, iterations=810,
    evaluations=100, elapsed=10.0, compiling=False, initial_fraction=0.1,
)  # fmt: skip


def test_progress_line():
    """Cycle, strain, time left, gap, iterations; the part done before this session is drawn apart."""
    line = render(STATE, 62.0, 120)
    assert line == (
        "cycle 12/80 [==#.....................] 15 %, strain 38.4/256, 1:02 left,"
        " smallest gap 1.2e-03 a, 8.1 iterations"
    )
    for width in range(1, 130):
        assert len(render(STATE, None, width)) <= width
    assert "compiling" in render(SimpleNamespace(**{**vars(STATE), "compiling": True}), None, 120)
    assert [clock_time(s) for s in (None, 5.4, 3723.0)] == ["?", "0:05", "1:02:03"]


class Terminal(io.StringIO):
    def isatty(self):
        return True


def test_time_left_is_by_the_pace_of_this_session(monkeypatch):
    """From 10 % to 15 % in 5 s: 85 s for the rest. Compilation and earlier sessions do not count."""
    monkeypatch.setenv("TERM", "xterm")
    times = iter([0.0, 60.0, 65.0])
    stream = Terminal()
    progress = Progress(stream, clock=lambda: next(times))
    progress.update(SimpleNamespace(**{**vars(STATE), "fraction": 0.1, "compiling": True}))
    progress.update(SimpleNamespace(**{**vars(STATE), "fraction": 0.1}))
    progress.update(STATE)
    assert "1:25 left" in stream.getvalue().rpartition("\r")[2]


def test_no_bar_without_a_terminal():
    stream = io.StringIO()
    with Progress(stream) as progress:
        progress.update(STATE)
        progress.message("text")
    assert stream.getvalue() == "text\n" and not progress.visible


def test_messages_stand_above_the_bar(monkeypatch):
    monkeypatch.setenv("TERM", "xterm")
    stream = Terminal()
    with Progress(stream) as progress:
        progress.update(STATE)
        progress.message("text")
    assert "\r\x1b[Ktext\ncycle 12/80" in stream.getvalue() and stream.getvalue().endswith("\n")


def test_an_interrupt_from_the_keyboard_exits_130(tmp_path):
    """Ctrl-C while a command works: one line, 130; here during a read that never ends."""
    os.mkfifo(tmp_path / "a.yaml")
    command = [sys.executable, "-m", "suspend_cli", "run", str(tmp_path / "a.yaml")]
    process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)

    def other_end():
        with contextlib.suppress(OSError):  # nobody has opened it to read
            return os.open(tmp_path / "a.yaml", os.O_WRONLY | os.O_NONBLOCK)

    end = wait_until(other_end, process)
    process.send_signal(signal.SIGINT)
    out, err = process.communicate(timeout=LIMIT)
    os.close(end)
    assert (process.returncode, out, err) == (130, "", "\nError: interrupted\n")  # a new line after ^C


def test_on_a_real_terminal_the_bar_is_drawn(tmp_path):
    """Through a pseudo-terminal, as a user sees it."""
    code = (
        "import sys, types\nsys.modules['suspend.simulation'] = m = types.ModuleType('m')\n"
        "def run(config, directory, progress=None, **k):\n"
        f"  progress(types.SimpleNamespace(**{vars(STATE)!r}))\n  raise SystemExit(0)\n"
        f"m.run = run\nfrom suspend_cli.main import main\nmain(['run', {DEMO!r}])"
    )
    ours, theirs = pty.openpty()
    environment = {**os.environ, "TERM": "xterm", "COLUMNS": "120"}
    subprocess.run([sys.executable, "-c", code], stderr=theirs, env=environment, check=True)
    os.close(theirs)
    assert b"cycle 12/80 [==#" in os.read(ours, 4096)
    os.close(ours)
