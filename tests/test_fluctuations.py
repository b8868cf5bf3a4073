"""Density fluctuations: structure factor of the longest waves, and what the hard-sphere fluid at equilibrium has."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.integrate import quad

from suspend.analysis.microstructure.number_variance import number_variance
from suspend.analysis.microstructure.snapshot import Snapshot
from suspend.analysis.microstructure.structure_factor import scattering
from suspend.box import edge_length
from suspend.fluctuations import (
    equilibrium_exponent,
    equilibrium_structure_factor,
    equilibrium_variance,
    needed_travel,
    smallest_wave_structure,
    structure_factor_at_zero,
    variance_exponent,
    variance_radii,
)
from suspend.packing import random_packing


@pytest.mark.parametrize("tilt", [0.0, 0.3, -0.5])
def test_smallest_waves_are_those_the_cell_allows(tilt):
    """The three waves one cell long along the three faces, as the analysis has them in the sheared cell (round-off)."""
    x = np.random.default_rng(3).random((70, 3)) * 9.0
    expected = scattering(Snapshot(x, 9.0, tilt), np.eye(3, dtype=int)).mean()
    assert smallest_wave_structure(x, 9.0, tilt) == pytest.approx(expected, rel=1e-10)


def test_random_points_have_a_structure_factor_of_one_and_a_lattice_none():
    """S = 1 for points without order (400 cells of three waves: 4 errors of 1/sqrt(1200)), 0 for a lattice."""
    random = np.random.default_rng(2)
    cells = [smallest_wave_structure(random.random((20, 3)) * 9.0, 9.0) for _ in range(400)]
    assert np.mean(cells) == pytest.approx(1.0, abs=4.0 / math.sqrt(1200.0))
    assert smallest_wave_structure(3.0 * np.array(list(np.ndindex(4, 4, 4))), 12.0, 0.25) < 1e-20


@pytest.mark.parametrize("phi", [0.1, 0.4, 0.49])
def test_structure_factor_of_the_fluid(phi):
    """At small q Carnahan & Starling's compressibility (1e-2, the grid's end), at large q one, and in between the
    numerical transform of Percus & Yevick's c(r) = -(l1 + 6 phi l2 r + phi l1 r^3/2), r < 1 (Wertheim 1963), to 1e-6.
    """
    assert equilibrium_structure_factor(0.0, phi) == pytest.approx(structure_factor_at_zero(phi), rel=1e-2)
    assert equilibrium_structure_factor(200.0, phi) == pytest.approx(1.0, abs=1e-3)
    l1 = (1 + 2 * phi) ** 2 / (1 - phi) ** 4
    l2 = -((1 + phi / 2) ** 2) / (1 - phi) ** 4
    for k in (9.0, 14.0, 25.0):
        c = quad(lambda r, k=k: -(l1 + 6 * phi * l2 * r + 0.5 * phi * l1 * r**3) * r * math.sin(k * r), 0.0, 1.0)[0]
        expected = 1.0 / (1.0 - 24.0 * phi * c / k)
        assert equilibrium_structure_factor(k / 2.3, phi, 2.3) == pytest.approx(expected, rel=1e-6)


def test_number_variance_of_a_dilute_fluid_is_that_of_random_points():
    """N v/V (1 - v/V) at phi = 1e-6, where spheres do not feel each other (1e-4)."""
    length = edge_length(200, 1e-6)
    radii = variance_radii(length, 5)[2:]
    share = 4.0 / 3.0 * math.pi * radii**3 / length**3
    found = equilibrium_variance(200, length, radii, 1e-6, 2.0)
    np.testing.assert_allclose(found, 200 * share * (1 - share), rtol=1e-4)


@pytest.mark.parametrize("phi", [0.3, 0.4])
def test_equilibrium_packings_have_the_exponent_of_the_fluid(phi):
    """beta of 16 packings, averaged: that of the integral over S(q) within four standard errors and 0.02."""
    found = []
    for seed in range(16):
        packing = random_packing(500, phi, 0.02, seed)
        found.append(variance_exponent(packing.positions, packing.length))
    expected = equilibrium_exponent(500, packing.length, phi * 1.01**3, 2.02)
    assert np.mean(found) == pytest.approx(expected, abs=4.0 * np.std(found) / 4.0 + 0.02)


def test_exponent_is_that_of_the_analysis():
    """One definition: the exponent of a start and that of the analysed frame are the same number (1e-12)."""
    x = np.random.default_rng(4).random((60, 3)) * 12.0
    analysed = number_variance(Snapshot(x, 12.0, 0.2), variance_radii(12.0))
    assert variance_exponent(x, 12.0, 0.2) == pytest.approx(analysed.beta, rel=1e-12)


def test_needed_travel_is_the_decay_of_a_density_wave():
    """exp(-D k^2 t/S) = exp(-decay) at 6 D t = travel^2, k = 2 pi/L."""
    travel = needed_travel(0.3, 20.0, 1.7)
    k = 2.0 * math.pi / 20.0
    assert math.exp(-(travel**2) / 6.0 * k**2 / structure_factor_at_zero(0.3)) == pytest.approx(math.exp(-1.7))
