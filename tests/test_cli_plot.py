"""The command `suspend plot`: names, files, formats, messages and exit codes."""

from __future__ import annotations

import pytest
from figure_runs import make_run

from suspend.figures.registry import FIGURES
from suspend_cli.main import main


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    """A run of two cycles."""
    return make_run(tmp_path_factory.mktemp("plot") / "run", 0.8, cycles=2)


def call(capsys, *arguments):
    with pytest.raises(SystemExit) as stopped:
        main(["plot", *map(str, arguments)])
    out, err = capsys.readouterr()
    return stopped.value.code, out, err


def test_list(capsys):
    """One line for each figure, with its number in the paper."""
    code, out, _ = call(capsys, "--list")
    assert code == 0 and len(out.splitlines()) == len(FIGURES)
    assert any(line.startswith("viscosity ") and "fig. 2 " in line for line in out.splitlines())


@pytest.mark.parametrize(
    ("options", "written"),
    [
        ((), ["a.csv", "a_lissajous.csv", "a.pdf", "a.png"]),
        (("--no-csv",), ["a.pdf", "a.png"]),
        (("--no-csv", "--format", "pdf"), ["a.pdf"]),
        (("--no-csv", "--format", "both"), ["a.pdf", "a.png"]),
    ],
)
def test_files(capsys, tmp_path, run, options, written):
    """The names of what was written go to stdout."""
    code, out, _ = call(capsys, "fig2a", run, "-o", tmp_path / "a", *options)
    assert code == 0
    assert sorted(p.name for p in tmp_path.iterdir()) == sorted(written)
    assert sorted(out.split()) == sorted(str(tmp_path / name) for name in written)


def test_suffix_and_folder(capsys, tmp_path, run):
    """A suffix decides the format; into a folder the figure's own name is taken."""
    assert call(capsys, "viscosity-evolution", run, "-o", tmp_path / "b.PNG", "--no-csv")[0] == 0
    assert call(capsys, "n2-lissajous", run, "-o", tmp_path, "--no-csv", "--format", "png")[0] == 0
    assert sorted(p.name for p in tmp_path.iterdir()) == ["b.png", "n2-lissajous.png"]


@pytest.mark.parametrize(
    ("arguments", "code", "text"),
    [
        (("viscosty", "RUN"), 2, "did you mean viscosity?"),
        (("snapshot", "RUN"), 2, "output.particle_stress: true"),
        (("animation", "RUN", "--colour", "none"), 2, "output.position_phases"),
        (("viscosity", "RUN"), 2, "several strain amplitudes"),
        (("n1", "RUN", "--cycle", "0"), 2, "takes no --cycle"),
        (("snapshot", "RUN", "--phase", "1.5"), 2, "--phase"),
        (("fig2a", "RUN", "-o", "x.gif"), 2, "its formats are png, pdf"),
        (("fig2a",), 2, "Missing argument"),
        (("fig2a", "nowhere"), 4, "does not exist"),
        (("fig2a", "RUN", "-o", "no/such/folder/x"), 4, "write the figure"),
    ],
)
def test_errors(capsys, tmp_path, monkeypatch, run, arguments, code, text):
    """Exit code, one message without a traceback, no file."""
    monkeypatch.chdir(tmp_path)
    found, out, err = call(capsys, *(run if part == "RUN" else part for part in arguments))
    assert found == code and text in err and not out and "Traceback" not in err
    assert not list(tmp_path.iterdir())


def test_a_folder_that_is_not_there_yet(capsys, tmp_path, run):
    """A path that ends in a slash is a folder, which is made."""
    assert call(capsys, "n2-lissajous", run, "-o", f"{tmp_path}/new/", "--no-csv", "--format", "png")[0] == 0
    assert [p.name for p in (tmp_path / "new").iterdir()] == ["n2-lissajous.png"]
