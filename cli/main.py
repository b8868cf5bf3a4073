"""Commands of `suspend`: parsing, calling, printing. The physics is imported inside the commands."""

from __future__ import annotations

from pathlib import Path

import click

import suspend
from suspend_cli.errors import guarded
from suspend_cli.export import export
from suspend_cli.options import DurationType, Figure, OverrideType, Place, Threads, check_environment, use_threads
from suspend_cli.plot import plot
from suspend_cli.properties import properties
from suspend_cli.report_page import report
from suspend_cli.solve import solve
from suspend_cli.sweep import sweep

EPILOG = """
\b
Examples:
  suspend init config.yaml             write a commented configuration
  suspend run config.yaml              run it, or continue it where it stopped
  suspend analyze runs/config          moduli of every cycle
  suspend plot viscosity runs/*        figures by name
  suspend sweep sweep.yaml             a family of runs, as often called as it takes
  suspend solve scene.npz              velocities of one configuration
  suspend properties --phi 0.4         viscosity, diffusion, sedimentation of packings

\b
Exit codes: 0 done, 2 configuration or command line, 3 numerical, 4 files or disk,
130 interrupted (a checkpoint is written). Results go to stdout, all else to stderr.

\b
Shells have a builtin of the same name, which comes first. Switch it off, once:
  bash   enable -n suspend          in ~/.bashrc, and at the top of bash scripts
  zsh    disable suspend            in ~/.zshrc, and at the top of zsh scripts
  fish   functions --erase suspend  in ~/.config/fish/config.fish
Without it, `env suspend run config.yaml` or `python -m suspend_cli run config.yaml`.

\b
Completion in the shell, after that line:
  bash   eval "$(_SUSPEND_COMPLETE=bash_source suspend)"
  zsh    eval "$(_SUSPEND_COMPLETE=zsh_source suspend)"
  fish   _SUSPEND_COMPLETE=fish_source suspend | source
"""

RUN_EPILOG = """
\b
Examples:
  suspend run configs/demo.yaml
  suspend run configs/paper.yaml --set flow.amplitude=0.4 --output runs/gamma0.4
  suspend run configs/paper.yaml --dry-run
  suspend run configs/paper.yaml --max-time 2h    the same command again continues

\b
The same command again continues an unfinished run to a bit-identical result. A finished run
is left as it is, unless its duration was extended: suspend run CONFIG --set duration.cycles=100
--set duration.until_steady=0.02 ends it early, once its steady state is established
"""

ANALYZE_EPILOG = """
\b
Examples:
  suspend analyze runs/demo
  suspend analyze runs/demo --csv moduli.csv --plot moduli.pdf
  suspend analyze runs/demo --json | jq .averages
  suspend analyze runs/demo --dynamics --structure
  suspend analyze runs/phi0.4_*                   many runs: values against amplitude, gamma_c
  suspend analyze runs/phi* --csv runs.csv        one row a run
  suspend analyze runs/phase_diagram              the complete points of a sweep
"""

SETTINGS = {"help_option_names": ["-h", "--help"], "max_content_width": 120}


@click.group(context_settings=SETTINGS, epilog=EPILOG)
@click.version_option(suspend.__version__, prog_name="suspend", message="%(prog)s %(version)s")
def cli() -> None:
    """Dense suspensions of spheres under oscillatory shear: simulate, analyse."""
    check_environment()


@cli.command(epilog=RUN_EPILOG)
@click.argument("config", type=Place())
@click.option(
    "-o",
    "--output",
    type=Place(),
    metavar="DIR",
    help="Folder of the run. [default: runs/NAME of NAME.yaml]",
)
@click.option("--resume", is_flag=True, help="Continue only: an error if there is no run in the folder yet.")
@click.option(
    "--set",
    "overrides",
    type=OverrideType(),
    multiple=True,
    metavar="KEY=VALUE",
    help="Override a key, such as flow.amplitude=0.4. May be repeated.",
)
@click.option(
    "--dry-run", is_flag=True, help="Print the plan: what is on or off and why, memory, time. Run nothing."
)
@click.option("--threads", type=Threads(), metavar="N", help="Threads to compute with. [default: all cores]")
@click.option(
    "--max-time",
    type=DurationType(),
    metavar="T",
    help="Stop with a checkpoint after this wall time: 90, 90s, 10m, 2h, 1h30m, 01:30:00.",
)
@click.option("--json", "as_json", is_flag=True, help="Print the closing figures (or the plan) as JSON.")
@click.option("-q", "--quiet", is_flag=True, help="Print errors only.")
def run(config, output, overrides, dry_run, as_json, **how) -> None:
    """Run a simulation, or continue it.

    CONFIG is the YAML file that describes it; configs/reference.yaml explains every key.
    """
    from suspend.config import load

    configuration = load(config, overrides)
    directory = Path(output) if output is not None else Path("runs") / Path(config).stem
    if how["threads"] is not None:
        use_threads(how["threads"])
    if dry_run:
        from suspend.simulation import make_plan

        _print_result(make_plan(configuration), as_json)
        return
    summary = _simulate(configuration, directory, config, **how)
    if as_json or not how["quiet"]:
        _print_result(summary, as_json)


def _simulate(configuration, directory, source, *, resume, threads, max_time, quiet):
    from suspend_cli.progress import Progress

    progress = Progress(quiet=quiet)
    # Before the import: it takes a second.
    progress.message(f"suspend {suspend.__version__}: {source} -> {directory}")
    from suspend.simulation import run as simulate

    with progress:
        return simulate(
            configuration,
            directory,
            resume=True if resume else None,
            threads=threads,
            max_time=max_time,
            progress=None if quiet else progress.update,
            message=progress.message,
        )


def _print_result(result, as_json: bool) -> None:
    if as_json:
        from suspend_cli.report import to_json

        click.echo(to_json(result.as_dict()))
        return
    for line in result.lines():
        click.echo(line)


@cli.command(epilog=ANALYZE_EPILOG)
@click.argument("paths", metavar="RUN...", nargs=-1, required=True, type=Place())
@click.option("--json", "as_json", is_flag=True, help="Print JSON instead of tables.")
@click.option("--csv", "csv_path", type=Place(), metavar="FILE", help="Write the columns to a CSV file.")
@click.option(
    "--plot",
    "plot_path",
    type=Figure(),
    metavar="FILE",
    help="Draw Lissajous curves and the evolution over cycles (.png, .pdf).",
)
@click.option("--last", type=click.IntRange(min=1), metavar="N", help="Average over the last N cycles.")
@click.option("--dynamics", is_flag=True, help="One run: displacements, active fraction, decay of D_cyc.")
@click.option("--structure", is_flag=True, help="One run: g(r), clusters, density fluctuations, order, contacts.")
def analyze(paths, as_json, csv_path, plot_path, last, dynamics, structure) -> None:
    """Print the moduli, normal stresses and diffusivity of every cycle.

    RUN is the folder of a run, which may still be going on. Of several runs, or a folder that holds them, or a sweep
    (its folder or its file): values of the last cycles against amplitude for each volume fraction, with the scatter
    over seeds, the four signatures of the transition, gamma_c.
    """
    from suspend.analysis.run_paths import find_runs
    from suspend_cli.options import runs_of

    paths, sweeps = runs_of(paths)
    runs = find_runs(paths)
    if len(runs) > 1 or sweeps:
        if plot_path is not None:
            raise click.UsageError("--plot draws one run; `suspend plot` draws several")
        if dynamics or structure:
            raise click.UsageError("--dynamics and --structure are of one run")
        _analyze_many(runs, as_json, csv_path, last, sweeps)
        return
    path = runs[0]
    from suspend.analysis.summary import analyze as analyze_run

    analysis = analyze_run(path, last=last)
    if csv_path is not None:
        analysis.write_csv(csv_path)
        click.echo(f"columns written to {csv_path}", err=True)
    if plot_path is not None:
        from suspend.plots import plot_first_figure

        plot_first_figure(analysis, plot_path)
        click.echo(f"figure written to {plot_path}", err=True)
    sections = _sections(path, dynamics, structure)
    if as_json:
        from suspend_cli.report import to_json

        click.echo(to_json(analysis.as_dict() | sections))
        return
    click.echo(analysis.table().rstrip("\n"))
    if sections:
        from suspend.analysis.sections import format_section

        for section in sections.values():
            click.echo("\n" + format_section(section))


def _sections(path, dynamics: bool, structure: bool) -> dict:
    """Further sections of the analysis, by name."""
    sections = {}
    if dynamics or structure:
        from suspend.analysis.sections import dynamics_section, structure_section

        if dynamics:
            sections["dynamics"] = dynamics_section(path)
        if structure:
            sections["structure"] = structure_section(path)
    return sections


def _analyze_many(paths, as_json, csv_path, last, sweeps) -> None:
    from suspend.analysis.collection import Collection
    from suspend.analysis.collection_text import format_collection
    from suspend.analysis.phase_diagram import PhaseDiagram

    collection = Collection(last=last).compute(paths)
    diagram = PhaseDiagram().compute(collection)
    if csv_path is not None:
        collection.write_csv(csv_path)
        click.echo(f"one row a run written to {csv_path}", err=True)
    if as_json:
        from suspend_cli.report import to_json

        counts = {"sweeps": {sweep["sweep"]: sweep["counts"] for sweep in sweeps}} if sweeps else {}
        click.echo(to_json({"collection": collection.summary(), "phase_diagram": diagram.summary()} | counts))
    else:
        click.echo(format_collection(collection, diagram))


@cli.command(
    epilog="\b\nExamples:\n  suspend info runs/demo\n  suspend info runs/demo --json | jq .statistics"
)
@click.argument("path", metavar="RUN", type=Place())
@click.option("--json", "as_json", is_flag=True, help="Print JSON, the whole configuration included.")
def info(path, as_json) -> None:
    """Say how far a run is, how it was made and what it cost.

    RUN is the folder of a run.
    """
    from suspend.io import describe
    from suspend_cli.report import description, information, to_json

    content = information(describe(path))
    click.echo(to_json(content) if as_json else "\n".join(description(content)))


@cli.command(
    epilog="\b\nExamples:\n  suspend init                 write config.yaml\n"
    "  suspend init runs/a.yaml --force\n  suspend init - | less        print it"
)
@click.argument("file", default="config.yaml", type=Place())
@click.option("--force", is_flag=True, help="Overwrite the file if it exists.")
def init(file, force) -> None:
    """Write a commented configuration to start from.

    FILE is config.yaml if not given, - for stdout. It holds every key with its unit, default and meaning.
    """
    from suspend.config.reference import starting_point

    if file == "-":
        click.echo(starting_point(), nl=False)
        return
    from suspend_cli.report import write_text

    write_text(Path(file), starting_point(), force)
    click.echo(f"{file} written; next: suspend run {file}", err=True)


cli.add_command(solve)
cli.add_command(properties)
cli.add_command(export)
cli.add_command(report)
cli.add_command(plot)
cli.add_command(sweep)


def main(arguments: list[str] | None = None) -> None:
    """Entry point: run the command line and exit with its code."""
    guarded(cli, arguments)
