"""What a scene does not need costs nothing: no module of it is imported, no kernel of it compiled or launched.

Every scene runs in a process of its own, which says what it imported and which kernels have a compiled signature (one
without was never launched). The full scene shows that the probe sees what the others must not have. What this saves
in time and memory is measured by benchmarks/lean_scenes.py, never here.
"""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from suspend.config import from_dict
from suspend.hydro.neighbours import VerletList
from suspend.simulation import Simulation

PROBE = Path(__file__).with_name("lean_probe.py")
SHEAR = {"type": "oscillatory", "amplitude": 0.5}
FULL = {
    "particles": {"number": 8, "volume_fraction": 0.3},
    "flow": SHEAR,
    "duration": {"cycles": 1},
    "repulsion": {"force": 10.0, "debye_length": 0.01},
    "output": {"samples_per_cycle": 20, "particle_stress": True},
    "far_field": "ewald",
    "tolerance": 1e-2,
}
DILUTE = {"number": 6, "volume_fraction": 1e-6}
PLAIN = {"samples_per_cycle": 20}

NEAR = ("suspend.hydro.nearfield", "suspend.hydro.table")
SOLVERS = ("suspend.solvers.conjugate_gradient", "suspend.solvers.incomplete")
SCIPY = ("scipy.sparse", "scipy.special", "scipy.spatial", "scipy.optimize")  # for the far field's parameters
FAR = ("suspend.farfield", "suspend.hydro.ewald", "suspend.solvers.coupled", "suspend.solvers.gmres", "pyfftw", *SCIPY)
NEVER = ("suspend.analysis.steady_state",)  # for duration.until_steady
# kernels, by what they begin with
NEAR_KERNELS = ("suspend.hydro.nearfield.", "suspend.solvers.", "suspend.gaps.", "suspend.core.pairs.evaluate")
FAR_KERNELS = ("suspend.core.ewald", "suspend.core.grid", "suspend.hydro.ewald", "suspend.solvers.coupled")
FORCES = ("suspend.forces.",)
PER_SPHERE = ("suspend.core.pairs.stresslet_of_each", "suspend.forces._force_rows")
SCENES = {  # changes to the full scene; modules that must not be there; kernels that must not be there
    "no far field": ({"far_field": "self", "output": PLAIN}, FAR, FAR_KERNELS + PER_SPHERE),
    "no repulsion": ({"far_field": "self", "output": PLAIN, "repulsion": None}, FAR, FAR_KERNELS + FORCES),
    "no lubrication": (
        {"far_field": "self", "output": PLAIN, "lubrication": {"enabled": False}},
        FAR + NEAR + SOLVERS,
        FAR_KERNELS + NEAR_KERNELS,
    ),
    "far field, no lubrication": (
        {"output": PLAIN, "lubrication": {"enabled": False}},
        NEAR,
        ("suspend.hydro.nearfield.", "suspend.gaps.", "suspend.solvers.incomplete.", "suspend.solvers.conjugate"),
    ),
    "no per-sphere output": ({"output": PLAIN}, (), PER_SPHERE),
    "steady": (
        {"far_field": "self", "output": PLAIN, "flow": {"type": "steady"}, "duration": {"strain": 1.0}},
        FAR,
        FAR_KERNELS + PER_SPHERE,
    ),
    "one sphere": (
        {"far_field": "self", "output": PLAIN, "particles": {"number": 1, "volume_fraction": 1e-3}},
        FAR + NEAR + SOLVERS,
        FAR_KERNELS + NEAR_KERNELS + FORCES + ("suspend.hydro.", "suspend.core.packing", "suspend.core.cell_list"),
    ),
    "dilute": (
        {"far_field": "self", "particles": DILUTE},
        FAR + NEAR + SOLVERS,
        FAR_KERNELS + NEAR_KERNELS + FORCES,
    ),
    "dilute with far field": ({"output": PLAIN, "particles": DILUTE}, NEAR, ("suspend.hydro.nearfield.", *FORCES)),
    "nothing acts": (
        {"far_field": "self", "output": PLAIN, "lubrication": {"enabled": False}, "repulsion": None},
        FAR + NEAR + SOLVERS,
        FAR_KERNELS + NEAR_KERNELS + FORCES,
    ),
}


def probe(tree, folder):
    """What the run of a configuration used, by `lean_probe`."""
    folder.mkdir(exist_ok=True)
    source = folder / "scene.json"
    source.write_text(json.dumps(tree))
    done = subprocess.run([sys.executable, PROBE, source, folder / "run"], capture_output=True, text=True, timeout=300)
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout.splitlines()[-1])


def begins(names, heads):
    """The names that are, or belong to, one of the heads."""
    return [n for n in names if any(n == h or n.startswith(h if h.endswith((".", "_")) else h + ".") for h in heads)]


def kernels_of(found, heads):
    """Kernels whose names begin with one of the heads."""
    return [name for name in found["kernels"] if name.startswith(tuple(heads))]


@pytest.fixture(scope="module")
def full(tmp_path_factory):
    return probe(FULL, tmp_path_factory.mktemp("full"))


def test_the_full_scene_has_all(full):
    """The probe sees each group that a lean scene must not have."""
    for heads in (NEAR, SOLVERS, FAR):
        assert all(begins(full["modules"], [head]) for head in heads)
    for head in (*FAR_KERNELS[:3], *NEAR_KERNELS[:3], *PER_SPHERE[:1], *FORCES):
        assert kernels_of(full, [head]), head
    assert full["statistics"]["factorisations"] > 0 and full["statistics"]["products"] > 0


@pytest.mark.parametrize("name", SCENES)
def test_lean_scene(name, tmp_path):
    """Neither modules nor kernels of what is off or out of reach; without a pair no factorisation, no iteration."""
    changes, modules, kernels = SCENES[name]
    found = probe(FULL | changes, tmp_path)
    assert begins(found["modules"], (*modules, *NEVER)) == []
    assert kernels_of(found, kernels) == []
    if "suspend.hydro.nearfield." in kernels or NEAR_KERNELS[0] in kernels:
        assert found["statistics"]["factorisations"] == 0
    if "self" in changes.values() and NEAR_KERNELS[0] in kernels:
        assert found["statistics"]["iterations"] == 0
    assert ("particle_stress" in found["fields"]) == ("output" not in changes)


def test_continuing_needs_nothing_of_the_start(tmp_path):
    """The same run extended: neither packing nor what reads or judges a start is imported."""
    tree = FULL | SCENES["no far field"][0]
    start = tuple(f"suspend.{name}" for name in ("initial", "packing", "structure", "fluctuations"))
    assert len(begins(probe(tree, tmp_path)["modules"], start)) == len(start)
    found = probe(tree | {"duration": {"cycles": 2}}, tmp_path)
    assert begins(found["modules"], start) == [] and kernels_of(found, ["suspend.core.packing"]) == []


def passing(far_field):
    """Two spheres that meet and part again in each half of a cycle, out of reach (7.8 a) at the start."""
    tree = {
        "particles": {"number": 2, "volume_fraction": 2.0 * 4.0 * np.pi / 3.0 / 30.0**3},
        "flow": {"type": "oscillatory", "amplitude": 6.0},
        "duration": {"cycles": 1},
        "repulsion": {"force": 10.0, "debye_length": 0.01},
        "far_field": far_field,
        "output": {"samples_per_cycle": 20},
        "solver": {"tolerance": 1e-12} | ({"far_tolerance": 1e-6} if far_field == "ewald" else {}),
        "external": {"force": [0.0, 0.0, -0.1]},
    }
    simulation = Simulation(from_dict(tree), 1)
    simulation.start(np.array([[11.0, 15.4, 15.0], [18.8, 14.6, 15.3]]), 0.0)
    return simulation


def cycle(simulation, after_step=lambda simulation: simulation):
    """The record of one cycle; `after_step` may put another simulation in place."""
    simulation.begin_cycle()
    while simulation.events:
        simulation.step()
        simulation = after_step(simulation)
    return simulation.end_cycle()


@pytest.mark.parametrize("far_field", ["self", "ewald"])
def test_a_pair_that_comes_into_reach_and_leaves_it(far_field, monkeypatch):
    """The near field comes and goes with the pair; the motion is that with a near field that is always there.

    Solves at 1e-12 (coupled: 1e-6) leave differences of that size times the strain, 24.
    """
    simulation, present = passing(far_field), []

    def note(simulation):
        present.append((simulation.suspension.near is not None, simulation.suspension.lubricated))
        return simulation

    found = cycle(simulation, note)
    assert {(False, False), (True, True)} <= set(present)
    monkeypatch.setattr(VerletList, "holds", lambda *_: True)
    expected = cycle(passing(far_field))
    allowed = 1e-9 if far_field == "self" else 1e-4
    for name in ("stress_hydrodynamic", "stress_interparticle", "stress_flow_driven"):
        assert found[name] == pytest.approx(expected[name], abs=allowed)
    assert found["statistics"]["minimum_gap"] == pytest.approx(expected["statistics"]["minimum_gap"], rel=allowed)


@pytest.mark.parametrize("far_field", ["self", "ewald"])
def test_stopped_after_every_step(far_field):
    """Dumped and loaded into a new simulation after each step, with and without a pair in reach: the same bits."""

    def replace(simulation):
        if not simulation.events:
            return simulation
        other = passing(far_field)
        other.load(*simulation.dump())
        return other

    found, expected = cycle(passing(far_field), replace), cycle(passing(far_field))
    for name in ("time", "stress_hydrodynamic", "stress_interparticle", "stress_flow_driven"):
        assert np.array_equal(found[name], expected[name]), name
    assert found["statistics"]["iterations"] == expected["statistics"]["iterations"]
