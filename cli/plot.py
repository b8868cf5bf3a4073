"""The command `suspend plot`: figures by name."""

from __future__ import annotations

import click

from suspend_cli.options import Place

EPILOG = """
\b
Examples:
  suspend plot --list
  suspend plot viscosity runs/phi0.4_* -o figures/
  suspend plot dynamics runs/phase_diagram -o figures/    the complete points of a sweep
  suspend plot viscosity-evolution runs/demo --format pdf --no-csv
  suspend plot snapshot runs/demo --cycle 0 --colour displacement
  suspend plot animation runs/demo -o cycle.gif

\b
RUNS are folders of runs, folders that hold folders of runs, or sweeps (their folders or files).
Figures of the paper go by name or number (viscosity, 2, 2b). The CSV behind each panel is written
beside the picture. Points against amplitude are means over the seeds with their standard error, of
one seed with that of its last cycles; the CSV says which.
"""

NOTES = 6  # printed at most


def _list(context: click.Context, _, wanted: bool) -> None:
    """Print the names and leave."""
    if not wanted or context.resilient_parsing:
        return
    from suspend.figures.registry import FIGURES

    width = max(len(kind.name) for kind in FIGURES)
    for kind in FIGURES:
        where = f"fig. {kind.number}" if kind.number else ""
        click.echo(f"{kind.name.ljust(width)}  {where.ljust(7)}  {kind.meaning}")
    context.exit()


class FigureName(click.ParamType):
    """Name of a figure; the shell completes it, the figures check it."""

    name = "figure"

    def shell_complete(self, ctx, param, incomplete):
        """Names that begin with what is typed."""
        from click.shell_completion import CompletionItem

        from suspend.figures.registry import FIGURES

        return [CompletionItem(k.name, help=k.meaning) for k in FIGURES if k.name.startswith(incomplete)]


@click.command(epilog=EPILOG)
@click.argument("figure", type=FigureName())
@click.argument("runs", nargs=-1, required=True, type=Place())
@click.option(
    "--list",
    is_flag=True,
    is_eager=True,
    expose_value=False,
    callback=_list,
    help="Print the names of the figures.",
)
@click.option(
    "-o",
    "--output",
    type=Place(),
    metavar="PATH",
    help="File (.png, .pdf, .gif, .mp4), or folder. [default: FIGURE here]",
)
@click.option(
    "--format",
    "kind",
    type=click.Choice(["png", "pdf", "both", "gif", "mp4"]),
    help="Format of the picture. [default: both, or that of PATH]",
)
@click.option("--csv/--no-csv", "with_csv", default=True, help="Write the CSV behind each panel. [default: --csv]")
@click.option(
    "--last",
    type=click.IntRange(min=1),
    metavar="N",
    help="Steady-state values: average over the last N cycles.",
)
@click.option("--cycle", type=int, metavar="K", help="Snapshot, animation: the cycle, from 0. [default: last]")
@click.option(
    "--phase",
    type=click.FloatRange(0.0, 1.0, max_open=True),
    metavar="P",
    help="Snapshot: only the frame at this fraction of the cycle.",
)
@click.option(
    "--colour",
    "--color",
    "colour",
    metavar="SCALAR",
    help="Snapshot, animation: stress (xy), stress-xx, n1, n2, pressure, displacement, none, or a "
    "stored series. [default: stress]",
)
def plot(figure, runs, output, kind, with_csv, **options) -> None:
    """Draw FIGURE from RUNS, with the CSV behind it.

    `suspend plot --list` prints the names.
    """
    from suspend.figures.make import make_figure
    from suspend_cli.options import runs_of

    runs, _ = runs_of(runs)
    formats = None if kind is None else ["png", "pdf"] if kind == "both" else [kind]
    drawn = make_figure(figure, runs, output, formats, with_csv=with_csv, **options)
    for note in drawn.notes[:NOTES]:
        click.echo(f"Note: {note}", err=True)
    if len(drawn.notes) > NOTES:
        click.echo(f"Note: {len(drawn.notes) - NOTES} more of these", err=True)
    for path in drawn.paths:
        click.echo(str(path))
