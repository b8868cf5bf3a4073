"""What is kept of a cycle: stress samples, positions at chosen phases, solver statistics, in the file's units."""

from __future__ import annotations

import numpy as np

from suspend.box import flip, flips_of, unwrap
from suspend.core.cell import wrap_and_count
from suspend.motion import Motion, State
from suspend.scene import Units

PHASE_TOLERANCE = 1e-9  # cycles: phases closer than this are one event


class Recorder:
    """Collects the record of one cycle after the other.

    samples : stress samples per cycle; phases : fractions of the cycle at which positions are kept;
    flow_driven, per_sphere : whether these stresses are wanted.
    """

    def __init__(self, motion: Motion, units: Units, samples: int, phases, flow_driven: bool, per_sphere: bool):
        self.motion, self.units, self.samples, self.phases = motion, units, samples, tuple(phases)
        self.flow_driven, self.per_sphere = flow_driven, per_sphere

    def event_phases(self) -> list[float]:
        """Phases of all samples and frames, ascending from 0, without the cycle's end."""
        merged: list[float] = []
        for phase in sorted({k / self.samples for k in range(self.samples)} | set(self.phases)):
            if not merged or phase - merged[-1] > PHASE_TOLERANCE:
                merged.append(phase)
        return merged

    def begin(self, cycle: int) -> None:
        """Start the record of `cycle`."""
        self.record = {"index": cycle, "complete": False}
        self.rows: dict[str, list] = {}

    def resume(self, partial: dict) -> None:
        """Continue a record that `partial` returned."""
        self.record = {"index": partial["index"], "complete": False}
        self.rows = {name: list(values) for name, values in partial["rows"].items()}

    def partial(self) -> dict:
        """The record so far, for a checkpoint in mid-cycle."""
        return {"index": self.record["index"], "rows": {name: np.array(v) for name, v in self.rows.items()}}

    def visit(self, state: State, time: float, position: np.ndarray, velocity: np.ndarray) -> None:
        """Take what is due at `time` within the cycle; positions and velocities as at the last evaluation."""
        phase = time / self.motion.flow.period(state.cycle)
        nearest = round(phase * self.samples)
        if abs(phase - nearest / self.samples) < PHASE_TOLERANCE and nearest < self.samples:
            self._sample(state, time, nearest / self.samples, position, velocity)
        for kept in self.phases:
            if abs(phase - kept) < PHASE_TOLERANCE:
                self._add(frame_phase=kept, **self.frame(state, time, position))

    def _add(self, **values) -> None:
        for name, value in values.items():
            self.rows.setdefault(name, []).append(value)

    def _sample(self, state: State, time: float, phase: float, position, velocity) -> None:
        flow, suspension, units = self.motion.flow, self.motion.suspension, self.units
        rate, elapsed = flow.rate(state.cycle, time), flow.elapsed(state.cycle, time)
        parts = suspension.stress(velocity, rate)
        suspension.count_contacts(position, flow.strain(state.cycle, time), self.motion.tilt(state, time))
        self._add(
            time=elapsed * units.time, strain=flow.strain(state.cycle, time), rate=rate * units.rate, phase=phase
        )
        self._add(**{f"stress_{name}": units.stress * value for name, value in parts.items()})
        if self.flow_driven:
            self._add(stress_flow_driven=units.stress * suspension.flow_driven_stress(rate, elapsed))
        if self.per_sphere:
            each = suspension.stress_per_sphere(position, self.motion.tilt(state, time), velocity, rate)
            self._add(particle_stress=units.stress * each)

    def frame(self, state: State, time: float, position: np.ndarray) -> dict:
        """Wrapped and unwrapped positions at `time` within the cycle, with tilt and images."""
        edge, length = self.motion.suspension.scene.edge, self.units.length
        tilt = self.motion.tilt(state, time)
        unwrapped = unwrap(position, state.image, edge, tilt)
        extra = flips_of(tilt)
        wrapped, image = position.copy(), state.image.copy()
        flip(image, extra)
        wrap_and_count(wrapped, image, edge, tilt - extra)
        return {
            "frame_time": self.motion.flow.elapsed(state.cycle, time) * self.units.time,
            "frame_strain": self.motion.strain(state, time),
            "tilt": tilt - extra,
            "position": length * wrapped,
            "image": image,
            "unwrapped": length * unwrapped,
        }

    def finish(self, statistics: dict) -> dict:
        """The complete record."""
        arrays = {name: np.array(values) for name, values in self.rows.items()}
        return self.record | arrays | {"complete": True, "statistics": statistics}

