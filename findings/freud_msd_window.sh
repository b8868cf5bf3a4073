#!/usr/bin/env bash
# freud's mean square displacement over all origins (mode "window", the default) is computed in single precision from
# squares of the positions, so its error is some 1e-7 x^2, and not relative to the displacement: spheres at x = 10 that
# move 1e-4 in each step get negative values. Mode "direct" and the same algorithm in double precision are right.
. "$(dirname "$0")/common.bash"
install freud-analysis==3.4.0 tidynamics==1.1.2 numpy==2.4.6
measure <<'END'
import freud
import numpy as np
import tidynamics
from finding import as_found, versions

versions("freud-analysis", "tidynamics", "numpy")
rng = np.random.default_rng(0)
walk = np.cumsum(rng.normal(0.0, 1e-4, (500, 20, 3)), axis=0)
LAGS = (1, 10, 100)
for offset in (0.0, 1.0, 10.0, 100.0):
    x = walk + offset
    truth = np.array([((x[lag:] - x[:-lag]) ** 2).sum(-1).mean() for lag in LAGS])
    window = freud.msd.MSD(mode="window").compute(positions=x).msd[list(LAGS)]
    double = np.mean([tidynamics.msd(x[:, i]) for i in range(20)], axis=0)[list(LAGS)]
    print(f"x = {offset:5}: true {truth}, freud {window}, double precision {double}")
    if offset == 0.0:
        as_found("right for spheres near the origin", np.allclose(window, truth, rtol=0.01))
    if offset == 10.0:
        as_found("negative at every lag for spheres at x = 10", (window < 0).all())
        as_found("right in double precision", np.allclose(double, truth, rtol=0.01))
direct = freud.msd.MSD(mode="direct").compute(positions=walk + 10.0).msd
as_found("mode direct is right", np.allclose(direct, ((walk - walk[0]) ** 2).sum(-1).mean(-1), rtol=0.01, atol=1e-10))
END
