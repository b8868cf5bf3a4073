"""Figures by name: each is drawn without warnings, holds the data it should, and writes them with units."""

from __future__ import annotations

import csv
import subprocess
import sys
import warnings

import numpy as np
import pytest
from figure_runs import NUMBER, VISCOSITY, doubling, eta_r, make_run, minus_nu0, thinning
from synthetic_runs import EDGE, configuration, steady_record, stress, write_run

from suspend.errors import ConfigurationError, StorageError
from suspend.figures.animation import Animation
from suspend.figures.cell import pictures
from suspend.figures.make import make_figure
from suspend.figures.page import draw_page
from suspend.figures.registry import FIGURES, figure_kind
from suspend.figures.runs import open_runs
from suspend.figures.style import journal

AMPLITUDES = (0.4, 0.8, 1.2, 2.0)
TEXT_COLUMNS = {"setup", "state", "signature", "error_over"}


@pytest.fixture(scope="module")
def many(tmp_path_factory):
    """Runs at two volume fractions, one of them with far field, too, and one amplitude with two seeds."""
    folder = tmp_path_factory.mktemp("many")
    for gamma0 in AMPLITUDES:
        make_run(folder / f"a{gamma0}", gamma0)
        make_run(folder / f"b{gamma0}", gamma0, phi=0.3)
    make_run(folder / "far", 0.8, far_field="ewald")
    make_run(folder / "seed2", 0.8, seed=2)
    return folder


@pytest.fixture(scope="module")
def one(tmp_path_factory):
    """A run with frames at eight phases and the stress of every sphere."""
    path = tmp_path_factory.mktemp("one") / "run"
    return make_run(path, 0.8, cycles=3, phases=np.arange(8) / 8, particle_stress=True)


def drawn(name, runs, output, **options):
    """The files, with every warning an error."""
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        return make_figure(name, runs, output, **options).paths


def read(path):
    with path.open(newline="") as file:
        rows = list(csv.DictReader(file))
    return {name: [row[name] for row in rows] for name in rows[0]}


def values(path, name):
    return np.array([float(v) for v in read(path)[name]])


@pytest.mark.parametrize("kind", [k for k in FIGURES if k.name != "animation"], ids=lambda k: k.name)
def test_every_figure(tmp_path, many, one, kind):
    """A PNG and a PDF, and a CSV for each panel whose numeric columns all carry a unit; no warning."""
    files = drawn(kind.name, [one] if kind.name == "snapshot" else [many], tmp_path)
    assert files[0].read_bytes()[:4] == b"\x89PNG" and files[1].read_bytes()[:4] == b"%PDF"
    tables = [path for path in files if path.suffix == ".csv"]
    assert len(tables) >= len(kind.panels)
    for path in tables:
        columns = read(path)
        for name, column in columns.items():
            assert name in TEXT_COLUMNS or (name.endswith("]") and "[" in name), (path.name, name)
            assert name in TEXT_COLUMNS or all(v == "" or np.isfinite(float(v)) for v in column)
    assert sorted(p.name for p in tmp_path.iterdir()) == sorted(p.name for p in files)


@pytest.mark.parametrize(
    ("name", "file", "column", "expected"),
    [
        ("viscosity-amplitude", "", "eta_r_prime[-]", lambda g, phi: eta_r(g, phi)),
        ("thinning", "", "minus_eta3_over_eta1[-]", lambda g, _: thinning(g)),
        ("n2-average", "", "minus_nu0[eta0]", lambda g, _: minus_nu0(g)),
        ("n2-average", "_interparticle", "minus_nu0_interparticle[eta0]", lambda g, _: minus_nu0(g)),
        ("n2-doubling", "", "nu4_abs_over_nu2_abs[-]", lambda g, _: doubling(g)),
        ("n2-doubling", "_hydrodynamic", "nu4_abs_over_nu2_abs_hydrodynamic[-]", lambda g, _: doubling(g)),
        ("n1", "_hydrodynamic", "N1_mean_hydrodynamic[eta0*gamma0*omega]", lambda g, _: -0.1),
    ],
)
def test_values_against_amplitude(tmp_path, many, name, file, column, expected):
    """The points are the moduli that the stored stresses were made of (Fourier sums: to rounding)."""
    drawn(name, [many], tmp_path, formats=["png"])
    path = tmp_path / f"{name}{file}.csv"
    gamma0, phi = values(path, "gamma0[-]"), values(path, "phi[-]")
    assert len(gamma0) == 2 * len(AMPLITUDES) + 1
    np.testing.assert_allclose(values(path, column), [expected(*p) for p in zip(gamma0, phi, strict=True)], atol=1e-12)


def test_final_diffusivity(tmp_path, many):
    """A step of 0.05 gamma0 along each axis: D_cyc = 3 (0.05 gamma0)^2/(8 gamma0), within 5 errors; seeds averaged."""
    drawn("diffusivity-amplitude", [many], tmp_path, formats=["png"])
    path = tmp_path / "diffusivity-amplitude.csv"
    gamma0, found = values(path, "gamma0[-]"), values(path, "D_cyc[-]")
    expected = 3.0 * (0.05 * gamma0) ** 2 / (8.0 * gamma0)
    assert (np.abs(found - expected) < 5.0 * expected * np.sqrt(2.0 / (3.0 * NUMBER))).all()
    assert sorted(values(path, "runs[-]"))[-1] == 2


def test_onset_line_crosses_where_n2_begins(tmp_path, many):
    """-nu_0 = gamma0 - 0.9 at the last amplitudes but one lies on the dashed line only where the line is exact."""
    drawn("n2-average", [many], tmp_path, formats=["png"])
    path = tmp_path / "n2-average_fits.csv"
    x = np.array(AMPLITUDES[-3:])
    slope, intercept = np.polyfit(x, [minus_nu0(g) for g in x], 1)
    np.testing.assert_allclose(values(path, "zero_at_gamma0[-]"), -intercept / slope, rtol=1e-9)
    np.testing.assert_allclose(values(path, "slope_per_gamma0[eta0]"), slope, rtol=1e-9)


def test_half_cycle_is_in_the_order_of_time(tmp_path, many):
    """The last half cycle runs over positive rates from zero through the maximum to zero."""
    drawn("viscosity-evolution", [many], tmp_path, formats=["png"])
    path = tmp_path / "viscosity-evolution_lissajous.csv"
    gamma0, rate = values(path, "gamma0[-]"), values(path, "rate[gamma0*omega]")
    for amplitude in set(gamma0):
        half = rate[gamma0 == amplitude]
        np.testing.assert_allclose(half, np.cos(np.linspace(-np.pi / 2, np.pi / 2, 17)), atol=1e-12)


@pytest.mark.parametrize("name", ["viscosity", "n2", "dynamics", "clusters", "pair-distribution", "structure-factor"])
def test_texts_do_not_overlap(many, name):
    """No two labels (axes, ticks, titles) of a page share area, and none leaves it."""
    kind = figure_kind(name)
    with journal():
        runs = open_runs([many])
        figure = draw_page([builder(runs) for builder in kind.builders()], kind.size)
        figure.draw_without_rendering()
        boxes = label_boxes(figure)
        page = figure.bbox
    for i, (first, box) in enumerate(boxes):
        assert box.x0 >= -1 and box.y0 >= -1 and box.x1 <= page.x1 + 1 and box.y1 <= page.y1 + 1, first
        for second, other in boxes[i + 1 :]:
            assert not box.overlaps(other), f"{first!r} on {second!r}"


def label_boxes(figure):
    renderer, boxes = figure.canvas.get_renderer(), []
    for ax in figure.axes:
        texts = [ax.title, ax._left_title, ax._right_title]
        if ax.axison:
            texts += [ax.xaxis.label, ax.yaxis.label]
            for which in (ax.xaxis, ax.yaxis):
                low, high = sorted(which.get_view_interval())
                ticks = [t for t in which.get_major_ticks() if low <= t.get_loc() <= high]
                texts += [t.label1 for t in ticks if t.label1.get_visible()]
        shown = [t for t in texts if t.get_text().strip() and t.get_visible()]
        # two pixels in: the empty corners of boxes may touch
        boxes += [(t.get_text(), t.get_window_extent(renderer).padded(-2)) for t in shown]
    return boxes


def test_snapshot_shows_the_stress_in_the_sheared_cell(one):
    """Centres lie in the cell sheared by the strain; the mean over the spheres is the bulk stress less the fluid's."""
    scalar, found = pictures(open_runs([one]).only, "stress", None, None)
    assert scalar.signed and [p.phase for p in found] == (np.arange(8) / 8).tolist()
    for picture in found:
        strain = 0.8 * np.sin(2.0 * np.pi * picture.phase)
        assert picture.tilt == pytest.approx(strain, abs=1e-12)
        inside = picture.centres[:, :2] @ np.linalg.inv([[EDGE, 0.0], [strain * EDGE, EDGE]])
        assert (inside > -1e-9).all() and (inside < 1 + 1e-9).all()
        theta = 2.0 * np.pi * picture.phase
        first = eta_r(0.8, 0.4)
        bulk = (first - 1.0) * np.cos(theta) - first * thinning(0.8) * np.cos(3.0 * theta)
        assert picture.values.mean() == pytest.approx(bulk, abs=1e-12)
    np.testing.assert_allclose(found[2].corners[2], [EDGE * 1.8, EDGE])


def test_colours(one):
    """Displacement and the components by name; what is not stored is refused with the names there are."""
    member = open_runs([one]).only
    _, found = pictures(member, "n2", 0, [0.0])
    _, displaced = pictures(member, "displacement", 0, [0.0])
    expected = 0.01 + 0.1 - minus_nu0(0.8)
    assert found[0].values.mean() == pytest.approx(expected, abs=1e-12)
    assert np.sqrt(np.mean(displaced[0].values ** 2)) == pytest.approx(0.05 * 0.8 * np.sqrt(3), rel=0.2)
    with pytest.raises(ConfigurationError, match="stress-xx"):
        pictures(member, "charge", 0, None)
    with pytest.raises(ConfigurationError, match=r"output\.position_phases"):
        pictures(member, "none", 0, [0.3])
    with pytest.raises(ConfigurationError, match="no cycle 7"):
        pictures(member, "none", 7, None)


def test_animation(tmp_path, one):
    """A GIF with one image for each frame of the cycle that differ, and its CSV."""
    from PIL import Image

    files = drawn("animation", [one], tmp_path / "cycle.gif", colour="none")
    assert [path.name for path in files] == ["cycle.gif", "cycle.csv"]
    with Image.open(files[0]) as movie:
        assert movie.n_frames == 8
        seen = []
        for k in range(8):
            movie.seek(k)
            seen.append(movie.convert("RGB").tobytes())
    assert len(set(seen)) == 8
    assert len(values(files[1], "x[a]")) == 8 * NUMBER


def test_animation_needs_frames_and_ffmpeg(tmp_path, many, one, monkeypatch):
    """Two frames a cycle are no movement; MP4 without ffmpeg is refused, and nothing is left behind."""
    from matplotlib.animation import FFMpegWriter

    with pytest.raises(ConfigurationError, match=r"output\.position_phases"):
        Animation(open_runs([many / "a0.4"]), colour="none")
    monkeypatch.setattr(FFMpegWriter, "isAvailable", classmethod(lambda cls: False))
    with pytest.raises(ConfigurationError, match="ffmpeg"):
        make_figure("animation", [one], tmp_path / "cycle.mp4")
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(
    ("name", "which", "options", "text"),
    [
        ("viscocity", "many", {}, "did you mean viscosity"),
        ("xyzzy", "many", {}, "--list"),
        ("snapshot", "a0.4", {}, "output.particle_stress: true"),
        ("snapshot", "many", {}, "of one run"),
        ("thinning", "a0.4", {}, "flow.amplitude"),
        ("thinning", "many", {"phase": 0.5}, "takes no --phase"),
        ("thinning", "many", {"formats": ["gif"]}, "png, pdf"),
        ("viscosity", "steady", {}, "its flow|the flow of"),
    ],
)
def test_bad_requests(tmp_path, many, name, which, options, text):
    """One clear message each, and no file."""
    if which == "steady":
        flow = {"type": "steady", "rate": 1.0}
        records = [steady_record(0, {"rate": 1.0, "viscosity": VISCOSITY}, stress(np.full(8, 6.0)))]
        run = write_run(tmp_path / "steady", configuration(flow, {"strain": 1.0}), records, np.zeros((4, 3)))
    else:
        run = many if which == "many" else many / which
    with pytest.raises(ConfigurationError, match=text):
        make_figure(name, [run], tmp_path / "figure", **options)
    assert not list(tmp_path.glob("figure*"))


def test_snapshot_of_steady_shear(tmp_path):
    """Drawn at any flow; displacements over a cycle are refused where there is none."""
    flow = {"type": "steady", "rate": 1.0}
    record = steady_record(0, {"rate": 1.0, "viscosity": VISCOSITY}, stress(np.full(8, 6.0)))
    record["particle_stress"] = np.broadcast_to(record["stress_hydrodynamic"][:, None] / 4.0, (8, 4, 6))
    run = write_run(tmp_path / "steady", configuration(flow, {"strain": 1.0}), [record], np.zeros((4, 3)))
    drawn("snapshot", [run], tmp_path / "a", formats=["png"])
    np.testing.assert_allclose(values(tmp_path / "a.csv", "stress[eta0*rate]"), 6.0 / VISCOSITY)
    with pytest.raises(ConfigurationError, match="oscillatory"):
        make_figure("snapshot", [run], tmp_path / "b", colour="displacement")


def test_broken_and_unfinished_runs(tmp_path, many):
    """Alone: an error; among others: left out and said."""
    broken = tmp_path / "broken"
    broken.mkdir()
    (broken / "trajectory.h5").write_bytes(b"no HDF5")
    empty = make_run(tmp_path / "empty", 0.8, cycles=1)
    config = (empty / "trajectory.h5").read_bytes()
    (empty / "trajectory.h5").write_bytes(config[: len(config) // 2])
    with pytest.raises(StorageError):
        make_figure("viscosity-evolution", [broken], tmp_path / "x")
    with pytest.raises(StorageError):
        make_figure("viscosity-evolution", [tmp_path / "nowhere"], tmp_path / "x")
    made = make_figure("viscosity-evolution", [many, broken, empty], tmp_path / "x", ["png"], with_csv=False)
    assert [path.name for path in made.paths] == ["x.png"]
    assert sum("left out" in note for note in made.notes) == 2


def test_one_cycle(tmp_path):
    """A run of one cycle is drawn where that means something."""
    run = make_run(tmp_path / "run", 0.8, cycles=1)
    for name in ("viscosity-evolution", "n2-lissajous", "diffusivity-evolution", "neighbour-distance"):
        assert drawn(name, [run], tmp_path / name, formats=["png"])[0].exists()


def test_missing_half_cycle_is_said_in_the_panel(tmp_path):
    """Without positions at half a cycle the cloud is left out, the rest is drawn, and the CSV has no cloud."""
    run = make_run(tmp_path / "run", 0.8, phases=(0.0,))
    files = drawn("diffusivity-evolution", [run], tmp_path, formats=["png"])
    assert [path.name for path in files] == ["diffusivity-evolution.png", "diffusivity-evolution.csv"]


def test_names_do_not_load_matplotlib():
    """The list of names and the command start without matplotlib and numba."""
    code = "import sys, suspend.figures.registry, suspend_cli.plot; print({*sys.argv} & {*sys.modules})"
    done = subprocess.run(
        [sys.executable, "-c", code, "matplotlib", "numba"], capture_output=True, text=True, check=True
    )
    assert done.stdout.strip() == "set()"
