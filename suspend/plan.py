"""What a run will do: which terms are on and why, memory, time."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cache

from suspend.box import edge_length
from suspend.flow import Flow, make_flow
from suspend.forces import interaction_range, pair_force

# measured at N = 500, phi = 0.40, cutoff 4 a (benchmarks/bench_evaluation.py, one core)
SECONDS_PER_PAIR = 3.3e-7  # and velocity evaluation: 1.94 ms in a whole run
# at integrator.tolerance 1e-3, gamma0 0.1 to 3.2 to total strain 256: 329, 179, 104, 81, 63 to 74 a unit strain
EVALUATIONS_PER_STRAIN = 65.0
EVALUATIONS_PER_SAMPLE = 2.06  # where samples are closer together than steps would be
BYTES_PER_PAIR = 400
PRODUCTS = 6.0  # with the mobility in a warm solve (benchmarks/bench_coupled.py)
SECONDS_AROUND = 4e-7  # and sphere: near field and orthogonalisation of one iteration
FAR_BYTES = 5_000  # a sphere, at tolerance 1e-3, beside the near field
GRID_BYTES = 104  # at most, a grid point of an Ewald sum (`suspend.hydro.ewald.wave`)
FAR_PAIR_BYTES = 320  # a pair of the neighbour list that reaches the Ewald cutoff
COARSE_PRODUCTS = 12.0  # with the mobility of the inner iteration, where there is one
BASE_MB = 200  # interpreter, libraries and compiled kernels
START = {
    "equilibrium": "equilibrium packing: a fluid of hard spheres, a glass above freezing",
    "quenched": "quenched packing: random points pushed apart",
}


@dataclass(frozen=True)
class Plan:
    """Terms, sizes and estimates of a run."""

    terms: list[tuple[str, str]]
    figures: dict

    def lines(self) -> list[str]:
        """Text, one line an entry."""
        width = max(len(name) for name, _ in self.terms) + 2
        return [f"{name.ljust(width)}{text}" for name, text in self.terms]

    def as_dict(self) -> dict:
        """The same for scripts."""
        return {"terms": dict(self.terms), **self.figures}


def make_plan(config) -> Plan:
    """Plan of a configuration (`suspend.config.Config`)."""
    particles, lubrication, flow = config.particles, config.lubrication, make_flow(config)
    edge = edge_length(particles.number, particles.volume_fraction)
    reach = interaction_range(pair_force(config.repulsion, config.contact))
    ewald = _ewald(config, edge)
    figures = _estimates(config, flow, edge, max(reach, lubrication.cutoff if lubrication.enabled else 0.0), ewald)
    terms = [
        ("spheres", f"{particles.number} at volume fraction {particles.volume_fraction:g}, cell edge {edge:.6g} a"),
        ("flow", _flow_text(config, flow)),
        ("far field", _far_field_text(config, ewald)),
        ("lubrication", f"on: pairs closer than {lubrication.cutoff:g} a, {lubrication.at_cutoff} at the cutoff"
         + (f", frozen below {lubrication.minimum_gap:g} a" if lubrication.minimum_gap else "")
         if lubrication.enabled else "off (lubrication.enabled: false): no table, no linear system"),
        ("repulsion", f"on: {config.repulsion.force:g} F_stk, Debye length {config.repulsion.debye_length:g} a, "
         f"up to centre distance {reach:.4g} a" if config.repulsion is not None and config.repulsion.force > 0
         else "off: no force loop"),
        ("contact", f"on: spring {config.contact.stiffness:g} F_stk/a" if config.contact is not None else "off"),
        ("external", f"force {config.external.force}, torque {config.external.torque}"
         if config.external is not None else "off"),
        ("start", START.get(particles.initial, str(particles.initial))),
        ("steps", f"{config.integrator.method}, tolerance {config.integrator.tolerance:g}"
         if config.integrator.step is None else f"{config.integrator.method}, fixed {config.integrator.step:g}"),
        ("velocity solve", f"near field alone, tolerance {config.solver.tolerance:g}" if ewald is None else
         f"near and far field coupled, residual {config.solver.far_tolerance:g}"),
        ("samples", f"{config.output.samples_per_cycle} a cycle" + (
            ", stress of every sphere" if config.output.particle_stress else "")),
        ("memory", f"about {figures['memory_MB']:.0f} MB"),
        ("time", f"about {figures['seconds']:.0f} s on one core (a guess from N and phi)"),
    ]  # fmt: skip
    return Plan(terms, figures)


def _ewald(config, edge: float):
    """Parameters of the Ewald sum and of its inner iteration, None without far field."""
    if config.far_field != "ewald":
        return None
    return _ewald_parameters(config.ewald, config.particles.number, edge)


@cache  # a second each, and a sweep plans many runs of the same scene
def _ewald_parameters(section, number: int, edge: float):
    from suspend.farfield import make_parameters

    return make_parameters(section, section.tolerance, number, edge)


def _far_field_text(config, ewald) -> str:
    if config.far_field == "self":
        return "self: own drag and stresslet only; no grid, no FFT"
    if ewald is None:
        return "identity: as the authors' code (rotational drag x 3/4, stresslet x 9/5)"
    coarse, ewald = ewald.coarse, ewald.accurate
    grid = " x ".join(str(n) for n in ewald.grid)
    inner = "" if coarse is None else f"; inner iteration on {' x '.join(str(n) for n in coarse.grid)}"
    return (
        f"ewald: spectral Ewald sum, tolerance {config.ewald.tolerance:g}: real space to {ewald.split.cutoff:.3g} a, "
        f"grid {grid}, {ewald.window.kind} window of {ewald.window.support} points{inner}"
    )


def _flow_text(config, flow: Flow) -> str:
    end = flow.accumulated(flow.cycles - 1, flow.period(flow.cycles - 1))
    if config.flow.type == "oscillatory":
        text = f"oscillatory, gamma0 {config.flow.amplitude:g}, {flow.cycles} cycles, total strain {end:g}"
        asked = config.duration.strain
        text += f" (whole cycles for {asked:g})" if asked is not None and abs(asked - end) > 1e-6 else ""
        steady = config.duration.until_steady
        return text + (f", less where the steady state is established before (to {steady:g})" if steady else "")
    return f"{config.flow.type}, total strain (time x rate) {end:g} in {flow.cycles} blocks"


def _estimates(config, flow: Flow, edge: float, reach: float, ewald) -> dict:
    number = config.particles.number
    pairs = 0.5 * number * number / edge**3 * 4.19 * max(reach**3 - 8.0, 0.0) if reach else 0.0
    strain = flow.accumulated(flow.cycles - 1, flow.period(flow.cycles - 1))
    evaluations = math.hypot(
        strain * EVALUATIONS_PER_STRAIN * (1e-3 / config.integrator.tolerance) ** 0.4,
        flow.cycles * config.output.samples_per_cycle * EVALUATIONS_PER_SAMPLE,
    )
    sphere_stress = 48 * number * config.output.samples_per_cycle if config.output.particle_stress else 0
    products = evaluations * PRODUCTS if ewald is not None else 0.0
    far_seconds = ewald.accurate.seconds + SECONDS_AROUND * number if ewald is not None else 0.0
    if ewald is not None and ewald.coarse is not None:
        far_seconds += COARSE_PRODUCTS / PRODUCTS * ewald.coarse.seconds
    return {
        "number": number,
        "cell_edge": edge,
        "cycles": flow.cycles,
        "total_strain": strain,
        "pairs": round(pairs),
        "memory_MB": BASE_MB
        + (BYTES_PER_PAIR * 1.5 * pairs + 3000 * number + 3 * sphere_stress) / 1e6
        + (_far_bytes(number, edge, ewald) / 1e6 if ewald is not None else 0.0),
        "evaluations": round(evaluations),
        "seconds": evaluations * (pairs * SECONDS_PER_PAIR + 1e-4) + products * far_seconds,
    }


def _far_bytes(number: int, edge: float, ewald) -> float:
    """Memory of the Ewald sums: the grids and the pairs within the cutoff, where they are more than usual."""
    parts = [part for part in (ewald.accurate, ewald.coarse) if part is not None]
    grids = sum(GRID_BYTES * math.prod(part.grid) for part in parts)
    pairs = number * number * (2.0 / 3.0) * math.pi * (ewald.cutoff / edge) ** 3
    return max(FAR_BYTES * number, grids + FAR_PAIR_BYTES * pairs)
