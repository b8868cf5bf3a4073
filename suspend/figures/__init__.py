"""Figures of the paper by name, and pictures of configurations."""
