"""Angular distribution of neighbours on the sphere (Aitoff), initial and final, at the first three peaks of g(r)."""

from __future__ import annotations

import numpy as np

from suspend.analysis.microstructure import AngularMaps, compute_together, first, last
from suspend.errors import ConfigurationError
from suspend.figures.panel import Columns, Panel
from suspend.figures.runs import Runs, oscillatory
from suspend.figures.structure import CRITICAL, STATES, title_of, two_states

_FINAL = 8  # cycle starts that make the final state
_FEW = 2000  # with fewer spheres the cells of the maps are larger


class DirectionMaps(Panel):
    """Maps in two columns, at r +- 0.1 a; the pole is the gradient direction, longitude 0 the flow.

    The flow of a neighbour relative to the sphere in the middle is the same along each latitude.
    """

    def __init__(self, runs: Runs):
        self.member = oscillatory(runs).nearest(CRITICAL)
        cells = {"longitudes": 24, "latitudes": 16} if self.member.number < _FEW else {}
        with self.member.open() as run:
            if run.cycles < 1:
                raise ConfigurationError(f"{self.member.path}: the maps need a complete cycle, none is stored yet")
            self.final = AngularMaps(last(min(_FINAL, run.cycles)), **cells).compute(run)
            known = self.final.radii[np.isfinite(self.final.radii)]
            if not len(known):
                raise ConfigurationError(
                    f"{self.member.path}: g(r) shows no peak above its noise, so there is no distance to draw maps at: "
                    "use more spheres or more cycles"
                )
            self.radii = known
            self.initial = AngularMaps(first(1), radii=known, **cells)
            compute_together(run, [self.initial])

    def tables(self) -> dict[str, Columns]:
        """Density relative to isotropy by distance, longitude and latitude."""
        final = self.final.table()
        kept = np.isfinite(final["r[a]"])
        return {"": two_states(self.member, [self.initial.table(), {k: v[kept] for k, v in final.items()}])}

    def draw(self, page) -> None:
        """One row for each distance, one scale of colour a row."""
        axes = page.subplots(len(self.radii), 2, squeeze=False, subplot_kw={"projection": "aitoff"})
        for radius, row in zip(self.radii, axes, strict=True):
            top = max(2.0, float(np.nanquantile(self.final.at(radius), 0.98)))
            for maps, ax in zip((self.initial, self.final), row, strict=True):
                mesh = (maps.longitude_edges, maps.latitude_edges, maps.at(radius).T)
                drawn = ax.pcolormesh(*mesh, cmap="Blues", vmin=0.0, vmax=top, rasterized=True)
                ax.set_xticks(np.deg2rad([-90.0, 0.0, 90.0]), ["", "", ""])
                ax.set_yticks(np.deg2rad([-60.0, -15.0, 15.0, 60.0]), ["−60°", "−15°", "15°", "60°"], fontsize=5)
                ax.grid(True, linewidth=0.3, color="#666666")
            row[0].set_ylabel(rf"$r/a = {radius:.2f}$", fontsize=7)
            bar = page.colorbar(drawn, ax=row.tolist(), shrink=0.75, aspect=10, extend="max")
            bar.ax.tick_params(labelsize=6, direction="out", right=True)
        bar.set_label("density / isotropic", fontsize=6)
        for ax in axes[-1]:
            ax.set_xlabel("longitudes −90°, 0 (flow), 90°", fontsize=6)
        for (name, _), ax in zip(STATES, axes[0], strict=True):
            ax.set_title(name, fontsize=8, pad=5)
        page.suptitle(title_of(self.member), fontsize=7)
