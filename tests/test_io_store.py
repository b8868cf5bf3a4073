"""Writing and reading run directories: every bit comes back, also of resumed and extended runs."""

from __future__ import annotations

import csv
import os

import numpy as np
import pytest
from io_records import CONFIG, META, assert_same, final_frame, record, state

from suspend.errors import StorageError
from suspend.io import CycleTable, Run, RunStore, describe, holds_run
from suspend.io.files import replace_atomically, replace_text

TABLE = CycleTable("moduli.csv", lambda r: {"G1' (Pa)": r["stress_fluid"][0, 0], "a, b": 0.1 * r["index"]})


def write(directory, cycles, *, start=0, finish=True, interval=10.0, **kind):
    """Run the made-up simulation from cycle `start` to `cycles` in one go."""
    opener = RunStore.open if start else lambda *a, **k: RunStore.create(a[0], CONFIG, META, *a[1:], **k)
    with opener(directory, TABLE, interval=interval) as store:
        if not start:
            store.save(state(0))
        for k in range(start, cycles):
            store.append_cycle(record(k, **kind))
            store.save(state(k + 1))
        if finish:
            store.finish(state(cycles), final_frame(cycles))


def assert_holds(path, cycles, **kind):
    """The run at `path` holds exactly the made-up cycles."""
    with Run(path) as run:
        assert run.cycles == run.stored == cycles
        for k in range(cycles):
            assert_same(record(k, **kind), run.cycle(k))


@pytest.mark.parametrize("interval", [0.0, 1e9])
@pytest.mark.parametrize("kind", [{}, {"particle_stress": True, "flow_driven": True}])
def test_every_bit_comes_back_from_trajectory_and_journal(tmp_path, interval, kind):
    """Storage must be lossless: bytes, types and shapes equal, cycles consolidated or pending."""
    write(tmp_path / "run", 4, finish=False, interval=interval, **kind)
    assert_holds(tmp_path / "run", 4, **kind)
    with Run(tmp_path / "run") as run:
        assert run.pending == (0 if interval == 0.0 else 4)
        assert run.meta == META and run.config_yaml == CONFIG and run.config["flow"]["amplitude"] == 0.8
        assert not run.finished


def test_series_and_frames_join_trajectory_and_journal(tmp_path):
    """Joined series equal the concatenation of the records, across the border of the two files."""
    write(tmp_path / "run", 3, finish=False, interval=0.0)
    write(tmp_path / "run", 5, start=3, finish=False)
    records = [record(k) for k in range(5)]
    with Run(tmp_path / "run") as run:
        assert run.pending == 2 and run.n_samples == 40 and run.n_frames == 10
        for first, last in ((0, 5), (1, 4), (3, 5), (0, 2), (2, 2)):
            for name in ("time", "stress_hydrodynamic", "tilt", "unwrapped"):
                rows = [r[name] for r in records[first:last]] or [records[0][name][:0]]
                np.testing.assert_array_equal(run.series(name, first, last), np.concatenate(rows))
        assert run.series("cycle").tolist() == np.repeat(range(5), 8).tolist()
        assert [f["cycle"] for f in run.frames()] == [0, 0, 1, 1, 2, 2, 3, 3, 4, 4]
        np.testing.assert_array_equal(run.frame(-1)["position"], records[4]["position"][1])
        np.testing.assert_array_equal(run.frame(2)["unwrapped"], records[1]["unwrapped"][0])
        starts = np.concatenate(list(run.cycle_start_unwrapped(chunk=2)))
        np.testing.assert_array_equal(starts, np.stack([r["unwrapped"][0] for r in records]))
        for name, column in run.statistics().items():
            assert column.tolist() == [r["statistics"][name] for r in records]
        with pytest.raises(KeyError, match="stress_hydrodynamic"):
            run.series("stress_hydro")
        with pytest.raises(IndexError):
            run.cycle(5)


def test_finished_run_can_be_extended_without_doubling_the_final_frame(tmp_path):
    """4 cycles + 2 more = 6 cycles in one go: same records, frames and table; the end is stored once."""
    write(tmp_path / "once", 6)
    write(tmp_path / "twice", 4)
    with Run(tmp_path / "twice") as run:
        assert run.finished and run.n_frames == 9 and run.frame(-1)["cycle"] == 4
    longer = CONFIG.replace("cycles: 4", "cycles: 6")
    with RunStore.open(tmp_path / "twice", TABLE) as store:
        assert store.finished and store.cycles_done == 4 and not store.notes
        assert_same(store.load_state()[0], state(4))
        store.update_configuration(longer)
        assert not store.finished
    write(tmp_path / "twice", 5, start=4, finish=False)
    with Run(tmp_path / "twice") as run:  # the journal's first frame replaces the final frame
        assert run.n_frames == 10 and not run.finished and run.config_yaml == longer
    write(tmp_path / "twice", 6, start=5)
    assert_holds(tmp_path / "twice", 6)
    with Run(tmp_path / "once") as one, Run(tmp_path / "twice") as two:
        assert two.finished and one.n_frames == two.n_frames == 13
        for a, b in zip(one.frames(), two.frames(), strict=True):
            assert_same(a, b)
        assert np.concatenate(list(two.cycle_start_unwrapped())).shape == (7, 5, 3)
    assert (tmp_path / "once/moduli.csv").read_bytes() == (tmp_path / "twice/moduli.csv").read_bytes()


def test_incomplete_last_block_is_stored_and_replaced_when_extended(tmp_path):
    """Steady shear to 1.5 strain units: the half block is stored; continued, the whole one replaces it."""
    half = record(1, n=4, complete=False)
    with RunStore.create(tmp_path / "run", CONFIG, META, TABLE) as store:
        store.append_cycle(record(0))
        store.save(state(1))
        store.append_cycle(half)
        frame = final_frame(2) | {"frame_phase": np.array([0.5])}
        store.finish(state(1), {**frame, "frame_time": np.array([1.5])}, partial=half)
    with Run(tmp_path / "run") as run:
        assert (run.cycles, run.stored, run.n_samples) == (1, 2, 12)
        assert_same(run.cycle(1), half)
        assert run.n_frames == 4  # the final frame coincides with the block's frame at phase 1/2
    with RunStore.open(tmp_path / "run", TABLE) as store:
        assert_same(store.load_state()[1], half)
        store.append_cycle(record(1))
        store.save(state(2))
        store.finish(state(2), final_frame(2))
    assert_holds(tmp_path / "run", 2)
    assert len((tmp_path / "run/moduli.csv").read_text().splitlines()) == 3


def test_state_and_partial_record_come_back_exactly(tmp_path):
    """A checkpoint restores arrays with their types, huge integers, NaN, None and nesting."""
    partial = record(0, n=3)
    with RunStore.create(tmp_path / "run", CONFIG, META) as store:
        assert not store.has_state
        with pytest.raises(StorageError, match="no checkpoint"):
            store.load_state()
        store.save(state(0) | {"numpy": np.float64(0.1), "zero": np.array(3.0)}, partial)
    with RunStore.open(tmp_path / "run") as store:
        found, again = store.load_state()
    assert_same(found, state(0) | {"numpy": 0.1, "zero": np.array(3.0)})
    assert_same(again, partial)
    with np.load(tmp_path / "run/checkpoint.npz", allow_pickle=False) as archive:  # readable without us
        np.testing.assert_array_equal(archive["state/positions"], state(0)["positions"])


def test_table_numbers_are_exact_and_headers_quoted(tmp_path):
    """Numbers in the CSV parse back to the same float64 (shortest repr is exact)."""
    write(tmp_path / "run", 3)
    with open(tmp_path / "run/moduli.csv", newline="") as handle:
        rows = list(csv.DictReader(handle))
    assert list(rows[0]) == ["cycle", "G1' (Pa)", "a, b"]
    for k, row in enumerate(rows):
        assert int(row["cycle"]) == k and float(row["G1' (Pa)"]) == record(k)["stress_fluid"][0, 0]


@pytest.mark.parametrize("damage", ["torn", "missing line", "removed", "surplus", "zeros", "other digits"])
def test_table_is_repaired_on_opening(tmp_path, damage):
    """Whatever happened to the table, on resuming it equals that of an undisturbed run."""
    write(tmp_path / "run", 3)
    path = tmp_path / "run/moduli.csv"
    good = path.read_bytes()
    lines = good.splitlines(keepends=True)
    bad = {
        "torn": good[:-5],
        "missing line": b"".join(lines[:-1]),
        "surplus": good + lines[-1].replace(b"2,", b"3,", 1),
        "other digits": good[:-2] + b"7\n",
        "zeros": good[: -len(lines[-1])] + b"\0" * len(lines[-1]),
    }
    path.unlink() if damage == "removed" else path.write_bytes(bad[damage])
    with RunStore.open(tmp_path / "run", TABLE) as store:
        assert any("moduli.csv" in note for note in store.notes)
    assert path.read_bytes() == good


def test_wrong_records_are_refused_before_anything_is_written(tmp_path):
    """A record out of order, of another size or with other fields is the caller's error, not stored."""
    with RunStore.create(tmp_path / "run", CONFIG, META) as store:
        store.append_cycle(record(0))
        store.save(state(1))
        for bad, word in (
            (record(2), "cycle 2"),
            (record(1, flow_driven=True), "stress_flow_driven"),
            (record(1) | {"rate": np.zeros(7)}, "rate"),
            (record(1, number=6), "position"),
            (record(1) | {"strain": np.zeros(8, np.float32)}, "strain"),
        ):
            with pytest.raises(ValueError, match=word):
                store.append_cycle(bad)
        with pytest.raises(TypeError, match="odd"):
            store.save({"odd": object()})
        store.append_cycle(record(1))
        with pytest.raises(ValueError, match="save"):
            store.consolidate()
        store.save(state(2))
    assert_holds(tmp_path / "run", 2)


def test_trajectory_alone_is_enough_to_resume(tmp_path):
    """Without checkpoint and journal (power cut, clean-up) the copy in trajectory.h5 continues the run."""
    write(tmp_path / "run", 3)
    for damage in (lambda p: p.write_bytes(p.read_bytes()[:-40]), lambda p: p.unlink()):
        damage(tmp_path / "run/checkpoint.npz")
        with RunStore.open(tmp_path / "run", TABLE) as store:
            assert_same(store.load_state()[0], state(3))
    write(tmp_path / "run", 4, start=3)
    assert_holds(tmp_path / "run", 4)


def test_checkpoint_ahead_of_the_journal_falls_back(tmp_path):
    """After a power cut the journal may lack cycles the checkpoint has: continue from the copy."""
    write(tmp_path / "run", 2, finish=False, interval=0.0)
    write(tmp_path / "run", 4, start=2, finish=False)
    journal = tmp_path / "run/cycles.journal"
    os.truncate(journal, journal.stat().st_size - 1)
    with RunStore.open(tmp_path / "run", TABLE) as store:
        assert store.cycles_done == 2 and any("ahead" in note for note in store.notes)
        assert_same(store.load_state()[0], state(2))
    write(tmp_path / "run", 4, start=2)
    assert_holds(tmp_path / "run", 4)


def test_h5md_layout(tmp_path):
    """H5MD 1.1: versions, box attributes and edges (rows are cell vectors); step and time of one table are
    the same object (hard links); the file alone is readable."""
    import h5py

    write(tmp_path / "run", 3)
    with h5py.File(tmp_path / "run/trajectory.h5") as file:
        assert file["h5md"].attrs["version"].tolist() == [1, 1]
        assert file["h5md/creator"].attrs["name"] == "suspend" and "name" in file["h5md/author"].attrs
        box = file["particles/spheres/box"]
        assert box.attrs["dimension"] == 3 and list(box.attrs["boundary"]) == ["periodic"] * 3
        length = META["L"]
        tilt = np.array([record(k)["tilt"] for k in range(3)]).ravel()
        expected = [[[length, 0, 0], [t * length, length, 0], [0, 0, length]] for t in tilt]
        np.testing.assert_array_equal(box["edges/value"][:6], expected)
        frames = [
            file[f"particles/spheres/{n}"] for n in ("position", "image", "position_unwrapped", "box/edges")
        ]
        frames += list(file["observables"].values())
        assert all(g["step"] == frames[0]["step"] and g["time"] == frames[0]["time"] for g in frames)
        assert frames[0]["step"][:].tolist() == [0, 500000, 1000000, 1500000, 2000000, 2500000, 3000000]
        assert all(len(g["value"]) == 7 for g in frames)
        series = list(file["rheology"].values())
        assert all(g["step"] == series[0]["step"] and len(g["value"]) == 24 for g in series)
        np.testing.assert_array_equal(series[0]["time"][:8], record(0)["time"])
        assert file["parameters/configuration"].asstr()[()] == CONFIG
        assert file["parameters/meta"].attrs["seed"] == 7
    assert_holds(tmp_path / "run/trajectory.h5", 3)


def test_mdanalysis_reads_positions_box_and_time(tmp_path):
    """MDAnalysis' H5MD reader gives our positions (float32), cell vectors, times and per-frame strains."""
    mda = pytest.importorskip("MDAnalysis")
    write(tmp_path / "run", 3)
    universe = mda.Universe.empty(5, trajectory=False)
    universe.load_new(str(tmp_path / "run/trajectory.h5"), format="H5MD", convert_units=False)
    with Run(tmp_path / "run") as run:
        for step, frame in zip(universe.trajectory, run.frames(), strict=True):
            np.testing.assert_allclose(universe.atoms.positions, frame["position"], atol=1e-7)
            assert step.time == frame["time"] and step.data["strain"] == frame["strain"]
            assert step.triclinic_dimensions[1][0] == pytest.approx(frame["tilt"] * META["L"], abs=1e-6)


def test_describe_and_holds_run(tmp_path):
    """`describe` tells what was written, in plain types."""
    import json

    assert not holds_run(tmp_path / "run")
    write(tmp_path / "run", 3)
    assert holds_run(tmp_path / "run")
    facts = json.loads(json.dumps(describe(tmp_path / "run")))
    assert (facts["cycles"], facts["samples"], facts["frames"], facts["pending"]) == (3, 24, 7, 0)
    assert facts["finished"] and facts["running"] is None and facts["meta"] == META
    total = sum(record(k)["statistics"]["evaluations"] for k in range(3))
    smallest = min(record(k)["statistics"]["minimum_gap"] for k in range(3))
    assert facts["statistics"]["evaluations"] == total and facts["statistics"]["minimum_gap"] == smallest
    with RunStore.open(tmp_path / "run"):
        assert f"pid {os.getpid()}" in describe(tmp_path / "run")["running"]
    assert describe(tmp_path / "run/trajectory.h5")["cycles"] == 3


def test_writers_beside_each_other_leave_each_other_alone(tmp_path):
    """A file being replaced survives the start of a run in its folder and a second writer of the same name.

    Two calls of one sweep write the point's configuration while the first one's process begins the run: no temporary
    file may be shared by name or taken for one that a killed writer left. Old ones and the run's own go.
    """
    path, store = tmp_path / "configuration.yaml", None
    own, old = tmp_path / "checkpoint.npz.1-a.tmp", tmp_path / "point.json.1-a.tmp"
    own.touch()
    old.touch()
    os.utime(old, (0, 0))

    def fill(temporary):
        nonlocal store
        temporary.write_text("first half, ")
        store = RunStore.create(tmp_path, CONFIG, META)
        replace_text(path, "of another writer")
        with open(temporary, "a") as file:
            file.write("second half")

    replace_atomically(path, fill, sync=False)
    store.close()
    assert path.read_text() == "first half, second half"
    assert not list(tmp_path.glob("*.tmp"))
