"""Order, exactness and interpolation of the Runge-Kutta steps on a smooth field in the sheared frame."""

import math

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from suspend.integrators import METHODS, Controller, interpolate, moved, take_step

ORDERS = {"bogacki-shampine": 3, "tsitouras": 5, "rk4": 4, "rk2": 2}
START = np.array([[0.3, 0.7, 0.0], [1.1, -0.4, 0.2], [-0.8, 0.5, -0.3]])


def strain(time):
    return 0.8 * math.sin(1.3 * time + 0.4)


def rate(time):
    return 1.04 * math.cos(1.3 * time + 0.4)


def field(x, time):
    """Velocity relative to the undisturbed flow, (N, 6): smooth, coupled through the mean, driven by the
    rate.
    """
    u = np.zeros((len(x), 6))
    mean = x.mean(axis=0)
    u[:, 0] = np.sin(x[:, 1] - mean[0]) + 0.5 * rate(time) * np.cos(x[:, 0])
    u[:, 1] = np.cos(x[:, 0] + mean[1]) - 0.3 * rate(time) * x[:, 1]
    u[:, 2] = 0.4 * np.sin(x[:, 0] * x[:, 1])
    u[:, 3:] = 7.0  # rotations must not enter the positions
    return u


def reference(time):
    """dx/dt = rate y e_x + u by an independent eighth-order method at 1e-13."""

    def slope(t, flat):
        x = flat.reshape(-1, 3)
        return (field(x, t)[:, :3] + rate(t) * np.outer(x[:, 1], [1, 0, 0])).reshape(-1)

    return solve_ivp(slope, (0, time), START.reshape(-1), method="DOP853", rtol=3e-14, atol=1e-14).y[:,
    -1].reshape(-1, 3)


@pytest.fixture(scope="module")
def end():
    return reference(1.0)


def march(name, steps, inner=None):
    """Positions at t = 1, sum of the error estimates, and (if `inner`) those interpolated at each step's
    fraction.
    """
    x, u, size, total, between = START, field(START, 0.0), 1.0 / steps, 0.0, []
    for k in range(steps):
        step = take_step(METHODS[name], field, strain, x, u, k * size, size)
        if inner is not None:
            states = (k * size, x, u), ((k + 1) * size, step.position, step.velocity)
            between.append(((k + inner) * size, interpolate(strain, *states, inner)[0]))
        x, u, total = step.position, step.velocity, total + (step.error or 0.0)
    return x, total, between


@pytest.mark.parametrize("name", ORDERS)
def test_order(name, end):
    """Global error ~ h^p: halving h divides it by 2^p. Slopes within 0.35 of p at steps where the next
    order fades.
    """
    steps = (8, 16, 32) if name == "tsitouras" else (20, 40, 80)
    errors = [np.abs(march(name, n)[0] - end).max() for n in steps]
    slopes = np.log2(np.array(errors[:-1]) / errors[1:])
    assert slopes[-1] == pytest.approx(ORDERS[name], abs=0.35)


@pytest.mark.parametrize("name", ORDERS)
def test_tableau_is_consistent(name):
    """Rows sum to their nodes, weights to 1, error weights to 0 (and the quadrature conditions up to the
    order).
    """
    method = METHODS[name]
    for node, row in zip(method.nodes, method.rows, strict=True):
        assert sum(row) == pytest.approx(node, abs=1e-12)
    for power in range(method.order):
        moments = sum(w * c**power for w, c in zip(method.weights, method.nodes, strict=True))
        assert moments == pytest.approx(1 / (power + 1), abs=1e-12)
    if method.error is not None:
        assert sum(method.error) == pytest.approx(0.0, abs=1e-12)
        nodes = (*method.nodes, 1.0)
        for power in range(1, method.order - 1):  # the embedded method has one order less
            assert sum(w * c**power for w, c in zip(method.error, nodes, strict=True)) == pytest.approx(0,
            abs=1e-12)


@pytest.mark.parametrize("name", ORDERS)
def test_affine_motion_is_exact(name):
    """No velocity relative to the flow: the spheres follow the shear exactly, whatever the step; rounding
    only.
    """
    still = np.zeros((3, 6))
    step = take_step(METHODS[name], lambda x, t: still, strain, START, still, 0.3, 2.7)
    assert np.allclose(step.position, moved(START, strain(3.0) - strain(0.3)), rtol=0, atol=1e-14)
    assert step.error is None or step.error == 0.0


def test_uniform_drift_across_the_flow():
    """A constant velocity v e_y in steady shear: x = v g t^2/2 is quadratic, exact for every method of
    order 2 or more.
    """
    drift = np.zeros((3, 6))
    drift[:, 1] = 0.5
    for method in METHODS.values():
        step = take_step(method, lambda x, t: drift, lambda t: 2.0 * t, START, drift, 0.0, 0.8)
        expected = START + np.array([0, 0.4, 0])
        expected[:, 0] += 2.0 * (START[:, 1] * 0.8 + 0.5 * 0.5 * 0.8**2)
        assert np.allclose(step.position, expected, rtol=0, atol=1e-13)


@pytest.mark.parametrize(("name", "order"), [("bogacki-shampine", 3), ("tsitouras", 5)])
def test_error_estimate_has_the_order_of_the_embedded_method(name, order):
    """One step: the estimate is the local error of the order p - 1 method, ~ h^p; and it bounds the true
    local error.
    """
    estimates = []
    for size in (0.1, 0.05):
        step = take_step(METHODS[name], field, strain, START, field(START, 0.0), 0.0, size)
        true = np.sqrt(np.mean(np.sum((step.position - reference(size)) ** 2, axis=1)))
        assert true < step.error
        estimates.append(step.error)
    assert math.log2(estimates[0] / estimates[1]) == pytest.approx(order, abs=0.4)


@pytest.mark.parametrize("name", ["bogacki-shampine", "rk2"])
def test_dense_output_keeps_the_order(name):
    """Cubic Hermite within the steps: positions between the steps converge with the method's order or
    better.
    """
    errors = []
    for steps in (20, 40):
        between = march(name, steps, inner=0.37)[2]
        errors.append(max(np.abs(x - reference(t)).max() for t, x in between[:: steps // 5]))
    assert METHODS[name].dense and math.log2(errors[0] / errors[1]) > ORDERS[name] - 0.4


def test_interpolation_alone():
    """Between exact states the cubic Hermite error is h^4 max|x''''| / 384: fourth order locally, third in
    all.
    """
    errors = []
    for size in (0.2, 0.1):
        ends = [(t, reference(t) if t else START) for t in (0.0, size)]
        states = [(t, x, field(x, t)) for t, x in ends]
        errors.append(np.abs(interpolate(strain, *states, 0.5)[0] - reference(0.5 * size)).max())
        for fraction, state in zip((0.0, 1.0), states, strict=True):
            assert np.allclose(interpolate(strain, *states, fraction)[0], state[1], rtol=0, atol=1e-14)
    assert math.log2(errors[0] / errors[1]) == pytest.approx(4.0, abs=0.4)


def test_last_evaluation_is_at_the_end():
    """First same as last: the velocity returned is that of the field at the returned positions, bit for
    bit.
    """
    for method in METHODS.values():
        calls = []
        step = take_step(
            method, lambda x, t, calls=calls: calls.append(t) or field(x, t), strain, START, field(START,
            0), 0.0, 0.1
        )
        assert np.array_equal(step.velocity, field(step.position, 0.1))
        assert len(calls) == {"bogacki-shampine": 3, "tsitouras": 6, "rk4": 4, "rk2": 2}[method.name]


def test_controller_finds_the_step_of_the_tolerance():
    """An error per unit time C h^(p-1): the steps settle where it is near, and below, the tolerance."""
    controller, size = Controller(1e-4, 3), 1e-3
    for _ in range(60):
        error_rate = 50.0 * size**2
        accepted = error_rate <= 1e-4
        size *= controller.factor(error_rate, accepted)
    assert 0.3e-4 < 50.0 * size**2 <= 1e-4
