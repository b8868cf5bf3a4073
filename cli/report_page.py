"""The command `suspend report`: parsing, calling, printing."""

from __future__ import annotations

import click

from suspend_cli.options import Place

EPILOG = """
\b
Examples:
  suspend report runs/demo -o report.html
  suspend report runs/gamma* -o sweep.html --title "phi = 0.4"

\b
The page needs no other file and no network. Runs that cannot be read are listed on it.
"""


@click.command(epilog=EPILOG)
@click.argument("runs", nargs=-1, required=True, type=Place())
@click.option(
    "-o", "--output", default="report.html", show_default=True, type=Place(), metavar="FILE", help="Page to write."
)
@click.option("--last", type=click.IntRange(min=1), metavar="N", help="Average over the last N cycles.")
@click.option("--title", metavar="TEXT", help="Title of the page.")
@click.option("-q", "--quiet", is_flag=True, help="Print errors only.")
def report(runs, output, last, title, quiet) -> None:
    """One page about one run or many: results, errors, figures, cost, warnings.

    RUNS are folders of runs, which may still be going on, or their trajectory files.
    """
    from suspend.report import write_report

    notes = write_report(runs, output, last=last, title=title)
    for note in notes:
        click.echo(f"warning: {note}", err=True)
    if not quiet:
        click.echo(f"{output} written", err=True)
