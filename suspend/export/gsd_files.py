"""GSD files of the HOOMD schema: what OVITO, freud and HOOMD-blue read.

Not for MDAnalysis: up to version 2.11 its reader takes the schema's tilt xy for the angle alpha, so that every cell
but an untilted one is wrong. It reads .h5md files rightly.
"""

from __future__ import annotations

from pathlib import Path

import gsd.hoomd
import numpy as np

from suspend.export.frames import ExportFrame, FrameChoice

FLUSH_EVERY = 16  # frames; gsd collects small writes in memory


def write_gsd(choice: FrameChoice, path: Path, notes: list[str]) -> None:
    """Write the chosen frames, single precision as the schema has it.

    The schema's cell is centred at the origin: box (L, L, L, xy, 0, 0) with xy = tilt; `image` makes unwrapped
    positions those of the run. `diameter` is 2 a. Logged by frame: time, strain, phase, cycle; where stored,
    particles/stress (N, 6) in the order xx yy zz xy xz yz, not a number where no sample was taken (a
    reader would show the first frame's otherwise). Raises OSError.
    """
    missing = 0
    path.touch()  # gsd's own new files are closed to other users, whatever the umask
    with gsd.hoomd.open(path, "w") as file:
        for written, frame in enumerate(choice, start=1):
            file.append(_snapshot(choice, frame))
            missing += choice.has_stress and frame.stress is None
            if written % FLUSH_EVERY == 0:
                file.file.flush()
    if missing:
        notes.append(f"particles/stress is not a number in {missing} frame(s): no stress was sampled then")


def _snapshot(choice: FrameChoice, frame: ExportFrame) -> gsd.hoomd.Frame:
    position, image = frame.centred()
    made = gsd.hoomd.Frame()
    made.configuration.step = frame.step
    made.configuration.dimensions = 3
    made.configuration.box = [choice.edge, choice.edge, choice.edge, frame.tilt, 0.0, 0.0]
    made.particles.N = choice.number
    made.particles.types = ["sphere"]
    made.particles.typeid = np.zeros(choice.number, np.uint32)
    made.particles.diameter = np.full(choice.number, 2.0 * choice.radius, np.float32)
    made.particles.position = position.astype(np.float32)
    made.particles.image = image
    made.log = {name: np.array([getattr(frame, name)]) for name in ("time", "strain", "phase", "cycle")}
    if choice.has_stress:
        stress = np.full((choice.number, 6), np.nan) if frame.stress is None else frame.stress
        made.log["particles/stress"] = stress
    return made
