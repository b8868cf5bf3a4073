"""Windows that carry loads to a grid: shapes, Fourier transforms, aliasing error, and the cheapest grid for an error.

A window w(x), x in grid cells, vanishes beyond |x| = P/2. With z = 2x/P and shape parameter c

    gaussian       exp(-c z^2 / 2)
    kaiser-bessel  I0(c sqrt(1 - z^2)) / I0(c)           (Kaiser 1966)
    pswf           psi_0^c(z), prolate function of order zero (Slepian & Pollak 1961)

of which the last concentrates most of its energy in |xi| < 2c/P, xi the wave number in radians per cell.
"""

from __future__ import annotations

import functools
import math
from dataclasses import dataclass

import numpy as np
from scipy.optimize import minimize_scalar
from scipy.special import ive

from suspend.errors import ConfigurationError
from suspend.hydro.ewald.split import Split, prolate
from suspend.hydro.two_sphere_matrices import FIVE, LEVI_CIVITA

KINDS = ("gaussian", "kaiser-bessel", "pswf")
LARGEST_SUPPORT = 20
SAFETY = 1.25  # between the predicted aliasing error and the one asked for
TILT_STRETCH = math.sqrt(1.25)  # |n2| <= sqrt(1 + tilt^2) kmax L/2pi, |tilt| <= 1/2
SELF_NORM2 = 3 * 1.0 + 3 * 0.75**2 + 5 * 0.9**2  # squared norm of the mobility of a lone sphere
LOWEST_MODES = 16.532  # sum of 1/n^4 over the integer lattice without 0


@functools.cache
def _prolate(shape: float) -> np.ndarray:
    return prolate(shape)[0]


_gauss = functools.cache(np.polynomial.legendre.leggauss)


@functools.cache
def _chebyshev_powers(number: int = 20) -> np.ndarray:
    """Columns: ascending power coefficients of the Chebyshev polynomials."""
    columns = [np.polynomial.chebyshev.cheb2poly(unit) for unit in np.eye(number)]
    return np.array([np.pad(column, (0, number - len(column))) for column in columns]).T


@dataclass(frozen=True)
class Window:
    """A window: kind, support P (grid points) and shape parameter c."""

    kind: str
    support: int
    shape: float

    def __post_init__(self):
        if self.kind not in KINDS:
            raise ConfigurationError(f"far_field window: {self.kind!r} is none of {', '.join(KINDS)}")
        if self.support < 2 or not self.shape > 0:
            raise ConfigurationError(
                f"far_field window: support {self.support} and shape {self.shape:g}; "
                "needed are 2 grid points or more and a positive shape"
            )

    def value(self, x: np.ndarray) -> np.ndarray:
        """w(x), |x| <= P/2 in cells; 1 at x = 0."""
        z = np.clip(2.0 * np.asarray(x, dtype=float) / self.support, -1.0, 1.0)
        c = self.shape
        if self.kind == "gaussian":
            return np.exp(-0.5 * c * z**2)
        if self.kind == "kaiser-bessel":
            root = np.sqrt(1.0 - z**2)
            return ive(0, c * root) * np.exp(c * (root - 1.0)) / ive(0, c)
        return np.polynomial.legendre.legval(z, _prolate(c))

    def transform(self, xi: np.ndarray) -> np.ndarray:
        """Fourier transform int w(x) cos(xi x) dx at xi (n,), radians per cell, by Gauss-Legendre quadrature."""
        nodes, weights = _gauss(24 + 3 * self.support)
        x = 0.5 * self.support * nodes
        return np.cos(np.outer(xi, x)) @ (0.5 * self.support * weights * self.value(x))

    @functools.lru_cache(256)  # noqa: B019 - windows are small and few
    def polynomials(self) -> np.ndarray:
        """w and its first and second derivative with respect to the centre, (3, degree + 1, P).

        Point l of the window lies at x = l - P/2 + f; polynomials in v = 2f - 1, highest power first. The degree
        is the lowest whose second derivative is wrong by less than a tenth of (2c/P)^2 w(P/2), or 19.
        """
        nodes = np.cos(np.pi * (np.arange(20) + 0.5) / 20)
        x = np.arange(self.support) - 0.5 * self.support + 0.5 * (nodes[:, None] + 1.0)
        series = np.polynomial.chebyshev.chebfit(nodes, self.value(x), 19)
        edge = float(self.value(np.array(0.5 * self.support)))
        terms = 4.0 / 3.0 * np.arange(20)[:, None] ** 4 * np.abs(series)  # bound their second derivatives
        tail = np.cumsum(terms[::-1], axis=0)[::-1].max(axis=1)
        degree = max(3, int((tail > 0.1 * (2.0 * self.shape / self.support) ** 2 * edge).sum()) - 1)
        series = series[: degree + 1]
        power = _chebyshev_powers()[: degree + 1, : degree + 1] @ series  # ascending powers of v
        out = np.zeros((3, degree + 1, self.support))
        for n, sign in enumerate((1.0, -1.0, 1.0)):  # d/dx_centre = -d/df = -2 d/dv
            derivative = sign * 2.0**n * np.polynomial.polynomial.polyder(power, n)
            out[n, n:] = derivative[::-1]
        return out


def largest_modes(kmax: float, edge: float) -> tuple[int, int, int]:
    """Largest |n1|, |n2|, |n3| with |k| <= kmax at any tilt from -1/2 to 1/2."""
    reach = kmax * edge / (2.0 * math.pi)
    return int(reach), int(TILT_STRETCH * reach), int(reach)


@functools.cache
def _offsets(number: int = 6) -> tuple[np.ndarray, np.ndarray]:
    """Places in a cell and their weights, dense near its end, where the outermost point enters the window.

    Half a cell: the other half mirrors it.
    """
    nodes, weights = _gauss(number)
    u = 0.5 * (nodes + 1.0)
    return 0.5 * u**2, weights * u


def _errors(window: Window, xi: np.ndarray) -> np.ndarray:
    """Errors of e^{-i xi x} and its first and second derivative at `_offsets`, (3, offsets, n), x in cells."""
    f, _ = _offsets()
    polynomials = window.polynomials()
    value = np.zeros((3, len(f), window.support))
    for d in range(polynomials.shape[1]):
        value = value * (2.0 * f - 1.0)[None, :, None] + polynomials[:, d, None, :]
    distance = np.arange(window.support) - 0.5 * window.support + f[:, None]
    phase = np.exp(-1j * distance[..., None] * xi)
    sums = np.einsum("nfp,fpx->nfx", value, phase) / window.transform(xi)
    return sums - np.stack([np.ones_like(xi), -1j * xi, -(xi**2)])[:, None, :]


def _sample(inner: float, radial: int, directions: int) -> tuple[np.ndarray, np.ndarray]:
    """Points (n, 3) of the unit ball without a ball of radius `inner`, weights (n,) that integrate over it."""
    nodes, weights = _gauss(radial)
    r, w = inner + 0.5 * (1.0 - inner) * (nodes + 1.0), 0.5 * (1.0 - inner) * weights
    i = np.arange(directions) + 0.5
    z, turn = 1.0 - 2.0 * i / directions, np.pi * (1.0 + math.sqrt(5.0)) * i
    s = np.sqrt(1.0 - z**2)
    unit = np.stack([s * np.cos(turn), s * np.sin(turn), z], axis=1)
    points = (r[:, None, None] * unit).reshape(-1, 3)
    return points, np.repeat(4.0 * np.pi * r**2 * w / directions, directions)


def _interpolated(table: np.ndarray, step: float, xi: np.ndarray) -> np.ndarray:
    """A `_errors` table at 0, step, 2 step, ..., at many xi of either sign, by linear interpolation."""
    at = np.minimum((np.abs(xi) / step).astype(int), table.shape[2] - 2)
    u = np.abs(xi) / step - at
    errors = (1.0 - u) * table[:, :, at] + u * table[:, :, at + 1]
    return np.where(xi < 0.0, errors.conj(), errors)


def _load_errors(k, axis, tilt, errors, scale):
    """Errors of 1 + lap/15 (f, n) and of the gradient (3, f, n) of the mode k (n, 3) from one axis's window.

    errors (3, f, n) of `_errors` along `axis`; scale = M/L.
    """
    kappa = np.array([k[:, 0], k[:, 1] + tilt * k[:, 0], k[:, 2]])  # D = -i kappa
    metric = np.array([[1.0 + tilt**2, -tilt, 0.0], [-tilt, 1.0, 0.0], [0.0, 0.0, 1.0]])
    e0, e1, e2 = errors[0], scale * errors[1], scale**2 * errors[2]
    others = [d for d in range(3) if d != axis]
    lap = metric[axis, axis] * e2
    for d in others:
        lap = lap - 2.0 * metric[axis, d] * 1j * kappa[d] * e1
        for b in others:
            lap = lap - metric[d, b] * kappa[d] * kappa[b] * e0
    lattice = [e1 if d == axis else -1j * kappa[d] * e0 for d in range(3)]
    return e0 + lap / 15.0, np.stack([lattice[0], lattice[1] - tilt * lattice[0], lattice[2]])


def _functionals(force: np.ndarray, gradient: np.ndarray) -> np.ndarray:
    """Rows [F, T, S] of the functional (n, 11, 3) whose force and gradient parts are (n,) and (3, n)."""
    rows = np.zeros((len(force), 11, 3), dtype=complex)
    rows[:, [0, 1, 2], [0, 1, 2]] = force[:, None]
    rows[:, 3:6] = -0.5 * np.einsum("rpk,pn->nkr", LEVI_CIVITA, gradient)
    rows[:, 6:] = np.einsum("arp,pn->nar", FIVE, gradient)
    return rows


def aliasing_parts(
    split: Split,
    edge: float,
    grid: tuple[int, int, int],
    window: Window,
    tilt: float,
    sample: tuple[int, int],
) -> tuple[float, float]:
    """Mean squared norm (Frobenius) of the error of the mobility of a sphere on itself and on another one.

    Errors of the three axes' windows to first order, added as squares, averaged over positions: on itself the
    modes add up with one phase, on another sphere at random (by Parseval's theorem). sample : numbers of |k| and
    directions.
    """
    volume = (2.0 * np.pi / edge) ** 3  # of a mode; the one at k = 0 is left out
    points, weights = _sample(min(0.9, (0.75 / np.pi * volume) ** (1 / 3) / split.kmax), *sample)
    k = split.kmax * points
    k2 = (k**2).sum(axis=1)
    modes = weights * split.kmax**3 / volume
    b = 6.0 * np.pi / edge**3 * split.wave(np.sqrt(k2)) / k2
    exact = _functionals(1.0 - k2 / 15.0, -1j * k.T)
    transverse = np.eye(3) - k[:, :, None] * k[:, None, :] / k2[:, None, None]
    exact = exact @ transverse
    load2 = (np.abs(exact) ** 2).sum(axis=(1, 2))
    xi = (k + tilt * k[:, :1] * [0.0, 1.0, 0.0]) * edge / grid  # radians per cell along the lattice vectors
    ends = np.linspace(0.0, np.abs(xi).max(), 25)
    table = _errors(window, ends)
    own = other = 0.0
    for axis, m in enumerate(grid):
        errors = _interpolated(table, ends[1], xi[:, axis])
        force, gradient = _load_errors(k, axis, tilt, errors, m / edge)
        for f, share in enumerate(_offsets()[1]):
            wrong = _functionals(force[f], gradient[:, f])
            half = np.tensordot((modes * b)[:, None, None] * exact.conj(), wrong, axes=((0, 2), (0, 2))).real
            own += share * ((half + half.T) ** 2).sum()
            wrong2 = (np.abs(wrong @ transverse) ** 2).sum(axis=(1, 2))
            other += share * (modes * b**2 * wrong2 * load2).sum()
    return own, other


def whole_norm(number: int, edge: float) -> float:
    """Norm of [U; Omega; E] per sphere for random unit loads: a sphere's own part and the longest waves."""
    waves = 72.0 * LOWEST_MODES / (16.0 * math.pi**2) * number / edge**2
    return math.sqrt(SELF_NORM2 + waves)


def aliasing_error(
    split: Split, edge: float, number: int, grid: tuple[int, int, int], window: Window, sample=(12, 24)
) -> float:
    """Predicted error of the wave part on a grid, relative 2-norm of all of [U; Omega; E] for random unit loads.

    At a tilt of 1/2, the worst. To first order in the aliasing; measured errors lie within a third of it.
    """
    own, other = aliasing_parts(split, edge, grid, window, 0.5, sample)
    return math.sqrt(own + number * other) / whole_norm(number, edge)


def matched_shape(kind: str, support: int, oversampling: float) -> float:
    """Shape parameter near which the aliasing error is least (fitted to `aliasing_error`), oversampling = M/(2 n_max).

    pi P (1 - 1/(2 oversampling)) would put the nearest aliases of the largest mode at the edge of the band; more is
    better because of the second derivatives, which feel the step at the end of the window. `best_window` searches.
    """
    band = math.pi * support * (1.0 - 0.5 / oversampling)
    return band * {"gaussian": 1.4, "kaiser-bessel": 1.17 + 1.3 / support, "pswf": 1.19 + 1.3 / support}[kind]


def smooth_sizes(first: int, last: int, even: bool) -> list[int]:
    """Sizes 2^a 3^b 5^c 7^d from `first` to `last`, which transform fast."""
    sizes = []
    for m in range(first, last + 1):
        rest = m
        for prime in (2, 3, 5, 7):
            while rest % prime == 0:
                rest //= prime
        if rest == 1 and (m % 2 == 0 or not even):
            sizes.append(m)
    return sizes


def grid_of(size: int, largest: tuple[int, int, int], support: int) -> tuple[int, int, int]:
    """Grid with `size` points along axes 1 and 3 and as fine a one along axis 2 at a tilt of 1/2."""
    least = max(math.ceil(TILT_STRETCH * size - 1e-9), 2 * largest[1] + 1, support)
    return size, smooth_sizes(least, 2 * least + 8, False)[0], size


# Slow-down of the transforms by the bytes of the grid: held by the nearest caches, by the last one (32 MB), by none.
OUT_OF_CACHE = ((10_000_000, 1.0), (28_000_000, 1.1), (math.inf, 2.4))


def wave_cost(number: int, grid: tuple[int, int, int], largest: tuple[int, int, int], support: int) -> float:
    """Estimated time of one product, seconds on one core (measured on a Zen 5 core at 2.6 GHz).

    7 ns a row of 8 points of a stencil and pass; 0.6 ns (sizes 2^a up to 64) to 2 ns a point and transform, more
    where the grid does not fit into the cache.
    """
    m1, m2, m3 = grid
    slower = next(factor for most, factor in OUT_OF_CACHE if 24 * m1 * m2 * m3 <= most)

    def per_point(size, otherwise):
        return slower * (0.6 if size in (8, 16, 32, 64) else otherwise)

    columns = 3 * (largest[0] + 1)
    strips = -(-support // 8)
    stencils = number * (80.0 + 7.0 * support**2 * strips * (0.8 if support <= 4 else 1.0))
    axis1 = 6 * m1 * m2 * m3 * per_point(m1, 1.1)
    axis2 = 2 * columns * m2 * m3 * per_point(m2, 1.25)
    axis3 = 2 * columns * m3 * (2 * largest[1] + 1) * per_point(m3, 2.0)
    return 1e-9 * (stencils + axis1 + axis2 + axis3 + 1.3 * columns * m2 * m3 + 1.5 * m1 * m2 * m3)


def best_window(
    split: Split, edge: float, number: int, grid: tuple[int, int, int], kind: str, support: int
) -> Window:
    """Window of this support whose shape makes `aliasing_error` least on a grid."""
    start = matched_shape(kind, support, max(grid[0] * math.pi / (split.kmax * edge), 1.0))

    def logarithm(t):
        return math.log(aliasing_error(split, edge, number, grid, Window(kind, support, start * t), (6, 10)))

    factor = minimize_scalar(logarithm, bounds=(0.6, 1.2), method="bounded", options={"maxiter": 7}).x
    return Window(kind, support, start * float(factor))


def _least_size(split, edge, number, support, kind, error):
    """Smallest grid size (axes 1 and 3) for the error with this support, or None; and its window."""
    largest = largest_modes(split.kmax, edge)
    least = max(2 * largest[0] + 1, support)
    sizes = smooth_sizes(least, int(2.2 * least) + 4, True)

    def passes(size):
        grid = grid_of(size, largest, support)
        window = best_window(split, edge, number, grid, kind, support)
        return SAFETY * aliasing_error(split, edge, number, grid, window) <= error

    if not sizes or not passes(sizes[-1]):
        return None
    low, high = -1, len(sizes) - 1
    while high - low > 1:
        middle = (low + high) // 2
        low, high = (low, middle) if passes(sizes[middle]) else (middle, high)
    # A size more convenient for the transforms may be cheaper than the smallest.
    costs = [wave_cost(number, grid_of(m, largest, support), largest, support) for m in sizes[high:]]
    best = sizes[high + int(np.argmin(costs))]
    grid = grid_of(best, largest, support)
    return min(costs), grid, best_window(split, edge, number, grid, kind, support)


@functools.lru_cache(64)
def choose_window(
    split: Split, edge: float, error: float, number: int, kind: str = "pswf"
) -> tuple[tuple[int, int, int], Window]:
    """Cheapest grid and window whose aliasing error is at most `error`, for `number` spheres.

    error : relative 2-norm of all of [U; Omega; E] for random unit loads; see `aliasing_error`.
    Raises ConfigurationError if no support up to `LARGEST_SUPPORT` reaches it (round-off ends at about 1e-12).
    """
    if not 0 < error < 1:
        raise ConfigurationError(f"far_field: a window error of {error:g}; needed is 0 < error < 1")
    best, since = None, 0
    for support in range(max(3, round(-0.9 * math.log10(error))), LARGEST_SUPPORT + 1):
        found = _least_size(split, edge, number, support, kind, error)
        if found is not None and (best is None or found[0] < best[0]):
            best, since = found, 0
        elif best is not None:
            since += 1
            if since == 2:  # the cost has its minimum behind it
                break
    if best is None:
        raise ConfigurationError(
            f"far_field: no {kind} window of up to {LARGEST_SUPPORT} points has an error of {error:g}; "
            "raise the tolerance"
        )
    return best[1], best[2]
