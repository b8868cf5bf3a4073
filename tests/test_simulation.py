"""Whole runs: physics with a known answer, and files that survive stops."""

from __future__ import annotations

import contextlib
import os
import re
import signal
import subprocess
import sys
import time

import numba
import numpy as np
import pytest
from waiting import LIMIT, cycles_in, wait_until

from suspend.analysis.microstructure.number_variance import number_variance
from suspend.analysis.microstructure.snapshot import Snapshot
from suspend.config import from_dict
from suspend.errors import ConfigurationError, Interrupted, NumericalError
from suspend.io import Run, RunStore
from suspend.simulation import make_plan, run
from suspend.simulation.progress import while_compiling


def scene(number=30, phi=0.3, **changes):
    """A small oscillatory run; dotted keys override."""
    base = {
        "particles": {"number": number, "volume_fraction": phi},
        "flow": {"type": "oscillatory", "amplitude": 0.3},
        "duration": {"cycles": 3},
        "repulsion": {"force": 10.0, "debye_length": 0.01},
        "output": {"samples_per_cycle": 24},
    }
    overrides = [f"{key.replace('__', '.')}={value}" for key, value in changes.items()]
    return from_dict(base, overrides=overrides)


def contents(directory):
    """Everything a run computed, without wall times."""
    with Run(directory) as stored:
        records = [stored.cycle(k) for k in range(stored.cycles)]
        final = stored.frame(-1)
    for record in records:
        record["statistics"] = {k: v for k, v in record["statistics"].items() if k != "wall_time"}
    return records, final


def assert_identical(a, b):
    """Bit for bit, through nested dicts and lists."""
    if isinstance(a, dict):
        assert set(a) == set(b)
        for key in a:
            assert_identical(a[key], b[key])
    elif isinstance(a, list | tuple):
        assert len(a) == len(b)
        for x, y in zip(a, b, strict=True):
            assert_identical(x, y)
    else:
        assert np.array_equal(a, b, equal_nan=np.asarray(a).dtype.kind == "f")


@pytest.mark.parametrize("kind", ["equilibrium", "quenched"])
def test_figures_of_the_start_are_said_and_stored(tmp_path, kind):
    """S(qmin) and beta0 beside the fluid's, from the stored first frame by the definitions: plain sums over waves, and
    the analysis of the run. The line on the screen and the run's attributes hold the same numbers.
    """
    said = []
    config = scene(number=120, particles__initial=kind, duration__cycles=1)
    run(config, tmp_path / "r", message=said.append)
    with Run(tmp_path / "r") as stored:
        meta, frame = stored.meta, next(iter(stored.frames()))
        edge = meta["L"]
    x = frame["unwrapped"]
    waves = [abs(np.exp(2j * np.pi * x[:, a] / edge).sum()) ** 2 / len(x) for a in range(3)]
    assert meta["start_kind"] == kind
    assert meta["start_s_qmin"] == pytest.approx(np.mean(waves), rel=1e-6)
    radii = np.geomspace(2.0, edge / 4.0, 12)
    assert meta["start_beta0"] == pytest.approx(number_variance(Snapshot(x, edge), radii).beta, rel=1e-4)
    assert 0.5 < meta["start_beta0"] / meta["start_beta0_equilibrium"] < 2.0
    line = next(text for text in said if text.startswith("start: "))
    assert f"{kind} packing" in line
    for name, label in (("s_qmin", "S(qmin)"), ("beta0", "beta0"), ("contact_value", "g(contact)")):
        value, fluid = meta[f"start_{name}"], meta[f"start_{name}_equilibrium"]
        assert f"{label} {value:.3g} (equilibrium fluid {fluid:.3g})" in line
    assert "not at equilibrium" not in line


def test_start_says_why_there_is_no_exponent(tmp_path):
    """A cell with L/4 below 2.5 a leaves no range for beta0: said on the screen and stored."""
    said = []
    run(scene(number=20, duration__cycles=1), tmp_path / "r", message=said.append)
    with Run(tmp_path / "r") as stored:
        assert "start_beta0" not in stored.meta
        assert "below 2.5 a" in stored.meta["start_beta0_note"]
    assert any("no beta0 (L/4 is" in text for text in said)


def test_run_stored_with_the_old_name_of_its_start_goes_on(tmp_path):
    """A run whose stored configuration says `random` is continued by files with either name; `quenched` is another."""
    run(scene(duration__cycles=1), tmp_path / "r")
    with RunStore.open(tmp_path / "r") as store:
        assert "initial: equilibrium" in store.config_yaml
        store.update_configuration(store.config_yaml.replace("initial: equilibrium", "initial: random"))
    with pytest.raises(ConfigurationError, match=r"particles.initial differ"):
        run(scene(duration__cycles=2, particles__initial="quenched"), tmp_path / "r")
    run(scene(duration__cycles=2), tmp_path / "r")
    run(scene(duration__cycles=3, particles__initial="random"), tmp_path / "r")
    with Run(tmp_path / "r") as stored:
        assert stored.cycles == 3


def test_only_compilations_are_shown_as_such(tmp_path):
    """`compiling` is shown when and only when a kernel is compiled: at the first call of a new one, not at its second,
    and never in a run that finds its kernels made.
    """
    kernel, seen = numba.njit(lambda x: x + 1.0), []
    with while_compiling(lambda: seen.append(True)):
        assert not seen
        kernel(1.0)
        once = len(seen)
        kernel(2.0)
    assert once >= 1 and len(seen) == once
    run(scene(5, 0.1, duration__cycles=1), tmp_path / "first")
    states = []
    run(scene(5, 0.1, duration__cycles=1), tmp_path / "second", progress=states.append)
    assert states and not any(state.compiling for state in states)
    run(scene(5, 0.1, duration__cycles=1), tmp_path / "second", progress=states.append)
    assert states[-1].fraction == pytest.approx(1.0, rel=1e-14) and not states[-1].compiling


def test_lone_sphere_has_the_einstein_viscosity(tmp_path):
    """A sphere without neighbours within the cutoff: eta_r = 1 + 2.5 phi (Einstein), to rounding."""
    phi = 0.01
    config = scene(1, phi)
    run(config, tmp_path / "r")
    with Run(tmp_path / "r") as stored:
        record = stored.cycle(0)
    total = (record["stress_fluid"] + record["stress_hydrodynamic"])[:, 3]
    moving = np.abs(record["rate"]) > 1e-3
    assert np.allclose(total[moving] / record["rate"][moving], 1.0 + 2.5 * phi, rtol=1e-12)


def test_motion_without_forces_is_reversible(tmp_path):
    """Stokes flow with F0 = 0 is reversible: the displacement over a cycle is the integrator's error only.

    It must fall with the step as dt^3 (Bogacki-Shampine): by about 8 for half the step, at least by 5.
    """
    back = []
    for step in (0.04, 0.02, 0.01):
        config = scene(20, 0.3, repulsion="null", duration__cycles=1, integrator__step=step, solver__tolerance=1e-11)
        run(config, tmp_path / f"{step}")
        with Run(tmp_path / f"{step}") as stored:
            back.append(np.abs(stored.frame(-1)["unwrapped"] - stored.frame(0)["unwrapped"]).max())
    assert back[0] > 5.0 * back[1] > 25.0 * back[2]


def test_units_do_not_matter(tmp_path):
    """The same dimensionless scene in other units of length, time and viscosity: the same viscosities.

    Internally everything is dimensionless, so only the conversion's rounding may differ.
    """
    a = scene(12, 0.3, duration__cycles=1)
    b = scene(12, 0.3, duration__cycles=1, particles__radius=2.5e-6, fluid__viscosity=0.7, flow__omega=31.0)
    run(a, tmp_path / "a")
    run(b, tmp_path / "b")
    with Run(tmp_path / "a") as first, Run(tmp_path / "b") as second:
        x, y = first.cycle(0), second.cycle(0)
    assert np.allclose(y["stress_hydrodynamic"] / (0.7 * 31.0 * 0.3), x["stress_hydrodynamic"] / 0.3, rtol=1e-12)
    assert np.allclose(y["unwrapped"] / 2.5e-6, x["unwrapped"], rtol=1e-12)


def test_stress_of_the_spheres_adds_up(tmp_path):
    """The stresses of all spheres sum to the bulk stress without the fluid's own (rounding only)."""
    config = scene(20, 0.4, duration__cycles=1, output__particle_stress="true")
    run(config, tmp_path / "r")
    with Run(tmp_path / "r") as stored:
        record = stored.cycle(0)
    bulk = record["stress_hydrodynamic"] + record["stress_interparticle"]
    assert np.allclose(record["particle_stress"].sum(axis=1), bulk, rtol=1e-10, atol=1e-12)


def test_sedimenting_spheres_without_neighbours_fall_with_the_stokes_velocity(tmp_path):
    """Quiescent fluid, no neighbour within the cutoff: U = F/(6 pi eta0 a), so one force unit gives speed 1."""
    config = from_dict({
        "particles": {"number": 1, "volume_fraction": 0.001},
        "flow": {"type": "quiescent", "rate": 2.0},
        "duration": {"strain": 1.0},
        "external": {"force": [0.0, -1.0, 0.0], "torque": [0.0, 0.0, 0.0]},
    })  # fmt: skip
    run(config, tmp_path / "r")
    with Run(tmp_path / "r") as stored:
        moved = stored.frame(-1)["unwrapped"][0] - stored.frame(0)["unwrapped"][0]
    assert np.allclose(moved, [0.0, -1.0, 0.0], atol=1e-12)


@pytest.mark.parametrize("flow", [{"type": "steady"}, {"type": "reversal", "reversal_strain": 1.0}])
def test_steady_and_reversed_shear_run(tmp_path, flow):
    """The strain recorded is the integral of the rate; a reversal comes back to zero strain."""
    config = from_dict({
        "particles": {"number": 15, "volume_fraction": 0.3},
        "flow": flow,
        "duration": {"strain": 2.0},
        "repulsion": {"force": 10.0},
        "output": {"samples_per_cycle": 16},
    })  # fmt: skip
    run(config, tmp_path / "r")
    with Run(tmp_path / "r") as stored:
        assert stored.cycles == 2
        expected = 2.0 if flow["type"] == "steady" else 0.0
        assert stored.frame(-1)["strain"] == pytest.approx(expected, abs=1e-12)
    assert (tmp_path / "r" / "viscosity.csv").read_text().count("\n") == 3


def test_interrupted_runs_continue_bit_for_bit(tmp_path):
    """Stopped after every single step by the time limit, the run ends with the very same bits."""
    config = scene(30, 0.4, duration__cycles=2)
    run(config, tmp_path / "whole")
    for _ in range(1000):
        try:
            run(config, tmp_path / "parts", max_time=0.0)
            break
        except Interrupted as stop:
            assert stop.exit_code == 130
    assert_identical(contents(tmp_path / "parts"), contents(tmp_path / "whole"))
    assert (tmp_path / "parts" / "moduli.csv").read_bytes() == (tmp_path / "whole" / "moduli.csv").read_bytes()


def test_extended_run_is_the_longer_run(tmp_path):
    """Two cycles, then two more: the same bits as four at once."""
    run(scene(20, 0.3, duration__cycles=2), tmp_path / "parts")
    run(scene(20, 0.3, duration__cycles=4), tmp_path / "parts")
    run(scene(20, 0.3, duration__cycles=4), tmp_path / "whole")
    assert_identical(contents(tmp_path / "parts"), contents(tmp_path / "whole"))


def test_killed_runs_lose_no_completed_cycle(tmp_path):
    """kill -9 at random instants, then the same command again: the same bits as an undisturbed run.

    The instants are within start-up or one to three cycles after it, by turns, in units of what these take.
    """
    config = scene(30, 0.4, duration__cycles=12)
    run(config, tmp_path / "whole")
    with Run(tmp_path / "whole") as stored:
        cycle = np.mean([stored.cycle(k)["statistics"]["wall_time"] for k in range(stored.cycles)])
    (tmp_path / "c.yaml").write_text(config.to_yaml())
    command = [sys.executable, "-m", "suspend_cli", "run", str(tmp_path / "c.yaml"), "--output", str(tmp_path / "r")]
    random = np.random.default_rng(7)
    done, start_up = 0, 0.0
    for number in range(6):
        begun = time.monotonic()
        process = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
        if number % 2:
            time.sleep(random.uniform(0.0, start_up))
        else:
            wait_until(lambda before=done: cycles_in(tmp_path / "r") > before, process)
            start_up = time.monotonic() - begun
            time.sleep(random.uniform(0.0, 2.0 * cycle))
        process.send_signal(signal.SIGKILL)
        process.wait()
        if (tmp_path / "r" / "trajectory.h5").exists():
            with Run(tmp_path / "r") as stored:
                assert stored.cycles >= done + (number % 2 == 0)
                done = stored.cycles
        if done == 12:
            break
    subprocess.run(command, check=True, capture_output=True)
    assert_identical(contents(tmp_path / "r"), contents(tmp_path / "whole"))


def test_sigterm_writes_a_checkpoint(tmp_path):
    """SIGTERM ends with exit code 130 and a checkpoint that the same command continues from."""
    config = scene(60, 0.4, duration__cycles=4_000_000)
    (tmp_path / "c.yaml").write_text(config.to_yaml())
    command = [sys.executable, "-m", "suspend_cli", "run", str(tmp_path / "c.yaml"), "--output", str(tmp_path / "r")]
    process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    wait_until(lambda: cycles_in(tmp_path / "r"), process)
    process.terminate()
    _, error = process.communicate(timeout=LIMIT)
    assert process.returncode == 130, error
    assert "checkpoint written" in error and "Traceback" not in error
    with pytest.raises(Interrupted, match="checkpoint written"):
        run(config, tmp_path / "r", max_time=0.0)


def test_another_configuration_is_refused(tmp_path):
    """A folder with a run of another configuration is left alone, and the differing key is named."""
    run(scene(5, 0.2, duration__cycles=1), tmp_path / "r")
    with pytest.raises(ConfigurationError, match=r"flow\.amplitude"):
        run(scene(5, 0.2, duration__cycles=1, flow__amplitude=0.5), tmp_path / "r")


def test_evaluation_limit_is_an_error_that_says_where(tmp_path):
    """integrator.max_evaluations ends a run with a numerical error; completed cycles stay."""
    with pytest.raises(NumericalError, match=r"max_evaluations.*cycle 0"):
        run(scene(20, 0.3, integrator__max_evaluations=30), tmp_path / "r")


def test_plan_names_terms_that_are_off():
    """Every term is in the plan, on or off."""
    text = "\n".join(make_plan(scene(5, 0.2, repulsion="null")).lines())
    assert "repulsion" in text and "off" in text and "no FFT" in text


def test_nothing_of_the_far_field_is_imported(tmp_path):
    """With far_field self no FFT exists in the process."""
    code = (
        "import sys; sys.path.insert(0, '.'); from suspend.config import load; from suspend.simulation import run;"
        f"run(load({str(tmp_path / 'c.yaml')!r}), {str(tmp_path / 'r')!r}); assert 'pyfftw' not in sys.modules;"
        "assert 'scipy.fft' not in sys.modules, 'fft'"
    )
    (tmp_path / "c.yaml").write_text(scene(5, 0.2, duration__cycles=1).to_yaml())
    subprocess.run([sys.executable, "-c", code], check=True, env=os.environ)


@pytest.mark.parametrize(
    "changes",
    [
        {"lubrication__minimum_gap": 0.05},
        {"lubrication__enabled": "false"},
        {"lubrication__enabled": "false", "contact": "{stiffness: 1.0}"},
        {"lubrication__enabled": "false", "repulsion": "{force: 1.0e-3, debye_length: 0.5}"},
    ],
    ids=["frozen lubrication", "nothing acts", "contact alone", "weak repulsion"],
)
def test_overlaps_and_gaps_are_facts_of_the_positions(tmp_path, changes):
    """Whatever acts, overlaps and the smallest gap are those of every pair and image of the stored positions.

    Every sample is a stored frame here; the pairs are counted by brute force over 27 images.
    """
    samples = 20
    phases = [k / samples for k in range(samples)]
    changes = {"repulsion": "null", **changes}
    config = scene(20, 0.4, duration__cycles=1, flow__amplitude=1.5, output__samples_per_cycle=samples,
                   output__position_phases=phases, integrator__step=0.05, **changes)  # fmt: skip
    run(config, tmp_path / "r")
    overlaps, smallest = 0, np.inf
    with Run(tmp_path / "r") as stored:
        record, edge = stored.cycle(0), stored.meta["L"]
    for position, tilt in zip(record["position"], record["tilt"], strict=True):
        vectors = edge * np.array([[1, 0, 0], [tilt, 1, 0], [0, 0, 1]])
        for shift in np.ndindex(3, 3, 3):
            apart = np.linalg.norm(position[:, None] - position + (np.array(shift) - 1) @ vectors, axis=2)
            apart = apart[apart > 0.0]
            overlaps += int((apart < 2.0).sum())
            smallest = min(smallest, apart.min() - 2.0)
    assert overlaps > 0 and record["statistics"]["overlaps"] == overlaps // 2
    assert record["statistics"]["minimum_gap"] <= smallest + 1e-12


def test_a_force_that_throws_spheres_away_ends_the_run(tmp_path):
    """A stiff repulsion without lubrication at a fixed step that is too long: one error, no crash of the kernels."""
    free = {"repulsion": "{force: 1.0, debye_length: 0.01}", "lubrication__enabled": "false"}
    with pytest.raises(NumericalError, match=r"integrator\.step"):
        run(scene(20, 0.4, integrator__step=0.05, flow__amplitude=1.5, **free), tmp_path / "r")


def test_smallest_gap_of_a_scene_without_any_interaction(tmp_path):
    """Nothing acts: the gap is still that of the positions; without value only where no two spheres come within 1 a."""
    free = {"repulsion": "null", "lubrication__enabled": "false", "duration__cycles": 1}
    run(scene(20, 0.4, **free), tmp_path / "dense")
    run(scene(2, 1e-6, **free), tmp_path / "dilute")
    with Run(tmp_path / "dense") as dense, Run(tmp_path / "dilute") as dilute:
        assert dense.cycle(0)["statistics"]["minimum_gap"] < 0.1
        assert np.isnan(dilute.cycle(0)["statistics"]["minimum_gap"])


def test_large_forces_run_by_themselves(tmp_path):
    """A repulsion of 1e8 F_stk throws spheres apart at 1e6 a per unit strain: the run needs no setting, and is right.

    Errors are then measured against the way the spheres go. Reference: the same at a hundredth of all tolerances; the
    spheres go some 0.1 a apart, positions to a hundredth of that.
    """
    forces = {"repulsion": "{force: 1.0e8, debye_length: 0.01}", "seed": 5}
    forces |= {"duration__cycles": 1, "flow__amplitude": 1e-4}
    frames = []
    for tolerance in (1e-3, 1e-5):
        run(scene(20, 0.4, **forces, tolerance=tolerance), tmp_path / f"{tolerance}")
        with Run(tmp_path / f"{tolerance}") as stored:
            frames.append([stored.frame(k)["unwrapped"] for k in (0, -1)])
    (start, coarse), (_, fine) = frames
    moved = np.abs(fine - start).max()
    assert moved > 0.03 and np.abs(coarse - fine).max() <= 0.01 * moved


def test_advice_for_large_forces_helps(tmp_path):
    """Velocities solved to less than the steps' tolerance: the message gives a value that works."""
    forces = {"repulsion": "{force: 1.0e8, debye_length: 0.01}", "seed": 5, "duration__cycles": 1}
    forces |= {"flow__amplitude": 1e-4, "integrator__tolerance": 1e-6}
    with pytest.raises(NumericalError, match=r"lower solver\.tolerance to") as caught:
        run(scene(20, 0.4, **forces, solver__tolerance=1e-2), tmp_path / "a")
    found = re.search(r"lower solver.tolerance to ([0-9.e+-]+[0-9])", str(caught.value))
    run(scene(20, 0.4, **forces, solver__tolerance=found[1]), tmp_path / "b")


@pytest.mark.parametrize("scale", [1e-4, 1e3, 1e7])
def test_a_fluid_at_rest_knows_no_unit_of_force(tmp_path, scale):
    """Ten settling spheres under a force scaled by any number go the same way in the time scaled by its inverse.

    The equations are linear in the force and hold no other; the reference rate is arbitrary. 1e-6 a: the path is 0.02 a
    long and solved to 1e-5 of it; steps differ where events are at other times.
    """

    def path(force, time):
        changes = {"flow": "{type: quiescent}", "repulsion": "null", "duration": f"{{strain: {time!r}}}", "seed": 3}
        changes["external"] = f"{{force: [{0.3 * force!r}, 0.0, {-force!r}]}}"
        directory = tmp_path / f"{force}"
        run(scene(10, 0.3, **changes), directory)
        with Run(directory) as stored:
            return stored.frame(-1)["unwrapped"] - stored.frame(0)["unwrapped"]

    assert np.allclose(path(scale, 0.02 / scale), path(1.0, 0.02), rtol=0, atol=1e-6)


@pytest.mark.parametrize(
    "helps",
    [{"lubrication__minimum_gap": 1e-3}, {"repulsion": "{force: 10, debye_length: 0.01}"}],
    ids=["roughness", "repulsion"],
)
def test_advice_for_vanishing_gaps_helps(tmp_path, helps):
    """A solve that fails while smooth spheres are pressed together says so, and not that its accuracy is at fault."""
    pressed = {"repulsion": "null", "external": "null", "flow__amplitude": 1.6, "duration__cycles": 1, "seed": 11}
    pressed |= {"solver__max_iterations": 60, "solver__tolerance": 1e-9}
    with pytest.raises(NumericalError, match=r"lubrication\.minimum_gap .*repulsion"):
        run(scene(60, 0.5, **pressed), tmp_path / "a")
    run(scene(60, 0.5, **pressed | {"solver__max_iterations": 2000} | helps), tmp_path / "b")


@pytest.mark.parametrize("duration", ["cycles", "strain"])
def test_a_state_within_a_cycle_is_never_stored_as_its_end(tmp_path, duration):
    """Stopped within cycle 2 of many, then asked for the 2 that are done: the run ends where one of 2 cycles ends.

    Theory: deterministic motion. The last frame equals the shorter run's to round-off (its wrapped positions are made
    from unwrapped ones), and extended to 4 cycles it holds the bits of a run that was never stopped.
    """

    tree = scene(20, 0.4).to_dict()

    def asked(cycles):
        tree["duration"] = {duration: cycles if duration == "cycles" else 4 * 0.3 * cycles}
        return from_dict(tree)

    while True:
        with contextlib.suppress(Interrupted):
            run(asked(1000), tmp_path / "r", max_time=0.0)
        with Run(tmp_path / "r") as stored:
            if stored.cycles == 2:
                break
    for _ in range(3):  # steps into the third cycle
        with pytest.raises(Interrupted):
            run(asked(1000), tmp_path / "r", max_time=0.0)
    run(asked(2), tmp_path / "r")
    run(asked(2), tmp_path / "short")
    (_, found), (_, expected) = contents(tmp_path / "r"), contents(tmp_path / "short")
    for name, value in expected.items():
        np.testing.assert_allclose(found[name], value, rtol=0.0, atol=1e-12, err_msg=name)
    with Run(tmp_path / "r") as stored:
        assert stored.finished
    run(asked(1), tmp_path / "r")  # less than what is done leaves it as it is
    with Run(tmp_path / "r") as stored:
        assert (stored.cycles, stored.finished) == (2, True)
    run(asked(4), tmp_path / "r")
    run(asked(4), tmp_path / "whole")
    assert_identical(contents(tmp_path / "r"), contents(tmp_path / "whole"))


def test_steady_runs_are_extended_by_whole_blocks(tmp_path):
    """3.3 units of strain (4 blocks of 0.825) go on to 9.9 (12 blocks), as the refusal of other lengths says."""
    steady = {
        "particles": {"number": 5, "volume_fraction": 0.1},
        "flow": {"type": "steady"},
        "duration": {"strain": 3.3},
        "output": {"samples_per_cycle": 2},
    }
    run(from_dict(steady), tmp_path / "r")
    with pytest.raises(ConfigurationError, match=r"whole multiple of the block length 0\.825"):
        run(from_dict(steady, overrides=["duration.strain=9.8"]), tmp_path / "r")
    for total, blocks in ((6.6, 8), (9.9, 12)):
        run(from_dict(steady, overrides=[f"duration.strain={total}"]), tmp_path / "r")
        with Run(tmp_path / "r") as stored:
            assert stored.cycles == blocks
            assert stored.frame(-1)["strain"] == pytest.approx(total, rel=1e-12)


@pytest.mark.parametrize("flow", [{"type": "steady"}, {"type": "reversal", "reversal_strain": 1.0}])
def test_a_begun_block_is_not_continued_as_another(tmp_path, flow):
    """Stopped within a block, the run refuses a duration that would cut this block anew: its state belongs to none."""
    tree = {
        "particles": {"number": 15, "volume_fraction": 0.3},
        "flow": flow,
        "duration": {"strain": 2.0},
        "output": {"samples_per_cycle": 4},
    }
    wanted = 0 if flow["type"] == "steady" else 1  # within the first block, within the one after the reversal
    for _ in range(1000):
        with contextlib.suppress(Interrupted):
            run(from_dict(tree), tmp_path / "r", max_time=0.0)
        with Run(tmp_path / "r") as stored:
            if stored.cycles == wanted:
                break
    with contextlib.suppress(Interrupted):
        run(from_dict(tree), tmp_path / "r", max_time=0.0)
    with pytest.raises(ConfigurationError, match="other blocks"):
        run(from_dict(tree, overrides=["duration.strain=1.7"]), tmp_path / "r")
