"""Explicit Runge-Kutta steps with error estimate, in coordinates that move with the affine flow.

During a step from strain g0, X = x - (g - g0) y e_x; then dX/dt = U' - (g - g0) U'_y e_x, with U' relative to
the undisturbed flow: the affine motion is exact and the error is that of the particles' own motion. All
methods end their step with an evaluation at the new positions (first same as last), which the stress sample
at that point uses too.

bogacki-shampine : order 3, estimate of order 2 (Bogacki & Shampine 1989), 3 evaluations a step
tsitouras        : order 5, estimate of order 4 (Tsitouras 2011), 6 evaluations a step
rk4, rk2         : the classical fourth-order and the midpoint method, 4 and 2 evaluations, without estimate
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class Method:
    """Butcher tableau; `weights` are also the last stage's row, `error` = weights - embedded weights."""

    name: str
    order: int
    nodes: tuple[float, ...]
    rows: tuple[tuple[float, ...], ...]
    weights: tuple[float, ...]
    error: tuple[float, ...] | None  # one more entry than weights: the new derivative
    dense: bool  # whether cubic Hermite interpolation has at least the method's order


METHODS = {
    "bogacki-shampine": Method(
        "bogacki-shampine", 3, (0.0, 0.5, 0.75), ((), (0.5,), (0.0, 0.75)), (2 / 9, 1 / 3, 4 / 9),
        (2 / 9 - 7 / 24, 1 / 3 - 1 / 4, 4 / 9 - 1 / 3, -1 / 8), True,
    ),
    "tsitouras": Method(
        "tsitouras", 5, (0.0, 0.161, 0.327, 0.9, 0.9800255409045097, 1.0),
        (
            (),
            (0.161,),
            (-0.008480655492356989, 0.335480655492357),
            (2.8971530571054935, -6.359448489975075, 4.3622954328695815),
            (5.325864828439257, -11.748883564062828, 7.4955393428898365, -0.09249506636175525),
            (
                5.86145544294642,
                -12.92096931784711,
                8.159367898576159,
                -0.071584973281401,
                -0.028269050394068383,
            ),
        ),
        (
            0.09646076681806523,
            0.01,
            0.4798896504144996,
            1.379008574103742,
            -3.290069515436081,
            2.324710524099774,
        ),
        (
            0.00178001105222577714, 0.0008164344596567469, -0.007880878010261995, 0.1447110071732629,
            -0.5823571654525552, 0.45808210592918697, -1 / 66,
        ), False,
    ),
    "rk4": Method("rk4", 4, (0.0, 0.5, 0.5, 1.0), ((), (0.5,), (0.0, 0.5), (0.0, 0.0, 1.0)),
                  (1 / 6, 1 / 3, 1 / 3, 1 / 6), None, False),
    "rk2": Method("rk2", 2, (0.0, 0.5), ((), (0.5,)), (0.0, 1.0), None, True),
}  # fmt: skip


@dataclass
class Step:
    """Outcome of a trial step."""

    position: np.ndarray  # at the end, lab frame
    velocity: np.ndarray  # (N, 6) at the end
    error: float | None  # rms over the spheres of the estimated position error, radii
    gaps: GapHistory | None = None
    gap_error: float = 0.0  # rms over the touching pairs of the estimated error of ln h


@dataclass
class GapHistory:
    """Gaps integrated by themselves over a step (`suspend.gaps`): change of ln h, and its rates at both ends."""

    gaps: object
    change: np.ndarray
    first: np.ndarray
    last: np.ndarray


def moved(position: np.ndarray, strain_increment: float) -> np.ndarray:
    """Positions carried along affinely by a simple shear of `strain_increment`."""
    result = position.copy()
    result[:, 0] += strain_increment * position[:, 1]
    return result


def take_step(method: Method, evaluate, strain, position, velocity, time: float, size: float, gaps=None) -> Step:
    """One trial step of `size` from `time`.

    evaluate(position, time) -> (N, 6) velocities relative to the undisturbed flow, called with a third argument, the
    gaps of the pairs held, where there are `gaps`; strain(time) -> gamma; position (N, 3) and velocity (N, 6) at
    `time`. gaps : `suspend.gaps.CloseGaps` of these positions, or None.
    Exceptions of `evaluate` pass through and change nothing here.
    """
    base = strain(time)

    def slope(velocity: np.ndarray, at: float) -> np.ndarray:
        return moved(velocity[:, :3], -(strain(at) - base))

    slopes = [velocity[:, :3]]
    rates = [gaps.rates(gaps.held(), position, time, velocity)] if gaps is not None else None

    def evaluated(weights, at: float) -> tuple[np.ndarray, np.ndarray]:
        """Positions and velocities of a stage; its slopes are added."""
        stage = moved(position + size * _combine(weights, slopes), strain(at) - base)
        held = None
        if gaps is not None:
            held = gaps.held(size * _combine(weights, rates))
            gaps.hold(stage, at, held)
        found = evaluate(stage, at) if held is None else evaluate(stage, at, held)
        slopes.append(slope(found, at))
        if gaps is not None:
            rates.append(gaps.rates(held, stage, at, found))
        return stage, found

    for node, row in zip(method.nodes[1:], method.rows[1:], strict=True):
        evaluated(row, time + node * size)
    new_position, new_velocity = evaluated(method.weights, time + size)
    kept = None
    if gaps is not None:
        kept = GapHistory(gaps, size * _combine(method.weights, rates[:-1]), rates[0], rates[-1])
    if method.error is None:
        return Step(new_position, new_velocity, None, kept)
    error = size * _combine(method.error, slopes)
    gap_error = 0.0 if gaps is None else float(np.sqrt(np.mean((size * _combine(method.error, rates)) ** 2)))
    rms = float(np.sqrt(np.mean(np.einsum("ij,ij->i", error, error))))
    return Step(new_position, new_velocity, rms, kept, gap_error)


def _combine(weights, slopes) -> np.ndarray:
    return sum(w * s for w, s in zip(weights, slopes, strict=True) if w != 0.0)


def interpolate(strain, start, end, fraction: float, kept: GapHistory | None = None):
    """Positions within a step by cubic Hermite interpolation along the affine flow (third order in all).

    start, end : (time, position, velocity); fraction in [0, 1] of the step; kept : the step's gaps, interpolated
    in their logarithms. Returns the positions, and the held gaps there (None without `kept`).
    """
    t0, x0, u0 = start
    t1, x1, u1 = end
    size, base, shear = t1 - t0, strain(t0), strain(t1) - strain(t0)
    x1, u1 = moved(x1, -shear), moved(u1[:, :3], -shear)
    s = fraction
    h00, h10 = (1 + 2 * s) * (1 - s) ** 2, s * (1 - s) ** 2
    h01, h11 = s * s * (3 - 2 * s), s * s * (s - 1)
    moving = h00 * x0 + h01 * x1 + size * (h10 * u0[:, :3] + h11 * u1)
    position = moved(moving, strain(t0 + s * size) - base)
    held = None
    if kept is not None:
        held = kept.gaps.held(h01 * kept.change + size * (h10 * kept.first + h11 * kept.last))
        kept.gaps.hold(position, t0 + s * size, held)
    return position, held


@dataclass
class Controller:
    """Step-size control: error per unit time kept at `tolerance` (PI control, Hairer & Wanner II.4)."""

    tolerance: float
    order: int  # of the method; the estimate per unit time is of order - 1
    previous: float = 1.0

    def factor(self, error_rate: float, accepted: bool) -> float:
        """Factor for the next step size from the error per unit time of this one."""
        ratio = max(error_rate / self.tolerance, 1e-6)
        exponent = 1.0 / (self.order - 1.0)
        if not accepted:
            return max(0.2, 0.9 * ratio**-exponent)
        scale = 0.9 * ratio ** (-0.7 * exponent) * self.previous ** (0.4 * exponent)
        self.previous = ratio
        return min(5.0, max(0.3, scale))
