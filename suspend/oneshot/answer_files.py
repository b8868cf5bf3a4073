"""The answer of a mobility problem as a short table, as plain values, and as a JSON, npz or HDF5 file."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

import suspend
from suspend.errors import ConfigurationError, StorageError
from suspend.io.files import replace_atomically, storage_errors
from suspend.oneshot.problem_files import Problem
from suspend.oneshot.problems import Motions

FORMATS = (".json", ".npz", ".h5", ".hdf5")
AXES = "xyz"


@dataclass(frozen=True)
class Answer:
    """What was asked and what came out."""

    problem: Problem
    motions: Motions

    def as_dict(self) -> dict[str, Any]:
        """All figures and arrays: results, accuracy and cost, then the scene; eta_r None without flow."""
        problem, scene, method = self.problem, self.problem.scene, self.problem.method
        motions, cost = self.motions, self.motions.cost
        lubrication = method.lubrication
        return {
            "U": motions.U,
            "Omega": motions.Omega,
            "stresslet": motions.stresslet,
            "eta_r": motions.eta_r,
            "accuracy": cost.accuracy,
            "residual": cost.residual,
            "iterations": cost.iterations,
            "products": cost.products,
            "seconds": cost.seconds,
            "far_field": method.far_field,
            "lubrication": lubrication.enabled,
            "cutoff": lubrication.cutoff if lubrication.enabled else None,
            "at_cutoff": lubrication.at_cutoff if lubrication.enabled else None,
            "number": scene.number,
            "volume_fraction": scene.volume_fraction,
            "positions": scene.positions,
            "L": scene.edge,
            "shift": (scene.tilt % 1.0) * scene.edge,
            "shear_rate": problem.shear_rate,
            "forces": problem.forces,
            "torques": problem.torques,
            "source": problem.source,
            "version": suspend.__version__,
        }

    def lines(self) -> list[str]:
        """Table for the screen: means and ranges over the spheres."""
        scene, cost, eta_r = self.problem.scene, self.motions.cost, self.motions.eta_r
        lines = [
            f"{scene.number} spheres, volume fraction {scene.volume_fraction:.6g}, cell edge {scene.edge:.6g} a,"
            f" tilt {scene.reduced_tilt:.6g}, shear rate {self.problem.shear_rate:g}",
            f"far field {self.problem.method.far_field}, {self._lubrication()}",
            "",
            f"{'':14}{'mean':>16}{'smallest':>16}{'largest':>16}",
        ]
        lines += [
            f"{name:14}{np.mean(v):>16.8g}{np.min(v):>16.8g}{np.max(v):>16.8g}" for name, v in self._columns()
        ]
        lines += [
            "",
            f"{'eta_r':14}{eta_r:>16.10g}" if eta_r is not None else "eta_r         not defined without flow",
        ]
        lines.append(
            f"accuracy asked {cost.accuracy:g}, residual {cost.residual:.2g}, {cost.iterations} iterations,"
            f" {cost.products} mobility products, {cost.seconds:.3g} s"
        )
        return lines

    def _lubrication(self) -> str:
        law = self.problem.method.lubrication
        return f"lubrication to {law.cutoff:g} a ({law.at_cutoff})" if law.enabled else "no lubrication"

    def _columns(self) -> list[tuple[str, np.ndarray]]:
        motions, s = self.motions, self.motions.stresslet
        columns = [(f"U_{AXES[c]}", motions.U[:, c]) for c in range(3)]
        columns += [(f"Omega_{AXES[c]}", motions.Omega[:, c]) for c in range(3)]
        columns += [(f"S_{AXES[a]}{AXES[b]}", s[:, a, b]) for a, b in ((0, 1), (0, 2), (1, 2))]
        return [*columns, ("S_xx - S_yy", s[:, 0, 0] - s[:, 1, 1]), ("S_yy - S_zz", s[:, 1, 1] - s[:, 2, 2])]

    def write(self, path: str | Path) -> None:
        """Write the file, whole or not at all; its suffix is the format. Raises as `check_target`, StorageError."""
        path = check_target(path)
        fill = {".json": self._fill_json, ".npz": self._fill_npz}.get(path.suffix.lower(), self._fill_hdf5)
        with storage_errors("write", path):
            replace_atomically(path, fill, sync=False)

    def _fill_json(self, path: Path) -> None:
        content = {k: v.tolist() if isinstance(v, np.ndarray) else v for k, v in self.as_dict().items()}
        path.write_text(json.dumps(content, indent=2, allow_nan=False) + "\n", encoding="utf-8")

    def _known(self) -> dict[str, Any]:
        return {k: v for k, v in self.as_dict().items() if v is not None}

    def _fill_npz(self, path: Path) -> None:
        with open(path, "wb") as file:  # np.savez adds .npz to a name
            np.savez(file, **self._known())

    def _fill_hdf5(self, path: Path) -> None:
        import h5py

        with h5py.File(path, "w") as file:
            for name, value in self._known().items():
                file[name] = value


def check_target(path: str | Path) -> Path:
    """The path, if an answer can be written there: ConfigurationError or StorageError if not."""
    path = Path(path)
    if path.suffix.lower() not in FORMATS:
        raise ConfigurationError(
            f"{path}: unknown kind of file '{path.suffix}'; known are {', '.join(FORMATS)}"
        )
    if path.is_dir():
        raise ConfigurationError(f"{path}: is a folder; give the name of a file")
    if not path.parent.is_dir():
        raise StorageError(f"{path}: cannot be written: there is no folder {path.parent}")
    return path
