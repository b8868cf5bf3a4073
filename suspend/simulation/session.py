"""The loop over the cycles of a run, with files, signals and progress."""

from __future__ import annotations

import time
from dataclasses import asdict
from typing import TYPE_CHECKING

import numpy as np

from suspend.config import Config
from suspend.dynamics import Counters
from suspend.errors import Interrupted, NumericalError
from suspend.io import Run, RunStore
from suspend.missing import known
from suspend.simulation.in_memory import Simulation
from suspend.simulation.progress import ProgressState, while_compiling
from suspend.simulation.stop import Stop
from suspend.simulation.summary import Summary

if TYPE_CHECKING:
    from suspend.analysis.steady_state import SteadyWatch

PROGRESS_EVERY = 0.1  # seconds


class Session:
    """The loop over cycles with files, signals and progress."""

    def __init__(self, simulation: Simulation, store: RunStore, stop: Stop, progress, started: float):
        self.simulation, self.store, self.stop, self.progress = simulation, store, stop, progress
        self.started, self.drawn = started, 0.0
        self.compilations = None
        flow = simulation.flow
        self.watch = watch(simulation.config, store)
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
        if self._complete():
            self._report()
            # A longer run that is asked for less stays as it is. A cycle begun since is kept for an extension.
            if simulation.state.cycle <= simulation.flow.cycles and not store.finished:
                self._finish()
            return
        with while_compiling(lambda: self._report(compiling=True)) as self.compilations:
            self._cycles()
        self._finish()

    def _complete(self) -> bool:
        """Whether nothing is left to do: the duration is reached, or the steady state where that ends the run."""
        simulation = self.simulation
        return simulation.state.cycle >= simulation.flow.cycles or (self.watch is not None and self.watch.steady)

    def _finish(self) -> None:
        state, partial = self.simulation.dump()
        end = None if self.watch is None else self.watch.verdict().text()
        self.store.finish(state, self.simulation.final_frame(), partial, end)

    def _cycles(self) -> None:
        while True:
            self._cycle()
            if self._complete():
                break
            self._interrupt()

    def _cycle(self) -> None:
        simulation, clock = self.simulation, time.monotonic() - self.compilations.seconds
        try:
            if simulation.between_cycles:
                simulation.begin_cycle()
            self._report()
            while simulation.events:
                simulation.step()
                self.stop.keep()
                self._report()
                if simulation.events:
                    self._interrupt()
        except NumericalError as error:
            raise NumericalError(
                f"{error}; cycle {simulation.state.cycle}, step after total strain {self._strain():.6g}; the "
                f"{self.store.cycles_done} completed cycles are kept in {self.store.directory}"
            ) from None
        simulation.wall_time = time.monotonic() - self.compilations.seconds - clock
        self._count(asdict(simulation.suspension.counters))
        record = simulation.end_cycle()
        self.store.append_cycle(record)
        if self.watch is not None:
            self.watch.add(record)
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
        state, counters = self.simulation.state, self.simulation.suspension.counters
        strain = min(self._strain(), self.total)  # a run may hold more than it is asked for
        self.progress(
            ProgressState(
                cycle=min(state.cycle, self.simulation.flow.cycles),
                cycles=self.simulation.flow.cycles,
                strain=strain,
                total_strain=self.total,
                fraction=strain / self.total,
                minimum_gap=known(float(counters.minimum_gap)),
                iterations=counters.iterations,
                evaluations=counters.evaluations,
                elapsed=now - self.started,
                compiling=compiling,
                initial_fraction=min(self.begun / self.total, 1.0),
            )
        )

    def summary(self) -> Summary:
        """Closing figures of this session."""
        return Summary(
            {
                "directory": str(self.store.directory),
                "cycles": self.store.cycles_done,
                "total_strain": self._strain(),
                "strain_now": self._strain() - self.begun,
                "seconds": time.monotonic() - self.started,
                "compiling_seconds": self.compilations.seconds if self.compilations is not None else 0.0,
                "minimum_gap": known(float(self.smallest)),
                **self.sums,
                "end": self.store.meta.get("end") if self.store.finished else None,
            }
        )


def watch(config: Config, store: RunStore) -> SteadyWatch | None:
    """What ends a run at its steady state, with the cycles done so far; None where it runs for its duration."""
    if config.duration.until_steady is None:
        return None
    from suspend.analysis.steady_state import SteadyWatch

    with Run(store.directory) as stored:
        return SteadyWatch.of(stored, config.duration.until_steady, store.cycles_done)
