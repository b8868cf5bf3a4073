"""The command `suspend export`: parsing, calling, printing."""

from __future__ import annotations

import re

import click

from suspend_cli.options import Place

EPILOG = """
\b
Examples:
  suspend export runs/demo -o demo.gsd                  every frame, for OVITO, freud, HOOMD-blue
  suspend export runs/demo -o demo.xyz --phase 0        extended XYZ, once a cycle
  suspend export runs/demo -o end.gsd --frames -1       the last frame
  suspend export runs/demo -o demo.h5md                 for MDAnalysis, with the topology of
  suspend export runs/demo -o top.xyz --frames 0          Universe("top.xyz", "demo.h5md")
  suspend export runs/demo -o moduli.csv                moduli of every cycle
  suspend export runs/demo -o stress.csv --table samples
  suspend export runs/demo -o run.nc --frames ::10      netCDF for xarray

\b
Frames are counted from 0, negative ones from the end: a number, numbers with commas, or START:STOP:STEP.
netCDF needs `pip install xarray h5netcdf`.

\b
MDAnalysis opens neither trajectory.h5 (its suffix and its units are none it knows) nor, rightly, .gsd:
it takes the tilt of the cell for an angle. Its .h5md labels lengths Angstrom and times ps, for it asks for
units; the numbers are those of the configuration.
"""
SLICE = re.compile(r"(-?\d+)?:(-?\d+)?(?::(-?\d+)?)?")


class Frames(click.ParamType):
    """Numbers with commas, or START:STOP:STEP."""

    name = "frames"

    def convert(self, value, param, ctx):
        """A slice or a tuple of integers."""
        if isinstance(value, slice | tuple):
            return value
        match = SLICE.fullmatch(value.strip())
        try:
            if match:
                if match.group(3) == "0":
                    raise ValueError("step 0")
                return slice(*(int(part) if part else None for part in match.groups()))
            return tuple(int(word) for word in value.split(","))
        except ValueError:
            self.fail(f"found {value!r}; must be numbers such as -1 or 0,10,20, or START:STOP:STEP", param, ctx)


@click.command(epilog=EPILOG)
@click.argument("run", type=Place())
@click.option(
    "-o",
    "--output",
    required=True,
    type=Place(),
    metavar="FILE",
    help="File to write (.gsd, .xyz, .extxyz, .h5md, .csv, .json, .nc).",
)
@click.option("--frames", type=Frames(), metavar="FRAMES", help="Frames of positions. [default: all; .nc: none]")
@click.option(
    "--phase", type=click.FloatRange(0.0, 1.0, max_open=True), metavar="P", help="Only frames at this phase [cycles]."
)
@click.option(
    "--table",
    type=click.Choice(["cycles", "samples"]),
    default="cycles",
    show_default=True,
    help="What .csv and .json hold: moduli of every cycle, or the time series.",
)
@click.option("-q", "--quiet", is_flag=True, help="Print errors only.")
def export(run, output, frames, phase, table, quiet) -> None:
    """Write a run in a format of other tools.

    RUN is the folder of a run (which may still be going on) or its trajectory.h5. The suffix of FILE is the format;
    the whole file is written, or none. Units are those of the configuration.
    """
    from suspend.export import export as write

    notes = write(run, output, frames=frames, phase=phase, table=table)
    if not quiet:
        for note in notes:
            click.echo(f"note: {note}", err=True)
        click.echo(f"{output} written", err=True)
