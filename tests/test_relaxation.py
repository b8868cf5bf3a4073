"""Synthetic decays of D_cyc are told apart, their relaxation strains found, absorbing and diffusing ends decided."""

from __future__ import annotations

import math

import numpy as np
import pytest

from suspend.analysis.relaxation import Relaxation
from suspend.errors import ConfigurationError

STRAIN = 3.2 * np.arange(1, 81)  # gamma0 = 0.8 to total strain 256


def noisy(curve: np.ndarray, spread: float, seed: int) -> np.ndarray:
    """The curve times exp(normal), as the sum over spheres scatters."""
    return curve * np.exp(spread * np.random.default_rng(seed).normal(size=len(curve)))


EXPONENTIAL = 2e-3 * np.exp(-STRAIN / 40.0)
POWER = 2e-3 * (1.0 + STRAIN / 5.0) ** -1.5


def test_exact_decays_are_recovered():
    """Without noise the parameters come back to 1e-4, with and without a plateau (the optimiser's own tolerance)."""
    found = Relaxation().fit(STRAIN, EXPONENTIAL)
    assert found.family == "exponential" and found.relaxation_strain == pytest.approx(40.0, rel=1e-4)
    found = Relaxation().fit(STRAIN, EXPONENTIAL + 1e-5)
    assert found.best.name == "exponential + plateau" and found.best.plateau == pytest.approx(1e-5, rel=1e-4)
    assert found.relaxation_strain == pytest.approx(40.0, rel=1e-4)
    found = Relaxation().fit(STRAIN, POWER)
    assert found.family == "power law" and found.best.exponent == pytest.approx(1.5, rel=1e-4)
    assert found.relaxation_strain == pytest.approx(5.0 * math.expm1(1.0 / 1.5), rel=1e-4)
    found = Relaxation().fit(STRAIN, POWER + 3e-5)
    assert found.best.name == "power law + plateau" and found.best.plateau == pytest.approx(3e-5, rel=1e-3)


@pytest.mark.parametrize("seed", range(6))
def test_noisy_decays_are_told_apart(seed):
    """With 20 % scatter of every cycle, the family is the right one for each of six seeds, with and without plateau.

    Above a plateau that leaves 50 : 1 only, a steep power law follows an exponential within that scatter: then the
    answer may be "undecided", but never the wrong family.
    """
    assert Relaxation().fit(STRAIN, noisy(EXPONENTIAL, 0.2, seed)).family == "exponential"
    assert Relaxation().fit(STRAIN, noisy(EXPONENTIAL + 4e-6, 0.2, seed)).family == "exponential"
    assert Relaxation().fit(STRAIN, noisy(EXPONENTIAL + 4e-5, 0.2, seed)).family in ("exponential", "undecided")
    assert Relaxation().fit(STRAIN, noisy(POWER, 0.2, seed)).family == "power law"
    assert Relaxation().fit(STRAIN, noisy(POWER + 3e-6, 0.2, seed)).family == "power law"


def correlated(seed: int, rho: float) -> np.ndarray:
    """80 cycles of stationary noise of correlation rho^|j - k|, 15 % of 0.01."""
    random, noise = np.random.default_rng(seed), np.zeros(120)
    for k in range(1, 120):
        noise[k] = rho * noise[k - 1] + math.sqrt(1.0 - rho**2) * random.normal()
    return 1e-2 * np.exp(0.15 * noise[40:])


def test_no_decay_is_claimed_in_stationary_noise():
    """White noise: the simplest form wins in at least 14 of 15 series. Correlated noise: never a decay."""
    names = [Relaxation().fit(STRAIN, noisy(np.full(80, 0.01), 0.2, seed)).best.name for seed in range(15)]
    assert names.count("steady") >= 14
    for seed in range(15):
        assert Relaxation().fit(STRAIN, correlated(seed, 0.8)).family in ("steady", "undecided")


@pytest.mark.parametrize("rho", [0.0, 0.8])
def test_error_of_the_slope_is_its_scatter(rho):
    """Over 100 series the slopes scatter about 0 as their reported errors say, also when cycles are correlated.

    The root mean square of 100 slopes is known to 7 %; the errors, from 40 correlated cycles each, vary by half and are
    compared by their mean: 30 % are allowed. Without the correlation the mean would be 3 times too small at rho = 0.8.
    """
    slopes = np.array([Relaxation().fit(STRAIN, correlated(seed, rho)).late_slope for seed in range(100)])
    assert np.sqrt(np.mean(slopes[:, 0] ** 2)) == pytest.approx(slopes[:, 1].mean(), rel=0.3)


def test_curvature_of_a_decay_is_not_noise():
    """A pure exponential over the last half is a curve in the logarithms: its slope there is certain, so it absorbs."""
    found = Relaxation().fit(STRAIN, noisy(EXPONENTIAL, 0.05, 1))
    assert found.state == "absorbing" and found.late_slope[1] < 0.25 * abs(found.late_slope[0])


def test_a_decay_too_short_to_tell_is_undecided():
    """One e-fold with 30 % scatter cannot decide; fewer than 8 cycles are not fitted at all and the note says so."""
    short = STRAIN[:12]
    assert Relaxation(start=0.0).fit(short, noisy(np.exp(-short / 40.0), 0.3, 1)).family == "undecided"
    found = Relaxation().fit(STRAIN[:5], EXPONENTIAL[:5])
    assert found.best is None and found.family == "undecided" and math.isnan(found.relaxation_strain)
    assert "8 are needed" in found.notes[0] and set(found.table()) == {"total_strain[-]", "D_cyc[-]"}


def test_first_collapse_is_set_aside():
    """A ten times larger first cycle does not turn an exponential into a power law, unless start = 0 asks for it."""
    values = noisy(EXPONENTIAL, 0.1, 3)
    values[0] *= 100.0
    assert Relaxation().fit(STRAIN, values).family == "exponential"
    assert Relaxation().fit(STRAIN, values).best.residual < Relaxation(start=0.0).fit(STRAIN, values).best.residual


def test_states():
    """Slope of ln D in ln gamma over the last half: 0 diffuses, -1 absorbs, -0.5 with scatter is undecided.

    Exact power laws: the slope is theirs, with no error. D = 0 at the end or below the floor absorbs.
    """
    found = Relaxation().fit(STRAIN, noisy(np.full(80, 0.01), 0.1, 1))
    assert found.state == "diffusing" and abs(found.late_slope[0]) < 4.0 * found.late_slope[1]
    found = Relaxation().fit(STRAIN, 0.3 / STRAIN)
    assert found.state == "absorbing" and found.late_slope[0] == pytest.approx(-1.0, abs=1e-10)
    assert Relaxation().fit(STRAIN, noisy(0.3 * STRAIN**-0.5, 0.2, 2)).state == "undecided"
    assert Relaxation(slope=1.5).fit(STRAIN, 0.3 / STRAIN).state == "diffusing"
    assert Relaxation().fit(STRAIN, np.full(80, 1e-9), floor=1e-8).state == "absorbing"
    assert "step errors" in Relaxation().fit(STRAIN, np.full(80, 1e-9), floor=1e-8).notes[-1]
    still = np.where(np.arange(80) < 20, EXPONENTIAL, 0.0)
    found = Relaxation().fit(STRAIN, still)
    assert found.state == "absorbing" and found.final == 0.0 and any("60 cycle(s)" in note for note in found.notes)
    assert Relaxation().fit(STRAIN[:3], EXPONENTIAL[:3]).state == "undecided"
    assert Relaxation().fit(STRAIN[:0], EXPONENTIAL[:0]).summary()["family"] == "undecided"


def test_summary_and_parameters():
    """The numbers behind a decision are in the summary; parameters without meaning are refused."""
    summary = Relaxation().fit(STRAIN, noisy(POWER, 0.1, 1)).summary()
    assert summary["state"] == "absorbing" and summary["family"] == "power law" and summary["BIC_margin"] > 6.0
    assert summary["exponent"] == pytest.approx(1.5, abs=0.15)
    for wrong in ({"margin": -1.0}, {"slope": 0.0}, {"start": -1.0}, {"floor": -1.0}):
        with pytest.raises(ConfigurationError):
            Relaxation(**wrong)
