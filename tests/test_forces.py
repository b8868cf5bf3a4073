"""Repulsion and contact: the force laws, the sums over pairs, the sign of the stress."""

from types import SimpleNamespace

import naive
import numpy as np
import pytest

from suspend.forces import (
    NEGLIGIBLE,
    force_law,
    interaction_range,
    pair_force,
    pair_forces,
    stress_per_sphere,
)
from suspend.hydro.neighbours import VerletList
from suspend.hydro.rows import split_rows


def repulsion(force=10.0, debye_length=0.01, gap_shift=0.0, cutoff=None):
    return SimpleNamespace(force=force, debye_length=debye_length, gap_shift=gap_shift, cutoff=cutoff)


def contact(stiffness=1e4, gap_shift=0.0):
    return SimpleNamespace(stiffness=stiffness, gap_shift=gap_shift)


def evaluate(force, position, edge, tilt=0.0, threads=1):
    """(forces (N, 6), stress (6,), smallest gap, stress of each sphere)."""
    reach = interaction_range(force)
    verlet = VerletList(edge, reach, 0.3)
    verlet.build(position, 0.0, tilt)
    load = np.zeros((len(position), 6))
    chunks = split_rows(verlet.offset, threads)
    placed = verlet.at(position, tilt)
    found = pair_forces(chunks, placed, force, reach, load)
    each = stress_per_sphere(placed, force, reach)
    return load, *found, each


@pytest.mark.parametrize("threads", [1, 2])
@pytest.mark.parametrize("gap_shift", [0.0, 0.05])
@pytest.mark.parametrize("spring", [None, contact(50.0, 0.02)])
def test_sums_are_those_of_the_twin(spring, gap_shift, threads):
    """Soft, long repulsion in overlapping random spheres, tilted cell, several images: all pairs, rounding
    (1e-12).
    """
    edge, tilt = 5.0, 0.37
    position = np.random.default_rng(2).random((12, 3)) @ naive.lattice(edge, tilt)
    force = pair_force(repulsion(10.0, 0.2, gap_shift, 12.0), spring)

    def law(h):
        x = h - gap_shift
        value = 10.0 * np.exp(-5.0 * (max(x, 0.0) if spring else x)) * (h < gap_shift + 2.4)
        return value + (50.0 * max(0.02 - h, 0.0) if spring else 0.0)

    load, stress, gap, each = evaluate(force, position, edge, tilt, threads)
    expected, expected_stress = naive.pair_forces(position, edge, tilt, interaction_range(force), law)
    scale = np.abs(expected).max()
    assert np.abs(load[:, :3] - expected).max() <= 1e-12 * scale and not load[:, 3:].any()
    assert np.abs(load.sum(axis=0)).max() <= 1e-12 * scale  # action and reaction
    voigt = np.array([naive.voigt(s) for s in expected_stress])
    assert np.abs(each - voigt).max() <= 1e-12 * np.abs(voigt).max()
    assert np.abs(stress - voigt.sum(axis=0)).max() <= 1e-12 * np.abs(voigt).max() * len(position)
    distances = [np.linalg.norm(d) for *_, d in naive.separations(position, edge, tilt, 2.0 + gap_shift +
    2.4)]
    assert gap == pytest.approx(min(distances) - 2.0, abs=1e-12)


@pytest.mark.parametrize("gap", [0.3, 0.02, 1e-9, 0.0, -0.01, -0.1])
def test_literal_law(gap):
    """F0 exp(-kappa h) at every h, growing without bound below contact; one exponential, rounding."""
    force = pair_force(repulsion(10.0, 0.05, cutoff=100.0), None)
    assert force_law(force, gap) == pytest.approx(10.0 * np.exp(-gap / 0.05), rel=1e-14)


@pytest.mark.parametrize("gap", [0.02, 0.01, 0.005, 0.0, -0.02])
def test_law_with_contact(gap):
    """With a contact: the repulsion is taken at h - shift, held at F0 below the shift, and a spring is
    added there.
    """
    shift = 0.01
    force = pair_force(repulsion(10.0, 0.05, shift), contact(2000.0, shift))
    expected = 10.0 * np.exp(-max(gap - shift, 0.0) / 0.05) + 2000.0 * max(shift - gap, 0.0)
    assert force_law(force, gap) == pytest.approx(expected, rel=1e-14)


def test_contact_alone():
    """Without repulsion a linear spring from the contact gap on; nothing beyond it, and no other range."""
    force = pair_force(None, contact(100.0, 0.02))
    assert force_law(force, 0.01) == pytest.approx(1.0, rel=1e-14) and force_law(force, 0.02) == 0.0
    assert interaction_range(force) == 2.02
    assert interaction_range(pair_force(None, contact(100.0, -0.02))) == 2.0
    assert interaction_range(pair_force(None, None)) == 0.0


def test_reach():
    """By default cut where the force falls below NEGLIGIBLE; with a cutoff, at that many Debye lengths past
    the shift.
    """
    force = pair_force(repulsion(10.0, 0.01, 0.003), None)
    assert force_law(force, force.reach * (1 - 1e-9)) == pytest.approx(NEGLIGIBLE, rel=1e-5)
    assert force_law(force, force.reach) == 0.0
    force = pair_force(repulsion(10.0, 0.01, 0.003, cutoff=5.0), None)
    assert force.reach == pytest.approx(0.053, rel=1e-14)
    assert interaction_range(force) == pytest.approx(2.053, rel=1e-14)
    assert force_law(force, 0.0529) > 0.06 and force_law(force, 0.0531) == 0.0


def test_repelling_pair_and_sign_of_its_stress():
    """Spheres along x push apart: force -F on the left one. Stress -x F: a pressure, compression negative,
    exact.
    """
    force = pair_force(repulsion(10.0, 0.1), None)
    position = np.array([[10.0, 10, 10], [12.05, 10, 10]])
    load, stress, gap, _ = evaluate(force, position, 30.0)
    size = 10.0 * np.exp(-0.5)
    assert np.allclose(load[:, 0], [-size, size], rtol=1e-12) and not load[:, 1:].any()
    assert np.allclose(stress, [-2.05 * size, 0, 0, 0, 0, 0], rtol=1e-12)
    assert gap == pytest.approx(0.05, abs=1e-12)


def test_force_is_minus_the_gradient_of_the_energy():
    """E = (F0/kappa) sum exp(-kappa h): central differences of step 1e-5 are good to about 1e-8 of the
    force.
    """
    edge, tilt = 7.0, -0.3
    position = naive.loose_positions(10, edge, tilt, seed=3)
    force = pair_force(repulsion(10.0, 0.2, cutoff=40.0), None)
    reach = interaction_range(force)

    def energy(x):
        return sum(2.0 * np.exp(-(np.linalg.norm(d) - 2) / 0.2) for *_, d in naive.separations(x, edge,
        tilt, reach))

    load = evaluate(force, position, edge, tilt)[0]
    for i, c in ((0, 0), (4, 1), (9, 2)):
        step = np.zeros_like(position)
        step[i, c] = 1e-5
        slope = (energy(position + step) - energy(position - step)) / 2e-5
        assert load[i, c] == pytest.approx(-slope, abs=1e-6 * np.abs(load).max())
