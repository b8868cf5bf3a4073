"""Results of sweeps: which points are taken, averages over seeds, groups, figures and `analyze` from a sweep."""

from __future__ import annotations

import csv
import json
import math
import shutil

import numpy as np
import pytest
from synthetic_sweeps import make_sweep, sweep_text

from suspend.errors import ConfigurationError
from suspend.figures.amplitude import curves_by, curves_of
from suspend.figures.groups import error_entry, far_field_entries, group_entries, marker_style
from suspend.figures.make import make_figure
from suspend.figures.runs import open_runs
from suspend.figures.style import journal
from suspend.sweep.runs import is_sweep, select_runs
from suspend_cli.main import main

AMPLITUDES = [0.4, 0.8, 1.2]
BAD = "the step size fell <below> 1e-9 & stopped"


def state_of(point):
    """One point failed, one is interrupted, one has not begun; all of the near field."""
    where = (point.config.far_field, point.config.flow.amplitude, point.seed)
    return {("self", 0.4, 3): BAD, ("self", 0.8, 2): "interrupted", ("self", 1.2, 1): "waiting"}.get(where, "")


@pytest.fixture(scope="module")
def swept(tmp_path_factory):
    """The folder with s.yaml and runs/s: three amplitudes, near field with three seeds, far field with one."""
    folder = tmp_path_factory.mktemp("swept")
    blocks = [{"set": {"far_field": "self"}, "seeds": 3}, {"set": {"far_field": "ewald"}, "seeds": 1}]
    make_sweep(folder, sweep_text({"flow.amplitude": AMPLITUDES}, runs=blocks), state_of)
    return folder


@pytest.fixture(autouse=True)
def here(swept, monkeypatch):
    """Sweeps are called from the folder of their file."""
    monkeypatch.chdir(swept)


def call(capsys, *arguments):
    with pytest.raises(SystemExit) as stopped:
        main([*map(str, arguments)])
    out, err = capsys.readouterr()
    return stopped.value.code, out, err


def columns(path):
    with path.open(newline="") as file:
        rows = list(csv.DictReader(file))
    return {name: np.array([row[name] for row in rows]) for name in rows[0]}


@pytest.mark.parametrize("given", ["runs/s", "s.yaml"])
def test_complete_points_are_taken_and_the_others_named(given):
    """Nine complete runs by folder or file; the failed one with its message, the others by state."""
    found = select_runs([given])
    assert len(found.runs) == 9 and len(found.sweeps) == 1 and not any("seed-2" in r and "0.8" in r for r in found.runs)
    failed, going, waiting = (next(n for n in found.notes if word in n) for word in ("failed", "interr", "not begun"))
    assert BAD in failed and "gamma0-0.4" in failed and "gamma0-0.8" in going and "1 of 10" in going
    assert "gamma0-1.2" in waiting


def test_a_folder_of_runs_is_no_sweep(tmp_path, swept):
    """Paths that are no sweep go through as they are, also beside one; a YAML file of something else is refused."""
    assert not is_sweep(tmp_path) and not is_sweep("runs") and is_sweep("runs/s")
    assert select_runs(["runs", "absent"]).runs == ["runs", "absent"]
    assert select_runs(["absent", "runs/s"]).runs[0] == "absent"
    both = select_runs([swept / "runs/s", "s.yaml"])
    assert len(both.sweeps) == 1 and len(both.runs) == 9
    (tmp_path / "a.yaml").write_text("seed: 1\n")
    with pytest.raises(ConfigurationError, match=r"a\.yaml"):
        select_runs([tmp_path / "a.yaml"])


def test_averages_and_errors_over_seeds_by_hand(swept, tmp_path):
    """D_cyc of every curve is NumPy's mean over the seeds, its bar std(ddof=1)/sqrt(n); alone that over the spheres.

    Round-off only: 1e-12 relative. The CSV says which error it is and how many seeds there are.
    """
    make_figure("diffusivity-amplitude", select_runs(["runs/s"]).runs, tmp_path, ["png"])
    table = columns(tmp_path / "diffusivity-amplitude.csv")
    single = {}
    for path in select_runs(["runs/s"]).runs:
        member = open_runs([path])[0]
        (curve,) = curves_by(open_runs([path]), final)
        key = (str(int(member.far_field)), member.gamma0)
        single.setdefault(key, []).append((curve.value[0], curve.error[0]))
    assert [len(v) for _, v in sorted(single.items())] == [2, 2, 2, 1, 1, 1]
    for k, (far, gamma0) in enumerate(zip(table["far_field[bool]"], table["gamma0[-]"].astype(float), strict=True)):
        values, errors = np.array(single[far, gamma0]).T
        several = len(values) > 1
        expected = values.std(ddof=1) / math.sqrt(len(values)) if several else errors[0]
        assert float(table["D_cyc[-]"][k]) == pytest.approx(values.mean(), rel=1e-12)
        assert float(table["D_cyc_error[-]"][k]) == pytest.approx(expected, rel=1e-12)
        assert table["error_over"][k] == ("seeds" if several else "spheres") and int(table["runs[-]"][k]) == len(values)


def final(path):
    from suspend.figures.diffusivity import final_diffusivity

    return final_diffusivity(path)


def test_far_field_filled_near_field_empty(swept):
    """Far field has full markers, near field white ones, of one colour at one volume fraction; the bars are named."""
    with journal():
        runs = open_runs(select_runs(["runs/s"]).runs)
        curves = curves_of(runs, "eta_r_prime")
        assert [c.far_field for c in curves] == [True, False]
        far, near = (marker_style(c, curves) for c in curves)
        assert far["markerfacecolor"] == far["color"] == near["color"] and near["markerfacecolor"] == "white"
        assert [e.get_label() for e in far_field_entries(curves)] == ["with far field", "without"]
        assert [e.get_label() for e in group_entries(curves)] == [r"$\phi = 0.4$"]
        (entry,) = error_entry(curves_by(runs, final, "spheres"))
        assert entry.get_label() == "s.e. over 2 seeds,\none: spheres"


@pytest.mark.parametrize("name", ["viscosity", "n1", "n2", "dynamics"])
def test_figures_from_the_command_line(swept, tmp_path, capsys, name):
    """Drawn from the sweep's folder; what is left out is named on stderr, stdout holds the files only."""
    code, out, err = call(capsys, "plot", name, "runs/s", "-o", f"{tmp_path}/", "--format", "png")
    assert code == 0, err
    assert all((tmp_path / line).exists() for line in out.split()) and (tmp_path / f"{name}.png").exists()
    assert BAD in err and "gamma0-0.8_far_field-self_seed-2" in err and "not begun" in err


def test_another_key_makes_groups_of_its_own(tmp_path):
    """A sweep that crosses amplitudes with another key: a group for each value, named in legend and CSV."""
    text = sweep_text({"flow.amplitude": [0.4, 0.8], "particles.initial": ["equilibrium", "quenched"]}, seeds=2)
    base = make_sweep(tmp_path / "x", text)
    runs = select_runs([base]).runs
    make_figure("thinning", runs, tmp_path, ["png"])
    table = columns(tmp_path / "thinning.csv")
    kinds = [f"particles.initial = {kind}" for kind in ("equilibrium", "quenched")]
    assert sorted(set(table["setup"])) == kinds and set(table["runs[-]"]) == {"2"} and len(table["setup"]) == 4
    with journal():
        curves = curves_of(open_runs(runs), "eta_r_prime")
        assert len({marker_style(c, curves)["color"] for c in curves}) == 2
        assert [e.get_label() for e in group_entries(curves)] == [
            f"$\\phi = 0.4$, {kind}" for kind in ("equilibrium", "quenched")
        ]


def test_analyze_a_sweep(swept, capsys):
    """The collection's table with its scatter over seeds, from the folder or the file; JSON on stdout is valid."""
    code, out, err = call(capsys, "analyze", "runs/s")
    assert code == 0 and "9 runs in 2 series" in out and "minimum of eta_r'" in out and BAD in err
    code, from_file, _ = call(capsys, "analyze", "s.yaml", "--json")
    content = json.loads(from_file)
    assert code == 0 and content["collection"]["runs"] == content["sweeps"]["runs/s"]["complete"] == 9


def test_an_unreadable_point_stops_nothing(swept, tmp_path, capsys):
    """One trajectory cut in half: named on stderr, the others analysed."""
    shutil.copytree(swept / "runs/s", tmp_path / "s")
    (broken,) = (tmp_path / "s").glob("gamma0-0.4_far_field-ewald*")
    content = (broken / "trajectory.h5").read_bytes()
    (broken / "trajectory.h5").write_bytes(content[: len(content) // 2])
    code, out, err = call(capsys, "analyze", tmp_path / "s")
    assert code == 0 and "8 runs" in out and broken.name in err


def test_a_sweep_without_complete_points(tmp_path, capsys):
    """One message with the counts and exit code 2, no file; the file of a sweep that never ran says where it looked."""
    base = make_sweep(tmp_path / "x", sweep_text({"flow.amplitude": AMPLITUDES}), lambda _: "waiting")
    for arguments in (("analyze", base), ("plot", "viscosity", base, "-o", tmp_path / "figure")):
        code, out, err = call(capsys, *arguments)
        assert code == 2 and not out and "3 waiting" in err and str(base) in err and "Traceback" not in err
    assert not list(tmp_path.glob("figure*"))
    (tmp_path / "other.yaml").write_text((tmp_path / "x" / "s.yaml").read_text())
    code, _, err = call(capsys, "analyze", tmp_path / "other.yaml")
    assert code == 2 and "runs/other" in err and "no such folder" in err


@pytest.mark.parametrize("command", [("analyze",), ("plot", "viscosity")])
def test_a_missing_path_among_several_is_named(swept, tmp_path, monkeypatch, capsys, command):
    """Exit code 4 with the path that is not there; nothing is drawn."""
    code, out, err = call(capsys, *command, "runs/s", "runs/no_such_run")
    assert code == 4 and "runs/no_such_run does not exist" in err and not out
