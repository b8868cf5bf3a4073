"""Signals: a run stops with a checkpoint, or leaves at once where nothing is lost."""

from __future__ import annotations

import re
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
from waiting import LIMIT, cycles_in, wait_until

from suspend.config import from_dict
from suspend.errors import Interrupted
from suspend.io import Run
from suspend.simulation.stop import Stop


def command(folder, number, phi):
    """The words of `suspend run` of a run that never ends, in `folder`/r."""
    config = from_dict(
        {
            "particles": {"number": number, "volume_fraction": phi},
            "flow": {"type": "oscillatory", "amplitude": 0.3},
            "duration": {"cycles": 40_000_000},
            "repulsion": {"force": 10.0, "debye_length": 0.01},
        }
    )
    (folder / "c.yaml").write_text(config.to_yaml())
    return ["run", str(folder / "c.yaml"), "-o", str(folder / "r")]


def started(folder, number, phi, preexec=None, program=("-m", "suspend_cli")):
    """The command as a process."""
    words = [sys.executable, *program, *command(folder, number, phi)]
    preexec = preexec or (lambda: signal.signal(signal.SIGHUP, signal.SIG_DFL))  # the tests may run under nohup
    return subprocess.Popen(words, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, preexec_fn=preexec)


def running(process, folder):
    """Wait until a cycle is stored."""
    wait_until(lambda: cycles_in(folder / "r"), process)


@pytest.mark.parametrize("name", ["SIGUSR1", "SIGHUP", "SIGTERM"])
def test_a_scheduler_or_a_lost_terminal_stops_with_a_checkpoint(tmp_path, name):
    """Exit code 130, the signal named, a checkpoint from which the run can go on."""
    process = started(tmp_path, 10, 0.2)
    running(process, tmp_path)
    process.send_signal(getattr(signal, name))
    _, error = process.communicate(timeout=LIMIT)
    assert process.returncode == 130, error
    assert name in error and "checkpoint written" in error and "Traceback" not in error
    with Run(tmp_path / "r") as stored:
        assert stored.cycles >= 1


def test_nohup_is_honoured(tmp_path):
    """SIGHUP ignored by whoever started the run stays ignored: the run, which else stops after a step, goes on for
    cycles.
    """
    process = started(tmp_path, 10, 0.2, lambda: signal.signal(signal.SIGHUP, signal.SIG_IGN))
    running(process, tmp_path)
    process.send_signal(signal.SIGHUP)
    before = cycles_in(tmp_path / "r")
    wait_until(lambda: cycles_in(tmp_path / "r") >= before + 5, process)
    process.terminate()
    process.communicate(timeout=LIMIT)
    assert process.returncode == 130


STIRRING = """import sys
import suspend.packing as packing
from suspend_cli.start import main
def stir(*words, kernel=packing.metropolis):
    found = kernel(*words)
    with open(sys.argv[2] + ".stirred", "a") as file:
        file.write(".")
    return found
packing.metropolis = stir
main()
"""


def test_packing_can_be_stopped(tmp_path):
    """A packing of hundreds of blocks of sweeps ends with the block in which SIGTERM comes, and leaves no run behind.

    The file has one letter a block that has ended; one more may have ended between signal and look.
    """
    process = started(tmp_path, 8000, 0.6, program=("-c", STIRRING))
    stirred = tmp_path / "c.yaml.stirred"
    wait_until(lambda: stirred.exists() and stirred.stat().st_size >= 3, process)
    process.terminate()
    asked = stirred.stat().st_size
    _, error = process.communicate(timeout=LIMIT)
    assert stirred.stat().st_size <= asked + 2 and not (tmp_path / "r").exists()
    assert process.returncode == 130 and "nothing is lost" in error and "Traceback" not in error


def receives(process, number):
    """Whether the process has a handler of its own for a signal (a mask of bits in /proc)."""
    status = Path(f"/proc/{process.pid}/status").read_text()
    return int(re.search(r"SigCgt:\s*(\w+)", status).group(1), 16) >> (number - 1) & 1


@pytest.fixture(scope="module")
def start_up(tmp_path_factory):
    """Seconds that the imports take on this machine now."""
    begun = time.monotonic()
    words = command(tmp_path_factory.mktemp("start"), 8000, 0.6)
    subprocess.run([sys.executable, "-m", "suspend_cli", *words, "--dry-run"], capture_output=True, check=True)
    return time.monotonic() - begun


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGINT])
def test_start_up_leaves_at_once(tmp_path, start_up, number):
    """At any instant from the command's first lines on, through the imports into the packing: 130, one line, no
    traceback.
    """
    for part in (0.0, 0.1, 0.2, 0.4, 0.6, 0.9, 1.2):
        process = started(tmp_path, 8000, 0.6)
        # before, the interpreter has not reached the command; SIGUSR1 is received only by it
        wait_until(lambda process=process: receives(process, signal.SIGUSR1), process)
        time.sleep(part * start_up)
        process.send_signal(number)
        _, error = process.communicate(timeout=LIMIT)
        assert process.returncode == 130, (part, error)
        assert "Traceback" not in error, (part, error)


def test_a_signal_within_a_callback_from_c_is_not_lost():
    """There an exception is printed and dropped (ctypes). Nothing is raised within the compiler's callbacks, and the
    signal comes again where its exception ends the block.
    """
    inside = compile("def callback(stop): stop._receive(signal.SIGTERM, sys._getframe())", "/x/llvmlite/y.py", "exec")
    space = {"signal": signal, "sys": sys}
    exec(inside, space)
    with pytest.raises(Interrupted, match="SIGTERM"), Stop(None) as stop:
        space["callback"](stop)  # returns
        wait_until(lambda: False)  # ended by the signal
