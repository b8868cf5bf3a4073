"""Self-diffusion in any flow: mean square displacements with the affine part of the shear removed."""

from __future__ import annotations

import math
from typing import Any, Self

import numpy as np

from suspend.analysis.displacements import AXES, COMPONENT_PAIRS, cycle_starts, require_spheres
from suspend.analysis.quantity import Quantity
from suspend.analysis.summary import read_scales
from suspend.errors import ConfigurationError
from suspend.io import Run

_UNEVEN = 1e-6  # relative, between the intervals of the frames
_LAGS = 48


class SelfDiffusion(Quantity):
    """Mean square displacements against strain and the diffusion tensor D_ab in a^2 per unit of accumulated strain.

    Steady shear and reversal: from x the flow's own displacement along each sphere's path is taken off,
        x(t) - x(0) - Integral y gdot dt,
    with unwrapped y; the integral is the trapezoidal rule in strain over all stored frames. That is exact where y is
    constant or changes linearly in between. A y that diffuses between frames h of strain apart leaves
    D_yy h^2/12 in D_xx and nothing in D_yy, D_zz (`quadrature_bias`; smoother paths leave less: a quarter of it at
    phi = 0.4 and h = 1). Store frames more often to lower it: output.position_phases. Oscillatory shear: cycle starts
    only, at equal strain, where the flow displaces nothing; this is the diffusivity over all cycles, not D_cyc.
    No flow: strain is time x reference rate.
    All displacements are relative to the mean one, and averaged over spheres and origins.

    start : strain before which nothing is used. window : range of lags (low, high), in strain, of the straight-line
    fit <Delta_a Delta_b> = c + 2 D_ab gamma; by default 1/16 to 1/4 of the length.
    memory : bytes that stored positions may take; longer runs are thinned to every m-th frame, and `notes` says so.
    """

    def __init__(self, start: float = 0.0, window: tuple[float, float] | None = None, memory: int = 128 << 20):
        if start < 0.0 or (window is not None and not 0.0 <= window[0] < window[1]):
            raise ConfigurationError(f"start = {start:g}, window = {window}: needed are start >= 0 and 0 <= low < high")
        self.start, self.window, self.memory = start, window, memory

    def compute(self, run: Run) -> Self:
        """Compute from the stored frames; ConfigurationError for fewer than two spheres or four usable frames."""
        require_spheres(run)
        flow, scales = read_scales(run)
        self._flow = flow
        expected = max(run.cycles + 1, 1)
        self._stride = max(1, math.ceil(24 * int(run.meta["number"]) * expected / self.memory))
        frames = _cyclic_frames(run, scales) if flow == "oscillatory" else _sheared_frames(run, scales)
        times, kept, spacing = [], [], 0.0
        for number, (strain, position, gap) in enumerate(frames):
            spacing = max(spacing, gap)
            if strain < self.start - _UNEVEN or number % self._stride:
                continue
            times.append(strain)
            kept.append((position - position.mean(axis=0)) / scales["radius"])
        if len(kept) < 4:
            raise ConfigurationError(
                f"{run.path}: {len(kept)} frames from strain {self.start:g} on; 4 or more are needed"
            )
        interval = np.diff(times)
        if np.ptp(interval) > _UNEVEN * interval.mean():
            raise ConfigurationError(
                f"{run.path}: the frames are not at equal intervals of strain ({interval.min():.6g} to "
                f"{interval.max():.6g}): begin behind the reversal with `start`"
            )
        self._spacing, self._interval = spacing, float(interval.mean())
        self._evaluate(np.stack(kept))
        return self

    def _evaluate(self, path: np.ndarray) -> None:
        frames, number = path.shape[:2]
        length = (frames - 1) * self._interval
        low, high = self.window or (length / 16.0, length / 4.0)
        lags = np.unique(np.rint(np.geomspace(1, frames - 1, _LAGS)).astype(int))
        inside = np.arange(math.ceil(low / self._interval - 1e-9), math.floor(high / self._interval + 1e-9) + 1)
        inside = inside[(inside >= 1) & (inside < frames)]
        if len(inside) < 2:
            inside = np.array([1, 2])
        if len(inside) > _LAGS:
            inside = np.unique(np.rint(np.linspace(inside[0], inside[-1], _LAGS)).astype(int))
        self._window = (float(inside[0] * self._interval), float(inside[-1] * self._interval))
        weights = inside - inside.mean()
        weights = dict(zip(inside.tolist(), weights / (weights @ weights) / (2.0 * self._interval), strict=True))
        lags = np.union1d(lags, inside)
        self._lags, self._msd = lags * self._interval, np.empty((len(lags), 3, 3))
        each = np.zeros((number, 6))  # every sphere's own slope: its spread gives the error
        for k, lag in enumerate(lags.tolist()):
            products = np.zeros((number, 6))
            for origin in range(frames - lag):
                step = path[origin + lag] - path[origin]
                for c, (a, b) in enumerate(COMPONENT_PAIRS):
                    products[:, c] += step[:, a] * step[:, b]
            products /= frames - lag
            self._msd[k] = _symmetric(products.mean(axis=0))
            if lag in weights:
                each += weights[lag] * products
        self._tensor = _symmetric(each.mean(axis=0))
        self._errors = _symmetric(each.std(axis=0, ddof=1) / math.sqrt(number))

    @property
    def lags(self) -> np.ndarray:
        """Strain between the two positions (lags,), dimensionless (quiescent: time x rate)."""
        return self._lags

    @property
    def msd(self) -> np.ndarray:
        """<Delta_a Delta_b> (lags, 3, 3), in a^2."""
        return self._msd

    @property
    def tensor(self) -> np.ndarray:
        """D_ab (3, 3) in a^2 per unit of strain: D/(gdot a^2)."""
        return self._tensor

    @property
    def standard_error(self) -> np.ndarray:
        """Standard errors of `tensor` (3, 3), spheres taken as independent."""
        return self._errors

    @property
    def fit_window(self) -> tuple[float, float]:
        """Smallest and largest lag of the straight-line fit, in strain."""
        return self._window

    @property
    def quadrature_bias(self) -> float:
        """D_yy h^2/12, what the trapezoidal rule adds to D_xx if y diffuses between frames, in a^2 per unit strain."""
        if self._flow not in ("steady", "reversal"):
            return 0.0
        return float(max(self._tensor[1, 1], 0.0) * self._spacing**2 / 12.0)

    @property
    def notes(self) -> list[str]:
        """How the numbers are to be read."""
        notes = []
        if self._stride > 1:
            notes.append(f"every {self._stride}th position is used, to keep within {self.memory >> 20} MB")
        if self.quadrature_bias > 0.05 * abs(self._tensor[0, 0]):
            notes.append(
                f"frames are {self._spacing:.3g} of strain apart: removing the affine displacement may add up to "
                f"{self.quadrature_bias:.2g} to D_xx; store frames more often (output.position_phases)"
            )
        return notes

    def table(self) -> dict[str, np.ndarray]:
        """Columns strain and the six components of the mean square displacement."""
        components = {f"msd_{AXES[a]}{AXES[b]}[a^2]": self._msd[:, a, b] for a, b in COMPONENT_PAIRS}
        return {"strain[-]": self._lags, **components}

    def summary(self) -> dict[str, Any]:
        """The diffusion tensor with errors, the window and the bias of the affine correction."""
        found = {}
        for a, b in COMPONENT_PAIRS:
            name = f"D_{AXES[a]}{AXES[b]}[a^2/strain]"
            found |= {name: float(self._tensor[a, b]), f"{name}_error": float(self._errors[a, b])}
        return found | {"window": self._window, "quadrature_bias": self.quadrature_bias, "notes": self.notes}

    def plot(self, ax) -> None:
        """Mean square displacements along the three axes."""
        for a, color in enumerate(("#0072B2", "#E69F00", "#009E73")):
            ax.loglog(self._lags, self._msd[:, a, a], color=color, label=f"$\\langle\\Delta_{AXES[a]}^2\\rangle$")
        ax.set_xlabel(r"strain")
        ax.set_ylabel(r"mean square displacement$/a^2$")
        ax.legend(frameon=False)


def _cyclic_frames(run: Run, scales: dict):
    """Accumulated strain, unwrapped position, spacing of the quadrature (none) of the cycle starts."""
    for k, position in enumerate(cycle_starts(run)):
        yield 4.0 * scales["gamma0"] * k, position, 0.0


def _sheared_frames(run: Run, scales: dict):
    """Accumulated strain, position less the flow's displacement, distance of the frames, at the starts of blocks."""
    previous, removed = None, 0.0
    for frame in run.frames():
        whole = frame["phase"] == 0.0
        strain, height, gap = frame["strain"], frame["unwrapped"][:, 1], 0.0
        if previous is not None:
            gap = strain - previous[0]
            removed = removed + 0.5 * gap * (previous[1] + height)
        previous = (strain, height.copy())
        position = frame["unwrapped"].copy()
        position[:, 0] -= removed
        if whole:
            yield frame["time"] * abs(scales["rate"]), position, abs(gap)


def _symmetric(components: np.ndarray) -> np.ndarray:
    tensor = np.empty((3, 3))
    for value, (a, b) in zip(components, COMPONENT_PAIRS, strict=True):
        tensor[a, b] = tensor[b, a] = value
    return tensor
