"""H5MD files with the units that MDAnalysis asks for; it opens them beside a topology, an exported .xyz."""

from __future__ import annotations

from pathlib import Path

import h5py
import numpy as np

from suspend.export.frames import FrameChoice

LENGTH, TIME = "Angstrom", "ps"  # MDAnalysis' own units: it leaves the numbers as they are


def write_h5md(choice: FrameChoice, path: Path, notes: list[str]) -> None:
    """Write the chosen frames, double precision: wrapped positions, images, cell vectors (rows), times.

    Lengths and times are those of the configuration; they are labelled Angstrom and ps, because MDAnalysis refuses a
    file without units and knows no others. /observables: strain, phase, tilt, cycle of each frame. Raises OSError.
    """
    count = len(choice)
    with h5py.File(path, "w") as file:
        header = file.create_group("h5md")
        header.attrs["version"] = np.array([1, 1], np.int32)
        header.create_group("author").attrs["name"] = "unknown"
        header.create_group("creator").attrs.update(name="suspend export", version="1")
        box = file.create_group("particles/spheres/box")
        box.attrs.update(dimension=3, boundary=["periodic"] * 3)
        step, time = _clock(file, count)
        elements = {
            "position": _element(file, "particles/spheres/position", (count, choice.number, 3), float, (step, time)),
            "image": _element(file, "particles/spheres/image", (count, choice.number, 3), np.int32, (step, time)),
            "vectors": _element(file, "particles/spheres/box/edges", (count, 3, 3), float, (step, time)),
        }
        for name in ("position", "vectors"):
            elements[name].attrs["unit"] = LENGTH
        for name, kind in (("strain", float), ("phase", float), ("tilt", float), ("cycle", np.int64)):
            elements[name] = _element(file, f"observables/{name}", (count,), kind, (step, time))
        for i, frame in enumerate(choice):
            step[i], time[i] = frame.step, frame.time
            for name, dataset in elements.items():
                dataset[i] = getattr(frame, name)
    notes.append(
        f"lengths and times are the configuration's, labelled {LENGTH} and {TIME}; MDAnalysis needs a topology too: "
        "export the first frame as .xyz (--frames 0), then Universe('top.xyz', 'run.h5md')"
    )


def _clock(file: h5py.File, count: int) -> tuple[h5py.Dataset, h5py.Dataset]:
    """Step and time, shared by all elements."""
    group = file.create_group("particles/spheres/position")
    step, time = group.create_dataset("step", (count,), np.int64), group.create_dataset("time", (count,), float)
    time.attrs["unit"] = TIME
    return step, time


def _element(file: h5py.File, path: str, shape: tuple[int, ...], kind, clock) -> h5py.Dataset:
    group = file.require_group(path)
    for name, dataset in zip(("step", "time"), clock, strict=True):
        if name not in group:
            group[name] = dataset  # a hard link
    return group.create_dataset("value", shape, kind)
