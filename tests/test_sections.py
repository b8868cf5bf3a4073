"""Sections of `suspend analyze` on small real runs: what they hold, and what they say is missing."""

import json
import subprocess
import sys

import numpy as np
import pytest
from test_simulation import scene

from suspend.analysis.sections import dynamics_section, format_section, structure_section
from suspend.config import from_dict
from suspend.io import Run
from suspend.simulation import run


@pytest.fixture(scope="module")
def small(tmp_path_factory):
    """Thirty spheres, three cycles, frames at the start and in the middle of each."""
    folder = tmp_path_factory.mktemp("sections") / "r"
    run(scene(30, 0.3, output__position_phases="[0, 0.5]"), folder)
    return folder


def test_dynamics_hold_the_runs_own_diffusivity(small):
    """D_cyc of the section is that of the last cycle, which the run computed from the same positions."""
    found = dynamics_section(small)
    with Run(small) as stored:
        expected = stored.statistics()["d_cyc"][-1]
    assert found["CyclicDiffusivity"]["D_cyc"] == pytest.approx(expected, rel=1e-9)
    assert 0.0 <= found["ActiveFraction"]["last"] <= 1.0
    assert "D_cyc" in format_section(found)


def test_structure_holds_the_smallest_gap(small):
    """The smallest initial gap is that of the stored positions (brute force over images)."""
    found = structure_section(small)["Microstructure"]
    with Run(small) as stored:
        frame, length = stored.frame(0), stored.meta["L"]
    d = frame["position"][:, None] - frame["position"][None]
    assert frame["tilt"] == 0.0
    d -= length * np.round(d / length)
    r = np.linalg.norm(d, axis=2)[np.triu_indices(30, 1)]
    assert found["initial_smallest_gap[a]"] == pytest.approx(r.min() - 2.0, abs=1e-9)


def test_steady_shear_says_what_is_missing(tmp_path):
    """No cycles: what needs them is named in the notes, nothing is raised."""
    config = from_dict({
        "particles": {"number": 8, "volume_fraction": 0.2},
        "flow": {"type": "steady", "rate": 1.0},
        "duration": {"strain": 2.0},
        "repulsion": {"force": 10.0},
    })  # fmt: skip
    run(config, tmp_path / "r")
    found = dynamics_section(tmp_path / "r")
    assert any("CyclicDiffusivity" in note for note in found["notes"])
    assert "Microstructure" in structure_section(tmp_path / "r")


def test_command_prints_sections(small):
    """`suspend analyze RUN --dynamics --structure --json` holds both."""
    command = [sys.executable, "-m", "suspend_cli", "analyze", str(small), "--dynamics", "--structure", "--json"]
    found = json.loads(subprocess.run(command, check=True, capture_output=True, text=True).stdout)
    assert {"dynamics", "structure", "averages"} <= set(found)
