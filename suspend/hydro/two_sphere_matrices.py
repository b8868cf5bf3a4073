"""Two-sphere matrices: resistance from scalar functions, free-space FTS mobility, and scalar functions back.

Rows [F1 T1 F2 T2 S1 S2], columns [U1 W1 U2 W2 -E -E] (relative to the undisturbed flow), loads exerted by the
spheres on the fluid, units 6 pi eta a^n (a = 1): a lone sphere has diagonal 1, 4/3, 10/9. Stresslets are
five-vectors in the orthonormal basis `FIVE`. Plain NumPy: for the generator and as the reference in tests.
"""

from __future__ import annotations

import functools

import numpy as np

from suspend.conventions import COMPONENT_INDEX
from suspend.hydro.two_sphere_series import FUNCTIONS

_R2, _R6 = np.sqrt(2.0), np.sqrt(6.0)
FIVE = np.array(
    [
        np.diag([1, -1, 0]) / _R2,
        np.diag([-1, -1, 2]) / _R6,
        np.array([[0, 1, 0], [1, 0, 0], [0, 0, 0]]) / _R2,
        np.array([[0, 0, 1], [0, 0, 0], [1, 0, 0]]) / _R2,
        np.array([[0, 0, 0], [0, 0, 1], [0, 1, 0]]) / _R2,
    ]
)
_FIVE_TO_SIX = np.array([[basis[a, b] for a, b in COMPONENT_INDEX] for basis in FIVE])
LEVI_CIVITA = np.zeros((3, 3, 3))
LEVI_CIVITA[[0, 1, 2], [1, 2, 0], [2, 0, 1]] = 1.0
LEVI_CIVITA[[0, 2, 1], [2, 1, 0], [1, 0, 2]] = -1.0

# From the hatted normalisation to units 6 pi eta a^n.
_FACTOR = {"A": 1.0, "B": 2 / 3, "C": 4 / 3, "G": 2 / 3, "H": 4 / 3, "M": 10 / 9}
UNIT_FACTORS = np.array([_FACTOR[name[1]] for name in FUNCTIONS])
FORCE = (slice(0, 3), slice(6, 9))
TORQUE = (slice(3, 6), slice(9, 12))
STRESSLET = (slice(12, 17), slice(17, 22))


def five_of(tensor: np.ndarray) -> np.ndarray:
    """Components (..., 5) of symmetric traceless tensors (..., 3, 3) in the orthonormal basis `FIVE`."""
    return np.einsum("aij,...ij->...a", FIVE, tensor)


def tensor_of(five: np.ndarray) -> np.ndarray:
    """Symmetric traceless tensors (..., 3, 3) of five-vectors (..., 5)."""
    return np.einsum("...a,aij->...ij", five, FIVE)


def six_of(five: np.ndarray) -> np.ndarray:
    """Components (..., 6) in the order of `suspend.conventions.COMPONENTS` of five-vectors (..., 5)."""
    return five @ _FIVE_TO_SIX


def tensor_forms(f: dict[str, float], e: np.ndarray) -> tuple[np.ndarray, ...]:
    """A (3,3), B (3,3: T from U), C (3,3), G (5,3), H (5,3), M (5,5) from XA ... ZM and the unit vector e.

    Jeffrey & Onishi (1984), Jeffrey (1992); e points from the sphere of the row to the other one.
    """
    one = np.eye(3)
    ee = np.outer(e, e)
    a = f["XA"] * ee + f["YA"] * (one - ee)
    b = f["YB"] * LEVI_CIVITA @ e
    c = f["XC"] * ee + f["YC"] * (one - ee)
    mixed = np.einsum("i,jk->ijk", e, one) + np.einsum("j,ik->ijk", e, one)
    g = f["XG"] * np.einsum("ij,k->ijk", ee - one / 3, e)
    g = g + f["YG"] * (mixed - 2 * np.einsum("i,j,k->ijk", e, e, e))
    turn = LEVI_CIVITA @ e  # eps_jkm e_m
    h = f["YH"] * (np.einsum("i,jk->ijk", e, turn) + np.einsum("j,ik->ijk", e, turn))
    # Projectors on the axial, the two bending and the two transverse strains.
    five_e = np.einsum("aij,j->ai", FIVE, e)
    axial = np.einsum("ai,i->a", five_e, e)
    x = 1.5 * np.outer(axial, axial)
    y = 2 * (five_e @ five_e.T - np.outer(axial, axial))
    m = f["XM"] * x + f["YM"] * y + f["ZM"] * (np.eye(5) - x - y)
    return a, b, c, np.einsum("aij,ijk->ak", FIVE, g), np.einsum("aij,ijk->ak", FIVE, h), m


def pair_resistance_matrix(functions: np.ndarray, d: np.ndarray) -> np.ndarray:
    """Resistance (22, 22) of a pair from the functions (>= 22, units 6 pi eta a^n) and d = x2 - x1 (3,).

    Only the direction of d counts. Block (i, j) uses the functions 11 for i = j and 12 otherwise; e = d/|d|
    for rows of sphere 1, -d/|d| for rows of sphere 2.
    """
    e = np.asarray(d, dtype=float) / np.linalg.norm(d)
    value = dict(zip(FUNCTIONS, functions, strict=False))
    matrix = np.zeros((22, 22))
    for i in range(2):
        for j in range(2):
            suffix = "11" if i == j else "12"
            scalars = {name[:2]: v for name, v in value.items() if name.endswith(suffix)}
            a, b, c, g, h, m = tensor_forms(scalars, e if i == 0 else -e)
            matrix[FORCE[i], FORCE[j]] = a
            matrix[TORQUE[i], TORQUE[j]] = c
            matrix[STRESSLET[i], STRESSLET[j]] = m
            for rows, columns, block in (
                (TORQUE[i], FORCE[j], b),
                (STRESSLET[i], FORCE[j], g),
                (STRESSLET[i], TORQUE[j], h),
            ):
                matrix[rows, columns] = block
                matrix[columns, rows] = block.T
    return matrix


@functools.cache
def _unit_matrices() -> np.ndarray:
    axis = np.array([0.0, 0.0, 1.0])
    return np.array([pair_resistance_matrix(unit, axis) for unit in np.eye(len(FUNCTIONS))])


def scalar_functions(matrix: np.ndarray) -> np.ndarray:
    """Functions (22,) of a pair matrix (22, 22) whose axis d = x2 - x1 is along +z (inverse of the above)."""
    unit = _unit_matrices()
    return np.einsum("fij,ij->f", unit, matrix) / np.einsum("fij,fij->f", unit, unit)


def velocity_and_gradient(
    r: np.ndarray, force: np.ndarray, dipole: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Velocity (3,) and gradient d_p u_q (3,3) of a sphere at r from a force and dipole C on a sphere at 0.

    Finite-size Oseen kernels with Faxen's law at both ends, C_ij = S_ij - eps_ijk T_k/2; units 6 pi eta a^n.
    """
    s = np.linalg.norm(r)
    x = r / s
    f1, f2 = 0.75 / s + 0.5 / s**3, 1.5 / s - 1 / s**3
    g1, g2 = 0.75 / s**2 + 1.2 / s**4, -0.75 / s**2 + 1.2 / s**4
    h1, h2, h3 = -0.75 / s**3 + 0.9 / s**5, -2.25 / s**3 - 4.5 / s**5, 2.25 / s**3 - 4.5 / s**5
    xx, one = np.outer(x, x), np.eye(3)
    xf, cx, ctx = x @ force, dipole @ x, dipole.T @ x
    xcx = x @ cx
    u = f1 * force + (f2 - f1) * x * xf + g1 * (cx - xcx * x) + g2 * (ctx - 4 * xcx * x)
    gradient = -g1 * (np.outer(x, force) - xf * xx) - g2 * (one * xf + np.outer(force, x) - 4 * xf * xx)
    gradient += h1 * (dipole - 4 * dipole.T) + h2 * (np.outer(x, cx) - xcx * xx)
    gradient += h3 * (one * xcx + np.outer(cx + ctx, x) + np.outer(x, ctx) - 6 * xcx * xx - dipole.T)
    return u, gradient


def pair_mobility_matrix(d: np.ndarray) -> np.ndarray:
    """Free-space mobility (22, 22) of a pair at the force-torque-stresslet level, d = x2 - x1 (radii).

    For spheres that do not overlap, |d| >= 2. Rows [U1 W1 U2 W2 -E1 -E2], columns [F1 T1 F2 T2 S1 S2]:
    [U; W; -E] = M [F; T; S]; Durlofsky, Brady & Bossis, J. Fluid Mech. 180, 21 (1987).
    """
    matrix = np.zeros((22, 22))
    for i in range(2):
        matrix[FORCE[i], FORCE[i]] = np.eye(3)
        matrix[TORQUE[i], TORQUE[i]] = 0.75 * np.eye(3)
        matrix[STRESSLET[i], STRESSLET[i]] = 0.9 * np.eye(5)
        j = 1 - i
        r = -np.asarray(d, dtype=float) if i == 0 else np.asarray(d, dtype=float)  # x_i - x_j
        columns = np.r_[FORCE[j], TORQUE[j], STRESSLET[j]]
        for column, load in zip(columns, np.eye(11), strict=True):
            dipole = np.einsum("a,aij->ij", load[6:], FIVE) - 0.5 * LEVI_CIVITA @ load[3:6]
            u, gradient = velocity_and_gradient(r, load[:3], dipole)
            matrix[FORCE[i], column] = u
            matrix[TORQUE[i], column] = 0.5 * np.einsum("ijk,jk->i", LEVI_CIVITA, gradient)
            matrix[STRESSLET[i], column] = np.einsum("aij,ij->a", FIVE, gradient)
    return matrix


def far_field_functions(gap: float) -> np.ndarray:
    """Functions (22,), units 6 pi eta a^n, of the inverse of the pair's FTS mobility at a gap (radii)."""
    return scalar_functions(np.linalg.inv(pair_mobility_matrix(np.array([0.0, 0.0, 2.0 + gap]))))
