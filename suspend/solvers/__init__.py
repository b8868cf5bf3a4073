"""Iterative solvers and preconditioners."""
