"""Velocity solve: true errors against dense solutions, near contacts, the incomplete factor, the limit."""

from functools import cache

import numpy as np
import pytest

from suspend.conventions import ROTATIONAL_DRAG
from suspend.core.pairs import apply_rows
from suspend.errors import NumericalError
from suspend.hydro.nearfield import NearField, pair_table
from suspend.hydro.neighbours import VerletList
from suspend.packing import random_packing
from suspend.solvers.conjugate_gradient import DELAY, Goal, conjugate_gradient
from suspend.solvers.incomplete import apply_factor
from suspend.solvers.stiff_clusters import STIFF, no_clusters

DRAGS = (1.0, ROTATIONAL_DRAG)
SHEAR = np.array([[0, 0.5, 0], [0.5, 0, 0], [0, 0, 0]])
CLOSE = 0.2


def near_field(position, edge, cutoff=4.0, at_cutoff="shifted", close=CLOSE, threads=1):
    near = NearField(pair_table(cutoff, at_cutoff), DRAGS, threads)
    verlet = VerletList(edge, cutoff, 0.4)
    verlet.build(position, 0.0, 0.0)
    near.use_list(verlet.pairs, verlet.offset)
    near.smallest = near.assemble(position, edge, 0.0)
    near.precondition(close)
    return near


def own_drag(number):
    return np.tile([1.0] * 3 + [ROTATIONAL_DRAG] * 3, number)


def dense(near):
    """R_self + R_nf, (6N, 6N), through the product kernel (itself tested against a twin)."""
    number = near.offset.shape[0] - 1
    matrix = np.diag(own_drag(number))
    for k, unit in enumerate(np.eye(6 * number)):
        load = np.zeros((number, 6))
        apply_rows(0, number, near.active, near.scalars, unit.reshape(number, 6), load)
        matrix[:, k] += load.reshape(-1)
    return 0.5 * (matrix + matrix.T)


def exact(matrix, load):
    """Dense solution, refined with residuals in extended precision."""
    inverse = np.linalg.inv(matrix)
    wide, target = matrix.astype(np.longdouble), load.reshape(-1).astype(np.longdouble)
    velocity = np.zeros(len(matrix), np.longdouble)
    for _ in range(12):
        velocity = velocity + inverse @ (target - wide @ velocity).astype(float)
    return velocity.astype(float).reshape(load.shape)


def energy_error(matrix, velocity, solution):
    """Error in the energy norm relative to the drag-weighted norm of the solution."""
    error = (velocity - solution).reshape(-1)
    u = solution.reshape(-1)
    return np.sqrt(error @ matrix @ error / (u * own_drag(len(solution)) @ u))


@cache
def packing(number, fraction, seed):
    found = random_packing(number, fraction, seed=seed)
    return found.positions, found.length


def with_near_contact(gap, seed=1):
    """N = 100 at phi = 0.4 with one sphere moved onto its neighbour, at `gap`, no other pair nearer than
    1e-4.
    """
    position, edge = packing(100, 0.4, seed)
    for i in range(100):
        d = position - position[i]
        d -= edge * np.round(d / edge)
        r = np.linalg.norm(d, axis=1)
        r[i] = np.inf
        j = int(r.argmin())
        moved = position.copy()
        moved[i] += d[j] * (1.0 - (2.0 + gap) / r[j])
        others = np.delete(moved, [i, j], axis=0) - moved[i]
        others -= edge * np.round(others / edge)
        if np.linalg.norm(others, axis=1).min() > 2.0001:
            return moved, edge, i, j
    raise AssertionError("no sphere could be moved")


@pytest.mark.parametrize("tolerance", [1e-3, 1e-5, 1e-9])
@pytest.mark.parametrize(("fraction", "seed"), [(0.1, 1), (0.3, 2), (0.5, 3)])
def test_error_is_what_was_asked_for(fraction, seed, tolerance):
    """True error in the energy norm <= 3 x tolerance, for shear and for random loads, cold and warm start.

    The delayed estimate is a lower bound of the error DELAY iterations earlier; the factor 3 allows for that.
    """
    position, edge = packing(60, fraction, seed)
    near = near_field(position, edge)
    matrix, random = dense(near), np.random.default_rng(seed)
    for load in (near.strain_loads(SHEAR), random.normal(size=(60, 6)), 100 * random.normal(size=(60, 6))):
        solution = exact(matrix, load)
        for start in (np.zeros((60, 6)), solution + 1e-2 * random.normal(size=(60, 6))):
            found = near.solve(load, start, tolerance, 0.0, 500)
            assert energy_error(matrix, found.velocity, solution) <= 3 * tolerance
            assert found.error <= tolerance


@pytest.mark.parametrize("threads", [1, 2, 3])
def test_domains_do_not_change_the_solution(threads):
    """The preconditioner is cut at the threads' bounds: other iterations, the same solution (1e-10)."""
    position, edge = packing(60, 0.3, 2)
    near = near_field(position, edge, threads=threads)
    load = near.strain_loads(SHEAR)
    found = near.solve(load, np.zeros((60, 6)), 1e-12, 0.0, 500)
    assert energy_error(dense(near), found.velocity, exact(dense(near), load)) <= 1e-10


def test_factor_of_a_touching_pair():
    """Gap 1e-10: pivots of 1e10 beside pivots of 1. Factored by squares the loss is eps/gap (2e-6), not
    eps/gap^2.
    """
    near = near_field(np.array([[10.0, 10, 10], 10 + (2 + 1e-10) * np.array([2, -1, 2]) / 3]), 60.0)
    inverse = np.linalg.inv(dense(near))
    assert (near.factor.broken == 0).all()
    assert np.abs(factor_inverse(near) - inverse).max() <= 5e-6


@pytest.mark.parametrize("gap", [1e-6, 1e-8])
@pytest.mark.parametrize("kind", ["shear", "pushed", "random"])
def test_one_pair_near_contact(gap, kind):
    """One stiff pair must not hide the errors of the other spheres: every sphere's velocity against a dense
    solution.

    |error_i| <= the whole error's drag norm <= energy norm <= 3 x tolerance x norm of the velocities.
    Assembly at a gap of 1e-8 loses eight digits of the gap; both solutions share it. Fewer than 200 iterations.
    """
    position, edge, i, j = with_near_contact(gap)
    near = near_field(position, edge)
    assert near.smallest == pytest.approx(gap, rel=1e-6)
    load = near.strain_loads(SHEAR)
    if kind == "pushed":  # the two spheres of the pair pressed together by a large force
        d = position[j] - position[i]
        d -= edge * np.round(d / edge)
        load[i, :3] += 10.0 * d / np.linalg.norm(d)
        load[j, :3] -= 10.0 * d / np.linalg.norm(d)
    elif kind == "random":
        load = np.random.default_rng(1).normal(size=load.shape)
    solution = exact(dense(near), load)
    tolerance = 1e-5
    found = near.solve(load, np.zeros_like(load), tolerance, 0.0, 2000)
    scale = np.sqrt(np.sum(solution.reshape(-1) ** 2 * own_drag(100)))
    assert np.linalg.norm(found.velocity - solution, axis=1).max() <= 3 * tolerance * scale
    assert energy_error(dense(near), found.velocity, solution) <= 3 * tolerance
    assert found.iterations < 200


def test_warm_start_from_the_solution_is_quick():
    """Started at the solution nothing is left to do but to see it: no more than DELAY + 1 iterations."""
    position, edge = packing(60, 0.3, 2)
    near = near_field(position, edge)
    load = near.strain_loads(SHEAR)
    found = near.solve(load, exact(dense(near), load), 1e-6, 0.0, 500)
    assert found.iterations <= DELAY + 1


def test_zero_load():
    """No load: no motion, no iteration."""
    position, edge = packing(60, 0.3, 2)
    found = near_field(position, edge).solve(np.zeros((60, 6)), np.zeros((60, 6)), 1e-6, 0.0, 500)
    assert found.iterations == 0 and not found.velocity.any()


def test_limit_is_an_error():
    """Too few iterations raise, with the numbers and the setting to change; a bad answer is never
    returned.
    """
    position, edge = packing(60, 0.5, 3)
    near = near_field(position, edge)
    with pytest.raises(NumericalError, match=r"after 4 iterations.*solver\.max_iterations"):
        near.solve(near.strain_loads(SHEAR), np.zeros((60, 6)), 1e-10, 0.0, 4)


def factor_inverse(near):
    """(L D L^T)^-1 as a dense matrix."""
    number = near.offset.shape[0] - 1
    columns = []
    for unit in np.eye(6 * number):
        result = np.zeros((number, 6))
        for first, last in zip(near.factor.bounds[:-1], near.factor.bounds[1:], strict=True):
            apply_factor(first, last, near.factor, unit.reshape(number, 6), result)
        columns.append(result.reshape(-1))
    return np.array(columns).T


def chain():
    """Seven spheres in a zigzag, gaps from 1e-7 to 0.1, next-nearest neighbours beyond the cutoff 2.5."""
    gaps = (1e-7, 1e-2, 1e-5, 0.1, 1e-3, 1e-8)
    position = [np.array([5.0, 10.0, 10.0])]
    for k, gap in enumerate(gaps):
        angle = 0.5 * (-1) ** k
        step = np.array([np.cos(angle), np.sin(angle), 0.1 * k])
        position.append(position[-1] + (2 + gap) * step / np.linalg.norm(step))
    return np.array(position)


def star():
    """Six spheres around one, which comes last: every branch is eliminated before its root, so there is no
    fill.
    """
    arms = np.vstack([np.eye(3), -np.eye(3)]) * (2 + np.array([1e-7, 1e-3, 0.05, 1e-5, 1e-8, 0.1]))[:, None]
    return np.vstack([arms, np.zeros(3)]) + 20.0


@pytest.mark.parametrize("shape", [chain, star])
def test_factor_of_a_tree_is_exact(shape):
    """L D L^T without fill is complete on a tree numbered from the leaves: exact, to rounding times the
    condition.

    Rounding: eps / gap = 2e-8 at the smallest gap. Conjugate gradients need one iteration, two to clean up.
    """
    position = shape()
    near = near_field(position, 60.0, cutoff=2.5, at_cutoff="hard")
    assert len(near.factor.column) == len(position) - 1
    assert (near.factor.broken == 0).all()
    matrix = dense(near)
    inverse = np.linalg.inv(matrix)
    assert np.abs(factor_inverse(near) - inverse).max() <= 5e-8 * np.abs(inverse).max()
    load = np.random.default_rng(1).normal(size=(len(position), 6))
    velocity = np.zeros_like(load)
    goal = Goal(1e-10, 0.0, 2)
    conjugate_gradient(near.chunks, near.active, near.scalars, near.factor, no_clusters(), load, velocity, goal)
    assert energy_error(matrix, velocity, exact(matrix, load)) <= 1e-9


def test_factor_is_symmetric_positive_definite():
    """A preconditioner of conjugate gradients must be; (L D L^T)^-1 of a dense packing, symmetric to
    rounding.
    """
    position, edge = packing(60, 0.5, 3)
    near = near_field(position, edge)
    inverse = factor_inverse(near)
    assert np.abs(inverse - inverse.T).max() <= 1e-12 * np.abs(inverse).max()
    assert np.linalg.eigvalsh(0.5 * (inverse + inverse.T)).min() > 0.0
    assert (near.factor.broken == 0).all() and len(near.factor.column) > 100


def test_factor_agrees_with_the_matrix_on_its_pattern():
    """The defining property of a factorisation without fill: L D L^T = A on the diagonal and on the close
    pairs.
    """
    position, edge = packing(60, 0.5, 3)
    near = near_field(position, edge)
    product, matrix = np.linalg.inv(factor_inverse(near)), dense(near)
    start, column = near.factor.start, near.factor.column
    scale = np.abs(matrix).max()
    for i in range(60):
        for k in [i, *column[start[i] : start[i + 1]]]:
            rows, columns = slice(6 * i, 6 * i + 6), slice(6 * k, 6 * k + 6)
            assert np.abs(product[rows, columns] - matrix[rows, columns]).max() <= 1e-9 * scale


def test_block_jacobi_also_converges():
    """Without close pairs in the factor the solution is the same, with more iterations."""
    position, edge = packing(60, 0.5, 3)
    near, plain = near_field(position, edge), near_field(position, edge, close=0.0)
    load, start = near.strain_loads(SHEAR), np.zeros((60, 6))
    assert len(plain.factor.column) == 0
    a, b = (n.solve(load, start, 1e-10, 0.0, 2000) for n in (near, plain))
    assert energy_error(dense(near), a.velocity, b.velocity) <= 1e-8 and a.iterations < b.iterations


def ring_of_rings():
    """Twelve spheres around a middle one in a plane, a hexagonal lattice of unit distance: every ring is closed."""
    near = [np.array([np.cos(t), np.sin(t), 0.0]) for t in np.arange(6) * np.pi / 3]
    far = [a + b for a, b in zip(near, near[1:] + near[:1], strict=True)]
    return np.array([np.zeros(3), *near, *far])


@pytest.mark.parametrize("gap", [1e-5, 1e-8])
def test_clusters_with_rings(gap):
    """24 stiff pairs that close rings, among loose spheres: few iterations, and right forces, not only velocities.

    Thirteen spheres of a hexagonal lattice, all pairs at the same gap, under random loads, so that the normal forces
    k/h v_n are of order one with v_n of order h. Reference: dense solution with residuals in
    extended precision. Forces to FORCE_SHARE * tolerance of the drag norm. Without the exact clusters the dropped fill
    has the stiffness 1/h, and the iterations grow with the number of rings.
    """
    cluster = ring_of_rings() * (2.0 + gap) + 30.0
    rng = np.random.default_rng(3)
    loose = 60.0 * rng.random((20, 3)) * [1.0, 1.0, 0.3]
    position = np.vstack([cluster, loose[np.linalg.norm(loose[:, None] - cluster, axis=2).min(axis=1) > 2.2]])
    near = near_field(rng.permutation(position), 60.0)
    load = rng.normal(size=(len(position), 6))
    solution = near.solve(load, np.zeros_like(load), 1e-6, 0.0, 200)
    assert len(near.clusters.order) == 13 and solution.iterations <= 40
    truth = exact(dense(near), load)
    scale = np.sqrt(np.sum(own_drag(len(position)) * truth.reshape(-1) ** 2))
    assert energy_error(dense(near), solution.velocity, truth) <= 3e-6
    error = np.zeros_like(load)
    apply_rows(0, len(load), near.active, near.scalars, solution.velocity - truth, error)
    assert np.abs(error).max() <= 1e-4 * scale


def test_no_clusters_where_nothing_is_stiff():
    """Pairs wider than STIFF, or stiff pairs that share no sphere: nothing beside the incomplete factorisation."""
    apart = np.array([[5.0, 5, 5], [7.0 + 0.1 * STIFF, 5, 5], [5, 15, 5], [5, 17 + 0.1 * STIFF, 5], [15, 5, 5]])
    assert len(near_field(apart, 40.0).clusters.order) == 0
    position, edge = packing(60, 0.5, 3)
    assert near_field(position, edge).smallest > STIFF or len(near_field(position, edge).clusters.order) > 0
    assert len(near_field(apart, 40.0, threads=2).clusters.order) == 4  # two domains may cut a pair


def test_forces_of_a_pressed_pair_are_right_from_a_poor_start():
    """The energy of a start that is off by 1e-6 is small; the force of a pair at 1e-9 a is then off by hundreds.

    Two spheres pressed together by unit forces: the lubrication force between them is 1, less what their own drag
    carries (nothing: they do not move). To FORCE_SHARE * 1e-5 of the drag norm, here of the floor.
    """
    position = np.array([[5.0, 5, 5], [7.0 + 1e-9, 5, 5]])
    near = near_field(position, 40.0)
    load = np.zeros((2, 6))
    load[0, 0], load[1, 0] = 1.0, -1.0
    start = np.zeros((2, 6))
    start[0, 0] = 1e-6
    velocity = near.solve(load, start, 1e-5, 2e-4, 100).velocity
    force = np.zeros((2, 6))
    apply_rows(0, 2, near.active, near.scalars, velocity, force)
    assert force[0, 0] == pytest.approx(1.0, abs=2e-5) and force[1, 0] == pytest.approx(-1.0, abs=2e-5)
