"""The command `swarm export`: a run's trajectories in the formats of other programs."""

from enum import StrEnum
from pathlib import Path
from typing import Annotated

import typer

from swarm.cli import completion
from swarm.cli.options import out_path
from swarm.cli.terminal import mistakes

FEW = 12
"""Files that are named; of more, the number is told."""


class To(StrEnum):
    """A format, as `swarm.exports.export.Format`, which is not imported before the command runs."""

    TUM = "tum"
    KITTI = "kitti"
    CSV = "csv"
    CCSDS = "ccsds"
    MCAP = "mcap"


class What(StrEnum):
    """A source, as `swarm.exports.trajectory.Source`."""

    TRUTH = "truth"
    ESTIMATE = "estimate"
    SMOOTHED = "smoothed"
    PNP = "pnp"
    PEER = "peer"


class TimeSystem(StrEnum):
    """A time system, as `swarm.exports.ccsds.TimeSystem`."""

    UTC = "UTC"
    TAI = "TAI"
    GPS = "GPS"
    TT = "TT"


def export(
    run: Annotated[Path, typer.Argument(metavar="RUN", autocompletion=completion.runs, help="The folder of a run.")],
    to: Annotated[To, typer.Option("--to", help="The format.")],
    what: Annotated[
        list[What] | None,
        typer.Option("--what", help="Export this. Repeatable. Default: truth and estimate."),
    ] = None,
    craft: Annotated[
        list[str] | None,
        typer.Option("--craft", metavar="NAME", help="Export only this craft. Repeatable."),
    ] = None,
    epoch: Annotated[
        str | None,
        typer.Option("--epoch", metavar="DATE", help="Date of the start, 2027-03-01T12:00:00 (ccsds, mcap)."),
    ] = None,
    time_system: Annotated[
        TimeSystem, typer.Option("--time-system", help="Time system of the epoch (ccsds).")
    ] = TimeSystem.UTC,
    out: Annotated[
        Path | None,
        typer.Option(
            "--out", parser=out_path, metavar="FOLDER", help="Write to this folder. Default: RUN/export/FORMAT."
        ),
    ] = None,
    force: Annotated[bool, typer.Option("--force", help="Replace files that are there already.")] = False,
) -> None:
    """Export the trajectories of a run, files per craft.

    \b
    swarm export runs/formation-7 --to tum
    swarm export runs/orbit-9 --to ccsds --what truth \\
        --epoch 2027-03-01T12:00:00

    tum, kitti: for evo and other tools of odometry. csv: for
    a spreadsheet. ccsds: OEM and AEM messages. mcap: for
    Foxglove, with the optional library mcap.
    """
    with mistakes():
        from swarm.errors import SwarmError
        from swarm.exports import ccsds
        from swarm.exports.export import Format
        from swarm.exports.export import export as write
        from swarm.exports.trajectory import Source
        from swarm.tables import counted

        system = ccsds.TimeSystem(time_system.value)
        if to is To.MCAP and system is not ccsds.TimeSystem.UTC:
            raise SwarmError("--time-system: the times of MCAP are UTC")
        start = None if epoch is None else ccsds.epoch(epoch, system)
        sources = [Source(one.value) for one in what or ()]
        done = write(run, Format(to.value), sources, craft=craft or (), start=start, out=out, force=force)
        typer.echo(f"{done.folder}/  {counted(len(done.files), 'file')}")
        for file in done.files[:FEW]:
            typer.echo(f"  {file.name}")
        if len(done.files) > FEW:
            typer.echo(f"  ... and {len(done.files) - FEW} more")
        if done.left_out:
            typer.echo(
                f"Left out: {counted(done.left_out, 'period')} without a pose, as KITTI has no time in its files."
            )
