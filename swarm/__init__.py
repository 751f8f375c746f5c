"""Fly a swarm of spacecraft in front of one laser lighthouse; each craft finds its own pose.

    import swarm
    run = swarm.simulate(swarm.load("formation"))
    run.telemetry   # a pyarrow.Table, one row per craft and lighthouse period; .to_pandas() where pandas is installed
    run.summary     # the figures that `swarm run` prints

What is named here is imported when it is first used, so that `import swarm` and `swarm --help` cost nothing.
"""

import sys
from importlib import import_module
from importlib.metadata import PackageNotFoundError, version
from types import ModuleType
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from swarm.calibration.calibrate import calibrate_survey
    from swarm.calibration.survey import observe_recording, observe_run
    from swarm.errors import SwarmError
    from swarm.replay import replay
    from swarm.results.run_folder import Run, open_run
    from swarm.scenario import Scenario, load
    from swarm.simulate import simulate

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
    "replay",
    "simulate",
]

_HOME = {
    "Run": "swarm.results.run_folder",
    "Scenario": "swarm.scenario",
    "SwarmError": "swarm.errors",
    "calibrate_survey": "swarm.calibration.calibrate",
    "load": "swarm.scenario",
    "observe_recording": "swarm.calibration.survey",
    "observe_run": "swarm.calibration.survey",
    "open_run": "swarm.results.run_folder",
    "replay": "swarm.replay",
    "simulate": "swarm.simulate",
}


class _Package(ModuleType):
    """The import system binds every submodule to its name here; `simulate` and `replay` stay the functions."""

    def __setattr__(self, name: str, value: Any) -> None:
        if name in _HOME and isinstance(value, ModuleType):
            value = getattr(value, name)
        super().__setattr__(name, value)


sys.modules[__name__].__class__ = _Package


def __getattr__(name: str) -> Any:
    if name == "__version__":
        try:
            return version("lighthouse-swarm")
        except PackageNotFoundError:
            return "0+unknown"
    if name not in _HOME:
        raise AttributeError(f"module 'swarm' has no attribute {name!r}")
    return getattr(import_module(_HOME[name]), name)


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
