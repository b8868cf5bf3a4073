"""Starting a run in a directory, or continuing what is there."""

from __future__ import annotations

import time
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING

import numba

from suspend.analysis.rheology import block_row, cycle_row
from suspend.config import Config, loads
from suspend.errors import ConfigurationError, StorageError
from suspend.flow import Flow, continued_flow, make_flow, rate_scale
from suspend.io import CycleTable, Run, RunStore, holds_run
from suspend.scene import make_units
from suspend.simulation.in_memory import Simulation
from suspend.simulation.provenance import provenance
from suspend.simulation.session import Session
from suspend.simulation.stop import Stop
from suspend.simulation.summary import Summary

if TYPE_CHECKING:
    from suspend.initial import InitialConfiguration


def run(
    config: Config,
    directory: str | Path,
    *,
    resume: bool | None = None,
    threads: int | None = None,
    max_time: float | None = None,
    progress: Callable | None = None,
    message: Callable[[str], None] | None = None,
    prepare: Callable[[Config], InitialConfiguration] | None = None,
) -> Summary:
    """Run a configuration into `directory`, or continue, or extend what is there.

    resume : True = only continue an existing run; None = start, or continue a run of the same configuration (the
    duration may be longer). threads : default all cores. max_time : seconds. progress(state), message(text) : optional
    callbacks. prepare : makes the start of a new run (default: `prepare_initial`). Raises ConfigurationError,
    NumericalError, StorageError, Interrupted (after writing a checkpoint).
    """
    started = time.monotonic()
    say = message or (lambda text: None)
    directory = Path(directory)
    threads = _use_threads(threads)
    exists = holds_run(directory)
    if resume and not exists:
        raise StorageError(f"{directory} holds no run to resume: leave out --resume to start one")
    with Stop(max_time) as stop:
        if exists:
            simulation, store = _continue(config, directory, threads, say)
        else:
            initial = (prepare or _prepared)(config)
            simulation, store = _start(config, directory, threads, say, initial)
        with store:
            session = Session(simulation, store, stop, progress, started)
            session.go()
        return session.summary()


def _use_threads(threads: int | None) -> int:
    available = numba.config.NUMBA_NUM_THREADS
    if threads is not None and not 1 <= threads <= available:
        raise ConfigurationError(f"threads: {threads}; this process can use 1 to {available}")
    return threads or available


def _prepared(config: Config) -> InitialConfiguration:
    from suspend.initial import prepare_initial  # what makes or reads a start is not needed to continue

    return prepare_initial(config, config.directory)


def _table(config: Config) -> CycleTable:
    scales = {"viscosity": config.fluid.viscosity}
    if config.flow.type == "oscillatory":
        flow = config.flow
        scales |= {"gamma0": flow.amplitude, "omega": flow.omega, "phase": flow.phase}
        return CycleTable("moduli.csv", lambda record: cycle_row(record, scales))
    scales["rate"] = rate_scale(config)
    return CycleTable("viscosity.csv", lambda record: block_row(record, scales))


def _start(
    config: Config, directory: Path, threads: int, say, initial: InitialConfiguration
) -> tuple[Simulation, RunStore]:
    from suspend.simulation.start_figures import start_figures

    simulation = Simulation(config, threads, initial.length)
    simulation.start(initial.positions, initial.tilt)
    figures = start_figures(initial, config.particles.minimum_gap)
    meta = provenance(config, initial, threads) | figures.meta()
    store = RunStore.create(directory, config.to_yaml(), meta, _table(config))
    say(figures.line())
    return simulation, store


def _continue(config: Config, directory: Path, threads: int, say) -> tuple[Simulation, RunStore]:
    with Run(directory) as run:
        stored = loads(run.config_yaml, source=f"configuration stored in {directory}")
    _check_same(config, stored, directory)
    store = RunStore.open(directory, _table(config))
    try:
        content, partial = store.load_state()
        flow = _continued_flow(config, stored, content, directory)
        simulation = Simulation(config, threads, store.meta["L"] / make_units(config).length, flow)
        simulation.load(content, partial)
        done = simulation.state.cycle
        if done <= flow.cycles and store.config_yaml != config.to_yaml():
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
    if done < flow.cycles:
        say(f"continuing at cycle {done} of {flow.cycles}")
    elif done > flow.cycles:
        say(f"{done} cycles are done, {flow.cycles} asked for: the run stays as it is")
    return simulation, store


def _check_same(config: Config, stored: Config, directory: Path) -> None:
    differing = _differing(stored.to_dict(), config.to_dict())
    if differing:
        raise ConfigurationError(
            f"{directory} holds a run with another configuration ({', '.join(differing)} differ): "
            "choose another --output, or the configuration it was started with"
        )


def _continued_flow(config: Config, stored: Config, content: dict, directory: Path) -> Flow:
    """The flow with the blocks that the run was begun with. Raises ConfigurationError where the duration forbids it."""
    cycle, time, block = content["motion"]["cycle"], content["motion"]["time"], content.get("block")
    flow = continued_flow(config, stored, block, cycle + (time > 0.0))
    if flow is not None:
        return flow
    old = make_flow(stored, block)
    before = f" behind the first {old.pre:g}" if old.pre else ""
    raise ConfigurationError(
        f"{directory}: duration.strain {config.duration.strain:g} cuts the run into other blocks than the "
        f"{stored.duration.strain:g} it holds: choose a whole multiple of the block length "
        f"{old.period(old.cycles - 1):g}{before}"
    )


def _differing(old: dict, new: dict) -> list[str]:
    """Dotted names of the keys of two configurations that differ, the duration's left out."""
    names = []
    for section, value in new.items():
        before = old.get(section)
        if section == "duration" or before == value:
            continue
        if isinstance(value, dict) and isinstance(before, dict):
            names += [f"{section}.{key}" for key in value if before.get(key) != value[key]]
        else:
            names.append(section)
    return sorted(names)
