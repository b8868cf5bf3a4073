"""Time and structure of random packings against volume fraction: writes results/packing.csv beside this file.

    python benchmarks/bench_packing.py [N ...]

Default N: 500 and 10,000. Compilation is not counted. One core.
"""

from __future__ import annotations

import csv
import sys
from pathlib import Path

from suspend.packing import random_packing

FRACTIONS = (0.1, 0.2, 0.3, 0.4, 0.45, 0.5, 0.55, 0.6)
SEED = 1
COLUMNS = {
    "seconds": "seconds",
    "sweeps": "sweeps",
    "minimum_gap": "minimum_gap [a]",
    "contact_value": "g_contact",
    "contact_error": "g_contact standard error",
    "equilibrium_contact_value": "g_contact Carnahan-Starling",
    "global_q6": "Q6 global",
    "local_q6": "q6 local mean",
    "crystal_fraction": "crystalline share",
    "rms_travel": "rms travel [a]",
    "equilibrium": "equilibrium fluid",
}


def main(numbers: list[int]) -> None:
    random_packing(50, 0.3)  # compiles
    target = Path(__file__).parent / "results" / "packing.csv"
    with open(target, "w", newline="") as file:
        table = csv.writer(file)
        table.writerow(["N", "phi", *COLUMNS.values()])
        for number in numbers:
            for fraction in FRACTIONS:
                packing = random_packing(number, fraction, seed=SEED)._asdict()
                values = [packing[name] for name in COLUMNS]
                row = [f"{v:.5g}" if isinstance(v, float) else v for v in values]
                table.writerow([number, fraction, *row])
                print(number, fraction, *row, flush=True)


if __name__ == "__main__":
    main([int(word) for word in sys.argv[1:]] or [500, 10_000])
