"""Progress on stderr: one line that is redrawn on a terminal, a line now and then in the log of a job."""

from __future__ import annotations

import math
import os
import shutil
import sys
import time

INTERVAL = 0.1  # seconds between redrawings
LOGGED = 60.0  # seconds between lines of a log, at least where no tenth of the run is completed
BAR = 24  # characters, at most
DONE_BEFORE, DONE_NOW, TO_DO = "=", "#", "."


class Progress:
    """Draws the state of a run; messages appear above it. Quiet: nothing at all.

    Where the stream is no terminal, prints a line at each tenth of the run, and one a minute between them.

    `update` takes an object with the attributes cycle, cycles, strain, total_strain, fraction, minimum_gap
    (radii), iterations, evaluations, compiling and initial_fraction (done before this session).
    """

    def __init__(self, stream=None, quiet: bool = False, clock=time.monotonic):
        self.stream = stream if stream is not None else sys.stderr
        self.quiet = quiet
        terminal = self.stream.isatty() and os.environ.get("TERM", "") != "dumb"
        self.visible = terminal and not quiet
        self._clock = clock
        self._drawn = -math.inf
        self._start: tuple[float, float] | None = None  # clock and fraction when computing began
        self._line = ""
        self._logged = -math.inf
        self._tenth: int | None = None
        self._said_compiling = False

    def __enter__(self) -> Progress:
        """Nothing is drawn before the first update."""
        return self

    def __exit__(self, *error: object) -> None:
        """Leave the last state on the screen, on a line of its own."""
        if self._line:
            self.stream.write("\n")
            self.stream.flush()
            self._line = ""

    def message(self, text: str) -> None:
        """Print a line, above the bar if there is one."""
        if self.quiet:
            return
        self.stream.write(f"\r\x1b[K{text}\n{self._line}" if self._line else f"{text}\n")
        self.stream.flush()

    def update(self, state) -> None:
        """Draw `state`, unless the last drawing is too recent."""
        now = self._clock()
        if self._start is None and not state.compiling:
            self._start = (now, state.fraction)
        if not self.visible:
            self._log(now, state)
            return
        if (now - self._drawn < INTERVAL and state.fraction < 1.0):
            return
        self._drawn = now
        width = shutil.get_terminal_size().columns - 1
        self._line = render(state, self._left(now, state.fraction), width)
        self.stream.write(f"\r\x1b[K{self._line}")
        self.stream.flush()

    def _log(self, now: float, state) -> None:
        """A line for a job's log, if one is due."""
        if self.quiet or (state.compiling and self._said_compiling):
            return
        if state.compiling:
            self._said_compiling = True
            self.message(COMPILING)
            return
        tenth = int(10.0 * state.fraction + 1e-9)
        if self._tenth is None:  # what it begins with is known
            self._tenth, self._logged = tenth, now
            return
        if tenth <= self._tenth and now - self._logged < LOGGED:
            return
        self._tenth, self._logged = max(tenth, self._tenth), now
        self.message(log_line(state, self._left(now, state.fraction)))

    def _left(self, now: float, fraction: float) -> float | None:
        """Seconds left at the pace of this session, None while it is unknown."""
        if self._start is None or fraction <= self._start[1]:
            return None
        return (now - self._start[0]) / (fraction - self._start[1]) * (1.0 - fraction)


COMPILING = "compiling the kernels (on the first run only, about a minute)"


def log_line(state, left: float | None) -> str:
    """The line for `state` in a log, with `left` seconds to go (None: unknown)."""
    text = (
        f"cycle {state.cycle}/{state.cycles}, {100.0 * state.fraction:.0f} %, "
        f"strain {state.strain:.4g}/{state.total_strain:.4g}, {clock_time(left)} left"
    )
    return text + (f", smallest gap {state.minimum_gap:.1e} a" if math.isfinite(state.minimum_gap) else "")


def render(state, left: float | None, width: int) -> str:
    """The line for `state` with `left` seconds to go (None: unknown), at most `width` characters."""
    if state.compiling:
        return COMPILING[:width]
    head = f"cycle {state.cycle}/{state.cycles} "
    parts = [
        f" {100.0 * state.fraction:.0f} %",
        f"strain {state.strain:.4g}/{state.total_strain:.4g}",
        f"{clock_time(left)} left",
    ]
    if math.isfinite(state.minimum_gap):
        parts.append(f"smallest gap {state.minimum_gap:.1e} a")
    if state.evaluations:
        parts.append(f"{state.iterations / state.evaluations:.1f} iterations")
    tail = ", ".join(parts)
    room = min(BAR, width - len(head) - len(tail) - 2)
    bar = f"[{_bar(state.initial_fraction, state.fraction, room)}]" if room >= 5 else ""
    return (head + bar + tail)[:width]


def clock_time(seconds: float | None) -> str:
    """1:02:03, 2:03, or ? where it is unknown."""
    if seconds is None or not math.isfinite(seconds):
        return "?"
    minutes, rest = divmod(round(seconds), 60)
    hours, minutes = divmod(minutes, 60)
    return f"{hours}:{minutes:02d}:{rest:02d}" if hours else f"{minutes}:{rest:02d}"


def _bar(before: float, now: float, room: int) -> str:
    first = min(room, int(before * room))
    second = max(first, min(room, int(now * room)))
    return DONE_BEFORE * first + DONE_NOW * (second - first) + TO_DO * (room - second)
