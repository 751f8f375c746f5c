"""Write a run's trajectories in another program's format: files per craft and source, in a folder of their own."""

from collections.abc import Iterable, Iterator, Sequence
from enum import StrEnum
from functools import partial
from pathlib import Path
from typing import NamedTuple

from estimators.relative_orbit import RelativeOrbit, circular
from swarm.errors import SwarmError
from swarm.exports import mcap_file
from swarm.exports.ccsds import NANOSECONDS, Epoch, aem, oem
from swarm.exports.kitti import common, kitti, times
from swarm.exports.table import table
from swarm.exports.trajectory import Source, Trajectories, Trajectory
from swarm.exports.tum import tum
from swarm.results.disk import outputs, refuse_existing
from swarm.results.files import SCENARIO
from swarm.results.run_folder import Run, open_run
from swarm.user_text import parse_toml

FOLDER = "export"
"""Folder in that of a run, with one for each format."""


class Format(StrEnum):
    """A format of exports."""

    TUM = "tum"
    KITTI = "kitti"
    CSV = "csv"
    CCSDS = "ccsds"
    MCAP = "mcap"


DATED = (Format.CCSDS, Format.MCAP)
"""Formats with dates instead of seconds from the start."""


class Exported(NamedTuple):
    """The files that were written. left_out: periods without one of the poses, summed over the craft (KITTI only)."""

    folder: Path
    files: list[Path]
    left_out: int = 0


def export(
    path: str | Path,
    to: Format,
    what: Sequence[Source] = (),
    *,
    craft: Sequence[str] = (),
    start: Epoch | None = None,
    out: Path | None = None,
    force: bool = False,
) -> Exported:
    """Write the trajectories of a run.

    Args:
        path: The folder of the run.
        to: The format.
        what: The sources; none: truth and estimate, as far as the run has them.
        craft: The craft; none: all.
        start: The date of the run's start; CCSDS needs one, MCAP can have one, the others have none.
        out: The folder to write to. None: `export/FORMAT` in that of the run.
        force: Replace files that are there.

    Raises:
        SwarmError: The run, a craft or a source does not exist, a file is damaged, files are there already, or nothing
            can be written.
    """
    if to is Format.CCSDS and start is None:
        raise SwarmError("--to ccsds needs the date of the run's start: --epoch 2027-03-01T12:00:00")
    if to not in DATED and start is not None:
        raise SwarmError(f"--epoch: {to} has seconds from the start, and no date; ccsds and mcap have")
    if to is Format.MCAP:
        mcap_file.check_library()
    run = open_run(path)
    found = Trajectories(run.folder, craft)
    sources = found.sources(what)
    if to is Format.CCSDS and (without := [source for source in sources if source in (Source.PNP, Source.PEER)]):
        raise SwarmError(f"--what: an OEM needs velocities, which {without[0]} does not have")
    folder = out or run.folder / FOLDER / to.value
    if to is Format.MCAP:
        files = [folder / f"{run.folder.name}.mcap"]
        refuse_existing(*files, force=force)
        known = [one for name in found.craft for one in _known(found, name, sources)]
        with outputs(*files) as (temporary,):
            mcap_file.write_mcap(temporary, run, known, partial(_nanoseconds, start))
        return Exported(folder, files)
    orbit = orbit_of(run) if to is Format.CCSDS else None
    texts = partial(_texts, to, start=start, orbit=orbit)
    files = [folder / name for each in found.craft for name, _ in texts(_known(found, each, sources))]
    refuse_existing(*files, force=force)
    left_out = 0
    with outputs(*files) as temporaries:
        places = iter(temporaries)
        for name in found.craft:
            known = _known(found, name, sources)
            if to is Format.KITTI and known:
                left_out += max(len(one.frame) for one in known) - len(common(known)[0].frame)
            for _, lines in texts(known):
                _write(next(places), lines)
    return Exported(folder, files, left_out)


def _known(found: Trajectories, name: str, sources: Sequence[Source]) -> list[Trajectory]:
    """Return the trajectories of a craft that have a pose."""
    return [one for source in sources if len((one := found.of(name, source)).frame)]


def _texts(
    to: Format, known: Sequence[Trajectory], *, start: Epoch | None, orbit: RelativeOrbit | None
) -> Iterator[tuple[str, Iterable[str]]]:
    """Yield the files of a craft by their names, as lines, which are made when they are read."""
    if to is Format.KITTI and known:
        known = common(known)
        yield f"{known[0].craft}.times.txt", times(known[0])
    for one in known:
        stem = f"{one.craft}.{one.source}"
        if to is Format.CCSDS:
            assert start is not None
            yield f"{stem}.oem", oem(one, start, orbit)
            yield f"{stem}.aem", aem(one, start, orbit)
        else:
            made = {Format.TUM: tum, Format.KITTI: kitti, Format.CSV: table}[to]
            yield f"{stem}.{to}", made(one)


def orbit_of(run: Run) -> RelativeOrbit | None:
    """Return the orbit of the station; None in weightless space, and in a replay."""
    tables = parse_toml(run.scenario, str(run.folder / SCENARIO)) if run.scenario else {}
    said = tables.get("orbit")
    if said is None:
        return None
    try:
        return circular(1e3 * float(said["altitude_km"]), said["boresight"])
    except (KeyError, TypeError, ValueError) as error:
        raise SwarmError(f"{run.folder / SCENARIO} is damaged: orbit: {error}") from None


def _nanoseconds(start: Epoch | None, time_s: float) -> int:
    return round(time_s * NANOSECONDS) if start is None else start.unix_ns(time_s)


def _write(file: Path, lines: Iterable[str]) -> None:
    with file.open("w", encoding="utf-8", newline="\n") as stream:
        stream.writelines(f"{line}\n" for line in lines)
