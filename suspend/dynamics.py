"""Velocities of all spheres as a function of positions and flow: one evaluation from top to bottom.

neighbour list -> near-field scalars -> loads (flow, pair forces, external) -> preconditioner -> velocity
solve (near field alone, or coupled with the far field). Only what the scene needs is built: without
lubrication, or before two spheres come within its reach, no table is loaded; without far field no solve is made where
no pair is in reach; without any pair interaction there is no neighbour list. Internal units of `suspend.conventions`.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from suspend.conventions import COMPONENT_INDEX
from suspend.core.pairs import HeldPairs
from suspend.errors import NumericalError
from suspend.forces import PairForce, interaction_range, pair_forces, stress_per_sphere
from suspend.hydro.lubrication import Lubrication, NearFieldOnDemand
from suspend.hydro.neighbours import VerletList, contacts_within

HISTORY = 3  # earlier velocities from which the near-field solve's start is extrapolated
FAR_HISTORY = 2  # the same for the coupled solve (benchmarks/bench_coupled.py)
# Smallest gap (radii) from which a factorisation serves several coupled solves: one of a pair that has since turned by
# an angle t lets t^2/(4 gap) of its stiffness into soft directions.
STIFF_GAP = 1e-3
TURNED_GAP = 1e-4  # the same for near-field solves, whose factorisation costs a larger share
PRESSED_GAP = 1e-6  # radii: below, round-off and stiffness of the gaps are what a solve or a step fails by
PRESSED = (
    "smooth spheres are pressed together, and what helps is a force or a roughness that keeps them apart, not the "
    "accuracy asked for: set lubrication.minimum_gap (1e-4, say) or contact (with its gap_shift), or add or strengthen "
    "repulsion"
)
GAP_REACH = 3.0  # radii: centre distance up to which gaps are looked for in a sample, whatever acts
FLOWN = 1e6  # cell edges: a trial position beyond it is no position of a suspension
VELOCITY_FLOOR = 1e-2  # a Gamma: velocities below it need not be relatively accurate in a flow of rate Gamma


class Overlap(Exception):
    """Trial positions in which spheres overlap and the lubrication functions are not defined."""

    def __init__(self, gap: float):
        super().__init__(f"spheres overlap by {-gap:.3g} a")
        self.gap = gap


class Flown(Overlap):
    """Trial positions far outside the cell: a force grew beyond all bounds in an overlap of the step before."""

    def __init__(self):
        Exception.__init__(self, f"spheres are thrown further than {FLOWN:g} cell edges")
        self.gap = -np.inf


@dataclass(frozen=True)
class Scene:
    """What acts on the spheres; `lubrication` None = off, `ewald` None = own drag and stresslet only."""

    edge: float
    lubrication: Lubrication | None
    drags: tuple[float, float]
    self_stresslet: float
    force: PairForce
    external: np.ndarray  # (6,) force and torque on every sphere
    sheared: bool
    ewald: object | None = None  # parameters of the far field's Ewald sum


@dataclass(frozen=True)
class SolverSettings:
    """Accuracy and limits of the velocity solve, and its tuning (measured in benchmarks/)."""

    tolerance: float = 1e-5
    far_tolerance: float = 1e-3  # of the coupled solve
    max_iterations: int = 2000
    close_gap: float = 0.2  # pairs below it enter the incomplete factorisation
    growth: float = 1.3  # refactorise when the iterations have grown by this factor
    factor_life: int = 4  # evaluations with far field after which it is made anew
    skin: float = 0.6


@dataclass
class Counters:
    """Work done, since the start of the cycle."""

    evaluations: int = 0
    iterations: int = 0
    products: int = 0  # with the far field's mobility
    steps: int = 0
    rejected_error: int = 0
    rejected_overlap: int = 0
    list_builds: int = 0
    factorisations: int = 0
    overlaps: int = 0  # overlapping pairs, summed over the samples
    minimum_gap: float = np.inf  # inf: no two spheres came within the reach of what acts, nor of GAP_REACH


@dataclass
class History:
    """Earlier velocities and the polynomial through them, the start of the next solve."""

    times: list = field(default_factory=list)
    values: list = field(default_factory=list)
    length: int = HISTORY

    def push(self, time: float, value: np.ndarray) -> None:
        """Remember `value` at `time`; a value at the same time is replaced."""
        if time in self.times:
            k = self.times.index(time)
            self.times.pop(k)
            self.values.pop(k)
        self.times.append(time)
        self.values.append(value)
        if len(self.times) > self.length:
            self.times.pop(0)
            self.values.pop(0)

    def extrapolate(self, time: float, shape) -> np.ndarray:
        """Lagrange polynomial through the stored values at `time`; zeros without any."""
        start = np.zeros(shape)
        for a, value in zip(self.times, self.values, strict=True):
            weight = 1.0
            for b in self.times:
                if b != a:
                    weight *= (time - b) / (a - b)
            start += weight * value
        return start

    def copy(self) -> History:
        """A copy that later pushes do not change."""
        return History(self.times.copy(), self.values.copy(), self.length)


class Suspension:
    """The velocity field of a scene. One object a run; not thread-safe."""

    def __init__(self, scene: Scene, settings: SolverSettings, number: int, threads: int):
        self.scene, self.settings, self.number, self.threads = scene, settings, number, threads
        self.floor = VELOCITY_FLOOR if scene.sheared else 0.0  # a fluid at rest has no velocity to compare with
        self.strain_rate = np.zeros((3, 3))
        if scene.sheared:
            self.strain_rate[0, 1] = self.strain_rate[1, 0] = 0.5
        self.force_range = interaction_range(scene.force)
        self.list = self._make_list()
        self._near_field = NearFieldOnDemand(scene.lubrication, scene.drags, threads)
        self.near = None  # while the list holds no pair that feels it
        self.forced = False  # whether it holds one that may feel the pair force
        self.smallest_gap = np.inf  # of the pairs that the near field acts on, at the last evaluation
        self.far = None
        if scene.ewald is not None:
            from suspend.farfield import FarField

            self.far = FarField(
                scene.edge, number, scene.ewald, None, settings.far_tolerance, settings.max_iterations, threads
            )
        self.counters = Counters()
        length = HISTORY if self.far is None else FAR_HISTORY
        self.history, self.flow_history = History(length=length), History(length=length)
        self.baseline = 0  # iterations of the solve after the last factorisation
        self.held: HeldPairs | None = None  # of the last evaluation
        self.factor_point = None  # positions, tilt and held gaps of the last factorisation
        self.factor_age = 0  # evaluations with far field since then
        self.far_stresslet = None  # (N, 5) of the last evaluation with far field, on the fluid

    def _make_list(self) -> VerletList | None:
        """The list of pairs as far as anything reaches; None where nothing acts, or the one sphere meets no image."""
        scene, skin = self.scene, self.settings.skin
        near_range = scene.lubrication.cutoff if scene.lubrication is not None else 0.0
        far_range = scene.ewald.cutoff if scene.ewald is not None else 0.0
        cutoff = max(self.force_range, near_range, far_range)
        alone = self.number == 1 and scene.ewald is None and scene.edge > cutoff + skin
        return VerletList(scene.edge, cutoff, skin) if cutoff > 0.0 and not alone else None

    def renew(self, position: np.ndarray, strain: float, tilt: float) -> None:
        """Build the neighbour list from these positions; the preconditioner goes with it."""
        if not np.abs(position).max() < FLOWN * self.scene.edge:  # not a number counts as well
            raise Flown
        self.list.build(position, strain, tilt)
        self.counters.list_builds += 1
        self.factor_point = None
        self.near = self._near_field.of(self.list, position, tilt)
        # beside lubrication alone a look at all pairs costs more than it saves
        reach = self.list.cutoff if self.far is None else self.force_range
        self.forced = self.force_range > 0.0 and self.list.holds(position, tilt, reach)
        if self.far is not None:
            self.far.solver.near = self.near
        if self.near is None:
            from suspend.hydro.rows import split_rows

            self.chunks = split_rows(self.list.offset, self.threads)

    def evaluate(
        self, position: np.ndarray, strain: float, tilt: float, rate: float, time: float, held: HeldPairs | None = None
    ) -> np.ndarray:
        """Velocities (N, 6) relative to the undisturbed flow; raises `Overlap` or NumericalError.

        `time` is the time since the start of the run, used to extrapolate the start of the solve; `held` : gaps of
        touching pairs (`suspend.gaps`).
        """
        self.counters.evaluations += 1
        if self.list is not None and not self.list.valid(position, strain):
            self.renew(position, strain, tilt)
        load = np.tile(self.scene.external, (self.number, 1))
        self.smallest_gap = np.inf
        if self.near is not None:
            self.held = held
            gap = self.near.assemble(position, self.scene.edge, tilt, held)
            if gap <= 0.0 and self.scene.lubrication.frozen <= 0.0:
                raise Overlap(gap)
            self.counters.minimum_gap = min(self.counters.minimum_gap, gap)
            self.smallest_gap = gap
        self.pair_stress = np.zeros(6)
        if self.forced:
            self._add_pair_forces(position, tilt, load)
        if self.lubricated and rate != 0.0:
            load += self.near.strain_loads(rate * self.strain_rate)
        if self.far is not None:
            return self._solve_coupled(load, rate, position, tilt, time)
        if self.scene.lubrication is None:
            return load / np.repeat(self.scene.drags, 3)
        velocity = self._solve(load, position, tilt, time) if self.lubricated else load / np.repeat(self.scene.drags, 3)
        self.history.push(time, velocity)
        return velocity

    @property
    def lubricated(self) -> bool:
        """Whether lubrication acted on a pair at the last evaluation."""
        return self.smallest_gap < np.inf

    def _add_pair_forces(self, position: np.ndarray, tilt: float, load: np.ndarray) -> None:
        chunks = self.near.chunks if self.near is not None else self.chunks
        self.pair_stress, gap = pair_forces(
            chunks, self.list.at(position, tilt), self.scene.force, self.force_range, load
        )
        self.counters.minimum_gap = min(self.counters.minimum_gap, gap)
        if not np.isfinite(self.pair_stress).all():
            raise Overlap(gap)

    def _solve(self, load: np.ndarray, position: np.ndarray, tilt: float, time: float) -> np.ndarray:
        fresh = self.factor_point is None or self.smallest_gap < TURNED_GAP
        if fresh:
            self.factor(position, tilt)
        start = self.history.extrapolate(time, load.shape)
        solution = self._conjugate_gradient(load, start)
        if fresh:
            self.baseline = solution.iterations
        elif solution.iterations > self.settings.growth * self.baseline + 2:
            self.factor_point = None  # renewed at the next evaluation
        return solution.velocity

    def _solve_coupled(self, load, rate: float, position, tilt: float, time: float) -> np.ndarray:
        if self.near is not None:
            old = self.factor_age >= self.settings.factor_life or self.smallest_gap < STIFF_GAP
            if self.factor_point is None or old:
                self.factor(position, tilt)
                self.factor_age = 0
            self.factor_age += 1
        self.far.place(position, tilt, self.list.pairs, self.list.offset)
        solution = self._coupled(load, rate * self.strain_rate, self.history, time)
        self.far_stresslet = solution.stresslet
        return solution.velocity

    def _coupled(self, load, strain_rate, history: History, time: float):
        start = history.extrapolate(time, history.values[0].shape) if history.times else None
        try:
            solution = self.far.solve(load, strain_rate, self.floor, start)
        except NumericalError as error:
            raise NumericalError(f"{error}; {self._gap_so_far()}") from None
        history.push(time, solution.guess)
        self.counters.iterations += solution.iterations
        self.counters.products += solution.products
        return solution

    @property
    def solve_accuracy(self) -> tuple[str, float]:
        """Key and value of the relative error that velocities are solved to; ("", 0) without a solve."""
        if self.far is not None:
            return "solver.far_tolerance", self.settings.far_tolerance
        return ("solver.tolerance", self.settings.tolerance) if self.near is not None else ("", 0.0)

    def _gap_so_far(self) -> str:
        gap = self.counters.minimum_gap
        return f"smallest gap so far {gap:.3g} a" + (f": {PRESSED}" if gap < PRESSED_GAP else "")

    def factor(self, position: np.ndarray, tilt: float) -> None:
        """Factorise the preconditioner from the scalars just assembled at `position`."""
        self.near.precondition(self.settings.close_gap)
        self.counters.factorisations += 1
        self.factor_point = (position.copy(), tilt, self.held)

    def _conjugate_gradient(self, load: np.ndarray, start: np.ndarray):
        floor2 = self.number * self.floor**2
        try:
            settings = self.settings
            solution = self.near.solve(load, start, settings.tolerance, floor2, settings.max_iterations)
        except NumericalError as error:
            raise NumericalError(f"{error}; {self._gap_so_far()}") from None
        self.counters.iterations += solution.iterations
        return solution

    def count_contacts(self, position: np.ndarray, strain: float, tilt: float) -> None:
        """Enter overlapping pairs and the smallest gap of a sample's positions (N, 3) in the counters.

        Facts of the positions, whatever acts: where no list of pairs reaches far enough, one is made for them.
        """
        pairs = self.list
        if pairs is None and self.number == 1 and self.scene.edge > GAP_REACH:
            return  # no image is near
        if pairs is None or pairs.cutoff < GAP_REACH or not pairs.valid(position, strain):
            pairs = VerletList(self.scene.edge, GAP_REACH, 0.0)
            pairs.build(position, strain, tilt)
        gap, overlaps = contacts_within(pairs.at(position, tilt), pairs.cutoff)
        self.counters.overlaps += overlaps
        self.counters.minimum_gap = min(self.counters.minimum_gap, gap)

    def stress(self, velocity: np.ndarray, rate: float) -> dict[str, np.ndarray]:
        """Bulk stress (six components, eta0 Gamma) by part at the positions of the last evaluation."""
        return {
            "fluid": 2.0 * rate * self._unit_strain_rate(),
            "hydrodynamic": self._hydrodynamic_stress(velocity, rate, self.far_stresslet),
            "interparticle": 6.0 * np.pi / self.scene.edge**3 * self.pair_stress,
        }

    def _unit_strain_rate(self) -> np.ndarray:
        return np.array([self.strain_rate[a, b] for a, b in COMPONENT_INDEX])

    def _hydrodynamic_stress(self, velocity: np.ndarray, rate: float, far: np.ndarray | None) -> np.ndarray:
        """Stresslets of near and far field; `far` (N, 5) those of the far field, on the fluid."""
        total = self._far_stresslets(rate, far).sum(axis=0)
        if self.lubricated:
            total = total + self.near.stresslet(velocity, rate * self.strain_rate)
        return 6.0 * np.pi / self.scene.edge**3 * total

    def _far_stresslets(self, rate: float, far: np.ndarray | None) -> np.ndarray:
        """Stresslet of every sphere (N, 6), Brady's sign, less the near field."""
        if self.far is None:
            return np.tile(self.scene.self_stresslet * rate * self._unit_strain_rate(), (self.number, 1))
        from suspend.hydro.two_sphere_matrices import six_of

        return -six_of(far)

    def flow_driven_stress(self, rate: float, time: float) -> np.ndarray:
        """Hydrodynamic stress driven by the flow alone, at the positions of the last evaluation.

        One more solve, for the velocities at unit rate without any non-hydrodynamic force.
        """
        if rate == 0.0:
            return np.zeros(6)
        still = np.zeros((self.number, 6))
        load = self.near.strain_loads(self.strain_rate) if self.lubricated else still
        if self.far is not None:
            solution = self._coupled(load, self.strain_rate, self.flow_history, time)
            return rate * self._hydrodynamic_stress(solution.velocity, 1.0, solution.stresslet)
        if self.scene.lubrication is None:
            return rate * self._hydrodynamic_stress(still, 1.0, None)
        velocity = still
        if self.lubricated:
            velocity = self._conjugate_gradient(load, self.flow_history.extrapolate(time, load.shape)).velocity
        self.flow_history.push(time, velocity)
        return rate * self._hydrodynamic_stress(velocity, 1.0, None)

    def stress_per_sphere(
        self, position: np.ndarray, tilt: float, velocity: np.ndarray, rate: float
    ) -> np.ndarray:
        """Stress of each sphere (N, 6), hydrodynamic and interparticle; the sum is the bulk's less fluid."""
        each = self._far_stresslets(rate, self.far_stresslet)
        if self.lubricated:
            each += self.near.stresslet_of_each(
                self._near_field.odd_table, position, self.scene.edge, tilt, velocity, rate * self.strain_rate
            )
        if self.forced:
            each += stress_per_sphere(self.list.at(position, tilt), self.scene.force, self.force_range)
        return 6.0 * np.pi / self.scene.edge**3 * each
