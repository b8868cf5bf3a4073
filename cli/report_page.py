"""The command `suspend report`: parsing, calling, printing."""

from __future__ import annotations

import click

from suspend_cli.options import Place

EPILOG = """
\b
Examples:
  suspend report runs/demo -o report.html
  suspend report runs/gamma* -o runs.html --title "phi = 0.4"
  suspend report runs/phase_diagram -o runs/phase_diagram/index.html

\b
The page needs no other file and no network. Runs that cannot be read are listed on it. That of a
sweep links to the folders of its points, relative to where it lies, so it is best put into the sweep's
folder; the sweep may be running. A crontab line that publishes it each night at half past six:
  30 6 * * * cd ~/suspend && .venv/bin/suspend report runs/phase_diagram -o runs/phase_diagram/index.html -q
"""


@click.command(epilog=EPILOG)
@click.argument("runs", nargs=-1, required=True, type=Place())
@click.option(
    "-o", "--output", default="report.html", show_default=True, type=Place(), metavar="FILE", help="Page to write."
)
@click.option("--last", type=click.IntRange(min=1), metavar="N", help="Average over the last N cycles.")
@click.option("--title", metavar="TEXT", help="Title of the page.")
@click.option(
    "--each", is_flag=True, help="Sweeps: also write report.html into the folder of each complete point that lacks it."
)
@click.option("-q", "--quiet", is_flag=True, help="Print errors only.")
def report(runs, output, last, title, each, quiet) -> None:
    """One page about one run or many, or about a sweep: results, errors, figures, cost, warnings.

    RUNS are folders of runs, which may still be going on, or their trajectory files; or sweeps, by their folders or
    files: states, failures, all points with links, figures against amplitude over all seeds, the phase diagram.
    """
    from suspend.sweep.runs import is_sweep

    sweeps = [is_sweep(path) for path in runs]
    if any(sweeps) and not all(sweeps):
        raise click.UsageError(
            f"{runs[sweeps.index(True)]} is a sweep, {runs[sweeps.index(False)]} is none: they go on different pages"
        )
    if each and not any(sweeps):
        raise click.UsageError("--each is for sweeps: give the folder of one, or its file")
    if any(sweeps):
        from suspend.sweep.page import write_sweep_page

        notes = write_sweep_page(runs, output, last=last, title=title, each=each)
        notes = [] if quiet else notes  # they are on the page
    else:
        from suspend.report import write_report

        notes = write_report(runs, output, last=last, title=title)
    for note in notes:
        click.echo(f"warning: {note}", err=True)
    if not quiet:
        click.echo(f"{output} written", err=True)
