"""Recordings of real lighthouses: their reading, their division into periods, and the calibration of their stations."""
