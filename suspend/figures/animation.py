"""Animation of the sheared cell over one cycle: GIF, or MP4 where ffmpeg is installed."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from suspend.backend import load_matplotlib
from suspend.errors import ConfigurationError
from suspend.figures.cell import Picture, colour_limits, draw_cell, picture_table, pictures
from suspend.figures.panel import Columns
from suspend.figures.runs import Runs
from suspend.figures.scalars import STRESS
from suspend.figures.style import BLUE, GREY, journal
from suspend.io.files import replace_atomically, storage_errors

if TYPE_CHECKING:
    from matplotlib.figure import Figure

FORMATS = ("gif", "mp4")
_LEAST = 4  # frames that make a movement
_SECONDS = 4.0  # that a cycle lasts on the screen
_DPI = 120


class Animation:
    """The frames stored in one cycle, one after the other; nothing is interpolated between them.

    cycle: the last complete one by default; colour: see `suspend.figures.scalars`. Raises ConfigurationError where
    fewer than four frames a cycle are stored.
    """

    def __init__(self, runs: Runs, cycle: int | None = None, colour: str = STRESS):
        member = runs.only
        self.scalar, self.found = pictures(member, colour, cycle, None)
        if len(self.found) < _LEAST:
            raise ConfigurationError(
                f"{member.path}: {len(self.found)} frame(s) a cycle are stored, an animation needs {_LEAST} or more "
                "(16 look smooth); run with output.position_phases: [0.0, 0.0625, 0.125, ...]"
            )
        self.limits = colour_limits(self.scalar, self.found)

    def tables(self) -> dict[str, Columns]:
        """One row for each sphere of each frame."""
        return {"": picture_table(self.scalar, self.found)}

    def write(self, path: Path) -> None:
        """Write a GIF or an MP4, by the suffix; atomic. ConfigurationError where MP4 needs ffmpeg, StorageError."""
        load_matplotlib()
        from matplotlib.animation import FFMpegWriter, FuncAnimation, PillowWriter

        kind = path.suffix.lower()[1:]
        if kind == "mp4" and not FFMpegWriter.isAvailable():
            raise ConfigurationError(
                f"cannot write {path}: MP4 needs the program ffmpeg, which is not installed; write a .gif"
            )
        rate = max(len(self.found) / _SECONDS, 1.0)
        with journal():
            figure, update = self._stage()
            movie = FuncAnimation(figure, update, frames=self.found, init_func=lambda: [], blit=False)
            writer = PillowWriter(fps=rate) if kind == "gif" else FFMpegWriter(fps=rate)

            def save(temporary: Path) -> None:
                named = temporary.with_name(f"{temporary.name}.{kind}")  # the writers go by the suffix
                try:
                    movie.save(named, writer=writer, dpi=_DPI)
                    named.replace(temporary)
                finally:
                    named.unlink(missing_ok=True)

            with storage_errors("write the animation", path):
                replace_atomically(path, save, sync=False)

    def _stage(self) -> tuple[Figure, object]:
        """A figure with the cell above and the strain below, and the function that shows a frame in it."""
        from matplotlib.backends.backend_agg import FigureCanvasAgg
        from matplotlib.figure import Figure

        extents = np.array([p.extent for p in self.found])
        x0, x1, y0, y1 = extents[:, 0].min(), extents[:, 1].max(), extents[:, 2].min(), extents[:, 3].max()
        width = 5.0
        height = np.ceil(50.0 * (width * 0.84 * (y1 - y0) / (x1 - x0) + 1.1)) / 50.0
        figure = Figure(figsize=(width, height), layout="constrained")
        FigureCanvasAgg(figure)
        ax, strip = figure.subplots(2, 1, height_ratios=(height - 1.0, 0.75))
        drawn = draw_cell(ax, self.found[0], self.scalar, self.limits)
        if self.scalar.label:
            bar = figure.colorbar(drawn, ax=ax, extend="both" if self.scalar.signed else "max", shrink=0.85, aspect=18)
            bar.set_label(self.scalar.label)
        phases = np.array([p.phase for p in self.found])
        strip.plot(phases, [p.strain for p in self.found], color=GREY, marker=".", markersize=2)
        (now,) = strip.plot([], [], "o", color=BLUE)
        strip.set(xlim=(-0.02, 1.02), xlabel="fraction of the cycle", ylabel=r"$\gamma$")

        def update(picture: Picture) -> list:
            ax.clear()
            draw_cell(ax, picture, self.scalar, self.limits)
            ax.set(xlim=(x0, x1), ylim=(y0, y1))
            now.set_data([picture.phase], [picture.strain])
            return []

        return figure, update
