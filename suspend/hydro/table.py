"""Table of near-field two-sphere resistance functions: loading and evaluation at a gap.

    f(xi) = g1/xi + g2 ln(1/xi) + smooth(t),   t = ln xi,   xi = r/a - 2

in units 6 pi eta a^n (n = 1, 2, 3), the smooth part a quintic spline with uniform knots in t. Function order:
XA11 XA12 YA11 YA12 YB11 YB12 XC11 XC12 YC11 YC12 XG11 XG12 YG11 YG12 YH11 YH12 XM11 XM12 YM11 YM12 ZM11 ZM12,
then two zeros. `suspend.hydro.two_sphere` makes the file and says what the functions are.
"""

from __future__ import annotations

import functools
import math
import zipfile
from importlib import resources
from pathlib import Path
from typing import NamedTuple

import numpy as np

from suspend.core.jit import scalar
from suspend.errors import NumericalError, StorageError

VERSION = 1  # of the layout this module reads
WIDTH = 24  # functions, padded from 22


class ResistanceTable(NamedTuple):
    """Near-field functions: (ln xi - t0) inv_dt = k + u selects sum_d coefficients[k, d] u^d."""

    t0: float
    inv_dt: float
    coefficients: np.ndarray  # (intervals, degree + 1, 24)
    g1: np.ndarray  # (24,)
    g2: np.ndarray  # (24,)


def read_table(path: Path) -> ResistanceTable:
    """Read a table file; StorageError if it is missing, damaged or of another version."""
    try:
        with np.load(path) as file:
            data = {name: file[name] for name in ("version", "t0", "dt", "coefficients", "g1", "g2")}
    except (OSError, ValueError, KeyError, EOFError, zipfile.BadZipFile) as error:
        raise StorageError(
            f"cannot read the two-sphere table {path}: {error}; "
            f"make it again with `python -m suspend.hydro.two_sphere --output {path}`"
        ) from error
    if int(data["version"]) != VERSION:
        raise StorageError(
            f"two-sphere table {path} has version {int(data['version'])}, this program reads {VERSION}; "
            f"make it again with `python -m suspend.hydro.two_sphere --output {path}`"
        )
    arrays = [np.ascontiguousarray(data[name], dtype=np.float64) for name in ("coefficients", "g1", "g2")]
    for array in arrays:
        array.flags.writeable = False
    return ResistanceTable(float(data["t0"]), 1.0 / float(data["dt"]), *arrays)


@functools.cache
def load_table() -> ResistanceTable:
    """The table that comes with the package (read once)."""
    with resources.as_file(resources.files("suspend.data") / "two_sphere_table.npz") as path:
        return read_table(path)


def largest_gap(table: ResistanceTable) -> float:
    """Largest gap xi (radii) the table covers; any smaller positive gap is covered too."""
    return math.exp(table.t0 + len(table.coefficients) / table.inv_dt)


@scalar
def evaluate(table, xi, out):
    """Near-field functions at gap xi (radii) into out[0:24]; NaN outside 0 < xi <= `largest_gap`.

    Below the first knot (1e-10) the smooth part keeps its value: it has reached its limit at contact there.
    """
    intervals, powers, width = table.coefficients.shape
    t = math.log(xi) if xi > 0.0 else math.nan
    x = max((t - table.t0) * table.inv_dt, 0.0) if xi > 0.0 else math.nan
    if not x <= intervals * (1.0 + 1e-14):  # the end itself may be a rounding error outside
        out[:width] = math.nan
        return
    k = min(int(x), intervals - 1)
    u = x - k
    for f in range(width):
        out[f] = table.coefficients[k, powers - 1, f]
    for d in range(powers - 2, -1, -1):
        for f in range(width):
            out[f] = out[f] * u + table.coefficients[k, d, f]
    inverse = 1.0 / xi
    for f in range(width):
        out[f] += table.g1[f] * inverse - table.g2[f] * t


def values(table: ResistanceTable, xi: float) -> np.ndarray:
    """Near-field functions (24,) at one gap xi (radii), for instance at a cutoff to shift by.

    Raises NumericalError outside 0 < xi <= `largest_gap(table)`.
    """
    if not 0.0 < xi <= largest_gap(table) * (1.0 + 1e-12):
        raise NumericalError(
            f"two-sphere table: gap {xi!r} radii is outside 0 < gap <= {largest_gap(table):.6g}; "
            "use a cutoff inside the table or generate a longer one"
        )
    out = np.empty(table.coefficients.shape[2])
    evaluate(table, xi, out)
    return out
