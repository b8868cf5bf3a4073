"""Runs whose files contradict themselves: one clear error each, and never the end of a report on many."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys

import h5py
import numpy as np
import pytest
from io_records import CONFIG, META, final_frame, record, state
from synthetic_runs import configuration, oscillatory_record, stress, write_run

from suspend.analysis.collection import Collection
from suspend.analysis.summary import analyze
from suspend.errors import StorageError
from suspend.export import export
from suspend.figures.runs import open_runs
from suspend.io import Run, RunStore, describe
from suspend.report import write_report
from suspend_cli.main import main

FLOW = {"type": "oscillatory", "amplitude": 0.8}
SCALES = {"gamma0": 0.8, "omega": 1.0, "phase": 0.0, "viscosity": 2.0}
PARTS = {
    "hydrodynamic": lambda theta: stress(2.0 * np.cos(theta)),
    "interparticle": lambda theta: stress(0.1 * np.sin(theta)),
}
PLACES = np.arange(12.0).reshape(4, 3)
SHEAR, POSITION = "rheology/stress_hydrodynamic/value", "particles/spheres/position/value"
COMMANDS = (("info",), ("analyze",), ("report", "-o", "page.html"), ("export", "-o", "out.csv"))


def sound_run(path, cycles=4):
    """A finished run that all commands can read."""
    records = [oscillatory_record(k, SCALES, PARTS, unwrapped=PLACES + 0.1 * k) for k in range(cycles)]
    return write_run(path, configuration(FLOW, {"cycles": cycles}), records, PLACES + 0.1 * cycles)


def put(name, change):
    """Damage that replaces the values of a dataset."""

    def damage(file):
        values = change(file[name][:])
        del file[name]
        file[name] = values

    return damage


def shortened(name, rows):
    return lambda file: file[name].resize(len(file[name]) - rows, axis=0)


def edge(value):
    return lambda file: file["parameters/meta"].attrs.__setitem__("L", value)


def without(name):
    return lambda file: file.__delitem__(name)


def elsewhere(file):
    """The configuration in another file, as an external link."""
    with h5py.File(file.filename + ".other", "w") as other:
        other["configuration"] = file["parameters/configuration"][()]
    del file["parameters/configuration"]
    file["parameters/configuration"] = h5py.ExternalLink(file.filename + ".other", "configuration")


def external_data(file):
    """The stress in a raw file beside it."""
    shape = file[SHEAR].shape
    del file[SHEAR]
    raw = [(file.filename + ".raw", 0, h5py.h5f.UNLIMITED)]
    file.create_dataset(SHEAR, shape, "f8", external=raw)


def a_group(name):
    def damage(file):
        del file[name]
        file.create_group(name)

    return damage


def bumped(values):
    values[1] += 1
    return values


DAMAGES = {
    "sample_end too large": (put("cycles/sample_end", lambda v: v + 5), "rows instead of"),
    "sample_end not increasing": (put("cycles/sample_end", lambda v: v[::-1]), "rows of its own|rows instead of"),
    "sample_end shifted": (put("cycles/sample_end", bumped), "belongs to cycle 2, by cycles/sample_end to cycle 1"),
    "frame_end too large": (put("cycles/frame_end", lambda v: v + 2), "frames of positions"),
    "frame_end shifted": (put("cycles/frame_end", lambda v: np.array([2, 3, 4, 5])), "belongs to cycle"),
    "cycle numbers": (put("cycles/index", lambda v: v + 1), "row 0 of cycles/index is cycle 1"),
    "cycle doubled": (put("cycles/index", lambda v: np.array([0, 1, 1, 3])), "row 2 of cycles/index is cycle 1"),
    "incomplete within": (put("cycles/complete", lambda v: np.array([1, 0, 1, 1], bool)), "others follow it"),
    "sample's cycle": (put("rheology/cycle/value", lambda v: v[::-1]), "belongs to cycle 3"),
    "frame's cycle": (put("observables/cycle/value", lambda v: v + 1), "belongs to cycle 1"),
    "stress too short": (shortened(SHEAR, 7), "rows instead of 256"),
    "positions too short": (shortened(POSITION, 2), "rows instead of 5"),
    "stress is text": (put(SHEAR, lambda v: np.full(v.shape, b"x")), "type"),
    "stress is complex": (put(SHEAR, lambda v: v + 1j), "type complex128"),
    "stress of five": (put(SHEAR, lambda v: v[:, :5]), "5 values instead of 6 values"),
    "stress flat": (put(SHEAR, lambda v: v[:, 0]), "1 values instead of 6 values"),
    "stress missing": (without("rheology/stress_hydrodynamic"), "stress_hydrodynamic is missing"),
    "fluid missing": (without("rheology/stress_fluid"), "stress_fluid is missing"),
    "strain missing": (without("rheology/strain"), "rheology/strain is missing"),
    "value missing": (without(SHEAR), "damaged"),
    "positions missing": (without("particles/spheres/image"), "image is missing"),
    "statistics too short": (put("cycles/statistics/overlaps", lambda v: v[:2]), "2 rows instead of 4"),
    "positions of three": (put(POSITION, lambda v: v[:, :3]), "3 x 3 values instead of 4 x 3 values"),
    "L nan": (edge(float("nan")), "L of the cell nan"),
    "L negative": (edge(-30.0), "L of the cell -30"),
    "L infinite": (edge(float("inf")), "L of the cell nan"),
    "L zero": (edge(0.0), "L of the cell 0"),
    "L another": (edge(31.0), "L is 31, but the cell"),
    "L text": (edge("wide"), "damaged"),
    "number zero": (lambda file: file["parameters/meta"].attrs.__setitem__("number", 0), "number of spheres is 0"),
    "number another": (lambda file: file["parameters/meta"].attrs.__setitem__("number", 5), "instead of 5 x 3"),
    "radius text": (lambda file: file["parameters/meta"].attrs.__setitem__("radius", "x"), "damaged"),
    "radius nan": (lambda file: file["parameters/meta"].attrs.__setitem__("radius", np.nan), "radius is nan"),
    "overlaps nan": (put("cycles/statistics/overlaps", lambda v: v * np.nan), "has the type float64"),
    "configuration elsewhere": (elsewhere, "parameters/configuration lies in another file"),
    "stress elsewhere": (external_data, "lie in another file"),
    "configuration a group": (a_group("parameters/configuration"), "damaged"),
    "stress a group": (a_group(SHEAR), "damaged"),
}
CONFIGURATIONS = {
    "viscosity nan": ("viscosity: 2.0", "viscosity: .nan"),
    "viscosity negative": ("viscosity: 2.0", "viscosity: -2.0"),
    "seed text": ("seed: 1\n", "seed: many\n"),
    "section": ("solver:\n", "solver: 3\nother:\n"),
}


def damaged(path, name):
    sound_run(path)
    with h5py.File(path / "trajectory.h5", "r+") as file:
        DAMAGES[name][0](file)
    return path


@pytest.mark.parametrize("name", DAMAGES)
def test_damage_is_one_clear_error(tmp_path, name):
    """Whatever reads the run alone raises a StorageError that names the run and what is wrong."""
    path = damaged(tmp_path / "run", name)
    for reading in (
        analyze,
        lambda p: Collection().compute(p),
        lambda p: write_report([p], tmp_path / "page.html"),
        lambda p: export(p, tmp_path / "out.csv"),
    ):
        with pytest.raises(Exception, match=DAMAGES[name][1]) as caught:
            reading(path)
        assert caught.type.__module__ == "suspend.errors" and str(path) in str(caught.value)
    assert "stress" in name or "fluid" in name or isinstance(caught.value, StorageError)


@pytest.mark.parametrize("name", [*DAMAGES, *CONFIGURATIONS])
def test_one_damaged_run_does_not_hide_the_others(tmp_path, name, monkeypatch):
    """Report, collection and figures of a sound, the damaged and a sound run: both sound ones, and the reason."""
    monkeypatch.setattr("suspend.report.write.figures_of", lambda run: [])
    sound_run(tmp_path / "a"), sound_run(tmp_path / "c")
    if name in DAMAGES:
        damaged(tmp_path / "b", name)
    else:
        old, new = CONFIGURATIONS[name]
        text = configuration(FLOW, {"cycles": 4})
        assert old in text
        records = [oscillatory_record(k, SCALES, PARTS, unwrapped=PLACES + 0.1 * k) for k in range(4)]
        write_run(tmp_path / "b", text.replace(old, new), records)
    paths = [tmp_path / letter for letter in "abc"]
    noted = write_report(paths, tmp_path / "page.html")
    page = (tmp_path / "page.html").read_text()
    assert page.count('<section class="run"') == (3 if name == "seed text" else 2)
    assert noted == [] if name == "seed text" else len(noted) == 1 and str(paths[1]) in noted[0] and "Not read" in page
    collection = Collection().compute(paths)
    assert len(collection) == (3 if name == "section" and len(collection) == 3 else 2)
    assert any(str(paths[1]) in note for note in collection.notes)
    assert len(open_runs(paths)) in (2, 3)


def stopped_within_a_cycle(path):
    """Two cycles done, five samples into the third."""
    with RunStore.create(path, CONFIG, META) as store:
        for k in range(2):
            store.append_cycle(record(k))
            store.save(state(k + 1))
        begun = record(2, n=5)
        rows = {name: begun[name] for name in ("time", "strain", "rate", "phase", "stress_fluid")}
        store.save(state(2), {"index": 2, "rows": rows})


def test_a_run_stopped_within_a_cycle_is_described(tmp_path, capsys):
    """`suspend info` says how many samples of the begun cycle the checkpoint holds: five, or none at its start."""
    stopped_within_a_cycle(tmp_path / "run")
    assert describe(tmp_path / "run")["checkpoint"] == {"cycles": 2, "partial_samples": 5}
    with pytest.raises(SystemExit) as left:
        main(["info", str(tmp_path / "run"), "--json"])
    assert left.value.code == 0
    assert json.loads(capsys.readouterr().out)["checkpoint"]["partial_samples"] == 5
    with RunStore.open(tmp_path / "run") as store:
        store.save(state(2), {"index": 2, "rows": {}})
    assert describe(tmp_path / "run")["checkpoint"]["partial_samples"] == 0


def test_a_run_really_stopped_within_a_cycle_is_reported(tmp_path):
    """The simulation's own checkpoint in the midst of a cycle: info and report read it."""
    from suspend.config import from_dict
    from suspend.errors import Interrupted
    from suspend.simulation import run

    particles = {"number": 4, "volume_fraction": 0.1}
    config = from_dict({"particles": particles, "flow": FLOW, "far_field": "self", "duration": {"cycles": 100000}})
    for _ in range(3):  # after a step each
        with pytest.raises(Interrupted):
            run(config, tmp_path / "run", max_time=0.0)
    checkpoint = describe(tmp_path / "run")["checkpoint"]
    assert set(checkpoint) == {"cycles", "partial_samples"} and checkpoint["partial_samples"] >= 0
    assert write_report([tmp_path / "run"], tmp_path / "page.html") == []


@pytest.mark.parametrize("made", [0, 1, 3])
def test_sound_files_pass(tmp_path, made):
    """No cycles, with and without the final frame, an incomplete last cycle, series of every sphere: none refused."""
    with RunStore.create(tmp_path / "run", CONFIG, META, interval=0.0) as store:
        store.save(state(0))
        for k in range(made):
            store.append_cycle(record(k, complete=k < 2, particle_stress=True, flow_driven=True))
            store.save(state(k + 1))
            with Run(tmp_path / "run") as run:
                assert run.stored == k + 1
        frame = final_frame(made) | ({"frame_phase": np.array([0.75])} if made == 3 else {})
        store.finish(state(made), frame)
    with Run(tmp_path / "run") as run:
        assert run.stored == made and run.n_frames == 2 * made + 1


@pytest.mark.parametrize("command", COMMANDS, ids=lambda c: c[0])
@pytest.mark.parametrize("name", ["sample_end too large", "L nan", "stress is text", "configuration elsewhere"])
def test_commands_end_in_one_line(tmp_path, monkeypatch, capsys, command, name):
    """Exit code 4, one line on stderr, no traceback."""
    monkeypatch.chdir(tmp_path)
    damaged(tmp_path / "run", name)
    with pytest.raises(SystemExit) as left:
        main([command[0], "run", *command[1:]])
    captured = capsys.readouterr()
    assert left.value.code == 4
    assert captured.err.startswith("Error: run") and captured.err.count("\n") == 1


@pytest.mark.parametrize("many", [False, True])
def test_folder_names_that_are_no_text(tmp_path, many):
    """A folder named by a byte that is no UTF-8: every command does its work, in a strict UTF-8 terminal."""
    odd = os.fsdecode(os.fsencode(tmp_path) + b"/run\xff")
    shutil.move(sound_run(tmp_path / "made"), odd)
    paths = [odd, str(sound_run(tmp_path / "a"))] if many else [odd]
    tasks = [("analyze", *paths), ("analyze", *paths, "--csv", "a.csv"), ("report", *paths, "-o", "page.html")]
    tasks += [("analyze", *paths, "--json"), ("plot", "viscosity-evolution", odd, "-o", "figure.png")]
    tasks += [("info", odd), ("export", odd, "-o", "out.csv"), ("export", odd, "-o", odd + "/end.xyz")]
    for task in tasks:
        done = subprocess.run(
            [sys.executable, "-m", "suspend_cli", *task],
            cwd=tmp_path,
            env=os.environ | {"PYTHONIOENCODING": "utf-8:strict"},
            capture_output=True,
        )
        assert done.returncode == 0, (task, done.stderr.decode(errors="replace"))
    assert b"run\\udcff" in (tmp_path / "page.html").read_bytes()
