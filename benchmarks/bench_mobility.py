"""Time of a mobility product and its parts; the constants of the cost model of the real part; growth and memory with N.

    NUMBA_NUM_THREADS=1 OMP_NUM_THREADS=1 python benchmarks/bench_mobility.py [--number 500 4096] [--tolerance 1e-3]
    python benchmarks/bench_mobility.py --calibrate

Random packings, tilt 0.2. "fft" is the transforms alone; "total" the product of `Mobility.apply`; "place" what an
evaluation pays once for new positions. Memory counts arrays of the far field and its neighbour list.
"""

from __future__ import annotations

import argparse
import time

import numpy as np

from suspend.hydro.ewald.mobility import Mobility
from suspend.hydro.ewald.parameters import choose_parameters
from suspend.hydro.neighbours import find_pairs
from suspend.packing import random_packing

TILT = 0.2


def median_ms(function, repeats: int) -> float:
    function()
    times = []
    for _ in range(repeats):
        clock = time.perf_counter()
        function()
        times.append(time.perf_counter() - clock)
    return 1e3 * float(np.median(times))


def scene(number: int, phi: float) -> tuple[np.ndarray, float]:
    """A packing; above 4096 spheres copies of one of 1/8 or 1/27 of them, which costs no hours to make."""
    copies = 1 if number <= 8192 else round((number / 4096.0) ** (1.0 / 3.0))
    packing = random_packing(max(1, number // copies**3), phi, 1e-3, 1)
    shift = packing.length * np.stack(np.meshgrid(*[np.arange(copies)] * 3, indexing="ij"), -1).reshape(-1, 3)
    position = (packing.positions[None] + shift[:, None]).reshape(-1, 3)
    edge = copies * packing.length
    position[:, 0] = (position[:, 0] - TILT * position[:, 1]) % edge + TILT * position[:, 1]  # into the sheared cell
    return position, edge


def array_bytes(holder, seen: set) -> int:
    """Bytes of the arrays an object holds, directly or in tuples and its own objects, each buffer once."""
    if isinstance(holder, np.ndarray):
        while isinstance(holder.base, np.ndarray):
            holder = holder.base
        known = id(holder) in seen
        seen.add(id(holder))
        return 0 if known else holder.nbytes
    if isinstance(holder, (tuple, list)):
        return sum(array_bytes(item, seen) for item in holder)
    return sum(array_bytes(v, seen) for v in vars(holder).values()) if hasattr(holder, "__dict__") else 0


def measure(number: int, phi: float, tolerance: float, threads: int) -> None:
    position, edge = scene(number, phi)
    number = len(position)
    parameters = choose_parameters(tolerance, number, edge)
    mobility = Mobility(edge, number, parameters, threads)
    pairs, offset = find_pairs(position, edge, TILT, mobility.cutoff)
    loads, result = np.random.default_rng(1).standard_normal((number, 11)), np.zeros((number, 11))
    repeats = 21 if number <= 8192 else 5
    place = median_ms(lambda: mobility.place(position, TILT, pairs, offset), repeats)
    total = median_ms(lambda: mobility.apply(loads), repeats)
    real = median_ms(lambda: mobility.real.add(loads, result), repeats)
    wave = median_ms(lambda: mobility.wave.add(loads, result), repeats)
    transforms = mobility.wave.transforms
    fft = median_ms(transforms.to_modes, repeats) + median_ms(transforms.to_grid, repeats)
    held = array_bytes((mobility.real, mobility.wave, pairs, offset), set())
    print(
        f"N {number}, phi {phi:g}, tolerance {tolerance:g}, threads {threads}: total {total:.3f} ms (predicted "
        f"{1e3 * parameters.seconds:.3f}), real {real:.3f}, wave {wave:.3f}, of it fft {fft:.3f}; total/fft "
        f"{total / fft:.2f}; place {place:.2f}; {1e3 * total / number:.3f} us and {held / number / 1e3:.2f} kB per "
        f"sphere; r_c {mobility.cutoff:.2f}, {mobility.real.number_of_pairs} pairs, grid {parameters.grid}, P "
        f"{parameters.window.support}",
        flush=True,
    )


def calibrate(number: int) -> None:
    """PER_PAIR and PER_SPHERE of `suspend.hydro.ewald.parameters` by least squares over cutoffs."""
    position, edge = scene(number, 0.4)
    rows, times = [], []
    for cutoff in (2.6, 3.0, 3.5, 4.0, 4.5, 5.0, 5.5):
        mobility = Mobility(edge, number, choose_parameters(1e-3, number, edge, cutoff=cutoff))
        mobility.place(position, TILT, *find_pairs(position, edge, TILT, cutoff))
        loads, result = np.ones((number, 11)), np.zeros((number, 11))
        product = median_ms(lambda m=mobility, x=loads, y=result: m.real.add(x, y), 15)
        place = median_ms(lambda m=mobility: m.real.place(position, edge, TILT), 7)
        rows.append([mobility.real.number_of_pairs, number])
        times.append(1e-3 * (product + 0.1 * place))
    per_pair, per_sphere = np.linalg.lstsq(np.array(rows, float), np.array(times), rcond=None)[0]
    print(f"N {number}: PER_PAIR, PER_SPHERE = {per_pair:.2g}, {per_sphere:.2g}")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--number", type=int, nargs="+", default=[500, 4096])
    parser.add_argument("--volume-fraction", type=float, default=0.4)
    parser.add_argument("--tolerance", type=float, nargs="+", default=[1e-3])
    parser.add_argument("--threads", type=int, default=1)
    parser.add_argument("--calibrate", action="store_true")
    arguments = parser.parse_args()
    for number in arguments.number:
        if arguments.calibrate:
            calibrate(number)
            continue
        for tolerance in arguments.tolerance:
            measure(number, arguments.volume_fraction, tolerance, arguments.threads)


if __name__ == "__main__":
    main()
