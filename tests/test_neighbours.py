"""Pairs in the sheared periodic cell against a search over all images."""

import naive
import numpy as np
import pytest

from suspend.box import unwrap
from suspend.hydro.neighbours import VerletList, find_pairs, stretch

SIZES = [(1, 2.5, 4.6), (2, 3.0, 4.0), (7, 5.5, 4.6), (60, 11.0, 3.0)]


def canonical(pairs):
    """Pairs as a set, i < j, own images in one half space; fails on a pair listed twice."""
    result = set()
    for i, j, *n in np.asarray(pairs).tolist():
        turned = i > j or (i == j and tuple(n[::-1]) < (0, 0, 0))
        key = (j, i, *(-v for v in n)) if turned else (i, j, *n)
        assert key not in result
        result.add(key)
    return result


def within(pairs, position, edge, tilt, cutoff):
    """Those of `pairs` that are closer than `cutoff`."""
    vectors = naive.lattice(edge, tilt)
    d = position[pairs[:, 1]] + pairs[:, 2:] @ vectors - position[pairs[:, 0]]
    return pairs[np.einsum("ij,ij->i", d, d) < cutoff**2]


@pytest.mark.parametrize("tilt", [-0.5, -0.31, 0.0, 0.2, 0.4999, 0.5])
@pytest.mark.parametrize(("number", "edge", "reach"), SIZES)
def test_every_image_pair_is_found_once(number, edge, reach, tilt):
    """The set of pairs closer than the reach is a fact: both searches must give the same set, exactly."""
    position = np.random.default_rng(number).random((number, 3)) @ naive.lattice(edge, tilt)
    pairs, row = find_pairs(position, edge, tilt, reach)
    assert canonical(pairs) == set(naive.image_pairs(position, edge, tilt, reach))
    assert row[0] == 0 and row[-1] == len(pairs)
    for i in range(number):
        assert (pairs[row[i] : row[i + 1], 0] == i).all()


def test_spheres_on_the_faces_of_the_cell():
    """Coordinates of exactly 0 and one rounding error below L fall into the first and last grid cell."""
    edge = 9.0
    top = np.nextafter(edge, 0.0)
    position = np.array([[0, 0, 0], [top, 0, 3], [3, top, 0], [0, 3, top], [4, 4, edge / 2]], float)
    pairs, _ = find_pairs(position, edge, 0.0, 4.0)
    assert canonical(pairs) == set(naive.image_pairs(position, edge, 0.0, 4.0))


@pytest.mark.parametrize("tilt", [-1.3, 0.8, 2.5])
def test_positions_and_tilts_outside_the_cell(tilt):
    """The images listed belong to the positions and the tilt as given, wrapped or not: an exact fact."""
    edge, random = 7.0, np.random.default_rng(3)
    inside = random.random((12, 3)) @ naive.lattice(edge, tilt)
    position = unwrap(inside, random.integers(-2, 3, (12, 3)), edge, tilt)
    verlet = VerletList(edge, 3.5, 0.5)
    verlet.build(position, 0.0, tilt)
    close = within(verlet.pairs, position, edge, tilt, 4.0)
    assert len(close) == len(verlet.pairs)
    assert canonical(close) == set(naive.image_pairs(position, edge, tilt, 4.0))


@pytest.mark.parametrize("seed", range(6))
def test_list_is_complete_while_it_says_so(seed):
    """Theory: |r_build| <= stretch(g) (r_now + 2 u). While valid(), no pair within the cutoff is missing.

    Every sphere moves in its own random direction, all at one speed, in slow and fast shear of either sign.
    """
    random = np.random.default_rng(seed)
    edge, cutoff, tilt0, strain0 = 8.0, 3.0, 0.45, 0.45
    position = random.random((40, 3)) @ naive.lattice(edge, tilt0)
    verlet = VerletList(edge, cutoff, 0.5)
    verlet.build(position, strain0, tilt0)
    walk = random.normal(size=position.shape)
    walk /= np.linalg.norm(walk, axis=1)[:, None]
    shear, speed = ((1.0, 0.0), (-1.0, 0.02), (1.0, 0.1), (0.0, 1.0), (-0.3, 0.3), (0.2, 1.0))[seed]
    steps = 0
    for k in range(1, 1000):
        g = shear * 0.01 * k
        moved = position + speed * 0.01 * k * walk
        moved[:, 0] += g * position[:, 1]
        if not verlet.valid(moved, strain0 + g):
            break
        held = within(verlet.pairs, moved, edge, tilt0 + g, cutoff)
        assert canonical(held) == set(naive.image_pairs(moved, edge, tilt0 + g, cutoff))
        steps = k
    assert 5 <= steps < 400  # it lives for a while, and it ends


def test_validity_bound_is_tight():
    """Two spheres that start just outside cutoff + skin and approach reach the cutoff as the list ends."""
    edge, cutoff, skin = 30.0, 4.0, 0.5
    position = np.array([[10.0, 10, 10], [10 + cutoff + skin + 1e-9, 10, 10]])
    verlet = VerletList(edge, cutoff, skin)
    verlet.build(position, 0.0, 0.0)
    assert len(verlet.pairs) == 0
    step = np.array([[1.0, 0, 0], [-1.0, 0, 0]])
    assert verlet.valid(position + (0.5 * skin - 1e-9) * step, 0.0)
    assert not verlet.valid(position + (0.5 * skin + 1e-9) * step, 0.0)


def test_stretch_is_the_largest_singular_value():
    """Largest singular value of [[1, g], [0, 1]], by NumPy; rounding only."""
    for g in (-1.7, -0.1, 0.0, 0.3, 2.0):
        assert stretch(g) == pytest.approx(np.linalg.svd([[1, g], [0, 1]])[1][0], rel=1e-14)
