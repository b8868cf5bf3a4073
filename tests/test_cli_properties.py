"""The command `suspend properties`: what it prints and writes, and how it refuses."""

import csv
import json
import subprocess
import sys

import numpy as np
import pytest

from suspend_cli.main import main

QUICK = ("--phi", "0.2", "--number", "20", "--configurations", "2", "--far-field", "self", "--probes", "2")


def call(*arguments):
    """The command in this process; returns its exit code."""
    with pytest.raises(SystemExit) as stop:
        main(["properties", *map(str, arguments)])
    return stop.value.code


def test_table_on_the_screen(capsys):
    assert call(*QUICK) == 0
    printed = capsys.readouterr()
    rows = [line for line in printed.out.splitlines() if line[:1].strip()]
    for name in ("eta_inf/eta0", "D_s/D0", "D_r/D0", "U/U0"):
        assert any(line.startswith(name) for line in rows)
    assert "random packings: 2 x 20 spheres, volume fraction 0.2" in printed.out
    assert "configuration 2 of 2" in printed.err
    assert max(map(len, printed.out.splitlines())) <= 100


def test_json_and_csv_hold_the_same(tmp_path, capsys):
    assert call(*QUICK, "--json", "--quiet", "--output", tmp_path / "table.csv") == 0
    printed = json.loads(capsys.readouterr().out)
    with open(tmp_path / "table.csv", encoding="utf-8") as file:
        rows = {row["property"]: row for row in csv.DictReader(file)}
    assert set(rows) == set(printed["properties"]) == {"eta_inf", "D_s", "D_r", "U"}
    for name, values in printed["properties"].items():
        assert float(rows[name]["value"]) == values["value"]
        assert rows[name]["corrected"] == "" and values["corrected"] is None
        assert len(values["samples"]) == 2
    assert call(*QUICK, "--quiet", "--output", tmp_path / "all.json") == 0
    assert json.loads((tmp_path / "all.json").read_text(encoding="utf-8")) == printed


def test_same_seed_same_numbers(capsys):
    outputs = []
    for seed in (3, 3, 4):
        assert call(*QUICK, "--json", "--quiet", "--seed", seed) == 0
        outputs.append(capsys.readouterr().out)
    assert outputs[0] == outputs[1] != outputs[2]


def test_one_configuration_of_a_file(tmp_path, capsys):
    """Lengths are divided by the file's radius; exact traces for few spheres; one configuration has no error."""
    positions = np.array([[0.0, 0.0, 0.0], [4.3, 0.0, 0.0], [0.0, 5.0, 1.0]])
    np.savez(tmp_path / "a.npz", positions=positions, L=16.0, shift=3.0, radius=2.0)
    np.savez(tmp_path / "b.npz", positions=positions / 2.0, L=8.0, shift=1.5)
    found = []
    for name in ("a.npz", "b.npz"):
        assert call(tmp_path / name, "--far-field", "self", "--json") == 0
        found.append(json.loads(capsys.readouterr().out))
    assert found[0]["properties"] == found[1]["properties"]
    assert found[0]["probes"] == 0 and found[0]["properties"]["D_s"]["error"] is None
    assert found[0]["volume_fraction"] == pytest.approx(3 * 4.0 / 3.0 * np.pi / 8.0**3)


def test_configuration_file_decides(tmp_path, capsys):
    """Number, phi, seed, far field and lubrication of the YAML; options change the method."""
    path = tmp_path / "c.yaml"
    path.write_text(
        "seed: 5\nparticles: {number: 15, volume_fraction: 0.1}\nflow: {type: steady}\nduration: {strain: 1}\n"
        "lubrication: {cutoff: 3.0}\n"
    )
    assert call(path, "--json", "--configurations", 2, "--probes", 2) == 0
    found = json.loads(capsys.readouterr().out)
    assert (found["number"], found["far_field"], found["lubrication"]) == (15, "self", True)
    assert found["volume_fraction"] == pytest.approx(0.1)
    assert call(path, "--json", "--configurations", 2, "--probes", 2, "--no-lubrication") == 0
    alone = json.loads(capsys.readouterr().out)
    assert alone["properties"]["D_s"]["value"] == pytest.approx(1.0, rel=1e-12)
    assert found["properties"]["D_s"]["value"] < 0.999


def test_far_field_is_the_default_without_a_yaml(capsys):
    assert call("--phi", "0.05", "--number", "3", "--configurations", "1", "--json", "--accuracy", "1e-2") == 0
    found = json.loads(capsys.readouterr().out)
    assert found["far_field"] == "ewald" and found["finite_size_shift"] > 0.0
    difference = found["properties"]["D_s"]["corrected"] - found["properties"]["D_s"]["value"]
    assert difference == pytest.approx(found["finite_size_shift"])


@pytest.mark.parametrize(
    ("arguments", "code", "found"),
    [
        ([], 2, "give --phi for random packings, or a file"),
        (["--phi", "0.7"], 2, "0.7 is not in the range"),
        (["--phi", "0.1", "--number", "0"], 2, "0 is not in the range"),
        (["--phi", "0.1", "--probes", "1"], 2, "1 is not in the range"),
        (["--phi", "0.1", "--accuracy", "1e-12"], 2, "found 1e-12; must be a number from 1e-10"),
        (["--phi", "0.1", "--output", "a.txt"], 2, "must end in .json, .csv"),
        (["--phi", "0.1", "--set", "lubrication.cutof=3"], 2, "did you mean cutoff?"),
        (["scene.npz", "--phi", "0.1"], 2, "--phi: is for random packings without a file"),
        (["scene.npz", "--configurations", "3"], 2, "holds one configuration"),
        (["touching.npz", "--far-field", "self"], 2, "touch or overlap"),
        (["missing.npz"], 4, "no such file"),
        (["missing.yaml"], 2, "no such file"),
    ],
)
def test_wrong_use(arguments, code, found, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    np.savez("scene.npz", positions=np.zeros((1, 3)), L=8.0)
    np.savez("touching.npz", positions=np.array([[0.0, 0.0, 0.0], [2.0, 0.0, 0.0]]), L=8.0)
    assert call(*arguments) == code
    printed = capsys.readouterr()
    assert found in printed.err and printed.out == ""
    assert sorted(p.name for p in tmp_path.iterdir()) == ["scene.npz", "touching.npz"]


def test_help_has_examples():
    command = [sys.executable, "-m", "suspend_cli", "properties", "--help"]
    result = subprocess.run(command, capture_output=True, text=True, check=True)
    assert "Examples:" in result.stdout and "suspend properties --phi 0.4" in result.stdout
    assert max(map(len, result.stdout.splitlines())) <= 100
