"""Names of the files that a run leaves in its folder."""

from swarm.results.parquet import PARTIAL

SUMMARY = "summary.json"
SCENARIO = "scenario.toml"
RECORDING = "recording.rrd"
TELEMETRY = "telemetry.parquet"
ANGLES = "angles.parquet"
SCANS = "scans.parquet"
PARTS = TELEMETRY + PARTIAL
"""Folder of the telemetry's parts, while the run goes on."""
