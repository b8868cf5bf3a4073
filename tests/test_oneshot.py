"""One-shot problems against independently computed scenes, dense twins and closed forms."""

import dataclasses
from pathlib import Path

import naive
import numpy as np
import pytest

from suspend.config import Ewald, Lubrication
from suspend.errors import ConfigurationError, NumericalError
from suspend.oneshot import (
    Method,
    PeriodicScene,
    grand_mobility,
    grand_resistance,
    mobility_problem,
    resistance_problem,
)
from suspend.oneshot.iterations import solve_definite

DATA = Path(__file__).parent / "data"
SCENES = ("pair_xi1e-02", "rand_N8_phi0.2", "rand_N8_phi0.4", "rand_N27_phi0.3", "sheared0.20_N27_phi0.3")
OFF = Lubrication(enabled=False)
HARD = Lubrication(at_cutoff="hard")
SHEAR = np.array([[0.0, 0.5, 0.0], [0.5, 0.0, 0.0], [0.0, 0.0, 0.0]])


def oracle(name):
    """A scene and its values."""
    data = np.load(DATA / f"{name}.npz")
    edge = float(data["L"])
    return PeriodicScene(data["pos"], edge, float(data["shift"]) / edge), data


def close(found, expected, tolerance):
    """Largest deviation relative to the largest value."""
    assert np.abs(found - expected).max() <= tolerance * np.abs(expected).max()


def dense_solution(scene, method_cutoff, at_cutoff, load, flow, drag=4 / 3, stresslet=10 / 9):
    """Self far field by numpy.linalg on the dense twin: U', stresslets (Brady's sign)."""
    near = naive.grand_near_field(scene.wrapped(), scene.edge, scene.reduced_tilt, method_cutoff, at_cutoff)
    matrix = near + np.diag(np.tile([1.0] * 3 + [drag] * 3 + [0.0] * 5, scene.number))
    right = load + naive.strain_loads(near, flow)
    velocity = np.linalg.solve(naive.part(matrix, naive.MOTION, naive.MOTION), right.reshape(-1)).reshape(
        -1, 6
    )
    return velocity, naive.stresslets(near, velocity, flow) + stresslet * flow


@pytest.mark.parametrize("name", SCENES)
@pytest.mark.parametrize(("prefix", "lubrication", "tolerance"), [("nolub", OFF, 1e-8), ("lubx", HARD, 1e-7)])
def test_mobility_problem_of_the_oracle_scenes(name, prefix, lubrication, tolerance):
    """Velocities, stresslets (minus the stored ones: on the fluid) and eta_r; the two-sphere functions behind
    the values with lubrication are good to 5e-8.
    """
    scene, data = oracle(name)
    method = Method(lubrication=lubrication, accuracy=1e-9)
    for case, arguments in (("mob", {"forces": data["F"]}), ("shear", {"strain_rate": 1.0})):
        found = mobility_problem(scene, **arguments, method=method)
        close(found.U, data[f"{prefix}_{case}_U"], tolerance)
        close(found.Omega, data[f"{prefix}_{case}_O"], tolerance)
        close(found.stresslet, -data[f"{prefix}_{case}_S"], tolerance)
        assert 0.0 < found.cost.residual <= 1e-10 and found.cost.accuracy == 1e-9
        assert found.cost.products > found.cost.iterations > 0
    assert found.eta_r == pytest.approx(float(data[f"eta_r_{prefix}"]), abs=tolerance)


@pytest.mark.parametrize(("prefix", "lubrication", "tolerance"), [("nolub", OFF, 1e-7), ("lubx", HARD, 1e-6)])
def test_resistance_problem_gives_the_loads_back(prefix, lubrication, tolerance):
    """The oracle's velocities need the oracle's forces and no torque (ten times looser: resistance amplifies)."""
    scene, data = oracle("rand_N8_phi0.4")
    method = Method(lubrication=lubrication, accuracy=1e-9)
    found = resistance_problem(scene, data[f"{prefix}_mob_U"], data[f"{prefix}_mob_O"], method=method)
    close(found.forces, data["F"], tolerance)
    assert np.abs(found.torques).max() <= tolerance
    close(found.stresslet, -data[f"{prefix}_mob_S"], tolerance)
    found = resistance_problem(scene, data[f"{prefix}_shear_U"], data[f"{prefix}_shear_O"], 1.0, method)
    assert np.abs(np.hstack([found.forces, found.torques])).max() <= tolerance
    assert found.eta_r == pytest.approx(float(data[f"eta_r_{prefix}"]), abs=tolerance)


@pytest.mark.parametrize(
    ("phi", "axial", "plane", "axial_lubricated", "plane_lubricated"),
    [(0.1, 0.35965, 0.24118, 0.36501, 0.24270), (0.3, 2.31054, 0.78925, 2.94217, 0.86575)],
)
def test_simple_cubic_viscosities(phi, axial, plane, axial_lubricated, plane_lubricated):
    """1 + alpha under axial strain, 1 + beta under shear in a coordinate plane, whatever the plane: known to
    half a unit of the fifth decimal, without and with lubrication (hard cutoff 4).
    """
    scene = PeriodicScene([[0.3, 0.2, 0.1]], (4.0 * np.pi / (3.0 * phi)) ** (1.0 / 3.0))
    for lubrication, alpha, beta in ((OFF, axial, plane), (HARD, axial_lubricated, plane_lubricated)):
        method = Method(lubrication=lubrication, accuracy=1e-7)
        strain = np.diag([-0.5, 1.0, -0.5])
        assert mobility_problem(scene, strain_rate=strain, method=method).eta_r == pytest.approx(
            1 + alpha, abs=6e-6
        )
        for a, b in ((0, 1), (0, 2), (1, 2)):
            strain = np.zeros((3, 3))
            strain[a, b] = strain[b, a] = 1.7
            found = mobility_problem(scene, strain_rate=strain, method=method)
            assert found.eta_r == pytest.approx(1 + beta, abs=6e-6)
            assert np.sign(found.stresslet[0, a, b]) == 1.0


def test_simple_cubic_drag():
    """1/K = 1 - 1.7601188844 phi^(1/3) + phi and, for rotation, 1 - phi: exact at this level for F, FT, FTS."""
    phi = 0.125
    scene = PeriodicScene([[0.0, 0.0, 0.0]], (4.0 * np.pi / (3.0 * phi)) ** (1.0 / 3.0))
    found = mobility_problem(
        scene, [[0.0, 2.0, 0.0]], [[1.0, 0.0, 0.0]], method=Method(lubrication=OFF, accuracy=1e-9)
    )
    assert found.U[0] == pytest.approx(
        [0.0, 2.0 * (1.0 - 1.7601188844 * phi ** (1 / 3) + phi), 0.0], abs=2e-9
    )
    assert found.Omega[0] == pytest.approx([0.75 * (1.0 - phi), 0.0, 0.0], abs=2e-9)
    assert found.eta_r is None


def test_lone_sphere_without_far_field():
    """Stokes' drags and Einstein's 2.5 phi; `identity` has 3/4 of the rotational drag and 9/5 of the stresslet."""
    scene = PeriodicScene([[1.0, 2.0, 3.0]], 10.0, 0.3)
    for far_field, spin, stresslet in (("self", 0.75, 10 / 9), ("identity", 1.0, 2.0)):
        for lubrication in (OFF, HARD):
            method = Method(far_field, lubrication)
            found = mobility_problem(scene, [[2.0, 0.0, 1.0]], [[0.0, 1.0, 0.0]], 3.0, method)
            assert found.U[0] == pytest.approx([2.0, 0.0, 1.0]) and found.Omega[0] == pytest.approx(
                [0.0, spin, 0.0]
            )
            assert found.stresslet[0] == pytest.approx(stresslet * 3.0 * SHEAR)
            assert found.eta_r - 1.0 == pytest.approx(scene.volume_fraction * 2.5 * stresslet * 0.9)
            loads = resistance_problem(scene, found.U, found.Omega, 3.0, method)
            assert loads.forces[0] == pytest.approx([2.0, 0.0, 1.0])
            assert loads.torques[0] == pytest.approx([0.0, 1.0, 0.0])


@pytest.mark.parametrize("at_cutoff", ["hard", "shifted"])
def test_self_path_is_the_dense_near_field(at_cutoff):
    """Velocities and stresslets of random loads in a general flow against numpy.linalg on the dense twin, to the
    accuracy asked for (the energy norm of it; 30 times covers the worst sphere).
    """
    random = np.random.default_rng(3)
    edge, tilt = 7.0, 0.37
    scene = PeriodicScene(naive.loose_positions(12, edge, tilt, 5), edge, tilt)
    load = random.standard_normal((12, 6))
    flow = random.standard_normal((3, 3))
    flow = flow + flow.T
    flow -= np.trace(flow) / 3.0 * np.eye(3)
    velocity, stresslet = dense_solution(scene, 3.5, at_cutoff, load, flow)
    method = Method("self", Lubrication(cutoff=3.5, at_cutoff=at_cutoff), accuracy=1e-8)
    found = mobility_problem(scene, load[:, :3], load[:, 3:], flow, method)
    close(np.hstack([found.U, found.Omega]), velocity, 3e-7)
    close(found.stresslet, stresslet, 3e-7)
    back = resistance_problem(scene, velocity[:, :3], velocity[:, 3:], flow, method)
    close(np.hstack([back.forces, back.torques]), load, 1e-9)
    close(back.stresslet, stresslet, 1e-9)


@pytest.mark.parametrize("far_field", ["ewald", "self"])
def test_images_and_tilts_of_the_same_scene(far_field):
    """Whole cell vectors added to positions and a tilt by a whole number change nothing."""
    scene, data = oracle("sheared0.20_N27_phi0.3")
    scene = PeriodicScene(scene.positions[:9], scene.edge, scene.tilt)
    random = np.random.default_rng(1)
    vectors = scene.edge * np.array([[1.0, 0.0, 0.0], [scene.tilt, 1.0, 0.0], [0.0, 0.0, 1.0]])
    moved = scene.positions + random.integers(-2, 3, scene.positions.shape) @ vectors
    method = Method(far_field, accuracy=1e-8)
    found = [
        mobility_problem(PeriodicScene(x, scene.edge, tilt), data["F"][:9], strain_rate=1.0, method=method)
        for x, tilt in ((scene.positions, scene.tilt), (moved, scene.tilt - 3.0))
    ]
    close(found[1].U, found[0].U, 1e-8)
    close(found[1].stresslet, found[0].stresslet, 1e-8)


def test_grand_mobility_is_the_oracles():
    """All 88 columns, and what a mobility matrix must be: symmetric to its error, positive definite."""
    scene, data = oracle("rand_N8_phi0.4")
    matrix = grand_mobility(scene, Method(accuracy=1e-8))
    close(matrix, data["M_grand"], 1e-8)
    close(matrix, matrix.T, 1e-8)
    assert np.linalg.eigvalsh(matrix)[0] > 0.0
    lone = np.diag(np.tile([1.0] * 3 + [0.75] * 3 + [0.9] * 5, 8))
    assert grand_mobility(scene, Method("self")) == pytest.approx(lone, rel=1e-15)


@pytest.mark.parametrize("far_field", ["ewald", "self"])
@pytest.mark.parametrize("at_cutoff", ["hard", "shifted", "tapered"])
def test_grand_resistance_agrees_with_both_problems(far_field, at_cutoff):
    """The iterative problems and the matrix are two ways to the same answer."""
    scene, data = oracle("rand_N8_phi0.4")
    method = Method(far_field, Lubrication(at_cutoff=at_cutoff), accuracy=1e-9)
    matrix = grand_resistance(scene, method)
    close(matrix, matrix.T, 1e-12)
    motion = naive.part(matrix, naive.MOTION, naive.MOTION)
    found = mobility_problem(scene, data["F"], strain_rate=1.0, method=method)
    loads = np.hstack([data["F"], np.zeros((8, 3))]) + naive.strain_loads(matrix, SHEAR)
    velocity = np.linalg.solve(motion, loads.reshape(-1)).reshape(8, 6)
    close(np.hstack([found.U, found.Omega]), velocity, 1e-7)
    close(found.stresslet, naive.stresslets(matrix, velocity, SHEAR), 1e-7)
    back = resistance_problem(scene, velocity[:, :3], velocity[:, 3:], 1.0, method)
    close(back.forces, data["F"], 1e-7)


@pytest.mark.parametrize("accuracy", [1e-2, 1e-4, 1e-6])
@pytest.mark.parametrize("lubrication", [OFF, Lubrication()])
def test_accuracy_asked_for_is_delivered(accuracy, lubrication):
    """Against the same problem at 1e-10, in the 2-norm of U, Omega and of the stresslets."""
    scene, data = oracle("sheared0.20_N27_phi0.3")
    fine, coarse = (
        mobility_problem(
            scene, data["F"], strain_rate=1.0, method=Method(lubrication=lubrication, accuracy=a)
        )
        for a in (1e-10, accuracy)
    )
    for name in ("U", "Omega", "stresslet"):
        expected = getattr(fine, name)
        assert np.linalg.norm(getattr(coarse, name) - expected) <= accuracy * np.linalg.norm(expected)


def test_overlap_is_allowed_without_lubrication_only():
    """Two overlapping spheres pulled along x: alike by symmetry, faster than one, slower than at the same place."""
    scene = PeriodicScene([[0.0, 0.0, 0.0], [1.2, 0.0, 0.0]], 9.0)
    method = Method(lubrication=OFF)
    pull = [[1.0, 0.0, 0.0]]
    alone = mobility_problem(PeriodicScene([[0.0, 0.0, 0.0]], 9.0), pull, method=method).U[0, 0]
    found = mobility_problem(scene, pull * 2, method=method).U
    assert found[0] == pytest.approx(found[1], abs=1e-6) and 1.2 * alone < found[0, 0] < 2.0 * alone
    with pytest.raises(ConfigurationError, match=r"spheres 0 and 1 .* gap -0\.8 radii"):
        mobility_problem(scene, pull * 2)
    frozen = Lubrication(minimum_gap=1e-3)
    assert np.isfinite(mobility_problem(scene, pull * 2, method=Method("self", frozen)).U).all()


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"positions": np.zeros((0, 3))}, r"no spheres \(N = 0\)"),
        ({"positions": []}, r"no spheres \(N = 0\)"),
        ({"positions": np.zeros(3)}, r"positions: has shape \(3,\), must be \(N, 3\)"),
        ({"positions": np.zeros((2, 2))}, "positions: has shape"),
        ({"positions": [[0.0, 0.0, np.nan]]}, "positions: 1 entries are not finite, the first of sphere 0"),
        ({"positions": [["a", "b", "c"]]}, "must be real numbers"),
        ({"positions": [[0.0, 0.0, 1j]]}, "must be real numbers"),
        ({"positions": [[0.0, 0.0], [1.0]]}, "positions: is no array of numbers"),
        ({"edge": 0.0}, "must be > 0"),
        ({"edge": np.inf}, "not finite"),
        ({"tilt": np.nan}, "tilt: 1 entries are not finite"),
        ({"edge": [1.0, 2.0]}, "must be one number"),
    ],
)
def test_what_is_no_scene(change, message):
    with pytest.raises(ConfigurationError, match=message):
        PeriodicScene(**({"positions": [[0.0, 0.0, 0.0]], "edge": 6.0} | change))


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"forces": np.zeros((2, 3))}, r"forces: has shape \(2, 3\), must be \(1, 3\)"),
        ({"torques": [[0.0, 0.0, np.inf]]}, "torques: 1 entries are not finite"),
        ({"strain_rate": np.eye(3)}, "trace 3, must be 0"),
        ({"strain_rate": [[0, 1, 0], [0, 0, 0], [0, 0, 0]]}, "not symmetric"),
        ({"strain_rate": [1.0, 2.0]}, "must be a shear rate or"),
        ({"strain_rate": "fast"}, "must be real numbers"),
    ],
)
def test_what_is_no_problem(arguments, message):
    with pytest.raises(ConfigurationError, match=message):
        mobility_problem(PeriodicScene([[0.0, 0.0, 0.0]], 6.0), **arguments, method=Method("self"))


def test_what_no_method_can_do():
    """Cells below a diameter, coincident spheres, a sphere that touches its image, accuracies out of range."""
    small = PeriodicScene([[0.0, 0.0, 0.0]], 1.9)
    with pytest.raises(ConfigurationError, match="too small a cell"):
        mobility_problem(small, method=Method(lubrication=OFF))
    with pytest.raises(ConfigurationError, match=r"sphere 0 .* and its own periodic image touch or overlap"):
        mobility_problem(small, method=Method("self"))
    with pytest.raises(ConfigurationError, match=r"spheres 0 and 1 .* at the same place"):
        mobility_problem(PeriodicScene(np.ones((2, 3)), 6.0), method=Method(lubrication=OFF))
    for accuracy in (1e-11, 0.1, np.nan):
        with pytest.raises(ConfigurationError, match="accuracy: found"):
            Method(accuracy=accuracy)
    with pytest.raises(ConfigurationError, match="far_field: found 'fts'"):
        Method("fts")
    with pytest.raises(ConfigurationError, match="ewald: far_field is self"):
        Method("self", ewald=Ewald(support=6))
    crowd = PeriodicScene(np.random.default_rng(0).random((301, 3)) * 90.0, 90.0)
    with pytest.raises(ConfigurationError, match="301 spheres: dense matrices are made for up to 300"):
        grand_mobility(crowd)


def test_too_few_iterations_are_an_error():
    """No answer that misses the accuracy is returned, whichever solve it is."""
    scene, data = oracle("rand_N8_phi0.4")
    for method in (Method("self"), Method(), Method(lubrication=OFF)):
        few = dataclasses.replace(method, max_iterations=2)
        with pytest.raises(NumericalError, match="did not converge"):
            mobility_problem(scene, data["F"], method=few)
    with pytest.raises(NumericalError, match="did not converge"):
        resistance_problem(scene, data["F"], method=dataclasses.replace(Method(), max_iterations=2))


def test_conjugate_gradients_on_a_matrix():
    """A well-conditioned random system to 1e-12; a residual below round-off is refused, zero costs nothing."""
    random = np.random.default_rng(0)
    basis, _ = np.linalg.qr(random.standard_normal((22, 22)))
    matrix = basis @ np.diag(np.geomspace(1.0, 50.0, 22)) @ basis.T
    right = random.standard_normal((2, 11))

    def product(x):
        return (matrix @ x.reshape(-1)).reshape(2, 11)

    found = solve_definite(product, right, np.ones(11), 1e-12, 100)
    close(found.solution.reshape(-1), np.linalg.solve(matrix, right.reshape(-1)), 1e-10)
    assert found.residual <= 1e-12 and found.products == found.iterations + 1
    with pytest.raises(NumericalError, match="did not converge"):
        solve_definite(product, right, np.ones(11), 1e-18, 1000)
    assert solve_definite(product, 0.0 * right, np.ones(11), 1e-12, 100).products == 0


@pytest.mark.parametrize("size", [1e-300, 1e-200, 1e200, 1e300])
@pytest.mark.parametrize("method", [Method(), Method(lubrication=OFF), Method(far_field="self")])
def test_answers_scale_with_what_is_given(size, method):
    """The problems are linear: loads, velocities and flows of any size give answers of that size, to rounding."""
    scene = PeriodicScene(np.array([[1.0, 1.0, 1.0], [3.5, 1.2, 1.0], [1.0, 4.0, 2.0]]), 9.0)
    given = np.random.default_rng(2).standard_normal((3, 3))
    for problem in (mobility_problem, resistance_problem):
        one = problem(scene, given, strain_rate=0.5, method=method)
        other = problem(scene, given * size, strain_rate=0.5 * size, method=method)
        first, second = (dataclasses.astuple(answer)[0] for answer in (one, other))
        close(second / size, first, 1e-9)
        assert other.eta_r == pytest.approx(one.eta_r, rel=1e-9)


def test_answers_beyond_double_precision_are_refused():
    """No infinity in silence."""
    scene = PeriodicScene(np.array([[1.0, 1.0, 1.0], [3.01, 1.0, 1.0]]), 9.0)
    with pytest.raises(ConfigurationError, match="scale what is given down"):
        resistance_problem(scene, np.array([[1.0, 0, 0], [-1.0, 0, 0]]) * 1e308)


@pytest.mark.parametrize(
    ("positions", "edge", "tilt", "words"),
    [
        (np.zeros((1, 3)), 1e300, 0.0, "edge"),
        (np.zeros((1, 3)), 10.0, 1e18, "tilt"),
        (np.array([[0.0, 0.0, 0.0], [0.0, 3e13, 0.0]]), 30.0, 0.0, "sphere 1"),
    ],
)
def test_lengths_beyond_double_precision_are_refused(positions, edge, tilt, words):
    """Where rounding has lost the gaps the answer would be wrong in silence: an error names what is too large."""
    with pytest.raises(ConfigurationError, match=words):
        PeriodicScene(positions, edge, tilt)
