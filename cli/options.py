"""Types of options: overrides, wall time, threads, figure files."""

from __future__ import annotations

import os
import re
import sys
from pathlib import Path

import click
from click.shell_completion import CompletionItem

FEATURES = re.compile(r"[+-][\w.-]+(,[+-][\w.-]+)*", re.ASCII)  # LLVM ends the process for other text
FIGURES = (".png", ".pdf")  # `suspend.plots.FORMATS`, known here without importing matplotlib


def cores() -> int:
    """Cores this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def use_threads(threads: int) -> None:
    """Let numba start `threads` threads; it reads the variable once, when it is imported."""
    if "numba" not in sys.modules:
        os.environ["NUMBA_NUM_THREADS"] = str(threads)


class OverrideType(click.ParamType):
    """KEY=VALUE, checked with the configuration; the shell completes the keys."""

    name = "key=value"

    def shell_complete(self, ctx, param, incomplete):
        """Dotted keys that begin with what is typed."""
        from suspend.config.schema import every_key

        return [
            CompletionItem(f"{key}=", help=i.meaning)
            for key, i in every_key().items()
            if key.startswith(incomplete)
        ]


class Place(click.Path):
    """A file or folder; empty text, as of a variable that is not set, is none."""

    def convert(self, value, param, ctx):
        """The path as text."""
        if value == "":
            self.fail("found an empty name; is a variable not set? `.` is the current folder", param, ctx)
        return super().convert(value, param, ctx)


def check_environment() -> None:
    """Refuse what Numba and LLVM cannot start with."""
    features = os.environ.get("NUMBA_CPU_FEATURES", "")
    if features and not FEATURES.fullmatch(features):
        raise click.UsageError(
            f"the environment has NUMBA_CPU_FEATURES={features}; must be names with + or - in front, separated by "
            "commas, such as +avx2,-avx512f: unset it"
        )
    value = os.environ.get("NUMBA_NUM_THREADS", "")
    if value and not (value.strip().isascii() and value.strip().isdigit() and int(value) >= 1):
        raise click.UsageError(
            f"the environment has NUMBA_NUM_THREADS={value}; must be an integer of at least 1: "
            "unset it, or use --threads"
        )


class DurationType(click.ParamType):
    """Wall time to seconds: 90, 90s, 10m, 2h, 1h30m, 1d; of schedulers: 10:00, 1:30:00, 1-12, 1-12:00:00."""

    name = "time"

    def convert(self, value, param, ctx):
        """Seconds, more than 0."""
        if isinstance(value, int | float):
            return float(value)
        from suspend.config.wall_time import EXAMPLES, wall_seconds

        total = wall_seconds(value)
        if total is None:
            self.fail(f"found {value!r}; must be a time > 0 such as {EXAMPLES}", param, ctx)
        return total


class Threads(click.ParamType):
    """Number of threads from 1 to the number of cores."""

    name = "threads"

    def convert(self, value, param, ctx):
        """An integer in the range."""
        available = cores()
        try:
            threads = int(value)
        except ValueError:
            threads = 0
        if not 1 <= threads <= available:
            self.fail(
                f"found {value}; must be an integer from 1 to {available}, the cores there are", param, ctx
            )
        return threads


class Figure(click.ParamType):
    """File to draw into; its suffix is the format."""

    name = "file"

    def convert(self, value, param, ctx):
        """The path as text."""
        if Path(value).suffix.lower() not in FIGURES:
            self.fail(f"found {value!r}; must end in {', '.join(FIGURES)}", param, ctx)
        return value


class Accuracy(click.ParamType):
    """A number in the range of accuracies."""

    name = "tol"

    def convert(self, value, param, ctx):
        """A float; its range is checked where it is used, too."""
        from suspend.config.schema import COARSEST, FINEST

        try:
            accuracy = float(value)
        except ValueError:
            accuracy = 0.0
        if not FINEST <= accuracy <= COARSEST:
            reason = f"{FINEST:g} (finer is lost in round-off) to {COARSEST:g}"
            self.fail(f"found {value}; must be a number from {reason}", param, ctx)
        return accuracy


def runs_of(paths) -> tuple[list[str], list[dict]]:
    """The paths with sweeps replaced by their complete points, and the sweeps; what is left out goes to stderr."""
    from suspend.sweep.runs import is_sweep, select_runs

    if not any(map(is_sweep, paths)):
        return list(paths), []
    found = select_runs(paths)
    for note in found.notes:
        click.echo(f"Note: {note}", err=True)
    return found.runs, found.sweeps


overrides_option = click.option(
    "--set",
    "overrides",
    type=OverrideType(),
    multiple=True,
    metavar="KEY=VALUE",
    help="Override a key, such as lubrication.at_cutoff=hard. May be repeated.",
)
threads_option = click.option(
    "--threads", type=Threads(), metavar="N", help="Threads to compute with. [default: all cores]"
)
quiet_option = click.option("-q", "--quiet", is_flag=True, help="Print errors only.")


def method_options(accuracy: float, meaning: str, far_field: str):
    """Options of the one-shot commands: far field, lubrication, accuracy (default, what it means), overrides."""

    def decorate(command):
        for option in (
            overrides_option,
            click.option(
                "--accuracy",
                type=Accuracy(),
                default=accuracy,
                metavar="TOL",
                show_default=True,
                help=f"Relative error of {meaning}; replaces the tolerances of the file.",
            ),
            click.option(
                "--no-lubrication", is_flag=True, help="Leave out the near-field interactions of pairs."
            ),
            click.option(
                "--far-field",
                type=click.Choice(["ewald", "self", "identity"]),
                help=f"Far-field hydrodynamics. [default: {far_field}]",
            ),
        ):
            command = option(command)
        return command

    return decorate
