"""Replay of lines as they come from a program that reads hardware: the playback of several stations, fed as they come.

The first seconds tell the object, its stations and its noise; they are flown as soon as that is known, and everything
after them at once. What the object's hand does is not learnt, but as settings have it.
"""

from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path
from typing import Any

from swarm.flight.recordings.live_light import LiveWindows
from swarm.flight.recordings.live_lines import LiveLines
from swarm.flight.recordings.live_start import Learnt, learn
from swarm.flight.recordings.row_likelihood import Likely
from swarm.flight.recordings.row_windows import RowWindow
from swarm.flight.recordings.stations_file import PlacedStations
from swarm.flight.recordings.windows import Source
from swarm.flight.station_replay import Chosen, StationPlayback, choose_stations, peer_in_world
from swarm.scenario import Scenario


def live_playback(
    lines: LiveLines,
    settings: Scenario,
    object_name: str | None,
    lighthouse: int | None,
    calibration: str | Path | None,
    stations: PlacedStations | None,
    source: Source,
    tell: Callable[[str], None],
) -> "LivePlayback":
    """Return the playback of lines as they come, once the first ones have told how to fly.

    Args:
        lines: as they come.
        settings: scenario with the navigation settings.
        object_name: name of the tracked object, None for the only one.
        lighthouse: number of the only station, None for all.
        calibration: libsurvive's configuration with the stations' poses and errors.
        stations: those of a file.
        source: raw pulses or angles.
        tell: gets a sentence where nothing comes to fly by.

    Raises:
        SwarmError: there is nothing to fly by.
    """
    learnt = learn(lines, object_name, source, calibration, tell)
    light = learnt.light
    known = (
        light.placed
        if stations is None
        else {station.number for station in stations.stations if station.generation == light.light.generation}
    )
    awaited = sorted(number for number in known if number is not None) if lighthouse is None else ()
    chosen = choose_stations(light, stations, lighthouse, awaited)
    return LivePlayback(lines, learnt, settings, chosen, source, given=stations is not None)


class LivePlayback(StationPlayback):
    """Light that one object sees of several stations, through the same navigator as that of a file."""

    def __init__(
        self, lines: LiveLines, learnt: Learnt, settings: Scenario, chosen: Chosen, source: Source, *, given: bool
    ) -> None:
        """Prepare the replay.

        Args:
            lines: as they come.
            learnt: the first ones.
            settings: scenario with the navigation settings.
            chosen: the stations.
            source: raw pulses or angles.
            given: whether they are those of a file of stations.
        """
        super().__init__(learnt.light, settings, chosen, given=given)
        self.duration_s = float("inf")
        self._lines, self._reader, self._world = lines, learnt.reader, chosen.world
        self._live = LiveWindows(lines, learnt, source, self.windows)

    def periods(self) -> Iterator[RowWindow]:
        """Yield the light, period by period as it comes; once."""
        numbers = [placed.number for placed in self.placed]
        peer = partial(peer_in_world, stations=self.placed, world=self._world)
        return self._live.periods(numbers, self.found.false, peer)

    def end(self, tell: Callable[[str], None]) -> dict[str, Any]:
        """Return what the summary has of the lines, once they have ended, and tell what of them was lost."""
        damaged, late = self._reader.damaged + self._reader.clock.damaged, self._live.late
        if self._lines.lost:
            tell(f"the lines are {self._lines.lost}")
        if damaged:
            tell(f"damaged lines, left out: {damaged}")
        if late:
            tell(f"lines that came too late for their period, left out: {late}")
        return {"live": {**self._live.latency.summary(), "damaged_lines": damaged, "late_lines": late}}

    def _likely(self, given: Scenario) -> Likely | None:
        """Return None: some seconds are too few, and light does not wait while it is searched."""
        return None
