"""Two spheres in ever larger cells against exact two-sphere hydrodynamics: what each approximation costs.

    python benchmarks/two_spheres.py [--csv benchmarks/results/two_spheres.csv]

Two spheres, skew to the axes, carry opposite forces and unlike torques in a shear flow. Velocities in cells of edge
L are extrapolated to L = inf. Spheres whose net force is zero feel their images as 1/L^3 and 1/L^5; a small term 1/L
is there too, because the near field (exact minus two-sphere FTS resistance) is not blind to rigid motion of the pair,
so that the far field's forces have a small net. Reported is the largest deviation of U and Omega from the
exact two-sphere solution (resistance functions by twin multipole expansions), relative to the largest velocity.
"""

from __future__ import annotations

import argparse
import csv
from pathlib import Path

import numpy as np

from suspend.config import Lubrication
from suspend.hydro.table import load_table, values
from suspend.hydro.two_sphere_matrices import FIVE, far_field_functions, pair_resistance_matrix
from suspend.oneshot import Method, PeriodicScene, mobility_problem

DIRECTION = np.array([0.36, 0.48, 0.8])
STRAIN_RATE = np.array([[0, 0.5, 0], [0.5, 0, 0], [0, 0, 0]])
FORCES = np.array([[0.3, -0.5, 0.8], [-0.3, 0.5, -0.8]])
TORQUES = np.array([[0.1, 0.4, -0.2], [-0.3, 0.2, 0.5]])
EDGES = (40.0, 60.0, 90.0, 135.0)


def exact_velocities(r: float) -> np.ndarray:
    """U and Omega (2, 6) of the pair in unbounded fluid, relative to the undisturbed flow."""
    gap = r - 2.0
    functions = values(load_table(), gap)[:22] + far_field_functions(gap)
    resistance = pair_resistance_matrix(functions, DIRECTION)
    motion, strain = slice(0, 12), slice(12, 22)
    e = np.tile(np.einsum("aij,ij->a", FIVE, STRAIN_RATE), 2)
    load = np.concatenate([FORCES[0], TORQUES[0], FORCES[1], TORQUES[1]])
    return np.linalg.solve(resistance[motion, motion], load + resistance[motion, strain] @ e).reshape(2, 6)


def found_velocities(r: float, edge: float, method: Method) -> np.ndarray:
    """The same in a periodic cell."""
    centre = np.full(3, 0.5 * edge)
    positions = np.array([centre - 0.5 * r * DIRECTION, centre + 0.5 * r * DIRECTION])
    scene = PeriodicScene(positions=positions, edge=edge)
    motions = mobility_problem(scene, forces=FORCES, torques=TORQUES, strain_rate=STRAIN_RATE, method=method)
    return np.hstack([motions.U, motions.Omega])


def extrapolated(r: float, method: Method) -> np.ndarray:
    """Velocities at L = inf from four edges, errors 1/L, 1/L^3 and 1/L^5 removed."""
    matrix = np.array([[1.0, 1.0 / edge, edge**-3, edge**-5] for edge in EDGES])
    found = np.array([found_velocities(r, edge, method).reshape(-1) for edge in EDGES])
    return np.linalg.solve(matrix, found)[0].reshape(2, 6)


def deviation(r: float, at_cutoff: str | None, accuracy: float = 1e-9) -> float:
    """Largest deviation from the exact velocities; `at_cutoff` None: without lubrication."""
    lubrication = Lubrication(enabled=False) if at_cutoff is None else Lubrication(at_cutoff=at_cutoff)
    exact = exact_velocities(r)
    found = extrapolated(r, Method(accuracy=accuracy, lubrication=lubrication))
    return float(np.abs(found - exact).max() / np.abs(exact).max())


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--csv", type=Path)
    arguments = parser.parse_args()
    rows = []
    print("gap/a      r/a     hard cutoff   shifted   without lubrication")
    for gap in (1e-6, 1e-4, 1e-2, 0.1, 0.5, 1.0, 1.9, 2.1, 3.0, 5.0):
        row = [gap, *(deviation(2.0 + gap, law) for law in ("hard", "shifted", None))]
        rows.append(row)
        print(f"{gap:<9g} {2 + gap:<9g} {row[1]:<12.2e} {row[2]:<12.2e} {row[3]:<12.2e}", flush=True)
    if arguments.csv:
        with arguments.csv.open("w", newline="") as file:
            writer = csv.writer(file)
            writer.writerow(["gap[a]", "hard[-]", "shifted[-]", "no_lubrication[-]"])
            writer.writerows([[f"{x:.6g}" for x in row] for row in rows])


if __name__ == "__main__":
    main()
