"""Quantities computed from the files of a run; no kernel of the simulation is imported here."""
