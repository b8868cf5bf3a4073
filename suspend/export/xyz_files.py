"""Extended XYZ: text with cell and columns named in the comment line; OVITO, ASE and QUIP read it."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from suspend.export.frames import ExportFrame, FrameChoice

SPECIES = "X"  # the dummy element; readers refuse names that are none


def write_xyz(choice: FrameChoice, path: Path, notes: list[str]) -> None:
    """Write the chosen frames; numbers have all their digits, so that they read back bit for bit.

    Lattice holds the cell vectors one after the other, its corner is the origin. Columns: species, pos, radius,
    map_shift (cell vectors to add for the unwrapped position) and, where stored, Stress (xx yy zz xy xz yz; OVITO's
    Stress Tensor, while ASE would take the name stress for the system's); the comment line has time, strain, phase,
    cycle and frame. Raises OSError.
    """
    missing = 0
    with open(path, "w", encoding="ascii", newline="\n") as file:
        for frame in choice:
            _write_frame(file, choice, frame)
            missing += choice.has_stress and frame.stress is None
    if missing:
        notes.append(f"{missing} frame(s) have no stress column: no stress was sampled then")


def _write_frame(file, choice: FrameChoice, frame: ExportFrame) -> None:
    lattice = " ".join(repr(value) for value in frame.vectors.ravel().tolist())
    columns = "species:S:1:pos:R:3:radius:R:1:map_shift:I:3" + (":Stress:R:6" if frame.stress is not None else "")
    facts = {name: getattr(frame, name) for name in ("time", "strain", "phase", "cycle", "tilt")}
    values = " ".join(f"{name}={value!r}" for name, value in facts.items())
    file.write(
        f'{choice.number}\nLattice="{lattice}" Origin="0.0 0.0 0.0" Properties={columns} pbc="T T T" {values} '
        f"frame={frame.index}\n"
    )
    stress = frame.stress if frame.stress is not None else np.empty((choice.number, 0))
    radius = repr(choice.radius)
    for x, n, s in zip(frame.position.tolist(), frame.image.tolist(), stress.tolist(), strict=True):
        words = [SPECIES, *map(repr, x), radius, *map(str, n), *map(repr, s)]
        file.write(" ".join(words) + "\n")
