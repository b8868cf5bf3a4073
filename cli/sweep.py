"""The command `suspend sweep`: a family of runs from one file, called as often as it takes."""

from __future__ import annotations

import sys

import click

from suspend_cli.options import DurationType, Place, quiet_option

EPILOG = """
\b
Examples:
  suspend sweep configs/phase_diagram.yaml --dry-run        the points, with time and memory of each
  suspend sweep configs/phase_diagram.yaml                  run what is missing
  suspend sweep configs/phase_diagram.yaml --max-time 50m   the same, for cron: go on where the last call stopped
  suspend sweep status runs/phase_diagram
  suspend sweep collect runs/phase_diagram -o table.csv

\b
Options of `suspend sweep FILE`: `suspend sweep run --help`. Exit codes: 0 all points complete, 130 work is left
(call again), 3 all else complete but points failed for good, 2 the file, 4 files or disk.
"""

RUN_EPILOG = """
\b
The file (YAML):
  base: paper.yaml                    a configuration, relative to this file, or written out
  set: {duration.strain: 256}         the same for all points
  vary:                               crossed
    particles.volume_fraction: [0.3, 0.4, 0.5]
    flow.amplitude: {from: 0.1, to: 3.2, steps: 6, spacing: log}
  zip:                                go together
    - {particles.number: [500, 4000], output.samples_per_cycle: [64, 32]}
  seeds: 3                            how many, or a list
  runs:                               blocks; each takes what it does not say from above
    - {set: {far_field: self}}
    - {set: {far_field: ewald}, seeds: 1}
  workers: 2                          processes [default: all cores]
  retries: 2                          of a point that fails, over all calls
  memory: 8 GB                        for all runs together [default: what is free]
"""


SHOWN = 10  # names of folders printed at most


class SweepGroup(click.Group):
    """`suspend sweep FILE` is `suspend sweep run FILE`."""

    def parse_args(self, ctx: click.Context, args: list[str]) -> list[str]:
        """Put the name of the command in where a file or an option comes first."""
        if args and args[0] not in self.commands and args[0] not in ctx.help_option_names:
            args = ["run", *args]
        return super().parse_args(ctx, args)


@click.group(cls=SweepGroup, epilog=EPILOG, subcommand_metavar="FILE [OPTIONS] | COMMAND")
def sweep() -> None:
    """Run a family of simulations, one point after the other, as often as it takes."""


folder_option = click.option(
    "-o", "--output", type=Place(), metavar="DIR", help="Folder of the sweep. [default: runs/NAME of NAME.yaml]"
)


@sweep.command("run", epilog=RUN_EPILOG)
@click.argument("file", type=Place())
@folder_option
@click.option("--workers", type=click.IntRange(min=1), metavar="N", help="Processes at a time. [default: all cores]")
@click.option("--max-time", type=DurationType(), metavar="T", help="Stop all with checkpoints after T: 50m, 01:30:00.")
@click.option("--retry-failed", is_flag=True, help="Try points again that failed for good.")
@click.option("--dry-run", is_flag=True, help="Print the points, their predicted time and memory. Run nothing.")
@quiet_option
def run_sweep(file, output, workers, max_time, retry_failed, dry_run, quiet) -> None:
    """Compute what is missing of the sweep in FILE.

    Complete points are skipped, interrupted ones go on, failed ones are tried again; nothing is printed where there is
    nothing to do. Every point has a folder with its run and its log (suspend.log).
    """
    from suspend.errors import Interrupted
    from suspend.io.files import InUseError
    from suspend.sweep.run import compute, is_due, open_call, prepare

    call = prepare(file, output)
    if dry_run:
        from suspend.sweep.overview import overview

        click.echo("\n".join(overview(call, workers)))
        return
    if not (call.changed or is_due(call, retry_failed)):
        return
    call.folder.make()
    try:
        lock = call.folder.lock()
    except InUseError as error:
        if sys.stderr.isatty() and not quiet:
            click.echo(f"{error}", err=True)
        click.get_current_context().exit(Interrupted.exit_code)
    if lock.note and not quiet:
        click.echo(lock.note, err=True)
    try:
        call.look()
        if call.changed and call.former and not quiet:
            more = f" and {len(call.former) - SHOWN} more" if len(call.former) > SHOWN else ""
            names = ", ".join(call.former[:SHOWN]) + more
            click.echo(f"{call.folder.path}: no longer in {file}, kept but not run: {names}", err=True)
        open_call(call, retry_failed)
        if is_due(call):
            from suspend_cli.sweep_progress import SweepProgress

            with SweepProgress(quiet=quiet) as progress:
                counts = f"{len(call.points)} points, {call.done} complete, {len(call.left)} to do"
                progress.message(f"{file} -> {call.folder.path}: {counts}")
                compute(call, workers, max_time, progress.event, progress.report)
    finally:
        lock.release()


@sweep.command("status")
@click.argument("path", metavar="SWEEP", type=Place())
@folder_option
@click.option("--json", "as_json", is_flag=True, help="Print JSON.")
def status_of_sweep(path, output, as_json) -> None:
    """Say how far every point is.

    SWEEP is the folder of a sweep, or its file.
    """
    from suspend.sweep.status import status_lines, sweep_status

    found = sweep_status(path, output)
    if as_json:
        from suspend_cli.report import to_json

        click.echo(to_json(found))
        return
    click.echo("\n".join(status_lines(found)))


@sweep.command("collect")
@click.argument("path", metavar="SWEEP", type=Place())
@click.option("-o", "--output", type=Place(), metavar="FILE", help="Table: .csv or .h5. [default: CSV to stdout]")
@click.option("--last", type=click.IntRange(min=1), metavar="N", help="Average over the last N cycles.")
@quiet_option
def collect_sweep(path, output, last, quiet) -> None:
    """Write one table of all points: parameters, seed, every analysed quantity with its error, run time, state.

    SWEEP is the folder of a sweep, or its file. Points that are not complete have what there is of them.
    """
    from suspend.sweep.collect import check_format, collect, table_text, write_table

    if output not in (None, "-"):
        check_format(output)
    rows = collect(path, last, lambda text: None if quiet else click.echo(text, err=True))
    if output in (None, "-"):
        click.echo(table_text(rows), nl=False)
        return
    write_table(rows, output)
    if not quiet:
        click.echo(f"{len(rows)} points written to {output}", err=True)
