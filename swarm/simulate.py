"""Fly a scenario: one short loop over lighthouse periods.

    world (MuJoCo's truth over one period) -> visibility -> the lighthouse's pulses -> every craft's own navigation
    -> its control -> forces back to the world; beside it, telemetry and the recording.

Nothing but pulses passes from the lighthouse to a craft; `feedback = "truth"` steers by the true state instead of the
craft's own, but never navigates by it.
"""

from collections.abc import Callable
from pathlib import Path
from typing import Protocol
from zlib import crc32

import numpy as np
from numpy.typing import NDArray

from estimators.arrays import Bools, Floats
from estimators.rotation import matrix_from_quaternion
from swarm import build
from swarm.assets import find_model
from swarm.onboard import control
from swarm.onboard.control import State
from swarm.onboard.decoder import SweepAngles
from swarm.onboard.navigation import Estimate, Navigator
from swarm.results.angles import believed
from swarm.results.progress import Progress
from swarm.results.recorder import Scene
from swarm.results.run_folder import Run
from swarm.results.run_writer import writing_run
from swarm.results.telemetry import Truth
from swarm.scenario import Scenario, craft
from swarm.sensors.lighthouse import Lighthouse
from swarm.sensors.visibility import Sight, Visibility
from swarm.world.craft import visuals
from swarm.world.world import PeriodTruth


class Observer(Protocol):
    """Watches a flight from outside, for instance to time its computers; it changes nothing."""

    def begin(self, flight: "Flight") -> None:
        """See the flight before its first period."""

    def period(self, frame: int, truth: Truth, estimate: Estimate) -> None:
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
            time_s, truth, sight, estimate = flight.period(frame)
            writer.append(frame, time_s, truth, sight, estimate, angles=flight.angles)
            if observer is not None:
                observer.period(frame, truth, estimate)
            if progress is not None:
                progress(writer.progress)
    return writer.run


class Flight:
    """The world, the lighthouse and every craft's computer, period by period."""

    def __init__(self, scenario: Scenario) -> None:
        """Build everything. Raises SwarmError where the scenario cannot fly."""
        settings = build.lighthouse(scenario)
        self.motions = build.fleet(scenario)
        self.world = build.world(scenario, self.motions)
        layout = self.world.photodiodes
        self.visibility = Visibility(
            self.world.model, layout, self.world.craft_bodies, self.world.lighthouse_body, settings
        )
        # A craft's random draws go by its name: it keeps them when other craft come or go.
        keys = [crc32(name.encode()) for name in self.world.names]
        self.lighthouse = Lighthouse(layout, settings, scenario.seed, keys)
        self.decoder = build.decoder(scenario, layout.present)
        navigation, own_layout = build.navigation(scenario), build.believed_layout(scenario, layout)
        self.navigator = Navigator(own_layout, navigation)
        fans, noise = (navigation.fan_x, navigation.fan_y), build.angle_noise(scenario)
        self.believed = believed(self.world.names, own_layout, fans, noise)
        self.angles: SweepAngles | None = None
        """What every craft's decoder made of the last period."""
        self.steers_by_estimate = np.array([craft.feedback == "estimate" for craft in craft(scenario)])
        self.period_s = 1 / settings.rate_hz
        self.scene = Scene(
            craft=self.world.names,
            visuals=[self.world.visuals(i) for i in range(layout.craft_count)],
            photodiodes=layout,
            lighthouse=visuals(find_model(scenario.lighthouse.model)),
            field_deg=scenario.lighthouse.field_deg,
            detail=scenario.recording.detail,
        )
        start = self.motions.start()
        self._true = State(matrix_from_quaternion(start.quaternion), start.angular_rate, start.position, start.velocity)
        self._estimated = control.unknown(layout.craft_count)

    def period(self, frame: int) -> tuple[float, Truth, NDArray[np.int8], Estimate]:
        """Fly one lighthouse period.

        Returns its epoch [s], the truth at the epoch, the `Sight` of every photodiode (C, K), what each craft knows.
        """
        truth, sight = self.move(frame)
        pulses = self.lighthouse.sweep(truth, frame, sight == Sight.LIT)
        self.angles = self.decoder.decode(pulses)
        estimate = self.navigator.step(self.angles)

        # The estimate is of the epoch; the next wrench begins half a period later.
        self._estimated = State(estimate.rotation, estimate.angular_rate, estimate.position, estimate.velocity).ahead(
            self.period_s / 2
        )
        epoch = len(truth.time_s) // 2
        at_epoch = Truth(
            truth.position[epoch],
            truth.quaternion[epoch],
            truth.velocity[epoch],
            truth.angular_rate[epoch],
            truth.contact,
        )
        return float(truth.time_s[epoch]), at_epoch, sight.min(axis=-1), estimate

    def move(self, frame: int) -> tuple[PeriodTruth, NDArray[np.int8]]:
        """Move every craft through one lighthouse period, and no more: nobody measures, nobody navigates.

        Returns the truth, and the `Sight` of every photodiode as each fan sweeps, (C, K, 2).
        """
        truth = self.world.advance(*self._wrench(frame))
        last = -1
        self._true = State(
            matrix_from_quaternion(truth.quaternion[last]),
            truth.angular_rate[last],
            truth.position[last],
            truth.velocity[last],
        )
        return truth, self._sight(truth)

    def _sight(self, truth: PeriodTruth) -> NDArray[np.int8]:
        """The `Sight` of every photodiode as each fan sweeps, (C, K, 2): taken at the knots in mid-sweep."""
        steps = len(truth.time_s) - 1
        return np.stack(
            [self.visibility.state(truth.position[k], truth.quaternion[k]) for k in (steps // 4, 3 * steps // 4)],
            axis=-1,
        )

    def _wrench(self, frame: int) -> tuple[Floats, Floats]:
        """Force and torque (C, 3) of every craft in period `frame`: its control, and what pushes it at random."""
        believed = self._true.where(~self.steers_by_estimate, self._estimated)
        reference = self.motions.at(frame * self.period_s)
        force, torque = control.wrench(reference, believed, self.world.mass, self.world.inertia)
        push = self.motions.disturbance(frame)
        pushed: Bools = (push.acceleration.any(axis=1) | push.angular_acceleration.any(axis=1)).reshape(-1, 1)
        pushed_force, pushed_torque = self.world.inertial_wrench(*push)
        return (
            np.where(pushed, pushed_force, force),
            np.where(pushed, pushed_torque, torque),
        )
