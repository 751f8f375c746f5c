"""Fly a scenario and write the run: one short loop over lighthouse periods. What a period is: `swarm.flight.flight`."""

from collections.abc import Callable
from pathlib import Path
from typing import Protocol

from swarm.flight.flight import Flight
from swarm.results.period import Period
from swarm.results.progress import Progress
from swarm.results.run_folder import Run
from swarm.results.run_writer import writing_run
from swarm.scenario import Scenario


class Observer(Protocol):
    """Watches a flight from outside, for instance to time its computers; it changes nothing."""

    def begin(self, flight: Flight) -> None:
        """See the flight before its first period."""

    def period(self, period: Period) -> None:
        """See one period at its epoch."""


def simulate(
    scenario: Scenario,
    *,
    out: str | Path | None = None,
    force: bool = False,
    live: bool = False,
    record: bool = True,
    progress: Callable[[Progress], None] | None = None,
    observer: Observer | None = None,
) -> Run:
    """Fly `scenario` and write the run to `out` (default `runs/<scenario>-<seed>`); the run, opened.

    force: replace a run that is there. live: open the viewer. record: write recording.rrd. progress: told now and then.
    observer: sees the flight and every period.
    Raises SwarmError: a scenario that cannot fly, a folder that cannot be written; KeyboardInterrupt closes the run,
    marks it as interrupted, and is raised again.
    """
    flight = Flight(scenario)
    if observer is not None:
        observer.begin(flight)
    duration_s, record = scenario.duration_s, record and scenario.recording.enabled
    angles = flight.believed if scenario.recording.angles else None
    with writing_run(
        scenario, out, flight.scene, force=force, duration_s=duration_s, record=record, live=live, angles=angles
    ) as writer:
        for frame in range(max(1, round(duration_s / flight.period_s))):
            period = flight.period(frame)
            writer.append(period)
            if observer is not None:
                observer.period(period)
            if progress is not None:
                progress(writer.progress)
    return writer.run
