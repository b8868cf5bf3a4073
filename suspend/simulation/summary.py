"""Closing figures of a session."""

from __future__ import annotations

from dataclasses import dataclass

from suspend.missing import text


@dataclass
class Summary:
    """Closing figures of a session."""

    figures: dict

    def as_dict(self) -> dict:
        """Figures for scripts."""
        return self.figures

    def lines(self) -> list[str]:
        """One line to close a run with."""
        f = self.figures
        end = f" ({f['end']})" if f["end"] else ""
        if f["evaluations"] == 0:
            return [f"{f['directory']}: finished before, {f['cycles']} cycles{end}, nothing to do"]
        spent = f["compiling_seconds"]
        compiling = f" ({spent:.1f} s of it compiling)" if spent >= 0.05 else ""
        return [
            f"{f['directory']}: {f['cycles']} cycles, total strain {f['total_strain']:.6g}{end}, "
            f"{f['seconds']:.1f} s{compiling}, "
            f"{f['evaluations']} velocity evaluations ({f['evaluations'] / max(f['strain_now'], 1e-300):.0f} per unit "
            f"strain), {f['iterations'] / f['evaluations']:.1f} iterations each, "
            f"smallest gap {text(f['minimum_gap'], '.3g', ' a')}, rejected steps {f['rejected_overlap']} (overlap) "
            f"{f['rejected_error']} (error)"
        ]
