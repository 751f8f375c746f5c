"""Options that several commands share."""

from pathlib import Path
from typing import Annotated

import typer

from swarm.cli import completion
from swarm.user_text import user_path


def out_path(text: str) -> Path:
    """Return the path that `--out` names. Raises SwarmError where it is none, such as an empty text."""
    return user_path(text, "--out")


Scenario = Annotated[
    str,
    typer.Argument(
        metavar="SCENARIO",
        autocompletion=completion.scenarios,
        help="A name that `swarm list` shows, or the path of a .toml file.",
    ),
]
Overrides = Annotated[
    list[str] | None,
    typer.Option("--set", metavar="KEY=VALUE", help="Change one value, such as swarm.count=16. Repeatable."),
]
Seed = Annotated[int | None, typer.Option("--seed", metavar="N", help="Use this seed instead of the scenario's.")]
Out = Annotated[
    Path | None,
    typer.Option(
        "--out", parser=out_path, metavar="FOLDER", help="Write to this folder. Default: runs/<scenario>-<seed>."
    ),
]
Force = Annotated[bool, typer.Option("--force", help="Replace a run that is there already.")]
NoRecording = Annotated[bool, typer.Option("--no-recording", help="Write no recording for the viewer.")]
AttitudeDeg = Annotated[
    float | None, typer.Option("--attitude-deg", metavar="DEG", help="Reach this attitude precision, 1 sigma.")
]
PositionMm = Annotated[
    float | None, typer.Option("--position-mm", metavar="MM", help="Reach this position precision, 1 sigma.")
]
SearchSeed = Annotated[int, typer.Option("--seed", metavar="N", min=0, help="Use this seed for the search.")]
ForceFiles = Annotated[bool, typer.Option("--force", help="Replace files that are there already.")]
