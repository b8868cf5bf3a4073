"""Collections of stored runs with known moduli and displacements: grouping, seeds, files, the command line."""

from __future__ import annotations

import csv
import json
import math
import shutil
from dataclasses import replace

import numpy as np
import pytest
from synthetic_runs import oscillatory_record, steady_record, stress, write_run

from suspend.analysis.activity import ActiveFraction
from suspend.analysis.collection import Collection, Series
from suspend.analysis.diffusion import SelfDiffusion
from suspend.analysis.displacements import CyclicDiffusivity, DisplacementCloud
from suspend.analysis.phase_diagram import PhaseDiagram
from suspend.analysis.relaxation import Relaxation
from suspend.analysis.run_paths import find_runs
from suspend.analysis.signatures import Signatures
from suspend.config import from_dict
from suspend.errors import ConfigurationError, StorageError
from suspend.io import Run
from suspend_cli.main import main

AMPLITUDES = (0.4, 0.8, 1.0, 1.6)
UNIT = 2.0  # viscosity times omega


def config_of(gamma0: float, phi: float, seed: int, cycles: int, **more) -> str:
    tree = {
        "seed": seed,
        "particles": {"number": 4, "volume_fraction": phi},
        "fluid": {"viscosity": 2.0},
        "flow": {"type": "oscillatory", "amplitude": gamma0},
        "duration": {"cycles": cycles},
    }
    return from_dict(tree | more).to_yaml()


def make_run(path, gamma0: float, phi: float = 0.4, seed: int = 1, cycles: int = 6, finished: bool = True, **more):
    """eta_r' = 3 + (gamma0 - 1)^2 + seed/100, -eta3'/eta1' = 0.05 - (gamma0 - 0.8)^2/10, -nu0 = (gamma0 - 0.9)+,

    nu2 and nu4 that cross over at 0.8; D_cyc = gamma0^2/50: spheres go +-d to and fro along y.
    """
    unit = UNIT * gamma0
    eta1 = 3.0 + (gamma0 - 1.0) ** 2 + 0.01 * seed
    eta3 = -eta1 * (0.05 - 0.1 * (gamma0 - 0.8) ** 2)

    def hydrodynamic(theta):
        shear = (eta1 - 1.0) * np.cos(theta) + eta3 * np.cos(3.0 * theta)
        n2 = -max(0.0, gamma0 - 0.9) + (0.05 + abs(gamma0 - 0.8)) * np.cos(2.0 * theta) + 0.1 * np.cos(4.0 * theta)
        return unit * stress(shear, 0.0, n2, 0.0)

    parts = {"hydrodynamic": hydrodynamic, "interparticle": lambda theta: stress(np.zeros(len(theta)))}
    scales = {"gamma0": gamma0, "omega": 1.0, "viscosity": 2.0, "phase": 0.0}
    distance = math.sqrt(8.0 * gamma0 * gamma0**2 / 50.0)
    signs = np.array([1.0, -1.0, 1.0, -1.0])[:, None] * [0.0, 1.0, 0.0]
    walk = [10.0 + distance * (k % 2) * signs for k in range(cycles + 1)]
    records = [oscillatory_record(k, scales, parts, 32, walk[k]) for k in range(cycles)]
    config = config_of(gamma0, phi, seed, cycles, **more)
    return write_run(path, config, records, walk[-1] if finished else None)


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """Runs at four amplitudes, two seeds, two volume fractions."""
    base = tmp_path_factory.mktemp("runs")
    for phi in (0.3, 0.4):
        for gamma0 in AMPLITUDES:
            for seed in (1, 2):
                make_run(base / f"phi{phi}_g{gamma0}_s{seed}", gamma0, phi, seed)
    return base


def test_values_grouping_and_seeds(folder):
    """All quantities of all runs to 1e-10, two series, means and standard errors over the seeds (half their spread)."""
    found = Collection().compute(folder)
    assert len(found) == 16 and [s.phi for s in found.series] == [0.3, 0.4] and {s.setup for s in found.series} == {""}
    x = np.array(AMPLITUDES)
    for series in found.series:
        np.testing.assert_array_equal(series.gamma0, x)
        assert series.runs.tolist() == [2] * 4
        np.testing.assert_allclose(series.mean("eta_r_prime"), 3.015 + (x - 1.0) ** 2, rtol=1e-10)
        np.testing.assert_allclose(series.error("eta_r_prime"), 0.005, rtol=1e-8)
        np.testing.assert_allclose(series.mean("minus_eta3_over_eta1"), 0.05 - 0.1 * (x - 0.8) ** 2, rtol=1e-10)
        np.testing.assert_allclose(series.mean("minus_N2_nu0"), np.maximum(0.0, x - 0.9), atol=1e-10)
        np.testing.assert_allclose(series.mean("nu4_over_nu2"), 0.1 / (0.05 + abs(x - 0.8)), rtol=1e-10)
        np.testing.assert_allclose(series.mean("D_cyc"), x**2 / 50.0, rtol=1e-10)
    table = found.table()
    assert table["seed[-]"].tolist() == [1, 2] * 8 and set(table["state"]) == {"undecided"}
    assert len(found.notes) == 1 and "total strain is 38.4 at most" in found.notes[0]  # six cycles each
    signatures = Signatures().compute(found.series[0])
    ranges = [(r.low, r.high) for r in signatures.ranges.values()]
    assert ranges == [(0.8, 1.6), (0.4, 1.0), (0.8, 1.0), (0.4, 1.0)]
    assert (signatures.bound.low, signatures.bound.high) == (0.8, 1.0)
    assert any("at most 2 seeds" in note for note in signatures.notes)


def test_coherent_ratio_ignores_noise(tmp_path):
    """|<nu_4>|/|<nu_2>| of coefficients whose sign alternates from cycle to cycle about a small mean is that of means.

    nu_4 = 0.01 +- 0.2: the mean of magnitudes would be 0.2. Six cycles: the +- cancel exactly.
    """
    records = []
    for k in range(6):
        noise = 0.2 * (-1.0) ** k

        def part(theta, noise=noise):
            n2 = 0.5 * np.cos(2.0 * theta) + (0.01 + noise) * np.cos(4.0 * theta)
            return UNIT * stress(np.cos(theta), 0.0, n2, 0.0)

        parts = {"hydrodynamic": part, "interparticle": lambda theta: stress(np.zeros(len(theta)))}
        records.append(oscillatory_record(k, {"gamma0": 1.0, "omega": 1.0, "viscosity": 2.0, "phase": 0.0}, parts, 32))
    path = write_run(tmp_path / "run", config_of(1.0, 0.4, 1, 6), records, np.zeros((4, 3)))
    found = Collection(last=6).compute(path).members[0]
    assert found.values["nu4_over_nu2"] == pytest.approx(0.02, rel=1e-9) and found.errors["nu4_over_nu2"] > 0.1


def test_other_physics_is_another_series(tmp_path):
    """Runs that differ in far field, repulsion or number are not averaged; the label names only what differs."""
    make_run(tmp_path / "a", 0.8)
    make_run(tmp_path / "b", 0.8, far_field="identity")
    make_run(tmp_path / "c", 0.8, repulsion={"force": 5.0})
    found = Collection().compute(tmp_path)
    assert [len(s.groups) for s in found.series] == [1, 1, 1]
    labels = " | ".join(s.setup for s in found.series)
    assert "far_field = identity" in labels and "repulsion" in labels and "lubrication" not in labels
    make_run(tmp_path / "d", 0.8, output={"samples_per_cycle": 64}, seed=2)
    assert [s.runs.tolist() for s in Collection().compute(tmp_path).series].count([2]) == 1


def test_any_other_key_makes_groups_where_it_would_be_averaged(tmp_path):
    """Two tolerances or kinds of start at one amplitude are two series, one key named for those that go together.

    Along a curve, one value at each amplitude, they are one series and a note; files that starts are read from are one
    kind of start.
    """
    for tolerance in (1e-3, 1e-4):
        for gamma0 in (0.4, 0.8):
            make_run(tmp_path / "a" / f"{tolerance}_{gamma0}", gamma0, tolerance=tolerance)
    found = Collection().compute(tmp_path / "a").series
    assert [s.setup for s in found] == ["tolerance = 0.0001", "tolerance = 0.001"]
    assert [s.runs.tolist() for s in found] == [[1, 1], [1, 1]]
    for gamma0, tolerance in ((0.4, 1e-3), (0.8, 1e-4)):
        make_run(tmp_path / "b" / f"{gamma0}", gamma0, tolerance=tolerance)
    along = Collection().compute(tmp_path / "b")
    assert [s.setup for s in along.series] == [""] and any("tolerance differ" in note for note in along.notes)
    for k, start in enumerate(("equilibrium", "quenched", "a.npz", "b.npz")):
        make_run(tmp_path / "c" / start, 0.8, seed=k, particles=sphere_keys(start))
    starts = Collection().compute(tmp_path / "c").series
    assert [len(s.groups[0]) for s in starts] == [1, 1, 2] and starts[2].setup == "particles.initial = read from a file"


def sphere_keys(start):
    """Section particles with another start."""
    return {"number": 4, "volume_fraction": 0.4, "initial": start}


def test_a_run_without_the_value_is_not_in_the_mean_nor_its_error(folder):
    """Of two runs one knows the value: mean and error are that run's own, though it is not the first."""
    group = Collection().compute(folder).series[0].groups[0]
    unknown = replace(group[0], values=group[0].values | {"D_cyc": math.nan}, errors=group[0].errors | {"D_cyc": 7.0})
    known = replace(group[1], errors=group[1].errors | {"D_cyc": 0.5})
    series = Series(0.3, "", ((unknown, known),))
    assert series.mean("D_cyc")[0] == known.values["D_cyc"] and series.error("D_cyc")[0] == 0.5


def test_window_and_total_strain(folder, tmp_path):
    """`strain` ends the averages there; runs shorter than the others are named; `last` is at most what there is."""
    make_run(tmp_path / "long", 0.8, cycles=20)
    make_run(tmp_path / "short", 1.0, cycles=3)
    found = Collection().compute(tmp_path)
    assert any("shorter: short (12)" in note for note in found.notes)
    assert [m.total_strain for m in found.members] == [pytest.approx(64.0), pytest.approx(12.0)]
    found = Collection(strain=16.0, last=2).compute(tmp_path / "long").members[0]
    assert found.total_strain == pytest.approx(16.0) and found.last == 2 and found.cycles == 5
    with pytest.raises(ConfigurationError, match="first cycle ends beyond total strain 1"):
        Collection(strain=1.0).compute(folder)
    with pytest.raises(ConfigurationError):
        Collection(last=0)


def test_unusable_runs_are_named_and_left_out(folder, tmp_path):
    """Truncated, foreign, without cycles, without oscillation: a note each, the rest is analysed; none left: error."""
    good = make_run(tmp_path / "good", 0.8)
    torn = shutil.copytree(good, tmp_path / "torn")
    (torn / "trajectory.h5").write_bytes((good / "trajectory.h5").read_bytes()[:3000])
    (tmp_path / "foreign.h5").write_text("no trajectory")
    write_run(tmp_path / "begun", config_of(0.8, 0.4, 1, 3), [])
    config = from_dict(
        {
            "particles": {"number": 4, "volume_fraction": 0.4},
            "flow": {"type": "steady", "rate": 1.0},
            "duration": {"strain": 1.0},
        }
    )
    steady = steady_record(0, {"rate": 1.0, "viscosity": 1.0}, np.zeros((8, 6)))
    write_run(tmp_path / "steady", config.to_yaml(), [steady], np.zeros((4, 3)))
    bad = [tmp_path / name for name in ("torn", "foreign.h5", "begun", "steady")]
    found = Collection().compute([good, *bad])
    assert len(found) == 1
    for name, why in (("torn", ""), ("foreign.h5", ""), ("begun", "no complete cycle"), ("steady", "flow is steady")):
        assert any("left out" in note and name in note and why in note for note in found.notes)
    with pytest.raises(ConfigurationError, match="no usable run"):
        Collection().compute(bad)


def test_unfinished_run_and_repeated_seed(tmp_path):
    """A run still going on counts with its complete cycles and says so; the same seed twice is pointed out."""
    make_run(tmp_path / "a", 0.8, finished=False)
    make_run(tmp_path / "b", 0.8)
    found = Collection().compute(tmp_path)
    assert found.series[0].runs.tolist() == [2]
    assert any("not finished" in note for note in found.notes)
    assert any("same parameters and seed" in note for note in found.notes)
    assert found.members[0].values["D_cyc"] == pytest.approx(0.0128)


def test_finding_runs(folder, tmp_path):
    """Folders, patterns and files find each run once, in order; nothing found is an error that names what was given."""
    assert len(find_runs(folder)) == 16 and len(find_runs([folder, f"{folder}/phi0.3_*"])) == 16
    (folder / "phi0.3_notes.json").write_text("{}")
    names = [path.name for path in find_runs(f"{folder}/phi0.3_*")]
    (folder / "phi0.3_notes.json").unlink()
    assert names == sorted(names) and len(names) == 8
    with pytest.raises(ConfigurationError, match="matches no run"):
        find_runs(f"{folder}/phi0.9*")
    with pytest.raises(StorageError, match="does not exist"):
        find_runs(tmp_path / "absent")


def call(capsys, *arguments) -> tuple[int, str, str]:
    with pytest.raises(SystemExit) as stop:
        main([str(argument) for argument in arguments])
    return stop.value.code, *capsys.readouterr()


def test_command_line(folder, tmp_path, capsys):
    """Several runs print the table with signatures and phase diagram; --csv has one row a run; --json is valid JSON."""
    runs = sorted(folder.iterdir())
    code, text, log = call(capsys, "analyze", *runs, "--csv", tmp_path / "runs.csv")
    assert code == 0 and "16 runs in 2 series" in text and "0.821" in text and "written" in log
    assert text.count("minimum of eta_r'         (0.8, 1.6)") == 2 and "(0.8, 1)" in text
    assert max(len(line) for line in text.splitlines() if str(folder) not in line and "Note" not in line) <= 110
    with open(tmp_path / "runs.csv", newline="") as file:
        rows = list(csv.DictReader(file))
    assert len(rows) == 16 and float(rows[0]["eta_r_prime[-]"]) == pytest.approx(3.37) and rows[0]["seed[-]"] == "1"
    code, text, _ = call(capsys, "analyze", folder, "--json", "--last", 2)
    content = json.loads(text)
    assert code == 0 and content["collection"]["runs"] == 16
    assert content["phase_diagram"]["series"][1]["ranges"]["gamma_c"]["range"] == [0.8, 1.0]
    code, text, _ = call(capsys, "analyze", runs[0])
    assert code == 0 and "Harmonics" in text
    code, _, log = call(capsys, "analyze", *runs, "--plot", tmp_path / "a.png")
    assert code == 2 and "suspend plot" in log
    code, _, log = call(capsys, "analyze", folder, tmp_path / "absent")
    assert code == 4 and "absent" in log


def test_figures_are_drawn(folder):
    """Every quantity draws into given axes, with finite data where it has some, and says which axes are logarithmic."""
    matplotlib = pytest.importorskip("matplotlib")
    matplotlib.use("Agg")
    from matplotlib.figure import Figure

    def drawn(quantity) -> tuple:
        ax = Figure().subplots()
        quantity.plot(ax)
        ax.figure.canvas.draw()
        assert ax.lines or ax.collections or ax.containers
        return ax.get_xscale(), ax.get_xlabel()

    collection = Collection().compute(folder)
    diagram = PhaseDiagram().compute(collection)
    assert drawn(collection) == ("log", r"$\gamma_0$") and drawn(diagram.signatures[0])[1] == r"$\gamma_0$"
    assert drawn(diagram)[1] == r"$\phi$"
    with Run(folder / "phi0.3_g0.8_s1") as run:
        assert drawn(CyclicDiffusivity().compute(run))[0] == "log" and drawn(ActiveFraction().compute(run))[0] == "log"
        assert drawn(DisplacementCloud(stop=1.0).compute(run))[1] == r"$\Delta_x/a$"
        assert drawn(Relaxation().compute(run))[0] == "log" and drawn(SelfDiffusion().compute(run))[0] == "log"
