"""The command `suspend sweep`: a family of runs from one file, called as often as it takes."""

from __future__ import annotations

import contextlib
import sys
from pathlib import Path

import click

from suspend_cli.options import DurationType, Place, quiet_option

EPILOG = """
\b
Examples:
  suspend sweep configs/phase_diagram.yaml --dry-run        the points, with time and memory of each
  suspend sweep configs/phase_diagram.yaml                  run what is missing
  suspend sweep configs/phase_diagram.yaml --max-time 50m   the same, for cron: go on where the last call stopped
  suspend sweep configs/phase_diagram.yaml --scheduler tcp://HOST:8786   on the workers of a Dask cluster
  suspend sweep configs/phase_diagram.yaml --emit slurm-array > job.sh && sbatch job.sh
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
  workers: 2                          processes on this machine [default: all cores]
  retries: 2                          of a point that fails, over all calls
  memory: 8 GB                        for all runs together, on this machine [default: what is free]
  adaptive:                           amplitudes are added where gamma_c is, group by group
    width: 0.05                       of its bound, relative [default]
    points: 12                        added at most, each with all seeds [default]
    signatures: [D_cyc, eta_r_prime]  [default: these, minus_eta3_over_eta1, minus_N2_nu0, nu4_over_nu2]
    key: flow.amplitude               refined [default]
  cluster:                            computed by jobs of a batch system, unless --local or --scheduler is given
    kind: slurm                       slurm, pbs or sge
    workers: 64                       points at a time
    cores: 8                          of a job, a point each [default: 1]
    memory: 16 GB                     of a job [default: 2 GB a core]; for sge name its resource in directives, too
    walltime: 12:00:00                of a job [default: 4 h]; interrupted points go on in another
    queue: normal                     or partition [default: the site's]
    account: physics
    directives: ["--constraint=x"]    for the head of the job script
    prologue: ["module load x"]       lines of shell before the work
    interface: ib0                    network between jobs and this machine [default: the site's]

\b
On other machines (pip install 'suspend[cluster]'; all must see the same folder):
  suspend sweep FILE --scheduler tcp://HOST:8786    on the workers of a running Dask scheduler
  suspend sweep FILE                                with a section cluster: on jobs made for it, given back at the end
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
@click.option(
    "--scheduler", metavar="ADDRESS",
    help="Compute on the workers of this Dask scheduler: tcp://HOST:8786 or a scheduler file.",
)
@click.option("--local", is_flag=True, help="Compute here, though the file has a section `cluster`.")
@click.option("--max-time", type=DurationType(), metavar="T", help="Stop all with checkpoints after T: 50m, 01:30:00.")
@click.option("--retry-failed", is_flag=True, help="Try points again that failed for good.")
@click.option("--dry-run", is_flag=True, help="Print the points, their predicted time and memory. Run nothing.")
@click.option(
    "--point", metavar="K", help="Compute one point, by its number in --dry-run or its name; others may run beside it."
)
@click.option(
    "--emit", type=click.Choice(["slurm-array"]), help="Print a script for sbatch, one job a point. Run nothing."
)
@click.option("--script", type=Place(), metavar="FILE", help="Where --emit writes. [default: stdout]")
@quiet_option
def run_sweep(file, output, dry_run, **how) -> None:
    """Compute what is missing of the sweep in FILE.

    Complete points are skipped, interrupted ones go on, failed ones are tried again; nothing is printed where there is
    nothing to do. Every point has a folder with its run and its log (suspend.log).
    """
    from suspend.sweep.run import prepare

    _check_options(dry_run, how)
    call = prepare(file, output)
    if dry_run:
        from suspend.sweep.adaptive import group_lines
        from suspend.sweep.overview import overview

        click.echo("\n".join([*overview(call, how["workers"], _section(call, how)), *group_lines(call)]))
    elif how["emit"]:
        _emit(call, file, how["script"], how["quiet"])
    elif how["point"] is not None:
        _run_point(call, how)
    else:
        _run_all(call, file, how)


def _check_options(dry_run: bool, how: dict) -> None:
    """Refuse options that contradict each other."""
    given = [f"--{name}" for name in ("point", "emit", "scheduler") if how[name] is not None]
    given += ["--dry-run"] * dry_run
    if len(given) > 1:
        raise click.UsageError(f"{given[0]} and {given[1]} do not go together: give one of them")
    if how["scheduler"] is not None and (how["local"] or how["workers"] is not None):
        other = "--local" if how["local"] else "--workers"
        raise click.UsageError(f"--scheduler computes on its own workers, {other} on this machine: give one of them")
    if how["script"] is not None and how["emit"] is None:
        raise click.UsageError("--script FILE says where --emit writes: give --emit slurm-array, too")
    if how["point"] is not None and how["workers"] is not None:
        raise click.UsageError("--point computes one point in one process: leave out --workers")


def _emit(call, file, script, quiet: bool) -> None:
    from suspend.io.files import replace_text, storage_errors
    from suspend.sweep.adaptive import refine_now
    from suspend.sweep.slurm_array import slurm_array

    refine_now(call, lambda text: None if quiet else click.echo(text, err=True))
    if not call.left:
        if not quiet:
            click.echo(f"{file}: all {len(call.points)} points are complete, there is nothing to submit", err=True)
        return
    text, notes = slurm_array(call, file)
    if script in (None, "-"):
        click.echo(text, nl=False)
    else:
        with storage_errors("write", script):
            replace_text(Path(script), text)
        notes.append(f"{len(call.left)} points: sbatch {script}")
    if not quiet:
        for note in notes:
            click.echo(note, err=True)


def _run_point(call, how: dict) -> None:
    from suspend.sweep.run import compute_one
    from suspend_cli.sweep_progress import SweepProgress

    with SweepProgress(quiet=how["quiet"]) as progress:
        compute_one(call, how["point"], how["retry_failed"], how["max_time"], progress.event)


def _run_all(call, file, how: dict) -> None:
    from suspend.sweep.adaptive import refinable
    from suspend.sweep.run import is_due

    if not (call.changed or refinable(call) or is_due(call, how["retry_failed"])):
        return
    with _crew(call, how) as crew:
        _run_locked(call, file, how, crew)


def _crew(call, how: dict):
    """Who computes beyond this machine, connected before anything is written; None: nobody."""
    from suspend.sweep.adaptive import refinable

    section = _section(call, how)
    if not (call.left or refinable(call)) or (how["scheduler"] is None and section is None):
        return contextlib.nullcontext()
    from suspend.sweep.crew import Crew

    return Crew(how["scheduler"], section)


def _section(call, how: dict):
    """The section `cluster`, where it is to be used."""
    section = None if how["local"] or how["scheduler"] is not None else call.sweep.cluster
    if section is not None and how["workers"] is not None:
        raise click.UsageError(
            "the section cluster of the file says how many points are computed at a time: give --local to compute on "
            "this machine with --workers, or leave out --workers"
        )
    return section


def _run_locked(call, file, how: dict, crew) -> None:
    from suspend.errors import Interrupted
    from suspend.io.files import InUseError
    from suspend.sweep.adaptive import rounds
    from suspend.sweep.run import open_call

    quiet = how["quiet"]
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
        open_call(call, how["retry_failed"])
        rounds(
            call,
            lambda left: _compute_all(call, file, how | {"max_time": left}, crew),
            how["max_time"],
            lambda text: None if quiet else click.echo(text, err=True),
        )
    finally:
        lock.release()


def _compute_all(call, file, how: dict, crew) -> None:
    from suspend.sweep.run import compute
    from suspend_cli.sweep_progress import SweepProgress

    with SweepProgress(quiet=how["quiet"]) as progress:
        counts = f"{len(call.points)} points, {call.done} complete, {len(call.left)} to do"
        progress.message(f"{file} -> {call.folder.path}: {counts}")
        if crew is None:
            compute(call, how["workers"], how["max_time"], progress.event, progress.report)
        else:
            crew.compute(call, how["max_time"], progress.event, progress.report, progress.message)


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
