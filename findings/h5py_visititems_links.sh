#!/usr/bin/env bash
# h5py: visititems calls once per object, not once per path. In H5MD files, whose elements share step and time by hard
# links as the format advises, a walk shows step and time under one element and every other seems to have none; under
# which one, the order of names decides. visititems_links and plain loops show all. Copying the elements one by one
# makes separate copies of what was shared.
. "$(dirname "$0")/common.bash"
install h5py==3.16.0 numpy==2.4.6
measure <<'END'
import h5py
import numpy as np
from finding import as_found, versions

versions("h5py", "numpy")
with h5py.File("shared.h5", "w") as file:
    position = file.create_group("position")
    position["step"], position["time"] = np.arange(3), np.arange(3.0)
    for name in ("image", "velocity"):
        for part in ("step", "time"):
            file[f"{name}/{part}"] = position[part]
with h5py.File("shared.h5") as file:
    objects, links = [], []
    file.visititems(lambda name, _: objects.append(name))
    file.visititems_links(lambda name, _: links.append(name))
    print("visititems:", objects)
    print("visititems_links:", links)
    as_found("step and time under the first name alone, not where they were made",
             [name for name in objects if "/" in name] == ["image/step", "image/time"])
    as_found("visititems_links shows six", sum("/" in name for name in links) == 6)
    as_found("all names hold one object", file["image/step"] == file["position/step"] == file["velocity/step"])
    with h5py.File("copy.h5", "w") as copy:
        for name in file:
            file.copy(name, copy)
        as_found("copied one by one they are objects of their own", copy["image/step"] != copy["position/step"])
END
