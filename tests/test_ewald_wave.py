"""Wave part of the far-field mobility: windows, grids, and the product against a direct sum over modes."""

import math

import numpy as np
import pytest

from suspend.errors import ConfigurationError
from suspend.hydro.ewald.split import gaussian_split, pswf_split
from suspend.hydro.ewald.wave import WavePart
from suspend.hydro.ewald.windows import (
    KINDS,
    Window,
    aliasing_error,
    choose_window,
    grid_of,
    largest_modes,
    matched_shape,
    smooth_sizes,
)

FIVE = np.zeros((5, 3, 3))  # the package's basis, written out again
FIVE[0] = np.diag([1, -1, 0]) / math.sqrt(2)
FIVE[1] = np.diag([-1, -1, 2]) / math.sqrt(6)
for _a, (_i, _j) in enumerate(((0, 1), (0, 2), (1, 2)), start=2):
    FIVE[_a, _i, _j] = FIVE[_a, _j, _i] = 1 / math.sqrt(2)
EPSILON = np.zeros((3, 3, 3))
for _i in range(3):
    EPSILON[_i, (_i + 1) % 3, (_i + 2) % 3], EPSILON[_i, (_i + 2) % 3, (_i + 1) % 3] = 1, -1


def direct_sum(position, tilt, edge, split, loads):
    """Naive twin: all modes, all spheres, the formulas of the module's docstring word by word."""
    most = math.ceil(1.2 * split.kmax * edge / (2 * np.pi))
    reach = range(-most, most + 1)
    n = np.array([(a, b, c) for a in reach for b in reach for c in reach])
    k = 2 * np.pi / edge * np.stack([n[:, 0], n[:, 1] - tilt * n[:, 0], n[:, 2]], axis=1)
    k2 = (k**2).sum(axis=1)
    k, k2 = k[(k2 > 0) & (k2 < split.kmax**2)], k2[(k2 > 0) & (k2 < split.kmax**2)]
    dipole = np.einsum("na,aij->nij", loads[:, 6:], FIVE)
    dipole -= 0.5 * np.einsum("qpk,nk->nqp", EPSILON, loads[:, 3:6])
    phase = np.exp(-1j * k @ position.T)
    f = (phase @ loads[:, :3]) * (1 - k2 / 15)[:, None] - 1j * np.einsum("kp,kn,nqp->kq", k, phase, dipole)
    f = f - k * (np.einsum("kq,kq->k", k, f) / k2)[:, None]
    u = (6 * np.pi / edge**3 * split.wave(np.sqrt(k2)) / k2)[:, None] * f
    velocity = (phase.conj().T @ (u * (1 - k2 / 15)[:, None])).real
    gradient = np.einsum("kn,kp,kq->npq", phase.conj(), 1j * k, u).real
    spin = 0.5 * np.einsum("kpq,npq->nk", EPSILON, gradient)
    return np.concatenate([velocity, spin, np.einsum("apq,npq->na", FIVE, gradient)], axis=1)


def scene(number, edge, seed=1):
    rng = np.random.default_rng(seed)
    return edge * rng.random((number, 3)), rng.standard_normal((number, 11))


def product(position, tilt, edge, split, loads, grid, window, threads=1):
    wave = WavePart(edge, split, grid, window, threads)
    wave.place(position, tilt)
    result = np.zeros_like(loads)
    wave.add(loads, result)
    return result


def accurate(split, edge, support=14):
    """Grid and window whose error is below 1e-9."""
    size = smooth_sizes(math.ceil(1.6 * (2 * largest_modes(split.kmax, edge)[0] + 1)), 1000, True)[0]
    grid = grid_of(max(size, support), largest_modes(split.kmax, edge), support)
    return grid, Window("pswf", support, matched_shape("pswf", support, 1.6))


SPLIT = pswf_split(4.0, 1e-4)


@pytest.mark.parametrize("tilt", [0.0, 0.37, -0.5])
@pytest.mark.parametrize("split", [SPLIT, gaussian_split(4.0, 1e-2)], ids=["pswf", "gaussian"])
def test_equals_the_direct_sum_over_modes(split, tilt):
    """All 11 loads to all 11 motions; 1e-8 is above the window's predicted error (about 1e-9)."""
    edge = 7.0
    position, loads = scene(6, edge)
    expected = direct_sum(position, tilt, edge, split, loads)
    got = product(position, tilt, edge, split, loads, *accurate(split, edge))
    assert np.linalg.norm(got - expected) < 1e-8 * np.linalg.norm(expected)


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("error", [1e-2, 1e-4, 1e-7])
def test_error_is_the_one_asked_for(kind, error):
    """`choose_window` delivers at most the error asked for, and not more than 1/30 of it.

    40 spheres at random, norm of the whole mobility as in `aliasing_error`. The support is an integer
    and one point of it is worth a factor of 5 to 10, hence the lower bound.
    """
    number, edge = 40, 9.0
    position, loads = scene(number, edge, 3)
    grid, window = choose_window(SPLIT, edge, error, number, kind)
    expected = product(position, 0.5, edge, SPLIT, loads, *accurate(SPLIT, edge))
    got = product(position, 0.5, edge, SPLIT, loads, grid, window)
    whole = math.sqrt(number * (8.7375 + 7.54 * number / edge**2))
    assert error / 30 < np.linalg.norm(got - expected) / whole <= error


def test_predicted_error_is_the_measured_one():
    """To first order in the aliasing the prediction is exact in the mean: within 1.5 for 300 spheres."""
    number, edge = 300, 14.6
    position, loads = scene(number, edge, 5)
    expected = product(position, 0.5, edge, SPLIT, loads, *accurate(SPLIT, edge))
    whole = math.sqrt(number * (8.7375 + 7.54 * number / edge**2))
    for kind, support, shape in (("gaussian", 7, 14.0), ("kaiser-bessel", 6, 12.0), ("pswf", 8, 15.0)):
        grid, window = (24, 28, 24), Window(kind, support, shape)
        got = product(position, 0.5, edge, SPLIT, loads, grid, window)
        ratio = np.linalg.norm(got - expected) / whole / aliasing_error(SPLIT, edge, number, grid, window)
        assert 1 / 1.5 < ratio < 1.5


@pytest.mark.parametrize("support", [4, 7, 11])
def test_symmetric_and_positive_on_a_coarse_grid(support):
    """Interpolation is the transpose of spreading, so the matrix is A^T B A with B >= 0 whatever the window."""
    edge, tilt = 6.0, -0.31
    position, _ = scene(3, edge)
    window = Window("kaiser-bessel", support, 2.0 * support)
    wave = WavePart(edge, SPLIT, (12, 14, 12), window)
    wave.place(position, tilt)
    matrix = np.zeros((33, 33))
    for column in range(33):
        result = np.zeros(33)
        result[column] = 1.0
        motion = np.zeros((3, 11))
        wave.add(result.reshape(3, 11), motion)
        matrix[:, column] = motion.ravel()
    assert np.abs(matrix - matrix.T).max() < 1e-13 * np.abs(matrix).max()
    assert np.linalg.eigvalsh(matrix + matrix.T).min() > -1e-13


def test_unchanged_by_the_wrap_of_the_tilt_by_translation_and_by_lattice_vectors():
    """Tilts 1/2 and -1/2 are the same lattice; the flow does not know where the grid is (window error 1e-9)."""
    edge = 7.0
    position, loads = scene(5, edge)
    grid, window = accurate(SPLIT, edge)
    expected = product(position, 0.5, edge, SPLIT, loads, grid, window)
    scale = np.linalg.norm(expected)
    wrapped = product(position, -0.5, edge, SPLIT, loads, grid, window)
    moved = product(position + np.array([0.3, -20.1, 5.7]), 0.5, edge, SPLIT, loads, grid, window)
    images = position + edge * np.array([[0.5, 1, 0], [-1, 0, 0], [0, 0, -3], [1.5, 1, 1], [0, 0, 0]])
    assert np.linalg.norm(wrapped - expected) < 1e-8 * scale
    assert np.linalg.norm(moved - expected) < 1e-8 * scale
    imaged = product(images, 0.5, edge, SPLIT, loads, grid, window)
    assert np.linalg.norm(imaged - expected) < 1e-12 * scale


def test_one_sphere_whose_window_fills_the_cell():
    """N = 1 with as many grid points as the window has: every row wraps onto itself."""
    edge = 3.0
    position, loads = scene(1, edge)
    expected = direct_sum(position, 0.2, edge, SPLIT, loads)
    window = Window("pswf", 14, matched_shape("pswf", 14, 1.6))
    got = product(position, 0.2, edge, SPLIT, loads, (14, 14, 14), window)
    assert np.linalg.norm(got - expected) < 1e-8 * np.linalg.norm(expected)


def test_a_second_placement_forgets_the_first():
    """The same object at other positions, another tilt and another number of spheres."""
    edge = 7.0
    grid, window = accurate(SPLIT, edge)
    wave = WavePart(edge, SPLIT, grid, window)
    for number, tilt in ((4, 0.1), (4, 0.4), (9, 0.4)):
        position, loads = scene(number, edge, number)
        wave.place(position, tilt)
        result = np.ones((number, 11))
        wave.add(loads, result)
        fresh = product(position, tilt, edge, SPLIT, loads, grid, window)
        np.testing.assert_allclose(result, 1.0 + fresh, rtol=1e-13, atol=1e-14)


def test_results_do_not_depend_on_the_number_of_threads():
    """Planes, transforms and spheres are cut into parts, each summed in the same order: equal bit for bit."""
    edge = 9.0
    position, loads = scene(50, edge)
    window = Window("pswf", 6, 13.0)
    one, two, five = (
        product(position, 0.2, edge, SPLIT, loads, (20, 24, 20), window, threads) for threads in (1, 2, 5)
    )
    assert np.array_equal(one, two)
    assert np.array_equal(one, five)


def test_transform_of_the_windows():
    """Kaiser-Bessel: P sinh(root)/(root I0(c)), root^2 = c^2 - (xi P/2)^2; prolate: its own transform up to scale."""
    xi = np.linspace(0.0, 2.5, 9)
    root = np.sqrt(15.0**2 - (3.5 * xi) ** 2)
    expected = 7.0 * np.sinh(root) / (root * np.i0(15.0))
    np.testing.assert_allclose(Window("kaiser-bessel", 7, 15.0).transform(xi), expected, rtol=1e-12)
    prolate = Window("pswf", 7, 15.0)
    ratio = prolate.transform(xi) / prolate.value(xi * 7**2 / (4 * 15.0))
    np.testing.assert_allclose(ratio, ratio[0], rtol=1e-9)


@pytest.mark.parametrize("kind", KINDS)
def test_polynomials_of_the_windows(kind):
    """Value and derivatives with respect to the centre, by central differences of the window itself.

    The degree is chosen for a second derivative good to 0.1 (2c/P)^2 w(P/2); the differences are to about 3e-7.
    """
    window = Window(kind, 8, 16.0)
    height = float(window.value(np.array(4.0)))
    polynomials = window.polynomials()
    f, h = np.array([0.2, 0.5, 0.9]), 1e-4
    x = np.arange(8) - 4.0 + f[:, None]
    inside = np.abs(x) + h < 4.0
    powers = (2 * f - 1)[:, None] ** np.arange(polynomials.shape[1])[::-1]
    got = np.einsum("fd,ndp->nfp", powers, polynomials)
    ahead, here, behind = window.value(x - h), window.value(x), window.value(x + h)
    expected = here, (ahead - behind) / (2 * h), (ahead - 2 * here + behind) / h**2
    for n in range(3):
        np.testing.assert_allclose(got[n][inside], expected[n][inside], atol=3e-7 + 1.6 * height)


def test_unusable_parameters_are_refused():
    with pytest.raises(ConfigurationError, match="grid"):
        WavePart(9.0, SPLIT, (10, 10, 10), Window("pswf", 6, 13.0))
    with pytest.raises(ConfigurationError, match="window"):
        Window("hann", 6, 13.0)
    with pytest.raises(ConfigurationError, match="window"):
        Window("pswf", 1, 13.0)
    with pytest.raises(ConfigurationError, match="raise the tolerance"):
        choose_window(SPLIT, 9.0, 1e-15, 10)
