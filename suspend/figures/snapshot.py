"""Snapshots of the sheared cell over a cycle, coloured by the stress of the spheres or another scalar."""

from __future__ import annotations

import numpy as np

from suspend.figures.cell import colour_limits, draw_cell, picture_table, pictures
from suspend.figures.panel import Columns, Panel
from suspend.figures.runs import Runs
from suspend.figures.scalars import STRESS
from suspend.figures.style import DOUBLE, SINGLE, number

_BAR, _TITLE = 0.75, 0.25  # inches, of the colour bar and the titles
_MOST = 4  # frames of a cycle that are drawn by default


class Snapshot(Panel):
    """Frames of one cycle in a row, projected onto the shear plane (x to the right, y up, z towards the reader).

    cycle: the last complete one by default; phase: one frame at this fraction of the cycle instead of up to four;
    colour: see `suspend.figures.scalars`. The dashed outline is the cell sheared by the whole strain.
    """

    def __init__(self, runs: Runs, cycle: int | None = None, phase: float | None = None, colour: str = STRESS):
        member = runs.only
        self.oscillatory = member.flow == "oscillatory"
        self.scalar, found = pictures(member, colour, cycle, None if phase is None else [phase])
        step = max(-(-len(found) // _MOST), 1)
        self.found = found[::step]
        self.limits = colour_limits(self.scalar, self.found)

    @property
    def size(self) -> tuple[float, float]:
        """Two columns for three frames or more, else one; as high as the cells need."""
        width = DOUBLE if len(self.found) > 2 else SINGLE
        extents = np.array([p.extent for p in self.found])
        spans, rise = extents[:, 1] - extents[:, 0], (extents[:, 3] - extents[:, 2]).max()
        room = width - (_BAR if self.scalar.label else 0.1)
        return width, min(room * rise / spans.sum(), width) + _TITLE

    def tables(self) -> dict[str, Columns]:
        """One row for each sphere of each frame."""
        return {"": picture_table(self.scalar, self.found)}

    def draw(self, page) -> None:
        """The frames at one scale with one colour bar."""
        widths = [p.extent[1] - p.extent[0] for p in self.found]
        axes = page.subplots(1, len(widths), squeeze=False, width_ratios=widths)[0]
        for ax, picture in zip(axes, self.found, strict=True):
            drawn = draw_cell(ax, picture, self.scalar, self.limits)
            time = rf"$\omega t = {number(360 * picture.phase)}\degree$, " if self.oscillatory else ""
            ax.set_title(time + rf"$\gamma = {number(picture.strain)}$", fontsize=7)
        if self.scalar.label:
            bar = page.colorbar(
                drawn, ax=axes.tolist(), extend="both" if self.scalar.signed else "max", shrink=0.8, aspect=15
            )
            bar.set_label(self.scalar.label)
            bar.ax.tick_params(direction="out", right=True)
