"""Hard spheres in the literature: short-time properties, finite-size correction.

The three fits are of equilibrium fluids of equal, neutrally interacting hard spheres with stick boundaries, used
here for comparison only and meant for 0 <= phi <= 0.5. They were published by Riest et al., Soft Matter (2015), for
simulations of Abade et al., J. Chem. Phys. (2012), and are read, coefficient by coefficient, from the code that
Park & Naegele published with their paper (J. Chem. Phys. 2020, doi:10.1063/5.0020986), for spheres that the solvent
does not enter. Rotational diffusion has no line: no published source of a fit for it was at hand.
"""

from __future__ import annotations

import math
from typing import NamedTuple

LARGEST_FRACTION = 0.5  # the fits end near freezing
CUBIC_LATTICE = 2.837297 / (4.0 * math.pi / 3.0) ** (1.0 / 3.0)  # 1.7601: 2.837297 a/L in phi^(1/3)
# Relative excess of U at the force-torque-stresslet level with lubrication, phi = 0.2, 0.3, 0.4 (N = 27 and 64).
KNOWN_EXCESS = "about +10, +25 and +80 % at phi = 0.2, 0.3 and 0.4"


class Fit(NamedTuple):
    """A property of the literature, its formula and where the formula is from."""

    value: float
    source: str


def viscosity(phi: float) -> float:
    """High-frequency viscosity eta_inf/eta0: Saito's form, S = phi (1 + 0.95 phi - 2.15 phi^2)."""
    crowded = phi * (1.0 + phi * (1.0 + phi * (0.95 - 2.15 * phi)))
    return 1.0 + 2.5 * crowded / (1.0 - crowded)


def translation(phi: float) -> float:
    """Short-time self-diffusion D_s/D0 = 1 - 1.8315 phi (1 + 0.12 phi - 0.70 phi^2)."""
    return 1.0 - 1.8315 * phi * (1.0 + phi * (0.12 - 0.70 * phi))


def sedimentation(phi: float) -> float:
    """Sedimentation U/U0 = 1 - 6.5464 phi (1 - 3.348 phi + 7.426 phi^2 - 10.034 phi^3 + 5.882 phi^4)."""
    return 1.0 - 6.5464 * phi * (1.0 - phi * (3.348 - phi * (7.426 - phi * (10.034 - 5.882 * phi))))


_PUBLISHED = "Riest et al., Soft Matter (2015), code of Park & Naegele, doi:10.1063/5.0020986"
FITS = {
    "eta_inf": (viscosity, _PUBLISHED),
    "D_s": (translation, _PUBLISHED),
    "U": (sedimentation, _PUBLISHED),
}


def fit(name: str, phi: float) -> Fit | None:
    """The literature's value of a property over the dilute one; None without a published fit, or beyond its range."""
    if name not in FITS or not 0.0 <= phi <= LARGEST_FRACTION + 1e-9:  # rounding of N/V
        return None
    function, source = FITS[name]
    return Fit(function(phi), source)


def finite_size_shift(phi: float, number: int, viscosity: float) -> float:
    """What a periodic cell of `number` spheres takes off D_s/D0: 1.7601 (phi/N)^(1/3) eta0/eta_inf.

    The images of a sphere drag it through the suspension as a medium of viscosity eta_inf: 2.837297 a/L of a cubic
    lattice (Hasimoto 1959) over eta_inf/eta0 (Ladd, J. Chem. Phys. 93, 3484, 1990). U/U0 lacks S(0) times this;
    what D_r and eta_inf lack is smaller by (a/L)^2. The next term for D_s is of order phi/N.

    The near field of pairs resists a common translation a little (exact minus force-torque-stresslet resistance of a
    pair that moves as one: 0.005, 0.026 and 0.035 of 6 pi eta0 a a sphere at phi = 0.1, 0.4, 0.5), so that with
    lubrication longer waves are damped more than by eta_inf and cells of thousands of spheres lack less than this
    (phi = 0.4: D_s/D0 corrected is 0.318 for N = 125 to 500, 0.314 for N = 4000).
    """
    return CUBIC_LATTICE * (phi / number) ** (1.0 / 3.0) / viscosity
