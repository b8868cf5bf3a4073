"""Pairs, contact value and bond order against plain-NumPy twins, perfect lattices and random points."""

from __future__ import annotations

import itertools
import math

import numpy as np
import pytest

from suspend.bonds import sixth_harmonics
from suspend.box import cell_vectors, wrap
from suspend.structure import bond_order, contact_value, pairs_within, smallest_distance


def naive_distances(positions, length, reach, tilt):
    """Sorted distances of all directed pairs and images within reach, by three loops."""
    vectors = cell_vectors(length, tilt)
    layers = range(-math.ceil(2 * reach / length) - 2, math.ceil(2 * reach / length) + 3)
    found = []
    for i, j in itertools.product(range(len(positions)), repeat=2):
        for image in itertools.product(layers, repeat=3):
            r = np.linalg.norm(positions[j] - positions[i] + np.array(image) @ vectors)
            if r <= reach and not (i == j and image == (0, 0, 0)):
                found.append(r)
    return np.sort(found)


def lattice(basis, cells, edge):
    corners = np.array(list(np.ndindex(cells, cells, cells)), dtype=float)
    return np.concatenate([corners + offset for offset in basis]) * edge, cells * edge


SC = [(0.0, 0.0, 0.0)]
BCC = [*SC, (0.5, 0.5, 0.5)]
FCC = [*SC, (0.5, 0.5, 0.0), (0.5, 0.0, 0.5), (0.0, 0.5, 0.5)]


@pytest.mark.parametrize("tilt", [0.0, 0.37, -0.5])
@pytest.mark.parametrize(("length", "reach"), [(4.0, 1.9), (3.0, 4.4)])
def test_pairs_are_those_of_three_loops(tilt, length, reach):
    """Every pair and image in reach is found once, also a sphere's own and for reach > L/2 (round-off)."""
    positions = np.random.default_rng(3).random((6, 3)) * 3 * length - length
    pairs = pairs_within(positions, length, reach, tilt)
    expected = naive_distances(positions, length, reach, tilt)
    assert len(pairs.distance) == len(expected)
    np.testing.assert_allclose(np.sort(pairs.distance), expected, rtol=0, atol=1e-13)
    np.testing.assert_allclose(np.linalg.norm(pairs.vector, axis=1), pairs.distance, rtol=1e-14)
    vectors = cell_vectors(length, tilt)
    shift = (pairs.vector - positions[pairs.second] + positions[pairs.first]) @ np.linalg.inv(vectors)
    np.testing.assert_allclose(shift, np.rint(shift), atol=1e-12)


def test_wrap_moves_by_lattice_vectors_into_the_cell():
    """Fractions end in [0, 1), the moves are whole cell vectors; -1e-17 must not round up to L."""
    x = np.random.default_rng(1).normal(size=(200, 3)) * 20.0
    x[:3] = [[-1e-17, 0.0, 0.0], [0.0, -1e-17, 0.0], [0.0, 0.0, -1e-17]]
    for tilt in (0.0, 0.3, -0.5):
        inside = wrap(x, 5.0, tilt)
        inverse = np.linalg.inv(cell_vectors(5.0, tilt))
        fractions, moved = inside @ inverse, (inside - x) @ inverse
        assert fractions.min() > -1e-14
        assert fractions.max() < 1.0 + 1e-14
        assert inside[:, 1:].max() < 5.0
        np.testing.assert_allclose(moved, np.rint(moved), atol=1e-12)


def test_sixth_harmonics_obey_the_addition_theorem():
    """The product of two rows is the Legendre polynomial P6 of the angle between them (round-off)."""
    v = np.random.default_rng(2).normal(size=(40, 3))
    u = v / np.linalg.norm(v, axis=1, keepdims=True)
    h = sixth_harmonics(v)
    expected = np.polynomial.legendre.legval(u @ u.T, [0, 0, 0, 0, 0, 0, 1])
    np.testing.assert_allclose(h @ h.T, expected, atol=1e-13)


@pytest.mark.parametrize(
    ("basis", "edge", "reach", "expected"),
    [(SC, 2.0, 2.2, 0.353553), (BCC, 4 / 3**0.5, 2.2, 0.628539), (FCC, 8**0.5, 2.8, 0.574524)],
)
def test_bond_order_of_perfect_lattices(basis, edge, reach, expected):
    """Nearest-neighbour Q6 of sc, bcc, fcc (Steinhardt et al. 1983), the same when the lattice is read in a
    cell with tilt 1, and with the axes exchanged; six digits are known.
    """
    positions, length = lattice(basis, 4, edge)
    for tilt in (0.0, 1.0):
        order = bond_order(positions, length, tilt, reach)
        assert order.global_q6 == pytest.approx(expected, abs=1e-6)
        assert order.local_q6 == pytest.approx(expected, abs=1e-6)
    turned = bond_order(positions[:, [2, 0, 1]], length, 0.0, reach)
    assert turned.global_q6 == pytest.approx(expected, abs=1e-6)


def test_crystal_fraction_sees_differently_oriented_crystallites():
    """Two fcc grains, one turned by 45 degrees: the global Q6 drops, the crystalline share stays near one."""
    positions, length = lattice(FCC, 6, 8**0.5 * 1.05)
    assert bond_order(positions, length).crystal_fraction == 1.0
    c = math.sqrt(0.5)
    centred = positions - length / 2
    grains = []
    for centre, turn in ((0.25, np.eye(3)), (0.75, np.array([[c, c, 0.0], [-c, c, 0.0], [0.0, 0.0, 1.0]]))):
        grain = centred @ turn
        grain = grain[np.all(np.abs(grain) < 0.2 * length, axis=1)]
        grains.append(grain + np.array([centre, 0.5, 0.5]) * length)
    grains = np.concatenate(grains)
    order = bond_order(grains, length)
    alone = bond_order(grains[grains[:, 0] < length / 2], length)
    assert order.global_q6 < 0.85 * alone.global_q6
    assert order.crystal_fraction == pytest.approx(alone.crystal_fraction, abs=0.1)


def test_bond_order_of_random_points_falls_with_the_number_of_bonds():
    """Independent directions: <Q6^2> = 1/bonds, Q6^2 is chi-squared with 13 degrees of freedom; 4 sigma."""
    rng = np.random.default_rng(5)
    samples = 150
    ratios = []
    for _ in range(samples):
        order = bond_order(rng.random((200, 3)) * 12.0, 12.0, reach=1.5)
        ratios.append(order.global_q6**2 * order.bonds)
    assert np.mean(ratios) == pytest.approx(1.0, abs=4 * math.sqrt(2 / 13 / samples))


def test_contact_value_of_an_ideal_gas_is_one_within_its_error():
    """Random points have g = 1 at any distance; the reported error must be the scatter over samples.

    40 samples: the mean within 4 standard errors, the scatter within 45 % (4 sigma of a standard deviation
    from 40 samples).
    """
    rng = np.random.default_rng(7)
    found = [contact_value(rng.random((1500, 3)) * 20.0, 20.0, tilt=0.2) for _ in range(40)]
    values = np.array([c.value for c in found])
    error = np.mean([c.error for c in found])
    assert values.mean() == pytest.approx(1.0, abs=4 * error / math.sqrt(40))
    assert values.std() == pytest.approx(error, rel=0.45)


def test_contact_value_without_pairs_is_not_a_number():
    """Fewer than 30 pairs say nothing about g: NaN by definition, and the count is reported."""
    found = contact_value(np.array([[0.0, 0.0, 0.0], [2.05, 0.0, 0.0]]), 10.0)
    assert math.isnan(found.value)
    assert found.pairs == 1


def test_smallest_distance_finds_the_pair_across_the_sheared_edge():
    """The closest pair may be joined by an image of the sheared cell, or be a sphere and its own image."""
    tilt, length = 0.4, 10.0
    below = np.array([5.0 - tilt * length, 0.1, 5.0])
    positions = np.array([[5.0, 9.9, 5.0], [2.0, 5.0, 2.0], below])
    distance, first, second = smallest_distance(positions, length, tilt)
    assert {first, second} == {0, 2}
    assert distance == pytest.approx(0.2, abs=1e-12)
    assert smallest_distance(positions[:1], length, tilt) == (pytest.approx(length), 0, 0)
