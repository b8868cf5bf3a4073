"""Export of runs for the tools people use: GSD, extended XYZ, H5MD, CSV, JSON, netCDF; xarray and pandas from Python.

    from suspend.export import export
    export("runs/demo", "demo.gsd", frames=slice(0, None, 10))
"""

from __future__ import annotations

from suspend.export.export import FORMATS, check_target, export

__all__ = ["FORMATS", "check_target", "export"]
