"""Near and far field together: two spheres in large cells against exact two-sphere hydrodynamics."""

import importlib.util
from pathlib import Path

import pytest

PATH = Path(__file__).parents[1] / "benchmarks" / "two_spheres.py"
_spec = importlib.util.spec_from_file_location("two_spheres", PATH)
two_spheres = importlib.util.module_from_spec(_spec)
_spec.loader.exec_module(two_spheres)


@pytest.mark.parametrize("gap", [1e-6, 1e-2, 0.5, 1.9])
def test_hard_cutoff_gives_the_exact_pair(gap):
    """Closer than the cutoff, near field (exact minus FTS) and far field (FTS) must add up to the exact two-sphere
    problem when the cell goes to infinity. 1e-7 is ten times what the extrapolation over four edges leaves.
    """
    assert two_spheres.deviation(2.0 + gap, "hard") < 1e-7


def test_beyond_the_cutoff_the_method_itself_errs():
    """At r = 5 only the far field is left: the error is that of the FTS level, of the order r^-5 = 3e-4 for forces,
    not less than a tenth of it, and the same for both cutoffs.
    """
    hard, shifted = two_spheres.deviation(5.0, "hard"), two_spheres.deviation(5.0, "shifted")
    assert 3e-5 < hard < 3e-3
    assert hard == pytest.approx(shifted, rel=1e-9)
