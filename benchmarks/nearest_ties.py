"""Largest cluster of the nearest-neighbour graph of quenched starts against the gap that counts as a tie.

Random points pushed apart leave neighbours nearly tied at r = 2.002 a. Linking each sphere to all neighbours within
`tie` of its nearest shows what a round-off of that size makes of the clusters.
    python benchmarks/nearest_ties.py [--number 500 4096] [--phi 0.4] [--seeds 5]
"""

import argparse

import numpy as np
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from suspend.packing import quenched_packing

TIES = (0.0, 1e-7, 1e-6, 2e-6, 5e-6, 1e-5, 1e-4)  # radii
NEIGHBOURS = 12


def largest_cluster(positions: np.ndarray, length: float, tie: float) -> float:
    """Share of the spheres in the largest cluster; positions (N, 3) in [0, L)."""
    distance, other = cKDTree(positions, boxsize=length).query(positions, k=NEIGHBOURS + 1)
    linked = distance[:, 1:] <= distance[:, 1:2] + tie
    first = np.repeat(np.arange(len(positions)), linked.sum(axis=1))
    graph = coo_matrix((np.ones(len(first)), (first, other[:, 1:][linked])), shape=(len(positions),) * 2)
    return float(np.bincount(connected_components(graph, directed=False)[1]).max() / len(positions))


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--number", type=int, nargs="+", default=[500, 4096])
    parser.add_argument("--phi", type=float, default=0.4)
    parser.add_argument("--seeds", type=int, default=5)
    arguments = parser.parse_args()
    print("N      tie/a    largest cluster in % of N: mean (smallest, largest) over the seeds")
    for number in arguments.number:
        packings = [quenched_packing(number, arguments.phi, 1e-3, seed) for seed in range(1, arguments.seeds + 1)]
        for tie in TIES:
            share = [100.0 * largest_cluster(p.positions, p.length, tie) for p in packings]
            print(f"{number:<6} {tie:<8g} {np.mean(share):.1f} ({min(share):.1f}, {max(share):.1f})")


if __name__ == "__main__":
    main()
