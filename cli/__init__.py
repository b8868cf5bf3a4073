"""The command line of suspend."""
