"""Structure of a configuration in the sheared periodic cell: pairs, contact value of g(r), bond order.

Lengths in sphere radii unless said otherwise; the cell is (L,0,0), (tilt L, L, 0), (0,0,L).
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from suspend.bonds import BOND_RANGE, BondOrder, Pairs, bond_order_of_pairs
from suspend.box import cell_vectors, flips_of, wrap
from suspend.core.cell_list import cells_along, collect, sort_into_bins

MINIMUM_PAIRS = 30  # below this many pairs in the shell a contact value says nothing


class ContactValue(NamedTuple):
    """g(r) at contact and its standard error from counting; both NaN where too few pairs are near."""

    value: float
    error: float
    pairs: int


def pairs_within(positions: np.ndarray, length: float, reach: float, tilt: float = 0.0) -> Pairs:
    """All directed pairs with centre distance <= reach, every periodic image included (a sphere's own too).

    positions (N,3), any units, equal to those of length and reach; tilt any real number; reach may exceed L/2.
    """
    if len(positions) == 1 and reach < length:  # no vector of the lattice is shorter
        return Pairs(np.empty(0, int), np.empty(0, int), np.empty((0, 3)), np.empty(0))
    tilt = float(tilt - flips_of(tilt))
    x = np.ascontiguousarray(wrap(positions, length, tilt))
    bins = sort_into_bins(x, float(length), tilt, cells_along(length, reach, len(x)))
    found = collect(bins, reach * (1.0 + 1e-12))
    first, second = found[:, 0].astype(int), found[:, 1].astype(int)
    vector = x[second] - x[first] + found[:, 2:] @ cell_vectors(length, tilt)
    distance = np.sqrt(np.sum(vector**2, axis=1))
    near = distance <= reach
    first, second, vector, distance = first[near], second[near], vector[near], distance[near]
    return Pairs(
        np.concatenate([first, second]), np.concatenate([second, first]), np.concatenate([vector, -vector]),
        np.tile(distance, 2),
    )  # fmt: skip


def smallest_distance(positions: np.ndarray, length: float, tilt: float = 0.0) -> tuple[float, int, int]:
    """Smallest centre distance over all pairs and images, and its two spheres (equal for an own image).

    positions (N,3) in any units, those of length.
    """
    if len(positions) == 1:
        return float(length), 0, 0
    reach = min(1.2 * length / len(positions) ** (1.0 / 3.0), length)
    while True:
        pairs = pairs_within(positions, length, reach * (1.0 + 1e-9), tilt)
        if len(pairs.distance):
            k = int(np.argmin(pairs.distance))
            return float(pairs.distance[k]), int(pairs.first[k]), int(pairs.second[k])
        reach *= 1.5


def contact_value(
    positions: np.ndarray, length: float, tilt: float = 0.0, diameter: float = 2.0, shell: float = 0.2
) -> ContactValue:
    """Radial distribution function at contact, g(diameter), extrapolated from a thin shell outside contact.

    Pairs with diameter <= r < (1 + shell) diameter are counted in 20 bins, expected N (N-1)/(2 V) dV g(r)
    each; ln g = c0 + c1 s + c2 s^2, s = r/diameter - 1, is fitted by maximum likelihood (Poisson counts),
    and g(diameter) = exp(c0) with the error of c0 from the Fisher information. Pairs closer than `diameter`
    are left out. positions (N,3), length and diameter in the same unit. A pole at contact narrower
    than a bin (touching spheres) is averaged over it.
    """
    edges = diameter * np.linspace(1.0, 1.0 + shell, 21)
    pairs = pairs_within(positions, length, edges[-1], tilt)
    n = len(positions)
    counts = np.histogram(pairs.distance, edges)[0] / 2.0
    total = float(counts.sum())
    if total < MINIMUM_PAIRS:
        return ContactValue(math.nan, math.nan, int(total))
    ideal = 0.5 * n * (n - 1) / length**3 * (4.0 * math.pi / 3.0) * np.diff(edges**3)
    s = (0.5 * (edges[1:] + edges[:-1]) / diameter - 1.0) / shell
    basis = np.column_stack([np.ones_like(s), s, s * s])
    c = np.array([math.log(total / ideal.sum()), 0.0, 0.0])
    likelihood = -math.inf
    for _ in range(100):  # Newton on a concave log-likelihood, halved where it overshoots
        mean = ideal * np.exp(basis @ c)
        fisher = basis.T @ (mean[:, None] * basis)
        step = np.linalg.solve(fisher, basis.T @ (counts - mean))
        while _log_likelihood(basis @ (c + step), ideal, counts) < likelihood - 1e-9 * total:
            step *= 0.5
        c = c + step
        likelihood = _log_likelihood(basis @ c, ideal, counts)
        if np.max(np.abs(step)) < 1e-8:
            break
    value = math.exp(c[0])
    return ContactValue(value, value * math.sqrt(np.linalg.inv(fisher)[0, 0]), int(total))


def _log_likelihood(log_g: np.ndarray, ideal: np.ndarray, counts: np.ndarray) -> float:
    """Poisson log-likelihood of the counts up to a constant."""
    return float(counts @ log_g - ideal @ np.exp(log_g))


def carnahan_starling(volume_fraction: float) -> float:
    """Contact value (1 - phi/2)/(1 - phi)^3 of the equilibrium hard-sphere fluid (phi <= 0.494).

    Carnahan & Starling, J. Chem. Phys. 51, 635 (1969).
    """
    return (1.0 - 0.5 * volume_fraction) / (1.0 - volume_fraction) ** 3


def bond_order(positions: np.ndarray, length: float, tilt: float = 0.0, reach: float = BOND_RANGE) -> BondOrder:
    """Steinhardt bond order of degree 6 with neighbours closer than `reach`.

    global_q6  |<Y6(bond)>| over all bonds: fcc 0.5745, hcp 0.4848, sc 0.3536 (nearest neighbours); of the
        order of 1/sqrt(bonds) when disordered (Steinhardt, Nelson & Ronchetti, PRB 28, 784, 1983)
    local_q6   mean over spheres of |<Y6(bond)>| over its own bonds (0.3 to 0.45 even when disordered)
    crystal_fraction  share of spheres with >= 7 bonds to neighbours whose q6 is parallel to theirs,
        normalised product > 0.7 (ten Wolde, Ruiz-Montero & Frenkel, J. Chem. Phys. 104, 9932, 1996); it also
        shows crystallites that point in different directions, which the global order averages away
    All zero without bonds. positions (N,3) and reach in the units of length.
    """
    return bond_order_of_pairs(pairs_within(positions, length, reach, tilt), len(positions))
