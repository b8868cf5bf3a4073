"""The reference configuration: `python -m suspend.config.reference > configs/reference.yaml`."""

from __future__ import annotations

import sys

from suspend.config.render import commented

UNITS = """
Units: lengths in any unit you like (that of particles.radius), times in that of flow.omega or flow.rate,
viscosity in that of fluid.viscosity; lengths marked [radii] in sphere radii a; strains as pure numbers;
forces in F_stk = 6 pi eta0 a^2 Gamma with Gamma = gamma0 omega (oscillatory) or flow.rate.
After each key: its meaning [unit]; its default; the values it allows.
"""
REFERENCE_HEAD = f"""
Every key of a suspend configuration, made by `python -m suspend.config.reference` (a test keeps it so).
Keys in comments are off by default, belong to another flow type, or exclude a key that is given.
{UNITS.strip()}
"""
START_HEAD = f"""
A configuration of suspend, written by `suspend init`: change what you need, then `suspend run` this file.
Keys with a default may be left out. Keys in comments are off, belong to another flow type, or exclude a
given key.
{UNITS.strip()}
"""


def reference() -> str:
    """Text of configs/reference.yaml: every key at its default."""
    return commented(REFERENCE_HEAD)


def starting_point() -> str:
    """Text that `suspend init` writes: every key, with the paper's repulsion on."""
    return commented(START_HEAD, on=("repulsion",))


if __name__ == "__main__":
    sys.stdout.write(reference())
