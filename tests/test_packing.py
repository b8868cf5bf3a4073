"""Random packings: hard constraints by a plain-NumPy twin, equilibrium by theory, order, reproducibility."""

from __future__ import annotations

import itertools
import math

import numba
import numpy as np
import pytest

from suspend.core import packing_kernels
from suspend.errors import ConfigurationError, NumericalError
from suspend.fluctuations import equilibrium_structure_factor, smallest_wave_structure, variance_exponent
from suspend.packing import PACKINGS, quenched_packing, random_packing, spatial_order
from suspend.structure import carnahan_starling


def naive_smallest_distance(positions, length):
    """Smallest distance over all pairs and 27 images, own images included."""
    images = np.array(list(itertools.product((-1, 0, 1), repeat=3))) * length
    smallest = length
    for i in range(len(positions)):
        d = positions[:i] - positions[i]
        d -= length * np.rint(d / length)
        if i:
            smallest = min(smallest, np.linalg.norm(d[:, None] + images, axis=2).min())
    return smallest


@pytest.mark.parametrize("kind", PACKINGS)
@pytest.mark.parametrize(
    ("number", "fraction", "gap"),
    [
        (1, 0.5, 1e-3),
        (2, 0.6, 1e-3),
        (3, 0.4, 0.0),
        (8, 0.6, 1e-3),
        (30, 1e-9, 1e-3),
        (60, 0.6, 1e-6),
        (200, 0.3, 0.2),
        (500, 0.6, 1e-3),
    ],
)
def test_no_two_spheres_are_closer_than_the_gap(kind, number, fraction, gap):
    """The constraint is strict, in any cell from one that barely holds its sphere to an almost empty one."""
    packing = PACKINGS[kind](number, fraction, gap, seed=4)
    assert packing.kind == kind
    x, length = packing.positions, packing.length
    assert x.shape == (number, 3)
    assert x.min() >= 0.0
    assert x.max() < length
    assert number * 4 / 3 * math.pi / length**3 == pytest.approx(fraction, rel=1e-14)
    smallest = naive_smallest_distance(x, length)
    assert smallest >= 2.0 + gap
    assert packing.minimum_gap == pytest.approx(smallest - 2.0, abs=1e-12)


@pytest.mark.parametrize(("number", "length"), [(12, 4.6), (12, 5.2), (150, 10.5)])
def test_separation_leaves_no_overlap_at_all(number, length):
    """The relaxation at 2.002 ends only when every distance is >= 2, strictly, from any random points."""
    x = np.random.default_rng(6).random((number, 3)) * length
    assert packing_kernels.separate(x, length, 2.0, 2.002, 20_000) > 0
    assert naive_smallest_distance(x, length) >= 2.0
    assert x.min() >= 0.0
    assert x.max() < length


@pytest.mark.parametrize("fraction", [0.1, 0.3, 0.45])
def test_fluid_has_the_contact_value_of_carnahan_and_starling(fraction):
    """Equilibrium: g(contact) = (1 - phi/2)/(1 - phi)^3, right to 0.5 %; four standard errors of the mean of
    three packings are added. The gaps' diameter counts: 0.02 raises phi by 3 %.
    """
    found = [random_packing(1500, fraction, 0.02, seed) for seed in (1, 2, 3)]
    assert all(p.equilibrium for p in found)
    mean = np.mean([p.contact_value for p in found])
    error = np.sqrt(np.sum([p.contact_error**2 for p in found])) / 3
    expected = carnahan_starling(fraction * 1.01**3)
    assert mean == pytest.approx(expected, abs=4 * error + 0.005 * expected)
    assert found[0].equilibrium_contact_value == pytest.approx(expected)


def test_fluid_is_at_equilibrium_at_long_waves_too():
    """S of the longest waves at phi = 0.1, N = 500: 0.46 within four errors, S/sqrt(72), of 24 packings of three waves.
    (Stirred for one diameter only they have 0.8.)
    """
    packings = [random_packing(500, 0.1, 0.02, seed) for seed in range(24)]
    assert all(p.long_waves and p.rms_travel >= p.needed_travel for p in packings)
    found = np.mean([smallest_wave_structure(p.positions, p.length) for p in packings])
    expected = float(equilibrium_structure_factor(2.0 * math.pi / packings[0].length, 0.1 * 1.01**3, 2.02))
    assert found == pytest.approx(expected, abs=4.0 * expected / math.sqrt(72.0))


def test_stirring_that_ends_early_is_said(monkeypatch):
    """With too few moves for the longest wave the packing does not claim to be at equilibrium there."""
    monkeypatch.setattr("suspend.packing.LONG_WAVE_MOVES", 500 * 150)
    packing = random_packing(500, 0.1, seed=1)
    assert packing.equilibrium and not packing.long_waves
    assert packing.rms_travel < packing.needed_travel


def plain_quench(x, length, hard, soft):
    """Every pair below `soft` moved apart by half its overlap each, all at once, until none is below `hard`; sweeps."""
    for sweep in itertools.count():
        d = x[:, None] - x[None]
        d -= length * np.rint(d / length)
        r = np.linalg.norm(d, axis=2)
        np.fill_diagonal(r, np.inf)
        if r.min() >= hard:
            return x, sweep
        overlap = np.maximum(soft - r, 0.0) / r
        x = x + 0.5 * np.einsum("ij,ija->ia", overlap, d)


def test_quench_is_pairs_pushed_apart_by_half_their_overlap():
    """A plain-NumPy twin from the same points: the same number of sweeps and the same positions (1e-9 of rounding)."""
    packing = quenched_packing(60, 0.4, 1e-3, seed=5)
    points = np.random.default_rng([5, 0]).random((60, 3)) * packing.length
    x, sweeps = plain_quench(points, packing.length, 2.001, 2.001 * (1.0 + 5e-4))
    assert packing.sweeps == sweeps and packing.relaxation_steps == 0
    d = packing.positions[:, None] - x[None]
    d -= packing.length * np.rint(d / packing.length)
    nearest = np.linalg.norm(d, axis=2)
    assert nearest.min(axis=1).max() < 1e-9 and len(set(nearest.argmin(axis=1))) == 60


def test_quench_is_no_fluid():
    """What the paper's start is known by (N = 500, phi = 0.4, two makings apart from this program): neighbours that
    nearly touch (nearest at 2.002), beta0 of 3.0 to 3.5, S of the longest waves near that of random points and tens of
    times the fluid's 0.044; means of 12 seeds. Seed 1 alone: beta0 3.02, S 0.35.
    """
    packings = [quenched_packing(500, 0.4, 1e-3, seed) for seed in range(1, 13)]
    beta = [variance_exponent(p.positions, p.length) for p in packings]
    s = [smallest_wave_structure(p.positions, p.length) for p in packings]
    assert 3.0 < np.mean(beta) < 3.5
    assert 0.35 < np.mean(s) < 1.2
    assert (beta[0], s[0]) == (pytest.approx(3.02, abs=0.01), pytest.approx(0.35, abs=0.005))
    d = packings[0].positions[:, None] - packings[0].positions[None]
    d -= packings[0].length * np.rint(d / packings[0].length)
    r = np.linalg.norm(d, axis=2)
    np.fill_diagonal(r, np.inf)
    assert np.median(r.min(axis=1)) == pytest.approx(2.002, abs=5e-4)
    assert packings[0].contact_value > 5.0 * carnahan_starling(0.4)
    assert not any(p.equilibrium or p.long_waves for p in packings)


def test_dense_quench_is_finished_by_relaxation():
    """At phi = 0.55 sweeps suffice, at 0.6 a thousand of them do not: the rest is relaxed, and said."""
    assert quenched_packing(200, 0.55, seed=1).relaxation_steps == 0
    dense = quenched_packing(200, 0.6, seed=1)
    assert dense.sweeps == 1000 and dense.relaxation_steps > 0


@pytest.mark.parametrize("fraction", [0.4, 0.55, 0.6])
def test_packing_is_disordered(fraction):
    """An fcc crystal has Q6 = 0.57 and crystalline share 1. Independent bonds would give Q6 = 1/sqrt(bonds);
    those of neighbours are correlated, so 6 times that is allowed (a fifth of fcc), and a share of 5 %.
    """
    packing = random_packing(500, fraction, seed=2)
    assert packing.global_q6 < 6 / math.sqrt(500 * 6)
    assert packing.crystal_fraction < 0.05


def test_dense_packing_is_not_left_at_contact():
    """At phi = 0.6 the metastable fluid has g(contact) = 11 and a quench from random points 40: the slow
    compression must come out nearer the fluid.
    """
    packing = random_packing(500, 0.6, seed=3)
    assert packing.contact_value < 25
    assert not packing.equilibrium


@pytest.mark.parametrize("make", PACKINGS.values())
def test_seed_gives_the_same_bits_on_any_number_of_threads(make):
    """No parallel reduction and no global random state: equal bits, whatever NumPy's or Numba's state is."""
    reference = make(100, 0.55, seed=11)
    threads = numba.get_num_threads()
    try:
        numba.set_num_threads(1)
        np.random.seed(0)  # noqa: NPY002 - the global state must not matter
        again = make(100, 0.55, seed=11)
    finally:
        numba.set_num_threads(threads)
    assert np.array_equal(reference.positions, again.positions)
    assert not np.array_equal(reference.positions, make(100, 0.55, seed=12).positions)


def test_random_stream_is_splitmix64():
    """First outputs of SplitMix64 from state 0, by integers of unlimited size; the first is published as
    0xE220A8397B1DCDAF.
    """
    mask, z0, expected = 2**64 - 1, 0, []
    for _ in range(5):
        z0 = (z0 + 0x9E3779B97F4A7C15) & mask
        z = ((z0 ^ (z0 >> 30)) * 0xBF58476D1CE4E5B9) & mask
        z = ((z ^ (z >> 27)) * 0x94D049BB133111EB) & mask
        expected.append(z ^ (z >> 31))
    assert expected[0] == 0xE220A8397B1DCDAF
    state = np.zeros(1, np.uint64)
    found = [packing_kernels.uniform(state) for _ in range(5)]
    assert found == [(z >> 11) / 2**53 for z in expected]


@pytest.mark.parametrize("length", [5.0, 6.5])
def test_monte_carlo_samples_two_hard_spheres_uniformly(length):
    """The separation of two hard spheres is uniform over the cell less the sphere of radius 2, so
    P(r < R) = (4 pi/3)(R^3 - 8)/(L^3 - 32 pi/3) for R <= L/2; 4 sigma of 4,000 nearly independent samples.
    Both branches: L = 5 holds two search cells along an edge, L = 6.5 three.
    """
    x = np.array([[0.0, 0.0, 0.0], [2.4, 0.0, 0.0]])
    state, travel = np.array([9], np.uint64), np.zeros((2, 3))
    within, samples, limit = 0, 4000, 0.5 * length
    for _ in range(samples):
        packing_kernels.metropolis(x, travel, length, 2.0, 0.5 * length, 15, state)
        d = x[0] - x[1]
        r = np.linalg.norm(d - length * np.rint(d / length))
        assert r >= 2.0
        within += r < limit
    p = 4 * math.pi / 3 * (limit**3 - 8) / (length**3 - 32 * math.pi / 3)
    assert within / samples == pytest.approx(p, abs=4 * math.sqrt(p * (1 - p) / samples))


def test_push_forces_are_those_of_a_plain_double_loop():
    """Forces (d - r) r/|r| of all overlapping pairs from the cell list and from all images (round-off)."""
    length, diameter = 7.0, 2.1
    x = np.random.default_rng(8).random((40, 3)) * length
    expected, smallest = np.zeros_like(x), np.inf
    for i, j in itertools.permutations(range(40), 2):
        d = x[i] - x[j]
        d -= length * np.rint(d / length)
        r = np.linalg.norm(d)
        if r < diameter:
            expected[i] += (diameter - r) * d / r
            smallest = min(smallest, r)
    by_cells, by_images = np.zeros_like(x), np.zeros_like(x)
    assert math.sqrt(packing_kernels.push_cells(x, length, 3, diameter, by_cells)) == pytest.approx(smallest)
    packing_kernels.push_images(x, length, diameter, by_images)
    np.testing.assert_allclose(by_cells, expected, atol=1e-12)
    np.testing.assert_allclose(by_images, expected, atol=1e-12)


def test_spheres_come_in_spatial_order():
    """Morton order: neighbours in the list are neighbours in space, unlike in random order (mean 0.48 L)."""
    packing = random_packing(500, 0.4, seed=1)
    d = np.diff(packing.positions, axis=0)
    d -= packing.length * np.rint(d / packing.length)
    assert np.linalg.norm(d, axis=1).mean() < 0.25 * packing.length
    assert np.array_equal(spatial_order(packing.positions, packing.length), np.arange(500))


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ((500, 0.63), "0.62 that random"),
        ((500, 0.6, 0.1), "particles.minimum_gap"),
        ((1, 0.55), "its own image"),
        ((0, 0.3), "number of spheres"),
        ((2.5, 0.3), "number of spheres"),
        ((10, 0.0), "volume fraction"),
        ((10, float("nan")), "volume fraction"),
        ((10, 0.3, -1e-3), "minimum gap"),
        ((10, 0.3, 1e-3, -1), "seed"),
    ],
)
def test_impossible_requests_say_what_to_do(arguments, words):
    for make in PACKINGS.values():
        with pytest.raises(ConfigurationError, match=words):
            make(*arguments)


def test_arrangement_that_does_not_exist_is_an_error():
    """Three spheres at phi = 0.6 do not fit a cubic periodic cell: every start jams and the error says so."""
    for make in PACKINGS.values():
        with pytest.raises(NumericalError, match="20 jammed"):
            make(3, 0.6)
