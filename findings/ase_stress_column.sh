#!/usr/bin/env bash
# ase takes a column "stress" of an extended XYZ file for the stress of the whole system. The column is then no array
# of the atoms, and written again its N x 6 numbers become one entry of the comment line, which ase itself refuses to
# read. OVITO asks for this very name (it is its Stress Tensor), whatever the case of the letters; ase minds the case.
. "$(dirname "$0")/common.bash"
install ase==3.29.0 ovito==3.17.2 numpy==2.4.6
measure <<'END'
import ase.io
import numpy as np
from finding import as_found, versions
from ovito.io import import_file

versions("ase", "ovito", "numpy")
STRESS = np.arange(24.0).reshape(4, 6)
for name in ("stress", "Stress"):
    with open(f"{name}.xyz", "w") as file:
        file.write(f'4\nLattice="9 0 0 0 9 0 0 0 9" Properties=species:S:1:pos:R:3:{name}:R:6 pbc="T T T"\n')
        file.writelines(f"X {i} {i} {i} {' '.join(map(str, row))}\n" for i, row in enumerate(STRESS))

atoms = ase.io.read("stress.xyz")
print("arrays:", list(atoms.arrays), "| results of a calculator:", {k: v.shape for k, v in atoms.calc.results.items()})
as_found("the column stress becomes a calculator's stress", "stress" not in atoms.arrays and "stress" in atoms.calc.results)
ase.io.write("again.xyz", atoms, format="extxyz")
print("written again:", open("again.xyz").readlines()[1][:130], "...")
try:
    ase.io.read("again.xyz")
    error = None
except ValueError as caught:
    error = str(caught)
print("read again:", error)
as_found("ase refuses the file that it wrote", error is not None)

atoms = ase.io.read("Stress.xyz")
as_found("with a capital letter it stays an array of the atoms", np.array_equal(atoms.arrays["Stress"], STRESS))
for name in ("stress", "Stress"):
    tensor = import_file(f"{name}.xyz").compute().particles["Stress Tensor"]
    as_found(f"OVITO reads {name} as Stress Tensor", np.array_equal(tensor[...], STRESS))
END
