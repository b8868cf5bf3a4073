"""Bond order of neighbours that are known: what it is, apart from how they are found."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

BOND_RANGE = 2.8  # 1.4 diameters: the first minimum of g(r) in dense sphere suspensions
SOLID_BONDS = 7  # a sphere with this many parallel q6 bonds counts as crystalline
PARALLEL = 0.7  # q6 bonds with a normalised scalar product above this are parallel


class Pairs(NamedTuple):
    """Directed pairs: both (i, j) and (j, i) appear, each with every image in range."""

    first: np.ndarray  # (P,) int, sphere i
    second: np.ndarray  # (P,) int, sphere j
    vector: np.ndarray  # (P,3) from i to the image of j
    distance: np.ndarray  # (P,)


class BondOrder(NamedTuple):
    """Steinhardt order of the bonds within a range (see `bond_order`)."""

    global_q6: float
    local_q6: float
    crystal_fraction: float
    bonds: int


def sixth_harmonics(vectors: np.ndarray) -> np.ndarray:
    """The 13 real spherical harmonics of degree 6 of the directions `vectors` (P,3), shape (P,13).

    Scaled so that the product of two rows is the Legendre polynomial P6 of the angle between them.
    """
    u = vectors / np.linalg.norm(vectors, axis=1, keepdims=True)
    z = u[:, 2]
    w = u[:, 0] + 1j * u[:, 1]
    z2 = z * z
    polynomials = (
        (math.sqrt(21.0) / 8.0, z * (33.0 * z2 * z2 - 30.0 * z2 + 5.0)),
        (math.sqrt(105.0 / 2.0) / 16.0, 33.0 * z2 * z2 - 18.0 * z2 + 1.0),
        (math.sqrt(105.0 / 2.0) / 8.0, z * (11.0 * z2 - 3.0)),
        (math.sqrt(63.0) / 16.0, 11.0 * z2 - 1.0),
        (math.sqrt(693.0 / 2.0) / 8.0, z),
        (math.sqrt(231.0 / 2.0) / 16.0, np.ones_like(z)),
    )
    columns = [(231.0 * z2**3 - 315.0 * z2 * z2 + 105.0 * z2 - 5.0) / 16.0]
    power = np.ones_like(w)
    for factor, polynomial in polynomials:
        power = power * w
        columns += [factor * polynomial * power.real, factor * polynomial * power.imag]
    return np.column_stack(columns)


def bond_order_of_pairs(pairs: Pairs, n: int) -> BondOrder:
    """`bond_order` of n spheres whose bonds are known."""
    if len(pairs.distance) == 0:
        return BondOrder(0.0, 0.0, 0.0, 0)
    harmonics = sixth_harmonics(pairs.vector)
    neighbours = np.bincount(pairs.first, minlength=n)
    sums = np.column_stack([np.bincount(pairs.first, column, minlength=n) for column in harmonics.T])
    norms = np.sqrt(np.sum(sums**2, axis=1))
    local = norms / np.maximum(neighbours, 1)
    unit = sums / np.maximum(norms, 1e-300)[:, None]
    parallel = np.sum(unit[pairs.first] * unit[pairs.second], axis=1) > PARALLEL
    connections = np.bincount(pairs.first, parallel, minlength=n)
    return BondOrder(
        float(np.linalg.norm(harmonics.mean(axis=0))),
        float(local.mean()),
        float(np.mean(connections >= SOLID_BONDS)),
        len(pairs.distance) // 2,
    )
