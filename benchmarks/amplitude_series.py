"""Amplitude series of the paper at one volume fraction, near field only, to total strain 256.

    python benchmarks/amplitude_series.py OUT [--phi 0.4] [--seed 1] [--strain 256]
        [--start quenched] [--amplitudes 0.1 0.2 ...]

Runs (or continues) `configs/paper.yaml` for every amplitude from the same starting configuration into OUT and
writes OUT/series.csv: amplitude, moduli averaged over the last cycles, first and last D_cyc, evaluations,
wall time.
"""

from __future__ import annotations

import argparse
import csv
from pathlib import Path

from suspend.analysis.summary import analyze
from suspend.config import load
from suspend.simulation import run

AMPLITUDES = (0.1, 0.2, 0.4, 0.6, 0.8, 1.0, 1.2, 1.6, 2.0, 3.2)
PAPER = Path(__file__).parent.parent / "configs" / "paper.yaml"


def row(directory: Path, amplitude: float) -> dict:
    result = analyze(directory)
    mean = {name.partition("[")[0]: value["mean"] for name, value in result.averages().items()}
    statistics = result.statistics
    return {
        "gamma0": amplitude,
        "cycles": len(result.total_strain),
        "total_strain": result.total_strain[-1],
        "averaged_cycles": result.last,
        "eta_r_prime": mean["eta_r_prime"],
        "eta_r_double_prime": mean["eta_r_double_prime"],
        "minus_eta3_over_eta1": mean["minus_eta3_over_eta1"],
        "N1_nu0": mean["N1_nu0"],
        "N2_nu0": mean["N2_nu0"],
        "N2_nu4_over_nu2": mean["N2_nu4_abs"] / mean["N2_nu2_abs"],
        "D_first": result.d_cyc[0],
        "D_last": result.d_cyc[-1],
        "evaluations": statistics["evaluations"],
        "evaluations_per_strain": statistics["evaluations"] / result.total_strain[-1],
        "minimum_gap": statistics["minimum_gap"],
        "wall_time": statistics["wall_time"],
    }


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("out", type=Path)
    parser.add_argument("--phi", type=float, default=0.4)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--strain", type=float, default=256.0)
    parser.add_argument("--start", default="quenched", help="particles.initial: quenched or equilibrium")
    parser.add_argument("--amplitudes", type=float, nargs="+", default=AMPLITUDES)
    arguments = parser.parse_args()
    rows = []
    for amplitude in arguments.amplitudes:
        config = load(
            PAPER,
            [
                f"particles.initial={arguments.start}",
                f"flow.amplitude={amplitude}",
                f"particles.volume_fraction={arguments.phi}",
                f"seed={arguments.seed}",
                f"duration.strain={arguments.strain}",
                "output.position_phases=[0, 0.5]",
            ],
        )
        directory = arguments.out / f"gamma0_{amplitude:g}"
        summary = run(config, directory, threads=1)
        print("\n".join(summary.lines()), flush=True)
        rows.append({"phi": arguments.phi, "seed": arguments.seed} | row(directory, amplitude))
        with open(arguments.out / "series.csv", "w", newline="") as file:
            writer = csv.DictWriter(file, rows[0].keys())
            writer.writeheader()
            writer.writerows(rows)


if __name__ == "__main__":
    main()
