"""A run from configuration to files: cycles, records, checkpoints, signals, resuming.

    from suspend.config import load
    from suspend.simulation import run
    summary = run(load("configs/demo.yaml"), "demo-run")
"""

from __future__ import annotations

import os
import platform
import signal
import threading
import time
from collections.abc import Callable
from dataclasses import asdict, dataclass
from pathlib import Path

import numba
import numpy as np

import suspend
from suspend.analysis.dynamics import cyclic_diffusivity
from suspend.analysis.rheology import block_row, cycle_row
from suspend.box import unwrap
from suspend.config import Config, loads
from suspend.conventions import FORMAT_VERSION
from suspend.dynamics import Counters, History
from suspend.errors import ConfigurationError, Interrupted, NumericalError, StorageError
from suspend.flow import make_flow, rate_scale
from suspend.initial import prepare_initial
from suspend.integrators import METHODS
from suspend.io import CycleTable, Run, RunStore, holds_run
from suspend.motion import Motion, State, StepSettings
from suspend.plan import Plan, make_plan
from suspend.recorder import Recorder
from suspend.scene import make_suspension, make_units

__all__ = ["Plan", "Simulation", "Summary", "make_plan", "run"]
PROGRESS_EVERY = 0.1  # seconds


@dataclass
class Summary:
    """Closing figures of a session."""

    figures: dict

    def as_dict(self) -> dict:
        """Figures for scripts."""
        return self.figures

    def lines(self) -> list[str]:
        """One line to close a run with."""
        f = self.figures
        if f["evaluations"] == 0:
            return [f"{f['directory']}: finished before, {f['cycles']} cycles, nothing to do"]
        return [
            f"{f['directory']}: {f['cycles']} cycles, total strain {f['total_strain']:.6g}, {f['seconds']:.1f} s, "
            f"{f['evaluations']} velocity evaluations ({f['evaluations'] / max(f['strain_now'], 1e-300):.0f} per unit "
            f"strain), {f['iterations'] / f['evaluations']:.1f} iterations each, "
            f"smallest gap {f['minimum_gap']:.3g} a, rejected steps {f['rejected_overlap']} (overlap) "
            f"{f['rejected_error']} (error)"
        ]


@dataclass
class ProgressState:
    """What a progress bar shows."""

    cycle: int
    cycles: int
    strain: float
    total_strain: float
    fraction: float
    minimum_gap: float
    iterations: int
    evaluations: int
    elapsed: float
    compiling: bool
    initial_fraction: float


class Simulation:
    """One run in memory: suspension, motion, state, record. `run` adds files and signals."""

    def __init__(self, config: Config, threads: int, edge: float | None = None):
        self.config, self.flow, self.units = config, make_flow(config), make_units(config)
        self.suspension = make_suspension(config, threads, edge)
        numba.set_num_threads(self.suspension.threads)  # idle threads would spin
        integrator, output = config.integrator, config.output
        settings = StepSettings(
            integrator.tolerance,
            integrator.step,
            integrator.max_step,
            integrator.min_step,
            integrator.max_evaluations,
        )
        self.motion = Motion(self.suspension, self.flow, METHODS[integrator.method], settings)
        solved = self.suspension.near is not None or self.suspension.far is not None
        driven = output.flow_driven and solved and self.suspension.scene.sheared
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
        period = self.flow.period(state.cycle)
        self.events = [period * phase for phase in self.recorder.event_phases()[1:]] + [period]
        self.recorder.visit(state, 0.0, state.position, state.velocity)

    def step(self) -> None:
        """One accepted step."""
        self.motion.advance(
            self.state, self.events, lambda t, x, u: self.recorder.visit(self.state, t, x, u)
        )

    def end_cycle(self) -> dict:
        """The cycle's record; the state moves to the start of the next cycle."""
        state, counters = self.state, self.suspension.counters
        statistics = {**asdict(counters), "position_error": float(self.motion.position_error)}
        statistics["minimum_gap"] = float(counters.minimum_gap)
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
        """Positions at the end, as arrays of one frame."""
        state = self.state
        state.cycle, state.time = state.cycle - 1, self.flow.period(state.cycle - 1)
        frame = self.recorder.frame(state, state.time, state.position)
        state.cycle, state.time = state.cycle + 1, 0.0
        return {name: np.array([value]) for name, value in frame.items()}

    def dump(self) -> tuple[dict, dict | None]:
        """Everything needed to continue bit for bit: (state, partial record of the cycle in progress)."""
        suspension, motion = self.suspension, self.motion
        verlet = suspension.list
        content = {
            "motion": asdict(self.state),
            "controller": motion.controller.previous,
            "position_error": motion.position_error,
            "evaluations_before": motion.evaluations_before,
            "history": _dump_history(suspension.history),
            "flow_history": _dump_history(suspension.flow_history),
            "threads": suspension.threads,
        }
        if self.between_cycles:
            return content, None
        content |= {
            "counters": asdict(suspension.counters),
            "baseline": suspension.baseline,
            "start_position": self.start_position,
            "list": None if verlet is None else _list_point(verlet),
            "factor": _factor_point(suspension.factor_point),
            "factor_age": suspension.factor_age,
        }
        return content, self.recorder.partial()

    def load(self, content: dict, partial: dict | None) -> None:
        """Continue from what `dump` returned."""
        suspension, motion = self.suspension, self.motion
        self.state, self.events = State(**content["motion"]), []
        motion.controller.previous = content["controller"]
        motion.evaluations_before = content["evaluations_before"]
        _load_history(suspension.history, content["history"])
        _load_history(suspension.flow_history, content["flow_history"])
        if partial is None:
            return
        if content["list"] is not None:
            point = content["list"]
            suspension.renew(point["reference"], point["strain"], point["tilt"])
        if content["factor"] is not None:
            position, tilt = content["factor"]["position"], content["factor"]["tilt"]
            suspension.near.assemble(position, suspension.scene.edge, tilt)
            suspension.factor(position, tilt)
            suspension.factor_age = content["factor_age"]
        motion.position_error = content["position_error"]
        suspension.counters = Counters(**content["counters"])
        suspension.baseline, self.start_position = content["baseline"], content["start_position"]
        self.recorder.resume(partial)
        period = self.flow.period(self.state.cycle)
        ahead = [period * phase for phase in self.recorder.event_phases()[1:]] + [period]
        self.events = [t for t in ahead if t > self.state.time + 1e-12 * max(1.0, self.state.time)]


def _list_point(verlet) -> dict:
    return {"reference": verlet.reference, "strain": verlet.strain, "tilt": verlet.tilt}


def _factor_point(point) -> dict | None:
    return None if point is None else {"position": point[0], "tilt": point[1]}


def _dump_history(history: History) -> dict:
    return {"times": list(history.times), "values": np.array(history.values)}


def _load_history(history: History, content: dict) -> None:
    history.times, history.values = [float(t) for t in content["times"]], list(content["values"])


class _Stop:
    """Set by SIGINT, SIGTERM or the time limit; the run looks at it after every step."""

    def __init__(self, max_time: float | None):
        self.reason: str | None = None
        self.deadline = time.monotonic() + max_time if max_time is not None else None
        self._before: dict = {}

    def __enter__(self) -> _Stop:
        if threading.current_thread() is threading.main_thread():
            for number in (signal.SIGINT, signal.SIGTERM):
                self._before[number] = signal.signal(number, self._receive)
        return self

    def __exit__(self, *_) -> None:
        for number, handler in self._before.items():
            signal.signal(number, handler)

    def _receive(self, number, _frame) -> None:
        self.reason = signal.Signals(number).name

    def check(self) -> str | None:
        """Why to stop, None to go on."""
        if self.reason is None and self.deadline is not None and time.monotonic() > self.deadline:
            self.reason = "time limit"
        return self.reason


def run(
    config: Config,
    directory: str | Path,
    *,
    resume: bool | None = None,
    threads: int | None = None,
    max_time: float | None = None,
    progress: Callable | None = None,
    message: Callable[[str], None] | None = None,
) -> Summary:
    """Run a configuration into `directory`, or continue, or extend what is there.

    resume : True = only continue an existing run; None = start, or continue a run of the same configuration (the
    duration may be longer). threads : default all cores. max_time : seconds. progress(state), message(text) : optional
    callbacks. Raises ConfigurationError, NumericalError, StorageError, Interrupted (after writing a checkpoint).
    """
    started = time.monotonic()
    say = message or (lambda text: None)
    directory = Path(directory)
    threads = _use_threads(threads)
    exists = holds_run(directory)
    if resume and not exists:
        raise StorageError(f"{directory} holds no run to resume: leave out --resume to start one")
    with _Stop(max_time) as stop:
        simulation, store = (_continue if exists else _start)(config, directory, threads, say)
        with store:
            session = _Session(simulation, store, stop, progress, started)
            session.go()
        return session.summary()


def _use_threads(threads: int | None) -> int:
    available = numba.config.NUMBA_NUM_THREADS
    if threads is not None and not 1 <= threads <= available:
        raise ConfigurationError(f"threads: {threads}; this process can use 1 to {available}")
    return threads or available


def _table(config: Config) -> CycleTable:
    scales = {"viscosity": config.fluid.viscosity}
    if config.flow.type == "oscillatory":
        flow = config.flow
        scales |= {"gamma0": flow.amplitude, "omega": flow.omega, "phase": flow.phase}
        return CycleTable("moduli.csv", lambda record: cycle_row(record, scales))
    scales["rate"] = rate_scale(config)
    return CycleTable("viscosity.csv", lambda record: block_row(record, scales))


def _start(config: Config, directory: Path, threads: int, say) -> tuple[Simulation, RunStore]:
    initial = prepare_initial(config, config.directory)
    simulation = Simulation(config, threads, initial.length)
    simulation.start(initial.positions, initial.tilt)
    store = RunStore.create(directory, config.to_yaml(), _meta(config, initial, threads), _table(config))
    if initial.packing is not None:
        p = initial.packing
        say(
            f"start: random packing, g(contact) {p.contact_value:.3g} (equilibrium fluid "
            f"{p.equilibrium_contact_value:.3g}), Q6 {p.global_q6:.3g}, smallest gap {p.minimum_gap:.3g} a"
        )
    return simulation, store


def _meta(config: Config, initial, threads: int) -> dict:
    import h5py
    import scipy

    units = make_units(config)
    return {
        "number": config.particles.number,
        "L": initial.length * units.length,
        "radius": units.length,
        "viscosity": units.viscosity,
        "rate": units.rate,
        "seed": config.seed,
        "threads": threads,
        "format_version": FORMAT_VERSION,
        "start_tilt": initial.tilt,
        "start_minimum_gap": initial.minimum_gap if initial.minimum_gap is not None else np.nan,
        "machine": platform.machine(),
        "processor": platform.processor() or "unknown",
        "cores": os.cpu_count() or 1,
        "created": time.strftime("%Y-%m-%dT%H:%M:%SZ", time.gmtime()),
        "versions": {
            "suspend": suspend.__version__,
            "python": platform.python_version(),
            "numpy": np.__version__,
            "scipy": scipy.__version__,
            "numba": numba.__version__,
            "h5py": h5py.__version__,
        },
    }


def _continue(config: Config, directory: Path, threads: int, say) -> tuple[Simulation, RunStore]:
    with Run(directory) as stored:
        _check_same(config, stored, directory)
    store = RunStore.open(directory, _table(config))
    try:
        units = make_units(config)
        simulation = Simulation(config, threads, store.meta["L"] / units.length)
        content, partial = store.load_state()
        simulation.load(content, partial)
        if store.config_yaml != config.to_yaml():
            store.update_configuration(config.to_yaml())
    except BaseException:
        store.close()
        raise
    for note in store.notes:
        say(note)
    if simulation.suspension.threads != content["threads"]:
        say(
            f"note: {content['threads']} thread(s) before, {simulation.suspension.threads} now: results go on "
            "within the tolerances, not bit for bit"
        )
    say(f"continuing at cycle {simulation.state.cycle} of {simulation.flow.cycles}")
    return simulation, store


def _check_same(config: Config, run: Run, directory: Path) -> None:
    stored = loads(run.config_yaml, source=f"configuration stored in {directory}")
    old, new = stored.to_dict(), config.to_dict()
    old_flow, new_flow = make_flow(stored), make_flow(config)
    differing = sorted(
        f"{section}.{key}" if isinstance(new[section], dict) else section
        for section in new
        if section != "duration" and old.get(section) != new[section]
        for key in (new[section] if isinstance(new[section], dict) and isinstance(old.get(section), dict) else [""])
        if not isinstance(new[section], dict) or not isinstance(old.get(section), dict)
        or old[section].get(key) != new[section][key]
    )
    if differing:
        raise ConfigurationError(
            f"{directory} holds a run with another configuration ({', '.join(differing)} differ): "
            "choose another --output, or the configuration it was started with"
        )
    if run.cycles and old_flow.period(0) != new_flow.period(0):
        raise ConfigurationError(
            f"{directory}: duration.strain {config.duration.strain:g} cuts the run into other blocks than the "
            f"{stored.duration.strain:g} it was started with: choose a whole multiple of the block length "
            f"{old_flow.period(0):g}"
        )


class _Session:
    """The loop over cycles with files, signals and progress."""

    def __init__(self, simulation: Simulation, store: RunStore, stop: _Stop, progress, started: float):
        self.simulation, self.store, self.stop, self.progress = simulation, store, stop, progress
        self.started, self.drawn = started, 0.0
        flow = simulation.flow
        self.total = flow.accumulated(flow.cycles - 1, flow.period(flow.cycles - 1))
        self.begun = self._strain()
        self.sums = {k: 0 for k in ("evaluations", "iterations", "rejected_overlap", "rejected_error")}
        self.smallest = np.inf
        self.count_before = asdict(simulation.suspension.counters)

    def _strain(self) -> float:
        state = self.simulation.state
        return self.simulation.flow.accumulated(state.cycle, state.time)

    def go(self) -> None:
        """Run to the end; a checkpoint is written whatever stops it."""
        simulation, store = self.simulation, self.store
        if not store.has_state:
            store.save(*simulation.dump())
        self._report(compiling=True)
        if simulation.state.cycle >= simulation.flow.cycles:
            if not store.finished:
                store.finish(simulation.dump()[0], simulation.final_frame())
            return
        while True:
            self._cycle()
            if simulation.state.cycle >= simulation.flow.cycles:
                break
            self._interrupt()
        store.finish(simulation.dump()[0], simulation.final_frame())

    def _cycle(self) -> None:
        simulation, clock = self.simulation, time.monotonic()
        try:
            if simulation.between_cycles:
                simulation.begin_cycle()
            while simulation.events:
                simulation.step()
                self._report()
                if simulation.events:
                    self._interrupt()
        except NumericalError as error:
            raise NumericalError(
                f"{error}; cycle {simulation.state.cycle}, step after total strain {self._strain():.6g}; the "
                f"{self.store.cycles_done} completed cycles are kept in {self.store.directory}"
            ) from None
        simulation.wall_time = time.monotonic() - clock
        self._count(asdict(simulation.suspension.counters))
        self.store.append_cycle(simulation.end_cycle())
        self.store.save(*simulation.dump())

    def _count(self, counters: dict) -> None:
        for name in self.sums:
            self.sums[name] += counters[name] - self.count_before[name]
        self.smallest = min(self.smallest, counters["minimum_gap"])
        self.count_before = asdict(Counters())

    def _interrupt(self) -> None:
        reason = self.stop.check()
        if reason is None:
            return
        self.store.save(*self.simulation.dump())
        self.store.consolidate()
        raise Interrupted(
            f"stopped ({reason}) at total strain {self._strain():.6g} of {self.total:.6g}; checkpoint written, "
            "the same command continues"
        )

    def _report(self, compiling: bool = False) -> None:
        now = time.monotonic()
        if self.progress is None or (now - self.drawn < PROGRESS_EVERY and not compiling):
            return
        self.drawn = now
        state, counters, strain = self.simulation.state, self.simulation.suspension.counters, self._strain()
        self.progress(
            ProgressState(
                cycle=state.cycle,
                cycles=self.simulation.flow.cycles,
                strain=strain,
                total_strain=self.total,
                fraction=strain / self.total,
                minimum_gap=counters.minimum_gap,
                iterations=counters.iterations,
                evaluations=counters.evaluations,
                elapsed=now - self.started,
                compiling=compiling,
                initial_fraction=self.begun / self.total,
            )
        )

    def summary(self) -> Summary:
        """Closing figures of this session."""
        return Summary(
            {
                "directory": str(self.store.directory),
                "cycles": self.store.cycles_done,
                "total_strain": self.total,
                "strain_now": self.total - self.begun,
                "seconds": time.monotonic() - self.started,
                "minimum_gap": float(self.smallest),
                **self.sums,
            }
        )
