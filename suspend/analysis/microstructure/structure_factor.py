"""Static structure factor at the wave vectors the sheared cell allows, and what it says about hyperuniformity."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from suspend.analysis.microstructure.snapshot import LAST, FrameQuantity, Frames, Snapshot
from suspend.errors import ConfigurationError

_FINE = 1.0  # 1/a: below this wave number shells are pi/L wide
_SPHERES, _VECTORS = 512, 256  # at a time: what fits into the caches


class Hyperuniformity(NamedTuple):
    """Behaviour of S(q) at small q.

    s0, s0_error: S(q -> 0) of a fit S = s0 + c q^2; alpha, alpha_error: exponent of a fit S ~ q^alpha; index:
    s0 / S at its peak (below about 1e-3: called effectively hyperuniform, Torquato, Phys. Rep. 745, 1, 2018);
    q_max: upper end of both fits, 1/a.
    """

    s0: float
    s0_error: float
    alpha: float
    alpha_error: float
    index: float
    q_max: float


def allowed_vectors(length: float, tilt: float, q_max: float) -> tuple[np.ndarray, np.ndarray]:
    """Integers n (M,3) and wave numbers (M,) of q = (2 pi/L) (n1, n2 - tilt n1, n3), 0 < |q| <= q_max, one of +-q.

    These are all vectors with exp(i q.a) = 1 for the three cell vectors; those of the untilted cell would see
    the jump of the positions at the sheared face.
    """
    unit = 2.0 * np.pi / length
    top = int(q_max / unit)
    middle = int(q_max / unit * (1.0 + abs(tilt))) + 1
    n1, n2, n3 = np.meshgrid(
        np.arange(0, top + 1), np.arange(-middle, middle + 1), np.arange(-top, top + 1), indexing="ij"
    )
    q2 = n1**2 + (n2 - tilt * n1) ** 2 + n3**2
    half = (n1 > 0) | ((n1 == 0) & ((n2 > 0) | ((n2 == 0) & (n3 > 0))))
    keep = half & (q2 <= (q_max / unit) ** 2 * (1.0 + 1e-12))
    return np.column_stack([n1[keep], n2[keep], n3[keep]]), unit * np.sqrt(q2[keep])


def scattering(snapshot: Snapshot, n: np.ndarray) -> np.ndarray:
    """S(q) = |sum_j exp(-i q.x_j)|^2 / N for integer vectors n (M,3), shape (M,)."""
    x = snapshot.position / snapshot.length
    s = np.column_stack([x[:, 0] - snapshot.tilt * x[:, 1], x[:, 1], x[:, 2]]) % 1.0
    low, high = n.min(axis=0), n.max(axis=0)
    amplitude = np.zeros(len(n), complex)
    for j in range(0, snapshot.number, _SPHERES):
        # exp(-2 pi i n s) for every integer that occurs: products of three replace exponentials
        tables = [
            np.exp(-2j * np.pi * np.outer(np.arange(low[axis], high[axis] + 1), s[j : j + _SPHERES, axis]))
            for axis in range(3)
        ]
        for i in range(0, len(n), _VECTORS):
            part = n[i : i + _VECTORS] - low
            product = tables[0][part[:, 0]]
            product *= tables[1][part[:, 1]]
            amplitude[i : i + _VECTORS] += np.einsum("ij,ij->i", product, tables[2][part[:, 2]])
    return np.abs(amplitude) ** 2 / snapshot.number


class StructureFactor(FrameQuantity):
    """S(q) averaged over frames and over the wave vectors of shells, from 2 pi/L to `q_max` (1/a).

    Shells are pi/L wide below 1/a, `width` above; the first holds the smallest wave vectors only. At most
    `per_shell` vectors of a shell are used (twice as many below 1/a), chosen at random once: the relative scatter
    of S of one vector is one, whatever N is.
    """

    def __init__(self, frames: Frames = LAST, q_max: float = 8.0, width: float = 0.1, per_shell: int = 60):
        self.frames, self.q_max, self.width, self.per_shell = frames, q_max, width, per_shell

    def missing(self, snapshot: Snapshot) -> str | None:
        """No wave vector below q_max."""
        unit = 2.0 * np.pi / snapshot.length
        if unit <= self.q_max:
            return None
        return f"the smallest wave number 2 pi/L = {unit:.3g}/a is above q_max = {self.q_max:g}/a"

    def begin(self) -> None:
        """Forget earlier results."""
        self._edges, self._tilt, self._frames = None, None, 0

    def add(self, snapshot: Snapshot) -> None:
        """Add the scattering of one configuration."""
        unit = 2.0 * np.pi / snapshot.length
        if self._edges is None:
            self._edges = _shell_edges(unit, self.q_max, self.width)
            self._sums = np.zeros((3, len(self._edges) - 1))  # vectors, q, S
        if self._tilt != snapshot.tilt:
            self._tilt = snapshot.tilt
            self._vectors = self._choose(snapshot)
        n, q, shell = self._vectors
        values = scattering(snapshot, n)
        for row, weight in zip(self._sums, (None, q, values), strict=True):
            row += np.bincount(shell, weight, minlength=len(row))
        self._frames += 1

    def _choose(self, snapshot: Snapshot) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        n, q = allowed_vectors(snapshot.length, snapshot.tilt, self.q_max)
        shell = np.searchsorted(self._edges, q, side="right") - 1
        inside = shell < len(self._edges) - 1
        n, q, shell = n[inside], q[inside], shell[inside]
        order = np.random.default_rng(1).permutation(len(n))
        order = order[np.argsort(shell[order], kind="stable")]
        start = np.searchsorted(shell[order], np.arange(len(self._edges) - 1))
        rank = np.arange(len(n)) - start[shell[order]]
        limit = np.where(self._edges[:-1] < _FINE, 2 * self.per_shell, self.per_shell)
        chosen = order[rank < limit[shell[order]]]
        return n[chosen], q[chosen], shell[chosen]

    @property
    def _filled(self) -> np.ndarray:
        return self._sums[0] > 0

    @property
    def q(self) -> np.ndarray:
        """Mean wave number of the vectors of each shell, 1/a."""
        return self._sums[1][self._filled] / self._sums[0][self._filled]

    @property
    def s(self) -> np.ndarray:
        """Structure factor of each shell, dimensionless."""
        return self._sums[2][self._filled] / self._sums[0][self._filled]

    @property
    def vectors(self) -> np.ndarray:
        """Number of wave vectors (one of +-q) per frame in each shell."""
        return self._sums[0][self._filled] / self._frames

    @property
    def error(self) -> np.ndarray:
        """S / sqrt(vectors): exponential scatter of each vector, all frames taken as one (an upper bound)."""
        return self.s / np.sqrt(self.vectors)

    def hyperuniformity(self, q_fit: float = 1.0) -> Hyperuniformity:
        """Fits of S over q <= `q_fit` (1/a), or over the four lowest shells where fewer lie below.

        Raises ConfigurationError where there are fewer than four shells in all.
        """
        return fit_small_q(self.q, self.s, self.vectors, q_fit)

    def table(self) -> dict[str, np.ndarray]:
        """q, S, its error, number of vectors."""
        return {"q[1/a]": self.q, "S[-]": self.s, "S_error[-]": self.error, "vectors[-]": self.vectors}

    def plot(self, ax) -> None:
        """S against q, logarithmic."""
        ax.errorbar(self.q, self.s, self.error, fmt=".-", linewidth=0.8)
        ax.set(xlabel=r"$q a$", ylabel=r"$S(q)$", xscale="log", yscale="log")

    def summary(self) -> dict[str, Any]:
        """S at the smallest wave vector, its peak, and the fits."""
        top = int(np.argmax(self.s))
        result = {
            "S_qmin[-]": float(self.s[0]),
            "qmin[1/a]": float(self.q[0]),
            "S_peak[-]": float(self.s[top]),
            "q_peak[1/a]": float(self.q[top]),
        }
        try:
            fit = self.hyperuniformity()
        except ConfigurationError as reason:
            return result | {"S_fit": f"none: {reason}"}
        return result | {f"S_{name}": value for name, value in fit._asdict().items()}


def _shell_edges(unit: float, q_max: float, width: float) -> np.ndarray:
    """Edges of the shells; the first one holds the smallest wave vectors only."""
    low = unit * np.arange(0.75, max(_FINE / unit, 1.0) + 0.5, 0.5)
    return np.append(low, np.arange(low[-1] + width, q_max + 0.5 * width, width))


def fit_small_q(q: np.ndarray, s: np.ndarray, vectors: np.ndarray, q_fit: float) -> Hyperuniformity:
    """Weighted fits s0 + c q^2 and q^alpha to S (n,) at q (n,) <= q_fit with relative errors 1/sqrt(vectors)."""
    if len(q) < 4:
        raise ConfigurationError(f"{len(q)} shells of wave vectors are too few to extrapolate S(q) to zero")
    used = np.arange(len(q)) < max(4, int(np.count_nonzero(q <= q_fit)))
    q_low, s_low, count = q[used], s[used], vectors[used]
    model = np.full_like(s_low, s_low.mean())
    basis = np.column_stack([np.ones_like(q_low), q_low**2])
    for _ in range(20):  # the scatter is proportional to S itself, which the fit gives
        weight = count / model**2
        normal = np.linalg.inv(basis.T @ (weight[:, None] * basis))
        model = np.maximum(basis @ (normal @ basis.T @ (weight * s_low)), 1e-3 * s_low)
    s0 = float((normal @ basis.T @ (weight * s_low))[0])
    line = np.column_stack([np.ones_like(q_low), np.log(q_low)])
    covariance = np.linalg.inv(line.T @ (count[:, None] * line))
    with np.errstate(divide="ignore"):
        alpha = float((covariance @ line.T @ (count * np.log(s_low)))[1])
    errors = float(np.sqrt(normal[0, 0])), float(np.sqrt(covariance[1, 1]))
    return Hyperuniformity(s0, errors[0], alpha, errors[1], s0 / float(s.max()), float(q_low[-1]))
