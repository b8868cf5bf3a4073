"""The coupled solve of near and far field against dense linear algebra, with an independent dense mobility."""

from functools import cache

import numpy as np
import pytest
from naive import STRAIN, five, grand_near_field, loose_positions, part, separations
from naive_ewald import grand_mobility

from suspend.errors import NumericalError
from suspend.hydro.nearfield import NearField, pair_table
from suspend.hydro.neighbours import VerletList
from suspend.solvers import gmres
from suspend.solvers.coupled import CoupledSolver

EDGE, TILT, NUMBER, CUTOFF = 7.5, 0.23, 12, 4.0
SHEAR = np.array([[0, 0.5, 0], [0.5, 0, 0], [0, 0, 0]])


class DenseMobility:
    """A matrix behind the interface of `suspend.hydro.ewald.mobility.Mobility`."""

    def __init__(self, matrix):
        self.matrix = matrix

    def apply(self, loads):
        return (self.matrix @ loads.reshape(-1)).reshape(loads.shape)


@cache
def scene(gap=None):
    """Positions, mobility and near-field resistance (dense, 11N); `gap`: one pair brought to it."""
    position = loose_positions(NUMBER, EDGE, TILT, seed=4)
    if gap is not None:
        random = np.random.default_rng(0)
        while True:  # the last sphere to the gap from the first, clear of all others
            d = random.standard_normal(3)
            position[-1] = position[0] + d / np.linalg.norm(d) * (2.0 + gap)
            if sorted(np.linalg.norm(x[2]) for x in separations(position, EDGE, TILT, 2.5))[1] > 2.01:
                break
    return position, grand_mobility(position, EDGE, TILT), grand_near_field(position, EDGE, TILT, CUTOFF)


def near_field(position, drag=3.0, threads=1):
    near = NearField(pair_table(CUTOFF, "hard"), (drag, 4 / 3 * drag), threads)
    verlet = VerletList(EDGE, CUTOFF, 0.4)
    verlet.build(position, TILT, TILT)
    near.use_list(verlet.pairs, verlet.offset)
    near.assemble(position, EDGE, TILT)
    near.precondition(0.2)
    return near


def motion_and_strain(number):
    index = np.arange(11 * number).reshape(number, 11)
    return index[:, :6].reshape(-1), index[:, 6:].reshape(-1)


def dense_solution(mobility, resistance, external, strain_rate):
    """(U (N, 6), s (N, 5)) from (M^-1 + R) [U; -E] = [F_P; s_total] by elimination, R the near field.

    With loads x = [f; s] of the mobility: [U; -E] = M x, f = F_P + R_FE E - R_FU U; U and s are found from the
    dense system in the unknowns (U, s).
    """
    number = len(external)
    u, e = motion_and_strain(number)
    m, r = mobility, resistance[np.ix_(u, u)]
    strain = np.tile(five(strain_rate), number)
    b = external.reshape(-1) + resistance[np.ix_(u, e)] @ strain
    top = np.hstack([np.eye(6 * number) + m[np.ix_(u, u)] @ r, -m[np.ix_(u, e)]])
    bottom = np.hstack([-m[np.ix_(e, u)] @ r, m[np.ix_(e, e)]])
    right = np.concatenate([m[np.ix_(u, u)] @ b, -strain - m[np.ix_(e, u)] @ b])
    y = np.linalg.solve(np.vstack([top, bottom]), right)
    return y[: 6 * number].reshape(number, 6), y[6 * number :].reshape(number, 5)


def loads(near, external, strain_rate):
    return external + near.strain_loads(strain_rate)


def relative(a, b):
    return np.linalg.norm(a - b) / np.linalg.norm(b)


@pytest.mark.parametrize("tolerance", [1e-3, 1e-6, 1e-11])
def test_velocities_and_stresslets_match_the_dense_solution(tolerance):
    """Linear algebra: the error is the residual times the norm of the inverse of A, which is a few (the
    mobility's smallest eigenvalue is above 0.1 and R damps): 10 is allowed.
    """
    position, mobility, resistance = scene()
    external = np.random.default_rng(1).standard_normal((NUMBER, 6))
    near = near_field(position)
    solver = CoupledSolver(DenseMobility(mobility), near)
    found = solver.solve(loads(near, external, SHEAR), five(SHEAR), tolerance)
    u, s = dense_solution(mobility, resistance, external, SHEAR)
    assert found.residual <= tolerance
    assert relative(found.velocity, u) < 10 * tolerance + 1e-12
    assert relative(found.stresslet, s) < 10 * tolerance + 1e-12
    assert found.products == found.iterations + 1


def test_residual_is_the_true_one():
    """The reported residual must equal |[M_U x - U; -E - M_E x]| / |[U; E]| computed from its definition; the
    Arnoldi estimate agrees with it to round-off of the solution.
    """
    position, mobility, resistance = scene()
    near = near_field(position)
    load = loads(near, np.zeros((NUMBER, 6)), SHEAR)
    found = CoupledSolver(DenseMobility(mobility), near).solve(load, five(SHEAR), 1e-4)
    u, e = motion_and_strain(NUMBER)
    x = np.zeros(11 * NUMBER)
    x[u] = load.reshape(-1) - resistance[np.ix_(u, u)] @ found.velocity.reshape(-1)
    x[e] = found.stresslet.reshape(-1)
    moved = mobility @ x
    strain = np.tile(five(SHEAR), NUMBER)
    residual = np.concatenate([moved[u] - found.velocity.reshape(-1), -strain - moved[e]])
    size = np.sqrt(np.sum(found.velocity**2) + np.sum(strain**2))
    assert np.linalg.norm(residual) / size == pytest.approx(found.residual, rel=1e-6)


def test_touching_pair_spoils_nothing():
    """A gap of 1e-8 a makes loads of 1e8 from the flow; the velocities of all spheres must still be right to the
    tolerance, because the residual is in units of velocity (relative to the right-hand side it would not be).
    1e-5 x 10 for the inverse of A, 1e-6 for the conditioning of the dense reference itself.
    """
    position, mobility, resistance = scene(1e-8)
    near = near_field(position)
    zero = np.zeros((NUMBER, 6))
    found = CoupledSolver(DenseMobility(mobility), near).solve(loads(near, zero, SHEAR), five(SHEAR), 1e-5)
    u, s = dense_solution(mobility, resistance, zero, SHEAR)
    assert relative(found.velocity, u) < 1e-4
    assert relative(found.stresslet, s) < 1e-4
    assert found.iterations < 30


def test_start_from_the_solution_needs_one_product():
    """Warm start: at the solution only the residual is computed."""
    position, mobility, _ = scene()
    near = near_field(position)
    solver, load = CoupledSolver(DenseMobility(mobility), near), loads(near, np.zeros((NUMBER, 6)), SHEAR)
    first = solver.solve(load, five(SHEAR), 1e-9)
    again = solver.solve(load, five(SHEAR), 1e-8, start=first.guess)
    assert (again.iterations, again.products) == (0, 1)
    assert relative(again.velocity, first.velocity) < 1e-8


def test_restarts_reach_the_same_solution(monkeypatch):
    """GMRES restarted after five directions converges too, from the residual rebuilt without a product."""
    position, mobility, resistance = scene()
    near = near_field(position)
    monkeypatch.setattr(gmres, "RESTART", 5)
    load = loads(near, np.zeros((NUMBER, 6)), SHEAR)
    found = CoupledSolver(DenseMobility(mobility), near).solve(load, five(SHEAR), 1e-8)
    u, _ = dense_solution(mobility, resistance, np.zeros((NUMBER, 6)), SHEAR)
    assert found.iterations > 10
    assert relative(found.velocity, u) < 1e-7


def test_without_near_field():
    """R = 0: U = M_UF F + M_US s with M_ES s = -E - M_EF F, a dense solve."""
    _, mobility, _ = scene()
    external = np.random.default_rng(2).standard_normal((NUMBER, 6))
    found = CoupledSolver(DenseMobility(mobility), None, 0.9).solve(external, five(SHEAR), 1e-10)
    u, s = dense_solution(mobility, np.zeros_like(mobility), external, SHEAR)
    assert relative(found.velocity, u) < 1e-9
    assert relative(found.stresslet, s) < 1e-9


def test_drag_of_the_preconditioner_does_not_change_the_solution():
    """D only preconditions: solutions with 0.5 and 8 agree to the tolerance."""
    position, mobility, _ = scene()
    found = []
    for drag in (0.5, 8.0):
        near = near_field(position, drag)
        load = loads(near, np.zeros((NUMBER, 6)), SHEAR)
        found.append(CoupledSolver(DenseMobility(mobility), near).solve(load, five(SHEAR), 1e-10).velocity)
    assert relative(*found) < 1e-9


def test_nothing_to_do_and_the_floor():
    """No load and no flow: all zero, whatever the floor; a floor above the velocities relaxes the target."""
    position, mobility, _ = scene()
    near = near_field(position)
    solver = CoupledSolver(DenseMobility(mobility), near)
    still = solver.solve(np.zeros((NUMBER, 6)), np.zeros(5), 1e-6)
    assert not still.velocity.any() and not still.stresslet.any()
    external = 1e-6 * np.random.default_rng(3).standard_normal((NUMBER, 6))
    strict = solver.solve(external, np.zeros(5), 1e-6)
    loose = solver.solve(external, np.zeros(5), 1e-6, floor=1e-2)
    assert loose.products < strict.products


def test_the_limit_is_an_error():
    """Too few iterations: a NumericalError that names the residual, never a wrong answer."""
    position, mobility, _ = scene()
    near = near_field(position)
    solver = CoupledSolver(DenseMobility(mobility), near, limit=3)
    with pytest.raises(NumericalError, match="did not converge: residual"):
        solver.solve(loads(near, np.zeros((NUMBER, 6)), SHEAR), five(SHEAR), 1e-8)


def test_strain_loads_agree_with_the_twin():
    """The test's own set-up: R_FE : E of the kernel and of the dense twin."""
    position, _, resistance = scene()
    near = near_field(position)
    twin = part(resistance, [0, 1, 2, 3, 4, 5], STRAIN) @ np.tile(five(SHEAR), NUMBER)
    assert np.allclose(near.strain_loads(SHEAR).reshape(-1), twin, atol=1e-9)


def test_coarse_mobility_as_inner_preconditioner():
    """With a mobility of 1 % error inside, the outer iteration reaches the same solution with a few accurate products;
    each reduces the residual by about the coarse error (0.02 and 1 %), so 1e-9 takes at most seven.
    """
    position, mobility, resistance = scene()
    near = near_field(position)
    noise = np.random.default_rng(5).standard_normal(mobility.shape)
    coarse = mobility + 1e-2 * np.linalg.norm(mobility, 2) * (noise + noise.T) / np.linalg.norm(noise + noise.T, 2)
    solver = CoupledSolver(DenseMobility(mobility), near, coarse=DenseMobility(coarse))
    found = solver.solve(loads(near, np.zeros((NUMBER, 6)), SHEAR), five(SHEAR), 1e-9)
    u, s = dense_solution(mobility, resistance, np.zeros((NUMBER, 6)), SHEAR)
    assert relative(found.velocity, u) < 1e-8
    assert relative(found.stresslet, s) < 1e-8
    assert found.products <= 8 < found.coarse_products
