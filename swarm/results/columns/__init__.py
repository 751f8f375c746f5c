"""The columns of the telemetry."""
