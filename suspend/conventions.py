"""Units, axes and component order: the one page every other module refers to.

Axes
    x flow, y gradient, z vorticity. Undisturbed flow u_inf = gdot(t) y e_x; E_xy = gdot/2, Omega_z = -gdot/2.
Cell
    Vectors (L,0,0), (tilt L, L, 0), (0,0,L), with the strain gamma = tilt modulo 1, tilt in [-1/2, 1/2).
Internal units (everything below `suspend.simulation` and above the files)
    length a (sphere radius), viscosity eta0, rate Gamma, force 6 pi eta0 a^2 Gamma (= F_stk), torque F_stk a,
    stresslet F_stk a, stress eta0 Gamma, time 1/Gamma. Gamma is gamma0*omega (oscillatory), the shear rate
    (steady, reversal) or the reference rate (quiescent). A lone sphere: drag 1, rotational drag 4/3,
    stresslet (10/9) E.
Files
    Units of the configuration (whatever `particles.radius`, `fluid.viscosity`, `flow.omega` are given in).
Signs
    Forces and torques act on the spheres. Stresslets have Brady's sign: +(20/3) pi eta0 a^3 E for a lone
    sphere. Compression is a negative normal stress. N1 = sigma_xx - sigma_yy, N2 = sigma_yy - sigma_zz.
Quantities without a value
    See `suspend.missing`.
Symmetric tensors
    Six components in the order of `COMPONENTS`.
"""

from __future__ import annotations

COMPONENTS = ("xx", "yy", "zz", "xy", "xz", "yz")
COMPONENT_INDEX = ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2))

ROTATIONAL_DRAG = 4.0 / 3.0  # 8 pi eta0 a^3 in units of 6 pi eta0 a^3
SELF_STRESSLET = 10.0 / 9.0  # (20/3) pi eta0 a^3 in units of 6 pi eta0 a^3
FORMAT_VERSION = 1  # of the files a run writes
