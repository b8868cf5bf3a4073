"""Plain NumPy twins of the near-field and force kernels: all pairs over all images, dense matrices."""

import math

import numpy as np

from suspend.hydro.table import load_table, values
from suspend.hydro.two_sphere_matrices import FIVE, pair_resistance_matrix

COMPONENTS = ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2))
MOTION = [0, 1, 2, 3, 4, 5]
STRAIN = [6, 7, 8, 9, 10]


def lattice(edge, tilt):
    """Cell vectors as rows."""
    return np.array([[edge, 0.0, 0.0], [tilt * edge, edge, 0.0], [0.0, 0.0, edge]])


def image_pairs(position, edge, tilt, reach):
    """Every pair (i, j, n) with |x_j + n.a - x_i| < reach, once: i < j, or i = j and n in one half space."""
    vectors = lattice(edge, tilt)
    inverse = np.linalg.inv(vectors)
    spread = np.abs(position @ inverse).max() if len(position) else 0.0
    m = math.ceil(reach * np.linalg.norm(inverse, axis=0).max() + 2 * spread) + 1
    n = np.array([(a, b, c) for a in range(-m, m + 1) for b in range(-m, m + 1) for c in range(-m, m + 1)])
    pairs = []
    for i in range(len(position)):
        for j in range(i, len(position)):
            d = position[j] + n @ vectors - position[i]
            for k in np.flatnonzero(np.einsum("ij,ij->i", d, d) < reach**2):
                if i < j or tuple(n[k][::-1]) > (0, 0, 0):
                    pairs.append((i, j, *(int(v) for v in n[k])))
    return pairs


def separations(position, edge, tilt, reach):
    """(i, j, d) of every pair, d from i to j."""
    vectors = lattice(edge, tilt)
    return [
        (i, j, position[j] + np.array(n) @ vectors - position[i])
        for i, j, *n in image_pairs(position, edge, tilt, reach)
    ]


def grand_near_field(position, edge, tilt, cutoff, at_cutoff="hard"):
    """Near-field resistance (11N, 11N), sphere by sphere [F T S] from [U W -E], loads on the fluid.

    Sum over pairs of exact minus two-sphere FTS functions, minus their value at the cutoff if `shifted`.
    """
    table = load_table()
    matrix = np.zeros((11 * len(position), 11 * len(position)))
    shift = values(table, cutoff - 2.0) if at_cutoff == "shifted" else 0.0
    for i, j, d in separations(position, edge, tilt, cutoff):
        pair = pair_resistance_matrix(values(table, np.linalg.norm(d) - 2.0) - shift, d)
        rows = np.r_[0:6, 12:17, 6:12, 17:22]  # from [1, 2, S1, S2] to sphere by sphere
        pair = pair[np.ix_(rows, rows)]
        own = [np.arange(11 * i, 11 * i + 11), np.arange(11 * j, 11 * j + 11)]
        for a in range(2):
            for b in range(2):
                matrix[np.ix_(own[a], own[b])] += pair[11 * a : 11 * a + 11, 11 * b : 11 * b + 11]
    return matrix


def part(matrix, rows, columns):
    """Sub-matrix of an (11N, 11N) matrix: `MOTION` (6 a sphere) or `STRAIN` (5 a sphere) rows and columns."""
    number = matrix.shape[0] // 11
    index = [np.concatenate([11 * i + np.array(k) for i in range(number)]) for k in (rows, columns)]
    return matrix[np.ix_(*index)]


def five(tensor):
    """Components of a symmetric traceless tensor in the orthonormal basis."""
    return np.einsum("aij,ij->a", FIVE, tensor)


def voigt(tensor):
    """Six components in the order of the package."""
    return np.array([tensor[a, b] for a, b in COMPONENTS])


def strain_loads(matrix, strain_rate):
    """R_FE : E, (N, 6)."""
    number = matrix.shape[0] // 11
    return (part(matrix, MOTION, STRAIN) @ np.tile(five(strain_rate), number)).reshape(number, 6)


def stresslets(matrix, velocity, strain_rate):
    """Stresslet of each sphere, Brady's sign, (N, 3, 3): -R_SU U' + R_SE : E."""
    number = matrix.shape[0] // 11
    s = -part(matrix, STRAIN, MOTION) @ velocity.reshape(-1)
    s = s + part(matrix, STRAIN, STRAIN) @ np.tile(five(strain_rate), number)
    return np.einsum("na,aij->nij", s.reshape(number, 5), FIVE)


def pair_forces(position, edge, tilt, reach, law):
    """Forces (N, 3), stress -1/2 sum_j (x_i - x_j) F_ij of each sphere (N, 3, 3); law(gap) > 0 is
    repulsive.
    """
    force = np.zeros((len(position), 3))
    stress = np.zeros((len(position), 3, 3))
    for i, j, d in separations(position, edge, tilt, reach):
        r = np.linalg.norm(d)
        on_i = -law(r - 2.0) * d / r
        force[i] += on_i
        force[j] -= on_i
        for k in (i, j):
            stress[k] += 0.5 * np.outer(d, on_i)  # -1/2 (x_i - x_j) F_i = 1/2 d F_i
    return force, stress


def loose_positions(number, edge, tilt, seed, distance=2.02):
    """Random positions in the cell, no two images closer than `distance` (insertion: dilute scenes only)."""
    random = np.random.default_rng(seed)
    vectors = lattice(edge, tilt)
    placed = np.empty((0, 3))
    while len(placed) < number:
        trial = np.vstack([placed, random.random(3) @ vectors])
        d = (trial[:-1] - trial[-1]) @ np.linalg.inv(vectors)
        near = (d - np.round(d))[:, None, :] + np.array(
            [(a, b, c) for a in (-1, 0, 1) for b in (-1, 0, 1) for c in (-1, 0, 1)]
        )
        if len(placed) == 0 or np.linalg.norm(near @ vectors, axis=2).min() > distance:
            placed = trial
    return placed
