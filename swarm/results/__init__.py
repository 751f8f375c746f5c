"""Results of a run: telemetry, a recording, a summary."""
