"""Signature curves with known extrema and onsets give the known intervals, bounds and bootstrap."""

from __future__ import annotations

import math

import numpy as np
import pytest

from suspend.analysis.collection import Member, Series
from suspend.analysis.phase_diagram import PhaseDiagram, experimental_fit
from suspend.analysis.signatures import (
    Range,
    Signatures,
    extremum_range,
    intersection,
    most_covered,
    onset_range,
    steepest_range,
)
from suspend.errors import ConfigurationError

PAPER = np.array([0.2, 0.4, 0.8, 1.0, 1.6, 3.2])


def member(gamma0: float, values: dict, phi: float = 0.4, seed: int = 1, error: float = 1e-6, drift=()) -> Member:
    errors = {name: error for name in values}
    return Member("run", phi, gamma0, 500, seed, 80, True, 10, 256.0, values, errors, drift, "absorbing", {}, ())


def curves(gamma0: float, minimum: float, thinning: float, onset: float, peak: float, rise: float = 0.9) -> dict:
    """The five quantities with extrema, onset and steepest rise at the given amplitudes."""
    return {
        "eta_r_prime": 3.0 + np.log(gamma0 / minimum) ** 2,
        "minus_eta3_over_eta1": 0.05 - 0.02 * np.log(gamma0 / thinning) ** 2,
        "minus_N2_nu0": max(0.0, 0.5 * (gamma0 - onset)),
        "nu4_over_nu2": 10.0 / (1.0 + 40.0 * np.log(gamma0 / peak) ** 2),
        "D_cyc": 0.01 / (1.0 + math.exp(-(gamma0 - rise) / 0.02)),
    }


def series_of(amplitudes, phi: float = 0.4, seeds: int = 1, scatter: float = 0.0, **places) -> Series:
    random, groups = np.random.default_rng(1), []
    for gamma0 in amplitudes:
        group = []
        for seed in range(seeds):
            values = curves(gamma0, **places)
            values["eta_r_prime"] += scatter * random.normal()
            group.append(member(float(gamma0), values, phi, seed))
        groups.append(tuple(group))
    return Series(phi, "", tuple(groups))


def test_ranges_of_the_paper():
    """The paper's amplitudes and extrema return the ranges in its text: (0.8, 1.6), (0.4, 1.0), gamma_c in (0.8, 1.0).

    On 0.2 0.4 0.8 1.0 1.6 3.2: eta_r' smallest at 1.0, thinning largest at 0.8, a line through the last three of
    -nu0/eta0 that crosses zero at 0.9, a peak of |nu4|/|nu2| at 0.8, a rise of D_cyc between 0.8 and 1.0.
    """
    found = Signatures().compute(series_of(PAPER, minimum=1.05, thinning=0.75, onset=0.9, peak=0.85))
    ranges = {name: (r.low, r.high) for name, r in found.ranges.items()}
    assert ranges["minimum of eta_r'"] == (0.8, 1.6) and ranges["maximum of -eta3'/eta1'"] == (0.4, 1.0)
    assert ranges["onset of -nu0/eta0"] == (0.8, 1.0) and ranges["peak of |nu4|/|nu2|"] == (0.4, 1.0)
    assert found.ranges["onset of -nu0/eta0"].best == pytest.approx(0.9, rel=1e-12)
    assert (found.bound.low, found.bound.high, found.bound.best) == (0.8, 1.0, pytest.approx(0.9))
    assert (found.rise.low, found.rise.high) == (0.8, 1.0)
    assert found.agreement == (4, 4, found.bound) and found.bound.bracketed
    assert found.confidence("gamma_c") is None and any("one run (seed)" in note for note in found.notes)
    table = found.table()
    assert table["low[gamma0]"][4] == 0.8 and len(table["signature"]) == len(found.rows()) == 8


@pytest.mark.parametrize("place", [0.17, 0.45, 0.8, 1.13, 2.0, 2.4])
def test_a_single_extremum_lies_in_its_range(place):
    """A curve with one maximum anywhere: it lies between the neighbours of the largest sample, for every place."""
    amplitudes = np.array([0.1, 0.2, 0.35, 0.5, 0.8, 1.0, 1.4, 2.2, 3.2])
    for width in (0.1, 1.0, 5.0):
        values = 1.0 / (1.0 + width * np.log(amplitudes / place) ** 2)
        found = extremum_range(amplitudes, values)
        assert found.low < place < found.high and found.bracketed


def test_open_ends_gaps_and_rivals():
    """An extremum at the end is open; NaN is skipped; fewer than 3 values give none; near values far off are rivals."""
    x = np.array([0.2, 0.4, 0.8, 1.6])
    assert extremum_range(x, x) == Range(0.8, math.inf, 1.6) and extremum_range(x, -x) == Range(0.0, 0.4, 0.2)
    assert not extremum_range(x, x).bracketed
    assert extremum_range(x, np.array([1.0, math.nan, 3.0, 2.0])) == Range(0.2, 1.6, 0.8)
    assert extremum_range(x, np.array([1.0, math.nan, 3.0, math.nan])) is None
    y, errors = np.array([2.9, 1.0, 3.0, 2.0]), np.full(4, 0.1)
    assert extremum_range(x, y, errors).rivals == (0.2,) and extremum_range(x, y, 0.1 * errors).rivals == ()


def test_onset_and_steepest_rise():
    """Exact lines: the crossing is exact; two-slope curve: the steeper part; falling or too few values give none."""
    x = np.array([0.5, 1.0, 1.5, 2.0, 3.0])
    found = onset_range(x, 2.0 * np.maximum(0.0, x - 1.2))
    assert (found.low, found.high) == (1.0, 1.5) and found.best == pytest.approx(1.2, rel=1e-12)
    assert onset_range(x, 2.0 * np.maximum(0.0, x - 1.2), points=2).best == pytest.approx(1.2, rel=1e-12)
    assert onset_range(x, x + 1.0).low == 0.0 and onset_range(x, -x) is None and onset_range(x[:2], x[:2]) is None
    assert steepest_range(x, np.array([0.0, 0.1, 0.2, 1.0, 1.9])) == Range(1.5, 2.0, 1.75)
    assert steepest_range(x, np.array([1e-6, 1e-4, 1e-3, 1.0, 9.0]), logarithmic=True).low == 1.5
    assert steepest_range(x, np.array([0.0, 1e-4, 1e-3, 1e-2, 9.0]), logarithmic=True).low == 2.0  # 0 is left out
    assert steepest_range(x, -x) is None and steepest_range(x[:2], x[:2]) is None


def test_intersections():
    """Common part, nothing in common, open ends, and the part shared by most."""
    assert intersection([Range(0.8, 1.6, 1.0), Range(0.4, 1.0, 0.8)]) == Range(0.8, 1.0, pytest.approx(0.9))
    assert intersection([Range(0.4, 0.8, 0.6), Range(0.8, 1.6, 1.0)]) is None and intersection([]) is None
    assert math.isnan(intersection([Range(0.8, math.inf, 1.6)]).best)
    three = [Range(0.4, 1.0, 0.8), Range(0.6, 1.0, 0.8), Range(1.2, 1.6, 1.3), Range(0.8, 1.4, 1.0)]
    assert most_covered(three) == (3, Range(0.8, 1.0, pytest.approx(0.9)))
    assert most_covered([]) == (0, None)
    assert Range(0.4, 1.0, 0.8).overlap(Range(0.8, 2.0, 1.0)) == pytest.approx(0.2)


def test_contradiction_is_said_not_hidden():
    """Signatures that exclude each other give no bound, and the note names what most of them share."""
    found = Signatures().compute(series_of(PAPER, minimum=1.05, thinning=0.75, onset=2.0, peak=0.85))
    assert found.bound is None and found.agreement[:2] == (3, 4)
    assert (found.agreement[2].low, found.agreement[2].high) == (0.8, 1.0)
    assert any("exclude each other; 3 of 4 agree on (0.8, 1)" in note for note in found.notes)
    few = Signatures().compute(series_of(PAPER[:2], minimum=0.3, thinning=0.3, onset=0.1, peak=0.3))
    assert few.bound is None and few.rise is None and few.notes == ["2 amplitude(s): 3 are needed for the signatures"]


def test_bootstrap_over_seeds():
    """Scatter of eta_r' far below its differences: every resample is the same. Scatter as large as them: it moves.

    Then the frequency is that of the smallest mean of values drawn with replacement, counted here directly from another
    generator: two counts of 2000, whose difference has a standard deviation of at most sqrt(0.5/2000).
    """
    quiet = Signatures(resamples=200).compute(
        series_of(PAPER, seeds=5, scatter=1e-4, minimum=1.05, thinning=0.75, onset=0.9, peak=0.85)
    )
    assert quiet.confidence("gamma_c") == {"same": 1.0, "none": 0.0, "low": 0.8, "high": 1.0}
    assert not any("coarse" in note for note in quiet.notes)
    series = series_of(PAPER, seeds=4, scatter=1.2, minimum=0.9, thinning=0.75, onset=0.9, peak=0.85)
    found = Signatures(resamples=2000).compute(series).confidence("minimum of eta_r'")
    values = [[member.values["eta_r_prime"] for member in group] for group in series.groups]
    random = np.random.default_rng(99)
    at = np.array([np.argmin([random.choice(v, 4).mean() for v in values]) for _ in range(2000)])
    original = int(np.argmin(series.mean("eta_r_prime")))
    same = float(np.mean(at == original))
    assert 0.3 < same < 0.9 and found["same"] == pytest.approx(same, abs=4.0 * math.sqrt(0.5 / 2000))
    assert found["high"] > PAPER[original + 1]
    mixed = Series(0.4, "", (*series.groups[:3], *((g[0],) for g in series.groups[3:])))
    assert any("3 of 6 amplitudes" in note for note in Signatures(resamples=10).compute(mixed).notes)


class Made:
    """A collection of given series."""

    def __init__(self, *series):
        self.series = list(series)


def test_phase_diagram_returns_a_known_power_law():
    """Signatures that bracket 0.14 phi^-1.93 narrowly give its exponent and prefactor within the 95 % interval.

    Amplitudes 2 % apart: bounds of 2 to 4 %; over phi = 0.2 .. 0.5 that leaves an exponent within about 0.03.
    """
    series = []
    for phi in (0.2, 0.3, 0.4, 0.5):
        place = float(experimental_fit(phi))
        amplitudes = place * 1.02 ** (np.arange(-20, 21) + 0.5)
        places = dict.fromkeys(("minimum", "thinning", "onset", "peak", "rise"), place)
        series.append(series_of(amplitudes, phi, **places))
    found = PhaseDiagram().compute(Made(*series))
    assert found.agrees == [True] * 4 and all(b.high / b.low < 1.05 for b in found.bounds)
    np.testing.assert_allclose(found.reference, [3.1271, 1.4298, 0.8206, 0.5335], rtol=1e-3)
    law = found.power_law()
    assert law["exponent_interval"][0] < 1.93 < law["exponent_interval"][1]
    assert law["exponent"] == pytest.approx(1.93, abs=0.05) and law["prefactor"] == pytest.approx(0.14, rel=0.06)
    assert law["prefactor_interval"][0] < 0.14 < law["prefactor_interval"][1]
    np.testing.assert_allclose(found.table()["ratio[-]"], 1.0, atol=0.03)
    one = PhaseDiagram().compute(Made(series[0]))
    assert one.power_law() is None and one.summary()["power_laws"] == {"": None}


def test_parameters_without_meaning():
    for wrong in ({"points": 1}, {"resamples": -1}):
        with pytest.raises(ConfigurationError):
            Signatures(**wrong)
    with pytest.raises(ConfigurationError):
        PhaseDiagram(draws=0)
