"""The page of a sweep: states, failures, links, numbers; while it runs, before anything is complete, called by cron."""

from __future__ import annotations

import html
import os
import re
import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace
from urllib.parse import unquote

import pytest
from figure_runs import eta_r
from synthetic_sweeps import make_sweep, sweep_text
from test_report import words
from waiting import LIMIT

from suspend.analysis.collection import QUANTITIES, Member, Series
from suspend.analysis.phase_diagram import PhaseDiagram
from suspend.sweep.folder import LOG, PointLock, Record, write_record
from suspend.sweep.page import RUN_PAGE, write_sweep_page
from suspend.sweep.page_results import bounds
from suspend_cli.main import main

ROOT = Path(__file__).parents[1]
BAD = "the step size fell <below> 1e-9 & stopped"
VARY = {"flow.amplitude": [0.4, 0.8, 1.2]}


@pytest.fixture(scope="module")
def base(tmp_path_factory):
    """A sweep of three amplitudes and two seeds: one point failed, one is being computed, one has a page of its own."""
    folder = tmp_path_factory.mktemp("swept")
    states = {(0.4, 2): BAD, (1.2, 2): "interrupted"}
    path = make_sweep(folder, sweep_text(VARY, seeds=2), lambda p: states.get((p.config.flow.amplitude, p.seed), ""))
    (mine,) = path.glob("gamma0-0.8_seed-1*")
    (mine / RUN_PAGE).write_text("x")
    (mine / LOG).write_text("x")
    (going,) = path.glob("gamma0-1.2_seed-2*")
    write_record(going, Record(strain=2.5, total_strain=10.0, updated=1.0, seconds=50.0, running=True))
    return path


@pytest.fixture(scope="module")
def page(base, tmp_path_factory):
    """Its page in another folder, written while a point is being computed; nothing of the sweep changes."""
    (going,) = base.glob("gamma0-1.2_seed-2*")
    target = tmp_path_factory.mktemp("published") / "page.html"
    lock = PointLock(going)
    before = {path: path.stat().st_mtime_ns for path in base.rglob("*")}
    try:
        missing = write_sweep_page([base], target)
        assert before == {path: path.stat().st_mtime_ns for path in base.rglob("*")}
    finally:
        lock.release()
    assert len(missing) == 2
    return target


def test_states_failures_and_text(page):
    """Counts, the running point's strain, the failure with its message escaped, no other file needed."""
    source = page.read_text()
    text = words(source)
    assert "6 points: 4 complete, 1 running, 1 failed" in text and "total strain 2.5 of 10" in text
    assert "(failed 2 times): " + BAD in text and "<below>" not in source and html.escape(BAD) in source
    outside = re.findall(r'(?:src|href)="(?!data:|\./|#)([^"]*)', source)
    assert outside == [] and "<script" not in source


def test_links_lead_to_what_is_there(page, base):
    """Every link is relative and its target exists: six folders (the failed one twice), the log and the run's page."""
    links = re.findall(r'href="(\./[^"]*)"', page.read_text())
    targets = [Path(os.path.normpath(page.parent / unquote(html.unescape(link)))) for link in links]
    assert all(target.exists() for target in targets) and len(targets) == 9
    assert {target.name for target in targets if target.is_file()} == {RUN_PAGE, LOG}
    assert {t for t in targets if t.is_dir()} == {p for p in base.iterdir() if p.name.startswith("gamma0")}


def test_figures_and_numbers(page):
    """Seven figures; eta_r' of the stored stresses, exact in every run, in the points and in the means over seeds."""
    source = page.read_text()
    assert source.count("<figure>") == 7 and "Not drawn" not in source
    text = words(source)
    assert eta_r(0.8, 0.4) == pytest.approx(eta_r(1.2, 0.4), rel=1e-12)
    for gamma0, times in ((0.4, 1 + 1), (0.8, 3 + 2)):  # complete points, and each amplitude once in the means
        assert text.count(f" {eta_r(gamma0, 0.4):.4g} ") == times, gamma0
    assert "no power law is fitted" in text and "0.14 φ−1.93" in text


def test_nothing_complete(tmp_path):
    """The page is written and says so; with no point begun there is no link."""
    path = make_sweep(tmp_path / "x", sweep_text(VARY), lambda _: "waiting")
    write_sweep_page([path], tmp_path / "p.html", title="a < b")
    source = (tmp_path / "p.html").read_text()
    assert "No point is complete yet" in source and "3 waiting" in words(source) and "./" not in source
    assert "<h1>a &lt; b</h1>" in source


def exact(phi: float, amplitudes: tuple, seed: int, far_field: str) -> Series:
    """Signatures between amplitudes[1] and amplitudes[3] around amplitudes[2], the onset in (amplitudes[1], ...[2])."""
    groups = []
    for k, x in enumerate(amplitudes):
        near = abs(k - 2)
        values = dict.fromkeys(QUANTITIES, 0.0) | {"eta_r_prime": 3.0 + near, "minus_eta3_over_eta1": -float(near)}
        onset = 0.5 * (amplitudes[1] + amplitudes[2])
        values |= {"nu4_over_nu2": 1.0 / (1 + near), "minus_N2_nu0": max(0.0, x - onset), "D_cyc": float(k)}
        errors = dict.fromkeys(values, 1e-6)
        setup = {"far_field": far_field}
        groups.append((Member("r", phi, x, 500, seed, 80, True, 10, 256.0, values, errors, (), "", setup),))
    return Series(phi, f"far_field = {far_field}", tuple(groups))


def test_bounds_and_the_fitted_exponent():
    """gamma_c = phi^-2 exactly at three fractions, bounds of 1 % around it: exponent 2 and prefactor 1 to their width.

    Two fractions are too few for a fit; each bound stands beside 0.14 phi^-1.93.
    """
    series = []
    for far, fractions in (("self", (0.3, 0.4, 0.5)), ("ewald", (0.3, 0.5))):
        for phi in fractions:
            centre = phi**-2
            series.append(exact(phi, tuple(centre * f for f in (0.5, 0.995, 1.005, 1.5, 2.0)), 1, far))
    text = words(bounds(PhaseDiagram().compute(SimpleNamespace(series=series))))
    law = r"no far field: γc = C φ−n through 3 bounds: n = (\S+) \((\S+) to (\S+), 95 %\), beside 1.93"
    found = re.search(law, text)
    value, low, high = map(float, found.groups())
    assert value == pytest.approx(2.0, abs=0.02) and low < 2.0 < high and high - low < 0.05
    assert " far field: no power law is fitted: it needs closed bounds at 3 volume fractions, there are 2." in text
    assert text.count("outside") == 5 and text.count("4 of 4 agree") == 5 and "(6.21875, 6.28125)" in text


def test_pages_of_the_runs(tmp_path, monkeypatch):
    """each: a page in the folder of every complete point, linked; written again only when the run has changed."""
    monkeypatch.setattr("suspend.report.write.figures_of", lambda run: [])  # most of the time
    path = make_sweep(tmp_path / "x", sweep_text(VARY), lambda p: "" if p.config.flow.amplitude < 1.0 else "waiting")
    write_sweep_page([path], path / "index.html", each=True)
    pages = sorted(path.glob(f"*/{RUN_PAGE}"))
    assert len(pages) == 2 and all("Report on gamma0" in page.read_text() for page in pages)
    source = (path / "index.html").read_text()
    assert all(f'href="./{page.parent.name}/{RUN_PAGE}"' in source for page in pages)
    pages[0].write_text("kept")
    pages[1].write_text("old")
    os.utime(pages[1], (0, 0))
    write_sweep_page([path], path / "index.html", each=True)
    assert pages[0].read_text() == "kept" and "Report on gamma0" in pages[1].read_text()


@pytest.mark.parametrize(
    ("arguments", "code", "text"),
    [
        (("BASE", "BASE/starts"), 2, "different pages"),
        (("BASE/starts", "--each"), 2, "--each is for sweeps"),
        (("BASE", "-o", "page.txt"), 2, ".html"),
        (("BASE", "-o", "no/such/folder/p.html"), 4, "no/such/folder"),
    ],
)
def test_errors(base, tmp_path, monkeypatch, capsys, arguments, code, text):
    """One message, exit code, no file; what the page cannot be written to is said before anything is computed."""
    monkeypatch.chdir(tmp_path)
    with pytest.raises(SystemExit) as stopped:
        main(["report", *(part.replace("BASE", str(base)) for part in arguments)])
    out, err = capsys.readouterr()
    assert stopped.value.code == code and text in err and not out and "Traceback" not in err
    assert not list(tmp_path.iterdir())


def test_the_nightly_line_of_the_readme(tmp_path):
    """The README's line, which the help has too, run by sh with cron's environment: a page, and not a word."""
    pattern = r"^ +((?:\S+ ){5}cd \S+ && \S+/suspend report .*)$"
    (line,) = re.findall(pattern, (ROOT / "README.md").read_text(), re.MULTILINE)
    assert line in (ROOT / "cli" / "report_page.py").read_text()
    project, program, path, target = re.search(r"cd (\S+) && (\S+) report (\S+) -o (\S+)", line).groups()
    home = tmp_path / "home"
    place = Path(project.replace("~", str(home)))
    (place / program).parent.mkdir(parents=True)
    (place / program).write_text(f'#!/bin/sh\nPYTHONPATH="{ROOT}" exec "{sys.executable}" -m suspend_cli "$@"\n')
    (place / program).chmod(0o755)
    made = make_sweep(tmp_path / "x", sweep_text(VARY), lambda p: "" if p.config.flow.amplitude == 0.8 else "waiting")
    (place / path).parent.mkdir(parents=True)
    made.rename(place / path)
    done = subprocess.run(
        ["/bin/sh", "-c", line.split(" ", 5)[5]], env={"HOME": str(home), "PATH": "/usr/bin:/bin"},
        capture_output=True, text=True, timeout=LIMIT,
    )  # fmt: skip
    assert (done.returncode, done.stdout, done.stderr) == (0, "", "")
    assert "3 points: 1 complete, 2 waiting" in words((place / target).read_text())
