"""Measures of LAOS against signals whose Chebyshev coefficients, moduli and spectra are known in closed form."""

from __future__ import annotations

import csv
import json

import numpy as np
import pytest
from synthetic_runs import configuration, oscillatory_record, steady_record, stress, write_run

from suspend.analysis.laos import ChebyshevMeasures, Laos, direct_measures
from suspend.analysis.lissajous import Lissajous, mean_waveforms
from suspend.analysis.moduli import Moduli, read_harmonics
from suspend.analysis.normal_stresses import NormalStresses
from suspend.analysis.rheology import fourier_coefficients
from suspend.analysis.spectrum import PowerSpectrum
from suspend.analysis.summary import analyze
from suspend.errors import ConfigurationError
from suspend.io import Run

SCALES = {"gamma0": 0.8, "omega": 2.0, "viscosity": 2.0, "phase": 0.0, "radius": 1.0}
UNIT = SCALES["viscosity"] * SCALES["gamma0"] * SCALES["omega"]


def stored(path, parts_of, cycles: int = 4, phase: float = 0.0, samples: int = 64) -> Run:
    """A stored run, opened; parts_of(k) gives the stress parts of cycle k as functions of theta."""
    scales = SCALES | {"phase": phase}
    records = [oscillatory_record(k, scales, parts_of(k), samples) for k in range(cycles)]
    flow = {"type": "oscillatory", "amplitude": 0.8, "omega": 2.0, "phase": phase}
    return Run(write_run(path, configuration(flow, {"cycles": cycles}), records, np.zeros((4, 3))))


def measures_of(signal, harmonics: int = 9) -> ChebyshevMeasures:
    """Measures of signal(theta), in units of eta0 gamma0 omega."""
    theta = 2.0 * np.pi * np.arange(64) / 64 + 0.3
    found = fourier_coefficients(theta, signal(theta), harmonics)
    return ChebyshevMeasures(-found.imag, found.real)


def test_newtonian():
    """sigma = 3 rate: every viscosity 3, no other coefficient, T = 0."""
    found = measures_of(lambda t: 3.0 * np.cos(t))
    np.testing.assert_allclose(found.v, [3.0, 0.0, 0.0, 0.0, 0.0], atol=1e-14)
    np.testing.assert_allclose([found.eta_M, found.eta_L], 3.0, atol=1e-13)
    np.testing.assert_allclose([found.G_M, found.G_L, *found.e], 0.0, atol=1e-13)


def test_kelvin_voigt():
    """sigma = G gamma + eta rate: tangent and secant are the constants, both ways."""
    found = measures_of(lambda t: 1.7 * np.sin(t) + 0.6 * np.cos(t))
    np.testing.assert_allclose([found.G_M, found.G_L, found.eta_M, found.eta_L], [1.7, 1.7, 0.6, 0.6], atol=1e-13)


@pytest.mark.parametrize(("cubic", "quintic"), [(0.5, 0.0), (-0.3, 0.2)])
def test_nonlinear_spring(cubic, quintic):
    """sigma = x + b x^3 + c x^5 + rate, x = gamma/gamma0 (Duffing's spring), expanded in Chebyshev polynomials by hand.

    x^3 = (3 T1 + T3)/4, x^5 = (10 T1 + 5 T3 + T5)/16: e1 = 1 + 3b/4 + 5c/8, e3 = b/4 + 5c/16, e5 = c/16. Tangent at
    zero G_M = 1, secant G_L = 1 + b + c, so S = (b + c)/(1 + b + c); b > 0 stiffens: e3 > 0, although G_3' < 0.
    """
    found = measures_of(lambda t: np.sin(t) + cubic * np.sin(t) ** 3 + quintic * np.sin(t) ** 5 + np.cos(t))
    expected = [1 + 0.75 * cubic + 0.625 * quintic, cubic / 4 + 5 * quintic / 16, quintic / 16, 0.0, 0.0]
    np.testing.assert_allclose(found.e, expected, atol=1e-14)
    np.testing.assert_allclose([found.G_M, found.G_L], [1.0, 1.0 + cubic + quintic], atol=1e-13)
    assert found.elastic[3] == pytest.approx(-found.e[1])
    stiffening = found.series("G_L-G_M") / found.G_L
    assert stiffening == pytest.approx((cubic + quintic) / (1.0 + cubic + quintic), abs=1e-13)


def test_nonlinear_dashpot():
    """sigma = y + b y^3, y = rate/(gamma0 omega), b > 0 thickens: v1 = 1 + 3b/4, v3 = b/4 = eta_3', T = b/(1 + b)."""
    found = measures_of(lambda t: np.cos(t) + 0.4 * np.cos(t) ** 3)
    np.testing.assert_allclose(found.v[:3], [1.3, 0.1, 0.0], atol=1e-14)
    np.testing.assert_allclose([found.eta_M, found.eta_L], [1.0, 1.4], atol=1e-13)
    assert found.series("eta_L-eta_M") / found.eta_L == pytest.approx(0.4 / 1.4)


def test_even_harmonics_are_left_out():
    """A stress that is not the same in both half-cycles: the measures are those of the mean of the two."""
    clean = measures_of(lambda t: np.cos(t) + 0.2 * np.sin(t))
    uneven = measures_of(lambda t: np.cos(t) + 0.2 * np.sin(t) + 0.3 * np.cos(2 * t) + 0.1 * np.sin(4 * t) + 0.5)
    np.testing.assert_allclose(uneven.e, clean.e, atol=1e-14)
    assert uneven.eta_L == pytest.approx(clean.eta_L)
    assert float(uneven.G_M) == pytest.approx(float(clean.G_M))


@pytest.mark.parametrize("phase", [0.0, 0.37, -2.0])
def test_definition_by_tangents_and_secants(phase):
    """Fourier sums against the slopes and values of the sampled curve where Ewoldt et al. define them.

    Random odd and even harmonics to 9 (decaying, as in suspensions), 64 samples anywhere in phase. Through
    seven samples the slope of harmonic n is wrong by (2 pi n/64)^6/140 of n c_n, 0.3 % at n = 9 and 64 samples.
    """
    random = np.random.default_rng(11)
    orders = np.arange(1, 10)
    sine, cosine = random.normal(size=(2, 9)) / orders**3

    def signal(theta):
        return np.sin(np.outer(theta, orders)) @ sine + np.cos(np.outer(theta, orders)) @ cosine

    theta = 2.0 * np.pi * np.arange(64) / 64 + phase
    found, direct = measures_of(signal), direct_measures(theta, signal(theta))
    for name, value in direct.items():
        assert value == pytest.approx(found.series(name), abs=1e-4), name
    fine = 2.0 * np.pi * np.arange(1024) / 1024 + phase
    for name, value in direct_measures(fine, signal(fine)).items():
        assert value == pytest.approx(found.series(name), abs=1e-9), name


def shear_parts(k: int) -> dict:
    """Cycle k: hydrodynamic 2 y + 0.2 y^3 + 0.01 k y and interparticle 0.3 x^3, fluid y besides."""
    return {
        "hydrodynamic": lambda t: stress(UNIT * ((2.0 + 0.01 * k) * np.cos(t) + 0.2 * np.cos(t) ** 3)),
        "interparticle": lambda t: stress(UNIT * 0.3 * np.sin(t) ** 3),
        "flow_driven": lambda t: stress(UNIT * np.cos(t)),
    }


@pytest.mark.parametrize("phase", [0.0, 1.1])
def test_measures_of_a_stored_run(tmp_path, phase):
    """Through the files, at any initial phase: every part and cycle returned to 1e-12, averages of the last two cycles.

    Total viscous stress (3 + 0.01 k) y + 0.2 y^3: v1 = 3.15 + 0.01 k, v3 = 0.05, T = 0.2/(3.2 + 0.01 k); elastic
    0.3 x^3: e1 = 0.225, e3/e1 = 1/3, G_M = 0, G_L = 0.3, S = 1.
    """
    with stored(tmp_path / "run", shear_parts, phase=phase) as run:
        laos = Laos(last=2).compute(run)
    k, columns = np.arange(4), laos.table()
    np.testing.assert_allclose(columns["eta_L[eta0]"], 3.2 + 0.01 * k, atol=1e-12)
    np.testing.assert_allclose(columns["eta_M[eta0]"], 3.0 + 0.01 * k, atol=1e-12)
    np.testing.assert_allclose(columns["v3_over_v1[-]"], 0.05 / (3.15 + 0.01 * k), atol=1e-12)
    np.testing.assert_allclose(columns["T[-]"], 0.2 / (3.2 + 0.01 * k), atol=1e-12)
    np.testing.assert_allclose(columns["G_L_interparticle[eta0*omega]"], 0.3, atol=1e-12)
    np.testing.assert_allclose(columns["e3_over_e1_interparticle[-]"], 1 / 3, atol=1e-12)
    np.testing.assert_allclose(columns["eta_L_flow_driven[eta0]"], 1.0, atol=1e-12)
    assert len({len(column) for column in columns.values()}) == 1
    found = laos.steady()
    assert found["T"].mean == pytest.approx(0.2 / 3.225, rel=1e-12)  # of the mean cycle
    assert found["S"].mean == pytest.approx(1.0) and found["e3_over_e1"].mean == pytest.approx(1 / 3)
    assert found["eta_L"].drifting and not found["G_L"].drifting
    assert laos.direct["eta_L"] == pytest.approx(3.225, abs=1e-6)
    assert laos.direct["G_M"] == pytest.approx(0.0, abs=1e-5)
    content = json.loads(json.dumps(laos.summary()))
    assert content["parts"]["interparticle"]["G_L"]["mean"] == pytest.approx(0.3)
    np.testing.assert_allclose(laos.ratio("T")[2:].mean(), found["T"].mean, rtol=1e-14)


def test_moduli_of_a_stored_run(tmp_path):
    """Equation (1) by part and cycle to 1e-12, ratios of averages, columns and CSV."""
    with stored(tmp_path / "run", shear_parts, phase=0.4) as run:
        moduli = Moduli(last=4).compute(run)
        with pytest.raises(ConfigurationError, match="last 5 cycles"):
            Moduli(last=5).compute(run)
    np.testing.assert_allclose(moduli.eta_r_prime, 3.15 + 0.01 * np.arange(4), atol=1e-12)
    np.testing.assert_allclose(moduli.eta_r_double_prime, 0.225, atol=1e-12)
    np.testing.assert_allclose(moduli.harmonics.elastic("interparticle")[:, 3], -0.075, atol=1e-12)
    np.testing.assert_allclose(moduli.total_strain, 3.2 * np.arange(1, 5))
    found = moduli.steady()
    assert found["minus_eta3_over_eta1"].mean == pytest.approx(-0.05 / 3.165, rel=1e-12)
    assert found["eta5_over_eta1"].mean == pytest.approx(0.0, abs=1e-14)
    assert found["eta1_prime_hydrodynamic"].mean == pytest.approx(2.165)
    assert found["G1_prime_interparticle"].mean == pytest.approx(0.225)
    moduli.write_csv(tmp_path / "m.csv")
    with open(tmp_path / "m.csv", newline="") as file:
        header, *rows = csv.reader(file)
    assert header == list(moduli.table()) and len(rows) == 4
    assert float(rows[2][header.index("eta_r_prime[-]")]) == moduli.eta_r_prime[2]


@pytest.mark.parametrize("phase", [0.0, 0.9])
def test_normal_stresses(tmp_path, phase):
    """N2 = Re sum nu_n exp(i n theta) with nu_0 = -0.5 - 0.1 k, nu_2 = 0.3 i, nu_4 = 0.4 - 0.2 i by part: returned.

    N1 is hydrodynamic only. |nu_4|/|nu_2| = 1.4907 of the total and both parts.
    """
    nu2, nu4 = 0.3j, 0.4 - 0.2j

    def parts(k):
        def n2(t, share):
            return UNIT * share * (-0.5 - 0.1 * k + (nu2 * np.exp(2j * t) + nu4 * np.exp(4j * t)).real)

        return {
            "hydrodynamic": lambda t: stress(0 * t, 0.1 * UNIT + n2(t, 0.25), n2(t, 0.25), 0.0),
            "interparticle": lambda t: stress(0 * t, n2(t, 0.75), n2(t, 0.75), 0.0),
        }

    with stored(tmp_path / "run", parts, phase=phase) as run:
        found = NormalStresses(last=2).compute(run)
    np.testing.assert_allclose(found.mean_per_cycle(), -0.5 - 0.1 * np.arange(4), atol=1e-12)
    np.testing.assert_allclose(found.nu(4, "N2", "interparticle"), 0.75 * nu4, atol=1e-12)
    np.testing.assert_allclose(found.nu(2, "N2", "hydrodynamic"), 0.25 * nu2, atol=1e-12)
    np.testing.assert_allclose(found.nu(0, "N1"), 0.1, atol=1e-12)
    np.testing.assert_allclose(found.doubling(), abs(nu4) / abs(nu2), rtol=1e-12)
    averages = found.steady()
    assert averages["N2_nu0"].mean == pytest.approx(-0.75)
    assert averages["N2_nu0_interparticle"].mean == pytest.approx(-0.5625)
    assert averages["N2_nu4_over_nu2_hydrodynamic"].mean == pytest.approx(abs(nu4) / abs(nu2), rel=1e-12)
    assert averages["N2_nu2_abs"].mean == pytest.approx(0.3, rel=1e-12)
    assert np.isfinite(np.stack(list(found.table().values()))[:7]).all()
    np.testing.assert_allclose(found.doubling_series(), abs(nu4) / abs(nu2), rtol=1e-12)


def test_lissajous_curves(tmp_path):
    """Waveforms of chosen cycles against the functions they were made of; their mean; area = dissipated work.

    sigma/(eta0 gamma0 omega) of cycle k is (3 + 0.01 k) y + 0.2 y^3 + 0.3 x^3. Work per cycle over pi eta0 gamma0^2
    omega is eta_1'/eta0 = 3.15 + 0.01 k.
    """
    with stored(tmp_path / "run", shear_parts, phase=0.4) as run:
        last, mean = Lissajous().compute(run), Lissajous([0, 1, -1], "strain", "shear", "interparticle").compute(run)
        assert Lissajous(np.int64(2)).compute(run).dissipation() == pytest.approx(3.175)
        for wrong in (0, 5, [4], []):
            with pytest.raises(ConfigurationError, match="complete"):
                Lissajous(wrong).compute(run)
    x, y = last.signal("strain"), last.signal("rate")
    np.testing.assert_allclose(x**2 + y**2, 1.0, atol=1e-12)
    np.testing.assert_allclose(last.signal("shear"), 3.03 * y + 0.2 * y**3 + 0.3 * x**3, atol=1e-12)
    np.testing.assert_allclose(last.viscous_stress(), 3.03 * y + 0.2 * y**3, atol=1e-12)
    np.testing.assert_allclose(last.elastic_stress(), 0.3 * x**3, atol=1e-12)
    assert last.dissipation() == pytest.approx(3.18) and last.dissipation("interparticle") == pytest.approx(
        0.0, abs=1e-13
    )
    assert mean.dissipation() == pytest.approx(3.15 + 0.04 / 3)
    strain, drawn = mean.curve()
    assert len(strain) == 65 and drawn[0] == drawn[-1]
    np.testing.assert_allclose(drawn[:-1], 0.3 * x**3, atol=1e-12)
    # the area of the closed polygon of the total stress: pi eta_1' times sinc(2 pi/n), n samples on the ellipse
    stress_, strain_ = last.signal("shear"), x
    area = 0.5 * np.sum(stress_ * np.roll(strain_, -1) - strain_ * np.roll(stress_, -1))
    assert area == pytest.approx(np.pi * 3.18, rel=0.01)
    assert last.parts == ("total", "hydrodynamic", "interparticle", "flow_driven")
    assert "shear_flow_driven[eta0*gamma0*omega]" in last.table()
    with pytest.raises(ConfigurationError, match="no frictional part"):
        last.signal("shear", "frictional")
    with pytest.raises(ConfigurationError, match="no curve"):
        Lissajous(1, "time")


def test_spectrum(tmp_path):
    """Parseval: the powers add to the mean square; each is |c_n|^2/2; eta_5'/eta_1' and the share of even harmonics."""

    def parts(_):
        return {
            "hydrodynamic": lambda t: stress(
                UNIT * (2 * np.cos(t) + 0.3 * np.sin(2 * t) + 0.06 * np.cos(5 * t)), 0.4 * UNIT
            ),
            "interparticle": lambda t: stress(UNIT * 0.1 * np.cos(30 * t)),
        }

    with stored(tmp_path / "run", parts) as run:
        spectrum, waves = PowerSpectrum().compute(run), mean_waveforms(run, 4)
    expected = np.zeros(32)
    expected[[1, 2, 5, 30]] = 4.5, 0.045, 0.0018, 0.005
    np.testing.assert_allclose(spectrum.power(), expected, atol=1e-12)
    assert spectrum.power().sum() == pytest.approx(np.mean(waves["shear"] ** 2), rel=1e-13)
    assert spectrum.power("N1")[0] == pytest.approx(0.16)
    assert spectrum.fifth == pytest.approx(0.02) == spectrum.summary()["eta5_over_eta1"]
    assert spectrum.summary()["even_share"] == pytest.approx(0.05 / 4.5518)
    assert spectrum.power("shear", "interparticle")[30] == pytest.approx(0.005)
    assert len(spectrum.table()["harmonic"]) == 32


def test_other_flows_and_empty_runs(tmp_path):
    """Steady shear has no Fourier moduli, an empty run nothing at all: an error that says so."""
    rate = {"rate": 2.0, "viscosity": 2.0}
    records = [steady_record(k, rate, stress(np.full(32, 4.0))) for k in range(2)]
    path = write_run(tmp_path / "s", configuration({"type": "steady", "rate": 2.0}, {"strain": 2.0}), records)
    flow = {"type": "oscillatory", "amplitude": 0.8, "omega": 2.0}
    empty = write_run(tmp_path / "e", configuration(flow, {"cycles": 2}), [])
    for quantity in (Moduli(), Laos(), NormalStresses(), Lissajous(), PowerSpectrum()):
        with Run(path) as run, pytest.raises(ConfigurationError, match=r"flow is steady.*oscillatory"):
            quantity.compute(run)
        with Run(empty) as run, pytest.raises(ConfigurationError, match="no complete cycle"):
            quantity.compute(run)


def test_one_cycle(tmp_path):
    """The shortest run: values, no error bars, no drift."""
    with stored(tmp_path / "run", shear_parts, cycles=1) as run:
        for quantity in (Moduli(), Laos(), NormalStresses()):
            quantity.compute(run)
            averages = quantity.steady()
            assert all(np.isnan(each.error) and not each.drifting for each in averages.values())
        assert Moduli().compute(run).steady()["eta_r_prime"].mean == pytest.approx(3.15)


def test_missing_samples(tmp_path):
    """A cycle that lacks a sample, or has another number than the rest: the error names the cycle."""
    records = [oscillatory_record(k, SCALES, shear_parts(k)) for k in range(3)]
    frames = ("frame_time", "frame_strain", "frame_phase", "tilt", "position", "image", "unwrapped")
    for name, column in records[1].items():
        if name not in ("index", "complete", "statistics", *frames):
            records[1][name] = np.delete(column, 10, axis=0)
    flow = {"type": "oscillatory", "amplitude": 0.8, "omega": 2.0}
    path = write_run(tmp_path / "run", configuration(flow, {"cycles": 3}), records)
    with Run(path) as run:
        with pytest.raises(ConfigurationError, match=r"cycle 1 of .*63 samples are not at equal phases"):
            read_harmonics(run)
        with pytest.raises(ConfigurationError, match=r"cycle 1 of .*samples are missing"):
            mean_waveforms(run, 3)
        assert Lissajous(1).compute(run).dissipation() == pytest.approx(3.17)  # the last cycle is whole


def test_a_part_that_is_not_stored(tmp_path):
    """Runs store flow_driven on request only: an error that names what is there."""
    with stored(tmp_path / "run", lambda k: {n: f for n, f in shear_parts(k).items() if n != "flow_driven"}) as run:
        harmonics = read_harmonics(run)
    assert harmonics.parts == ("total", "hydrodynamic", "interparticle")
    with pytest.raises(ConfigurationError, match="no part 'flow_driven'"):
        harmonics.viscous("flow_driven")


def test_analysis_shows_the_measures(tmp_path):
    """`analyze`: screen and JSON hold the averages of the quantities, parts included, and stay within 110 columns."""
    path = tmp_path / "run"
    with stored(path, shear_parts, cycles=12, phase=0.4) as run:
        laos, moduli = Laos(last=4).compute(run), Moduli(last=4).compute(run)
    result = analyze(path)
    content = json.loads(json.dumps(result.as_dict(), allow_nan=False))
    assert content["laos"]["parts"]["total"]["T"]["mean"] == laos.steady()["T"].mean
    assert content["laos"]["direct"] == laos.direct
    assert content["drift"]["cycles"] == 6 and "eta_r_prime" in content["drift"]["drifting"]
    assert content["spectrum"]["eta_n_prime[eta0]"][3] == pytest.approx(0.05)
    assert "N2_nu4_over_nu2_interparticle" in content["normal_stresses"]["averages"]
    average = content["averages"]["quantities"]["minus_eta3_over_eta1[-]"]
    assert average["mean"] == moduli.steady()["minus_eta3_over_eta1"].mean and average["p_value"] < 0.01
    lines = result.table().splitlines()
    assert max(len(line) for line in lines if str(path) not in line) <= 110
    heading = next(k for k, line in enumerate(lines) if line.startswith("Large-amplitude measures"))
    assert f"{laos.steady()['T'].mean:.5g}" in lines[heading + 2] and lines[heading + 1].split()[-1] == "T"
    assert any("not steady" in line for line in lines)


def test_plots(tmp_path):
    """Each quantity draws labelled curves into given axes."""
    from matplotlib.figure import Figure

    with stored(tmp_path / "run", shear_parts) as run:
        for quantity in (Moduli(), Laos(), NormalStresses(), Lissajous(2, "strain", "N2"), PowerSpectrum()):
            axes = Figure().add_subplot()
            quantity.compute(run).plot(axes)
            assert axes.lines and axes.get_xlabel() and axes.get_ylabel()
