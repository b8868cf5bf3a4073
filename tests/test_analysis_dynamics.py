"""D_cyc of known displacements, and the analysis of whole runs stored with the program's own writer."""

from __future__ import annotations

import csv
import json
import math

import numpy as np
import pytest
from synthetic_runs import configuration, oscillatory_record, steady_record, stress, write_run

from suspend.analysis.dynamics import cyclic_diffusivities, cyclic_diffusivity, mean_square_displacement
from suspend.analysis.steady import steady_average
from suspend.analysis.summary import analyze
from suspend.analysis.tables import shown_cycles
from suspend.errors import ConfigurationError, StorageError

SCALES = {"gamma0": 0.8, "omega": 2.0, "viscosity": 2.0, "phase": 0.3, "radius": 1.5}
FLOW = {"type": "oscillatory", "amplitude": 0.8, "omega": 2.0, "phase": 0.3}


def parts_of(index: int) -> dict:
    """Stresses of a cycle: eta_1' = 4 + 1/(index + 1) in units of eta0, of which 1 is interparticle."""
    unit = SCALES["viscosity"] * SCALES["gamma0"] * SCALES["omega"]
    return {
        "hydrodynamic": lambda t: stress(unit * (2.0 + 1.0 / (index + 1)) * np.cos(t), -unit),
        "interparticle": lambda t: stress(unit * np.cos(t)),
    }


def oscillatory_run(path, walk: np.ndarray, cycles: int, finished: bool = True):
    """A stored run whose positions at the start of cycle k are walk[k] (N, 3)."""
    records = [oscillatory_record(k, SCALES, parts_of(k), unwrapped=walk[k]) for k in range(cycles)]
    config = configuration(FLOW, {"cycles": max(cycles, 1)}, walk.shape[1], SCALES["radius"])
    return write_run(path, config, records, walk[cycles] if finished else None)


def test_random_walkers():
    """Independent Gaussian steps of variance 2 D 4 gamma0 a^2 in total give D within its statistical error.

    <(Delta/a)^2> = 2 D_cyc 4 gamma0 over x, y and z together. Removing the mean displacement costs the
    factor 1 - 1/N. The relative standard deviation of a mean square of 3N Gaussians is sqrt(2/3N): 4 of them
    are allowed.
    """
    number, radius, gamma0, diffusivity = 20000, 1.5, 0.8, 0.037
    random = np.random.default_rng(3)
    steps = random.normal(size=(4, number, 3)) * radius * math.sqrt(8.0 * gamma0 * diffusivity / 3.0)
    walk = np.cumsum(steps, axis=0) + 100.0
    found = list(cyclic_diffusivities(iter(walk), gamma0, radius))
    assert len(found) == 3
    np.testing.assert_allclose(found, diffusivity, rtol=4.0 * math.sqrt(2.0 / (3 * number)) + 1.0 / number)


def test_small_number_bias():
    """The mean is removed and its factor 1 - 1/N is not corrected, as documented: worked out for two spheres.

    Two spheres displaced by +d and -d/2 along y: relative to the mean +-0.75 d, so <Delta^2> = 0.5625 d^2.
    """
    after = np.array([[0.0, 0.4, 0.0], [0.0, -0.2, 0.0]])
    expected = [0.0, 0.5625 * 0.16 / 4.0, 0.0]
    np.testing.assert_allclose(mean_square_displacement(np.zeros((2, 3)), after, 2.0), expected, atol=1e-16)


def test_drift_of_the_centre_is_removed():
    """A uniform displacement, 3e3 times the rearrangements, leaves D_cyc unchanged to round-off."""
    random = np.random.default_rng(4)
    before, step = random.random((50, 3)), 1e-2 * random.normal(size=(50, 3))
    still = cyclic_diffusivity(before, before + step, 0.5)
    drifting = cyclic_diffusivity(before, before + step + np.array([30.0, -7.0, 2.0]), 0.5)
    assert drifting == pytest.approx(still, rel=1e-10)
    assert cyclic_diffusivity(before, before + np.array([30.0, 0.0, 0.0]), 0.5) < 1e-25


def test_reversible_motion_and_lone_sphere():
    """Returning spheres: D_cyc = 0. One sphere has no displacement relative to itself: NaN, not 0."""
    positions = np.random.default_rng(5).random((10, 3))
    assert cyclic_diffusivity(positions, positions.copy(), 0.5) == 0.0
    assert math.isnan(cyclic_diffusivity(positions[:1], positions[1:2], 0.5))
    assert list(cyclic_diffusivities([], 0.5)) == [] == list(cyclic_diffusivities([positions], 0.5))


def test_analysis_of_a_stored_run(tmp_path):
    """Through the files: eta_r' = 4 + 1/(k + 1) and D_cyc of each cycle come back exactly (1e-12).

    The walk spreads every sphere by known distances: Delta = +-d_k along x, alternating, so that the mean is
    zero and D_cyc = (d_k/a)^2/(8 gamma0). Averages: plain mean of the last cycles, and the error and drift that
    `steady_average` gives for the column (tested by itself): eta_r' is still falling, N1 is constant.
    """
    cycles, signs = 40, np.array([1.0, -1.0, 1.0, -1.0])
    distances = 0.3 * 0.9 ** np.arange(cycles)
    walk = np.zeros((cycles + 1, 4, 3))
    walk[1:, :, 0] = np.cumsum(distances)[:, None] * signs
    result = analyze(oscillatory_run(tmp_path / "run", walk, cycles), last=5)
    expected = 4.0 + 1.0 / np.arange(1, cycles + 1)
    np.testing.assert_allclose(result["eta_r_prime"], expected, rtol=1e-12)
    np.testing.assert_allclose(result.d_cyc, (distances / 1.5) ** 2 / 6.4, rtol=1e-10)
    np.testing.assert_allclose(result.total_strain, 3.2 * np.arange(1, cycles + 1))
    np.testing.assert_allclose(result["N1_nu0_hydrodynamic"], -1.0, rtol=1e-12)
    average = result.averages()["eta_r_prime[-]"]
    assert average["mean"] == pytest.approx(expected[-5:].mean(), rel=1e-12)
    steady = steady_average(expected, 5)
    assert average["standard_error"] == pytest.approx(steady.error, rel=1e-6)
    assert average["drift"] == pytest.approx(steady.change, rel=1e-6) and average["drifting"]
    assert average["p_value"] == pytest.approx(steady.p_value, rel=1e-4) and steady.p_value < 0.01
    assert not result.averages()["N1_nu0[eta0]"]["drifting"]
    assert average["change"] == pytest.approx(expected[-1] - expected[-5], rel=0.05)  # nearly straight there
    (note,) = result.notes
    assert "total strain 67.2 to 128" in note and "eta_r' by -0.0" in note and "paper's runs drift" in note
    assert result.statistics["evaluations"] == 100 * cycles
    assert result.statistics["minimum_gap"] == pytest.approx(1e-3 / cycles)
    assert set(result.waveforms) == {0, cycles - 1}
    assert analyze(tmp_path / "run").last == 5  # an eighth of 40


def test_table_csv_and_json_hold_the_same_numbers(tmp_path):
    """The three forms of the result: CSV read back equals the columns bit for bit; JSON has no NaN; table
    as wide."""
    walk = np.cumsum(np.random.default_rng(6).normal(size=(31, 4, 3)), axis=0)
    result = analyze(oscillatory_run(tmp_path / "run", walk, 30))
    result.write_csv(tmp_path / "moduli.csv")
    with open(tmp_path / "moduli.csv", newline="") as handle:
        header, *rows = csv.reader(handle)
    assert header == ["cycle", *result.columns] and [row[0] for row in rows] == [str(k) for k in range(30)]
    np.testing.assert_array_equal(np.array(rows, float)[:, 1:], result.values)
    assert list(tmp_path.glob("*.tmp")) == []
    read = json.loads(json.dumps(result.as_dict(), allow_nan=False))
    assert read["columns"]["eta_r_prime[-]"] == result["eta_r_prime"].tolist()
    assert read["averages"]["cycles"] == result.last == 4
    text = result.table()
    assert max(len(line) for line in text.splitlines() if not line.startswith(str(tmp_path))) <= 110
    assert f"{result['eta_r_prime'][29]:.5g}" in text and "hydrodynamic" in text and "gamma_tot" in text


def test_unfinished_run(tmp_path):
    """While a run goes on its complete cycles are analysed; the end of the last one is not stored yet: NaN
    and a note."""
    walk = np.random.default_rng(7).normal(size=(4, 4, 3))
    result = analyze(oscillatory_run(tmp_path / "run", walk, 3, finished=False))
    assert np.isfinite(result.d_cyc[:2]).all() and np.isnan(result.d_cyc[2])
    assert any("not finished" in note for note in result.notes) and any("D_cyc" in note for note in result.notes)
    assert "Note:" in result.table()
    assert result.as_dict()["columns"]["D_cyc[-]"][2] is None
    assert result.averages()["D_cyc[-]"]["mean"] == pytest.approx(result.d_cyc[:2].mean())


def test_nothing_to_analyse(tmp_path):
    """A run without a complete cycle: an empty result that says so, in all its forms; a `last` is then an
    error."""
    path = write_run(tmp_path / "run", configuration(FLOW, {"cycles": 3}), [])
    result = analyze(path)
    assert len(result.values) == 0 and "no complete cycle" in result.table()
    assert result.as_dict()["cycles"] == 0
    result.write_csv(tmp_path / "empty.csv")
    assert (tmp_path / "empty.csv").read_text() == "cycle\n"
    with pytest.raises(ConfigurationError, match="last 2 cycles"):
        analyze(path, last=2)


def test_one_cycle_of_one_sphere(tmp_path):
    """The smallest run: moduli as always, no standard error, no D_cyc and a note that says why."""
    result = analyze(oscillatory_run(tmp_path / "run", np.zeros((2, 1, 3)), 1))
    assert result["eta_r_prime"][0] == pytest.approx(5.0, rel=1e-12)
    assert math.isnan(result.averages()["eta_r_prime[-]"]["standard_error"])
    assert "two spheres" in result.table()


def test_reversal_is_not_averaged_across(tmp_path):
    """Blocks before a reversal do not enter the default average: eta_r is 4 before, 6 after."""
    rate = {"rate": 2.0, "viscosity": 2.0}
    blocks = [(k, 1.0, 3.0) for k in range(3)] + [(k, -1.0, 5.0) for k in range(3, 9)]
    records = [steady_record(k, rate, stress(np.full(32, 4.0 * sign * value)), sign) for k, sign, value in blocks]
    flow = {"type": "reversal", "rate": 2.0, "reversal_strain": 3.0}
    path = write_run(tmp_path / "run", configuration(flow, {"strain": 9.0}), records, np.zeros((4, 3)))
    result = analyze(path)
    assert result.last == 3 and not result.oscillatory
    np.testing.assert_allclose(result["eta_r"], [4.0] * 3 + [6.0] * 6, rtol=1e-13)
    assert result.averages()["eta_r[-]"]["mean"] == pytest.approx(6.0)
    assert analyze(path, last=9).averages()["eta_r[-]"]["mean"] == pytest.approx((3 * 4 + 6 * 6) / 9)
    assert "block" in result.table() and "D_cyc" not in result


def test_unusable_paths_and_columns(tmp_path):
    """Missing run, unwritable CSV, unknown column: one error each that names the thing."""
    with pytest.raises(StorageError, match="does not exist"):
        analyze(tmp_path / "absent")
    result = analyze(oscillatory_run(tmp_path / "run", np.zeros((3, 4, 3)), 2))
    with pytest.raises(StorageError, match=r"nowhere/a\.csv"):
        result.write_csv(tmp_path / "nowhere" / "a.csv")
    with pytest.raises(KeyError, match="no column 'eta'"):
        result["eta"]
    with pytest.raises(ConfigurationError, match="last 3 cycles"):
        analyze(tmp_path / "run", last=3)


def test_shown_cycles():
    """Short runs in full; of long ones the first three, the last, at most 20, ascending and without
    repetition."""
    assert shown_cycles(20) == list(range(20))
    for count in (21, 80, 640, 100_000):
        shown = shown_cycles(count)
        assert shown[:3] == [0, 1, 2] and shown[-1] == count - 1 and len(shown) <= 20
        assert shown == sorted(set(shown))
