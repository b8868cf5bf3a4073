"""Adaptive sweeps: amplitudes added to groups of points, from made runs with a known critical amplitude."""

from __future__ import annotations

import csv
import json
import shutil

import numpy as np
import pytest
from critical_model import drawn_values
from test_sweep import sweep, written

from suspend.config import loads
from suspend.errors import ConfigurationError, Interrupted, NumericalError
from suspend.sweep import read_sweep, resolve
from suspend.sweep.adaptive import UNITS, group_lines, refinable, rounds
from suspend.sweep.folder import CONFIGURATION, Record, write_configuration, write_record
from suspend.sweep.run import open_call, pick, prepare
from suspend.sweep.status import status_lines, sweep_status

BASE = """\
base:
  particles: {number: 8, volume_fraction: 0.2}
  flow: {type: oscillatory, amplitude: 0.3}
  duration: {cycles: 2}
  repulsion: {force: 10.0, debye_length: 0.01}
"""
FILE = BASE + """\
vary:
  particles.volume_fraction: [0.2, 0.4]
  flow.amplitude: [0.2, 0.4, 0.6, 0.8, 1.0, 1.2, 1.6, 2.4]
seeds: 3
adaptive: {width: 0.05, points: 9}
"""
CRITICAL = {0.2: 1.37, 0.4: 0.87}


def scalars(folder, *_):
    """What an analysis would have of the made run in a folder: it depends on its amplitude and seed only."""
    config = loads((folder / CONFIGURATION).read_text())
    gamma0, phi = config.flow.amplitude, config.particles.volume_fraction
    random = np.random.default_rng([config.seed, round(1e6 * gamma0), round(1e6 * phi)])
    values = drawn_values(gamma0, CRITICAL[phi], 1, 0.02, random)
    row = {}
    for name, value in values.items():
        row |= {f"{name}[{UNITS.get(name, '-')}]": float(value[0]), f"{name}_error[{UNITS.get(name, '-')}]": 1e-3}
    return row


@pytest.fixture
def made(tmp_path, monkeypatch):
    """A sweep whose runs are made: complete where a file says so."""
    complete = lambda folder, config: (folder / "made").exists()  # noqa: E731
    monkeypatch.setattr("suspend.sweep.run.is_complete", complete)
    monkeypatch.setattr("suspend.sweep.status.is_complete", complete)
    monkeypatch.setattr("suspend.sweep.collect.point_scalars", scalars)
    return written(tmp_path, FILE)


def compute(call, most: int = 10**6):
    """Make what is left; Interrupted after `most` points, as a kill would leave it."""
    for count, point in enumerate(list(call.left)):
        if count == most:
            raise Interrupted("stopped")
        folder = call.places[point.key]
        write_configuration(folder, point.config)
        (folder / "made").touch()
        write_record(folder, Record(strain=1.0, total_strain=1.0, done=True))


def one_call(file, most: int = 10**6):
    """As the command does: the call afterwards."""
    call = prepare(file, file.parent / "runs")
    call.folder.make()
    open_call(call)
    rounds(call, lambda left: compute(call, most), None, lambda text: None)
    return call


def chosen(call):
    return {group.parameters["particles.volume_fraction"]: group.chosen for group in call.groups}


def test_a_sweep_refines_every_group_until_it_is_narrow(made):
    """Both volume fractions: the truth inside a bound of 5 % or less, all seeds at every amplitude, names as usual."""
    call = one_call(made)
    given = len(resolve(read_sweep(made)))
    assert len(call.points) == given + 3 * sum(map(len, chosen(call).values())) and not call.left
    for group in call.groups:
        truth = CRITICAL[group.parameters["particles.volume_fraction"]]
        assert group.verdict["narrow"] and group.verdict["low"] < truth < group.verdict["high"]
        assert group.verdict["width"] <= 0.05 and 1 <= len(group.chosen) <= 9
    for point in call.points[given:]:
        gamma0 = point.config.flow.amplitude
        assert f"gamma0-{gamma0:g}_seed-{point.seed}" in point.name and call.places[point.key].name == point.name


def test_repeated_stopped_and_forgetful_calls_choose_the_same(made, tmp_path):
    """Stopped after every fifth point, or with the manifest removed at the end: the same amplitudes as in one go."""
    whole = one_call(made)
    again = prepare(made, tmp_path / "runs")
    assert not again.left and not refinable(again) and chosen(again) == chosen(whole)
    assert [p.name for p in again.points] == [p.name for p in whole.points]
    (tmp_path / "runs/sweep.json").unlink()
    assert chosen(one_call(made)) == chosen(whole)
    shutil.rmtree(tmp_path / "runs")
    for _ in range(100):
        try:
            stopped = one_call(made, most=5)
            break
        except Interrupted:
            continue
    assert chosen(stopped) == chosen(whole)


def test_a_group_with_failed_points_waits_and_the_other_goes_on(made):
    """Points that failed for good hold up their own group only; the failure is raised when the rest is done."""

    def failing(call):
        rest = [p for p in call.left if "phi-0.2_gamma0-1_" not in p.name]
        failed = [p for p in call.left if p not in rest]
        call.left = rest
        compute(call)
        call.left = [*rest, *failed]
        raise NumericalError("3 of 48 points failed for good")

    call = prepare(made, made.parent / "runs")
    call.folder.make()
    open_call(call)
    with pytest.raises(NumericalError, match="failed for good"):
        rounds(call, lambda left: failing(call), None, lambda text: None)
    assert chosen(call)[0.2] == [] and len(chosen(call)[0.4]) >= 1 and "not examined yet" in group_lines(call)[0]


def test_added_points_are_seen_everywhere(made, tmp_path):
    """Status of folder and file, the lines of a dry run, one point by number, the table: the same points and bounds."""
    call = one_call(made)
    by_file, by_folder = sweep_status(made, tmp_path / "runs"), sweep_status(tmp_path / "runs")
    assert by_file["points"] == by_folder["points"] and by_file["adaptive"] == by_folder["adaptive"]
    assert sum(point["chosen"] for point in by_folder["points"]) == 3 * sum(map(len, chosen(call).values()))
    text = "\n".join(status_lines(by_folder))
    verdict = call.groups[1].verdict
    line = f"particles.volume_fraction 0.4: critical flow.amplitude ({verdict['low']:.4g}, {verdict['high']:.4g})"
    assert line in text and line in "\n".join(group_lines(call)) and "as narrow as asked" in text
    assert pick(prepare(made, tmp_path / "runs"), str(len(call.points))).points[0].name == call.points[-1].name
    from suspend.sweep.collect import collect

    rows = collect(tmp_path / "runs")
    assert {row["added"] for row in rows} == {"true", "false"} and len(rows) == len(call.points)
    assert {row["gamma_c_low[-]"] for row in rows} == {group.verdict["low"] for group in call.groups}


def test_what_is_asked_may_change(made):
    """A wider bound than is there ends at once; more points go on from those that were chosen."""
    written(made.parent, FILE.replace("points: 9", "points: 1"))
    first = one_call(made)
    assert all(len(values) == 1 for values in chosen(first).values())
    assert "most points are reached" in group_lines(first)[0]
    written(made.parent, FILE)
    more = one_call(made)
    assert all(more_values[:1] == chosen(first)[phi] for phi, more_values in chosen(more).items())
    written(made.parent, FILE.replace("width: 0.05", "width: 0.5"))
    assert chosen(one_call(made)) == chosen(more)


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("adaptive: yes", r"s.yaml:\d+: adaptive: found .*; must be a section of keys: key, width, points, signatures"),
        ("adaptive: {witdh: 0.05}", "adaptive.witdh: unknown key; did you mean width"),
        ("adaptive: {width: 5 %}", r"adaptive.width: found '?5 %'?; must be a number from 0.005 to 1: 0.05 for 5 %"),
        ("adaptive: {points: 0}", "adaptive.points: found 0; must be an integer from 1"),
        ("adaptive: {signatures: [viscosity]}", "adaptive.signatures: found .*a list, each once, of eta_r_prime"),
        ("adaptive: {signatures: D_cyc}", "must be a list"),
        ("adaptive: {key: flow.amplitud}", "adaptive.key: found .*such as flow.amplitude"),
        ("adaptive: {key: particles.number}", "that holds a number"),
        ("adaptive: {key: tolerance}", "tolerance is not varied; give 3 or more values"),
    ],
)
def test_malformed_sections(tmp_path, text, expected):
    """One clear error each, with place and remedy."""
    file = written(tmp_path, FILE.replace("adaptive: {width: 0.05, points: 9}", text))
    with pytest.raises(ConfigurationError, match=expected):
        read_sweep(file)


def test_too_few_or_zipped_amplitudes(tmp_path):
    """Two amplitudes bracket nothing; amplitudes zipped to another key cannot be added alone."""
    few = BASE + "vary: {flow.amplitude: [0.3, 0.6]}\nadaptive: {}\n"
    with pytest.raises(ConfigurationError, match=r"has 2 value\(s\) in vary; 3 or more"):
        read_sweep(written(tmp_path, few))
    zipped = BASE + "zip: [{flow.amplitude: [1, 2, 3], output.samples_per_cycle: [32, 64, 64]}]\nadaptive: {}\n"
    with pytest.raises(ConfigurationError, match="zipped to other keys"):
        read_sweep(written(tmp_path, zipped))


def test_the_command(tmp_path):
    """Real runs: what they say is printed once, kept, in --dry-run, status and the table; then nothing is left."""
    text = BASE + "vary: {flow.amplitude: [0.3, 0.6, 0.9]}\nadaptive: {points: 1, signatures: [eta_r_prime]}\n"
    written(tmp_path, text)
    done = sweep(tmp_path, "s.yaml")
    assert done.returncode == 0 and "all points: critical flow.amplitude" in done.stderr, done.stderr
    again = sweep(tmp_path, "s.yaml")
    assert (again.returncode, again.stdout, again.stderr) == (0, "", "")
    found = json.loads(sweep(tmp_path, "status", "runs/s", "--json").stdout)
    added = [point for point in found["points"] if point["chosen"]]
    assert len(found["points"]) == 3 + len(added) == 3 + len(found["adaptive"][0]["chosen"])
    assert "critical flow.amplitude" in sweep(tmp_path, "s.yaml", "--dry-run").stdout
    rows = list(csv.DictReader(sweep(tmp_path, "collect", "s.yaml").stdout.splitlines()))
    assert len(rows) == len(found["points"]) and "gamma_c_low[-]" in rows[0]
