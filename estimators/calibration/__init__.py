"""Calibration of a lighthouse's fans and of photodiode positions from a survey."""
