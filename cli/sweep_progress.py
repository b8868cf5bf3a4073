"""Progress of a sweep on stderr: a table that is redrawn on a terminal, a line an event elsewhere."""

from __future__ import annotations

import os
import shutil
import sys
import time

from suspend_cli.progress import clock_time

WORDS = {"start": "started", "done": "complete", "stopped": "stopped", "again": "to be tried again", "failed": "FAILED"}
SHOWN = 20  # running points in the table


class SweepProgress:
    """Shows events and states of a sweep. Quiet: nothing at all."""

    def __init__(self, stream=None, quiet: bool = False):
        self.stream = stream if stream is not None else sys.stderr
        self.quiet = quiet
        self.live = self.stream.isatty() and os.environ.get("TERM", "") != "dumb" and not quiet
        self._lines: list[str] = []

    def __enter__(self) -> SweepProgress:
        """Nothing is drawn before the first state."""
        return self

    def __exit__(self, *error: object) -> None:
        """Leave the last table on the screen."""
        self._lines = []

    def message(self, text: str) -> None:
        """Print a line, above the table if there is one."""
        if not self.quiet:
            self._draw([text], self._lines)

    def event(self, kind: str, task, text: str) -> None:
        """Say what became of a point."""
        if self.live and kind in ("start", "stopped"):
            return  # the table shows it
        when = "" if self.live else time.strftime("%H:%M:%S ")
        cost = f", {clock_time(task.record.seconds)} of run time" if kind == "done" else ""
        self.message(f"{when}{task.folder.name} {WORDS[kind]}{cost}" + (f": {text}" if text else ""))

    def report(self, state) -> None:
        """Draw the table."""
        if self.live:
            size = shutil.get_terminal_size()
            self._draw([], [line[: size.columns - 1] for line in table(state, size.lines - 3)])

    def _draw(self, above: list[str], lines: list[str]) -> None:
        back = f"\x1b[{len(self._lines)}A\r\x1b[J" if self._lines else ""
        self.stream.write(back + "".join(f"{line}\n" for line in [*above, *lines]))
        self.stream.flush()
        self._lines = lines


def table(state, room: int = SHOWN) -> list[str]:
    """Lines for a state of the sweep."""
    head = f"{state.done}/{state.total} complete, {len(state.running)} running, {state.waiting} waiting"
    head += f", {len(state.failed)} failed" if state.failed else ""
    lines = [head + (f", on {state.where}" if state.where else "")]
    running = state.running[: max(min(SHOWN, room), 1)]
    width = max((len(each.task.folder.name) for each in running), default=0)
    for each in running:
        record = each.record
        strain = f"{record.strain:.4g}/{record.total_strain:.4g}" if record.total_strain else "starting"
        lines.append(f"  {each.task.folder.name.ljust(width)}  {strain:>13}  {clock_time(each.left):>8} left")
    return lines
