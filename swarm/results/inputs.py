"""The files that a scenario names, in the run's folder: the run can be read, and flown again, wherever it is taken.

    runs/docking-3/scenario.toml                 model = "inputs/servicer.xml"
    runs/docking-3/inputs/servicer.xml           with its meshes beside it (`swarm.world.model_copy`)
    runs/docking-3/inputs/calibration.toml

Models that come with the program are among them: the next version's may be others.
"""

from pathlib import Path, PurePosixPath
from typing import NamedTuple

from swarm.assets import find_model
from swarm.plugin_files import PLUG_INS, of_file, provenance
from swarm.scenario import Scenario
from swarm.scenario.fleet import Craft
from swarm.world.model_copy import Copies

FOLDER = "inputs"
PATTERNS = tuple(
    f"*.{ending}"
    for ending in (
        "xml",
        "obj",
        "stl",
        "msh",
        "png",
        "ktx",
        "skn",
        "bin",
        "raw",
        "toml",
        "json",
        "py",
        "gmsh",
        "vtk",
        "tmp",
    )
)
"""Files that the folder usually holds; `summary.json` lists those of a run, whatever they are called."""


class Inputs(NamedTuple):
    """A scenario whose paths begin at the run's folder. files: the contents of the files that it names, by path.
    plug_ins: what its plug-ins were, a line each.
    """

    scenario: Scenario
    files: dict[PurePosixPath, bytes]
    plug_ins: list[str]


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

    plug_ins: dict[str, None] = {}

    def flown(table: Craft) -> Craft:
        update: dict[str, object] = {"model": model(table.model)} if models else {}
        for key in PLUG_INS:
            if (value := getattr(table, key)) is not None:
                plug_ins[provenance(key, value)] = None
                if (named := of_file(value)) is not None:
                    update[key] = f"{FOLDER}/{copies.add(named[0])}:{named[1]}"
        return table.model_copy(update=update)

    lighthouse = scenario.lighthouse.model_copy(update={"model": model(scenario.lighthouse.model)})
    changed: dict[str, object] = {"lighthouse": lighthouse}
    if scenario.swarm.count:
        changed["swarm"] = flown(scenario.swarm)
    changed["craft"] = tuple(flown(single) for single in scenario.craft)
    if scenario.navigation.calibration is not None:
        file = f"{FOLDER}/{copies.add(Path(scenario.navigation.calibration))}"
        changed["navigation"] = scenario.navigation.model_copy(update={"calibration": file})
    files = {PurePosixPath(FOLDER, k): v for k, v in copies.files.items()}
    return Inputs(scenario.model_copy(update=changed), files, list(plug_ins))
