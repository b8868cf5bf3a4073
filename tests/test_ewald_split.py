"""Splits of the far field: the weight of the wave part, the functions of the real part, and their sum."""

import pathlib

import numpy as np
import pytest
from naive_ewald import Sum, classical, grand_mobility, overlap_polynomials, total_functions, wave_functions

from suspend.core.ewald_functions import real_functions_at, total_functions_at
from suspend.errors import ConfigurationError
from suspend.hydro.ewald.radial import radial_table, self_terms
from suspend.hydro.ewald.split import gaussian_split, make_split, optimal_split, prolate, pswf_split
from suspend.hydro.ewald.truncation import truncation_error

DATA = pathlib.Path(__file__).parent / "data"
KINDS = {"gaussian": gaussian_split, "pswf": pswf_split, "optimal": optimal_split}


SPLITS = [("gaussian", 5.0, 1e-6), ("pswf", 5.5, 1e-10), ("optimal", 3.0, 1e-3), ("optimal", 5.0, 1e-8)]


@pytest.fixture(params=SPLITS)
def split(request):
    kind, cutoff, error = request.param
    return KINDS[kind](cutoff, error)


def package_sum(split):
    """The package's split as a plain lattice sum (real-space table, self terms, W), truncated at r_c."""
    table = radial_table(split)

    def functions(r):
        out = np.empty((len(r), 7))
        real_functions_at(table, r, out)
        return out

    def force(k):
        return 1 - k**2 / 15

    return Sum(functions, np.array(self_terms(split)), split.cutoff, split.wave, force, np.ones_like, split.kmax)


def test_twin_meets_the_reference_scenes():
    """The twin against mobilities computed by an independent code, good to 3e-11, at two splittings."""
    for name in ("rand_N8_phi0.4", "pair_xi1e-02"):
        scene = np.load(DATA / f"{name}.npz")
        for xi in (0.9, 1.3):
            matrix = grand_mobility(scene["pos"], float(scene["L"]), 0.0, classical(xi))
            assert np.abs(matrix - scene["M_grand"]).max() < 3e-11


def test_twin_does_not_depend_on_the_splitting_or_the_wrap():
    """Overlapping random points at tilt 1/2: two splittings agree, and so does tilt -1/2 with points shifted."""
    position = 6.0 * np.random.default_rng(3).random((6, 3))
    matrix = grand_mobility(position, 6.0, 0.5, classical(0.9))
    assert np.abs(matrix - grand_mobility(position, 6.0, 0.5, classical(1.4))).max() < 3e-12
    moved = position + np.array([0.3, 7.1, -2.0])
    assert np.abs(matrix - grand_mobility(moved, 6.0, -0.5, classical(1.4))).max() < 3e-12
    assert np.linalg.eigvalsh(matrix)[0] > 0.0


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("tilt", [0.0, 0.5, -0.31])
def test_split_gives_the_mobility_of_the_classical_one(kind, tilt):
    """The sum is independent of the split: 5e-10 at a truncation error of 1e-10, overlapping pairs included."""
    position = 6.0 * np.random.default_rng(5).random((6, 3))
    position[1] = position[0] + [0.3, -0.2, 0.1]
    expected = grand_mobility(position, 6.0, tilt, classical(1.1))
    matrix = grand_mobility(position, 6.0, tilt, package_sum(KINDS[kind](5.8, 1e-10)))
    assert np.abs(matrix - expected).max() < 5e-10
    assert np.linalg.norm(matrix - expected) < 1e-10 * np.linalg.norm(expected) * 3


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize(("cutoff", "error"), [(3.0, 1e-2), (4.0, 1e-4), (5.0, 1e-7)])
def test_truncation_error_is_as_predicted(kind, cutoff, error):
    """Random loads on random points at volume fraction 0.4: what is left out beyond r_c is 0.4 to 2 errors.

    The prediction holds for uncorrelated pairs; 20 random points have them, within the scatter of one scene.
    """
    split = KINDS[kind](cutoff, error)
    assert abs(truncation_error(split) / error - 1.0) < 0.05
    edge = (20 * 4 * np.pi / 3 / 0.4) ** (1 / 3)
    rng = np.random.default_rng(7)
    position, loads = edge * rng.random((20, 3)), rng.normal(size=(220, 20))
    expected = grand_mobility(position, edge, 0.2, classical(0.9, 1e-11)) @ loads
    found = grand_mobility(position, edge, 0.2, package_sum(split)) @ loads
    measured = np.linalg.norm(found - expected) / np.linalg.norm(expected)
    assert 0.4 * error < measured < 2.0 * error


def test_weight_is_positive_and_has_the_curvature_of_a_sphere(split):
    """W >= 0 (a Gram matrix), W = 1 - k^2/5 + O(k^4) from the definition, table equal to it to 1e-13."""
    k = np.linspace(0.0, 1.1 * split.kmax, 4001)
    weight = split.wave(k)
    assert (weight >= -1e-15).all()
    assert (weight[k > split.kmax] == 0.0).all()
    assert np.abs(weight - split.exact_wave(k)).max() < 1e-13
    small = np.array([0.02, 0.04]) * split.kmax
    slope = (1.0 - split.exact_wave(small)) / small**2
    assert abs((4 * slope[0] - slope[1]) / 3 - 0.2) < 1e-5
    assert split.wave(k.reshape(1, -1, 1)).shape == (1, 4001, 1)


def test_prolate_function_is_its_own_transform():
    """int_-1^1 psi(t) cos(c x t) dt = mu psi(x), and psi solves its equation at 0: psi'' = -eigenvalue psi."""
    for c in (6.0, 22.0, 40.0):
        legendre, eigenvalue = prolate(c)
        t, w = np.polynomial.legendre.leggauss(120)
        x = np.linspace(0.0, 1.0, 41)
        psi = np.polynomial.legendre.legval(t, legendre)
        transform = np.cos(c * np.outer(x, t)) @ (w * psi)
        assert np.abs(transform / transform[0] - np.polynomial.legendre.legval(x, legendre)).max() < 1e-13
        second = np.polynomial.legendre.legval(0.0, np.polynomial.legendre.legder(legendre, 2))
        assert second == pytest.approx(-eigenvalue, rel=1e-10)


def test_table_is_total_less_wave_part(split):
    """Real-space functions against exact totals and quadrature with SciPy's Bessel functions, r from 0.05."""
    r = np.concatenate([np.linspace(0.05, split.cutoff, 301), [1.999, 2.0, 2.001]])
    found = np.empty((len(r), 7))
    real_functions_at(radial_table(split), r, found)

    def weights(k):
        w, p = split.exact_wave(k), 1 - k**2 / 15
        return {"FF": w * p * p, "FD": w * p, "DD": w}

    wave, own = wave_functions(r, weights, split.kmax)
    assert np.abs(found - (total_functions(r) - wave)).max() < 1e-12  # SciPy's j_n and h at r = 0.05: 3e-13
    assert np.abs(np.array([1.0, 0.75, 0.9]) - own - self_terms(split)).max() < 1e-13


def test_total_functions_meet_the_exact_polynomials():
    """r < 2 against exact integrals of sines and cosines; r > 2 is continuous with it; r -> 0 is one sphere."""
    assert overlap_polynomials()["FF"][0] == {0: 1, 1: pytest.approx(-9 / 32)}  # Rotne & Prager (1969)
    r = np.linspace(0.1, 5.0, 99)
    found = np.empty((len(r), 7))
    total_functions_at(r, found)
    assert np.abs(found - total_functions(r)).max() < 1e-13
    edge, zero = np.empty((2, 7)), np.empty((1, 7))
    total_functions_at(np.array([2.0 - 1e-13, 2.0]), edge)
    assert np.abs(edge[0] - edge[1]).max() < 1e-12
    total_functions_at(np.array([1e-14]), zero)
    f1, f2, g1, g2, h1, h2, h3 = zero[0]
    lone = [f1, f2, -0.5 * (5 * h1 + h3) - 0.25 * (h3 - h2), -(3 * h1 + h3)]
    assert np.allclose(lone, [1.0, 1.0, 0.75, 0.9], atol=1e-13)
    assert np.allclose([g1, g2, h2, h3], 0.0, atol=1e-13)


def test_too_short_a_cutoff_and_bad_parameters_are_refused():
    """A sphere's curvature needs range: a short r_c with a small error has no positive W."""
    with pytest.raises(ConfigurationError, match="positive"):
        gaussian_split(3.0, 1e-8)
    with pytest.raises(ConfigurationError, match="positive"):
        make_split("pswf", 2.5, 12.0)
    with pytest.raises(ConfigurationError, match="2 or more"):
        pswf_split(1.5, 1e-3)
    with pytest.raises(ConfigurationError, match="choose from"):
        pswf_split(4.0, 1e-15)
    with pytest.raises(ConfigurationError, match="kinds are"):
        make_split("kaiser", 4.0, 3.0)
