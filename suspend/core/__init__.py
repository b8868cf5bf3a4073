"""Numba kernels: scalars in, scalars out, and loops over pairs. No classes, no files."""
