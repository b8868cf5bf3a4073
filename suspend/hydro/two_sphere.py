"""Generator of the near-field table: exact two-sphere resistance minus inverse of the pair's FTS mobility.

    python -m suspend.hydro.two_sphere --output suspend/data/two_sphere_table.npz

Exact values come from `two_sphere_series` (multipoles at gaps >= 1e-3, the expansion at contact below), the
part that a far-field mobility at the force-torque-stresslet (FTS) level holds from `two_sphere_matrices`.
Stored, in units 6 pi eta a^n with the gap xi = r - 2 in radii, is the smooth remainder of

    f(xi) = g1/xi + g2 ln(1/xi) + smooth(t),   t = ln xi,

as a quintic spline (four times differentiable) with uniform knots in t, in local powers, laid out as
`suspend.hydro.table` reads it. Measured: interpolation error 1.4e-10 max(1, |f|).
"""

from __future__ import annotations

import argparse
import math
import os
from pathlib import Path

import numpy as np
from scipy.interpolate import make_interp_spline

from suspend.errors import StorageError
from suspend.hydro.two_sphere_matrices import UNIT_FACTORS, far_field_functions
from suspend.hydro.two_sphere_series import (
    FUNCTIONS,
    TRUNCATION,
    NearContact,
    contact_coefficients,
    resistance_functions,
)

VERSION = 1  # of the table's layout
SMALLEST, LARGEST = 1e-10, 6.0  # gaps, radii
INTERVALS = 250
MARGIN = 20  # intervals beyond LARGEST, so that the end condition of the spline is not felt
WIDTH = 24  # functions, padded to a multiple of the vector length
JOIN = 1e-3  # gap below which the expansion at contact replaces the multipoles


def exact_functions(gap: float, contact: NearContact) -> np.ndarray:
    """Exact functions (22,) in hatted normalisation at any gap > 0 (radii)."""
    return contact(gap) if gap < JOIN else resistance_functions(gap)


def near_field_functions(gap: float, contact: NearContact) -> np.ndarray:
    """Near-field functions (22,) in units 6 pi eta a^n: exact minus inverse of the pair's FTS mobility."""
    return UNIT_FACTORS * exact_functions(gap, contact) - far_field_functions(gap)


def smooth_part(gap: float, contact: NearContact) -> np.ndarray:
    """Near-field functions without g1/gap + g2 ln(1/gap), (22,), free of cancellation at small gaps."""
    g1, g2, g3 = contact_coefficients()
    if gap < JOIN:
        regular = contact.regular_basis(gap) @ contact.coefficients - g3 * gap * np.log(gap)
    else:
        regular = resistance_functions(gap) - g1 / gap + g2 * np.log(gap)
    return UNIT_FACTORS * regular - far_field_functions(gap)


def build_table() -> dict[str, np.ndarray]:
    """The arrays of the table file; takes about ten seconds.

    coefficients (intervals, degree + 1, 24): smooth(t) = sum_d coefficients[k, d] u^d at t = t0 + (k + u) dt,
    0 <= u <= 1, functions in the order of `FUNCTIONS`, two zero columns last. At the lower end the first two
    derivatives are zero, so that the constant continuation below it joins twice differentiably.
    """
    contact = NearContact()
    t0 = np.log(SMALLEST)
    dt = (np.log(LARGEST) - t0) / INTERVALS
    knots = np.arange(INTERVALS + MARGIN + 1)
    values = np.array([smooth_part(gap, contact) for gap in np.exp(t0 + knots * dt)])
    zero = np.zeros(len(FUNCTIONS))
    ends = ([(1, zero), (2, zero)], [(3, zero), (4, zero)])
    spline = make_interp_spline(knots.astype(float), values, k=5, bc_type=ends)
    coefficients = np.zeros((INTERVALS, 6, WIDTH))
    for d in range(6):
        coefficients[:, d, : len(FUNCTIONS)] = spline(knots[:INTERVALS], d) / math.factorial(d)
    g = np.zeros((2, WIDTH))
    g[:, : len(FUNCTIONS)] = UNIT_FACTORS * contact_coefficients()[:2]
    return {
        "version": np.int64(VERSION),
        "t0": np.float64(t0),
        "dt": np.float64(dt),
        "coefficients": coefficients,
        "g1": g[0],
        "g2": g[1],
        "functions": np.array(FUNCTIONS),
        "truncation": np.float64(TRUNCATION),  # of the multipoles: exp(-2 truncation)
    }


def write_table(path: Path) -> None:
    """Write the table to `path` in one step (StorageError if that is not possible)."""
    table = build_table()
    path = Path(os.path.realpath(path))  # a link stays, its target is written
    partial = path.with_name(path.name + ".partial")
    try:
        with open(partial, "wb") as file:
            np.savez_compressed(file, **table)
        os.replace(partial, path)
    except OSError as error:
        partial.unlink(missing_ok=True)
        raise StorageError(
            f"cannot write the two-sphere table {path}: {error.strerror}; choose another --output"
        ) from error


def main() -> None:
    """Command line: write the table to --output."""
    parser = argparse.ArgumentParser(
        prog="python -m suspend.hydro.two_sphere", description="Generate the near-field resistance table."
    )
    parser.add_argument("--output", type=Path, required=True, help="file to write (.npz)")
    try:
        write_table(parser.parse_args().output)
    except StorageError as error:
        parser.exit(error.exit_code, f"error: {error}\n")


if __name__ == "__main__":
    main()
