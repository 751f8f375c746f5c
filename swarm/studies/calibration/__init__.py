"""Calibration: a survey's angles, what they say about fans and photodiodes, and how that is written down."""
