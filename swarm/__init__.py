"""Fly a swarm of spacecraft in front of one laser lighthouse; each craft finds its own pose.

    import swarm
    run = swarm.simulate("formation")   # or swarm.load("formation", ["swarm.count=16"]), or the path of a .toml file
    run.telemetry   # a pyarrow.Table, one row per craft and lighthouse period; .to_pandas() where pandas is installed
    run.summary     # the figures that `swarm run` prints
    swarm.report(run.folder)

The names exported here are imported when they are first used, so that `import swarm` and `swarm --help` are fast.
"""

from __future__ import annotations

from importlib import import_module

# typing's own constant, without its import: until this file is read, Ctrl-C is the interpreter's.
TYPE_CHECKING = False
if TYPE_CHECKING:
    from typing import Any

    from swarm.errors import SwarmError
    from swarm.flight.replay import replay
    from swarm.flight.simulate import simulate
    from swarm.report.write import report
    from swarm.results.run_folder import Run, open_run
    from swarm.results.smoothing import smooth
    from swarm.scenario import Scenario, load
    from swarm.studies.calibration.calibrate import calibrate_survey
    from swarm.studies.calibration.survey import observe_recording, observe_run
    from swarm.studies.campaign.conduct import study
    from swarm.studies.papers import reproduce
    from swarm.studies.placement.study import place

__all__ = [
    "Run",
    "Scenario",
    "SwarmError",
    "__version__",
    "calibrate_survey",
    "load",
    "observe_recording",
    "observe_run",
    "open_run",
    "place",
    "replay",
    "report",
    "reproduce",
    "simulate",
    "smooth",
    "study",
]

_HOME = {
    "Run": "swarm.results.run_folder",
    "Scenario": "swarm.scenario",
    "SwarmError": "swarm.errors",
    "calibrate_survey": "swarm.studies.calibration.calibrate",
    "load": "swarm.scenario",
    "observe_recording": "swarm.studies.calibration.survey",
    "observe_run": "swarm.studies.calibration.survey",
    "open_run": "swarm.results.run_folder",
    "place": "swarm.studies.placement.study",
    "replay": "swarm.flight.replay",
    "reproduce": "swarm.studies.papers",
    "simulate": "swarm.flight.simulate",
    "smooth": "swarm.results.smoothing",
    "study": "swarm.studies.campaign.conduct",
}


def __getattr__(name: str) -> Any:
    if name == "__version__":
        return import_module("swarm.version").VERSION
    if name == "report":
        return import_module("swarm.report")  # which can be called
    if name not in _HOME:
        raise AttributeError(f"module 'swarm' has no attribute {name!r}")
    return getattr(import_module(_HOME[name]), name)


def __dir__() -> list[str]:
    return sorted(__all__)
