"""The command `swarm replay`: a real recording through the same on-board code."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from swarm.cli import completion
from swarm.cli.options import Force, NoRecording, out_path
from swarm.cli.terminal import ending_once, fly_and_report, mistakes

if TYPE_CHECKING:
    from rich.console import Console

    from swarm.flight.recordings.contents import Listed
    from swarm.flight.recordings.live_lines import LiveLines
    from swarm.results.progress import Progress
    from swarm.results.run_folder import Run


class Source(StrEnum):
    """The part of a recording that is fed to the on-board code."""

    PULSES = "pulses"
    ANGLES = "angles"


Recording = Annotated[
    str,
    typer.Argument(
        metavar="RECORDING",
        autocompletion=completion.recordings,
        help="A recording of real light: libsurvive's .rec or .rec.gz, a Crazyflie's event log, or a name that "
        "`swarm list` shows; - for libsurvive's lines from a pipe, flown as they come, until they end or Ctrl-C. "
        "With --list also a system-config.yaml, or a trajectory.",
    ),
]
Object = Annotated[
    str | None,
    typer.Option("--object", metavar="NAME", help="Use this tracked object, such as HMD. Default: the only one."),
]
Station = Annotated[
    int | None,
    typer.Option(
        "--lighthouse", metavar="N", min=0, help="Use this station only. Default: all whose place is known, together."
    ),
]
Stations = Annotated[
    Path | None,
    typer.Option(
        "--stations", metavar="FILE", help="Take the stations' places and errors from this file of stations (TOML)."
    ),
]
Calibration = Annotated[
    Path | None,
    typer.Option(
        "--calibration",
        metavar="FILE",
        help="Remove the stations' errors: libsurvive's config, or one station's of ours (TOML). Default: the config "
        "beside the recording.",
    ),
]
From = Annotated[
    Source, typer.Option("--from", help="Feed raw light pulses, or the angles that the recording computed of them.")
]
ListOnly = Annotated[
    bool, typer.Option("--list", help="Only list what the recording contains, and what of it can be replayed.")
]

Truth = Annotated[
    Path | None,
    typer.Option(
        "--truth", metavar="FILE", help="Compare with this trajectory of the object: motion capture .npy, TUM or CSV."
    ),
]
Live = Annotated[bool, typer.Option("--live", help="Open the viewer, and watch while it is replayed.")]
Imu = Annotated[
    bool,
    typer.Option(
        "--imu/--no-imu", help="Take in the gyroscope and accelerometer, where the recording has them and it moves."
    ),
]
Seed = Annotated[int | None, typer.Option("--seed", metavar="N", help="Use this seed. Default: 0.")]
Settings = Annotated[
    list[str] | None,
    typer.Option(
        "--set",
        metavar="KEY=VALUE",
        help="Change one value of navigation or recording, such as navigation.angle_noise_arcsec=20. Repeatable.",
    ),
]
Folder = Annotated[
    Path | None,
    typer.Option(
        "--out", parser=out_path, metavar="FOLDER", help="Write to this folder. Default: runs/<recording>-<seed>."
    ),
]


def replay(
    recording: Recording,
    object_name: Object = None,
    lighthouse: Station = None,
    calibration: Calibration = None,
    stations: Stations = None,
    source: From = Source.PULSES,
    truth: Truth = None,
    imu: Imu = True,
    list_only: ListOnly = False,
    overrides: Settings = None,
    seed: Seed = None,
    out: Folder = None,
    force: Force = False,
    live: Live = False,
    no_recording: NoRecording = False,
) -> None:
    """Feed a recording of real light, or the simulated one that comes along, to the same on-board code.

    \b
    swarm replay handheld
    swarm replay walk.rec.gz --list
    swarm replay FLIGHT/log00 --stations stations.toml
    swarm replay walk.rec.gz --lighthouse 0 --truth mocap.npy
    some-program | swarm replay - --live
    """
    with mistakes():
        lines, file = _found(recording, list_only)
        if list_only:
            _print_contents(file)
            return
        from swarm.results.owned_folder import folder_of
        from swarm.scenario import for_replay

        settings = for_replay(file, overrides or (), seed)
        folder = folder_of(settings.name, settings.seed, out)

        def fly(progress: Callable[["Progress"], None]) -> "Run":
            from swarm.flight.replay import replay as fly_again

            return fly_again(
                file if lines is None else lines,
                object_name=object_name,
                lighthouse=lighthouse,
                stations=stations,
                calibration=calibration or _own_calibration(file, tell),
                source=source.value,
                truth=truth,
                imu=imu,
                scenario=settings,
                out=folder,
                force=force,
                record=not no_recording,
                live=live,
                progress=progress,
                tell=tell,
            )

        with _telling(lines) as tell:
            fly_and_report(settings.name, folder, fly)


@contextmanager
def _telling(lines: "LiveLines | None") -> Iterator[Callable[[str], None]]:
    """Yield the printer of notes, of a file after the block, of lines at once; Ctrl-C ends lines."""
    if lines is not None:
        with ending_once(lines.stop):
            yield _print_note
        return
    notes: list[str] = []
    try:
        yield notes.append
    finally:
        _print_notes(notes)


def _found(recording: str, list_only: bool) -> "tuple[LiveLines | None, Path]":
    """Return the lines of the standard input, where these are asked for, and the file of a recording."""
    import sys

    from swarm.assets import find_recording
    from swarm.errors import SwarmError
    from swarm.flight.recordings.live_lines import LiveLines

    if recording != "-":
        return None, find_recording(recording)
    if list_only:
        raise SwarmError("--list: of lines as they come nothing is known yet: give a file")
    if sys.stdin is None or sys.stdin.isatty():
        raise SwarmError("-: the standard input is the terminal: pipe a program into it, such as survive-cli")
    return LiveLines(), Path(LiveLines.name)


def _own_calibration(file: Path, tell: Callable[[str], None]) -> Path | None:
    """Return the calibration beside a recording that comes with the program, and say that it is used."""
    from swarm.assets import own_recording

    own = own_recording(file)
    if own is None:
        return None
    tell(f"{own.name} comes with the program, and so does its station's calibration, {own.calibration}")
    return own.calibration


def _print_notes(notes: list[str]) -> None:
    """Print sentences about the recording."""
    for note in notes:
        _print_note(note)


def _print_note(note: str) -> None:
    from rich.console import Console
    from rich.text import Text

    Console(stderr=True, highlight=False).print(Text(f"note: {note}", "yellow"), soft_wrap=True)


def _print_contents(recording: Path) -> None:
    """Print the table of a recording's objects and stations."""
    from rich.text import Text

    from swarm.flight.recordings.contents import contents
    from swarm.tables import wide_console

    found = contents(recording)
    console = wide_console()
    console.print(Text(f"{recording.name}: {found.format}"))
    _print_rows(console, found.rows)
    for fact in found.facts:
        console.print(Text(fact), soft_wrap=True)
    _print_notes(found.losses)


def _print_rows(console: "Console", rows: "list[Listed]") -> None:
    """Print a row per object and station."""
    from rich.text import Text

    from swarm.tables import table

    if not rows:
        return
    heads = ("object", "light", "photo-\ndiodes", "station", "periods of\nraw light", "angles", "span\n(s)")
    made = table(*heads, tight=True, wrap=True)
    made.add_column("use")
    for row in rows:
        span = "" if row.begin_s is None or row.end_s is None else f"{row.begin_s:.1f} to {row.end_s:.1f}"
        number = ["" if value is None else str(value) for value in (row.photodiodes, row.station)]
        use = Text(row.remark, "yellow") if row.remark else Text("yes", "green")
        made.add_row(Text(row.name), row.generation, *number, str(row.pulses), str(row.angles), span, use)
    console.print(made)
