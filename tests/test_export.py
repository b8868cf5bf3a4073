"""Exports, opened by the readers people use: gsd, freud, MDAnalysis, OVITO, ASE, xarray, pandas, csv, json.

Known: the positions, images, cells and stresses that were stored. Formats in single precision lose 1e-7 of the
largest number in them (the cell, 30), so positions must agree within 30 * 2^-24 = 1.8e-6; text and double
precision must agree exactly. The sign of the tilt: a pair across the boundary that shifts is 0.002 L apart in
lattice coordinates, so its distance is 0.002 L |a2|/L and would be about 0.4 L with the wrong sign.
"""

from __future__ import annotations

import csv
import json
import os
import subprocess
import sys

import gsd.hoomd
import h5py
import numpy as np
import pytest
from sheared_runs import NUMBER, SCALES, sheared_run, vectors
from synthetic_runs import EDGE, configuration, write_run

import suspend.export.arrays as arrays
from suspend.analysis.summary import analyze
from suspend.configuration_files import read_gsd, read_h5md, read_xyz
from suspend.errors import ConfigurationError, StorageError
from suspend.export import export
from suspend.export.frames import FrameChoice
from suspend.io import Run

SINGLE = EDGE * 2.0**-23
STRESS_FRAMES = 6  # frames at which a stress was sampled; the last frame, the seventh, is behind the last cycle


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    return sheared_run(tmp_path_factory.mktemp("run") / "run", particle_stress=True)


@pytest.fixture(scope="module")
def stored(run):
    with Run(run) as opened:
        return list(opened.frames())


def stored_stress(opened, known):
    record = opened.cycle(known["cycle"])
    row = np.flatnonzero(record["phase"] == known["phase"])[0]
    return record["particle_stress"][row]


def minimum_image(vector, cell):
    lattice = vector @ np.linalg.inv(cell)
    near = lattice - np.round(lattice)
    shifts = np.array(np.meshgrid(*[[-1, 0, 1]] * 3)).reshape(3, -1).T
    return np.linalg.norm((near + shifts) @ cell, axis=1).min()


def pair_distance(tilt):
    return 0.002 * EDGE * np.hypot(1.0, tilt)


def test_gsd_by_gsd(run, stored, tmp_path):
    """Unwrapped positions, box, diameter, times, particle stress; positions lie in the centred cell."""
    assert export(run, tmp_path / "a.gsd") == [
        "particles/stress is not a number in 1 frame(s): no stress was sampled then"
    ]
    with Run(run) as opened, gsd.hoomd.open(tmp_path / "a.gsd") as file:
        assert len(file) == len(stored) == STRESS_FRAMES + 1
        for i, (frame, known) in enumerate(zip(file, stored, strict=True)):
            box = frame.configuration.box
            np.testing.assert_allclose(box, [EDGE, EDGE, EDGE, known["tilt"], 0, 0], rtol=1e-7)
            cell = vectors(known["tilt"])
            unwrapped = frame.particles.position + frame.particles.image @ cell
            np.testing.assert_allclose(unwrapped, known["unwrapped"], atol=SINGLE)
            lattice = frame.particles.position @ np.linalg.inv(cell)
            assert np.abs(lattice).max() <= 0.5 + 1e-6
            assert set(frame.particles.diameter) == {2.0}
            assert frame.log["time"][0] == known["time"] and frame.log["strain"][0] == known["strain"]
            assert frame.configuration.step == 1_000_000 * known["cycle"] + round(1e6 * known["phase"])
            if i == STRESS_FRAMES:
                assert np.isnan(frame.log["particles/stress"]).all()
            else:
                np.testing.assert_array_equal(frame.log["particles/stress"], stored_stress(opened, known))


def test_gsd_is_read_back(run, stored, tmp_path):
    """Our own reader of initial configurations gets the cell and the positions modulo its vectors."""
    export(run, tmp_path / "a.gsd")
    raw = read_gsd(tmp_path / "a.gsd", 1)
    np.testing.assert_allclose(raw.vectors, vectors(stored[1]["tilt"]), atol=SINGLE)
    lattice = (raw.positions - stored[1]["position"]) @ np.linalg.inv(raw.vectors)
    np.testing.assert_allclose(lattice, np.round(lattice), atol=1e-6)
    assert set(raw.radii) == {1.0}


def test_gsd_by_freud(run, stored, tmp_path):
    """freud takes frames as they are, and finds the pair across the shifting boundary."""
    freud = pytest.importorskip("freud", reason="freud is not installed")
    export(run, tmp_path / "a.gsd")
    with gsd.hoomd.open(tmp_path / "a.gsd") as file:
        for frame, known in zip(file[:STRESS_FRAMES], stored, strict=False):
            box = freud.box.Box.from_box(frame.configuration.box)
            x = frame.particles.position
            distance = box.compute_distances(x[:1], x[1:2])[0]
            assert distance == pytest.approx(pair_distance(known["tilt"]), abs=2 * SINGLE)
            query = freud.locality.AABBQuery(box, x).query(x, {"r_max": 1.0, "exclude_ii": True})
            found = query.toNeighborList()
            assert {(0, 1), (1, 0)} <= set(zip(*np.asarray(found[:]).T.tolist(), strict=True))


def test_gsd_by_mdanalysis(run, stored, tmp_path):
    """Positions of every frame. Not the cell: its reader of version 2.11 takes the tilt for the cosine of an angle."""
    reader = pytest.importorskip("MDAnalysis.coordinates.GSD", reason="MDAnalysis is not installed")
    export(run, tmp_path / "a.gsd")
    trajectory = reader.GSDReader(str(tmp_path / "a.gsd"))
    assert trajectory.n_frames == len(stored)
    for step, known in zip(trajectory, stored, strict=True):
        lattice = (step.positions - known["position"]) @ np.linalg.inv(vectors(known["tilt"]))
        np.testing.assert_allclose(lattice, np.round(lattice), atol=1e-6)
        np.testing.assert_allclose(step.dimensions[:3], EDGE, rtol=1e-7)
    trajectory.close()


def test_h5md_by_mdanalysis(run, stored, tmp_path):
    """`Universe(top.xyz, run.h5md)` opens without options: positions, times, cell and the pair across the boundary."""
    mda = pytest.importorskip("MDAnalysis", reason="MDAnalysis is not installed")
    from MDAnalysis.lib.distances import distance_array

    export(run, tmp_path / "a.h5md")
    export(run, tmp_path / "top.xyz", frames=(0,))
    universe = mda.Universe(str(tmp_path / "top.xyz"), str(tmp_path / "a.h5md"))
    assert universe.trajectory.n_frames == len(stored)
    for step, known in zip(universe.trajectory, stored, strict=True):
        np.testing.assert_allclose(universe.atoms.positions, known["position"], atol=SINGLE)
        np.testing.assert_allclose(step.triclinic_dimensions, vectors(known["tilt"]), atol=4 * SINGLE)
        assert step.time == known["time"] and step.data["strain"] == known["strain"]
    universe.trajectory[1]
    x = universe.atoms.positions
    distance = distance_array(x[:1], x[1:2], box=universe.dimensions)[0, 0]
    assert distance == pytest.approx(pair_distance(stored[1]["tilt"]), abs=4 * SINGLE)
    universe.trajectory.close()


def test_h5md_has_units_and_every_frame(run, stored, tmp_path):
    """The file as h5py reads it: positions bit for bit, cell vectors as rows, MDAnalysis' own units as labels; our own
    reader of starts takes it.
    """
    (note,) = export(run, tmp_path / "a.h5md", frames=slice(0, None, 2))
    assert "MDAnalysis" in note and "Angstrom" in note
    with h5py.File(tmp_path / "a.h5md") as file:
        spheres = file["particles/spheres"]
        assert spheres["position/value"].attrs["unit"] == "Angstrom" and spheres["position/time"].attrs["unit"] == "ps"
        for i, known in enumerate(stored[::2]):
            np.testing.assert_array_equal(spheres["position/value"][i], known["position"])
            np.testing.assert_array_equal(spheres["image/value"][i], known["image"])
            np.testing.assert_allclose(spheres["box/edges/value"][i], vectors(known["tilt"]), rtol=1e-14)
    np.testing.assert_array_equal(read_h5md(tmp_path / "a.h5md", 1).positions, stored[2]["position"])


OVITO_SCRIPT = """
import json, sys
from ovito.io import import_file
pipeline = import_file(sys.argv[1])
frames = []
for i in range(pipeline.source.num_frames):
    data = pipeline.compute(i)
    entry = {"cell": data.cell[...].tolist(), "pbc": list(data.cell.pbc), "attributes": {}}
    for name in ("Position", "Periodic Image", "Radius", "Stress Tensor", "stress"):
        if name in data.particles:
            entry[name] = data.particles[name][...].tolist()
    entry["pair"] = float(abs(sum(c * c for c in data.cell.delta_vector(
        data.particles.positions[0], data.particles.positions[1]))) ** 0.5)
    entry["attributes"] = {k: v for k, v in data.attributes.items() if isinstance(v, (int, float))}
    entry["names"] = list(data.particles.keys())
    frames.append(entry)
print(json.dumps(frames))
"""


@pytest.mark.parametrize("suffix", [".gsd", ".xyz"])
def test_both_by_ovito(run, stored, tmp_path, suffix):
    """Cell vectors and origin, positions, images, radii, stress, attributes, and the pair across the boundary."""
    pytest.importorskip("ovito", reason="OVITO's Python package is not installed")
    path = tmp_path / ("a" + suffix)
    export(run, path)
    done = subprocess.run(
        [sys.executable, "-c", OVITO_SCRIPT, str(path)],
        capture_output=True,
        text=True,
        env=os.environ | {"OVITO_GUI_MODE": "0", "QT_QPA_PLATFORM": "offscreen"},
    )
    assert done.returncode == 0, done.stderr
    frames = json.loads(done.stdout.splitlines()[-1])
    assert len(frames) == len(stored)
    for i, (frame, known) in enumerate(zip(frames, stored, strict=True)):
        cell = np.array(frame["cell"])
        lattice_vectors = cell[:, :3].T
        np.testing.assert_allclose(lattice_vectors, vectors(known["tilt"]), atol=SINGLE)
        origin = -0.5 * lattice_vectors.sum(axis=0) if suffix == ".gsd" else np.zeros(3)
        np.testing.assert_allclose(cell[:, 3], origin, atol=SINGLE)
        assert all(frame["pbc"])
        unwrapped = np.array(frame["Position"]) + np.array(frame["Periodic Image"]) @ lattice_vectors
        np.testing.assert_allclose(unwrapped, known["unwrapped"], atol=4 * SINGLE)
        assert set(np.ravel(frame["Radius"])) == {1.0}
        if i < STRESS_FRAMES:
            assert frame["pair"] == pytest.approx(pair_distance(known["tilt"]), abs=2 * SINGLE)
        if suffix == ".xyz":
            assert frame["attributes"]["strain"] == pytest.approx(known["strain"], abs=1e-12)
            assert ("Stress Tensor" in frame["names"]) == (i < STRESS_FRAMES)


def test_xyz_by_ase(run, stored, tmp_path):
    """The reference reader of the format: cell, periodicity, positions bit for bit, distance through the boundary.

    The stress of each sphere is an array of the atoms and survives a round trip; a column `stress` would not.
    """
    ase_io = pytest.importorskip("ase.io", reason="ASE is not installed")
    export(run, tmp_path / "a.xyz")
    frames = ase_io.read(tmp_path / "a.xyz", index=":")
    assert len(frames) == len(stored)
    for i, (atoms, known) in enumerate(zip(frames, stored, strict=True)):
        np.testing.assert_array_equal(atoms.cell[:], vectors(known["tilt"]))
        np.testing.assert_array_equal(atoms.positions, known["position"])
        np.testing.assert_array_equal(atoms.arrays["map_shift"], known["image"])
        assert atoms.pbc.all() and atoms.info["strain"] == known["strain"] and atoms.info["time"] == known["time"]
        if i < STRESS_FRAMES:
            assert atoms.get_distance(0, 1, mic=True) == pytest.approx(pair_distance(known["tilt"]), abs=1e-9)
            with Run(run) as opened:
                stress = stored_stress(opened, known)
            np.testing.assert_array_equal(atoms.arrays["Stress"], stress)
            assert atoms.calc is None
            ase_io.write(tmp_path / "again.xyz", atoms, format="extxyz")
            again = ase_io.read(tmp_path / "again.xyz").arrays["Stress"]
            np.testing.assert_allclose(again, stress, atol=1e-7)  # ASE writes eight decimals


def test_xyz_is_read_back(run, stored, tmp_path):
    """Our own reader: cell, radii and positions bit for bit; the stress under the name no reader takes for another."""
    export(run, tmp_path / "a.extxyz")
    heads = [line for line in (tmp_path / "a.extxyz").read_text().splitlines() if line.startswith("Lattice")]
    assert [":Stress:R:6 " in head for head in heads] == [i < STRESS_FRAMES for i in range(len(stored))]
    raw = read_xyz(tmp_path / "a.extxyz", 3)
    np.testing.assert_array_equal(raw.vectors, vectors(stored[3]["tilt"]))
    np.testing.assert_array_equal(raw.positions, stored[3]["position"])
    assert set(raw.radii) == {1.0}


def test_the_pair_keeps_its_distance(stored):
    """The premise of the tests above, by brute force over images; with the tilt's sign wrong it is far off."""
    for known in stored[:STRESS_FRAMES]:
        pair = known["position"][1] - known["position"][0]
        assert minimum_image(pair, vectors(known["tilt"])) == pytest.approx(pair_distance(known["tilt"]))
        if known["tilt"]:
            assert minimum_image(pair, vectors(-known["tilt"])) > 0.3 * EDGE


@pytest.mark.parametrize(
    ("options", "chosen"),
    [
        ({"frames": slice(None, None, 3)}, [0, 3, 6]),
        ({"frames": (-1, 0)}, [6, 0]),
        ({"phase": 0.25}, [1, 3, 5]),
        ({"phase": 0.0, "frames": slice(2, None)}, [2, 4, 6]),
    ],
)
def test_chosen_frames(run, stored, tmp_path, options, chosen):
    """Slices, numbers and phases choose the frames they name, in that order."""
    export(run, tmp_path / "a.gsd", **options)
    with gsd.hoomd.open(tmp_path / "a.gsd") as file:
        times = [frame.log["time"][0] for frame in file]
    assert times == [stored[i]["time"] for i in chosen]


def test_cycles_in_the_journal(tmp_path):
    """Cycles of a run that goes on, not in its trajectory yet, have their frames and their stresses."""
    from sheared_runs import FLOW, sheared_record

    from suspend.io import RunStore

    config = configuration(FLOW, {"cycles": 5}, number=NUMBER)
    with RunStore.create(tmp_path / "run", config, {"number": NUMBER, "L": EDGE, "radius": 1.0}) as store:
        for k in range(2):
            store.append_cycle(sheared_record(k, particle_stress=True))
            store.save({"k": k})
        with Run(tmp_path / "run") as opened:
            assert opened.pending
        assert export(tmp_path / "run", tmp_path / "a.gsd") == []
    with gsd.hoomd.open(tmp_path / "a.gsd") as file:
        assert len(file) == 4
        expected = sheared_record(1, particle_stress=True)["particle_stress"][16]
        np.testing.assert_array_equal(file[3].log["particles/stress"], expected)


def test_csv(run, tmp_path):
    """Cycles: the columns of `analyze`; samples: every stored number, with all its digits."""
    export(run, tmp_path / "a.csv")
    rows = list(csv.reader((tmp_path / "a.csv").open()))
    analysis = analyze(run)
    assert rows[0] == ["cycle", *analysis.columns]
    np.testing.assert_array_equal(np.array(rows[1:], float)[:, 1:], analysis.values)
    export(run, tmp_path / "s.csv", table="samples")
    rows = list(csv.reader((tmp_path / "s.csv").open()))
    table = dict(zip(rows[0], np.array(rows[1:], float).T, strict=True))
    with Run(run) as opened:
        np.testing.assert_array_equal(table["time[time]"], opened.series("time"))
        np.testing.assert_array_equal(
            table["stress_hydrodynamic_xy[viscosity/time]"], opened.series("stress_hydrodynamic")[:, 3]
        )
    assert len(rows) == 1 + 3 * 64


def test_json(run, tmp_path):
    """Configuration, moduli, statistics; on request the samples: valid JSON without NaN."""
    export(run, tmp_path / "a.json")
    content = json.loads((tmp_path / "a.json").read_text())
    assert content["configuration"]["flow"]["amplitude"] == SCALES["gamma0"]
    expected = analyze(run)["eta_r_prime"].tolist()
    assert content["analysis"]["columns"]["eta_r_prime[-]"] == expected
    assert content["statistics"]["evaluations"] == [100, 100, 100]
    export(run, tmp_path / "s.json", table="samples")
    samples = json.loads((tmp_path / "s.json").read_text())["samples"]
    with Run(run) as opened:
        assert samples["strain[-]"] == opened.series("strain").tolist()
        assert samples["stress_fluid_xy[viscosity/time]"] == opened.series("stress_fluid")[:, 3].tolist()


def test_netcdf_and_xarray(run, stored, tmp_path):
    """The file holds what `to_xarray` holds: series, moduli, frames."""
    xarray = pytest.importorskip("xarray", reason="xarray is not installed")
    pytest.importorskip("h5netcdf", reason="h5netcdf is not installed")
    export(run, tmp_path / "a.nc", frames=slice(None))
    with Run(run) as opened:
        made = arrays.to_xarray(opened, FrameChoice(opened))
        time = opened.series("time")
    with xarray.open_dataset(tmp_path / "a.nc", engine="h5netcdf") as read:
        assert set(read.variables) == set(made.variables)
        for name in made.variables:
            np.testing.assert_array_equal(read[name].values, made[name].values)
            assert read[name].dims == made[name].dims
        np.testing.assert_array_equal(read["time"], time)
        np.testing.assert_array_equal(read["position"], [frame["position"] for frame in stored])
        np.testing.assert_array_equal(read["vectors"][1], vectors(stored[1]["tilt"]))
        assert read["stress_fluid"].sel(component="xy").shape == time.shape
        assert read["stress_fluid"].attrs["units"] == "viscosity/time"
    export(run, tmp_path / "b.nc")
    with xarray.open_dataset(tmp_path / "b.nc", engine="h5netcdf") as read:
        assert "position" not in read and "cycle_eta_r_prime" in read


def test_pandas(run):
    """Moduli and samples as data frames."""
    pytest.importorskip("pandas", reason="pandas is not installed")
    with Run(run) as opened:
        moduli, samples = arrays.to_pandas(opened), arrays.to_pandas(opened, "samples")
    np.testing.assert_array_equal(moduli["eta_r_prime[-]"], analyze(run)["eta_r_prime"])
    assert len(samples) == 3 * 64 and samples["cycle[-]"].iloc[-1] == 2


def test_missing_packages_are_named(run, tmp_path, monkeypatch):
    """netCDF without xarray: what to install, and nothing written."""
    monkeypatch.setattr(arrays.importlib.util, "find_spec", lambda name: None)
    with pytest.raises(ConfigurationError, match="pip install xarray h5netcdf"):
        export(run, tmp_path / "a.nc")
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(
    ("target", "options", "message"),
    [
        ("a.pdf", {}, r"ends in '\.pdf', but exports are \.gsd"),
        ("a", {}, "no suffix"),
        ("a.gsd", {"frames": (7,)}, r"7 frame\(s\), there is no frame 7"),
        ("a.gsd", {"frames": slice(20, None)}, "none of them is in the range"),
        ("a.gsd", {"phase": 0.3}, "no chosen frame is at phase 0.3"),
        ("a.csv", {"frames": (0,)}, "frames are for trajectories"),
        ("a.csv", {"table": "other"}, "must be cycles or samples"),
    ],
)
def test_wrong_requests(run, tmp_path, target, options, message):
    """One clear message, nothing written."""
    with pytest.raises(ConfigurationError, match=message):
        export(run, tmp_path / target, **options)
    assert not list(tmp_path.iterdir())


def test_atomic(run, tmp_path, monkeypatch):
    """An error in the middle leaves the old file, and no temporary one; a folder that is not there is an error."""
    target = tmp_path / "a.xyz"
    target.write_text("old")
    frame, count = FrameChoice.frame, []

    def fail_at_third(self, i):
        count.append(i)
        if len(count) == 3:
            raise OSError(28, "no space")
        return frame(self, i)

    monkeypatch.setattr(FrameChoice, "frame", fail_at_third)
    with pytest.raises(StorageError, match="disk is full"):
        export(run, target)
    assert target.read_text() == "old" and [p.name for p in tmp_path.iterdir()] == ["a.xyz"]
    with pytest.raises(StorageError, match="cannot write"):
        export(run, tmp_path / "nowhere" / "a.csv")


def test_the_runs_own_table_is_kept(run):
    """A run maintains moduli.csv; an export must not take its place."""
    with pytest.raises(ConfigurationError, match="its own table"):
        export(run, run / "moduli.csv")


@pytest.mark.parametrize("kind", ["absent", "empty", "foreign", "truncated"])
@pytest.mark.parametrize("suffix", [".gsd", ".csv"])
def test_files_that_are_no_run(run, tmp_path, kind, suffix):
    """A clear error, and no target."""
    source = tmp_path / "trajectory.h5"
    content = (run / "trajectory.h5").read_bytes()
    if kind != "absent":
        source.write_bytes({"empty": b"", "foreign": b"hello" * 99, "truncated": content[: len(content) // 2]}[kind])
    with pytest.raises(StorageError, match=r"trajectory\.h5"):
        export(source, tmp_path / ("a" + suffix))
    assert not (tmp_path / ("a" + suffix)).exists()


def test_runs_without_a_cycle(tmp_path):
    """Nothing stored yet: said so, for frames, cycles and samples."""
    path = write_run(tmp_path / "run", configuration({"type": "oscillatory", "amplitude": 0.8}, {"cycles": 1}), [])
    for target, options in (("a.gsd", {}), ("a.csv", {}), ("a.csv", {"table": "samples"}), ("a.json", {})):
        with pytest.raises(ConfigurationError, match="nothing to export"):
            export(path, tmp_path / target, **options)


def test_command(run, tmp_path):
    """The command writes, says so on stderr, and refuses what it should with exit code 2."""

    def command(*words):
        return subprocess.run(
            [sys.executable, "-m", "suspend_cli", "export", *map(str, words)], capture_output=True, text=True
        )

    done = command(run, "-o", tmp_path / "a.gsd", "--frames", "::2", "--phase", "0")
    assert done.returncode == 0 and done.stdout == "" and "a.gsd written" in done.stderr
    with gsd.hoomd.open(tmp_path / "a.gsd") as file:
        assert len(file) == 4
    assert command(run, "-o", tmp_path / "a.gsd", "--frames", "-1", "-q").stderr == ""
    for words in (["--frames", "::0"], ["--frames", "x"], ["--phase", "1"]):
        assert command(run, "-o", tmp_path / "b.gsd", *words).returncode == 2
    assert command(tmp_path / "none", "-o", tmp_path / "b.gsd").returncode == 4
    assert not (tmp_path / "b.gsd").exists()
