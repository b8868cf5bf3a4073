"""Where outputs go: special files, links, names that a spreadsheet would execute."""

from __future__ import annotations

import csv
import io
import os
import stat
import subprocess
import sys
import threading

import numpy as np
import pytest
from synthetic_runs import configuration, oscillatory_record, stress, write_run
from waiting import LIMIT

from suspend.analysis.summary import analyze
from suspend.errors import StorageError
from suspend.io.csv_text import cell, csv_text
from suspend.io.files import replace_text


@pytest.fixture
def stored(tmp_path):
    """A small finished run."""
    return make_run(tmp_path / "run")


def make_run(path):
    scales = {"viscosity": 2.0, "gamma0": 0.8, "omega": 1.0, "phase": 0.0}
    parts = {"hydrodynamic": lambda theta: stress(np.cos(theta)), "interparticle": lambda theta: stress(np.sin(theta))}
    flow = {"type": "oscillatory", "amplitude": 0.8, "omega": 1.0}
    records = [oscillatory_record(cycle, scales, parts) for cycle in range(2)]
    return write_run(path, configuration(flow, {"cycles": 2}), records, np.zeros((4, 3)))


def suspend(*arguments, **options):
    return subprocess.run(
        [sys.executable, "-m", "suspend_cli", *map(str, arguments)], capture_output=True, timeout=LIMIT, **options
    )


def test_a_link_stays_and_its_target_is_written(tmp_path):
    """As every program that opens a file for writing does; a target that does not exist yet is made."""
    (tmp_path / "real").write_text("old")
    (tmp_path / "link").symlink_to("real")
    (tmp_path / "chain").symlink_to("link")
    (tmp_path / "dangling").symlink_to("made")
    replace_text(tmp_path / "chain", "new")
    replace_text(tmp_path / "dangling", "made")
    assert (tmp_path / "real").read_text() == "new" and (tmp_path / "made").read_text() == "made"
    assert all((tmp_path / name).is_symlink() for name in ("link", "chain", "dangling"))


def test_a_circle_of_links_is_an_error(tmp_path, stored):
    (tmp_path / "a").symlink_to("b")
    (tmp_path / "b").symlink_to("a")
    with pytest.raises(StorageError, match="circle"):
        analyze(stored).write_csv(tmp_path / "a")


def test_a_fifo_receives_the_bytes_and_stays(tmp_path):
    """A reader at the other end gets the whole text."""
    fifo, text, received = tmp_path / "pipe", "line\n" * 50_000, []
    os.mkfifo(fifo)
    reader = threading.Thread(target=lambda: received.append(fifo.read_text()))
    reader.start()
    replace_text(fifo, text)
    reader.join(LIMIT)
    assert received == [text] and stat.S_ISFIFO(fifo.stat().st_mode)


@pytest.mark.parametrize("command", ["analyze", "export"])
def test_devices_are_written_through(tmp_path, stored, command):
    """Through links, so that a wrong program cannot destroy the device: /dev/null takes all, /dev/full nothing."""
    for device in ("null", "full"):
        (tmp_path / f"{device}.csv").symlink_to(f"/dev/{device}")
    option = {"analyze": "--csv", "export": "-o"}[command]
    done = suspend(command, stored, option, tmp_path / "null.csv")
    assert done.returncode == 0, done.stderr
    failed = suspend(command, stored, option, tmp_path / "full.csv")
    assert failed.returncode == 4 and b"the disk is full" in failed.stderr and b"Traceback" not in failed.stderr
    for device in ("null", "full"):
        assert stat.S_ISCHR(os.stat(f"/dev/{device}").st_mode) and (tmp_path / f"{device}.csv").is_symlink()


def test_stdout_by_name_keeps_what_was_written_before(tmp_path, stored):
    """`--csv /dev/stdout >> file` adds to the file: opened anew it would be cut."""
    target = tmp_path / "log"
    target.write_text("before\n")
    with open(target, "a") as log:
        command = [sys.executable, "-m", "suspend_cli", "analyze", str(stored), "--csv", "/dev/stdout"]
        assert subprocess.run(command, stdout=log, timeout=LIMIT).returncode == 0
    text = target.read_text()
    assert text.startswith("before\n") and "cycle," in text


@pytest.mark.parametrize("text", ["=cmd|'/c x'!A1", "@SUM(A1)", "+1+2", "-2+3"])
def test_no_cell_is_a_formula(text):
    """Text that a spreadsheet would take for a formula begins with an apostrophe; numbers and plain names stay."""
    ((first, number, word),) = csv.reader(io.StringIO(csv_text([[text, -0.5, "phi0.4"]]), newline=""))
    assert (first, number, word) == ("'" + text, "-0.5", "phi0.4")
    assert (cell("\r=1"), cell("a\nb"), cell("\t=1")) == (r"\r=1", r"a\nb", r"\t=1")
    assert cell("-1.5e-3") == "-1.5e-3" and cell("-inf") == "-inf"


def test_folders_named_like_formulas_are_text_in_tables(tmp_path):
    """A run's folder named as a formula, in the table of many runs."""
    runs = [make_run(tmp_path / name) for name in ("=cmd", "@SUM", "plain")]
    done = suspend("analyze", *runs, "--csv", tmp_path / "t.csv")
    assert done.returncode == 0, done.stderr
    with open(tmp_path / "t.csv", newline="") as file:
        rows = list(csv.reader(file))
    assert len(rows) > 3
    assert not [c for row in rows for c in row if c[:1] in ("=", "@", "\t", "\r")]
