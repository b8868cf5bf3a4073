"""Self-diffusion of walkers in a shear flow: the affine part is removed, the diffusion tensor comes back."""

from __future__ import annotations

import math

import numpy as np
import pytest
from synthetic_runs import EDGE, configuration, oscillatory_record, samples, stress, write_run

from suspend.analysis.diffusion import SelfDiffusion
from suspend.errors import ConfigurationError
from suspend.io import Run, RunStore

RATE, RADIUS = 2.0, 1.5


def block(index: int, phases: list[float], positions: np.ndarray, strain: np.ndarray, sign: float) -> dict:
    """An output block of unit strain whose frames at `phases` have the given positions (phases, N, 3) and strains."""
    phase = np.arange(8) / 8.0
    record = samples(index, phase, (index + phase) / RATE, np.full(8, sign * RATE))
    record |= {"strain": strain[0] + sign * phase, "stress_fluid": stress(np.full(8, 4.0 * sign))}
    record |= {"stress_hydrodynamic": np.zeros((8, 6)), "stress_interparticle": np.zeros((8, 6))}
    return record | frames_of(index, phases, positions, strain)


def frames_of(index: int, phases: list[float], positions: np.ndarray, strain: np.ndarray) -> dict:
    image = np.floor(positions / EDGE).astype(np.int32)
    return {
        "frame_time": (index + np.array(phases)) / RATE,
        "frame_strain": strain,
        "frame_phase": np.array(phases),
        "tilt": strain - np.floor(strain + 0.5),
        "position": positions - image * EDGE,
        "image": image,
        "unwrapped": positions,
        "statistics": {"evaluations": 10, "minimum_gap": 1e-3, "overlaps": 0},
    }


def sheared_run(path, walk: np.ndarray, strain: np.ndarray, signs, phases=(0.0,), flow=None):
    """A stored run without oscillation: positions walk (blocks K + 1, N, 3) at the given strains, K frames a block."""
    k, blocks = len(phases), len(signs)
    records = [
        block(i, list(phases), walk[i * k : (i + 1) * k], strain[i * k : (i + 1) * k], signs[i]) for i in range(blocks)
    ]
    flow = flow or {"type": "steady", "rate": RATE}
    config = configuration(flow, {"strain": float(blocks)}, walk.shape[1], RADIUS)
    path = write_run(path, config, records)
    with RunStore.open(path) as store:
        end = frames_of(blocks, [0.0], walk[-1:], strain[-1:])
        store.finish({"positions": walk[-1]}, {name: end[name] for name in end if name != "statistics"})
    return path


def walkers(seed: int, number: int, steps: int, fine: int, tensor: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Walkers of diffusion tensor D (a^2 per strain) in shear: positions (steps + 1, N, 3) each unit of strain, strain.

    x gains the exact integral of y over `fine` steps of Brownian motion within each unit (y constant within a step).
    """
    random, h = np.random.default_rng(seed), 1.0 / fine
    position = random.random((number, 3)) * EDGE
    stored = [position.copy()]
    for _ in range(steps):
        kicks = random.multivariate_normal(np.zeros(3), 2.0 * tensor * h * RADIUS**2, (fine, number))
        for kick in kicks:
            position[:, 0] += h * (position[:, 1] + 0.5 * kick[:, 1])
            position += kick
        stored.append(position.copy())
    return np.array(stored), np.arange(steps + 1.0)


def test_pure_shear_is_removed_exactly(tmp_path):
    """Spheres that only follow the flow, 60 units of strain and y up to 1e3: displacements vanish to round-off.

    x reaches 6e4, whose last bit is 7e-12; 60 such roundings, squared, stay below 1e-18. Also with a reversal.
    """
    random = np.random.default_rng(1)
    start = random.random((20, 3)) * 1e3
    for name, signs, flow in (
        ("steady", [1.0] * 60, None),
        ("reversal", [1.0] * 30 + [-1.0] * 30, {"type": "reversal", "rate": RATE, "reversal_strain": 30.0}),
    ):
        strain = np.concatenate([[0.0], np.cumsum(signs)])
        walk = start + strain[:, None, None] * (start[:, [1]] * [1.0, 0.0, 0.0])
        with Run(sheared_run(tmp_path / name, walk, strain, signs, flow=flow)) as run:
            found = SelfDiffusion().compute(run)
        assert np.ptp(walk[:, :, 0]) > 1e4 and np.abs(found.msd).max() < 1e-18
        assert np.abs(found.tensor).max() < 1e-18 and found.notes == []


def test_a_straight_path_across_the_flow_is_removed_exactly(tmp_path):
    """y = y0 + v gamma, x = x0 + y0 gamma + v gamma^2/2, two frames a block: nothing is left in x, (v l)^2 in y."""
    random, strain = np.random.default_rng(2), np.arange(0.0, 20.5, 0.5)
    start, v, w = random.random((6, 3)) * 9.0, random.normal(size=6), np.array([1.0, -1.0, 2.0, -2.0, 3.0, -3.0])
    v -= v.mean()
    g = strain[:, None]
    walk = np.stack([start[:, 0] + start[:, 1] * g + v * g**2 / 2, start[:, 1] + v * g, start[:, 2] + w * g], axis=-1)
    with Run(sheared_run(tmp_path / "run", walk, strain, [1.0] * 20, (0.0, 0.5))) as run:
        found = SelfDiffusion().compute(run)
    np.testing.assert_allclose(found.msd[:, 2, 2], np.mean(w**2) * found.lags**2 / RADIUS**2, rtol=1e-10)
    np.testing.assert_allclose(found.msd[:, 1, 1], np.mean(v**2) * found.lags**2 / RADIUS**2, rtol=1e-10)
    assert np.abs(found.msd[:, 0, 0]).max() < 1e-16 and found.lags[0] == 1.0


def test_walkers_in_shear_return_their_tensor(tmp_path):
    """D_ab within 4 standard errors, D_xx with the documented D_yy h^2/12 of the trapezoidal rule on top.

    Frames h = 1 apart; the integral of a Brownian bridge has variance 2 D_yy h^3/12. D_yy = 6 D_xx makes this 50 % of
    D_xx, far outside the error. Without the removal D_xx would be larger by orders of magnitude (Taylor dispersion).
    """
    tensor = np.array([[0.01, 0.005, 0.0], [0.005, 0.06, 0.0], [0.0, 0.0, 0.03]])
    walk, strain = walkers(3, 1500, 64, 24, tensor)
    with Run(sheared_run(tmp_path / "run", walk, strain, [1.0] * 64)) as run:
        found = SelfDiffusion(window=(1.0, 6.0)).compute(run)
        thinned = SelfDiffusion(window=(1.0, 8.0), memory=24 * 1500 * 20).compute(run)
    expected = tensor.copy()
    expected[0, 0] += tensor[1, 1] / 12.0
    assert np.all(np.abs(found.tensor - expected) < 4.0 * found.standard_error + expected / 1500)
    assert found.quadrature_bias == pytest.approx(tensor[1, 1] / 12.0, rel=0.1)
    assert found.fit_window == (1.0, 6.0) and any("store frames more often" in note for note in found.notes)
    np.testing.assert_allclose(found.standard_error[1, 1] / found.tensor[1, 1], 0.02, atol=0.015)
    assert np.all(np.abs(thinned.tensor - expected) < 4.0 * thinned.standard_error + expected / 1500)
    assert any("every 4th position" in note for note in thinned.notes)


def test_reported_error_covers_the_scatter(tmp_path):
    """Over 12 runs of walkers the deviations of D_zz have the size of the reported error: chi^2 of 12 between 3 and 29
    (0.5 % tails each)."""
    tensor, chi = np.diag([0.01, 0.02, 0.03]), 0.0
    for seed in range(12):
        walk, strain = walkers(100 + seed, 60, 30, 1, tensor)
        with Run(sheared_run(tmp_path / str(seed), walk, strain, [1.0] * 30)) as run:
            found = SelfDiffusion().compute(run)
        chi += ((found.tensor[2, 2] - 0.03 * (1.0 - 1.0 / 60)) / found.standard_error[2, 2]) ** 2
    assert 3.0 < chi < 29.0


def test_oscillatory_walk_over_all_cycles(tmp_path):
    """Cycle starts of an oscillatory run: D = D_cyc for independent steps, within 4 errors; the lag is 4 gamma0."""
    scales = {"gamma0": 0.8, "omega": 2.0, "viscosity": 2.0, "phase": 0.0}
    d, number, cycles = 0.02, 800, 24
    step = RADIUS * math.sqrt(8.0 * 0.8 * d / 3.0)
    walk = np.cumsum(np.random.default_rng(5).normal(scale=step, size=(cycles + 1, number, 3)), axis=0)

    def rest(theta):
        return stress(np.zeros(len(theta)))

    parts = {"hydrodynamic": rest, "interparticle": rest}
    records = [oscillatory_record(k, scales, parts, 20, walk[k]) for k in range(cycles)]
    config = configuration({"type": "oscillatory", "amplitude": 0.8, "omega": 2.0}, {"cycles": cycles}, number, RADIUS)
    with Run(write_run(tmp_path / "run", config, records, walk[-1])) as run:
        found = SelfDiffusion().compute(run)
    assert found.lags[0] == pytest.approx(3.2) and found.quadrature_bias == 0.0
    assert np.trace(found.tensor) == pytest.approx(d, abs=4.0 * np.trace(found.standard_error))
    assert len(found.table()["strain[-]"]) == len(found.msd) and found.summary()["window"] == found.fit_window


def test_what_cannot_be_computed_is_an_error(tmp_path):
    """Two frames, a start beyond the run, a window without meaning."""
    walk, strain = walkers(7, 5, 2, 1, np.eye(3))
    with Run(sheared_run(tmp_path / "run", walk, strain, [1.0] * 2)) as run:
        with pytest.raises(ConfigurationError, match="3 frames"):
            SelfDiffusion().compute(run)
        with pytest.raises(ConfigurationError, match="0 frames from strain 9"):
            SelfDiffusion(start=9.0).compute(run)
    with pytest.raises(ConfigurationError, match="low < high"):
        SelfDiffusion(window=(3.0, 2.0))


def test_uneven_frames_are_an_error(tmp_path):
    """A reversal after 2.5 units of strain makes blocks of 0.83 and 1: lags would mix, so `start` is asked for."""
    random = np.random.default_rng(8)
    times = np.concatenate([np.arange(3) * 2.5 / 3.0, 2.5 + np.arange(7.0)])
    records = []
    for i in range(9):
        positions = random.random((1, 4, 3))
        record = block(i, [0.0], positions, np.zeros(1), 1.0)
        records.append(record | {"frame_time": times[i : i + 1] / RATE})
    config = configuration({"type": "steady", "rate": RATE}, {"strain": 9.0}, 4, RADIUS)
    with Run(write_run(tmp_path / "run", config, records)) as run:
        with pytest.raises(ConfigurationError, match="equal intervals"):
            SelfDiffusion().compute(run)
        assert SelfDiffusion(start=2.5).compute(run).lags[0] == pytest.approx(1.0)
