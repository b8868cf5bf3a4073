#!/usr/bin/env bash
# scipy's cKDTree counts spheres at exactly the given distance in query_pairs, query_ball_point and count_neighbors, and
# leaves them out in query(distance_upper_bound): a simple cubic lattice of touching spheres has coordination number 6
# or 0.
. "$(dirname "$0")/common.bash"
install scipy==1.17.1 numpy==2.4.6
measure <<'END'
import numpy as np
from finding import as_found, versions
from scipy.spatial import cKDTree

versions("scipy", "numpy")
nodes = 2.0 * np.arange(4)
lattice = np.stack(np.meshgrid(nodes, nodes, nodes), axis=-1).reshape(-1, 3)
N = len(lattice)
tree = cKDTree(lattice, boxsize=8.0)


def by_query(bound):
    return float(np.isfinite(tree.query(lattice, k=7, distance_upper_bound=bound)[0]).sum() - N) / N


numbers = {
    "query_pairs": 2 * len(tree.query_pairs(2.0)) / N,
    "query_ball_point": (sum(map(len, tree.query_ball_point(lattice, 2.0))) - N) / N,
    "count_neighbors": float(tree.count_neighbors(tree, 2.0) - N) / N,
    "query, bound 2": by_query(2.0),
    "query, bound the next number": by_query(np.nextafter(2.0, 3.0)),
}
print("coordination number at distance 2:", numbers)
as_found("6, 6, 6, then 0 and 6", list(numbers.values()) == [6, 6, 6, 0, 6])
END
