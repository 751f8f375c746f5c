"""The flight of a scenario, written as a run; `swarm.flight.flight` describes the steps of a period."""

from collections.abc import Callable
from pathlib import Path
from typing import Protocol

from swarm.flight.flight import Flight, periods_of
from swarm.flight.scene import scene
from swarm.results.filter_history import keeps_history
from swarm.results.period import Period
from swarm.results.progress import Progress
from swarm.results.run_folder import Run, refuse_run
from swarm.results.run_writer import writing_run
from swarm.scenario import Scenario, checked


class Observer(Protocol):
    """Observer of a flight from outside, for instance to time its computers; it changes nothing."""

    def begin(self, flight: Flight) -> None:
        """Observe the flight before its first period."""

    def period(self, period: Period) -> None:
        """Observe one period."""


class Nobody:
    """Null observer, for flights without one."""

    def begin(self, flight: Flight) -> None:
        """Do nothing."""

    def period(self, period: Period) -> None:
        """Do nothing."""


def untold(progress: Progress) -> None:
    """Ignore the progress of a run."""


def simulate(
    scenario: Scenario | str | Path,
    *,
    out: str | Path | None = None,
    force: bool = False,
    live: bool = False,
    record: bool = True,
    progress: Callable[[Progress], None] | None = None,
    observer: Observer | None = None,
) -> Run:
    """Fly a scenario and write the run.

    Args:
        scenario: scenario to fly: loaded, or its name or .toml file; one that was changed in Python is checked again.
        out: folder of the run, by default `runs/<scenario>-<seed>`.
        force: replace an existing run.
        live: open the viewer.
        record: write recording.rrd.
        progress: function called after every period.
        observer: observer of the flight and of every period.

    Returns:
        The run, opened.

    Raises:
        SwarmError: the scenario cannot fly, or the folder cannot be written.
        KeyboardInterrupt: after the run was closed and marked as interrupted.
    """
    scenario = checked(scenario)
    refuse_run(scenario.name, scenario.seed, out, force)
    rows = len(scenario.craft_names) * periods_of(scenario)
    own = any(table.navigator is not None for _, table in scenario.tables)
    history = not own and keeps_history(scenario.recording.filter, rows)
    flight, watch, tell = Flight(scenario, history=history), observer or Nobody(), progress or untold
    watch.begin(flight)
    with writing_run(
        scenario,
        out,
        scene(scenario, flight),
        force=force,
        duration_s=scenario.duration_s,
        record=record and scenario.recording.enabled,
        live=live,
        angles=flight.believed if scenario.recording.angles else None,
        history=history,
        found={"physics": flight.steps.summary()},
    ) as writer:
        for period in flight.fly():
            writer.append(period)
            watch.period(period)
            tell(writer.progress)
    return writer.run
