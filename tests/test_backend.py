"""A backend in the environment that matplotlib refuses: commands draw into files and do not need it."""

from __future__ import annotations

import os
import subprocess
import sys

import numpy as np
import pytest
from synthetic_runs import configuration, oscillatory_record, stress, write_run

BROKEN = ("module://no_such_package.backend_inline", "no_such_backend")
FLOW = {"type": "oscillatory", "amplitude": 0.8}
SCALES = {"gamma0": 0.8, "omega": 1.0, "phase": 0.0, "viscosity": 2.0}
PARTS = {name: lambda theta: stress(np.cos(theta)) for name in ("hydrodynamic", "interparticle")}
PLACES = np.arange(12.0).reshape(4, 3)


def python(folder, *arguments, backend):
    return subprocess.run(
        [sys.executable, *arguments],
        cwd=folder,
        env=os.environ | {"MPLBACKEND": backend},
        capture_output=True,
        text=True,
    )


def with_frames(record):
    """Eight frames a cycle, for an animation."""
    for name in ("frame_strain", "tilt", "position", "image", "unwrapped"):
        record[name] = np.repeat(record[name], 8, axis=0)
    record["frame_phase"] = np.arange(8) / 8
    record["frame_time"] = record["time"][::8]
    return record


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """A folder with a run of four cycles."""
    path = tmp_path_factory.mktemp("backend")
    records = [with_frames(oscillatory_record(k, SCALES, PARTS, unwrapped=PLACES + 0.1 * k)) for k in range(4)]
    write_run(path / "run", configuration(FLOW, {"cycles": 4}), records, PLACES + 0.4)
    return path


@pytest.mark.parametrize("backend", BROKEN)
@pytest.mark.parametrize(
    ("task", "result"),
    [
        (("report", "run", "-o", "page.html"), "page.html"),
        (("analyze", "run", "--plot", "moduli.png"), "moduli.png"),
        (("plot", "viscosity-evolution", "run", "-o", "evolution.pdf"), "evolution.pdf"),
        (("plot", "animation", "run", "-o", "movie.gif", "--colour", "none"), "movie.gif"),
        (("plot", "snapshot", "run", "-o", "snapshot.png", "--colour", "none"), "snapshot.png"),
    ],
    ids=lambda value: "-".join(value[:2]) if isinstance(value, tuple) else "",
)
def test_commands_need_no_backend(folder, task, result, backend):
    """With the variable of a notebook or with nonsense, the figure is drawn and nothing is said of it."""
    done = python(folder, "-m", "suspend_cli", *task, backend=backend)
    assert done.returncode == 0, done.stderr
    assert "ackend" not in done.stderr
    assert (folder / result).stat().st_size > 1000
    (folder / result).unlink()


def test_the_users_backend_stays(folder):
    """A working backend is in force after a report; a refused one is in the environment still."""
    code = "import os\nfrom suspend.backend import load_matplotlib\nload_matplotlib()\nimport matplotlib\n"
    code += "import matplotlib.figure\nprint(os.environ['MPLBACKEND'], matplotlib.get_backend())"
    assert python(folder, "-c", code, backend="pdf").stdout.split() == ["pdf", "pdf"]
    assert python(folder, "-c", code, backend=BROKEN[1]).stdout.split()[0] == BROKEN[1]


def test_a_matplotlib_imported_before_is_not_touched(folder):
    """The user's matplotlib and its settings are the same objects afterwards."""
    code = (
        "import matplotlib, sys\nmatplotlib.rcParams['lines.linewidth'] = 7.0\nbefore = dict(sys.modules)\n"
        "from suspend.report import write_report\nwrite_report(['run'], 'again.html')\n"
        "assert all(sys.modules[n] is m for n, m in before.items() if n.startswith('matplotlib'))\n"
        "print(matplotlib.get_backend(), matplotlib.rcParams['lines.linewidth'])"
    )
    done = python(folder, "-c", code, backend="svg")
    assert done.stdout.split() == ["svg", "7.0"], done.stderr
