"""Export of runs for the tools people use: GSD, extended XYZ, CSV, JSON, xarray."""
