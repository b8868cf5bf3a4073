"""Figures of a start: the same whether the configuration was made or read, and what is said where there are none."""

from __future__ import annotations

import numpy as np
import pytest

from suspend.config import from_dict
from suspend.initial import prepare_initial
from suspend.simulation.start_figures import start_figures


def start(initial="equilibrium", directory=".", number=300, phi=0.4):
    """A prepared start and its figures."""
    base = {
        "particles": {"number": number, "volume_fraction": phi, "initial": initial},
        "flow": {"type": "quiescent"},
        "duration": {"strain": 1.0},
    }
    config = from_dict(base)
    prepared = prepare_initial(config, directory)
    return prepared, start_figures(prepared, config.particles.minimum_gap)


def test_figures_show_which_kind_it_is():
    """Against the fluid's values: the equilibrium start within its scatter, the quenched one far from them all."""
    fluid, quenched = start("equilibrium")[1], start("quenched")[1]
    assert fluid.contact_value.equilibrium == quenched.contact_value.equilibrium
    assert fluid.contact_value.value < 1.5 * fluid.contact_value.equilibrium
    assert quenched.contact_value.value > 4.0 * quenched.contact_value.equilibrium
    assert fluid.s_qmin.value < 4.0 * fluid.s_qmin.equilibrium
    assert quenched.s_qmin.value > 4.0 * quenched.s_qmin.equilibrium
    assert fluid.beta0.value == pytest.approx(fluid.beta0.equilibrium, abs=0.3)  # scatters by 0.07
    assert quenched.beta0.value > quenched.beta0.equilibrium + 0.4


def test_a_file_has_the_figures_of_what_is_in_it(tmp_path):
    """A quenched start written and read back: S, beta0 and order the same (1e-9), whatever lattice vectors describe it;
    it is called a file, and compared with spheres without gap.
    """
    prepared, made = start("quenched")
    for tilt in (0.0, 1.0):  # the same lattice
        np.savez(tmp_path / "a.npz", positions=prepared.positions, L=prepared.length, tilt=tilt, radius=1.0)
        read = start("a.npz", tmp_path)[1]
        assert read.kind == "file" and read.line().startswith("start: configuration of a file, ")
        assert read.effective_volume_fraction == pytest.approx(0.4)
        for name in ("s_qmin", "beta0"):
            assert getattr(read, name).value == pytest.approx(getattr(made, name).value, rel=1e-9)
        assert read.global_q6 == pytest.approx(made.global_q6, rel=0.05)  # bonds up to 1.4 of 2 or 2.001 radii
        assert read.minimum_gap == pytest.approx(made.minimum_gap, abs=1e-12)


def test_stirring_that_ended_early_is_told(monkeypatch):
    """The line and the attributes say that the longest waves are not at equilibrium, and by how much."""
    assert "start_long_waves_note" not in start(phi=0.1)[1].meta()
    monkeypatch.setattr("suspend.packing.LONG_WAVE_MOVES", 0)
    prepared, figures = start(phi=0.1)
    told = f"stirred by {prepared.packing.rms_travel:.3g} a, which would take {prepared.packing.needed_travel:.3g} a"
    assert told in figures.line() and told in figures.meta()["start_long_waves_note"]


def test_few_spheres_and_very_many_have_no_exponent(monkeypatch):
    """Below 30 spheres nothing is said of density fluctuations; beyond the pairs that can be visited not of beta0."""
    few = start(number=20, phi=0.02)[1]
    assert not {"start_s_qmin", "start_beta0", "start_beta0_equilibrium"} & set(few.meta())
    assert "no beta0 (fewer than 30 spheres)" in few.line() and "S(qmin)" not in few.line()
    monkeypatch.setattr("suspend.simulation.start_figures.ALL_PAIRS", 250)
    many = start()[1]
    assert "no beta0 (more than 250 spheres)" in many.line() and "start_s_qmin" in many.meta()


def test_dense_starts_are_compared_with_the_metastable_fluid():
    """Above freezing there is no fluid at equilibrium to compare with, and the line does not say so."""
    line = start(number=120, phi=0.55)[1].line()
    assert "metastable fluid" in line and "equilibrium fluid" not in line
