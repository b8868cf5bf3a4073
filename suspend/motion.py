"""Motion through one cycle: adaptive steps that land on, or interpolate at, the phases asked for.

A sample is either landed on (the step is cut to end there and the velocity at its end is the sample's) or
interpolated (cubic Hermite, third order, one more evaluation). Which costs fewer evaluations depends on the
step size the accuracy allows; it is decided anew at every step. The cycle's end is always landed on.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np

from suspend.box import flip, flips_of
from suspend.core.cell import wrap_and_count
from suspend.core.pairs import HeldPairs
from suspend.dynamics import PRESSED, PRESSED_GAP, Overlap, Suspension
from suspend.errors import NumericalError
from suspend.flow import Flow
from suspend.gaps import CLOSE, CloseGaps, TouchingPairs
from suspend.integrators import Controller, Method, Step, interpolate, take_step

GAP_SHARE = 0.03  # an error of ln h of touching pairs counts as this many radii
FORCED_SHARE = 0.1  # of the spheres' speed that errors are measured against where it exceeds the shear's


@dataclass
class State:
    """Everything that moves, at `time` within `cycle`; positions (N, 3) at tilt = strain + offset - flips."""

    position: np.ndarray
    image: np.ndarray  # (N, 3) int32
    velocity: np.ndarray  # (N, 6), relative to the undisturbed flow
    cycle: int
    time: float
    flips: int
    size: float  # next step
    offset: float = 0.0  # tilt minus strain at the start: the starting cell may be sheared, the phase not 0
    touching: TouchingPairs = field(default_factory=TouchingPairs)


@dataclass(frozen=True)
class StepSettings:
    """Accuracy and limits of the steps; `fixed` = constant step size."""

    tolerance: float
    fixed: float | None = None
    max_step: float = 0.1
    min_step: float = 1e-9
    max_evaluations: int | None = None


class Motion:
    """Advances a `State` through a flow; calls back at every event (a sample or frame phase)."""

    def __init__(self, suspension: Suspension, flow: Flow, method: Method, settings: StepSettings):
        self.suspension, self.flow, self.method, self.settings = suspension, flow, method, settings
        self.controller = Controller(settings.tolerance, method.order)
        self.position_error = 0.0  # sum of the estimates since the start of the cycle
        self.evaluations_before = 0  # in earlier cycles

    def strain(self, state: State, time: float) -> float:
        """Strain at `time` within the state's cycle."""
        return self.flow.strain(state.cycle, time)

    def tilt(self, state: State, time: float) -> float:
        """Tilt of the cell that the state's positions and images refer to."""
        return self.strain(state, time) + state.offset - state.flips

    def evaluate(self, state: State, position: np.ndarray, time: float, held: HeldPairs | None = None) -> np.ndarray:
        """Velocities (N, 6) at trial positions and gaps of touching pairs, in the frame of the state."""
        strain = self.strain(state, time)
        rate, elapsed = self.flow.rate(state.cycle, time), self.flow.elapsed(state.cycle, time)
        return self.suspension.evaluate(position, strain, self.tilt(state, time), rate, elapsed, held)

    def begin_cycle(self, state: State) -> None:
        """Bring spheres and tilt back into the cell, renew the neighbour list, evaluate the velocities."""
        if state.cycle > 0:
            self._forget_if_rate_jumps(state)
        strain = self.strain(state, state.time)
        flips = flips_of(strain + state.offset)
        flip(state.image, flips - state.flips)
        state.touching.flip(flips - state.flips)
        state.flips = flips
        tilt = self.tilt(state, state.time)
        before = state.image.copy()
        wrap_and_count(state.position, state.image, self.suspension.scene.edge, tilt)
        state.touching.wrap(state.image - before)
        if self.suspension.list is not None:
            self.suspension.renew(state.position, strain, tilt)
        self.position_error = 0.0
        gaps = self._close_gaps(state)
        state.touching = TouchingPairs() if gaps is None else gaps.after(0.0)
        state.velocity = self.evaluate(state, state.position, state.time, state.touching.held())

    def _forget_if_rate_jumps(self, state: State) -> None:
        before = self.flow.rate(state.cycle - 1, self.flow.period(state.cycle - 1))
        if abs(before - self.flow.rate(state.cycle, 0.0)) > 1e-9:
            self.suspension.history.times.clear()
            self.suspension.history.values.clear()

    def advance(self, state: State, events: list[float], visit) -> None:
        """One accepted step; visit(time, position, velocity) at each of the coming `events` it reaches.

        events : times within the cycle still to come, ascending; the last is the cycle's end. Reached ones
        are removed. Raises NumericalError if no step is small enough.
        """
        size, landing = self._choose(state, events)
        while True:
            trial, retry = self._try(state, size)
            if trial is not None:
                break
            if self.settings.fixed is not None:
                why = "spheres overlap, or are thrown out of the cell, at the fixed step (integrator.step)"
                raise NumericalError(self._stuck(state, size, why))
            if retry * self._pace(state) < self.settings.min_step:
                why = "every trial step overlaps or misses the tolerance"
                raise NumericalError(self._stuck(state, size, why))
            size, landing = retry, False
        self._accept(state, trial, events[0] if landing else state.time + size, events, visit)

    def _choose(self, state: State, events: list[float]) -> tuple[float, bool]:
        """Step size, and whether the step ends on the next event."""
        ahead = events[0] - state.time
        if self.settings.fixed is not None:
            parts = math.ceil(ahead / self.settings.fixed - 1e-9)
            return ahead / parts, parts == 1
        longest = self.settings.max_step
        if not self.suspension.scene.sheared:  # there is no strain to be resolved, only the way of the spheres
            longest /= self._pace(state)
        size = min(state.size, longest)
        if not self._landing_pays(ahead, size) and len(events) > 1:
            ahead = events[-1] - state.time
            if ahead > size:  # do not leave a sliver at the cycle's end
                return ahead / math.ceil(ahead / size) if ahead < 2.0 * size else size, False
            return ahead, False
        parts = math.ceil(ahead / size - 1e-9)
        return ahead / parts, parts == 1

    def _landing_pays(self, ahead: float, size: float) -> bool:
        """Whether cutting steps to end on events `ahead` apart costs fewer evaluations than interpolating."""
        if not self.method.dense:
            return True
        stages = len(self.method.nodes)
        return stages * math.ceil(ahead / size - 1e-9) / ahead <= stages / size + 1.0 / ahead

    def _try(self, state: State, size: float) -> tuple[Step | None, float]:
        """A trial step of `size`, or None if it is rejected, without trace; and the size to try next."""
        counters, suspension = self.suspension.counters, self.suspension
        self._check_budget(state)
        history = suspension.history.copy()
        try:
            step = take_step(
                self.method,
                lambda position, time, held=None: self.evaluate(state, position, time, held),
                lambda time: self.strain(state, time),
                state.position,
                state.velocity,
                state.time,
                size,
                self._close_gaps(state),
            )
        except Overlap:
            counters.rejected_overlap += 1
            suspension.history = history
            return None, 0.5 * size
        if step.error is None or self.settings.fixed is not None:
            return step, size
        error = max(step.error, GAP_SHARE * step.gap_error)
        error /= self._pace(state)
        accepted = error <= self.settings.tolerance * size
        proposal = size * self.controller.factor(error / size, accepted)
        if accepted:  # a step cut short says little about much longer ones
            state.size = min(proposal, 2.0 * state.size)
            return step, size
        counters.rejected_error += 1
        suspension.history = history
        return None, proposal

    def _pace(self, state: State) -> float:
        """Radii per unit time that errors are measured against: the shear's, or the speed of spheres that forces move.

        So no force is too small or too large, and the unit of time of a fluid at rest has no say. A sheared suspension
        is measured by the shear until its spheres move ten times as fast.
        """
        speed = math.sqrt(float(np.mean(np.sum(state.velocity[:, :3] ** 2, axis=1))))
        if self.suspension.scene.sheared:
            return max(1.0, FORCED_SHARE * speed)
        return speed if speed > 0.0 else 1.0

    def _close_gaps(self, state: State) -> CloseGaps | None:
        """Pairs whose gaps are integrated by themselves; None where overlaps are allowed or nothing touches."""
        near = self.suspension.near
        if near is None or self.suspension.scene.lubrication.frozen > 0.0:
            return None
        gaps = CloseGaps(
            self.suspension.list,
            state.touching,
            state.position,
            state.time,
            lambda time: self.tilt(state, time),
            lambda time: self.flow.rate(state.cycle, time),
        )
        return gaps if len(gaps) else None

    def _accept(self, state: State, step: Step, end: float, events: list[float], visit) -> None:
        start = (state.time, state.position, state.velocity)
        if abs(end - events[-1]) < 1e-12 * max(1.0, events[-1]):
            end = events[-1]
        while events and events[0] < end - 1e-12 * max(1.0, end):
            time = events.pop(0)
            fraction = (time - start[0]) / (end - start[0])
            last = (end, step.position, step.velocity)
            position, held = interpolate(lambda t: self.strain(state, t), start, last, fraction, step.gaps)
            visit(time, position, self.evaluate(state, position, time, held))
        state.position, state.velocity, state.time = step.position, step.velocity, end
        state.touching = TouchingPairs() if step.gaps is None else step.gaps.gaps.after(step.gaps.change)
        self.suspension.counters.steps += 1
        self.position_error += step.error or 0.0
        if events and events[0] <= end + 1e-12 * max(1.0, end):
            visit(events.pop(0), state.position, state.velocity)

    def _check_budget(self, state: State) -> None:
        limit = self.settings.max_evaluations
        done = self.evaluations_before + self.suspension.counters.evaluations
        if limit is not None and done >= limit:
            raise NumericalError(
                f"{done} velocity evaluations used, the limit is {limit} (integrator.max_evaluations), "
                f"at strain {self.flow.accumulated(state.cycle, state.time):.6g}"
            )

    def _stuck(self, state: State, size: float, why: str) -> str:
        counters = self.suspension.counters
        advice = self._advice(state)
        return (
            f"{why}: step {size:.3g} at cycle {state.cycle}, total strain "
            f"{self.flow.accumulated(state.cycle, state.time):.6g}; "
            f"smallest gap {counters.minimum_gap:.3g} a{self._closest(state)}, {counters.rejected_overlap} overlaps "
            f"and {counters.rejected_error} error rejections in this cycle. "
            f"{advice}"
        )

    @staticmethod
    def _closest(state: State) -> str:
        """The touching pair at the smallest gap, and how many there are."""
        touching = state.touching
        if not len(touching.rows):
            return ""
        k = int(np.argmin(touching.log_gap))
        i, j = touching.rows[k, :2]
        pairs = f"{len(touching.rows)} pairs below {CLOSE:g} a"
        return f" (now spheres {i} and {j}, ln h = {touching.log_gap[k]:.1f}; {pairs})"

    def _advice(self, state: State) -> str:
        """What helps where no step is small enough."""
        counters = self.suspension.counters
        if counters.minimum_gap < PRESSED_GAP:
            return PRESSED[0].upper() + PRESSED[1:]
        if self.settings.fixed is not None:
            return "Lower integrator.step"
        key, accuracy = self.suspension.solve_accuracy
        speed = math.sqrt(float(np.mean(np.sum(state.velocity**2, axis=1))))
        allowed = self.settings.tolerance * self._pace(state)
        if accuracy * speed > allowed:
            return (
                f"The spheres move at {speed:.2g} a per unit time; {key} {accuracy:.2g} of that is more than the error "
                f"of {allowed:.2g} that integrator.tolerance allows, which no step however short can meet: lower "
                f"{key} to {0.1 * allowed / speed:.0e}, or the forces (repulsion, contact, external)"
            )
        if counters.rejected_error:
            return "Lower integrator.min_step, raise integrator.tolerance, or lower the forces"
        return "Lower integrator.min_step, or set lubrication.minimum_gap"
