"""Checks that take a minute: `make long`."""

from __future__ import annotations

from pathlib import Path

import pytest

from suspend.analysis.summary import analyze
from suspend.config import load
from suspend.simulation import run

PAPER = Path(__file__).parent.parent / "configs" / "paper.yaml"


@pytest.mark.long
@pytest.mark.parametrize(("amplitude", "absorbing"), [(0.2, True), (3.2, False)])
def test_small_amplitudes_absorb_and_large_ones_diffuse(tmp_path, amplitude, absorbing):
    """Reversible-irreversible transition at phi = 0.40 (gamma_c about 0.8 to 1, Ge & Elfring).

    Within a total strain of 40, D_cyc falls more than a hundredfold at gamma0 = 0.2 and stays finite at 3.2.
    """
    run(load(PAPER, [f"flow.amplitude={amplitude}", "duration.strain=40"]), tmp_path / "r")
    d_cyc = analyze(tmp_path / "r").d_cyc
    assert (d_cyc[-1] < 0.01 * d_cyc[0]) if absorbing else (d_cyc[-1] > 0.2 * d_cyc[0])
