"""Signals: a run stops with a checkpoint, or leaves at once where nothing is lost."""

from __future__ import annotations

import signal
import subprocess
import sys
import time

import pytest

from suspend.config import from_dict
from suspend.errors import Interrupted
from suspend.io import Run
from suspend.simulation.stop import Stop


def started(folder, number, phi, preexec=None):
    """`suspend run` of a long run in `folder`/r, as a process."""
    config = from_dict(
        {
            "particles": {"number": number, "volume_fraction": phi},
            "flow": {"type": "oscillatory", "amplitude": 0.3},
            "duration": {"cycles": 4000},
            "repulsion": {"force": 10.0, "debye_length": 0.01},
        }
    )
    (folder / "c.yaml").write_text(config.to_yaml())
    command = [sys.executable, "-m", "suspend_cli", "run", str(folder / "c.yaml"), "-o", str(folder / "r")]
    return subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, preexec_fn=preexec)


def running(process, folder):
    """Wait until a cycle is stored."""
    while not (folder / "r" / "moduli.csv").exists():
        time.sleep(0.05)
        assert process.poll() is None, process.communicate()
    time.sleep(1.0)


@pytest.mark.parametrize("name", ["SIGUSR1", "SIGHUP", "SIGTERM"])
def test_a_scheduler_or_a_lost_terminal_stops_with_a_checkpoint(tmp_path, name):
    """Exit code 130, the signal named, a checkpoint from which the run can go on."""
    process = started(tmp_path, 10, 0.2)
    running(process, tmp_path)
    process.send_signal(getattr(signal, name))
    _, error = process.communicate(timeout=60)
    assert process.returncode == 130, error
    assert name in error and "checkpoint written" in error and "Traceback" not in error
    with Run(tmp_path / "r") as stored:
        assert stored.cycles >= 1


def test_nohup_is_honoured(tmp_path):
    """SIGHUP ignored by whoever started the run stays ignored."""
    process = started(tmp_path, 10, 0.2, lambda: signal.signal(signal.SIGHUP, signal.SIG_IGN))
    running(process, tmp_path)
    process.send_signal(signal.SIGHUP)
    time.sleep(1.5)
    assert process.poll() is None
    process.terminate()
    process.communicate(timeout=60)
    assert process.returncode == 130


def test_packing_can_be_stopped(tmp_path):
    """A packing that takes a minute ends within seconds of SIGTERM, and leaves no run behind."""
    process = started(tmp_path, 8000, 0.6)
    time.sleep(8.0)
    assert process.poll() is None and not (tmp_path / "r").exists()
    process.terminate()
    asked = time.monotonic()
    _, error = process.communicate(timeout=60)
    assert time.monotonic() - asked < 10.0
    assert process.returncode == 130 and "nothing is lost" in error and "Traceback" not in error


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGINT])
def test_start_up_leaves_at_once(tmp_path, number):
    """At any instant from the first import on: 130, one line, no traceback."""
    for wait in (0.15, 0.25, 0.4, 0.6, 0.8, 1.0, 1.3):
        process = started(tmp_path, 8000, 0.6)
        time.sleep(wait)
        process.send_signal(number)
        _, error = process.communicate(timeout=30)
        if wait >= 0.4:  # before, the interpreter itself may not have reached the command
            assert process.returncode == 130, (wait, error)
            assert "Traceback" not in error, (wait, error)


def test_a_signal_within_a_callback_from_c_is_not_lost():
    """There an exception is printed and dropped (ctypes). Nothing is raised within the compiler's callbacks, and the
    signal comes again where its exception ends the block.
    """
    inside = compile("def callback(stop): stop._receive(signal.SIGTERM, sys._getframe())", "/x/llvmlite/y.py", "exec")
    space = {"signal": signal, "sys": sys}
    exec(inside, space)
    begun = time.monotonic()
    with pytest.raises(Interrupted, match="SIGTERM"), Stop(None) as stop:
        space["callback"](stop)  # returns
        while time.monotonic() - begun < 10.0:
            time.sleep(0.01)
    assert time.monotonic() - begun < 5.0
