"""Forces between spheres that are not hydrodynamic: repulsion, contact; with their stress.

Repulsion of a pair at surface gap h (paper, Sec. II): F0 exp(-kappa h) along the line of centres. The
authors' code evaluates it at h - shift, and beyond h = shift holds it at F0 and adds a linear spring; that is
what `gap_shift` and `contact` are for. For h <= 0 the literal law goes on growing, F0 exp(kappa |h|); whether
such a configuration can occur at all is decided by the lubrication (`suspend.dynamics`). Units: F_stk, radii.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numba
import numpy as np

from suspend.core.jit import kernel, parallel_kernel, scalar
from suspend.core.pairs import separation

NEGLIGIBLE = 1e-13  # force (F_stk) below which the repulsion is not evaluated


class PairForce(NamedTuple):
    """Parameters of the pair force in F_stk and radii; stiffness 0 = no contact."""

    strength: float  # F0
    decay: float  # kappa
    shift: float  # the repulsion is evaluated at h - shift
    held: bool  # the repulsion is held at F0 for h < shift
    reach: float  # gap beyond which the repulsion is cut
    stiffness: float  # contact spring per overlap
    contact_gap: float  # contact begins at this gap


def pair_force(repulsion, contact) -> PairForce:
    """Parameters from the `repulsion` and `contact` sections of a configuration; either may be None."""
    strength = decay = shift = reach = 0.0
    if repulsion is not None and repulsion.force > 0.0:
        strength, decay, shift = repulsion.force, 1.0 / repulsion.debye_length, repulsion.gap_shift
        lengths = repulsion.cutoff
        if lengths is None:
            lengths = max(math.log(strength / NEGLIGIBLE), 0.0)
        reach = shift + lengths / decay
    stiffness = contact.stiffness if contact is not None else 0.0
    contact_gap = contact.gap_shift if contact is not None else 0.0
    return PairForce(strength, decay, shift, contact is not None, reach, stiffness, contact_gap)


def interaction_range(force: PairForce) -> float:
    """Centre distance beyond which the pair force vanishes; 0 if there is none."""
    gaps = [force.reach] * (force.strength > 0.0) + [max(force.contact_gap, 0.0)] * (force.stiffness > 0.0)
    return 2.0 + max(gaps) if gaps else 0.0


@scalar
def force_law(force, gap):
    """Repulsive force of a pair at `gap`, in F_stk; positive pushes the spheres apart."""
    value = 0.0
    if force.strength > 0.0 and gap < force.reach:
        x = gap - force.shift
        if force.held and x < 0.0:
            x = 0.0
        value = force.strength * math.exp(-force.decay * x)
    if force.stiffness > 0.0 and gap < force.contact_gap:
        value += force.stiffness * (force.contact_gap - gap)
    return value


@kernel
def _force_rows(first, last, placed, force, reach, load, stress, each):
    """Add pair forces of spheres first:last to `load` (N, 6), virial to `stress` (6,); returns the smallest gap.

    `each` (N, 6) takes the stress per sphere, half a pair's to either; pass a (0, 6) array to leave it out.
    """
    pairs, offset, position, edge, tilt = placed
    smallest = np.inf
    for i in range(first, last):
        for p in range(offset[i], offset[i + 1]):
            j = pairs[p, 1]
            dx, dy, dz = separation(pairs, p, position, edge, tilt)
            r2 = dx * dx + dy * dy + dz * dz
            if r2 >= reach * reach:
                continue
            r = math.sqrt(r2)
            smallest = min(smallest, r - 2.0)
            f = force_law(force, r - 2.0) / r
            load[i, 0] -= f * dx
            load[i, 1] -= f * dy
            load[i, 2] -= f * dz
            load[j, 0] += f * dx
            load[j, 1] += f * dy
            load[j, 2] += f * dz
            virial = (-f * dx * dx, -f * dy * dy, -f * dz * dz, -f * dx * dy, -f * dx * dz, -f * dy * dz)
            for c in range(6):
                stress[c] += virial[c]
                if each.shape[0] > 0:
                    each[i, c] += 0.5 * virial[c]
                    each[j, c] += 0.5 * virial[c]
    return smallest


@parallel_kernel
def _pair_forces(chunks, placed, force, reach, load):
    """Every thread's virial stress, and smallest gap; reductions in here would depend on the threads."""
    threads = chunks.shape[0] - 1
    partial = np.zeros((threads, load.shape[0], 6))
    stress = np.zeros((threads, 6))
    smallest = np.full(threads, np.inf)
    none = np.zeros((0, 6))
    for t in numba.prange(threads):
        smallest[t] = _force_rows(chunks[t], chunks[t + 1], placed, force, reach, partial[t], stress[t], none)
    for t in range(threads):
        load += partial[t]
    return stress, smallest


def pair_forces(chunks, placed, force, reach, load):
    """Add the pair forces within centre distance `reach` to `load` (N, 6).

    chunks : (T + 1,) int64, spheres of each thread; placed : `PlacedPairs` that hold all pairs within `reach`.
    Returns (virial stress summed over spheres, -1/2 sum_j (x_i - x_j) F_ij, six components in F_stk a;
    smallest gap within `reach`).
    """
    stress, smallest = _pair_forces(chunks, placed, force, reach, load)
    return stress.sum(axis=0), smallest.min()


def stress_per_sphere(placed, force, reach) -> np.ndarray:
    """Interparticle stress of each sphere, -1/2 sum_j (x_i - x_j) F_ij, (N, 6) in F_stk a."""
    number = placed.position.shape[0]
    each = np.zeros((number, 6))
    load, total = np.zeros((number, 6)), np.zeros(6)
    _force_rows(0, number, placed, force, reach, load, total, each)
    return each
