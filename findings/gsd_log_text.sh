#!/usr/bin/env bash
# gsd: what a frame does not log is taken from frame 0. That works for numbers and arrays; a text logged in frame 0 alone
# makes every later frame unreadable, as the reader treats the text as an array. The writer accepts all of it.
. "$(dirname "$0")/common.bash"
install gsd==5.0.1 numpy==2.4.6
measure <<'END'
import gsd.hoomd
import numpy as np
from finding import as_found, versions

versions("gsd", "numpy")


def write(path, first_log):
    with gsd.hoomd.open(path, "w") as file:
        for step, log in enumerate((first_log, {})):
            frame = gsd.hoomd.Frame()
            frame.configuration.step = step
            frame.configuration.box = [9, 9, 9, 0, 0, 0]
            frame.particles.N = 1
            frame.particles.position = [[0, 0, step]]
            frame.log = log
            file.append(frame)


write("number.gsd", {"viscosity": np.array([2.5])})
with gsd.hoomd.open("number.gsd") as file:
    print("frame 1 of a file with a number in frame 0:", file[1].log)
    as_found("numbers of frame 0 appear in frame 1", file[1].log["viscosity"] == 2.5)
write("text.gsd", {"protocol": "oscillatory"})
with gsd.hoomd.open("text.gsd") as file:
    print("frame 0 of a file with a text in frame 0:", file[0].log)
    try:
        file[1]
        error = None
    except AttributeError as caught:
        error = str(caught)
print("frame 1:", error)
as_found("a text in frame 0 alone makes frame 1 unreadable", error is not None)
END
