"""Table of the phase diagram that grows: complete points of sweeps, merged into one CSV file.

    python benchmarks/phase_table.py docs/figures/phase_diagram.csv SWEEP_FOLDER ...

One row a complete point, by model (near: far_field self; far: ewald; authors: the preset of authors.yaml), volume
fraction, amplitude and seed. Rows whose points are not in the sweeps stay, so that parts of configs/phase_diagram.yaml
can be computed on several machines and days. A point computed anew replaces its row.
"""

from __future__ import annotations

import csv
import sys
from pathlib import Path

from suspend.config import loads
from suspend.io.csv_text import write_csv_file
from suspend.sweep.collect import collect

KEY = ("model", "phi[-]", "gamma0[-]", "seed")
COLUMNS = (
    "cycles", "averaged_cycles", "total_strain[-]", "run_time[s]", "evaluations", "minimum_gap[a]",
    "eta_r_prime[-]", "eta_r_prime_error[-]", "eta_r_double_prime[-]", "eta_r_double_prime_error[-]",
    "minus_eta3_over_eta1[-]", "minus_eta3_over_eta1_error[-]", "eta5_over_eta1[-]", "eta5_over_eta1_error[-]",
    "eta1_prime[eta0]", "eta1_prime_hydrodynamic[eta0]", "eta1_prime_interparticle[eta0]",
    "N1_nu0[eta0]", "N1_nu0_error[eta0]", "N1_nu0_hydrodynamic[eta0]",
    "N2_nu0[eta0]", "N2_nu0_error[eta0]", "N2_nu0_interparticle[eta0]",
    "minus_N2_nu0[eta0]", "minus_N2_nu0_error[eta0]", "nu4_over_nu2[-]", "nu4_over_nu2_error[-]",
    "D_cyc[-]", "D_cyc_error[-]", "cyclic_diffusivity_D_cyc", "active_fraction_first", "active_fraction_last",
    "relaxation_state", "drifting", "structure_initial_S_qmin[-]", "structure_S_qmin[-]", "structure_initial_r1[a]",
    "structure_r1[a]", "structure_initial_cluster_largest[share]", "structure_cluster_largest[share]",
    "structure_cluster_size_below_4[share]", "structure_beta_first[-]", "structure_beta_last[-]",
    "structure_Q6_first[-]", "structure_Q6_last[-]", "structure_crystalline_last[share]",
)  # fmt: skip
DIGITS = 6


def model_of(folder: Path) -> str:
    """Which of the three models of the phase diagram a point has."""
    config = loads((folder / "configuration.yaml").read_text(encoding="utf-8"), source=str(folder))
    return {"self": "near", "ewald": "far", "identity": "authors"}[config.far_field]


def rows_of(sweep: Path) -> list[dict[str, str]]:
    """Complete points of a sweep, with the columns of the table."""
    rows = []
    for row in collect(sweep, say=print):
        if row["state"] == "complete":
            row = row | {"model": model_of(sweep / row["point"])}
            rows.append({name: _text(row.get(name)) for name in (*KEY, *COLUMNS)})
    return rows


def _text(value) -> str:
    if isinstance(value, float):
        return f"{value:.{DIGITS}g}"
    return "" if value is None else str(value)


def merged(path: Path, fresh: list[dict[str, str]]) -> list[dict[str, str]]:
    """The table's rows with the fresh ones, in order."""
    table = {}
    if path.exists():
        with open(path, newline="", encoding="utf-8") as file:
            table = {tuple(row[name] for name in KEY): row for row in csv.DictReader(file)}
    table |= {tuple(row[name] for name in KEY): row for row in fresh}
    order = {"near": 0, "far": 1, "authors": 2}
    return [table[key] for key in sorted(table, key=lambda k: (order[k[0]], *map(float, k[1:])))]


if __name__ == "__main__":
    path, *sweeps = map(Path, sys.argv[1:])
    rows = merged(path, [row for sweep in sweeps for row in rows_of(sweep)])
    names = (*KEY, *COLUMNS)
    write_csv_file(path, [list(names), *([row.get(name, "") for name in names] for row in rows)])
    print(f"{path}: {len(rows)} points")
