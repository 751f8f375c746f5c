"""The command `swarm warm`: compile the kernels that scenarios use, before they are flown."""

from collections.abc import Callable
from contextlib import suppress
from typing import TYPE_CHECKING, Annotated

import typer

from swarm.cli import completion
from swarm.cli.terminal import mistakes

if TYPE_CHECKING:
    from swarm.results.progress import Progress

WARMED: dict[str, tuple[str, ...]] = {
    "formation": (),
    # From 64 craft on all filters run in one kernel.
    "swarm1000": ("swarm.count=64",),
    "ccd-docking": (),
    "inspect-satellite": (),
    "docking": (),
    "fault-parade": (),
    # Two photodiodes left: single sweeps.
    "eclipse": ("fault[0].at_s=0.5", "fault[0].photodiodes=[0, 1, 2, 3, 4, 5, 6, 7, 8, 9]"),
    "two-stations": ('station[0].kind="lighthouse-1"', 'station[1].kind="lighthouse-1"'),
    "constellation16": ("swarm.count=2",),
}
"""Scenarios that together use all sensors, filters, actuators and stations, and what is changed of them."""
FLOWN_S = 1.0
"""Simulated time [s]: the first poses, scans and updates."""


class Enough(KeyboardInterrupt):
    """Ends a flight, which then writes all that an interrupted run leaves."""


def warm(
    scenario: Annotated[
        list[str] | None,
        typer.Argument(
            metavar="[SCENARIO...]",
            autocompletion=completion.scenarios,
            help="Names that `swarm list` shows, or paths of .toml files. Default: some that use all sensors.",
        ),
    ] = None,
) -> None:
    """Compile the kernels that scenarios use, so that no run waits for it.

    Each is flown for a second, into a temporary folder. The machine code stays
    in the user's cache, which installations of the same version share.

    \b
    swarm warm
    swarm warm formation my/scenario.toml
    """
    with mistakes():
        from pathlib import Path
        from tempfile import TemporaryDirectory

        from rich.console import Console

        from swarm.cli.progress import ProgressDisplay
        from swarm.flight.simulate import simulate
        from swarm.scenario import load

        chosen: dict[str, tuple[str, ...]] = dict.fromkeys(scenario, ()) if scenario else WARMED
        for name, overrides in chosen.items():
            settings = load(name, overrides)
            with TemporaryDirectory() as folder, ProgressDisplay(Console(stderr=True), name) as progress:

                def tell(state: "Progress", show: Callable[["Progress"], None] = progress.run) -> None:
                    show(state)
                    if state.time_s >= FLOWN_S:
                        raise Enough

                with suppress(Enough):
                    simulate(settings, out=Path(folder) / "run", progress=tell)
        typer.echo("Everything is compiled: " + ", ".join(chosen))
