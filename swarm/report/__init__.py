"""The report: one self-contained HTML page of a run or a study, and what `swarm study` prints at its end.

The module can be called: `swarm.report("runs/formation-7")` makes the page, whether or not this room was imported.
"""

import sys
from pathlib import Path
from types import ModuleType


class _Report(ModuleType):
    def __call__(self, path: str | Path, out: str | Path | None = None) -> Path:
        """Make one HTML page of the run or the study at `path`, by default in its folder, and return its file."""
        from swarm.report.write import report

        return report(path, out)


sys.modules[__name__].__class__ = _Report
