"""The real-space product of the far field against dense pair matrices in plain NumPy."""

import numpy as np
import pytest
from naive import loose_positions, separations
from scipy.special import spherical_jn

from suspend.core.ewald_functions import RadialTable
from suspend.hydro.ewald.real import RealPart
from suspend.hydro.neighbours import find_pairs
from suspend.hydro.two_sphere_matrices import pair_mobility_matrix

CUTOFF = 7.0
BY_SPHERE = np.r_[0:6, 12:17, 6:12, 17:22]


def free_space_table():
    """No wave part: the real functions are those of two spheres in an unbounded fluid."""
    return RadialTable(1.0 / CUTOFF, np.zeros((1, 8, 7)), CUTOFF)


def dense(position, edge, tilt):
    """Sum over pairs of the free-space FTS mobility, without self terms."""
    matrix = np.zeros((11 * len(position), 11 * len(position)))
    for i, j, d in separations(position, edge, tilt, CUTOFF):
        pair = pair_mobility_matrix(d)[np.ix_(BY_SPHERE, BY_SPHERE)]
        own = np.arange(11 * i, 11 * i + 11), np.arange(11 * j, 11 * j + 11)
        for a in range(2):
            rows, columns = own[a], own[1 - a]
            matrix[np.ix_(rows, columns)] += pair[11 * a : 11 * a + 11, 11 * (1 - a) : 22 - 11 * a]
    return matrix


def product(position, edge, tilt, loads, threads=1, reach=CUTOFF):
    part = RealPart(free_space_table(), (0.0, 0.0, 0.0), threads)
    part.use_list(*find_pairs(position, edge, tilt, reach))
    part.place(position, edge, tilt)
    result = np.zeros_like(loads)
    part.add(loads, result)
    return result


@pytest.mark.parametrize("number, edge, tilt", [(8, 6.8, 0.0), (5, 6.0, -0.4), (1, 4.0, 0.3), (20, 30.0, 0.5)])
def test_product_is_the_sum_over_pairs_and_images(number, edge, tilt):
    """Every pair and every own image (edge < cutoff) once, both spheres: to round-off of a few hundred terms."""
    position = loose_positions(number, edge, tilt, seed=1)
    loads = np.random.default_rng(2).standard_normal((number, 11))
    expected = dense(position, edge, tilt) @ loads.ravel()
    assert np.abs(product(position, edge, tilt, loads).ravel() - expected).max() < 1e-12


def test_a_longer_list_and_more_threads_change_nothing_but_the_order_of_the_sum():
    position = loose_positions(12, 9.0, 0.2, seed=3)
    loads = np.random.default_rng(4).standard_normal((12, 11))
    reference = product(position, 9.0, 0.2, loads)
    np.testing.assert_allclose(product(position, 9.0, 0.2, loads, reach=9.5), reference, atol=1e-13)
    np.testing.assert_allclose(product(position, 9.0, 0.2, loads, threads=3), reference, atol=1e-13)
    again = product(position, 9.0, 0.2, loads, threads=3)
    assert np.array_equal(again, product(position, 9.0, 0.2, loads, threads=3))


def test_self_terms_and_a_list_that_grows():
    """Without pairs the product is the self terms; arrays follow a list of more pairs and other spheres."""
    part = RealPart(free_space_table(), (1.0, 0.75, 0.9), 2)
    loads = np.ones((2, 11))
    for edge, pairs in ((40.0, 0), (8.0, 1)):
        position = np.array([[1.0, 1.0, 1.0], [4.0, 1.0, 1.0]]) if pairs else np.array([[1.0] * 3, [21.0] * 3])
        part.use_list(*find_pairs(position, edge, 0.0, CUTOFF))
        part.place(position, edge, 0.0)
        result = np.zeros((2, 11))
        part.add(loads, result)
        own = np.repeat([1.0, 0.75, 0.9], (3, 3, 5))
        expected = own + (dense(position, edge, 0.0) @ loads.ravel()).reshape(2, 11)
        np.testing.assert_allclose(result, expected, atol=1e-13)
        assert part.memory > 0
    position = loose_positions(6, 9.0, 0.0, seed=5)
    part.use_list(*find_pairs(position, 9.0, 0.0, CUTOFF))
    part.place(position, 9.0, 0.0)
    assert part.number_of_pairs == len(separations(position, 9.0, 0.0, CUTOFF))


def test_overlapping_pair_has_the_functions_of_its_form_factors():
    """At r < 2: U from F is (3/pi) int j0(k)^2 (...) dk, Faxen's form factor at both ends; quadrature to 1e-6."""
    r = 1.3
    position = np.array([[10.0, 10.0, 10.0], [10.0, 10.0, 10.0 + r]])
    nodes, weights = np.polynomial.legendre.leggauss(1500)
    k = 300.0 * (nodes + 1.0)
    weight = (3.0 / np.pi) * 300.0 * weights * spherical_jn(0, k) ** 2
    second = spherical_jn(1, k * r) / (k * r)
    across, along = weight @ (spherical_jn(0, k * r) - second), weight @ (2.0 * second)
    for component, expected in ((0, across), (2, along)):
        loads = np.zeros((2, 11))
        loads[0, component] = 1.0
        result = product(position, 40.0, 0.0, loads)
        assert result[1, component] == pytest.approx(expected, abs=1e-6)
