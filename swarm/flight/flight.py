"""One flight: the world moves, light is measured, every craft navigates and steers, per lighthouse period.

A craft's computer receives only its own signals and commands. The truth reaches the telemetry, and the controller of a
craft that the scenario steers by the truth.
"""

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from swarm.flight import builders
from swarm.hardware import Closing
from swarm.onboard.pilot import Pilot
from swarm.results.period import Guided, Period
from swarm.results.records import Truth
from swarm.scenario import Scenario
from swarm.sensors.sight import Sight
from swarm.world.world import PeriodTruth

LIT = int(Sight.LIT)
"""The code as a plain number, which NumPy takes at once."""


def periods_of(scenario: Scenario) -> int:
    """Return the number of lighthouse periods of a flight."""
    return max(1, round(scenario.duration_s / scenario.period_s))


class Flight:
    """World, actuators, sensors, faults and computers of one scenario.

    period_s: length of a lighthouse period [s]. steps: physics steps in it, and how exact they are. believed: layout,
    fan errors and noise that the craft assume when they measure, for a calibration.
    """

    def __init__(self, scenario: Scenario, *, history: bool = False, pilot: type[Pilot] = Pilot) -> None:
        """Build everything.

        Args:
            scenario: scenario to fly.
            history: whether estimates carry the filter's prediction, for a smoother.
            pilot: the class that steers the craft.

        Raises:
            SwarmError: the scenario cannot fly.
        """
        self.period_s = scenario.period_s
        self.periods = periods_of(scenario)
        self.motions = builders.fleet(scenario)
        self.steps = builders.steps(scenario, self.motions, agents=pilot is not Pilot)
        self.world = builders.world(scenario, self.motions, self.steps.number)
        self.sensors = builders.sensors(scenario, self.world, self.motions)
        self.faults = builders.faults(scenario, self.world, self.sensors)
        self.latches = builders.latches(scenario, self.world)
        self.surroundings = builders.surroundings(scenario, self.world, self.motions)
        self.actuators = builders.actuators(scenario, self.world)
        layout = builders.own_layout(scenario, self.world)
        self.computer = builders.computer(scenario, self.world, self.motions, self.sensors, layout, history=history)
        self.pilot = builders.pilot(scenario, self.world, self.motions, self.latches, layout, pilot)
        self._told = builders.start_state(scenario, self.motions)
        self.command = builders.no_command(len(self.world.names))
        self.believed = builders.measured_by(scenario, self.world, layout, self.computer.navigator.settings)

    def fly(self) -> Iterator[Period]:
        """Fly one lighthouse period after the other, to the end of the scenario."""
        for frame in range(self.periods):
            yield self.period(frame)

    def period(self, frame: int) -> Period:
        """Fly one lighthouse period: steer, move, measure, navigate. Periods are flown in order."""
        faults = self.faults
        truth, sight = self.move(frame)
        lit = faults.light(sight == LIT)
        signals = self.sensors.signals(truth, frame, lit, faults.rotor())  # the only inputs of a craft
        signals = faults.signals(truth, lit, signals)
        known = self.computer.step(signals, self.command, faults.restarting())  # on board, each craft by itself
        docking = self.latches.meet(truth)
        self.pilot.learn(known.estimate, self.latches.closed)
        return Period(
            frame=frame,
            time_s=signals.epoch_s,
            truth=_at_epoch(truth),
            sight=faults.seen(self.sensors.seen(sight)),
            angles=known.angles,
            estimate=known.estimate,
            scans=known.scans,
            work=self.actuators.work(),
            guided=self._guided(docking),
            fault=faults.states(),
            overlaps=self.sensors.overlaps(),
        )

    def move(self, frame: int) -> tuple[PeriodTruth, NDArray[np.int8]]:
        """Steer and move every craft through one lighthouse period, without measurement or navigation.

        Returns:
            The truth, and the `Sight` of every photodiode as each fan sweeps, (C, K, 2), or from each station.
        """
        faults = self.faults
        faults.begin(frame)
        order = self.pilot.steer(frame * self.period_s, self._told, faults.idle())  # on board
        self.command = order.command.only(self.pilot.by_estimate)
        drive = self.actuators.drive(order, faults.thrusters())  # physics
        force, torque = self.surroundings.add(frame, drive.force, drive.torque, faults.blow())
        truth = self.world.advance(force, torque, drive.onboard)
        self._told = truth.state(-1)
        return truth, self.sensors.sight(truth)

    def _guided(self, docking: list[tuple[int, Closing]]) -> Guided | None:
        guidance = self.pilot.guidance
        if guidance is None:
            return None
        return Guided(guidance.phase, self.pilot.reference_m(), guidance.gave_way, docking)


def _at_epoch(truth: PeriodTruth) -> Truth:
    """Return the truth at the period's epoch."""
    k = truth.epoch
    return Truth(truth.position[k], truth.quaternion[k], truth.velocity[k], truth.angular_rate[k], truth.contact)
