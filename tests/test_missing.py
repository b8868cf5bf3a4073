"""Quantities without a value, in every output of runs that have some: NaN in HDF5, empty, null, a dash; never inf.

The scenes: one sphere (no D_cyc, no gap), two far apart (no gap within reach), no interaction at all, no flow. Each
output is opened with the reader of its medium, and every number in it looked at.
"""

from __future__ import annotations

import csv
import json
import math
import re

import h5py
import numpy as np
import pytest

from suspend import missing
from suspend.analysis.displacements import DisplacementCloud
from suspend.analysis.signatures import Range
from suspend.config import from_dict
from suspend.figures.registry import FIGURES
from suspend.initial import prepare_initial
from suspend.io import Run, RunStore, describe
from suspend.simulation import Simulation, run
from suspend_cli.main import main

SCENES = {
    "one": {"particles": {"number": 1, "volume_fraction": 1e-3}},
    "far": {"particles": {"number": 2, "volume_fraction": 1e-6}, "output": {"particle_stress": True}},
    "free": {"particles": {"number": 2, "volume_fraction": 1e-6}, "lubrication": {"enabled": False}},
    "steady": {"particles": {"number": 1, "volume_fraction": 1e-3}, "flow": {"type": "steady", "rate": 1.0}},
    "quiescent": {"particles": {"number": 1, "volume_fraction": 1e-3}, "flow": {"type": "quiescent"}},
}
WITHOUT_VALUE = {  # NaN is right here, in these scenes
    *(f"cycles/statistics/{name}" for name in ("minimum_gap", "d_cyc")),
}
TOKEN = re.compile(r"(?<![\w./-])[+-]?(nan|inf|infinity)(?![\w-])", re.IGNORECASE)


def make(folder, name):
    """The run of a scene, two cycles or units of strain."""
    tree = {"flow": {"type": "oscillatory", "amplitude": 0.5}, "repulsion": None} | SCENES[name]
    tree["duration"] = {"cycles": 2} if tree["flow"]["type"] == "oscillatory" else {"strain": 2.0}
    run(from_dict(tree), folder)
    return folder


@pytest.fixture(scope="module", params=SCENES)
def stored(request, tmp_path_factory):
    return make(tmp_path_factory.mktemp("missing") / request.param, request.param)


def call(*arguments):
    """Exit code of a command."""
    with pytest.raises(SystemExit) as stopped:
        main([str(word) for word in arguments])
    return stopped.value.code


def test_hdf5_has_nan_where_the_convention_says_and_no_infinity(stored):
    """All datasets and attributes of trajectory.h5; the file says what NaN means."""

    def look(name, item):
        for key, value in item.attrs.items():
            kind = np.asarray(value).dtype.kind
            assert kind != "f" or np.isfinite(value).all(), f"{name} {key}"
        if isinstance(item, h5py.Dataset) and item.dtype.kind == "f":
            assert not np.isinf(item[()]).any(), name
            assert np.isfinite(item[()]).all() or name in WITHOUT_VALUE, name

    with h5py.File(stored / "trajectory.h5") as file:
        assert file["parameters"].attrs["missing"] == missing.NOTE
        file.visititems(look)
        assert np.isnan(file["cycles/statistics/minimum_gap"][:]).all()
        if stored.name == "one":
            assert np.isnan(file["cycles/statistics/d_cyc"][:]).all()


def test_tables_have_empty_cells(stored, tmp_path):
    """The run's own table, those of analyze and export: a cell is text with a meaning, a finite number, or empty."""
    assert call("analyze", stored, "--csv", tmp_path / "analysis.csv") == 0
    for content in ("cycles", "samples"):
        assert call("export", stored, "-o", tmp_path / f"{content}.csv", "--table", content) == 0
    empty = 0
    for path in [*stored.glob("*.csv"), *tmp_path.glob("*.csv")]:
        with open(path, encoding="utf-8") as file:
            for row in csv.DictReader(file):
                empty += sum(cell == "" for cell in row.values())
                assert all(math.isfinite(float(cell)) for cell in row.values() if cell), path
    assert empty > 0 or stored.name in ("far", "free", "steady")


def strict(text):
    """Parsed JSON; NaN and Infinity, which json.loads takes and no other reader, are refused."""

    def refuse(word):
        raise AssertionError(word)

    return json.loads(text, parse_constant=refuse)


def test_json_has_null(stored, tmp_path, capsys):
    """info, analyze and export."""
    assert call("export", stored, "-o", tmp_path / "a.json") == 0
    exported = strict((tmp_path / "a.json").read_text())
    assert exported["statistics"]["minimum_gap"] == [None] * len(exported["statistics"]["minimum_gap"])
    capsys.readouterr()
    for command in ("info", "analyze"):
        assert call(command, stored, "--json") == 0
        assert strict(capsys.readouterr().out)["statistics"]["minimum_gap"] is None


def test_text_has_a_dash(stored, tmp_path, capsys):
    """The terminal and the report: no nan, no inf."""
    sections = ("--dynamics", "--structure") if stored.name in ("one", "far", "free") else ("--structure",)
    commands = (("info", stored), ("analyze", stored, *sections), ("report", stored, "-o", tmp_path / "report.html"))
    for words in commands:
        assert call(*words) == 0
        out = capsys.readouterr().out
        assert not TOKEN.search(out), TOKEN.search(out)
        if words[0] == "info":
            assert re.search(r"minimum gap +-\n", out)
    page = (tmp_path / "report.html").read_text(encoding="utf-8")
    seen = re.sub(r"<[^>]*>", " ", re.sub(r"(?s)<(style|script|svg).*?</\1>", " ", page))
    assert not TOKEN.search(seen), TOKEN.search(seen)


def test_closing_line_of_a_run(tmp_path, capsys):
    """`suspend run` and its JSON."""
    source = tmp_path / "one.yaml"
    source.write_text("particles: {number: 1, volume_fraction: 0.001}\nflow: {type: oscillatory, amplitude: 0.5}\n"
                      "duration: {cycles: 1}\n")  # fmt: skip
    assert call("run", source, "-o", tmp_path / "a") == 0
    out, err = capsys.readouterr()
    assert "smallest gap -," in out and not TOKEN.search(out + err)
    assert call("run", source, "-o", tmp_path / "b", "--json", "--quiet") == 0
    assert strict(capsys.readouterr().out)["minimum_gap"] is None


def test_figures_write_empty_cells(tmp_path, capsys):
    """CSV behind every figure that can be drawn of one sphere, at one amplitude or two."""
    stored, other = make(tmp_path / "a", "one"), tmp_path / "b"
    run(from_dict({"particles": {"number": 1, "volume_fraction": 1e-3}, "flow": {"type": "oscillatory",
                   "amplitude": 0.3}, "duration": {"cycles": 2}, "repulsion": None}), other)  # fmt: skip
    drawn = 0
    for name in (kind.name for kind in FIGURES):
        for runs in ([stored], [stored, other]):
            drawn += call("plot", name, *runs, "-o", tmp_path / f"{name}{len(runs)}", "--format", "png") == 0
    assert drawn >= 8, capsys.readouterr().err
    for path in tmp_path.glob("*.csv"):
        text = path.read_text(encoding="utf-8")
        assert not re.search(r"(^|,)[+-]?(nan|inf)(,|$)", text, re.IGNORECASE | re.MULTILINE), path


def test_collected_sweep(tmp_path, capsys):
    """Status as JSON, the table of results as CSV and HDF5."""
    (tmp_path / "base.yaml").write_text(
        "particles: {number: 1, volume_fraction: 0.001}\nflow: {type: oscillatory, amplitude: 0.5}\n"
        "duration: {cycles: 1}\n"
    )
    (tmp_path / "s.yaml").write_text("base: base.yaml\nvary: {flow.amplitude: [0.3, 0.5]}\n")
    where = tmp_path / "out"
    assert call("sweep", "run", tmp_path / "s.yaml", "-o", where, "--workers", 1) == 0
    capsys.readouterr()
    assert call("sweep", "status", where, "--json") == 0
    strict(capsys.readouterr().out)
    for suffix in ("csv", "h5"):
        assert call("sweep", "collect", where, "-o", tmp_path / f"t.{suffix}") == 0
    with open(tmp_path / "t.csv", encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    assert len(rows) == 2 and rows[0]["minimum_gap[a]"] == "" and rows[0]["D_cyc[-]"] == ""
    assert not any(re.fullmatch("[+-]?(nan|inf)", cell, re.IGNORECASE) for row in rows for cell in row.values())
    with h5py.File(tmp_path / "t.h5") as file:
        assert file.attrs["missing"] == missing.NOTE
        assert np.isnan(file["minimum_gap"][:]).all() and np.isnan(file["D_cyc"][:]).all()
        assert not any(np.isinf(item[:]).any() for item in file.values() if item.dtype.kind == "f")


def test_netcdf_and_data_frames(stored, tmp_path):
    """xarray and pandas take the missing numbers for missing."""
    xarray = pytest.importorskip("xarray", reason="xarray is not installed")
    pytest.importorskip("h5netcdf", reason="h5netcdf is not installed")
    pytest.importorskip("pandas", reason="pandas is not installed")
    from suspend.export.arrays import to_pandas

    assert call("export", stored, "-o", tmp_path / "a.nc", "--frames", "0") == 0
    with xarray.open_dataset(tmp_path / "a.nc", engine="h5netcdf") as data, Run(stored) as opened:
        assert not any(np.isinf(v.values).any() for v in data.variables.values() if v.dtype.kind == "f")
        if stored.name == "one":
            assert data["cycle_D_cyc"].isnull().all() and to_pandas(opened)["D_cyc[-]"].isna().all()


def test_old_runs_are_read(tmp_path):
    """Infinities that were stored formerly, in trajectory.h5 and in the journal of a run that goes on, are missing."""
    stored = make(tmp_path / "run", "one")
    with h5py.File(stored / "trajectory.h5", "r+") as file:
        file["cycles/statistics/minimum_gap"][:] = np.inf
        file["parameters/meta"].attrs["start_minimum_gap"] = np.nan
    with Run(stored) as opened:
        assert np.isnan(opened.statistics()["minimum_gap"]).all()
        assert math.isnan(opened.cycle(0)["statistics"]["minimum_gap"])
        record = opened.cycle(1) | {"index": 2}
    facts = describe(stored)
    assert math.isnan(facts["statistics"]["minimum_gap"]) and facts["meta"]["start_minimum_gap"] is None
    record["statistics"]["minimum_gap"] = np.inf
    with RunStore.open(stored) as store:
        store.append_cycle(record)
        with Run(stored) as opened:
            assert opened.pending == 1 and math.isnan(opened.cycle(2)["statistics"]["minimum_gap"])
            assert np.isnan(opened.statistics()["minimum_gap"]).all()
        store.save({"x": 1.0})
        store.consolidate()
    with h5py.File(stored / "trajectory.h5") as file:
        assert math.isnan(file["cycles/statistics/minimum_gap"][2])


def test_stopped_in_mid_cycle_without_a_gap(tmp_path):
    """A checkpoint in mid-cycle holds no infinity; the run that continues goes on looking for the smallest gap."""
    config = from_dict({"particles": {"number": 2, "volume_fraction": 1e-6}, "repulsion": None,
                        "flow": {"type": "oscillatory", "amplitude": 0.5}, "duration": {"cycles": 1}})  # fmt: skip
    start = prepare_initial(config, ".")
    first, second = (Simulation(config, 1, start.length) for _ in range(2))
    first.start(start.positions, start.tilt)
    first.begin_cycle()
    first.step()
    content, partial = first.dump()
    assert math.isnan(content["counters"]["minimum_gap"])
    second.load(content, partial)
    assert second.suspension.counters.minimum_gap == math.inf
    second.suspension.count_contacts(np.array([[0.0, 0, 0], [2.5, 0, 0]]), 0.0, 0.0)
    assert second.suspension.counters.minimum_gap == 0.5


@pytest.mark.parametrize(
    ("value", "has", "stored", "shown"),
    [(1.5, True, 1.5, "1.5"), (0, True, 0, "0"), (-math.inf, False, math.nan, "-"), (math.nan, False, math.nan, "-"),
     (np.float32(np.inf), False, math.nan, "-"), (None, False, None, "-")],
)  # fmt: skip
def test_single_numbers(value, has, stored, shown):
    """`has_value`, `known`, `plain` and `text` agree."""
    assert missing.has_value(value) is has and missing.text(value) == shown
    assert missing.known(value) is stored or np.array_equal(missing.known(value), stored, equal_nan=True)
    assert missing.plain(value) == (value if has else None)


def test_arrays_and_extremes():
    """Integers stay; infinities count neither as smallest nor as largest; nothing gives NaN."""
    values = np.array([np.inf, 2.0, np.nan, -1.0, -np.inf])
    assert missing.smallest(values) == -1.0 and missing.largest(values) == 2.0
    assert np.array_equal(missing.known(values), [np.nan, 2.0, np.nan, -1.0, np.nan], equal_nan=True)
    assert missing.known(np.arange(3)).dtype.kind == "i"
    assert math.isnan(missing.smallest([])) and math.isnan(missing.largest([np.inf]))
    nested = {"a": (values, np.int64(3), "x", True)}
    assert missing.plain(nested) == {"a": [[None, 2.0, None, -1.0, None], 3, "x", True]}


def test_open_interval_and_straight_cloud():
    """An amplitude range without an upper end, and the elongation of a cloud that is a line."""
    assert str(Range(0.8, math.inf, 1.6)) == "above 0.8"
    cloud = DisplacementCloud()
    cloud._cloud = np.outer([-1.0, 1.0], [1.0, 0.0, 0.0])
    assert math.isnan(cloud.elongation)
