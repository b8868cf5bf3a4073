"""Figures: that they hold the data they should, in the format asked for, and leave nothing behind on
errors."""

from __future__ import annotations

import dataclasses
import subprocess
import sys

import numpy as np
import pytest
from synthetic_runs import configuration, oscillatory_record, steady_record, stress, write_run

import suspend.plots as plots
from suspend.analysis.summary import analyze
from suspend.errors import ConfigurationError, StorageError

SCALES = {"gamma0": 0.8, "omega": 1.0, "viscosity": 2.0, "phase": 0.0, "radius": 1.0}
FLOW = {"type": "oscillatory", "amplitude": 0.8}


def oscillatory(path, cycles: int):
    parts = {
        "hydrodynamic": lambda t: stress(np.cos(t) - 0.1 * np.cos(3 * t)),
        "interparticle": lambda t: stress(0 * t),
    }
    walk = np.cumsum(np.random.default_rng(0).normal(size=(cycles + 1, 4, 3)), axis=0)
    records = [oscillatory_record(k, SCALES, parts, unwrapped=walk[k]) for k in range(cycles)]
    return analyze(
        write_run(
            path, configuration(FLOW, {"cycles": max(cycles, 1)}), records, walk[-1] if cycles else None
        )
    )


def steady(path, flow: dict, signs: list[float]):
    scales = {"rate": 1.0, "viscosity": 2.0}
    records = [steady_record(k, scales, stress(np.full(16, 6.0 * s)), s) for k, s in enumerate(signs)]
    return analyze(
        write_run(path, configuration(flow, {"strain": float(len(signs))}), records, np.zeros((4, 3)))
    )


@pytest.fixture
def drawn(monkeypatch):
    """The figures that are drawn, as matplotlib objects."""
    import matplotlib.figure

    figures, save = [], matplotlib.figure.Figure.savefig

    def keep(self, *args, **options):
        figures.append(self)
        return save(self, *args, **options)

    monkeypatch.setattr(matplotlib.figure.Figure, "savefig", keep)
    return figures


def line_data(axis, index=0):
    return axis.get_lines()[index].get_xydata()


def test_curves_are_the_analysis(tmp_path, drawn):
    """Each panel holds the column it names, against total strain; Lissajous curves are closed and of both
    cycles."""
    result = oscillatory(tmp_path / "run", 6)
    plots.plot_first_figure(result, tmp_path / "figure.png")
    panels = {axis.get_title(loc="left"): axis for axis in drawn[0].axes}
    columns = {
        "(a)": "eta_r_prime",
        "(c)": "minus_eta3_over_eta1",
        "(d)": "eta_r_double_prime",
        "(f)": "D_cyc",
    }
    for letter, name in columns.items():
        np.testing.assert_array_equal(
            line_data(panels[letter]), np.stack([result.total_strain, result[name]], 1)
        )
        assert panels[letter].get_xscale() == "log"
    assert panels["(f)"].get_yscale() == "log"
    for letter, against in (("(b)", "rate"), ("(e)", "strain")):
        loop = line_data(panels[letter], 1)
        np.testing.assert_array_equal(loop[:-1, 0], result.waveforms[5][against])
        np.testing.assert_array_equal(loop[-1], loop[0])


@pytest.mark.parametrize("cycles", [1, 2, 45])
def test_texts_do_not_overlap(tmp_path, drawn, cycles):
    """No two labels (axes, ticks, titles, legend) share area on the page, with one, two or many cycles."""
    plots.plot_first_figure(oscillatory(tmp_path / "run", cycles), tmp_path / "figure.pdf")
    figure = drawn[0]
    renderer = figure.canvas.get_renderer()
    boxes = []
    for axis in figure.axes:
        texts = [axis.xaxis.label, axis.yaxis.label, axis.title, axis._left_title]
        texts += [t for which in (axis.xaxis, axis.yaxis) for t in visible_ticks(which)]
        boxes += [(t.get_text(), t.get_window_extent(renderer)) for t in texts if t.get_text().strip()]
    for i, (first, box) in enumerate(boxes):
        for second, other in boxes[i + 1 :]:
            assert not box.overlaps(other), f"{first!r} on {second!r}"


def visible_ticks(axis):
    low, high = sorted(axis.get_view_interval())
    ticks = [t for t in axis.get_major_ticks() if low <= t.get_loc() <= high]
    return [t.label1 for t in ticks if t.label1.get_visible()]


@pytest.mark.parametrize(("suffix", "magic"), [(".png", b"\x89PNG"), (".PDF", b"%PDF"), (".pdf", b"%PDF")])
def test_format_by_suffix(tmp_path, suffix, magic):
    """The suffix decides the format; the file replaces an older one and leaves no temporary behind."""
    path = tmp_path / ("figure" + suffix)
    path.write_bytes(b"old")
    plots.plot_first_figure(oscillatory(tmp_path / "run", 3), path)
    assert path.read_bytes().startswith(magic)
    assert sorted(p.name for p in tmp_path.iterdir()) == sorted(["run", path.name])


@pytest.mark.parametrize("name", ["figure.jpg", "figure", "figure.png.txt"])
def test_other_suffixes_are_refused(tmp_path, name):
    """A clear error before anything is drawn or written."""
    with pytest.raises(ConfigurationError, match=r"\.png or \.pdf"):
        plots.plot_first_figure(oscillatory(tmp_path / "run", 2), tmp_path / name)
    assert not (tmp_path / name).exists()


def test_unwritable_folder_and_empty_run(tmp_path):
    """A folder that does not exist and a run without cycles: one error each."""
    with pytest.raises(StorageError, match="write the figure"):
        plots.plot_first_figure(oscillatory(tmp_path / "run", 2), tmp_path / "nowhere" / "figure.png")
    with pytest.raises(ConfigurationError, match="nothing to draw"):
        plots.plot_first_figure(oscillatory(tmp_path / "empty", 0), tmp_path / "figure.png")


@pytest.mark.parametrize("fill", [0.0, np.nan])
def test_no_diffusion_is_said_in_words(tmp_path, drawn, fill):
    """D_cyc that is zero or unknown cannot be drawn on a logarithmic axis: the panel says so."""
    result = oscillatory(tmp_path / "run", 3)
    values = result.values.copy()
    values[:, result.columns.index("D_cyc[-]")] = fill
    plots.plot_first_figure(dataclasses.replace(result, values=values), tmp_path / "figure.png")
    panel = drawn[0].axes[5]
    assert ("zero" if fill == 0.0 else "not known") in panel.texts[0].get_text()


@pytest.mark.parametrize(
    ("flow", "signs", "column"),
    [
        ({"type": "steady", "rate": 1.0}, [1.0] * 5, "eta_r"),
        ({"type": "reversal", "rate": 1.0, "reversal_strain": 2.0}, [1.0] * 2 + [-1.0] * 3, "eta_r"),
        ({"type": "quiescent", "rate": 1.0}, [0.0] * 4, "sigma_xy"),
    ],
)
def test_flows_without_oscillation(tmp_path, drawn, flow, signs, column):
    """Blocks of the other flows: viscosity (stress, where quiescent) against strain, and N1, N2."""
    result = steady(tmp_path / "run", flow, signs)
    plots.plot_first_figure(result, tmp_path / "figure.png")
    left, right = drawn[0].axes
    np.testing.assert_array_equal(line_data(left)[:, 1], result[column])
    np.testing.assert_array_equal(line_data(right, 1)[:, 1], result["N2"])


def test_matplotlib_stays_out_of_the_analysis():
    """Tables and JSON do not pay for matplotlib, nor for Numba: neither is imported with the analysis."""
    code = "import sys, suspend.plots, suspend.analysis.summary; print({*sys.argv} & {*sys.modules})"
    done = subprocess.run(
        [sys.executable, "-c", code, "matplotlib", "numba"], capture_output=True, text=True, check=True
    )
    assert done.stdout.strip() == "set()"
