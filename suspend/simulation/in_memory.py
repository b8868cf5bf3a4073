"""One run in memory, cycle by cycle, without files."""

from __future__ import annotations

from dataclasses import asdict, replace

import numpy as np

from suspend.analysis.dynamics import cyclic_diffusivity
from suspend.box import unwrap
from suspend.config import Config
from suspend.dynamics import Counters
from suspend.flow import Flow, make_flow
from suspend.integrators import METHODS
from suspend.missing import known
from suspend.motion import Motion, State, StepSettings
from suspend.recorder import Recorder
from suspend.scene import make_suspension, make_units
from suspend.simulation import checkpoint


class Simulation:
    """One run in memory: suspension, motion, state, record. `run` adds files and signals."""

    def __init__(self, config: Config, threads: int, edge: float | None = None, flow: Flow | None = None):
        self.config, self.flow, self.units = config, flow or make_flow(config), make_units(config)
        self.suspension = make_suspension(config, threads, edge)
        integrator, output = config.integrator, config.output
        settings = StepSettings(
            integrator.tolerance,
            integrator.step,
            integrator.max_step,
            integrator.min_step,
            integrator.max_evaluations,
        )
        self.motion = Motion(self.suspension, self.flow, METHODS[integrator.method], settings)
        scene = self.suspension.scene
        driven = output.flow_driven and scene.sheared and (scene.lubrication is not None or scene.ewald is not None)
        self.recorder = Recorder(
            self.motion, self.units, output.samples_per_cycle, output.position_phases, driven, output.particle_stress
        )
        self.wall_time = 0.0

    def start(self, position: np.ndarray, tilt: float) -> None:
        """Begin at the flow's start with positions (N, 3) in radii, wrapped, in a cell of the given tilt."""
        number = len(position)
        self.state = State(
            position=position.copy(),
            image=np.zeros((number, 3), np.int32),
            velocity=np.zeros((number, 6)),
            cycle=0,
            time=0.0,
            flips=0,
            size=min(0.01, self.config.integrator.max_step),
            offset=tilt - self.flow.strain(0, 0.0),
        )
        self.events: list[float] = []

    @property
    def between_cycles(self) -> bool:
        """True before the first step of a cycle."""
        return not self.events

    def begin_cycle(self) -> None:
        """Renew lists, evaluate, take the first sample and set the coming events."""
        state = self.state
        self.motion.begin_cycle(state)
        self.recorder.begin(state.cycle)
        self.start_position = self._unwrapped()
        self.events = self.coming_events()
        self.recorder.visit(state, 0.0, state.position, state.velocity)

    def coming_events(self) -> list[float]:
        """Times within the cycle of all samples and frames after its start, and of its end."""
        period = self.flow.period(self.state.cycle)
        return [period * phase for phase in self.recorder.event_phases()[1:]] + [period]

    def step(self) -> None:
        """One accepted step."""
        self.motion.advance(
            self.state, self.events, lambda t, x, u: self.recorder.visit(self.state, t, x, u)
        )

    def end_cycle(self) -> dict:
        """The cycle's record; the state moves to the start of the next cycle."""
        state, counters = self.state, self.suspension.counters
        statistics = {**asdict(counters), "position_error": float(self.motion.position_error)}
        statistics["minimum_gap"] = known(float(counters.minimum_gap))
        if self.config.flow.type == "oscillatory":
            statistics["d_cyc"] = float(
                cyclic_diffusivity(self.start_position, self._unwrapped(), self.config.flow.amplitude, 1.0)
            )
        statistics["wall_time"] = self.wall_time
        record = self.recorder.finish(statistics)
        self.motion.evaluations_before += counters.evaluations
        self.suspension.counters = Counters()
        state.cycle, state.time = state.cycle + 1, 0.0
        self.wall_time = 0.0
        return record

    def _unwrapped(self) -> np.ndarray:
        state = self.state
        return unwrap(
            state.position, state.image, self.suspension.scene.edge, self.motion.tilt(state, state.time)
        )

    def final_frame(self) -> dict:
        """Positions at the end of the last complete cycle, as arrays of one frame."""
        last = self.state.cycle - 1
        period = self.flow.period(last)
        state = replace(self.state, cycle=last, time=period)
        if not self.between_cycles:  # a cycle has begun since: its start is where the last one ended
            state.position, state.image = self.start_position, np.zeros_like(state.image)
        frame = self.recorder.frame(state, period, state.position)
        return {name: np.array([value]) for name, value in frame.items()}

    def dump(self) -> tuple[dict, dict | None]:
        """Everything needed to continue bit for bit: (state, partial record of the cycle in progress)."""
        return checkpoint.dump(self)

    def load(self, content: dict, partial: dict | None) -> None:
        """Continue from what `dump` returned."""
        checkpoint.load(self, content, partial)
