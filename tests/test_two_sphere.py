"""Exact two-sphere functions, their matrices and the generator of the table."""

import csv
import math
import subprocess
import sys
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from suspend.errors import NumericalError, StorageError
from suspend.hydro.table import load_table, values
from suspend.hydro.two_sphere import exact_functions, main, near_field_functions, smooth_part, write_table
from suspend.hydro.two_sphere_matrices import (
    FIVE,
    FORCE,
    LEVI_CIVITA,
    STRESSLET,
    TORQUE,
    UNIT_FACTORS,
    far_field_functions,
    pair_mobility_matrix,
    pair_resistance_matrix,
    scalar_functions,
)
from suspend.hydro.two_sphere_series import (
    FUNCTIONS,
    NearContact,
    contact_coefficients,
    number_of_terms,
    resistance_functions,
    scaled_binomials,
    solve_axisymmetric,
    twisting,
)

ORACLE = Path(__file__).parent / "data" / "two_sphere_oracle.csv"
DIRECTION = np.array([0.3, -1.9, 0.8])


@cache
def contact() -> NearContact:
    return NearContact()


@cache
def oracle() -> dict[float, np.ndarray]:
    """Columns value, bound of its error, in the order of FUNCTIONS, at each s."""
    with open(ORACLE) as file:
        rows = list(csv.DictReader(line for line in file if not line.startswith("#")))
    found = {(float(row["s"]), row["function"]): (float(row["value"]), float(row["abs_err"])) for row in rows}
    return {s: np.array([found[s, name] for name in FUNCTIONS]) for s in sorted({s for s, _ in found})}


def relative(difference: np.ndarray, value: np.ndarray) -> float:
    return float(np.max(np.abs(difference) / np.maximum(1.0, np.abs(value))))


def exact_matrix(gap: float, d: np.ndarray = DIRECTION) -> np.ndarray:
    return pair_resistance_matrix(UNIT_FACTORS * exact_functions(gap, contact()), d)


def near_field_matrix(gap: float, d: np.ndarray = DIRECTION) -> np.ndarray:
    return pair_resistance_matrix(near_field_functions(gap, contact()), d)


def test_scaled_binomials():
    """C(n+k, n) s^-(n+k) from the integers themselves; the recurrence gathers a rounding error a step."""
    naive = [[math.comb(n + k, n) / 2.5 ** (n + k) for k in range(1, 41)] for n in range(1, 41)]
    np.testing.assert_allclose(scaled_binomials(2.5, 40), naive, rtol=1e-13)


@pytest.mark.parametrize("s", [2.0001, 2.01, 2.5, 4.0])
def test_independent_values(s):
    """Values of another method (power series in a/r, bispherical sums): within their bound and 1e-10."""
    value, bound = oracle()[s].T
    computed = exact_functions(s - 2.0, contact())
    assert np.all(np.abs(computed - value) <= bound + 1e-10 * np.maximum(1.0, np.abs(value)))


def maude(gap: float) -> tuple[float, float]:
    """Drag factors of two equal spheres on their axis, approaching (XA11 - XA12) and following (XA11 + XA12).

    Bispherical sums: Stimson & Jeffery (1926); Brenner (1961), a sphere and a plane free surface.
    """
    alpha = math.acosh(1.0 + gap / 2.0)
    n = np.arange(1, math.ceil(22 / alpha) + 10).astype(np.longdouble)
    a = np.longdouble(alpha)
    weight = n * (n + 1) / ((2 * n - 1) * (2 * n + 3))
    sinh_n, sinh_2 = 2 * np.sinh((2 * n + 1) * a), (2 * n + 1) * np.sinh(2 * a)
    sine = ((2 * n + 1) * np.sinh(a)) ** 2
    approach = weight * ((4 * np.cosh((n + 0.5) * a) ** 2 + sine) / (sinh_n - sinh_2) - 1)
    follow = weight * (1 - (4 * np.sinh((n + 0.5) * a) ** 2 - sine) / (sinh_n + sinh_2))
    return float(4 / 3 * np.sinh(a) * approach.sum()), float(4 / 3 * np.sinh(a) * follow.sum())


@pytest.mark.parametrize("gap", [1e-5, 1e-4, 1e-3, 0.1, 6.0])
def test_axial_motion_by_bispherical_sums(gap):
    """XA11 -+ XA12 from Brenner's and Stimson & Jeffery's exact sums, at small gaps against the expansion.

    Another coordinate system and no linear system; 1e-10 leaves room for the fitted constant (3e-10 at most).
    """
    xa11, xa12 = exact_functions(gap, contact())[:2]
    approach, follow = maude(gap)
    assert abs(xa11 - xa12 - approach) <= 1e-10 * approach
    assert abs(xa11 + xa12 - follow) <= 1e-10


def test_twisting_limits():
    """XC at contact is (7/8) zeta(3) and -zeta(3)/8; the next term is -+(1/8) xi ln(1/xi)."""
    zeta3 = 1.2020569031595942
    x, y = twisting(1e-8)
    correction = 1e-8 * math.log(1e8) / 8
    assert abs(x - 7 * zeta3 / 8 + correction) < 1e-8
    assert abs(y + zeta3 / 8 - correction) < 1e-8


@pytest.mark.parametrize("gap", [1e-3, 0.03, 1.0, 6.0])
def test_two_truncations(gap):
    """One and a half times as many multipoles change nothing beyond rounding (condition times 1e-16)."""
    value = resistance_functions(gap)
    more = resistance_functions(gap, math.ceil(1.5 * number_of_terms(gap)))
    assert relative(more - value, value) < 1e-12


def test_too_few_multipoles_are_seen():
    """The truncation test can fail: a tenth of the multipoles is visibly short at a gap of 0.03."""
    value = resistance_functions(0.03)
    assert relative(resistance_functions(0.03, number_of_terms(0.03) // 10) - value, value) > 1e-4


@pytest.mark.parametrize("gap", [3e-4, 1e-3, 4e-3])
def test_multipoles_and_expansion_overlap(gap):
    """Expansion and multipoles agree where both hold, also below the fitted window: 1e-11 max(1, f)."""
    value = resistance_functions(gap)
    assert relative(contact()(gap) - value, value) < 1e-11


def test_expansion_does_not_depend_on_the_window():
    """Constants at contact from two windows and numbers of samples: 2e-9, a fifth of the 1e-8 claimed."""
    other = NearContact(samples=16, window=(2e-3, 3e-2))
    assert np.max(np.abs(other.coefficients[0] - contact().coefficients[0])) < 2e-9
    squeezed = [k for k, name in enumerate(FUNCTIONS) if name[:2] in ("XA", "XG", "XM")]
    rest = np.setdiff1d(np.arange(len(FUNCTIONS)), squeezed)  # no 1/xi to subtract there
    assert np.max(np.abs(other.coefficients[0] - contact().coefficients[0])[rest]) < 2e-11


def test_logarithm_next_to_contact():
    """g3 of xi ln(1/xi), fitted freely to exact values, is the analytic one: 1e-6 (1e-4 beside a 1/xi).

    Decides between the two printed values of YM12, .1272 and .1332.
    """
    gaps = np.geomspace(1e-3, 5e-2, 20)
    exact = np.array([resistance_functions(gap) for gap in gaps])
    g1, g2, g3 = contact_coefficients()
    log = -np.log(gaps)
    basis = np.column_stack([gaps * log, NearContact.regular_basis(gaps)])
    rest = exact - g1 / gaps[:, None] - g2 * log[:, None]
    fitted = np.linalg.lstsq(basis, rest, rcond=None)[0][0]
    assert np.all(np.abs(fitted - g3) < np.where(g1 == 0.0, 1e-6, 1e-4))


def test_multipoles_refuse_smaller_gaps():
    with pytest.raises(NumericalError, match="1e-4"):
        resistance_functions(5e-5)


def test_axisymmetric_reciprocity():
    """Stresslet of a translating sphere = force of a strained one: (P_2 from P_1) = 20/3 (P_1 from P_2)."""
    for response in solve_axisymmetric(2.01, number_of_terms(0.01)):
        np.testing.assert_allclose(response[1, 0], 20 / 3 * response[0, 1], rtol=1e-11)


@pytest.mark.parametrize("gap", [1e-8, 1e-4, 0.01, 1.0, 6.0])
def test_exact_matrix_dissipates(gap):
    """The exact resistance of a pair is symmetric and positive definite (22 x 22): any motion dissipates."""
    matrix = exact_matrix(gap)
    np.testing.assert_array_equal(matrix, matrix.T)
    # Rounding of the largest entries (1/4 xi) bounds how well the smallest eigenvalue can be seen.
    assert np.linalg.eigvalsh(matrix)[0] > 0.1 - 1e-14 * np.abs(matrix).max()


@pytest.mark.parametrize("gap", [1e-6, 0.01, 1.0])
def test_reflection(gap):
    """Exchange of the spheres (d -> -d) permutes the rows; mirror images give mirror loads."""
    swap = np.r_[6:12, 0:6, 17:22, 12:17]
    matrix = near_field_matrix(gap)
    np.testing.assert_allclose(near_field_matrix(gap, -DIRECTION), matrix[np.ix_(swap, swap)], rtol=1e-13)
    rotation = np.linalg.qr(np.random.default_rng(5).normal(size=(3, 3)))[0]
    rotation *= -np.linalg.det(rotation)  # improper: torques and angular velocities are axial vectors
    five = np.einsum("aij,ik,jl,bkl->ab", FIVE, rotation, rotation, FIVE)
    q = np.zeros((22, 22))
    for i in range(2):
        q[FORCE[i], FORCE[i]] = rotation
        q[TORQUE[i], TORQUE[i]] = -rotation
        q[STRESSLET[i], STRESSLET[i]] = five
    np.testing.assert_allclose(
        near_field_matrix(gap, rotation @ DIRECTION), q @ matrix @ q.T, atol=1e-13 * np.abs(matrix).max()
    )


@pytest.mark.parametrize("gap", [1e-8, 1e-3, 0.1, 1.0, 6.0])
def test_rigid_motion_of_the_pair(gap):
    """A pair moving as a rigid body strains nothing between the spheres: loads stay bounded at any gap.

    Lubrication forces (2.5e7 at 1e-8) must cancel. Exact minus FTS is not blind to rigid motion: measured,
    forces up to 3e-3 for a translation along the axis and torques up to 2e-2 for a turn about the centre.
    """
    matrix = near_field_matrix(gap)
    e = DIRECTION / np.linalg.norm(DIRECTION)
    half = 0.5 * (2.0 + gap) * e
    spin = np.cross(e, [0.0, 0.0, 1.0]) / np.linalg.norm(np.cross(e, [0.0, 0.0, 1.0]))
    motions = ((e, e, 0 * e, 4e-3), (np.cross(spin, -half), np.cross(spin, half), spin, 3e-2))
    for u1, u2, w, bound in motions:
        loads = matrix @ np.concatenate([u1, w, u2, w, np.zeros(10)])
        assert np.abs(loads[:12]).max() < bound + 1e-15 * np.abs(matrix).max()


def test_near_field_dissipates():
    """The force-torque block (12 x 12) of the near field is positive semidefinite over the whole table."""
    for gap in np.geomspace(1e-10, 6.0, 60):
        matrix = near_field_matrix(gap)
        block = matrix[:12, :12]
        np.testing.assert_array_equal(matrix, matrix.T)
        assert np.linalg.eigvalsh(block)[0] > -1e-13 * max(1e-3, np.abs(block).max())


def test_near_field_decays():
    """What the FTS level misses are octupoles: the force functions fall at least like r^-6, all like r^-5.

    Between r = 20 and 40 a wrong reflection anywhere in either matrix would leave r^-1 to r^-4.
    """
    near, far = (
        UNIT_FACTORS * resistance_functions(r - 2.0) - far_field_functions(r - 2.0) for r in (20.0, 40.0)
    )
    seen = np.abs(near) > 1e-11
    assert seen.sum() >= 12
    assert np.all(np.abs(far[seen]) < np.abs(near[seen]) / 2**4.8)


def test_mobility_is_faxen_of_oseen():
    """Mobility from the field of one loaded sphere and Faxen's laws for the other.

    U = (1 + a^2/6 laplacian) u, Omega = curl u / 2, -E = (1 + a^2/10 laplacian) sym grad u, by fourth-order
    differences of the textbook field of a sphere with force, torque and stresslet: error below 1e-6.
    """

    def velocity(x, force, torque, stresslet):  # of a sphere at the origin, its own size included
        r = np.linalg.norm(x)
        e = x / r
        u = 0.75 * (force + e * (e @ force)) / r + 0.25 * (force - 3 * e * (e @ force)) / r**3
        u = u + 0.75 * np.cross(torque, e) / r**2
        ses = e @ stresslet @ e
        return u + 2.25 * e * ses / r**2 + 0.45 * (2 * stresslet @ e - 5 * e * ses) / r**4

    def laplacian(field, x, h=0.02):
        total = -90 * field(x)
        for axis in np.eye(3) * h:  # fourth order
            near, far = field(x + axis) + field(x - axis), field(x + 2 * axis) + field(x - 2 * axis)
            total = total + 16 * near - far
        return total / (12 * h * h)

    rng = np.random.default_rng(3)
    force, torque, s5 = rng.normal(size=3), rng.normal(size=3), rng.normal(size=5)
    load = np.zeros(22)
    load[FORCE[0]], load[TORQUE[0]], load[STRESSLET[0]] = force, torque, s5

    def field(x):
        return velocity(x, force, torque, np.einsum("a,aij->ij", s5, FIVE))

    def gradient(y, h=1e-2):
        rows = [
            (8 * (field(y + a) - field(y - a)) - field(y + 2 * a) + field(y - 2 * a)) / (12 * h)
            for a in np.eye(3) * h
        ]
        return np.array(rows)

    d = np.array([2.0, -1.5, 1.2])
    motion = pair_mobility_matrix(d) @ load
    np.testing.assert_allclose(motion[FORCE[1]], field(d) + laplacian(field, d) / 6, atol=1e-6)
    curl = 0.5 * np.einsum("ijk,jk->i", LEVI_CIVITA, gradient(d))
    np.testing.assert_allclose(motion[TORQUE[1]], curl, atol=1e-6)
    strain = np.einsum("aij,ij->a", FIVE, gradient(d) + laplacian(gradient, d) / 10)
    np.testing.assert_allclose(motion[STRESSLET[1]], strain, atol=1e-6)


def test_mobility_is_symmetric_positive():
    """Reciprocity and positivity of the FTS mobility, down to contact; self blocks 1, 3/4, 9/10."""
    for r in (2.0, 2.5, 8.0):
        matrix = pair_mobility_matrix(r * DIRECTION / np.linalg.norm(DIRECTION))
        np.testing.assert_allclose(matrix, matrix.T, atol=1e-15)
        assert np.linalg.eigvalsh(matrix)[0] > 0.1
    own = np.r_[np.tile([1, 1, 1, 0.75, 0.75, 0.75], 2), [0.9] * 10]
    np.testing.assert_array_equal(np.diag(matrix), own)


def test_inverse_mobility_has_the_tensor_forms():
    """The 22 functions describe the inverse FTS mobility completely: nothing is lost in the projection."""
    resistance = np.linalg.inv(pair_mobility_matrix(np.array([0.0, 0.0, 2.3])))
    rebuilt = pair_resistance_matrix(scalar_functions(resistance), np.array([0.0, 0.0, 1.0]))
    np.testing.assert_allclose(rebuilt, resistance, atol=1e-14)


@pytest.mark.parametrize("gap", [1e-9, 3.3e-8, 1e-5, 4.4e-4, 1.7e-3, 0.0123, 0.31, 0.87, 2.2, 5.9])
def test_table_is_what_the_generator_makes(gap):
    """Interpolation error, between nodes, of the shipped table: 5e-10 max(1, |f|) (1.4e-10 measured).

    The smooth part is compared too, where g1/xi would hide it: 1e-9 as far as rounding of g1/xi allows.
    """
    table = load_table()
    f = near_field_functions(gap, contact())
    found = values(table, gap)
    assert relative(found[:22] - f, f) < 5e-10
    singular = (table.g1 / gap - table.g2 * np.log(gap))[:22]
    difference = found[:22] - singular - smooth_part(gap, contact())
    assert np.max(np.abs(difference)) < 1e-9 + 1e-15 / gap


def test_generator_program(tmp_path):
    """The command writes the very table that is shipped (to 1e-9: another BLAS rounds differently)."""
    path = tmp_path / "table.npz"
    subprocess.run([sys.executable, "-m", "suspend.hydro.two_sphere", "--output", str(path)], check=True)
    shipped = load_table()
    with np.load(path) as made:
        assert made["functions"].tolist() == list(FUNCTIONS)
        assert (made["t0"], 1 / made["dt"]) == (shipped.t0, shipped.inv_dt)
        np.testing.assert_array_equal(made["g1"], shipped.g1)
        np.testing.assert_array_equal(made["g2"], shipped.g2)
        np.testing.assert_allclose(made["coefficients"], shipped.coefficients, atol=2e-9)
    assert [p.name for p in tmp_path.iterdir()] == ["table.npz"]


def test_unwritable_output(tmp_path, monkeypatch):
    monkeypatch.setattr("suspend.hydro.two_sphere.build_table", lambda: {"t0": np.zeros(1)})
    path = tmp_path / "missing" / "table.npz"
    with pytest.raises(StorageError, match="missing"):
        write_table(path)
    monkeypatch.setattr("sys.argv", ["two_sphere", "--output", str(path)])
    with pytest.raises(SystemExit) as stop:
        main()
    assert stop.value.code == StorageError.exit_code
