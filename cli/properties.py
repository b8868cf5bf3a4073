"""The command `suspend properties`: parsing, calling, printing."""

from __future__ import annotations

from pathlib import Path

import click

from suspend_cli.options import Place, method_options, quiet_option, threads_option, use_threads

EPILOG = """
\b
Examples:
  suspend properties --phi 0.4
  suspend properties --phi 0.3 --number 1000 --configurations 10 --seed 7
  suspend properties scene.npz --json | jq .properties.D_s
  suspend properties config.yaml --far-field ewald --output properties.csv

\b
Without a file: random packings of hard spheres, an equilibrium fluid up to phi = 0.494.
With a configuration (YAML) the packings or the positions it asks for; with a file of
positions (.npz, .gsd, .xyz, .h5, the folder of a run) that one configuration.
"""

FORMATS = (".json", ".csv")


class Result(click.ParamType):
    """File to write; its suffix is the format."""

    name = "file"

    def convert(self, value, param, ctx):
        """The path as text."""
        if Path(value).suffix.lower() not in FORMATS:
            self.fail(f"found {value!r}; must end in {', '.join(FORMATS)}", param, ctx)
        return value


@click.command(epilog=EPILOG)
@click.argument("scene", type=Place(), required=False)
@click.option(
    "--phi",
    "volume_fraction",
    type=click.FloatRange(min=0.0, min_open=True, max=0.6),
    metavar="PHI",
    help="Volume fraction of random packings.",
)
@click.option("--number", type=click.IntRange(min=1), metavar="N", help="Spheres of random packings. [default: 500]")
@click.option(
    "--configurations",
    type=click.IntRange(min=1),
    metavar="M",
    help="Independent packings; their scatter is the error bar. [default: 4]",
)
@click.option(
    "--probes",
    type=click.IntRange(min=2),
    default=8,
    metavar="P",
    show_default=True,
    help="Random loads a configuration for D_s and D_r (up to 8 spheres: exact).",
)
@click.option(
    "--seed", type=click.IntRange(min=0), metavar="S", help="Of packings and random loads. [default: the file's, or 1]"
)
@method_options(1e-3, "each solve", "that of the YAML file; ewald otherwise")
@click.option("-o", "--output", type=Result(), metavar="FILE", help="Write the table (.csv) or everything (.json).")
@threads_option
@click.option("--json", "as_json", is_flag=True, help="Print everything as JSON.")
@quiet_option
def properties(scene, output, as_json, quiet, **how) -> None:
    """Short-time properties: viscosity, self-diffusion, sedimentation.

    High-frequency viscosity, short-time self-diffusion (translation and rotation) and sedimentation velocity of
    SCENE or of random packings, with error bars, finite-size correction and the literature's values.
    """
    if how["threads"] is not None:
        use_threads(how["threads"])
    result, source = _compute(scene, quiet, **how)
    if output is not None:
        _write(result, Path(output))
        if not quiet:
            click.echo(f"properties written to {output}", err=True)
    if as_json:
        from suspend_cli.report import to_json

        click.echo(to_json(result.as_dict()))
    elif not quiet:
        from suspend.short_time.report import lines

        click.echo("\n".join(lines(result, source)))


def _compute(scene, quiet, *, probes, no_lubrication, threads, **chosen):
    from suspend.short_time import short_time_properties
    from suspend.short_time.sources import Request, read_ensemble
    from suspend_cli.options import cores

    chosen["overrides"] = tuple(chosen["overrides"])
    ensemble = read_ensemble(Request(scene, lubrication=not no_lubrication, threads=threads or cores(), **chosen))

    def progress(done: int) -> None:
        if not quiet and ensemble.configurations > 1:
            click.echo(f"configuration {done} of {ensemble.configurations}", err=True)

    result = short_time_properties(ensemble.scenes, ensemble.method, probes, ensemble.seed, progress)
    return result, ensemble.source


def _write(result, path: Path) -> None:
    from suspend.short_time.report import to_csv
    from suspend_cli.report import to_json, write_text

    text = to_csv(result) if path.suffix.lower() == ".csv" else to_json(result.as_dict()) + "\n"
    write_text(path, text, force=True)
