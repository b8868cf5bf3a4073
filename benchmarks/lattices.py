"""Simple cubic arrays at the force-torque-stresslet level beside exact values: the known error of the method.

    python benchmarks/lattices.py [--accuracy 1e-8]

Drag K = F/(6 pi eta a U) of an array that moves relative to the volume mean (exact: Zick & Homsy, J. Fluid Mech. 115,
13, 1982), and the viscosity of a force- and torque-free array under instantaneous strain, axial and in a coordinate
plane (exact: computed independently to 0.1 %). The closed form of the FTS level for the drag without lubrication is
1/K = 1 - 1.7601188844 phi^(1/3) + phi (Hasimoto, J. Fluid Mech. 5, 317, 1959). At small phi the exact flow follows
Sangani & Acrivos (Int. J. Multiphase Flow 8, 343, 1982).
"""

from __future__ import annotations

import argparse

import numpy as np

from suspend.box import edge_length
from suspend.config import Lubrication
from suspend.oneshot import Method, PeriodicScene, mobility_problem

ZICK_HOMSY = {0.001: 1.21214, 0.027: 2.008, 0.064: 2.810, 0.125: 4.292, 0.216: 7.442, 0.343: 15.4, 0.45: 28.1}
VISCOSITY = {0.1: (1.3601, 1.2414), 0.2: (2.0666, 1.4971), 0.3: (3.546, 1.8178), 0.4: (7.46, 2.3124)}
AXIAL = np.diag([1.0, -1.0, 0.0])
SHEAR = np.array([[0, 1.0, 0], [1.0, 0, 0], [0, 0, 0]])


def array(phi: float) -> PeriodicScene:
    """One sphere a cell."""
    return PeriodicScene(positions=[[0.0, 0.0, 0.0]], edge=edge_length(1, phi))


def method(accuracy: float, lubricated: bool) -> Method:
    """Hard cutoff at 4 a, or no lubrication."""
    return Method(accuracy=accuracy, lubrication=Lubrication(enabled=lubricated, at_cutoff="hard"))


def drag(phi: float, how: Method) -> float:
    """K of the array."""
    return 1.0 / mobility_problem(array(phi), forces=[[1.0, 0.0, 0.0]], method=how).U[0, 0]


def sangani_acrivos(phi: float) -> float:
    """Exact 1/K for small phi."""
    c = phi ** (1 / 3)
    return 1 - 1.7601 * c + c**3 - 1.5593 * c**6 + 3.9799 * c**8 - 3.0734 * c**10


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--accuracy", type=float, default=1e-8)
    accuracy = parser.parse_args().accuracy
    bare, lubricated = method(accuracy, False), method(accuracy, True)
    print("drag      K exact   FTS, bare  closed form  deviation  FTS + lubrication (r < 4 a)")
    for phi, exact in ZICK_HOMSY.items():
        closed = 1 / (1 - 1.7601188844 * phi ** (1 / 3) + phi)
        found, lub = drag(phi, bare), drag(phi, lubricated)
        print(f"{phi:<9g} {exact:<9g} {found:<10.6f} {closed:<12.6f} {found / closed - 1:<10.1e} {lub:.5f}")
    print("\nsmall phi 1/K Sangani & Acrivos  1/K FTS   difference")
    for phi in (1e-4, 1e-3, 0.005, 0.01):
        exact, found = sangani_acrivos(phi), 1 / drag(phi, bare)
        print(f"{phi:<9g} {exact:<22.6f} {found:<9.6f} {found - exact:.1e}")
    print("\nviscosity axial: exact, FTS, FTS + lub.       in a plane: exact, FTS, FTS + lub.")
    for phi, (axial, plane) in VISCOSITY.items():
        row = []
        for exact, rate in ((axial, AXIAL), (plane, SHEAR)):
            found = [mobility_problem(array(phi), strain_rate=rate, method=m).eta_r for m in (bare, lubricated)]
            row.append(f"{exact:<8g} {found[0]:<9.5f} {found[1]:<10.5f}")
        print(f"{phi:<9g} {row[0]}             {row[1]}")


if __name__ == "__main__":
    main()
