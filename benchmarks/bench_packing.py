"""Time and structure of both kinds of packing against volume fraction: writes results/packing.csv beside this file.

    python benchmarks/bench_packing.py [N ...]

Default N: 500 and 10,000. Seconds of processor time, one core; compilation is not counted.
"""

from __future__ import annotations

import csv
import itertools
import sys
import time
from pathlib import Path

from suspend.fluctuations import smallest_wave_structure, variance_exponent
from suspend.packing import PACKINGS

FRACTIONS = (0.1, 0.2, 0.3, 0.4, 0.45, 0.5, 0.55, 0.6)
SEED = 1
COLUMNS = {
    "cpu": "seconds (CPU)",
    "sweeps": "sweeps",
    "relaxation_steps": "relaxation steps",
    "minimum_gap": "minimum_gap [a]",
    "contact_value": "g_contact",
    "contact_error": "g_contact standard error",
    "equilibrium_contact_value": "g_contact Carnahan-Starling",
    "global_q6": "Q6 global",
    "local_q6": "q6 local mean",
    "crystal_fraction": "crystalline share",
    "rms_travel": "rms travel [a]",
    "needed_travel": "travel for long waves [a]",
    "s_qmin": "S(qmin)",
    "beta0": "beta0",
    "equilibrium": "equilibrium fluid",
    "long_waves": "long waves too",
}


def measured(kind: str, number: int, fraction: float) -> dict:
    """A packing's fields, the processor time it took, and its density fluctuations."""
    before = time.process_time()
    packing = PACKINGS[kind](number, fraction, seed=SEED)
    cpu = time.process_time() - before
    x, length = packing.positions, packing.length
    found = {"s_qmin": smallest_wave_structure(x, length), "beta0": variance_exponent(x, length)}
    return packing._asdict() | found | {"cpu": cpu}


def main(numbers: list[int]) -> None:
    for make in PACKINGS.values():
        make(50, 0.3)  # compiles
        make(50, 0.6)
    target = Path(__file__).parent / "results" / "packing.csv"
    with open(target, "w", newline="") as file:
        table = csv.writer(file)
        table.writerow(["start", "N", "phi", *COLUMNS.values()])
        for kind, number, fraction in itertools.product(PACKINGS, numbers, FRACTIONS):
            packing = measured(kind, number, fraction)
            row = [f"{v:.5g}" if isinstance(v, float) else v for v in (packing[name] for name in COLUMNS)]
            table.writerow([kind, number, fraction, *row])
            print(kind, number, fraction, *row, flush=True)


if __name__ == "__main__":
    main([int(word) for word in sys.argv[1:]] or [500, 10_000])
