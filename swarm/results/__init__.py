"""What a run leaves behind: telemetry, a recording, a summary."""
