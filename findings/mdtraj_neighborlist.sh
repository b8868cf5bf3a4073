#!/usr/bin/env bash
# mdtraj: compute_neighborlist misses neighbours in tilted cells, at tilts well within 1/2, where compute_distances and
# compute_neighbors of the same package, cell and positions are right.
. "$(dirname "$0")/common.bash"
install mdtraj==1.11.1.post2 numpy==2.4.6
measure <<'END'
import mdtraj
import numpy as np
from finding import as_found, distances, sheared_cell, versions

versions("mdtraj", "numpy")
EDGE, N, CUTOFF = 10.0, 200, 3.0
topology = mdtraj.Topology()
residue = topology.add_residue("X", topology.add_chain())
for _ in range(N):
    topology.add_atom("X", mdtraj.element.virtual, residue)
fractions = np.random.default_rng(1).random((N, 3))
first, second = np.triu_indices(N, 1)
missed = {}
for tilt in (-0.5, -0.25, 0.0, 0.25, 0.5):
    cell = sheared_cell(EDGE, tilt)
    trajectory = mdtraj.Trajectory((fractions @ cell)[None].astype("f4"), topology)
    trajectory.unitcell_vectors = cell[None].astype("f4")
    truth = distances(fractions @ cell, cell)
    pairs = mdtraj.compute_distances(trajectory, np.column_stack([first, second]))[0]
    error = np.abs(pairs - truth[first, second]).max()
    wanted = (truth < CUTOFF).sum() - N
    missed[tilt] = wanted - sum(map(len, mdtraj.compute_neighborlist(trajectory, CUTOFF)))
    print(f"tilt {tilt:5}: neighbours {wanted}, missed {missed[tilt]}, largest error of compute_distances {error:.1g}")
    as_found("compute_distances is right to single precision", error < 1e-5)
as_found("none missed in the cube", missed[0.0] == 0)
as_found("neighbours missed at tilts of both signs", missed[0.25] > 0 and missed[0.5] > 0 and missed[-0.5] > 0)
END
