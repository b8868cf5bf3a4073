"""A run in memory as a checkpoint: arrays and numbers from which it continues bit for bit."""

from __future__ import annotations

from dataclasses import asdict

import numpy as np

from suspend.core.pairs import HeldPairs
from suspend.dynamics import Counters, History
from suspend.flow import block_length
from suspend.gaps import TouchingPairs
from suspend.missing import has_value, known
from suspend.motion import State


def dump(simulation) -> tuple[dict, dict | None]:
    """Everything needed to continue a `Simulation`: (state, partial record of the cycle in progress or None)."""
    suspension, motion = simulation.suspension, simulation.motion
    verlet = suspension.list
    content = {
        "motion": asdict(simulation.state),
        "controller": motion.controller.previous,
        "position_error": motion.position_error,
        "evaluations_before": motion.evaluations_before,
        "history": _dump_history(suspension.history),
        "flow_history": _dump_history(suspension.flow_history),
        "threads": suspension.threads,
        "block": block_length(simulation.flow),
    }
    if simulation.between_cycles:
        return content, None
    content |= {
        "counters": {name: known(value) for name, value in asdict(suspension.counters).items()},
        "baseline": suspension.baseline,
        "start_position": simulation.start_position,
        "list": None if verlet is None else _list_point(verlet),
        "factor": _factor_point(suspension.factor_point),
        "factor_age": suspension.factor_age,
    }
    return content, simulation.recorder.partial()


def load(simulation, content: dict, partial: dict | None) -> None:
    """Continue a `Simulation` made from the same configuration from what `dump` returned."""
    suspension, motion = simulation.suspension, simulation.motion
    motion_state = content["motion"]
    touching = {"touching": TouchingPairs(**motion_state["touching"])} if "touching" in motion_state else {}
    simulation.state, simulation.events = State(**motion_state | touching), []
    motion.controller.previous = content["controller"]
    motion.evaluations_before = content["evaluations_before"]
    _load_history(suspension.history, content["history"])
    _load_history(suspension.flow_history, content["flow_history"])
    if partial is None:
        return
    if content["list"] is not None:
        point = content["list"]
        suspension.renew(point["reference"], point["strain"], point["tilt"])
    if content["factor"] is not None:
        point = content["factor"]
        position, tilt = point["position"], point["tilt"]
        suspension.held = HeldPairs(point["rows"], point["log_gap"]) if len(point.get("rows", ())) else None
        suspension.near.assemble(position, suspension.scene.edge, tilt, suspension.held)
        suspension.factor(position, tilt)
        suspension.factor_age = content["factor_age"]
    motion.position_error = content["position_error"]
    suspension.counters = Counters(**{name: value for name, value in content["counters"].items() if has_value(value)})
    suspension.baseline, simulation.start_position = content["baseline"], content["start_position"]
    simulation.recorder.resume(partial)
    time, coming = simulation.state.time, simulation.coming_events()
    # the cycle's end stays, however near: without a coming event the state would pass for one between cycles
    simulation.events = [t for t in coming[:-1] if t > time + 1e-12 * max(1.0, time)] + coming[-1:]


def _list_point(verlet) -> dict:
    return {"reference": verlet.reference, "strain": verlet.strain, "tilt": verlet.tilt}


def _factor_point(point) -> dict | None:
    if point is None:
        return None
    position, tilt, held = point
    held = TouchingPairs() if held is None else held
    return {"position": position, "tilt": tilt, "rows": held.rows, "log_gap": held.log_gap}


def _dump_history(history: History) -> dict:
    return {"times": list(history.times), "values": np.array(history.values)}


def _load_history(history: History, content: dict) -> None:
    history.times, history.values = [float(t) for t in content["times"]], list(content["values"])
