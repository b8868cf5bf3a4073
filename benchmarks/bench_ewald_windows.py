"""Windows of the far field's wave part: grid, support, time and delivered error of each kind at equal accuracy.

    NUMBA_NUM_THREADS=1 python benchmarks/bench_ewald_windows.py [--number 4096] [--cutoff 4] [--output FILE]

Spheres at random, phi = 0.4, tilt 0.5, PSWF split of the same error; every kind gets the cheapest grid and support for
that error (`choose_window`). Times are the least of 15, one thread. The error is relative to the norm of the whole
mobility product for random unit loads, against the same product on a grid with an error 1e-3 times smaller or less.
"""

from __future__ import annotations

import argparse
import csv
import math
import time
from pathlib import Path

import numpy as np

from suspend.hydro.ewald.split import pswf_split
from suspend.hydro.ewald.wave import WavePart
from suspend.hydro.ewald.windows import KINDS, choose_window, wave_cost, whole_norm

RESULTS = Path(__file__).parent / "results" / "ewald_windows.csv"
COLUMNS = ["number", "cutoff", "kmax", "asked", "window", "grid", "support", "shape", "delivered", "add_ms", "fft_ms",
           "ratio_to_fft", "place_ms", "model_ms"]  # fmt: skip


def least_time(work, repeats: int = 15) -> float:
    """Least wall-clock time in ms."""
    times = []
    for _ in range(repeats):
        clock = time.perf_counter()
        work()
        times.append(time.perf_counter() - clock)
    return 1e3 * min(times)


def transform(wave: WavePart) -> None:
    wave.transforms.to_modes()
    wave.transforms.to_grid()


def product(wave: WavePart, position: np.ndarray, loads: np.ndarray) -> np.ndarray:
    wave.place(position, 0.5)
    result = np.zeros_like(loads)
    wave.add(loads, result)
    return result


def compare(number: int, cutoff: float, error: float) -> list[list]:
    edge = (number * 4.0 * math.pi / 3.0 / 0.4) ** (1.0 / 3.0)
    rng = np.random.default_rng(1)
    position, loads = edge * rng.random((number, 3)), rng.standard_normal((number, 11))
    split = pswf_split(cutoff, error)
    fine = choose_window(split, edge, max(1e-3 * error, 2e-12), number, "pswf")
    exact = product(WavePart(edge, split, *fine), position, loads)
    rows = []
    for kind in KINDS:
        grid, window = choose_window(split, edge, error, number, kind)
        wave = WavePart(edge, split, grid, window)
        result = product(wave, position, loads)
        delivered = np.linalg.norm(result - exact) / (whole_norm(number, edge) * math.sqrt(number))
        add = least_time(lambda w=wave, r=result: w.add(loads, r))
        place = least_time(lambda w=wave: w.place(position, 0.5))
        fft = least_time(lambda w=wave: transform(w))
        model = 1e3 * wave_cost(number, grid, wave.largest, window.support)
        shown = [f"{x:.4g}" for x in (window.shape, delivered, add, fft, add / fft, place, model)]
        size = "x".join(map(str, grid))
        rows.append([number, cutoff, f"{split.kmax:.4g}", error, kind, size, window.support, *shown])
        print(*rows[-1], flush=True)
    return rows


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--number", type=int, nargs="+", default=[500, 4096])
    parser.add_argument("--cutoff", type=float, default=4.0, help="real-space cutoff of the split, radii")
    parser.add_argument("--output", type=Path, default=RESULTS)
    options = parser.parse_args()
    print(*COLUMNS)
    rows = [row for n in options.number for e in (1e-3, 1e-6, 1e-9) for row in compare(n, options.cutoff, e)]
    with options.output.open("w", newline="") as file:
        csv.writer(file, lineterminator="\n").writerows([COLUMNS, *rows])


if __name__ == "__main__":
    main()
