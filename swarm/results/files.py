"""Names of the files that a run leaves in its folder, and of what is said in them."""

from swarm.results.parquet import PARTIAL

SUMMARY = "summary.json"
SCENARIO = "scenario.toml"
RECORDING = "recording.rrd"
TELEMETRY = "telemetry.parquet"
ANGLES = "angles.parquet"
SCANS = "scans.parquet"
EQUIPMENT = "craft_equipment"
"""Key of the schema's metadata under which is what the craft navigate by, in their order, as JSON: [[number of craft
that are alike, photodiodes of each, names of their sensors], ...]."""
ANGLE_NOISE = "angle_noise_rad"
"""Key of the schema's metadata under which is the standard deviation of a sweep angle that the craft assume [rad]."""
HISTORY = "filter.history"
"""Folder of what the filters predicted and believed, for the smoother."""
SMOOTH = "smooth.parquet"
SMOOTH_RECORDING = "smooth.rrd"
REPORT, FIGURES = "report.html", "figures"
"""Page of a run or a study, and the folder of its figures."""
DRAWN = ("*.svg", "*.png", "*.pdf")
"""Patterns of the figures' names."""
PARTS = TELEMETRY + PARTIAL
"""Folder of the telemetry's parts, while the run goes on."""
WITHOUT_SENSORS = "craft_without_sensors"
"""Key of the schema's metadata under which are the names of the craft that navigate by nothing, as JSON."""
