"""Nearest-neighbour graph: clusters of spheres linked to their nearest neighbours, their sizes and shapes."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from suspend.analysis.microstructure.snapshot import LAST, FrameQuantity, Frames, Snapshot, tabulate_frames

_OWN_INERTIA = 0.4  # of a solid sphere of unit mass and radius about its centre


class Clusters(NamedTuple):
    """Clusters of one configuration."""

    label: np.ndarray  # (N,) int, cluster of each sphere
    size: np.ndarray  # (C,) int, number of spheres
    shape: np.ndarray  # (C,) sqrt(I_max / I_min)


def shape_factor(position: np.ndarray, label: np.ndarray | None = None) -> np.ndarray:
    """sqrt(I_max/I_min) of rigid clusters of solid spheres; position (N,3) in radii, not wrapped.

    I_c = sum over the spheres of (2/5) I + |d|^2 I - d d, d from the cluster's centre: with the spheres' own
    inertia a doublet at distance r has sqrt(1 + (5/8) r^2): 1.938 at 2.1 a. With the inertia of points, I_min of a
    doublet would be zero. `label` (N,): clusters 0..C-1, by default one. Returns (C,).
    """
    position = np.asarray(position, float)
    label = np.zeros(len(position), int) if label is None else label
    size = np.bincount(label)
    centre = np.column_stack([np.bincount(label, x) for x in position.T]) / size[:, None]
    d = position - centre[label]
    gyration = np.empty((len(size), 3, 3))
    for i in range(3):
        for j in range(3):
            gyration[:, i, j] = np.bincount(label, d[:, i] * d[:, j])
    trace = np.trace(gyration, axis1=1, axis2=2) + _OWN_INERTIA * size
    inertia = trace[:, None, None] * np.eye(3) - gyration
    values = np.linalg.eigvalsh(inertia)
    return np.sqrt(values[:, -1] / values[:, 0])


def nearest_clusters(snapshot: Snapshot) -> Clusters:
    """Clusters of the graph that links each sphere to its nearest neighbour (ties: any one of them).

    The positions of a cluster are laid out from one of its spheres along the links, across the faces of the
    cell. A lone sphere (N = 1) is a cluster of size and shape 1. A cluster that closes on itself around the
    cell (perfect lattices) has no shape of its own: it gets that of the links taken first.
    """
    n = snapshot.number
    if n == 1:
        return Clusters(np.zeros(1, int), np.ones(1, int), np.ones(1))
    _, index, vector = snapshot.nearest(1)
    here, there = np.arange(n), index[:, 0]
    _, label = connected_components(coo_array((np.ones(n), (here, there)), shape=(n, n)), directed=False)
    start, end = np.concatenate([here, there]), np.concatenate([there, here])
    step = np.concatenate([vector[:, 0], -vector[:, 0]])
    position, placed = np.zeros((n, 3)), np.zeros(n, bool)
    placed[np.unique(label, return_index=True)[1]] = True
    while True:  # one ring of links further from the first sphere of each cluster
        new = placed[start] & ~placed[end]
        if not new.any():
            break
        position[end[new]] = position[start[new]] + step[new]
        placed[end[new]] = True
    return Clusters(label, np.bincount(label), shape_factor(position, label))


class NearestNeighbourGraph(FrameQuantity):
    """Sizes and shape factors of the clusters of the nearest-neighbour graph, over all chosen frames.

    `width` of the bins of the shape factor. Parameter-free otherwise.
    """

    def __init__(self, frames: Frames = LAST, width: float = 0.05):
        self.frames, self.width = frames, width

    def begin(self) -> None:
        """Forget earlier results."""
        self._sizes, self._shapes, self._when, self._number = [], [], [], 0

    def add(self, snapshot: Snapshot) -> None:
        """Take the clusters of one configuration."""
        clusters = nearest_clusters(snapshot)
        self._sizes.append(clusters.size)
        self._shapes.append(clusters.shape)
        self._when.append((snapshot.total_strain, snapshot.cycle))
        self._number = snapshot.number

    @property
    def sizes(self) -> np.ndarray:
        """Number of spheres of every cluster of every frame."""
        return np.concatenate(self._sizes)

    @property
    def shapes(self) -> np.ndarray:
        """Shape factor sqrt(I_max/I_min) of every cluster, in the order of `sizes`."""
        return np.concatenate(self._shapes)

    @property
    def size_distribution(self) -> tuple[np.ndarray, np.ndarray]:
        """Sizes 1, 2, ... and the share of the clusters that have them."""
        counts = np.bincount(self.sizes)[1:]
        return np.arange(1, len(counts) + 1), counts / counts.sum()

    @property
    def shape_distribution(self) -> tuple[np.ndarray, np.ndarray]:
        """Middles of the bins of the shape factor (from 1) and the probability density there."""
        bins = math.floor((self.shapes.max() - 1.0) / self.width) + 1
        edges = 1.0 + self.width * np.arange(bins + 1)
        counts = np.histogram(self.shapes, edges)[0]
        return 0.5 * (edges[1:] + edges[:-1]), counts / (counts.sum() * self.width)

    @property
    def largest_share(self) -> np.ndarray:
        """Share of the spheres in the largest cluster, per frame."""
        return np.array([size.max() for size in self._sizes]) / self._number

    @property
    def mean_size(self) -> np.ndarray:
        """Mean number of spheres of a cluster, per frame."""
        return np.array([size.mean() for size in self._sizes])

    @property
    def total_strain(self) -> np.ndarray:
        """gamma_tot of the frames."""
        return tabulate_frames(self._when)["total_strain[-]"]

    def table(self) -> dict[str, np.ndarray]:
        """Share of the clusters and of the spheres by size."""
        size, share = self.size_distribution
        return {"size[-]": size, "clusters[share]": share, "spheres[share]": size * share / (size * share).sum()}

    def shape_table(self) -> dict[str, np.ndarray]:
        """Probability density of the shape factor."""
        middle, density = self.shape_distribution
        return {"shape_factor[-]": middle, "density[-]": density}

    def evolution_table(self) -> dict[str, np.ndarray]:
        """Mean and largest size per frame."""
        series = {"mean_size[-]": self.mean_size, "largest_cluster[share]": self.largest_share}
        return tabulate_frames(self._when) | series

    def plot(self, ax) -> None:
        """Share of the clusters by size."""
        size, share = self.size_distribution
        ax.bar(size, share, width=0.8)
        ax.set(xlabel="cluster size", ylabel="share of clusters")

    def plot_shapes(self, ax) -> None:
        """Probability density of the shape factor."""
        middle, density = self.shape_distribution
        ax.bar(middle, density, width=self.width)
        ax.set(xlabel=r"shape factor $\sqrt{I_{max}/I_{min}}$", ylabel="probability density")

    def summary(self) -> dict[str, Any]:
        """Mean and largest size, share of clusters below 4 spheres, most frequent shape factor."""
        middle, density = self.shape_distribution
        return {
            "cluster_size_mean[-]": float(self.sizes.mean()),
            "cluster_size_below_4[share]": float(np.mean(self.sizes < 4)),
            "cluster_largest[share]": float(self.largest_share.max()),
            "shape_factor_mode[-]": float(middle[np.argmax(density)]),
        }


class NeighbourDistances(FrameQuantity):
    """Mean distance to the k-th nearest neighbour, k = 1..`count` (fewer where N - 1 is less)."""

    def __init__(self, frames: Frames = LAST, count: int = 16):
        self.frames, self.count = frames, count

    def begin(self) -> None:
        """Forget earlier results."""
        self._rows, self._when = [], []

    def add(self, snapshot: Snapshot) -> None:
        """Average over the spheres of one configuration."""
        k = min(self.count, snapshot.number - 1)
        row = snapshot.nearest(k)[0].mean(axis=0) if k else np.empty(0)
        self._rows.append(row)
        self._when.append((snapshot.total_strain, snapshot.cycle))

    @property
    def k(self) -> np.ndarray:
        """1, 2, ..."""
        return np.arange(1, len(self._rows[0]) + 1)

    @property
    def per_frame(self) -> np.ndarray:
        """Mean distance over the spheres, in radii, shape (frames, k)."""
        return np.array(self._rows)

    @property
    def distance(self) -> np.ndarray:
        """Mean distance to the k-th neighbour over spheres and frames, in radii, shape (k,)."""
        return self.per_frame.mean(axis=0)

    @property
    def total_strain(self) -> np.ndarray:
        """gamma_tot of the frames."""
        return tabulate_frames(self._when)["total_strain[-]"]

    def table(self) -> dict[str, np.ndarray]:
        """k and mean distance."""
        return {"k[-]": self.k, "distance[a]": self.distance}

    def plot(self, ax) -> None:
        """Mean distance against k."""
        ax.plot(self.k, self.distance, "o-")
        ax.set(xlabel=r"$k$", ylabel=r"$\langle r_k \rangle / a$")

    def summary(self) -> dict[str, Any]:
        """Mean distance to the nearest neighbour."""
        return {"r1[a]": float(self.distance[0]) if len(self.k) else float("nan")}
