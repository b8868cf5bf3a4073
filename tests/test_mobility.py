"""The far-field mobility: matrix properties, closed forms, an independent sum, and the error it promises."""

import functools
import pathlib

import numpy as np
import pytest
from naive import loose_positions
from naive_ewald import grand_mobility

from suspend.box import edge_length
from suspend.core.cell import wrap_and_count
from suspend.errors import ConfigurationError
from suspend.hydro.ewald.mobility import Mobility
from suspend.hydro.ewald.parameters import choose_parameters
from suspend.hydro.neighbours import find_pairs
from suspend.packing import random_packing

DATA = pathlib.Path(__file__).parent / "data"


@functools.cache
def chosen(tolerance, number, edge):
    return choose_parameters(tolerance, number, edge)


def placed(position, edge, tilt, tolerance, threads=1, **by_hand):
    if by_hand:
        parameters = choose_parameters(tolerance, len(position), edge, **by_hand)
    else:
        parameters = chosen(tolerance, len(position), edge)
    mobility = Mobility(edge, len(position), parameters, threads)
    inside = np.array(position, dtype=float)
    wrap_and_count(inside, np.zeros(inside.shape, np.int32), edge, tilt)
    mobility.place(inside, tilt, *find_pairs(inside, edge, tilt, mobility.cutoff))
    return mobility


def relative(a, b):
    return np.linalg.norm(a - b) / np.linalg.norm(b)


@pytest.mark.parametrize("tilt", [-0.5, -0.2, 0.0, 0.35])
def test_matrix_is_symmetric_and_positive_definite(tilt):
    """The wave part is a Gram matrix, the real part symmetric by pair: to round-off at a loose tolerance too."""
    matrix = placed(loose_positions(8, 6.5, tilt, seed=1), 6.5, tilt, 1e-3).matrix()
    assert np.abs(matrix - matrix.T).max() < 1e-13
    assert np.linalg.eigvalsh(0.5 * (matrix + matrix.T)).min() > 0.05


@pytest.mark.parametrize("tilt", [0.0, 0.4])
def test_overlapping_spheres_stay_positive_definite(tilt):
    """Faxen's laws at both ends make the sum a Gram matrix for any positions; equal to the brute-force one."""
    position = np.random.default_rng(3).random((10, 3)) * 4.0
    matrix = placed(position, 4.0, tilt, 1e-8).matrix()
    assert np.linalg.eigvalsh(0.5 * (matrix + matrix.T)).min() > 0
    assert relative(matrix, grand_mobility(position, 4.0, tilt)) < 1e-8


def test_independent_of_the_split():
    """Kind of split, cutoff, grid and window are free: products agree to a few times the tolerance."""
    position = loose_positions(10, 9.0, 0.3, seed=2)
    loads = np.random.default_rng(1).standard_normal((10, 11))
    reference = placed(position, 9.0, 0.3, 1e-10).apply(loads)
    for by_hand in (
        {"cutoff": 4.5},
        {"cutoff": 13.0, "split": "pswf"},
        {"split": "gaussian", "window": "gaussian", "cutoff": 7.0},
        {"window": "kaiser-bessel", "support": 12},
        {"cutoff": 9.0, "grid": (27, 30, 28)},
    ):
        assert relative(placed(position, 9.0, 0.3, 1e-7, **by_hand).apply(loads), reference) < 2e-7


@pytest.mark.parametrize("phi", [1e-6, 0.027, 0.125, 0.343, 0.5])
def test_simple_cubic_lattice(phi):
    """U/F = 1 - 1.7601188844 phi^(1/3) + phi (Hasimoto 1959, exact at this level), Omega/T = 3/4 (1 - phi)."""
    edge = edge_length(1, phi)
    matrix = placed(np.array([[0.3, 0.1, 0.2]]), edge, 0.0, 1e-10).matrix()
    np.testing.assert_allclose(np.diag(matrix)[:3], 1 - 1.7601188844 * phi ** (1 / 3) + phi, atol=1e-9)
    np.testing.assert_allclose(np.diag(matrix)[3:6], 0.75 * (1 - phi), atol=1e-9)
    assert np.abs(matrix - np.diag(np.diag(matrix))).max() < 1e-9


def test_lone_sphere():
    """In a cell of 1000 a: 1 - 2.837297/L + (4 pi/3)/L^3, 3/4 and 9/10 but for the volume fraction."""
    edge = 1000.0
    diagonal = np.diag(placed(np.zeros((1, 3)), edge, 0.2, 1e-9).matrix())
    np.testing.assert_allclose(diagonal[3:], np.repeat([0.75, 0.9], (3, 5)), atol=1e-8)
    diagonal = np.diag(placed(np.zeros((1, 3)), edge, 0.0, 1e-9).matrix())
    np.testing.assert_allclose(diagonal[:3], 1 - 2.837297 / edge + 4 * np.pi / 3 / edge**3, atol=1e-8)


@pytest.mark.parametrize("phi", ["0.2", "0.4"])
def test_reference_scene(phi):
    """The grand mobility of an independent program, good to 1e-8 or better."""
    with np.load(DATA / f"rand_N8_phi{phi}.npz") as scene:
        matrix = placed(scene["pos"], float(scene["L"]), float(scene["shift"]) / float(scene["L"]), 1e-10).matrix()
        assert np.abs(matrix - scene["M_grand"]).max() < 1e-8


def test_wrapped_tilt():
    """Tilts 1/2 and -1/2 span the same lattice; positions outside the cell belong to the same scene."""
    position = loose_positions(9, 8.0, 0.5, seed=7)
    loads = np.random.default_rng(8).standard_normal((9, 11))
    reference = placed(position, 8.0, 0.5, 1e-9).apply(loads)
    moved = position + 8.0 * np.array([[1.0, 0.0, -1.0]] * 9)
    assert relative(placed(moved, 8.0, -0.5, 1e-9).apply(loads), reference) < 2e-9


def test_axes_permuted():
    """A cubic cell turned by x -> y -> z -> x turns forces, torques and velocities with it."""
    position = loose_positions(9, 8.0, 0.0, seed=9)
    loads = np.zeros((9, 11))
    loads[:, :6] = np.random.default_rng(8).standard_normal((9, 6))
    reference = placed(position, 8.0, 0.0, 1e-9).apply(loads)
    turn = [2, 0, 1]
    turned = placed(position[:, turn], 8.0, 0.0, 1e-9).apply(loads[:, [2, 0, 1, 5, 3, 4, 6, 7, 8, 9, 10]])
    assert relative(turned[:, :6], reference[:, [2, 0, 1, 5, 3, 4]]) < 2e-9


def test_mirrored_scene():
    """Mirrored in z: forces keep x and y, torques keep z only."""
    position = loose_positions(9, 8.0, 0.3, seed=10)
    loads = np.random.default_rng(8).standard_normal((9, 11))
    sign = np.array([1, 1, -1, -1, -1, 1, 1, 1, 1, -1, -1])
    reference = placed(position, 8.0, 0.3, 1e-9).apply(loads)
    mirrored = placed(position * [1, 1, -1], 8.0, 0.3, 1e-9).apply(loads * sign)
    assert relative(mirrored * sign, reference) < 2e-9


SCENES = [(8, 0.5, -0.5), (12, 0.3, 0.2), (20, 0.05, 0.5), (20, 1e-4, 0.0)]


@pytest.mark.parametrize("number, phi, tilt", SCENES)
def test_delivers_the_tolerance_and_wastes_less_than_a_digit(number, phi, tilt):
    """Relative 2-norm of the error for random unit loads against the brute-force sum: in [tolerance/10, tolerance]."""
    edge = edge_length(number, phi)
    position = random_packing(number, phi, 1e-3, 4).positions
    loads = np.random.default_rng(6).standard_normal((number, 11))
    tight = placed(position, edge, tilt, 1e-10)
    reference = tight.apply(loads)
    if edge < 20.0:  # the brute-force sum's modes grow as the volume
        brute = grand_mobility(position, edge, tilt) @ loads.ravel()
        assert relative(reference.ravel(), brute) < 1e-10
        reference = brute.reshape(-1, 11)
    for tolerance in (1e-2, 1e-3, 1e-6, 1e-9):
        error = relative(placed(position, edge, tilt, tolerance).apply(loads), reference)
        assert 0.1 * tolerance <= error <= tolerance, tolerance


def test_delivers_the_tolerance_for_many_spheres():
    """Against the product at a tolerance 10^4 times tighter; sheared cell."""
    packing = random_packing(300, 0.4, 1e-3, 2)
    loads = np.random.default_rng(6).standard_normal((300, 11))
    reference = placed(packing.positions, packing.length, 0.4, 1e-9).apply(loads)
    for tolerance in (1e-2, 1e-3, 1e-5):
        error = relative(placed(packing.positions, packing.length, 0.4, tolerance).apply(loads), reference)
        assert 0.1 * tolerance <= error <= tolerance


def test_one_and_two_spheres_never_exceed_the_tolerance():
    """With few images the error scatters about its prediction; it is kept below the tolerance at every tilt."""
    for number, phi in ((1, 0.5), (1, 1e-3), (2, 0.3)):
        edge = edge_length(number, phi)
        position = loose_positions(number, edge, 0.0, seed=5)
        loads = np.random.default_rng(6).standard_normal((number, 11))
        for tilt in (0.0, -0.5):
            reference = placed(position, edge, tilt, 1e-10).apply(loads)
            for tolerance in (1e-2, 1e-6):
                assert relative(placed(position, edge, tilt, tolerance).apply(loads), reference) <= tolerance


def test_threads_change_the_last_digits_only():
    position = loose_positions(30, 14.0, 0.1, seed=11)
    loads = np.random.default_rng(1).standard_normal((30, 11))
    one, three = (placed(position, 14.0, 0.1, 1e-4, threads=t).apply(loads) for t in (1, 3))
    np.testing.assert_allclose(three, one, atol=1e-13)


@pytest.mark.parametrize(
    "tolerance, number, edge, words",
    [
        (1e-11, 8, 6.0, "round-off"),
        (0.1, 8, 6.0, "tolerance"),
        (1e-3, 1, 1.9, "own image"),
        (1e-3, 0, 6.0, "spheres"),
        (1e-3, 8, float("nan"), "edge"),
    ],
)
def test_refuses_what_cannot_be(tolerance, number, edge, words):
    with pytest.raises(ConfigurationError, match=words):
        choose_parameters(tolerance, number, edge)


def test_refuses_a_grid_too_coarse_for_the_tolerance():
    with pytest.raises(ConfigurationError, match="grid"):
        choose_parameters(1e-6, 50, 12.0, grid=(20, 24, 20), support=4)


def test_refuses_positions_of_another_scene():
    mobility = placed(loose_positions(4, 8.0, 0.0, seed=1), 8.0, 0.0, 1e-2)
    with pytest.raises(ConfigurationError, match="made for 4"):
        mobility.place(np.zeros((5, 3)), 0.0, *find_pairs(np.zeros((5, 3)), 8.0, 0.0, 3.0))


@pytest.mark.parametrize("tilt", [0.0, -0.4])
def test_supercell_of_eight_copies(tilt):
    """Eight copies of a scene in a cell of twice the edge carry the same loads and get the same velocities: k = 0
    of the small cell and every image are counted alike. Two sums of 1e-9 each.
    """
    edge, tolerance = 6.0, 1e-9
    random = np.random.default_rng(11)
    vectors = edge * np.array([[1, 0, 0], [tilt, 1, 0], [0, 0, 1]])
    position = random.random((4, 3)) @ vectors
    shifts = np.array([(a, b, c) for a in (0, 1) for b in (0, 1) for c in (0, 1)]) @ vectors
    loads = random.standard_normal((4, 11))
    one = placed(position, edge, tilt, tolerance).apply(loads)
    copies = np.concatenate([position + s for s in shifts])
    many = placed(copies, 2 * edge, tilt, tolerance).apply(np.tile(loads, (8, 1)))
    assert np.linalg.norm(many - np.tile(one, (8, 1))) < 4 * tolerance * np.linalg.norm(many)


LARGE_CELLS = [(1, 1e3), (3, 440.0), (3, 1e3), (16, 1e3), (20, 1e4), (3, 1e4), (3, 1e6)]


@pytest.mark.parametrize("number, edge", LARGE_CELLS)
def test_large_cells_meet_the_tolerance_on_small_grids(number, edge):
    """Few spheres far apart: the error stays below the tolerance, and a looser one never takes a larger grid."""
    position = np.random.default_rng(3).random((number, 3)) * edge
    loads = np.random.default_rng(6).standard_normal((number, 11))
    reference = placed(position, edge, 0.3, 1e-10).apply(loads)
    largest = np.prod(chosen(1e-10, number, edge).grid)
    for tolerance in (1e-2, 1e-3, 1e-6):
        assert relative(placed(position, edge, 0.3, tolerance).apply(loads), reference) <= tolerance
        assert np.prod(chosen(tolerance, number, edge).grid) <= largest


def test_close_spheres_in_a_large_cell_meet_the_tolerance():
    """A cluster in a cell of 1000 a, where the loose tolerances take a sum that is better than asked for."""
    position = loose_positions(5, 6.0, 0.0, seed=5) + 300.0
    loads = np.random.default_rng(6).standard_normal((5, 11))
    reference = placed(position, 1e3, 0.3, 1e-10).apply(loads)
    for tolerance in (1e-2, 1e-3):
        assert relative(placed(position, 1e3, 0.3, tolerance).apply(loads), reference) <= tolerance


def test_refuses_cells_that_cannot_be_computed():
    """A cell whose positions are not resolved, and a cutoff by hand that would need a grid beyond any memory."""
    with pytest.raises(ConfigurationError, match="far_field: self"):
        choose_parameters(1e-3, 3, 1e13)
    with pytest.raises(ConfigurationError, match=r"ewald\.cutoff"):
        choose_parameters(1e-3, 3, 1e6, cutoff=4.0)
    with pytest.raises(ConfigurationError, match="no optimal split"):
        choose_parameters(1e-9, 30, 10.0, cutoff=2.05)
