"""The command solve: scenes it takes, answers it writes, errors it gives."""

import json
import subprocess
import sys
from pathlib import Path

import h5py
import naive
import numpy as np
import pytest

from suspend.config import load
from suspend.flow import make_flow
from suspend.initial import prepare_initial
from suspend.oneshot import Method, PeriodicScene, mobility_problem
from suspend.scene import make_suspension
from suspend_cli.main import main

DATA = Path(__file__).parent / "data"
EDGE, SHIFT = 7.0, 1.4
POSITIONS = naive.loose_positions(6, EDGE, SHIFT / EDGE, 2)
FORCES = np.random.default_rng(4).standard_normal((6, 3))
YAML = """particles: {number: 12, volume_fraction: 0.3}
flow: {type: steady, rate: 2.5}
duration: {strain: 1}
repulsion: {force: 2.0, debye_length: 0.2}
external: {force: [0.3, 0, -0.2], torque: [0, 0.1, 0]}
tolerance: 1e-2
"""


def call(capsys, *arguments):
    """Exit code, stdout and stderr of the command in this process."""
    with pytest.raises(SystemExit) as stop:
        main(["solve", *map(str, arguments)])
    return stop.value.code, *capsys.readouterr()


def scene_file(folder, **changes):
    """An npz scene; a change to None leaves the array out."""
    arrays = {
        "positions": POSITIONS,
        "L": EDGE,
        "shift": SHIFT,
        "forces": FORCES,
        "shear_rate": 0.5,
    } | changes
    path = folder / "scene.npz"
    np.savez(path, **{name: value for name, value in arrays.items() if value is not None})
    return path


@pytest.fixture
def expected():
    """The answer for `scene_file` by the Python functions, self far field."""
    scene = PeriodicScene(POSITIONS, EDGE, SHIFT / EDGE)
    return mobility_problem(scene, FORCES, strain_rate=0.5, method=Method("self", accuracy=1e-8))


def read(path):
    """Results of an answer file, whatever its format."""
    if path.suffix == ".json":
        return json.loads(path.read_text())
    if path.suffix == ".npz":
        with np.load(path, allow_pickle=False) as archive:
            return {name: archive[name] for name in archive.files}
    with h5py.File(path) as file:
        return {name: file[name][()] for name in file}


@pytest.mark.parametrize("name", ["answer.json", "answer.npz", "answer.h5", "answer.hdf5", "UPPER.NPZ"])
def test_answers_in_every_format(name, tmp_path, capsys, expected):
    """U, Omega, stresslet, eta_r and the cost to the last bit, with the scene they belong to; nothing else is left."""
    path = scene_file(tmp_path)
    target = tmp_path / name
    code, out, err = call(
        capsys, path, "--far-field", "self", "--accuracy", "1e-8", "--output", target, "--threads", 1
    )
    assert code == 0 and f"answer written to {target}" in err
    found = read(target.rename(tmp_path / name.lower()))
    for key in ("U", "Omega", "stresslet", "eta_r"):
        assert np.array_equal(np.asarray(found[key]), getattr(expected, key))
    assert found["accuracy"] == 1e-8 and 0.0 < found["residual"] <= 1e-9
    assert found["iterations"] == expected.cost.iterations and found["seconds"] > 0.0
    assert np.array_equal(found["positions"], POSITIONS) and found["L"] == EDGE and found["shear_rate"] == 0.5
    assert found["shift"] == pytest.approx(SHIFT, rel=1e-15)
    assert sorted(p.name for p in tmp_path.iterdir()) == sorted([name.lower(), "scene.npz"])
    assert f"eta_r{expected.eta_r:>25.10g}" in out and "accuracy asked 1e-08, residual" in out


def test_what_is_printed(tmp_path, capsys, expected):
    """A table of means and ranges, JSON with --json, nothing with --quiet."""
    path = scene_file(tmp_path)
    arguments = (path, "--far-field", "self", "--accuracy", "1e-8", "--threads", 1)
    _, out, err = call(capsys, *arguments)
    row = next(line for line in out.splitlines() if line.startswith("U_x"))
    numbers = [float(word) for word in row.split()[1:]]
    u = expected.U[:, 0]
    assert numbers == pytest.approx([u.mean(), u.min(), u.max()], rel=1e-7) and err == ""
    _, out, _ = call(capsys, *arguments, "--json")
    assert json.loads(out)["U"] == expected.U.tolist()
    assert call(capsys, *arguments, "--quiet") == (0, "", "")
    _, out, _ = call(capsys, scene_file(tmp_path, shear_rate=None), *arguments[1:])
    assert "not defined without flow" in out


def test_the_default_is_the_whole_method(tmp_path, capsys):
    """An npz scene: ewald far field, shifted lubrication, 1e-6; overrides and options change each of them."""
    with np.load(DATA / "rand_N8_phi0.4.npz") as data:
        path = scene_file(
            tmp_path, positions=data["pos"], L=data["L"], shift=None, forces=data["F"], shear_rate=None
        )
        hard, none = data["lubx_mob_U"], data["nolub_mob_U"]
    found = []
    for extra in ((), ("--set", "lubrication.at_cutoff=hard"), ("--no-lubrication",)):
        code, out, _ = call(capsys, path, "--json", *extra)
        assert code == 0
        found.append(json.loads(out))
    assert [f["far_field"] for f in found] == ["ewald"] * 3 and found[0]["accuracy"] == 1e-6
    assert (found[0]["at_cutoff"], found[0]["cutoff"], found[2]["lubrication"]) == ("shifted", 4.0, False)
    assert np.array(found[1]["U"]) == pytest.approx(hard, abs=1e-6)
    assert np.array(found[2]["U"]) == pytest.approx(none, abs=1e-6)
    assert not np.allclose(found[0]["U"], hard, atol=1e-4)
    hand = ("--no-lubrication", "--set", "ewald.tolerance=1e-2", "--set", "ewald.split=gaussian")
    _, out, _ = call(capsys, path, "--json", *hand)
    error = np.abs(np.array(json.loads(out)["U"]) - none).max()
    assert 1e-7 < error < 0.05


def test_a_configuration_is_its_start(tmp_path, capsys):
    """Loads, flow and tilt of a YAML scene are those of the run's first evaluation, the stress of pair forces
    included in eta_r; its own tolerances do not count.
    """
    path = tmp_path / "scene.yaml"
    path.write_text(YAML)
    code, out, _ = call(capsys, path, "--json", "--accuracy", "1e-8", "--threads", 1)
    assert code == 0
    found = json.loads(out)
    config = load(path, ["solver.tolerance=1e-10"])
    initial, flow = prepare_initial(config), make_flow(config)
    suspension = make_suspension(config, 1, initial.length)
    velocity = suspension.evaluate(initial.positions, 0.0, initial.tilt, flow.rate(0, 0.0), 0.0)
    stress = sum(suspension.stress(velocity, flow.rate(0, 0.0)).values())
    assert np.hstack([found["U"], found["Omega"]]) == pytest.approx(velocity, rel=1e-6, abs=1e-7)
    assert found["eta_r"] == pytest.approx(stress[3], rel=1e-7)
    assert suspension.stress(velocity, 1.0)["interparticle"][3] != 0.0
    assert np.sum(found["forces"], axis=0) == pytest.approx([3.6, 0.0, -2.4])


def test_a_configuration_at_the_turning_point_has_no_viscosity(tmp_path, capsys):
    """cos(pi/2) is 6e-17 in floating point, no flow to divide by."""
    path = tmp_path / "scene.yaml"
    text = YAML.replace(
        "{type: steady, rate: 2.5}", "{type: oscillatory, amplitude: 1, phase: 1.5707963267948966}"
    )
    path.write_text(text)
    _, out, _ = call(capsys, path, "--json")
    assert json.loads(out)["shear_rate"] == 0.0 and json.loads(out)["eta_r"] is None


def test_options_go_before_the_file(tmp_path, capsys):
    """--far-field and --no-lubrication replace what the configuration says, its ewald section with it."""
    path = tmp_path / "scene.yaml"
    path.write_text(YAML + "far_field: ewald\newald: {tolerance: 1e-4}\nsolver: {far_tolerance: 1e-4}\n")
    code, out, _ = call(capsys, path, "--json", "--far-field", "self", "--no-lubrication")
    found = json.loads(out)
    assert (code, found["far_field"], found["lubrication"], found["cutoff"]) == (0, "self", False, None)
    code, _, err = call(capsys, path, "--far-field", "self", "--set", "ewald.support=6")
    assert code == 2 and "far_field is self, must be ewald" in err


def test_arrays_that_are_not_used_are_named(tmp_path, capsys):
    code, _, err = call(capsys, scene_file(tmp_path, mingap=0.1, source="x"), "--far-field", "self")
    assert code == 0 and "not used: mingap, source" in err


def test_tilt_and_radius_may_be_given(tmp_path, capsys, expected):
    """A file for particles.initial, which may hold tilt in place of shift and radius 1, is a scene."""
    path = scene_file(tmp_path, shift=None, tilt=SHIFT / EDGE, radius=np.ones(6))
    _, out, _ = call(capsys, path, "--far-field", "self", "--accuracy", "1e-8", "--json", "--threads", 1)
    assert json.loads(out)["U"] == expected.U.tolist()


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"positions": np.zeros((0, 3))}, "positions: hold no spheres"),
        ({"positions": np.zeros((6, 2))}, "positions: has shape (6, 2)"),
        (
            {"positions": np.full((6, 3), np.nan)},
            "positions: 18 entries are not finite, the first of sphere 0",
        ),
        ({"positions": np.array([["a"] * 3])}, "positions: is of type"),
        (
            {"positions": POSITIONS[[0, 1, 2, 3, 4, 0]]},
            "spheres 0 and 5 (counted from 0) are at the same place",
        ),
        ({"positions": POSITIONS[:5], "forces": FORCES}, "forces: has shape (6, 3), must be (5, 3)"),
        ({"L": None}, "no array 'L' (found positions, shift, forces, shear_rate); needed are"),
        ({"positions": None, "pos": POSITIONS}, "no array 'positions'"),
        ({"L": -1.0}, "must be > 0"),
        ({"L": [1.0, 2.0]}, "L: has shape (2,), must be one number"),
        ({"shift": EDGE}, "shift: found 7; must be >= 0 and < L = 7"),
        ({"shift": -0.1}, "shift: found -0.1"),
        ({"tilt": 0.1}, "holds both tilt and shift"),
        ({"forces": None, "force": FORCES}, "force: unknown array; did you mean forces?"),
        ({"torques": np.zeros((6, 2))}, "torques: has shape (6, 2), must be (6, 3)"),
        ({"shear_rate": np.inf}, "shear_rate: 1 entries are not finite"),
        ({"radius": 2.0}, "radius: must be 1: lengths are in sphere radii"),
        ({"a": 0.5}, "a: must be 1"),
    ],
)
def test_malformed_scenes_exit_2(changes, message, tmp_path, capsys):
    code, out, err = call(capsys, scene_file(tmp_path, **changes))
    assert (code, out) == (2, "") and err.startswith("Error: ") and message in err and "Traceback" not in err


def test_overlap_names_the_pair_and_the_gap(tmp_path, capsys):
    """Spheres 2 and 4 at distance 1.9 through the tilted upper image: refused with lubrication, solved without."""
    positions = POSITIONS.copy()
    positions[4] = positions[2] + [1.9 + SHIFT, EDGE, 0.0]
    path = scene_file(tmp_path, positions=positions)
    code, _, err = call(capsys, path)
    assert code == 2 and "spheres 2 and 4 (counted from 0) touch or overlap, gap -0.1 radii" in err
    assert call(capsys, path, "--no-lubrication", "--far-field", "self", "--quiet")[0] == 0


@pytest.mark.parametrize(
    ("arguments", "code", "message"),
    [
        (["--output", "a.txt"], 2, "unknown kind of file '.txt'; known are .json, .npz, .h5, .hdf5"),
        (["--output", "a"], 2, "unknown kind of file ''"),
        (["--output", "missing/a.json"], 4, "there is no folder missing"),
        (["--accuracy", "1e-11"], 2, "must be a number from 1e-10 (finer is lost in round-off)"),
        (["--accuracy", "nan"], 2, "found nan; must be a number"),
        (["--accuracy", "high"], 2, "found high; must be a number"),
        (["--far-field", "fts"], 2, "'fts' is not one of"),
        (["--set", "tolerance=1e-3"], 2, "--accuracy"),
        (["--set", "particles.number=3"], 2, "has no part in a scene of arrays"),
        (["--set", "lubrication.cutof=3"], 2, "did you mean cutoff?"),
        (["--set", "far_field=self", "--set", "ewald.support=6"], 2, "far_field is self, must be ewald"),
        (
            ["--far-field", "self", "--set", "solver.max_iterations=1", "--accuracy", "1e-10"],
            3,
            "did not converge",
        ),
    ],
)
def test_wrong_use(arguments, code, message, tmp_path, capsys, monkeypatch):
    monkeypatch.chdir(tmp_path)
    found, out, err = call(capsys, scene_file(tmp_path), *arguments)
    assert (found, out) == (code, "") and message in err and "Traceback" not in err
    assert [path.name for path in tmp_path.iterdir()] == ["scene.npz"]


def test_files_that_cannot_be_used(tmp_path, capsys):
    """No such npz and what is no archive: 4. A missing YAML and a folder: 2, as for the other commands."""
    (tmp_path / "bad.npz").write_text("no archive")
    np.savez(tmp_path / "object.npz", positions=np.array([{}]), L=6.0)
    whole = scene_file(tmp_path).read_bytes()
    (tmp_path / "cut.npz").write_bytes(whole[: len(whole) // 2])
    for name in ("missing.npz", "bad.npz", "object.npz", "cut.npz"):
        code, out, err = call(capsys, tmp_path / name)
        assert (code, out) == (4, "") and str(tmp_path / name) in err and "Traceback" not in err
    for name in ("missing.yaml", "."):
        assert call(capsys, tmp_path / name)[0] == 2


def test_without_far_field_no_transform_is_imported(tmp_path):
    """With self neither pyfftw nor the Ewald package exists in the process."""
    path = scene_file(tmp_path)
    code = (
        "import sys\nfrom suspend_cli.main import main\n"
        f"try:\n  main(['solve', {str(path)!r}, '--far-field', 'self', '--quiet'])\nexcept SystemExit: pass\n"
        "print([n for n in sys.modules if n == 'pyfftw' or n.startswith('suspend.hydro.ewald')])"
    )
    printed = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout
    assert printed.splitlines()[-1] == "[]"


def test_help():
    result = subprocess.run(
        [sys.executable, "-m", "suspend_cli", "solve", "--help"], capture_output=True, text=True, check=True
    )
    assert "Examples:" in result.stdout and "suspend solve scene.npz" in result.stdout
    assert max(map(len, result.stdout.splitlines())) <= 100


def test_an_empty_radius_is_refused(tmp_path):
    """An array without an entry says nothing about the radius: an error, not a radius of 1 in silence."""
    from suspend.errors import ConfigurationError
    from suspend.oneshot.problem_files import read_problem

    np.savez(tmp_path / "a.npz", positions=np.ones((1, 3)), L=9.0, radius=np.array([]))
    with pytest.raises(ConfigurationError, match="radius: must be 1"):
        read_problem(tmp_path / "a.npz")
