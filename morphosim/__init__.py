"""MorphoSim."""
