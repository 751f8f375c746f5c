"""The files that a scenario names, in the run's folder: the run can be read, and flown again, wherever it is taken.

    runs/docking-3/scenario.toml                 model = "inputs/servicer.xml"
    runs/docking-3/inputs/servicer.xml           with its meshes beside it (`swarm.world.model_copy`)
    runs/docking-3/inputs/calibration.toml

Models that come with the program are among them: the next version's may be others.
"""

from pathlib import Path, PurePosixPath
from typing import NamedTuple

from swarm.assets import find_model
from swarm.scenario import Lighthouse, Scenario
from swarm.scenario.schema import Craft
from swarm.world.model_copy import Copies

FOLDER = "inputs"
PATTERNS = tuple(
    f"*.{ending}"
    for ending in ("xml", "obj", "stl", "msh", "png", "ktx", "skn", "bin", "raw", "toml", "json", "gmsh", "vtk", "tmp")
)
"""Files that the folder usually holds; `summary.json` lists those of a run, whatever they are called."""


class Inputs(NamedTuple):
    """A scenario whose paths begin at the run's folder. files: the contents of the files that it names, by path."""

    scenario: Scenario
    files: dict[PurePosixPath, bytes]


def inputs_of(scenario: Scenario, models: bool = True) -> Inputs:
    """Read all files that a scenario names.

    Args:
        scenario: The scenario, whose paths are absolute.
        models: Take the craft's models too; a replay has none.

    Raises:
        SwarmError: A file cannot be read.
    """
    copies = Copies()

    def model(name: str) -> str:
        return f"{FOLDER}/{copies.add_model(find_model(name, Path()))}"

    def named(table: Craft | Lighthouse) -> Craft | Lighthouse:
        return table.model_copy(update={"model": model(table.model)})

    changed: dict[str, object] = {"lighthouse": named(scenario.lighthouse)}
    if models:
        changed["swarm"] = named(scenario.swarm) if scenario.swarm.count else scenario.swarm
        changed["craft"] = tuple(named(single) for single in scenario.craft)
    if scenario.navigation.calibration is not None:
        file = f"{FOLDER}/{copies.add(Path(scenario.navigation.calibration))}"
        changed["navigation"] = scenario.navigation.model_copy(update={"calibration": file})
    return Inputs(scenario.model_copy(update=changed), {PurePosixPath(FOLDER, k): v for k, v in copies.files.items()})
