"""Studies built on flights: campaigns, calibration, photodiode layouts, the papers' experiments."""
