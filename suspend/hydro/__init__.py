"""Hydrodynamic operators: two-sphere functions, neighbours, near field."""
