"""Folders of sweeps filled with stored runs of known stresses and displacements, as `suspend sweep` leaves them."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import yaml
from figure_runs import NUMBER, OMEGA, VISCOSITY, make_run

from suspend.sweep import read_sweep, resolve
from suspend.sweep.folder import Folder, Record, write_configuration, write_record

CYCLES = 6


def sweep_text(vary: dict, seeds: int = 1, **more) -> str:
    """A sweep file of runs as `figure_runs.make_run` makes them."""
    base = {
        "particles": {"number": NUMBER, "volume_fraction": 0.4},
        "fluid": {"viscosity": VISCOSITY},
        "flow": {"type": "oscillatory", "amplitude": 0.8, "omega": OMEGA},
        "duration": {"cycles": CYCLES},
    }
    return yaml.safe_dump({"base": base, "vary": vary, "seeds": seeds, "retries": 1} | more)


def make_sweep(folder: Path, text: str, skip=lambda point: "", make=make_run) -> Path:
    """Write folder/s.yaml and fill folder/runs/s; skip(point): "" for a complete point, else its state or failure."""
    folder.mkdir(exist_ok=True)
    (folder / "s.yaml").write_text(text)
    sweep = read_sweep(folder / "s.yaml")
    points = resolve(sweep)
    base = Folder(folder / "runs" / "s")
    base.make()
    for point in points:
        config, place, state = point.config, base.path / point.name, skip(point)
        if state == "waiting":
            continue
        write_configuration(place, config)
        record = Record(strain=1.0, total_strain=10.0, updated=1.0, seconds=60.0)
        if state:
            count = 0 if state == "interrupted" else 2
            write_record(place, replace(record, failures=count, message=state if count else ""))
            continue
        tree = config.to_dict()
        gamma0, phi = tree["flow"]["amplitude"], tree["particles"]["volume_fraction"]
        more = {key: value for key, value in tree.items() if key not in ("seed", "flow", "fluid", "duration")}
        make(place, gamma0, phi, point.seed, CYCLES, **more)
        write_record(place, replace(record, done=True, strain=10.0))
    entries = [{"folder": p.name, "key": p.key, "parameters": p.parameters, "seed": p.seed} for p in points]
    base.write_manifest(str(folder / "s.yaml"), entries, [], sweep.retries)
    return base.path
