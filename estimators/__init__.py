"""Pose estimation from sweep angles: pure functions of arrays, fit to run on a real craft."""
