"""Far-field mobility: spectral Ewald sum of the force-torque-stresslet level in the sheared cell."""
