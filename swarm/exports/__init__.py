"""Exports: a run's trajectories in the formats of other programs."""
