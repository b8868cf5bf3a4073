"""Whole runs with the far field: known answers, parts that add up, stops without a trace."""

from __future__ import annotations

import numpy as np
import pytest
from test_simulation import assert_identical, contents, scene

from suspend.config import from_dict
from suspend.config.schema import every_key
from suspend.errors import ConfigurationError, Interrupted
from suspend.farfield import make_parameters
from suspend.hydro.ewald.split import KINDS
from suspend.io import Run
from suspend.simulation import make_plan, run


def far(number=20, phi=0.3, **changes):
    return scene(number, phi, **{"far_field": "ewald", "duration__cycles": 1, **changes})


def test_splits_of_the_configuration():
    """Every kind of split can be asked for and is then used; null is the optimal one, with the same parameters."""
    assert set(every_key()["ewald.split"].choices) == set(KINDS)
    found = {
        kind: make_parameters(far(ewald__split=kind).ewald, 1e-2, 20, 7.0).accurate for kind in ("null", *KINDS)
    }
    assert all(found[kind].split.kind == kind for kind in KINDS)
    null, optimal = found["null"], found["optimal"]
    assert null.split.kind == "optimal" and null.grid == optimal.grid
    assert (null.split.cutoff, null.split.kmax) == (optimal.split.cutoff, optimal.split.kmax)


def test_lone_sphere_in_its_lattice(tmp_path):
    """One sphere a cell is a simple cubic lattice, sheared: at zero tilt its viscosity at the FTS level without
    lubrication is 1 + beta phi-term; independently computed beta(0.1) = 0.24118 (five digits), here to 2e-5. At
    phi = 0.1 and cutoff 2.5 no pair is within the lubrication's range.
    """
    config = far(1, 0.1, lubrication__enabled="false", repulsion="null", tolerance=1e-8, flow__amplitude=1e-3)
    run(config, tmp_path / "r")
    with Run(tmp_path / "r") as stored:
        record = stored.cycle(0)
    total = (record["stress_fluid"] + record["stress_hydrodynamic"])[0, 3] / record["rate"][0]
    assert total == pytest.approx(1.24118, abs=2e-5)


def test_many_body_field_adds_to_the_viscosity(tmp_path):
    """At phi = 0.4 the far field raises the first sample's viscosity above that of the near field alone."""
    values = {}
    for far_field in ("self", "ewald"):
        config = far(40, 0.4, far_field=far_field)
        run(config, tmp_path / far_field)
        with Run(tmp_path / far_field) as stored:
            record = stored.cycle(0)
        values[far_field] = record["stress_hydrodynamic"][0, 3] / record["rate"][0]
    assert values["ewald"] > 1.05 * values["self"]


def test_parts_and_spheres_add_up(tmp_path):
    """The stresses of all spheres sum to the bulk's (rounding); without non-hydrodynamic force the flow-driven
    part is the whole hydrodynamic stress, to the residual of the two solves (1e-8 of the velocity, times ten).
    """
    config = far(output__particle_stress="true", repulsion="null", solver__far_tolerance=1e-8)
    run(config, tmp_path / "r")
    with Run(tmp_path / "r") as stored:
        record = stored.cycle(0)
    assert np.allclose(record["particle_stress"].sum(axis=1), record["stress_hydrodynamic"], rtol=1e-10, atol=1e-12)
    assert np.allclose(record["stress_flow_driven"], record["stress_hydrodynamic"], atol=1e-6)


def test_motion_is_reversible_to_the_step(tmp_path):
    """F0 = 0: the way back over a cycle is the integrator's third-order error, far field or not."""
    back = []
    for step in (0.04, 0.02):
        config = far(
            8, 0.2, repulsion="null", integrator__step=step, solver__far_tolerance=1e-10, ewald__tolerance=1e-9
        )
        run(config, tmp_path / f"{step}")
        with Run(tmp_path / f"{step}") as stored:
            back.append(np.abs(stored.frame(-1)["unwrapped"] - stored.frame(0)["unwrapped"]).max())
    assert back[0] > 5.0 * back[1]


def test_interrupted_runs_continue_bit_for_bit(tmp_path):
    """Stopped after every step, resumed: the same bits. Transforms are planned by estimate, starts and
    preconditioner are restored.
    """
    config = far(16, 0.4)
    run(config, tmp_path / "whole")
    for _ in range(1000):
        try:
            run(config, tmp_path / "parts", max_time=0.0)
            break
        except Interrupted:
            pass
    assert_identical(contents(tmp_path / "parts"), contents(tmp_path / "whole"))


def test_sedimenting_array_moves_with_the_closed_form(tmp_path):
    """A simple cubic array under a force, FTS level: 1/K = 1 - 1.7601188844 c + c^3, c = phi^(1/3) (Hasimoto's
    constant), relative to zero mean flow; to the tolerance 1e-8 of the sum and of the solve, times ten.
    """
    phi = 0.05
    config = from_dict({
        "particles": {"number": 1, "volume_fraction": phi},
        "flow": {"type": "quiescent", "rate": 1.0},
        "duration": {"strain": 0.5},
        "far_field": "ewald",
        "tolerance": 1e-8,
        "lubrication": {"enabled": False},
        "external": {"force": [0.0, -1.0, 0.0], "torque": [0.0, 0.0, 0.0]},
    })  # fmt: skip
    run(config, tmp_path / "r")
    with Run(tmp_path / "r") as stored:
        moved = stored.frame(-1)["unwrapped"][0] - stored.frame(0)["unwrapped"][0]
    expected = 1 - 1.7601188844 * phi ** (1 / 3) + phi
    assert np.allclose(moved, [0.0, -0.5 * expected, 0.0], atol=5e-8)


def test_plan_names_the_grid():
    """The plan says what the Ewald sum will be made of."""
    text = "\n".join(make_plan(far()).lines())
    assert "spectral Ewald sum, tolerance 0.001" in text and "grid" in text and "coupled" in text


def test_too_small_a_cell_is_refused():
    """A cell edge below two radii: a sphere would overlap its own image."""
    with pytest.raises(ConfigurationError, match="overlaps its own image"):
        far(1, 0.6)


def test_smooth_spheres_without_repulsion(tmp_path):
    """F0 = 0: gaps fall below 1e-8 a and close pairs turn while they touch. The coupled solve must go on converging
    (it did not with a factorisation of the pairs' earlier directions), within a few tens of iterations, and no step
    may be cut by overlaps more than now and then.
    """
    config = far(50, 0.4, repulsion="null", flow__amplitude=0.8)
    run(config, tmp_path / "r")
    with Run(tmp_path / "r") as stored:
        statistics = {name: column[0] for name, column in stored.statistics().items()}
    assert statistics["minimum_gap"] < 1e-7
    assert statistics["iterations"] < 40 * statistics["evaluations"]
    assert statistics["rejected_overlap"] < 10
