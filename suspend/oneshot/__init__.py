"""One-shot problems: one configuration, no motion.

    from suspend.oneshot import PeriodicScene, mobility_problem
    scene = PeriodicScene(positions=[[0, 0, 0], [2.1, 0, 0]], edge=12.0)
    answer = mobility_problem(scene, forces=[[1, 0, 0], [-1, 0, 0]], strain_rate=1.0)
    print(answer.U, answer.eta_r)

`mobility_problem` gives velocities and stresslets for loads and a flow, `resistance_problem` loads and stresslets
for velocities, `grand_mobility` and `grand_resistance` the dense matrices of small scenes.
"""

from __future__ import annotations

from suspend.oneshot.dense import grand_mobility, grand_resistance
from suspend.oneshot.problems import Loads, Motions, mobility_problem, resistance_problem
from suspend.oneshot.scene import Method, PeriodicScene, strain_rate_tensor

__all__ = [
    "Loads",
    "Method",
    "Motions",
    "PeriodicScene",
    "grand_mobility",
    "grand_resistance",
    "mobility_problem",
    "resistance_problem",
    "strain_rate_tensor",
]
