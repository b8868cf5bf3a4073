"""Gaps of nearly touching pairs over large steps, against exact motion of a pair and closed forms."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from suspend.config import loads
from suspend.core.pairs import STIFFEST, HeldPairs, evaluate_combined
from suspend.gaps import ACCURACY, CLOSE, PINNED, CloseGaps, TouchingPairs
from suspend.hydro.nearfield import pair_table
from suspend.hydro.neighbours import VerletList
from suspend.integrators import METHODS, interpolate, take_step
from suspend.scene import make_suspension
from suspend.simulation import Simulation

EDGE, TURN, PRESS = 20.0, 1.0, 12.0  # cell edge; angular velocity of the pair; approach rate -d(ln h)/dt


def pair(gap):
    """Two spheres along (3, 4, 0)/5 at the middle of the cell."""
    half = 0.5 * (2.0 + gap) * np.array([0.6, 0.8, 0.0])
    return np.array([10.0 - half, 10.0 + half])


def velocities(position, _time=0.0, held=None):
    """Rotation about z with TURN and approach at PRESS times the gap: h = h0 exp(-PRESS t), exactly.

    Below STIFFEST velocities are those of a pair at STIFFEST, as of the lubrication there.
    """
    d = position[1] - position[0]
    r = np.linalg.norm(d)
    gap = r - 2.0 if held is None else max(np.exp(held.log_gap[0]), STIFFEST)
    relative = TURN * np.cross([0.0, 0.0, 1.0], d) - PRESS * gap * d / r
    result = np.zeros((2, 6))
    result[0, :3], result[1, :3] = -0.5 * relative, 0.5 * relative
    return result


def neighbours(position, tilt=0.0):
    verlet = VerletList(EDGE, 2.5, 0.5)
    verlet.build(position, 0.0, tilt)
    return verlet


def gaps_of(position, log_gap=None, shear_rate=0.0):
    before = TouchingPairs()
    if log_gap is not None:
        before = TouchingPairs(np.array([[0, 1, 0, 0, 0]], np.int32), np.array([log_gap]))
    return CloseGaps(neighbours(position), before, position, 0.0, lambda time: 0.0, lambda time: shear_rate)


def step(gap, size, method="bogacki-shampine", keep=True):
    position = pair(max(gap, PINNED))
    kept = gaps_of(position, np.log(gap)) if keep else None
    first = velocities(position, held=kept.held() if keep else None)
    return position, take_step(METHODS[method], velocities, lambda time: 0.0, position, first, 0.0, size, kept)


def gap_of(position):
    return np.linalg.norm(position[1] - position[0]) - 2.0


@pytest.mark.parametrize("gap", [1e-4, 1e-9, 1e-30, 1e-250])
@pytest.mark.parametrize("method", ["bogacki-shampine", "tsitouras", "rk4"])
def test_gap_of_a_turning_pair(method, gap):
    """h = h0 exp(-PRESS t) after a step of 0.1, where the step's own error in position is 1e-6.

    ln h to 1e-6 (its rate is constant; 1e-16/STIFFEST of it is round-off, as is TURN's part in the approach), the
    positions to the allowance that `hold` has. Without a state of their own the spheres overlap or part by far more.
    """
    _, taken = step(gap, 0.1, method)
    assert taken.gaps.change[0] == pytest.approx(-PRESS * 0.1, rel=1e-6)
    wanted = max(gap * np.exp(-PRESS * 0.1), PINNED)
    assert gap_of(taken.position) == pytest.approx(wanted, abs=max(ACCURACY * wanted, 0.11 * PINNED))
    if gap == 1e-9:
        _, plain = step(PINNED, 0.1, method, keep=False)
        assert abs(gap_of(plain.position) - PINNED * np.exp(-PRESS * 0.1)) > PINNED


def test_direction_and_centre_are_those_of_the_plain_step():
    """Holding the gap moves the spheres along the line of centres only, by about the step's error (1e-5 estimated)."""
    _, taken = step(1e-6, 0.05)
    _, plain = step(1e-6, 0.05, keep=False)
    assert np.allclose(taken.position.mean(axis=0), plain.position.mean(axis=0), atol=1e-14)
    assert np.abs(taken.position - plain.position).max() < 5e-5
    turned = np.arctan2(*(taken.position[1] - taken.position[0])[[1, 0]])
    assert turned == pytest.approx(np.arctan2(4, 3) + 0.05 * TURN, abs=1e-6)


def test_interpolated_gaps():
    """Within the step ln h is interpolated, exactly so where its rate is constant."""
    position, taken = step(1e-20, 0.1)
    start, end = (0.0, position, velocities(position)), (0.1, taken.position, taken.velocity)
    for fraction in (0.3, 0.5, 0.9):
        found, held = interpolate(lambda time: 0.0, start, end, fraction, taken.gaps)
        assert held.log_gap[0] == pytest.approx(np.log(1e-20) - PRESS * 0.1 * fraction, rel=1e-7)
        assert gap_of(found) == pytest.approx(PINNED, rel=0.11)


def test_rates_count_the_affine_motion():
    """d(ln h)/dt of a pair carried by shear alone: shear_rate (2 + h) e_x e_y/h."""
    position = pair(1e-4)
    gaps = gaps_of(position, shear_rate=2.0)
    expected = 2.0 * 0.6 * 0.8 * 2.0001 / 1e-4
    assert gaps.rates(gaps.held(), position, 0.0, np.zeros((2, 6)))[0] == pytest.approx(expected, rel=1e-9)


def test_chain_of_touching_spheres():
    """Five spheres in a row, every gap 1e-6, all to be brought to 2e-7: sweeps over the chain converge."""
    position = np.column_stack([5.0 + (2.0 + 1e-6) * np.arange(5), np.full(5, 7.0), np.full(5, 9.0)])
    gaps = CloseGaps(neighbours(position), TouchingPairs(), position, 0.0, lambda time: 0.0, lambda time: 0.0)
    position[2, 0] += 3e-7  # what a step's error does
    left = gaps.hold(position, 0.0, gaps.held(np.full(4, np.log(0.2))))
    assert left <= 1.0 and np.allclose(np.diff(position[:, 0]) - 2.0, 2e-7, rtol=0.011)


def test_wide_gaps_are_left_alone():
    """No pair closer than CLOSE: nothing to keep; one that parts beyond it is given up."""
    assert len(gaps_of(pair(2.0 * CLOSE))) == 0
    assert len(gaps_of(pair(1.1 * CLOSE), np.log(1.01 * CLOSE))) == 0
    assert len(gaps_of(pair(1.1 * CLOSE), np.log(0.99 * CLOSE))) == 1


def test_pairs_are_found_again_after_flips_and_wraps():
    """The rows of a pair through two faces of the cell, tilt from 0.6 to -0.4: as a new list names it.

    The pair reaches over the upper face (image 1 of y) and the right one; the new names follow from the shift of the
    spheres and of the cell's edges alone.
    """
    position, tilt = np.array([[19.5, 19.5, 5.0], [20.9, 20.9, 5.0]]), 0.6
    far = position[0] + np.array([1.2, 1.6, 0.0]) * (1.0 + 2e-4)
    position[1] = far - [20.0 * tilt, 20.0, 0.0]  # its image below
    list_before = neighbours(position, tilt)
    gaps = CloseGaps(list_before, TouchingPairs(), position, 0.0, lambda time: tilt, lambda time: 0.0)
    touching = gaps.after(0.0)
    assert touching.rows.tolist() == [[0, 1, 0, 1, 0]]
    touching.flip(1)
    moved = position.copy()
    image = np.array([[0, 0, 0], [1, -1, 2]])
    cell = np.array([[20.0, 0, 0], [20.0 * (tilt - 1.0), 20.0, 0], [0, 0, 20.0]])
    moved -= image @ cell
    touching.wrap(image)
    i, j, *n = touching.rows[0]
    assert np.linalg.norm(moved[j] + n @ cell - moved[i]) == pytest.approx(2.0 * (1.0 + 2e-4), rel=1e-12)


def pair_rates(log_gap):
    """d(ln h)/dt of a pair along (1, -1, 0)/sqrt 2 in simple shear of rate 1, from the evaluation's velocities."""
    config = loads(
        f"particles: {{number: 2, volume_fraction: {8 * np.pi / 3 / EDGE**3!r}}}\nflow: {{type: steady}}\n"
        "duration: {strain: 1}\nrepulsion: off\nsolver: {tolerance: 1e-10}\nlubrication: {at_cutoff: hard}\n",
        source="test",
        directory=".",
    )
    suspension = make_suspension(config, 1, EDGE)
    half = 0.5 * (2.0 + max(np.exp(log_gap), PINNED)) * np.array([1.0, -1.0, 0.0]) / np.sqrt(2.0)
    position = np.array([10.0 - half, 10.0 + half])
    gaps = gaps_of(position, log_gap, shear_rate=1.0)
    held = HeldPairs(gaps.rows, gaps.log_gap)
    velocity = suspension.evaluate(position, 0.0, 0.0, 1.0, 0.0, held)
    return gaps.rates(held, position, 0.0, velocity)[0]


def approach_rate(log_gap):
    """The same by the force balance of the pair's approach, each sphere's own drag 1 and R_nf with singular 1/h.

    (1 + X) v = 2 G E along the line of centres, v = U'_i - U'_j, X the difference of a pair's XA; then d(ln h)/dt =
    ((2 + h) E - v)/h. With X = x/h + X', G = x/h + G' (the singular parts are equal: spheres in contact do not part or
    overlap) the 1/h cancel by hand.
    """
    table, value = pair_table(4.0, "hard"), np.empty(16)
    h = np.exp(log_gap)
    evaluate_combined(table, log_gap, 0.0, value)  # without the singular parts
    x = 2.0 * (table.singular[0, 2] + table.singular[0, 3])
    assert table.singular[0, 10] == pytest.approx(x, rel=1e-14)
    regular, driven = 1.0 + 2.0 * (value[2] + value[3]), value[10]
    normal = -0.5
    # ((1 + X)(2 + h) - 2 G) E / (h (1 + X)) with 1 + X = (x + h regular)/h
    numerator = 2.0 * (regular - driven) + x + h * regular
    return normal * numerator / (x + h * regular)


@pytest.mark.parametrize("log_gap", [-7.0, -15.0, -25.0, -60.0, -400.0])
def test_rate_of_a_pressed_pair(log_gap):
    """ln h falls at a rate that depends on ln h itself, however small h: against the pair's force balance by hand.

    2e-6: the round-off of velocities, 1e-16, over STIFFEST, times the stiffness of a few; above 1e-9 a the solve's
    tolerance.
    """
    assert pair_rates(log_gap) == pytest.approx(approach_rate(log_gap), rel=2e-6)


def crowd(**changes):
    """Fifteen smooth spheres without repulsion at phi = 0.5: pressed together within half a unit of strain."""
    keys = {"number": 15, "phi": 0.5, "force": 0.0, "far": "self", "cycles": 1, "tolerance": 1e-3} | changes
    config = loads(
        f"seed: 2\nparticles: {{number: {keys['number']}, volume_fraction: {keys['phi']}, initial: quenched}}\n"
        f"flow: {{type: oscillatory, amplitude: 0.8}}\nduration: {{cycles: {keys['cycles']}}}\n"
        f"far_field: {keys['far']}\nrepulsion: {{force: {keys['force']}}}\ntolerance: {keys['tolerance']}\n"
        "output: {samples_per_cycle: 32}\n",
        source="test",
        directory=".",
    )
    from suspend.initial import prepare_initial

    initial = prepare_initial(config, ".")
    simulation = Simulation(config, 1, initial.length)
    simulation.start(initial.positions, initial.tilt)
    return simulation


def finish(simulation):
    smallest = 0.0
    while simulation.events:
        simulation.step()
        smallest = min([smallest, *simulation.state.touching.log_gap])
    return simulation.end_cycle(), smallest


@pytest.mark.parametrize("far", ["self", "ewald"])
def test_pressed_spheres_come_apart_again(far):
    """A cycle in which gaps fall below 1e-12 a ends, without overlap, and its stress is that of a tighter run.

    Reference: the same at a thirtieth of the tolerance; 3 % of the largest stress (the tolerance allows positions
    3e-4 a a unit strain, and between touching pairs stress follows gaps). Smallest ln h within 3 % of it.
    """
    found = []
    for tolerance in (3e-4, 1e-5):
        simulation = crowd(far=far, tolerance=tolerance)
        simulation.begin_cycle()
        record, smallest = finish(simulation)
        found.append((record["stress_hydrodynamic"][:, 3], smallest))
        assert record["statistics"]["overlaps"] == 0 and record["statistics"]["minimum_gap"] < 1e-12
    (coarse, first), (fine, second) = found
    assert np.abs(coarse - fine).max() <= 0.03 * np.abs(fine).max()
    assert first == pytest.approx(second, rel=0.03)


def test_touching_pairs_continue_bit_for_bit():
    """A run stopped while gaps are below what positions hold goes on as if it had not been: ln h is in the state."""
    whole, stopped = crowd(), crowd()
    for simulation in (whole, stopped):
        simulation.begin_cycle()
    while not (len(stopped.state.touching.rows) and stopped.state.touching.log_gap.min() < np.log(1e-14)):
        stopped.step()
        whole.step()
    again = crowd()
    again.load(*stopped.dump())
    (a, _), (b, _) = finish(whole), finish(again)
    for name in ("stress_hydrodynamic", "position"):
        assert np.array_equal(a[name], b[name])
    assert np.array_equal(whole.state.touching.log_gap, again.state.touching.log_gap)


def test_gaps_of_a_pair_in_shear_beyond_double_precision():
    """A pair without repulsion turning through the compressive quadrant: ln h(t) against an ODE of its own.

    Orientation and ln h by scipy's DOP853 at 1e-10 from the evaluation's own velocities at given (orientation, ln h),
    so that stepping, holding and interpolation are what is tested; 20 units of steady shear turn it once through, the
    smallest gap and the last one within 1 % of ln h.
    """
    config = loads(
        f"particles: {{number: 2, volume_fraction: {8 * np.pi / 3 / EDGE**3!r}}}\nflow: {{type: steady}}\n"
        "duration: {strain: 4}\nrepulsion: off\ntolerance: 1e-4\n",
        source="test",
        directory=".",
    )
    start = np.log(1e-5)
    angle = 2.6  # in the compressive quadrant, towards the flow's axis
    half = 0.5 * (2.0 + 1e-5) * np.array([np.cos(angle), np.sin(angle), 0.0])
    position = np.array([10.0 - half, 10.0 + half])
    simulation = Simulation(config, 1, EDGE)
    simulation.start(position, 0.0)
    times, logs = [], []
    while simulation.state.cycle < simulation.flow.cycles:
        simulation.begin_cycle()
        while simulation.events:
            simulation.step()
            if len(simulation.state.touching.rows):
                state = simulation.state
                times.append(simulation.flow.accumulated(state.cycle, state.time))
                logs.append(state.touching.log_gap[0])
        simulation.end_cycle()
    suspension = make_suspension(config, 1, EDGE)

    def slope(_, y):
        half = 0.5 * (2.0 + np.exp(y[1])) * np.array([np.cos(y[0]), np.sin(y[0]), 0.0])
        x = np.array([10.0 - half, 10.0 + half])
        gaps = gaps_of(x, y[1], shear_rate=1.0)
        u = suspension.evaluate(x, 0.0, 0.0, 1.0, 0.0, gaps.held())
        relative = u[1, :3] - u[0, :3] + [x[1, 1] - x[0, 1], 0.0, 0.0]
        tangent = np.array([-np.sin(y[0]), np.cos(y[0]), 0.0])
        return [relative @ tangent / 2.0, gaps.rates(gaps.held(), x, 0.0, u)[0]]

    truth = solve_ivp(slope, (0, max(times)), [angle, start], method="DOP853", rtol=1e-8, atol=1e-8, dense_output=True)
    expected = truth.sol(np.array(times))[1]
    assert np.abs(np.array(logs) - expected).max() <= 0.01 * np.abs(expected).max()
