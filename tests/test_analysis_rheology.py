"""Fourier moduli against signals whose harmonics are known in closed form."""

from __future__ import annotations

import numpy as np
import pytest
from synthetic_runs import oscillatory_record, steady_record, stress

from suspend.analysis.rheology import (
    HARMONICS,
    block_row,
    cycle_moduli,
    cycle_row,
    fourier_coefficients,
    normalised_signals,
)
from suspend.errors import ConfigurationError, NumericalError, StorageError

SCALES = {"gamma0": 0.7, "omega": 3.0, "viscosity": 2.0, "phase": 0.0, "radius": 1.5}
STEADY = {"rate": 2.5, "viscosity": 2.0, "radius": 1.0}


def no_stress(theta):
    return stress(np.zeros_like(theta))


def paper_series(theta, elastic, viscous, scales):
    """Equation (1) of the paper, written out: gamma0 sum_n (G_n' sin n theta + omega eta_n' cos n theta)."""
    shear = np.zeros_like(theta)
    for n in range(1, HARMONICS + 1):
        shear += elastic[n - 1] * np.sin(n * theta) + scales["omega"] * viscous[n - 1] * np.cos(n * theta)
    return scales["gamma0"] * shear


@pytest.mark.parametrize("samples", [19, 20, 64, 200])
@pytest.mark.parametrize("phase", [0.0, 0.4, np.pi / 2, -2.0, 5.0])
def test_all_harmonics_return(samples, phase):
    """Equation (1) with random G_n', eta_n', n = 1..9: returned to 1e-12, from 19 samples on, at any
    initial phase.

    The discrete Fourier transform is exact for n < samples/2, so only round-off is left. The phase is that
    of the strain: an initial phase shifts the samples, not the moduli.
    """
    random, scales = np.random.default_rng(samples), SCALES | {"phase": phase}
    elastic, viscous = random.normal(size=(2, HARMONICS))
    parts = {
        "hydrodynamic": lambda t: stress(0.25 * paper_series(t, elastic, viscous, scales)),
        "interparticle": lambda t: stress(0.75 * paper_series(t, elastic, viscous, scales)),
    }
    moduli = cycle_moduli(oscillatory_record(3, scales, parts, samples), scales)
    eta0, omega = scales["viscosity"], scales["omega"]
    fluid = np.eye(1, HARMONICS)[0]  # 1 in eta_1'/eta0
    np.testing.assert_allclose(moduli.total.viscous[1:], viscous / eta0 + fluid, atol=1e-12)
    np.testing.assert_allclose(moduli.total.elastic[1:], elastic / (eta0 * omega), atol=1e-12)
    np.testing.assert_allclose(moduli.hydrodynamic.viscous[1:], 0.25 * viscous / eta0, atol=1e-12)
    np.testing.assert_allclose(moduli.interparticle.elastic[1:], 0.75 * elastic / (eta0 * omega), atol=1e-12)
    assert moduli.flow_driven is None


def test_paper_convention_by_quadrature():
    """G_n' and eta_n' of a smooth signal that is no finite series, against the integrals that define them.

    exp(sin theta) cos(theta - 0.3): eta_n' omega gamma0 = (1/pi) int sigma cos n theta dtheta, G_n' gamma0
    the same with sin. The integrals are by Gauss-Legendre; 64 samples leave aliases of harmonic 55, far
    below 1e-12.
    """
    nodes, weights = np.polynomial.legendre.leggauss(120)
    nodes, weights = np.pi * (nodes + 1.0), np.pi * weights

    def signal(theta):
        return np.exp(np.sin(theta)) * np.cos(theta - 0.3)

    record = oscillatory_record(
        0, SCALES, {"hydrodynamic": lambda t: stress(signal(t)), "interparticle": no_stress}
    )
    part = cycle_moduli(record, SCALES).hydrodynamic
    unit = np.pi * SCALES["gamma0"] * SCALES["omega"] * SCALES["viscosity"]
    for n in range(1, HARMONICS + 1):
        assert part.viscous[n] == pytest.approx(
            np.sum(weights * signal(nodes) * np.cos(n * nodes)) / unit, abs=1e-12
        )
        assert part.elastic[n] == pytest.approx(
            np.sum(weights * signal(nodes) * np.sin(n * nodes)) / unit, abs=1e-12
        )


def test_newtonian_fluid():
    """sigma = eta gdot: eta_r' = eta/eta0, every other modulus 0 (round-off)."""
    viscosity = 4.3

    def hydrodynamic(theta):
        rate = SCALES["gamma0"] * SCALES["omega"] * np.cos(theta)
        return stress((viscosity - SCALES["viscosity"]) * rate)

    record = oscillatory_record(0, SCALES, {"hydrodynamic": hydrodynamic, "interparticle": no_stress})
    row = cycle_row(record, SCALES)
    assert row["eta_r_prime[-]"] == pytest.approx(viscosity / SCALES["viscosity"], abs=1e-13)
    own = ("total_strain", "eta_r_prime", "eta1_prime", "D_cyc")
    rest = [value for name, value in row.items() if not name.startswith(own)]
    assert np.abs(rest).max() < 1e-14 and len(rest) > 30


def test_hookean_solid():
    """sigma = G gamma: G_1' = G, so eta_r'' = G/(eta0 omega); without viscosity the ratios are undefined:
    NaN."""
    record = oscillatory_record(
        0,
        SCALES,
        {"hydrodynamic": lambda t: stress(5.0 * SCALES["gamma0"] * np.sin(t)), "interparticle": no_stress},
    )
    record["stress_fluid"] = np.zeros((64, 6))
    moduli = cycle_moduli(record, SCALES)
    assert moduli.eta_r_double_prime == pytest.approx(5.0 / (2.0 * 3.0), rel=1e-14)
    assert abs(moduli.eta_r_prime) < 1e-15
    record["stress_hydrodynamic"] = np.zeros((64, 6))
    assert np.isnan(cycle_moduli(record, SCALES).thinning)


def test_thinning_has_the_papers_sign():
    """|stress| flattened at the largest rate (cos - 0.1 cos 3 theta) has eta_3' < 0: shear thinning,
    positive."""
    unit = SCALES["viscosity"] * SCALES["gamma0"] * SCALES["omega"]
    parts = {
        "hydrodynamic": lambda t: stress(unit * (4.0 * np.cos(t) - 0.5 * np.cos(3 * t))),
        "interparticle": lambda t: stress(unit * 0.05 * np.cos(5 * t)),
    }
    row = cycle_row(oscillatory_record(0, SCALES, parts), SCALES)
    assert row["minus_eta3_over_eta1[-]"] == pytest.approx(0.1, rel=1e-13)  # eta_1' = 4 + the fluid's 1
    assert row["eta5_over_eta1[-]"] == pytest.approx(0.01, rel=1e-12)


@pytest.mark.parametrize("phase", [0.0, 1.1])
def test_normal_stress_harmonics(phase):
    """nu(t) = N/(gamma0 omega) = Re sum nu_n exp(i n theta), n = 0, 2, 4 with complex nu: returned by part,
    N1 and N2.

    The components are built so that N1 = sigma_xx - sigma_yy and N2 = sigma_yy - sigma_zz are those series
    and the trace is not zero.
    """
    scales = SCALES | {"phase": phase}
    nu1, nu2 = np.array([-0.3, 0.2 - 0.1j, 0.05j]), np.array([-0.8, -0.4 + 0.3j, 0.6 - 0.2j])
    orders = np.array([0, 2, 4])

    def normal(theta, share):
        waves = np.exp(1j * np.outer(theta, orders))
        n1, n2 = (scales["gamma0"] * scales["omega"] * share * (waves @ nu).real for nu in (nu1, nu2))
        zz = 0.7 * np.sin(theta)
        return stress(np.zeros_like(theta), zz + n2 + n1, zz + n2, zz)

    parts = {
        name: (lambda t, s=s: normal(t, s)) for name, s in (("hydrodynamic", 0.4), ("interparticle", 0.6))
    }
    record, eta0 = oscillatory_record(0, scales, parts), scales["viscosity"]
    moduli, row = cycle_moduli(record, scales), cycle_row(record, scales)
    for part, share in ((moduli.total, 1.0), (moduli.hydrodynamic, 0.4), (moduli.interparticle, 0.6)):
        np.testing.assert_allclose(part.n1[orders], share * nu1 / eta0, atol=1e-13)
        np.testing.assert_allclose(part.n2[orders], share * nu2 / eta0, atol=1e-13)
        assert np.abs(np.delete(part.n2, orders)).max() < 1e-13
    assert row["N2_nu0[eta0]"] == pytest.approx(-0.4, abs=1e-13)
    assert row["N2_nu4_im[eta0]"] == pytest.approx(-0.1, abs=1e-13)
    assert row["N2_nu2_abs[eta0]"] == pytest.approx(0.25, abs=1e-13)
    assert row["N2_nu0_interparticle[eta0]"] == pytest.approx(-0.24, abs=1e-13)


def test_vectorised_over_cycles():
    """One call for many cycles gives what one call per cycle gives, against a plain sum (round-off)."""
    theta = 2 * np.pi * np.arange(32) / 32 + 0.3
    signals = np.random.default_rng(1).normal(size=(5, 3, 32))
    found = fourier_coefficients(theta, signals)
    assert found.shape == (5, 3, HARMONICS + 1)
    naive = sum(2 / 32 * signals[4, 2, k] * np.exp(-3j * theta[k]) for k in range(32))
    assert found[4, 2, 3] == pytest.approx(naive, abs=1e-14)
    assert found[1, 0, 0] == pytest.approx(signals[1, 0].mean(), abs=1e-14)


def test_harmonics_beyond_the_limit_alias():
    """The documented limit: of N samples, harmonic N - n is seen as harmonic n, and N - 10 is not seen at
    all."""
    theta = 2 * np.pi * np.arange(20) / 20
    assert fourier_coefficients(theta, np.cos(11 * theta))[9] == pytest.approx(1.0, abs=1e-13)
    assert np.abs(fourier_coefficients(theta, np.cos(10 * theta))).max() < 1e-13


def test_too_few_samples():
    """18 samples cannot tell sin 9 theta from nothing: an error that names the key to change."""
    theta = 2 * np.pi * np.arange(18) / 18
    with pytest.raises(ConfigurationError, match=r"18 samples.*samples_per_cycle to 19"):
        fourier_coefficients(theta, np.cos(theta))


@pytest.mark.parametrize(
    "phase", [np.linspace(0, 1, 64), np.arange(64) / 65, (np.arange(64) / 64) ** 1.01, np.arange(64) / 32]
)
def test_unequal_phases(phase):
    """The end sampled twice, a cycle cut short, bunched phases, two cycles: each an error, not a wrong
    modulus."""
    with pytest.raises(ConfigurationError, match="equal phases"):
        fourier_coefficients(2 * np.pi * phase, np.ones(64))


def test_strain_must_belong_to_the_scales():
    """A record of another amplitude or another initial phase is refused instead of misread."""
    record = oscillatory_record(2, SCALES, {"hydrodynamic": no_stress, "interparticle": no_stress})
    for wrong in ({"gamma0": 0.71}, {"phase": 0.1}):
        with pytest.raises(StorageError, match="cycle 2: the recorded strain"):
            cycle_row(record, SCALES | wrong)


def test_stress_must_be_finite():
    """One infinite sample is an error that names the cycle, never NaN moduli."""
    record = oscillatory_record(5, SCALES, {"hydrodynamic": no_stress, "interparticle": no_stress})
    record["stress_hydrodynamic"][7, 2] = np.inf
    with pytest.raises(NumericalError, match="cycle 5"):
        cycle_row(record, SCALES)


def test_row_columns():
    """gamma_tot = 4 gamma0 n_cyc; each column names its unit; D_cyc as given, or stored with the cycle, or
    NaN."""
    parts = dict.fromkeys(("hydrodynamic", "interparticle", "flow_driven"), no_stress)
    record = oscillatory_record(9, SCALES, parts)
    row = cycle_row(record, SCALES)
    assert row["total_strain[-]"] == pytest.approx(28.0)
    assert all(name.endswith("]") and isinstance(value, float) for name, value in row.items())
    for n in range(1, 10):
        assert f"eta{n}_prime[eta0]" in row and f"G{n}_prime[eta0*omega]" in row
    assert "eta1_prime_flow_driven[eta0]" in row
    assert np.isnan(row["D_cyc[-]"])
    assert cycle_row(record, SCALES, 0.25)["D_cyc[-]"] == 0.25
    record["statistics"]["d_cyc"] = 0.5
    assert cycle_row(record, SCALES)["D_cyc[-]"] == 0.5


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_steady_block(sign):
    """eta_r is positive in both directions of shear; N1, N2 do not change sign; strain counts up either way.

    eta_r = <sigma_xy>/(eta0 gdot) with sigma_xy = 2 eta0 E + hydrodynamic of 7 eta0 rate: exactly 8. N1, N2
    in units of eta0 rate = 5.
    """
    ripple = np.cos(2 * np.pi * np.arange(32) / 32)
    hydrodynamic = stress(sign * 7.0 * 5.0 * (1.0 + 0.1 * ripple), -1.0, -2.0, 0.5)
    row = block_row(steady_record(3, STEADY, hydrodynamic, sign), STEADY)
    assert row["eta_r[-]"] == pytest.approx(8.0, rel=1e-14)
    assert row["eta_r_hydrodynamic[-]"] == pytest.approx(7.0, rel=1e-14)
    assert row["N1[eta0*rate]"] == pytest.approx(0.2) and row["N2[eta0*rate]"] == pytest.approx(-0.5)
    assert row["total_strain[-]"] == pytest.approx(4.0, rel=1e-14)
    assert row["shear_rate[rate]"] == sign


def test_quiescent_block():
    """Without shear there is no viscosity (NaN), but a stress in units of eta0 times the reference rate."""
    row = block_row(steady_record(0, STEADY, stress(np.full(8, 10.0)), sign=0.0), STEADY)
    assert np.isnan(row["eta_r[-]"]) and row["sigma_xy[eta0*rate]"] == pytest.approx(2.0)
    with pytest.raises(ConfigurationError, match="too few"):
        block_row(steady_record(0, STEADY, stress(np.ones(1))), STEADY)


def test_waveforms_are_normalised():
    """A Newtonian fluid of 3 eta0: strain and rate on the unit circle, stress/(eta0 gamma0 omega) = 3
    rate."""
    unit = 2.0 * SCALES["viscosity"] * SCALES["gamma0"] * SCALES["omega"]
    parts = {"hydrodynamic": lambda t: stress(unit * np.cos(t)), "interparticle": no_stress}
    wave = normalised_signals(oscillatory_record(0, SCALES, parts), SCALES)
    np.testing.assert_allclose(wave["strain"] ** 2 + wave["rate"] ** 2, 1.0, rtol=1e-14)
    np.testing.assert_allclose(wave["shear"], 3.0 * wave["rate"], atol=1e-14)
