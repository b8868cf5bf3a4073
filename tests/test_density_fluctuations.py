"""Number variance, its exponent and its fit; structure factor and hyperuniformity: theory and plain sums."""

from __future__ import annotations

import math

import matplotlib
import numpy as np
import pytest
from lattices import SC, doubled, lattice
from scipy.integrate import simpson

from suspend.analysis.microstructure import NumberVariance, Snapshot, StructureFactor, fit_beta, number_variance
from suspend.analysis.microstructure.number_variance import exact_variance
from suspend.analysis.microstructure.structure_factor import allowed_vectors, fit_small_q, scattering
from suspend.box import cell_vectors
from suspend.errors import ConfigurationError

matplotlib.use("Agg")


def slope(x, y):
    return np.polyfit(np.log(x), np.log(y), 1)[0]


@pytest.fixture(scope="module")
def poisson():
    """Variance (samples, radii), exponents and errors of independent points in a cell of tilt 0.3."""
    rng, length, number = np.random.default_rng(12), 24.0, 1500
    radii = np.geomspace(2.0, 6.0, 8)
    made = [
        number_variance(Snapshot(rng.random((number, 3)) @ cell_vectors(length, 0.3), length, 0.3), radii, seed=k)
        for k in range(60)
    ]
    return radii, 4.0 * np.pi / 3.0 * radii**3 / length**3, number, made


def test_number_variance_of_random_points(poisson):
    """n is binomial: sigma^2 = N p (1 - p), p = v/V, within 4 standard errors of the mean over 60 samples."""
    _, share, number, made = poisson
    variance = np.array([m.variance for m in made])
    error = variance.std(axis=0) / math.sqrt(len(made))
    assert (np.abs(variance.mean(axis=0) - number * share * (1.0 - share)) < 4.0 * error).all()


def test_exponent_of_random_points_is_three(poisson):
    """beta = 3 once the factor 1 - v/V of a fixed number is taken out, and the reported error is 0.5 to 1.3 of the
    scatter found (it is known to be small; 60 samples give the scatter to 10 %)."""
    radii, share, _, made = poisson
    beta = np.array([m.beta for m in made])
    lowered = slope(radii, 1.0 - share)
    error = beta.std() / math.sqrt(len(beta))
    assert beta.mean() - lowered == pytest.approx(3.0, abs=4.0 * error + 0.02)  # 0.02: bias of a mean of logarithms
    assert error < 0.03
    assert 0.5 < np.mean([m.error for m in made]) / beta.std() < 1.3


def test_exponent_of_a_perturbed_lattice_is_two():
    """Gaussian displacements s: S = 1 - exp(-q^2 s^2) (Bragg peaks are below 1e-4 for s = d/2), hence
    sigma^2(r) = rho/(2 pi^2) int S w^2 q^2 dq, w the transform of the test sphere, and beta -> 2 for r >> s.

    The variance of three samples is met within 12 % (large spheres: few independent places), beta within 0.1 of the
    integral's, which is within 0.15 of 2 here. A cell of tilt 1/2 holds a lattice whose period divides L/2.
    """
    spacing, cells = 2.4, 18
    s = 0.5 * spacing
    corners, length = lattice(SC, cells, spacing)
    rng = np.random.default_rng(3)
    radii = np.geomspace(2.4 * s, 0.25 * length, 8)
    made = []
    for tilt in (0.0, 0.5, 0.0, 0.5):
        shot = Snapshot(corners + s * rng.normal(size=corners.shape), length, tilt)
        made.append(number_variance(shot, radii, centres=8000))
    q = np.linspace(1e-4, 60.0, 60001)
    expected = []
    for r in radii:
        w = 4.0 * np.pi * (np.sin(q * r) - q * r * np.cos(q * r)) / q**3
        expected.append(simpson((1.0 - np.exp(-((q * s) ** 2))) * (w * q) ** 2, x=q) / (2.0 * np.pi**2) / spacing**3)
    variance = np.mean([m.variance for m in made], axis=0)
    np.testing.assert_allclose(variance, expected, rtol=0.12)
    theory, beta = slope(radii, expected), np.mean([m.beta for m in made])
    assert abs(theory - 2.0) < 0.15
    assert beta == pytest.approx(theory, abs=0.1)


def test_number_variance_is_the_same_in_tilted_cell_and_cube():
    """The tilt-1/2 cell and the cube of eight copies are the same points: the variances differ by the sampling of
    the test spheres only, here below 6 % each (20000 of them, 5 sigma of sqrt(2/M)), and beta by 0.05."""
    length = 17.0
    position = np.random.default_rng(5).random((300, 3)) @ cell_vectors(length, 0.5)
    radii = np.geomspace(2.0, 4.25, 6)
    tilted = number_variance(Snapshot(position, length, 0.5), radii, centres=20000)
    flat = number_variance(Snapshot(*doubled(position, length)), radii, centres=20000)
    np.testing.assert_allclose(tilted.variance, flat.variance, rtol=0.06)
    assert tilted.beta == pytest.approx(flat.beta, abs=0.05)


@pytest.mark.parametrize("tilt", [0.0, 0.31, -0.5])
def test_exact_number_variance_is_the_pair_sum(tilt):
    """Naive twin: every ordered pair and 27 images, fraction of common volume of two spheres from the cap formula.

    Beside it the definition itself, 400,000 counts in random places: within 5 standard errors of a variance,
    sqrt(2/M) of it, times 1.5 for the skew of few counts. Tolerance 1e-7: the bins of the squared distances.
    """
    length, radii = 14.0, np.array([2.0, 2.7, 3.5])
    rng = np.random.default_rng(17)
    position = rng.random((90, 3)) @ cell_vectors(length, tilt)
    position[1] = position[0] + [0.3, 0.1, 0.0]  # clustered: no fluid
    variance = exact_variance(Snapshot(position, length, tilt), radii)
    images = np.stack(np.meshgrid(*([-1, 0, 1],) * 3), -1).reshape(-1, 3) @ cell_vectors(length, tilt)
    shifted = position[:, None, None] - position[None, :, None] - images
    d = np.linalg.norm(shifted, axis=-1)
    d = d[d > 0.0]
    for r, found in zip(radii, variance, strict=True):
        volume, near = 4.0 * np.pi / 3.0 * r**3, d[d < 2.0 * r]
        cap = r - 0.5 * near
        common = 2.0 * np.pi * cap**2 * (3.0 * r - cap) / 3.0
        share = volume / length**3
        expected = len(position) * share * (1.0 - len(position) * share) + common.sum() / length**3
        assert found == pytest.approx(expected, rel=1e-7)
    sampled = number_variance(Snapshot(position, length, tilt), radii, centres=400_000)
    np.testing.assert_allclose(sampled.variance, variance, rtol=5.0 * 1.5 * math.sqrt(2.0 / 400_000))


def test_exact_number_variance_refuses_spheres_beyond_a_quarter_of_the_cell():
    with pytest.raises(ConfigurationError, match=r"above L/4"):
        exact_variance(Snapshot([[0.0, 0.0, 0.0], [3.0, 3.0, 3.0]], 12.0), np.array([3.1]))


def test_fit_of_beta_returns_what_it_was_given():
    """Exact data of the paper's form come back to 1e-6, with beta0 free or fixed to the first value."""
    strain = np.concatenate([[0.0], np.geomspace(1.0, 256.0, 20)])
    beta = (2.6 - 2.0) * (1.0 + strain) ** -0.29 + 2.0
    for free in (True, False):
        fit = fit_beta(strain, beta, free_start=free)
        assert (fit.beta0, fit.beta_inf, fit.nu) == pytest.approx((2.6, 2.0, -0.29), abs=1e-6)
        assert fit.determined
        assert fit.residual < 1e-8
    noisy = beta + 0.01 * np.random.default_rng(1).normal(size=beta.size)
    fit = fit_beta(strain, noisy)
    assert abs(fit.nu + 0.29) < 4.0 * fit.nu_error
    assert 0.01 < fit.nu_error < 0.2
    assert abs(fit.beta_inf - 2.0) < 4.0 * fit.beta_inf_error


def test_fit_of_beta_says_where_there_is_none():
    """Fewer than four values are refused; scatter about a constant gives no determined decay."""
    with pytest.raises(ConfigurationError, match="at least 4"):
        fit_beta([0.0, 1.0, 2.0], [2.5, 2.4, 2.3])
    flat = 2.1 + 0.02 * np.random.default_rng(0).normal(size=20)
    try:
        determined = fit_beta(np.linspace(0, 250, 20), flat).determined
    except ConfigurationError:
        determined = False
    assert not determined


def test_evolution_of_beta_has_a_row_per_frame_and_says_when_the_cell_is_too_small():
    import matplotlib.pyplot as plt

    rng = np.random.default_rng(6)
    shots = [Snapshot(rng.random((300, 3)) * 16.0, 16.0, total_strain=3.2 * k, cycle=k) for k in range(5)]
    variance = NumberVariance().compute_snapshots(shots)
    assert variance.table()["total_strain[-]"].tolist() == [3.2 * k for k in range(5)]
    assert variance.radii[[0, -1]] == pytest.approx([2.0, 4.0])
    assert variance.variance.shape == (5, 12)
    variance.plot(plt.figure().add_subplot())
    plt.close("all")
    with pytest.raises(ConfigurationError, match=r"L/4 is 2 a here"):
        NumberVariance().compute_snapshots([Snapshot(rng.random((20, 3)) * 8.0, 8.0)])


@pytest.mark.parametrize("tilt", [0.0, 0.37, -0.5])
def test_allowed_wave_vectors_are_all_of_the_reciprocal_lattice(tilt):
    """Every vector of a larger box of integers with |q| <= q_max, one of +-q; S against the plain sum (round-off)."""
    length, top = 7.0, 4.0
    n, q = allowed_vectors(length, tilt, top)
    reciprocal = 2.0 * np.pi * np.linalg.inv(cell_vectors(length, tilt)).T
    box = np.stack(np.meshgrid(*(np.arange(-8, 9),) * 3, indexing="ij"), axis=-1).reshape(-1, 3)
    size = np.linalg.norm(box @ reciprocal, axis=1)
    assert 2 * len(n) == np.count_nonzero((size > 0) & (size <= top))
    assert len({tuple(v) for v in np.vstack([n, -n]).tolist()}) == 2 * len(n)
    np.testing.assert_allclose(np.linalg.norm(n @ reciprocal, axis=1), q, rtol=1e-13)
    x = np.random.default_rng(2).normal(size=(700, 3)) * 9.0
    expected = np.abs(np.exp(-1j * (n @ reciprocal) @ x.T).sum(axis=1)) ** 2 / len(x)
    np.testing.assert_allclose(scattering(Snapshot(x, length, tilt), n), expected, rtol=1e-9, atol=1e-11)


def test_structure_factor_of_random_points_is_one():
    """S of each vector is exponentially distributed about 1: chi-squared of the shells within 5 sigma, S(0) = 1."""
    rng = np.random.default_rng(7)
    factor = StructureFactor(q_max=5.0).compute_snapshots([Snapshot(rng.random((2000, 3)) * 20.0, 20.0, 0.4)])
    chi = (factor.s - 1.0) * np.sqrt(factor.vectors)
    assert np.mean(chi**2) == pytest.approx(1.0, abs=5 * math.sqrt(2 / len(chi)))
    assert abs(chi.mean()) < 5 / math.sqrt(len(chi))
    fit = factor.hyperuniformity()
    assert fit.s0 == pytest.approx(1.0, abs=4 * fit.s0_error)
    assert fit.alpha == pytest.approx(0.0, abs=4 * fit.alpha_error)


def test_smallest_wave_vector_has_a_shell_of_its_own():
    """q = 2 pi/L: three vectors in the cube; in any tilt the first shell begins at 2 pi/L (along the vorticity)."""
    rng, unit = np.random.default_rng(1), 2.0 * np.pi / 17.0
    factor = StructureFactor().compute_snapshots([Snapshot(rng.random((50, 3)) * 17.0, 17.0)])
    assert factor.vectors[0] == 3
    assert factor.q[0] == pytest.approx(unit)
    for tilt in (0.3, -0.5):
        q = allowed_vectors(17.0, tilt, 3.0)[1]
        assert q.min() == pytest.approx(unit)


def test_structure_factor_of_lattices_has_bragg_peaks_and_nothing_else():
    """S = N at the lattice's own vectors, 0 elsewhere; also where the lattice is read in a cell of tilt 1/2."""
    position, length = lattice(SC, 6, 2.0)
    for tilt in (0.0, 0.5):
        n, _ = allowed_vectors(length, tilt, 7.0)
        s = scattering(Snapshot(position, length, tilt), n)
        reciprocal = 2.0 * np.pi * np.linalg.inv(cell_vectors(length, tilt)).T
        bragg = np.all(np.abs((n @ reciprocal) / np.pi - np.rint((n @ reciprocal) / np.pi)) < 1e-9, axis=1)
        assert bragg.sum() > 10
        np.testing.assert_allclose(s[bragg], len(position), rtol=1e-10)
        np.testing.assert_allclose(s[~bragg], 0.0, atol=1e-10)


def test_hyperuniformity_of_a_perturbed_lattice():
    """S = 1 - exp(-q^2 s^2): alpha near 2, S(0) = 0 within its error, far below the peak; a fluid-like S0 + c q^2
    comes back to round-off from exact data."""
    spacing, cells = 2.2, 16
    corners, length = lattice(SC, cells, spacing)
    shots = [
        Snapshot(corners + 0.6 * np.random.default_rng(k).normal(size=corners.shape), length, 0.5 * (k % 2))
        for k in range(4)
    ]
    factor = StructureFactor(q_max=3.0).compute_snapshots(shots)
    fit = factor.hyperuniformity(q_fit=0.8)
    assert fit.alpha == pytest.approx(2.0, abs=0.3)
    assert abs(fit.s0) < 3 * fit.s0_error + 2e-3
    theory = 1.0 - np.exp(-((0.6 * factor.q) ** 2))
    low = factor.q < 2.0  # below the first Bragg peak, 2 pi / 2.2
    chi = (factor.s[low] / theory[low] - 1.0) * np.sqrt(4 * factor.vectors[low])
    assert np.mean(chi**2) < 1.0 + 5 * math.sqrt(2 / low.sum()) + 0.5  # 0.5: shells have a width
    q = np.linspace(0.2, 2.0, 10)
    exact = fit_small_q(q, 0.05 + 0.3 * q**2, np.full(10, 50.0), 1.0)
    assert exact.s0 == pytest.approx(0.05, rel=1e-9)
    with pytest.raises(ConfigurationError, match="too few"):
        fit_small_q(q[:3], q[:3], q[:3], 1.0)


def test_small_samples_of_wave_vectors_are_unbiased_and_the_table_is_complete():
    """Five vectors a shell: still S = 1 for random points (5 sigma)."""
    rng = np.random.default_rng(3)
    factor = StructureFactor(per_shell=5).compute_snapshots([Snapshot(rng.random((800, 3)) * 20.0, 20.0)])
    assert factor.vectors.max() <= 10
    assert factor.s.mean() == pytest.approx(1.0, abs=5 / math.sqrt(factor.vectors.sum()))
    assert len({len(column) for column in factor.table().values()}) == 1
