"""Pairs, angular maps, clusters, order and contacts against plain-Python twins and perfect lattices."""

from __future__ import annotations

import itertools
import math

import matplotlib
import numpy as np
import pytest
from lattices import BCC, FCC, SC, doubled, lattice, spheres

from suspend.analysis.microstructure import (
    AngularMaps,
    BondOrderEvolution,
    Contacts,
    NearestNeighbourGraph,
    NeighbourDistances,
    PairDistribution,
    ShearPlaneDistribution,
    Snapshot,
    nearest_clusters,
    shape_factor,
)
from suspend.analysis.microstructure.angular import directions
from suspend.box import cell_vectors
from suspend.errors import ConfigurationError, NumericalError

matplotlib.use("Agg")
TILTS = [0.0, 0.37, -0.5, 0.5, 2.3]


def naive_nearest(position, length, tilt, i):
    """(distance, j, vector) of all other spheres, each by its nearest of 11 x 11 x 11 images, sorted."""
    images = np.array(list(itertools.product(range(-5, 6), repeat=3))) @ cell_vectors(length, tilt)
    found = []
    for j in range(len(position)):
        if j != i:
            vectors = position[j] - position[i] + images
            nearest = vectors[np.argmin(np.linalg.norm(vectors, axis=1))]
            found.append((np.linalg.norm(nearest), j, nearest))
    return sorted(found, key=lambda entry: entry[0])


@pytest.mark.parametrize("tilt", TILTS)
@pytest.mark.parametrize("number", [2, 3, 40])
def test_nearest_neighbours_are_those_of_a_plain_search(tilt, number):
    """Distances, indices and vectors of up to 6 neighbours, in any tilt, down to two spheres (round-off)."""
    position = spheres(np.random.default_rng(number), number, 11.0, tilt)
    k = min(6, number - 1)
    distance, index, vector = Snapshot(position, 11.0, tilt).nearest(k)
    for i in range(number):
        expected = naive_nearest(position, 11.0, tilt, i)[:k]
        np.testing.assert_allclose(distance[i], [e[0] for e in expected], rtol=1e-13)
        assert index[i].tolist() == [e[1] for e in expected]
        np.testing.assert_allclose(vector[i], [e[2] for e in expected], atol=1e-12)


def test_neighbours_that_do_not_exist_are_refused():
    with pytest.raises(ConfigurationError, match="no 3-th neighbour"):
        Snapshot(np.array([[0.0, 0, 0], [3.0, 0, 0], [0.0, 3, 0]]), 9.0).nearest(3)
    with pytest.raises(NumericalError, match="not finite"):
        Snapshot(np.full((2, 3), np.nan), 9.0)


def test_shape_factor_of_doublets_and_a_straight_triplet():
    """sqrt(1 + 5 r^2/8): 1.938 at 2.1 a and 1.931 at 2.09 a (the paper's 1.93); a straight triplet of spacing r has
    I_min = 6/5 and I_max = 6/5 + 2 r^2; one sphere is isotropic."""
    for r, expected in ((2.1, 1.938), (2.09, 1.931)):
        doublet = np.array([[0.0, 0.0, 0.0], [0.6, 0.0, 0.8]]) * [r, r, r]
        assert shape_factor(doublet)[0] == pytest.approx(expected, abs=5e-4)
        assert shape_factor(doublet)[0] == pytest.approx(math.sqrt(1.0 + 0.625 * r * r), rel=1e-13)
    triplet = np.array([[0.0, 0, 0], [0.0, 2.2, 0], [0.0, 4.4, 0]])
    assert shape_factor(triplet)[0] == pytest.approx(math.sqrt((1.2 + 2 * 2.2**2) / 1.2), rel=1e-13)
    assert shape_factor(np.zeros((1, 3))).tolist() == [1.0]


@pytest.mark.parametrize("tilt", [0.0, 0.37, -0.5])
def test_clusters_are_those_of_following_links_by_hand(tilt):
    """Partition and shapes against links followed sphere by sphere, with the inertia summed by its definition."""
    length, position = 14.0, spheres(np.random.default_rng(8), 90, 14.0, tilt)
    n = len(position)
    links = [[] for _ in range(n)]
    for i in range(n):
        _, j, vector = naive_nearest(position, length, tilt, i)[0]
        links[i].append((j, vector))
        links[j].append((i, -vector))
    expected, seen = [], set()
    for i in range(n):
        if i in seen:
            continue
        places, queue = {i: np.zeros(3)}, [i]
        while queue:
            here = queue.pop()
            for there, vector in links[here]:
                if there not in places:
                    places[there] = places[here] + vector
                    queue.append(there)
        seen |= set(places)
        d = np.array(list(places.values())) - np.mean(list(places.values()), axis=0)
        inertia = sum(0.4 * np.eye(3) + (v @ v) * np.eye(3) - np.outer(v, v) for v in d)
        values = np.linalg.eigvalsh(inertia)
        expected.append((frozenset(places), math.sqrt(values[-1] / values[0])))
    clusters = nearest_clusters(Snapshot(position, length, tilt))
    found = {frozenset(np.flatnonzero(clusters.label == c).tolist()): c for c in range(len(clusters.size))}
    assert set(found) == {members for members, _ in expected}
    assert all(clusters.size[c] == len(members) for members, c in found.items())
    for members, shape in expected:
        assert clusters.shape[found[members]] == pytest.approx(shape, rel=1e-10)


def test_graph_of_isolated_doublets():
    """Doublets far apart: every cluster has size 2, the most frequent shape is in the bin of 1.938."""
    corners, length = lattice(SC, 4, 8.0)
    step = np.array([0.0, 0.0, 2.1])
    graph = NearestNeighbourGraph().compute_snapshots([Snapshot(np.vstack([corners, corners + step]), length)])
    assert graph.size_distribution[1].tolist() == [0.0, 1.0]
    assert graph.shapes == pytest.approx(1.938, abs=5e-4)
    assert graph.summary()["shape_factor_mode[-]"] == pytest.approx(1.938, abs=0.025)
    assert graph.largest_share.tolist() == [2 / 128]


@pytest.mark.parametrize(
    ("basis", "edge", "shells"),
    [
        (SC, 2.2, [(1.0, 6), (math.sqrt(2), 12), (math.sqrt(3), 8), (2.0, 6)]),
        (FCC, 3.4, [(math.sqrt(0.5), 12), (1.0, 6), (math.sqrt(1.5), 24), (math.sqrt(2), 12)]),
        (BCC, 2.8, [(math.sqrt(0.75), 8), (1.0, 6), (math.sqrt(2), 12), (math.sqrt(2.75), 24)]),
    ],
)
@pytest.mark.parametrize("tilt", [0.0, 1.0, 0.25])
def test_pair_distribution_of_lattices_counts_their_shells(basis, edge, shells, tilt):
    """g(r) integrated over each shell is its coordination number; a tilt of a whole number of unit cells (1/4 of
    a cell of four... or eight of them) leaves the lattice what it is. Exact up to round-off."""
    position, length = lattice(basis, 4 if tilt != 0.25 else 8, edge)
    pairs = PairDistribution().compute_snapshots([Snapshot(position, length, tilt)])
    expected = 0
    for distance, neighbours in shells:
        if distance * edge + 0.06 > pairs.edges[-1]:
            continue
        expected += neighbours
        bins = np.searchsorted(pairs.edges, distance * edge + 0.06) - 1
        assert pairs.coordination[bins] == pytest.approx(expected, rel=1e-12)
    assert expected >= 6


def test_ideal_gas_has_unit_pair_distribution_in_every_direction():
    """g = 1 within the counting error: chi-squared per bin within 5 sigma, for r, for directions, in the plane.

    Opposite directions hold the same pairs: half of the cells are independent, each with Poisson counts."""
    rng, length = np.random.default_rng(4), 22.0
    shots = [Snapshot(rng.random((2000, 3)) * length, length, 0.3) for _ in range(3)]
    pairs = PairDistribution().compute_snapshots(shots)
    error = 1.0 / np.sqrt(0.5 * pairs._ideal)  # pairs counted from both ends
    chi = ((pairs.g - 1.0) / error)[10:]
    assert np.mean(chi**2) == pytest.approx(1.0, abs=5 * math.sqrt(2 / len(chi)))
    assert abs(chi.mean()) < 5 / math.sqrt(len(chi))
    assert (np.abs(pairs.error / error - math.sqrt(3.0))[10:] < 0.35).all()  # frames taken as one
    maps = AngularMaps(radii=[5.0]).compute_snapshots(shots)
    low, high = np.searchsorted(maps._edges, [4.9 - 1e-9, 5.1 - 1e-9])
    mean = maps._counts[low:high].sum(axis=0).mean()
    density = maps.at(5.0)
    assert density.mean() == pytest.approx(1.0, rel=1e-12)
    assert density.var() * mean == pytest.approx(1.0, abs=5 * math.sqrt(2 / (density.size / 2)))
    assert maps.off_rings(5.0) == pytest.approx(1.0, abs=5 * math.sqrt(2 / (0.3 * mean * density.size)))
    plane = ShearPlaneDistribution().compute_snapshots(shots)
    assert plane.g.mean() == pytest.approx(1.0, abs=0.02)


def test_angular_maps_are_oriented_as_in_the_paper():
    """Neighbours along the flow are at longitude 0 (and 180) on the equator, along the gradient at the poles, along
    the vorticity on the equator at +-90 degrees: +z at -90, so that the map is seen from outside (right-handed)."""
    length = 60.0
    corners, _ = lattice(SC, 3, length / 3)
    rng = np.random.default_rng(0)
    for axis, longitudes, latitude in ((0, (0.0, 180.0), 0.0), (2, (-90.0, 90.0), 0.0), (1, None, 90.0)):
        step = np.zeros(3)
        step[axis] = 2.1
        tiny = 1e-3 * rng.normal(size=corners.shape)
        shot = Snapshot(np.vstack([corners, corners + step + tiny]) + 1.0, length)
        maps = AngularMaps(radii=[2.1], longitudes=36, latitudes=19).compute_snapshots([shot])
        table = maps.table()
        full = table["density[isotropic]"] > 0
        assert np.abs(table["latitude[deg]"][full]) == pytest.approx(latitude, abs=20.0)
        if longitudes:
            turned = np.abs((table["longitude[deg]"][full, None] - longitudes + 180.0) % 360.0 - 180.0)
            assert turned.min(axis=1).max() < 10.0
    assert np.rad2deg(directions(np.array([[0.0, 0.0, 2.1]]))[0]) == pytest.approx(-90.0)


def test_off_rings_is_zero_for_neighbours_on_the_rings_only():
    """Equator and the plane perpendicular to the flow filled: 0; x-y diagonals only: far above 1."""
    corners, length = lattice(SC, 4, 12.0)
    diagonal = 2.1 * np.array([1.0, 1.0, 0.0]) / math.sqrt(2)
    for step, expected in (([2.1, 0.1, 0.0], 0.0), ([0.0, 1.4, 1.565], 0.0), (diagonal, 2.0)):
        shot = Snapshot(np.vstack([corners, corners + np.array(step)]), length)
        maps = AngularMaps(radii=[2.1]).compute_snapshots([shot])
        assert maps.off_rings(2.1) == 0.0 if expected == 0.0 else maps.off_rings(2.1) > expected


def test_shear_plane_shows_flow_to_the_right_and_gradient_upwards():
    corners, length = lattice(SC, 3, 20.0)
    shot = Snapshot(np.vstack([corners, corners + np.array([3.05, 1.05, 0.0])]), length)
    plane = ShearPlaneDistribution(width=0.1).compute_snapshots([shot])
    full = np.argwhere(plane.g > 0.0)
    found = {tuple(np.round(plane.x[index], 6).tolist()) for index in full}
    assert found == {(3.05, 1.05), (-3.05, -1.05)}


@pytest.mark.parametrize(
    ("basis", "edge", "reach", "expected"), [(SC, 2.2, 2.5, 0.3536), (FCC, 3.0, 2.6, 0.5745), (BCC, 2.6, 3.0, 0.5107)]
)
def test_global_bond_order_of_lattices(basis, edge, reach, expected):
    """Steinhardt et al. 1983; bcc with its 8 + 6 neighbours. Read as a cell of tilt 1/2 too (two unit cells of 4)."""
    position, length = lattice(basis, 4, edge)
    order = BondOrderEvolution(reach=reach)
    order.compute_snapshots([Snapshot(position, length), Snapshot(position, length, 0.5)])
    assert order.global_q6 == pytest.approx(expected, abs=1e-4)
    assert order.local_q6 == pytest.approx(expected, abs=1e-4)
    assert order.crystallised == (expected != 0.3536)  # sc has 6 bonds a sphere, 7 are asked for


def test_contacts_count_known_gaps():
    """A row of three spheres with gaps 0.01 and 0.04, a pair that overlaps by 0.001, a lone sphere."""
    row = np.array([[5.0, 5, 5], [7.01, 5, 5], [9.05, 5, 5]])
    pair = np.array([[15.0, 15, 15], [15.0, 16.999, 15]])
    contacts = Contacts().compute_snapshots([Snapshot(np.vstack([row, pair, [[25.0, 5, 25]]]), 40.0)])
    assert contacts.contact_number.tolist() == [pytest.approx(4 / 6)]
    assert contacts.without_contact.tolist() == [pytest.approx(2 / 6)]
    assert contacts.smallest_gap[0] == pytest.approx(-1e-3)
    assert contacts.overlaps.tolist() == [1]
    assert contacts.cumulative[-1] == pytest.approx(6 / 6)
    assert np.sum(contacts.density * np.diff(contacts.gaps)) == pytest.approx(4 / 6)


def test_tilted_cell_agrees_with_its_untilted_equivalent():
    """The lattice of tilt 1/2 has a cube of edge 2L with eight copies: all local quantities agree to round-off,
    g after its normalisation by (N-1)/V; the same for the tilt -1/2, which spans the same lattice."""
    length = 13.0
    position = spheres(np.random.default_rng(6), 110, length, 0.5)
    cube, edge = doubled(position, length)
    shots = [Snapshot(position, length, 0.5), Snapshot(position, length, -0.5), Snapshot(cube, edge)]
    tilted, turned, flat = ([] for _ in range(3))
    for shot, results in zip(shots, (tilted, turned, flat), strict=True):
        pairs = PairDistribution(reach=6.5).compute_snapshots([shot])
        results.append(pairs.g * (shot.number - 1) / shot.number)
        results.append(NeighbourDistances().compute_snapshots([shot]).distance)
        graph = NearestNeighbourGraph().compute_snapshots([shot])
        copies = round(shot.number / 110)
        results += [graph.size_distribution[1], np.sort(graph.shapes)[::copies]]
        results.append(Contacts().compute_snapshots([shot]).cumulative)
        bonds = BondOrderEvolution().compute_snapshots([shot])
        results.append(np.array([bonds.global_q6[0], bonds.local_q6[0], bonds.crystal_fraction[0]]))
    for a, b, c in zip(tilted, turned, flat, strict=True):
        np.testing.assert_allclose(a, b, rtol=1e-10, atol=1e-12)
        np.testing.assert_allclose(a, c, rtol=1e-10, atol=1e-12)


def test_sampled_centres_agree_with_all_of_them_within_their_noise():
    """A third of the centres: g differs by the noise of the counts (5 sigma), not in its normalisation."""
    rng = np.random.default_rng(9)
    shot = Snapshot(rng.random((1500, 3)) * 20.0, 20.0)
    sampled = PairDistribution(centres=500).compute_snapshots([shot])
    assert sampled.g[40:].mean() == pytest.approx(1.0, abs=5 / math.sqrt(0.5 * sampled._ideal[40:].sum()))


def test_every_quantity_draws_and_tabulates():
    """Tables have columns of equal length, figures draw without complaint, for a dense configuration and N = 2."""
    import matplotlib.pyplot as plt

    dense = Snapshot(spheres(np.random.default_rng(2), 120, 13.0), 13.0)
    two = Snapshot(np.array([[1.0, 1, 1], [3.1, 1, 1]]), 5.0)
    for shot in (dense, two):
        for quantity in (
            PairDistribution(),
            AngularMaps(radii=[2.1]),
            ShearPlaneDistribution(),
            NearestNeighbourGraph(),
            NeighbourDistances(),
            BondOrderEvolution(),
            Contacts(),
        ):
            quantity.compute_snapshots([shot])
            assert len({len(column) for column in quantity.table().values()}) == 1
            quantity.summary()
            figure = plt.figure()
            quantity.plot(figure.add_subplot(projection="aitoff" if isinstance(quantity, AngularMaps) else None))
            figure.canvas.draw()
            plt.close(figure)
    graph = NearestNeighbourGraph().compute_snapshots([two])
    assert graph.shapes.tolist() == [pytest.approx(math.sqrt(1.0 + 0.625 * 2.1**2))]
    assert NeighbourDistances().compute_snapshots([two]).distance.tolist() == [pytest.approx(2.1)]
    with pytest.raises(ConfigurationError, match="one sphere has no neighbours"):
        PairDistribution().compute_snapshots([Snapshot(np.zeros((1, 3)), 5.0)])
    with pytest.raises(ConfigurationError, match="half the edge"):
        PairDistribution(reach=4.0).compute_snapshots([two])
