"""Loading and evaluation of the near-field table."""

import math
import subprocess
import sys

import numpy as np
import pytest

from suspend.errors import NumericalError, StorageError
from suspend.hydro.table import evaluate, largest_gap, load_table, read_table, values


def naive(table, xi):
    """g1/xi + g2 ln(1/xi) + polynomial, term by term."""
    x = max((math.log(xi) - table.t0) * table.inv_dt, 0.0)
    k = min(math.floor(x), len(table.coefficients) - 1)
    powers = (x - k) ** np.arange(table.coefficients.shape[1])
    return table.g1 / xi + table.g2 * math.log(1 / xi) + powers @ table.coefficients[k]


def test_layout():
    """The layout other modules rely on: (intervals, degree + 1, 24), zero padding, range of gaps."""
    table = load_table()
    assert table.coefficients.shape == (250, 6, 24)
    assert not table.coefficients[..., 22:].any()
    assert not table.g1[22:].any() and not table.g2[22:].any()
    assert largest_gap(table) == pytest.approx(6.0, rel=1e-13)
    assert math.exp(table.t0) <= 1e-8


@pytest.mark.parametrize("xi", [1e-15, 1e-10, 1e-8, 3e-4, 0.02, 1.0, 1.999, 5.99, 6.0])
def test_evaluate_against_naive(xi):
    """The compiled function and a term-by-term sum in NumPy, to rounding."""
    table = load_table()
    out = np.empty(24)
    evaluate(table, xi, out)
    np.testing.assert_allclose(out, naive(table, xi), rtol=1e-12, atol=1e-14)
    np.testing.assert_array_equal(values(table, xi), out)


def test_four_derivatives_are_continuous():
    """A quintic spline: value and four derivatives match at every knot, two at the constant continuation."""
    c = load_table().coefficients
    for order in range(5):
        factor = np.array([math.perm(d, order) for d in range(6)], dtype=float)
        right_end = np.einsum("d,kdf->kf", factor, c)
        left_end = math.factorial(order) * c[:, order]
        np.testing.assert_allclose(right_end[:-1], left_end[1:], atol=1e-11)
    np.testing.assert_allclose(c[0, 1:3], 0.0, atol=1e-14)


def test_leading_terms_at_contact():
    """Classical lubrication of equal spheres (Jeffrey & Onishi 1984), in units 6 pi eta a^n.

    XA11 -> 1/(4 xi) + (9/40) ln(1/xi), YA11 -> (1/6) ln(1/xi), YC11 -> (4/15) ln(1/xi).
    """
    difference = values(load_table(), 1e-9) - values(load_table(), 1e-12)
    log = math.log(1e-12 / 1e-9)
    assert difference[0] == pytest.approx(0.25 * (1e9 - 1e12) + 9 / 40 * log, rel=1e-13)
    assert difference[2] == pytest.approx(log / 6, abs=1e-7)
    assert difference[8] == pytest.approx(4 / 15 * log, abs=1e-7)


@pytest.mark.parametrize("xi", [0.0, -1e-3, 6.1, math.inf, math.nan])
def test_outside_the_table(xi):
    """No silent extrapolation: an error from Python, NaN from the kernel."""
    table = load_table()
    with pytest.raises(NumericalError, match="two-sphere table"):
        values(table, xi)
    out = np.zeros(24)
    evaluate(table, xi, out)
    assert np.isnan(out).all()


def test_damaged_missing_or_old_file(tmp_path):
    with pytest.raises(StorageError, match=r"none\.npz"):
        read_table(tmp_path / "none.npz")
    damaged = tmp_path / "damaged.npz"
    damaged.write_bytes(b"PK\x03\x04 not a table")
    with pytest.raises(StorageError, match="make it again"):
        read_table(damaged)
    np.savez(tmp_path / "incomplete.npz", version=1)
    with pytest.raises(StorageError, match="make it again"):
        read_table(tmp_path / "incomplete.npz")
    old = tmp_path / "old.npz"
    zero = np.zeros(24)
    np.savez(old, version=0, t0=0.0, dt=1.0, coefficients=np.zeros((1, 6, 24)), g1=zero, g2=zero)
    with pytest.raises(StorageError, match="version 0"):
        read_table(old)


def test_loading_does_not_import_the_generator():
    """Runs read the table; SciPy's interpolation and the multipoles belong to the generator alone."""
    code = (
        "import sys, suspend.hydro.table as t; t.load_table();"
        "print([name for name in sys.modules if 'two_sphere' in name])"
    )
    done = subprocess.run([sys.executable, "-c", code], check=True, capture_output=True, text=True)
    assert done.stdout.strip() == "[]"
