"""Recordings of real lighthouses: read, cut into periods, and the calibration of their stations."""
