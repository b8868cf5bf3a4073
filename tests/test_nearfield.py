"""Near-field kernels against the dense NumPy twin, symmetries, contact theory and independently computed
scenes.
"""

from pathlib import Path

import naive
import numpy as np
import pytest

from suspend.conventions import ROTATIONAL_DRAG
from suspend.errors import ConfigurationError
from suspend.hydro.nearfield import NearField, pair_table
from suspend.hydro.neighbours import VerletList

DATA = Path(__file__).parent / "data"
RANDOM_E = np.array([[0.3, 0.5, -0.2], [0.5, -0.7, 0.1], [-0.2, 0.1, 0.4]])
SHEAR = np.array([[0, 0.5, 0], [0.5, 0, 0], [0, 0, 0]])
SCENES = [  # number, edge, tilt, cutoff, at the cutoff
    (1, 2.7, 0.3, 4.0, "hard"),  # only images of itself
    (2, 4.3, -0.5, 4.0, "shifted"),  # 2 cutoff > L: several images of one pair
    (9, 6.5, 0.41, 4.0, "hard"),
    (9, 6.5, -0.2, 4.0, "shifted"),
    (30, 11.0, 0.13, 3.2, "shifted"),
]


def near_field(position, edge, tilt=0.0, cutoff=4.0, at_cutoff="hard", threads=1, **more):
    """Assembled near field; also returns nothing that is not in it."""
    near = NearField(pair_table(cutoff, at_cutoff, **more), (1.0, ROTATIONAL_DRAG), threads)
    verlet = VerletList(edge, cutoff, 0.4)
    verlet.build(position, 0.0, tilt)
    near.use_list(verlet.pairs, verlet.offset)
    near.smallest = near.assemble(position, edge, tilt)
    return near


def resistance(near):
    """R_FU of the near field alone, (6N, 6N), column by column through the product kernel."""
    from suspend.core.pairs import apply_rows

    number = near.offset.shape[0] - 1
    columns = []
    for unit in np.eye(6 * number):
        load = np.zeros((number, 6))
        apply_rows(0, number, near.active, near.scalars, unit.reshape(number, 6), load)
        columns.append(load.reshape(-1))
    return np.array(columns).T


def six(tensor):
    return naive.voigt(tensor)


@pytest.fixture(params=SCENES, ids=lambda s: f"N{s[0]}_L{s[1]}_tilt{s[2]}_{s[4]}")
def scene(request):
    number, edge, tilt, cutoff, at_cutoff = request.param
    position = naive.loose_positions(number, edge, tilt, seed=number)
    near = near_field(position, edge, tilt, cutoff, at_cutoff)
    return near, naive.grand_near_field(position, edge, tilt, cutoff, at_cutoff), position


def test_resistance_is_that_of_the_twin(scene):
    """The product kernel is the sum of the pairs' 22 x 22 matrices; the same table, so only rounding
    (1e-10).
    """
    near, matrix, _ = scene
    expected = naive.part(matrix, naive.MOTION, naive.MOTION)
    assert np.abs(resistance(near) - expected).max() <= 1e-10 * np.abs(expected).max()


def test_resistance_is_symmetric_and_positive(scene):
    """Reciprocity: R_FU is symmetric to rounding. Dissipation: no motion gains from the near field,
    eigenvalues >= 0.

    The exact pair dissipates more than the pair at the FTS level does (minimum dissipation under fewer
    constraints),
    so each pair's excess is positive semi-definite, shifted or not (the excess grows as the gap closes).
    """
    matrix = resistance(scene[0])
    assert np.abs(matrix - matrix.T).max() <= 1e-13 * np.abs(matrix).max()
    assert np.linalg.eigvalsh(matrix).min() >= -1e-13 * np.abs(matrix).max()


def test_strain_loads_are_those_of_the_twin(scene):
    """R_FE : E for a general traceless E; rounding (1e-10 of the largest load)."""
    near, matrix, _ = scene
    expected = naive.strain_loads(matrix, RANDOM_E)
    assert np.abs(near.strain_loads(RANDOM_E) - expected).max() <= 1e-10 * max(np.abs(expected).max(), 1e-3)


def test_stresslet_is_that_of_the_twin(scene):
    """Sum over spheres of -R_SU U' + R_SE E, Brady's sign, for random velocities; rounding (1e-10)."""
    near, matrix, position = scene
    velocity = np.random.default_rng(5).normal(size=(len(position), 6))
    for u, e in ((velocity, 0 * RANDOM_E), (0 * velocity, RANDOM_E), (velocity, RANDOM_E)):
        expected = six(naive.stresslets(matrix, u, e).sum(axis=0))
        assert np.abs(near.stresslet(u, e) - expected).max() <= 1e-10 * max(np.abs(expected).max(), 1e-3)
        assert abs(near.stresslet(u, e)[:3].sum()) <= 1e-12 * max(np.abs(expected).max(), 1.0)  # traceless


def test_preconditioner_diagonal_is_that_of_the_matrix(scene):
    """Block Jacobi (no close pairs): applying it is the inverse of the 6 x 6 diagonal blocks, images
    included.
    """
    from suspend.solvers.incomplete import diagonal_blocks

    near, matrix, position = scene
    number = len(position)
    block = np.empty((number, 6, 6))
    diagonal_blocks(near.active, near.scalars, 1.0, ROTATIONAL_DRAG, block)
    expected = naive.part(matrix, naive.MOTION, naive.MOTION)
    for i in range(number):
        own = expected[6 * i : 6 * i + 6, 6 * i : 6 * i + 6] + np.diag([1.0] * 3 + [ROTATIONAL_DRAG] * 3)
        assert np.abs(block[i] - own).max() <= 1e-10 * np.abs(expected).max()


def test_tilt_and_image_do_not_matter():
    """Tilts that differ by an integer and positions that differ by cell vectors are the same suspension."""
    edge, tilt = 6.5, 0.5
    position = naive.loose_positions(9, edge, tilt, seed=4)
    velocity = np.random.default_rng(1).normal(size=(9, 6))
    first = near_field(position, edge, tilt)
    shifted = position + np.random.default_rng(2).integers(-2, 3, (9, 3)) @ naive.lattice(edge, tilt)
    for second in (near_field(position, edge, tilt - 1), near_field(shifted, edge, tilt + 2)):
        assert np.allclose(resistance(second), resistance(first), rtol=0, atol=1e-10)
        assert np.allclose(second.strain_loads(SHEAR), first.strain_loads(SHEAR), rtol=0, atol=1e-11)
        assert np.allclose(second.stresslet(velocity, SHEAR), first.stresslet(velocity, SHEAR), rtol=0,
        atol=1e-10)


def test_numbering_does_not_matter():
    """Renumbered spheres: loads come renumbered, the summed stresslet unchanged, to rounding."""
    edge, position = 6.5, naive.loose_positions(9, 6.5, 0.2, seed=6)
    velocity = np.random.default_rng(1).normal(size=(9, 6))
    order = np.random.default_rng(2).permutation(9)
    first, second = near_field(position, edge, 0.2), near_field(position[order], edge, 0.2)
    index = (6 * order[:, None] + np.arange(6)).reshape(-1)
    assert np.allclose(resistance(second), resistance(first)[np.ix_(index, index)], rtol=0, atol=1e-11)
    assert np.allclose(second.strain_loads(SHEAR), first.strain_loads(SHEAR)[order], rtol=0, atol=1e-12)
    assert np.allclose(
        second.stresslet(velocity[order], SHEAR), first.stresslet(velocity, SHEAR), rtol=0, atol=1e-11
    )


def test_rotation_by_ninety_degrees():
    """The cubic lattice turned about z with E and U: loads and stresslet turn along (isotropy of the
    fluid).
    """
    edge, turn = 6.5, np.array([[0, -1.0, 0], [1, 0, 0], [0, 0, 1]])
    position = naive.loose_positions(9, edge, 0.0, seed=8)
    velocity = np.random.default_rng(1).normal(size=(9, 6))
    turned = np.hstack([velocity[:, :3] @ turn.T, velocity[:, 3:] @ turn.T])
    e2 = turn @ RANDOM_E @ turn.T
    first, second = near_field(position, edge), near_field(position @ turn.T, edge)
    load, load2 = first.strain_loads(RANDOM_E), second.strain_loads(e2)
    assert np.allclose(load2[:, :3], load[:, :3] @ turn.T, rtol=0, atol=1e-11)
    assert np.allclose(load2[:, 3:], load[:, 3:] @ turn.T, rtol=0, atol=1e-11)
    s = first.stresslet(velocity, RANDOM_E)
    tensor = np.array([[s[0], s[3], s[4]], [s[3], s[1], s[5]], [s[4], s[5], s[2]]])
    assert np.allclose(second.stresslet(turned, e2), six(turn @ tensor @ turn.T), rtol=0, atol=1e-10)


def pair_at(gap, direction=(1.0, 2.0, -2.0)):
    """A pair in a cell so large that it has no images within the cutoff; returns the near field and e."""
    e = np.array(direction) / np.linalg.norm(direction)
    return near_field(np.array([[20.0, 20, 20], 20.0 + (2 + gap) * e]), 40.0), e


def test_isolated_pair_obeys_action_and_reaction():
    """Approach along the line of centres: F_1 = -F_2 along e, no torque (axisymmetry); one pair in the
    list.
    """
    near, e = pair_at(0.01)
    assert len(near.pairs) == 1 and near.smallest == pytest.approx(0.01, abs=1e-13)
    load = resistance(near) @ np.concatenate([e, np.zeros(3), -e, np.zeros(3)])
    assert np.allclose(load[:3], -load[6:9], atol=1e-10) and np.allclose(np.cross(load[:3], e), 0, atol=1e-10)
    assert np.allclose(load[[3, 4, 5, 9, 10, 11]], 0, atol=1e-10)


def test_squeeze_and_shear_limits():
    """Lubrication theory: squeezing F xi -> 1/2 + (9/20) xi ln(1/xi) for U = +-e; sliding grows by (1/3)
    ln(1/xi).

    What is left is O(1) and O(xi ln xi) of the force: tolerances 3 xi and 1e-3.
    """
    xi = 1e-6
    near, e = pair_at(xi, (0, 0, 1))
    matrix = resistance(near)
    squeeze = np.concatenate([e, np.zeros(3), -e, np.zeros(3)])
    force = (matrix @ squeeze)[:3] @ e
    gap = near.smallest
    assert force * gap == pytest.approx(0.5 + 0.45 * gap * np.log(1 / gap), abs=3 * gap)
    slide = np.array([1.0, 0, 0, 0, 0, 0, -1.0, 0, 0, 0, 0, 0])
    wider = resistance(pair_at(1e-4, (0, 0, 1))[0])
    assert (matrix @ slide - wider @ slide)[0] == pytest.approx(np.log(1e-4 / gap) / 3, abs=1e-3)


def test_rigid_motion_is_not_resisted_at_contact():
    """A rigid pair has no relative motion at contact: its near-field load stays bounded, without xi^-1 or
    ln xi.

    The load may change by O(xi ln xi) between gaps of 1e-4 and 1e-6 (and the lever arm by xi): below 1e-2.
    """
    loads = []
    for xi in (1e-4, 1e-6):
        near, e = pair_at(xi)
        spin, drift = np.array([0.3, -1.0, 0.7]), np.array([1.0, 0.5, -0.2])
        arm = 0.5 * (2 + xi) * np.cross(spin, e)
        loads.append(resistance(near) @ np.concatenate([drift - arm, spin, drift + arm, spin]))
    assert np.abs(loads[1] - loads[0]).max() < 1e-2


def test_uniform_translation_of_a_lattice():
    """A sphere and its images, no relative motion along with the cell: only the even functions A+, C+ and
    G- enter.

    Symmetry of the cubic lattice: R_FU is isotropic, F from U is a multiple of one, and no torque comes from
    U.
    """
    near = near_field(np.array([[0.3, 0.2, 0.1]]), 2.3)
    matrix = resistance(near)
    assert np.allclose(matrix[:3, :3], matrix[0, 0] * np.eye(3), atol=1e-12)
    assert np.allclose(matrix[3:, 3:], matrix[3, 3] * np.eye(3), atol=1e-12)
    assert np.allclose(matrix[:3, 3:], 0, atol=1e-12)
    assert np.allclose(near.strain_loads(RANDOM_E), 0, atol=1e-12)


def test_shifted_differs_from_hard_by_the_value_at_the_cutoff():
    """Shifted functions vanish at the cutoff; at contact the difference stays what it is at the cutoff."""
    e = np.array([[20.0, 20, 20], [20.0, 20, 20]])
    e[1, 0] += 4.0 - 1e-9
    at = resistance(near_field(e, 40.0, at_cutoff="shifted"))
    value = resistance(near_field(e, 40.0))
    assert np.abs(at).max() < 1e-9 and np.abs(value).max() > 1e-4
    e[1, 0] = 22.001
    difference = resistance(near_field(e, 40.0)) - resistance(near_field(e, 40.0, at_cutoff="shifted"))
    assert np.allclose(difference, value, rtol=0, atol=1e-9)


def test_tapered_is_shifted_inside_and_smooth_at_the_cutoff():
    """The taper leaves the first nine tenths of the range alone and ends in zero like (cutoff - r)^4."""
    e = np.array([[20.0, 20, 20], [23.0, 20, 20]])
    assert np.array_equal(
        resistance(near_field(e, 40.0, at_cutoff="tapered")), resistance(near_field(e, 40.0,
        at_cutoff="shifted"))
    )
    size = []
    for distance in (1e-2, 5e-3):
        e[1, 0] = 24.0 - distance
        size.append(np.abs(resistance(near_field(e, 40.0, at_cutoff="tapered"))).max())
    assert size[0] / size[1] == pytest.approx(16.0, rel=0.1)


def test_frozen_functions_below_a_gap():
    """`frozen` holds the functions at their value at that gap: the same resistance at any smaller gap,
    overlap too.
    """
    e = np.array([[20.0, 20, 20], [22.01, 20, 20]])
    held = resistance(near_field(e, 40.0))
    for gap in (1e-3, 1e-7, -1e-3):
        e[1, 0] = 22.0 + gap
        assert np.allclose(resistance(near_field(e, 40.0, frozen=0.01)), held, rtol=1e-11, atol=1e-11)


def test_overlap_is_reported():
    """Without frozen functions an overlap is returned as a gap <= 0, never evaluated."""
    e = np.array([[20.0, 20, 20], [21.99, 20, 20]])
    assert near_field(e, 40.0).smallest == pytest.approx(-0.01, abs=1e-12)


def test_no_pairs():
    """A lone sphere in a large cell: no near field, an infinite gap."""
    near = near_field(np.array([[1.0, 1, 1]]), 20.0)
    assert near.smallest == np.inf and not resistance(near).any() and not near.strain_loads(SHEAR).any()


@pytest.mark.parametrize("cutoff", [2.0, 1.0, 9.0, np.nan])
def test_cutoff_outside_the_table_is_refused(cutoff):
    """Only 2 < cutoff <= 2 + the table's largest gap has values."""
    with pytest.raises(ConfigurationError, match=r"lubrication\.cutoff"):
        pair_table(cutoff)


def test_number_of_threads_does_not_matter():
    """Two parts instead of one change the order of sums only (1e-13), the solution within its tolerance."""
    edge, position = 11.0, naive.loose_positions(30, 11.0, 0.13, seed=30)
    velocity = np.random.default_rng(1).normal(size=(30, 6))
    one, two = (near_field(position, edge, 0.13, threads=k) for k in (1, 2))
    assert len(two.chunks) == 3 and one.smallest == two.smallest
    for a, b in (
        (one.strain_loads(SHEAR), two.strain_loads(SHEAR)),
        (one.stresslet(velocity, SHEAR), two.stresslet(velocity, SHEAR)),
    ):
        assert np.abs(a - b).max() <= 1e-13 * np.abs(a).max()
    solutions = []
    for near in (one, two):
        near.precondition(0.2)
        solutions.append(near.solve(near.strain_loads(SHEAR), np.zeros((30, 6)), 1e-13, 1e-4, 500).velocity)
    assert np.abs(solutions[0] - solutions[1]).max() <= 1e-11


def grand_resistance(data):
    position, edge = data["pos"], float(data["L"])
    return np.linalg.inv(data["M_grand"]) + naive.grand_near_field(position, edge, 0.0, 4.0)


@pytest.mark.parametrize("name", ["pair_xi1e-02", "rand_N8_phi0.2", "rand_N8_phi0.4"])
def test_independently_computed_scenes(name):
    """[F T S] = (M_far^-1 + R_nf) [U W -E] with all images, r < 4, against another code's solution of the
    same scene.

    The two-sphere functions of either are good to 5e-8: tolerance 1e-7 on velocities and stresslets of order
    1.
    """
    data = np.load(DATA / f"{name}.npz")
    grand, number = grand_resistance(data), len(data["pos"])
    fu, fs = naive.part(grand, naive.MOTION, naive.MOTION), naive.part(grand, naive.MOTION, naive.STRAIN)
    loads = np.hstack([data["F"], np.zeros_like(data["F"])]).reshape(-1)
    forced = np.linalg.solve(fu, loads).reshape(number, 6)
    sheared = np.linalg.solve(fu, fs @ np.tile(naive.five(SHEAR), number)).reshape(number, 6)
    for kind, velocity, strain_rate in (("mob", forced, 0 * SHEAR), ("shear", sheared, SHEAR)):
        stresslet = -naive.stresslets(grand, velocity, strain_rate)  # theirs are exerted on the fluid
        scale = max(1.0, np.abs(stresslet).max())
        assert np.abs(velocity[:, :3] - data[f"lubx_{kind}_U"]).max() <= 1e-7
        assert np.abs(velocity[:, 3:] - data[f"lubx_{kind}_O"]).max() <= 1e-7
        assert np.abs(stresslet - data[f"lubx_{kind}_S"]).max() <= 1e-7 * scale


@pytest.mark.parametrize("name", ["rand_N8_phi0.2", "rand_N8_phi0.4"])
def test_kernels_in_independently_computed_scenes(name):
    """The kernels in place of the dense twin: shear velocities and the summed stresslet (1e-7, as above)."""
    data = np.load(DATA / f"{name}.npz")
    far, position = np.linalg.inv(data["M_grand"]), data["pos"]
    number, near = len(position), near_field(position, float(data["L"]))
    matrix = naive.part(far, naive.MOTION, naive.MOTION) + resistance(near)
    load = naive.strain_loads(far, SHEAR) + near.strain_loads(SHEAR)
    velocity = np.linalg.solve(matrix, load.reshape(-1)).reshape(number, 6)
    assert np.abs(velocity[:, :3] - data["lubx_shear_U"]).max() <= 1e-7
    total = six(naive.stresslets(far, velocity, SHEAR).sum(axis=0)) + near.stresslet(velocity, SHEAR)
    assert np.abs(total + six(data["lubx_shear_S"].sum(axis=0))).max() <= 1e-7 * number
