#!/usr/bin/env bash
# MDAnalysis: observables of an H5MD file are picked by the number of the frame, not by their own step or time. Sampled
# more often than the positions, as stresses are, each frame shows the wrong sample in silence; sampled for the last
# frames only, the first ones show them and a later one ends with IndexError.
. "$(dirname "$0")/common.bash"
install MDAnalysis==2.11.0 h5py==3.16.0 numpy==2.4.6
measure <<'END'
import warnings

import h5py
import numpy as np
from finding import as_found, versions

warnings.filterwarnings("ignore")
import MDAnalysis as mda

versions("MDAnalysis", "h5py", "numpy")
open("top.xyz", "w").write("1\n\nX 0 0 0\n")


def element(file, path, time, value, unit=None):
    group = file.create_group(path)
    group["step"], group["time"], group["value"] = np.rint(10 * time).astype(int), time, value
    group["time"].attrs["unit"] = "ps"
    if unit:
        group["value"].attrs["unit"] = unit


def universe(path, sample_times):
    frames = np.arange(4.0)
    with h5py.File(path, "w") as file:
        file.create_group("h5md").attrs["version"] = [1, 1]
        file.create_group("h5md/author").attrs["name"] = "nobody"
        file.create_group("h5md/creator").attrs.update(name="none", version="1")
        file.create_group("particles/all/box").attrs.update(dimension=3, boundary=["periodic"] * 3)
        element(file, "particles/all/position", frames, np.zeros((4, 1, 3)), "Angstrom")
        element(file, "particles/all/box/edges", frames, np.tile(9 * np.eye(3), (4, 1, 1)), "Angstrom")
        element(file, "observables/stress", sample_times, sample_times)  # its value is its own time
    return mda.Universe("top.xyz", path)


often = universe("often.h5md", np.arange(0, 3.5, 0.5))
pairs = [(float(ts.time), float(ts.data["stress"])) for ts in often.trajectory]
print("frame time, time of the sample shown:", pairs)
as_found("twice as many samples as frames: the samples of half the time", pairs == [(t, t / 2) for t in range(4)])

late = universe("late.h5md", np.array([2.0, 3.0]))
pairs = [(float(late.trajectory[i].time), float(late.trajectory[i].data["stress"])) for i in range(2)]
print("sampled at times 2 and 3 only:", pairs)
as_found("the samples of times 2 and 3 shown at times 0 and 1", pairs == [(0.0, 2.0), (1.0, 3.0)])
try:
    late.trajectory[2]
    error = None
except IndexError as caught:
    error = caught
print("the frame of time 2:", repr(error))
as_found("the frame whose sample exists cannot be read", error is not None)
END
