"""Dense grand matrices of small scenes: far-field mobility, and resistance with near field."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from suspend.config.schema import Lubrication
from suspend.errors import ConfigurationError
from suspend.hydro.neighbours import find_pairs
from suspend.hydro.two_sphere_matrices import pair_resistance_matrix
from suspend.oneshot.hydrodynamics import Hydrodynamics
from suspend.oneshot.scene import Method, PeriodicScene

LARGEST = 300  # spheres: 3,300 unknowns, 87 MB a matrix, as many mobility products
_BY_SPHERE = np.r_[0:6, 12:17, 6:12, 17:22]  # of a pair, from [1, 2, S1, S2] to sphere by sphere


def grand_mobility(scene: PeriodicScene, method: Method = Method()) -> np.ndarray:  # noqa: B008 (frozen)
    """Far-field mobility M (11N, 11N), [U; Omega; -E] = M [F; T; S] sphere by sphere, loads on the fluid.

    Symmetric positive definite; stresslets and strain rates in the orthonormal basis `FIVE`. By one product a
    column; lubrication plays no part in it and overlapping spheres are allowed. Raises ConfigurationError above
    300 spheres.
    """
    _check_size(scene)
    hydro = Hydrodynamics(scene, replace(method, lubrication=Lubrication(enabled=False)))
    if hydro.mobility is None:
        rotation, stresslet = 1.0 / hydro.drags[1], 1.0 / hydro.self_stresslet
        return np.diag(np.tile([1.0] * 3 + [rotation] * 3 + [stresslet] * 5, scene.number))
    return hydro.mobility.matrix()


def grand_resistance(scene: PeriodicScene, method: Method = Method()) -> np.ndarray:  # noqa: B008 (frozen)
    """Resistance (11N, 11N), [F; T; S] = R [U'; Omega'; -E] sphere by sphere, loads on the fluid.

    R = M^-1 + the sum over pairs within the cutoff of the near-field blocks of method.lubrication. Raises
    ConfigurationError above 300 spheres and where spheres touch with lubrication on.
    """
    _check_size(scene)
    method.check(scene)
    mobility = grand_mobility(scene, method)
    resistance = np.linalg.inv(0.5 * (mobility + mobility.T))  # symmetric but for the error of the Ewald sum
    return resistance + _near_field(scene, method.lubrication)


def _near_field(scene: PeriodicScene, law: Lubrication) -> np.ndarray:
    """Sum of the pairs' near-field blocks, (11N, 11N)."""
    size = 11 * scene.number
    matrix = np.zeros((size, size))
    if not law.enabled:
        return matrix
    position, tilt = scene.wrapped(), scene.reduced_tilt
    vectors = scene.edge * np.array([[1.0, 0.0, 0.0], [tilt, 1.0, 0.0], [0.0, 0.0, 1.0]])
    pairs, _ = find_pairs(position, scene.edge, tilt, law.cutoff)
    for i, j, *image in pairs:
        d = position[j] + np.array(image) @ vectors - position[i]
        block = pair_resistance_matrix(_pair_functions(np.linalg.norm(d) - 2.0, law), d)
        rows = np.r_[11 * i : 11 * i + 11, 11 * j : 11 * j + 11]
        np.add.at(matrix, np.ix_(rows, rows), block[np.ix_(_BY_SPHERE, _BY_SPHERE)])
    return matrix


def _pair_functions(gap: float, law: Lubrication) -> np.ndarray:
    """Near-field functions (24,) at a gap (radii) with what `law` says of the cutoff and of small gaps."""
    from suspend.core.pairs import taper
    from suspend.hydro.table import load_table, values

    table = load_table()
    functions = values(table, max(gap, law.minimum_gap))
    if law.at_cutoff == "hard":
        return functions
    functions = functions - values(table, law.cutoff - 2.0)
    if law.at_cutoff == "tapered":
        functions = functions * taper(gap + 2.0, 2.0 + 0.9 * (law.cutoff - 2.0), law.cutoff)
    return functions


def _check_size(scene: PeriodicScene) -> None:
    if scene.number > LARGEST:
        raise ConfigurationError(
            f"{scene.number} spheres: dense matrices are made for up to {LARGEST}; use mobility_problem or"
            " resistance_problem, which need no matrix"
        )
