"""Windows that carry loads to a grid: shapes, Fourier transforms, aliasing error, and the cheapest grid for an error.

A window w(x), x in grid cells, vanishes beyond |x| = P/2. With z = 2x/P and shape parameter c

    gaussian       exp(-c z^2 / 2)
    kaiser-bessel  I0(c sqrt(1 - z^2)) / I0(c)           (Kaiser 1966)
    pswf           psi_0^c(z), prolate function of order zero (Slepian & Pollak 1961)

of which the last concentrates most of its energy in |xi| < 2c/P, xi the wave number in radians per cell.
"""

from __future__ import annotations

import functools
import itertools
import math
from dataclasses import dataclass

import numpy as np
from scipy.special import ive

from suspend.errors import ConfigurationError
from suspend.hydro.ewald.split import Split, prolate

KINDS = ("gaussian", "kaiser-bessel", "pswf")
SUPPORTS = range(3, 17)
TILT_STRETCH = math.sqrt(1.25)  # |n2| <= sqrt(1 + tilt^2) kmax L/2pi, |tilt| <= 1/2
SELF_NORM2 = 3 * 1.0 + 3 * 0.75**2 + 5 * 0.9**2  # squared norm of the mobility of a lone sphere
LOWEST_MODES = 16.532  # sum of 1/n^4 over the integer lattice without 0


@functools.cache
def _prolate(shape: float) -> np.ndarray:
    return prolate(shape)[0]


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
        nodes, weights = np.polynomial.legendre.leggauss(24 + 3 * self.support)
        x = 0.5 * self.support * nodes
        return np.cos(np.outer(xi, x)) @ (0.5 * self.support * weights * self.value(x))

    def polynomials(self) -> np.ndarray:
        """w and its first and second derivative with respect to the centre, (3, degree + 1, P).

        Point l of the window lies at x = l - P/2 + f; polynomials in v = 2f - 1, highest power first, of the
        lowest degree whose error is below 1e-3 of the window's height at its edge (or 1e-15).
        """
        goal = max(1e-3 * float(self.value(np.array(0.5 * self.support))), 1e-15)
        left = np.arange(self.support) - 0.5 * self.support
        test = np.linspace(-1.0, 1.0, 33)
        exact = self.value(left + 0.5 * (test[:, None] + 1.0))
        for degree in range(4, 20):
            nodes = np.cos(np.pi * (np.arange(degree + 1) + 0.5) / (degree + 1))
            series = np.polynomial.chebyshev.chebfit(
                nodes, self.value(left + 0.5 * (nodes[:, None] + 1.0)), degree
            )
            if np.abs(np.polynomial.chebyshev.chebval(test, series).T - exact).max() <= goal:
                break
        out = np.zeros((3, degree + 1, self.support))
        for p in range(self.support):
            power = np.polynomial.chebyshev.cheb2poly(series[:, p])
            power = np.pad(power, (0, degree + 1 - len(power)))
            for n, sign in enumerate((1.0, -1.0, 1.0)):  # d/dx_centre = -d/df = -2 d/dv
                derivative = sign * 2.0**n * np.polynomial.polynomial.polyder(power, n)
                out[n, n:, p] = derivative[::-1]
        return out


def largest_modes(kmax: float, edge: float) -> tuple[int, int, int]:
    """Largest |n1|, |n2|, |n3| with |k| <= kmax at any tilt from -1/2 to 1/2."""
    reach = kmax * edge / (2.0 * math.pi)
    return int(reach), int(TILT_STRETCH * reach), int(reach)


def _errors(window: Window, xi: np.ndarray, offsets: int = 6) -> np.ndarray:
    """Errors of e^{-i xi x} and of its first and second derivative on the grid, (3, offsets, n), x in cells."""
    f = (np.arange(offsets) + 0.5) / offsets
    polynomials = window.polynomials()
    value = np.zeros((3, offsets, window.support))
    for d in range(polynomials.shape[1]):
        value = value * (2.0 * f - 1.0)[None, :, None] + polynomials[:, d, None, :]
    distance = np.arange(window.support) - 0.5 * window.support + f[:, None]
    phase = np.exp(-1j * distance[..., None] * xi)
    sums = np.einsum("nfp,fpx->nfx", value, phase) / window.transform(xi)
    return sums - np.stack([np.ones_like(xi), -1j * xi, -(xi**2)])[:, None, :]


@functools.cache
def _sample(radial: int = 20, directions: int = 48) -> tuple[np.ndarray, np.ndarray]:
    """Points (n, 3) of the unit ball and weights (n,) that integrate over it."""
    nodes, weights = np.polynomial.legendre.leggauss(radial)
    r, w = 0.5 * (nodes + 1.0), 0.5 * weights
    i = np.arange(directions) + 0.5
    z, turn = 1.0 - 2.0 * i / directions, np.pi * (1.0 + math.sqrt(5.0)) * i
    s = np.sqrt(1.0 - z**2)
    unit = np.stack([s * np.cos(turn), s * np.sin(turn), z], axis=1)
    points = (r[:, None, None] * unit).reshape(-1, 3)
    return points, np.repeat(4.0 * np.pi * r**2 * w / directions, directions)


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


def aliasing_error(
    split: Split, edge: float, number: int, grid: tuple[int, int, int], window: Window, tilt: float = 0.5
) -> float:
    """Predicted error of the wave part on a grid, relative 2-norm of all of [U; Omega; E] for random unit loads.

    Errors of the three axes' windows to first order, added as squares: those between different spheres as
    sums over modes of random phase, those of a sphere on itself as a sum of one phase.
    """
    points, weights = _sample()
    k = split.kmax * points
    k2 = (k**2).sum(axis=1)
    modes = weights * split.kmax**3 * (edge / (2.0 * np.pi)) ** 3
    b = 6.0 * np.pi / edge**3 * split.wave(np.sqrt(k2)) / k2
    a = 1.0 - k2 / 15.0
    load2 = a**2 + 0.75 * k2
    square = 0.0
    for axis, m in enumerate(grid):
        lattice = k[:, axis] + (tilt * k[:, 0] if axis == 1 else 0.0)
        xi = lattice * edge / m
        ends = np.linspace(0.0, np.abs(xi).max(), 25)
        table = _errors(window, ends)
        at = np.minimum((np.abs(xi) / ends[1]).astype(int), 23)
        u = np.abs(xi) / ends[1] - at
        errors = (1.0 - u) * table[:, :, at] + u * table[:, :, at + 1]
        errors = np.where(xi < 0.0, errors.conj(), errors)
        force, gradient = _load_errors(k, axis, tilt, errors, m / edge)
        error2 = (np.abs(force) ** 2 + 0.75 * (np.abs(gradient) ** 2).sum(axis=0)).mean(axis=0)
        square += number * 4.0 * (modes * b**2 * error2 * load2).sum()
        on_force = (modes * b * (4.0 / 3.0) * (a * force).real).sum(axis=1)
        along = np.einsum("np,pfn->fn", k, gradient)
        on_gradient = (modes * b * (3.0 / 8.0) * (1j * along).real).sum(axis=1)
        square += 3.0 * (on_force**2).mean() + 8.0 * (on_gradient**2).mean()
    waves = 72.0 * LOWEST_MODES / (16.0 * np.pi**2) * number / edge**2
    return math.sqrt(square / (SELF_NORM2 + waves))
