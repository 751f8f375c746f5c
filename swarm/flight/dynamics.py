"""How the craft move through one lighthouse period: what each wants, what its actuators make of it, what else pushes.

    guidance and control, on what the craft believe -> actuators -> random pushes, faults -> MuJoCo

`feedback = "truth"` steers by the true state instead of the craft's own estimate, but never navigates by it.
"""

import numpy as np

from estimators.arrays import Floats
from estimators.rotation import matrix_from_quaternion
from estimators.state import State, unknown
from swarm.flight import builders
from swarm.flight.actuators import Drive
from swarm.flight.faults.injection import Faults
from swarm.flight.guided import GuidedFlight
from swarm.onboard import control
from swarm.onboard.control import Command
from swarm.onboard.navigation import Estimate
from swarm.scenario import Scenario
from swarm.world.execution import ActuatorFaults
from swarm.world.world import PeriodTruth
from swarm.world.wrench import OnboardWrench


class Dynamics:
    """The world with C craft, and everything that moves them.

    command: what the craft have ordered for the period that was flown last, as far as their navigation knows it: none
    of a craft that is steered by the truth, which must not reach its filter that way.
    """

    def __init__(self, scenario: Scenario) -> None:
        """Build the craft where they start. Raises SwarmError where the scenario cannot fly."""
        self.motions = builders.fleet(scenario)
        self.world = builders.world(scenario, self.motions)
        self.orbit = builders.orbit(scenario)
        self.actuators = builders.actuators(scenario, self.world)
        self.pushes = builders.pushes(scenario)
        self._by_estimate = builders.steers_by_estimate(scenario)
        self.guided = GuidedFlight(scenario, self.motions, self.world, self._by_estimate)
        self._period_s = 1 / scenario.lighthouse.rate_hz
        craft = len(self.world.names)
        start = builders.start(scenario, self.motions)
        self._true = State(
            rotation=matrix_from_quaternion(start.quaternion),
            position=start.position,
            velocity=start.velocity,
            angular_rate=start.angular_rate,
        )
        self._estimated = unknown(craft)
        self.command = Command(*np.zeros((2, craft, 3)))

    def advance(self, frame: int, faults: Faults | None) -> PeriodTruth:
        """Move every craft through the lighthouse period `frame`."""
        truth = self.world.advance(*self._wrench(frame, faults))
        self._true = State(
            rotation=matrix_from_quaternion(truth.quaternion[-1]),
            position=truth.position[-1],
            velocity=truth.velocity[-1],
            angular_rate=truth.angular_rate[-1],
        )
        return truth

    def learn(self, truth: PeriodTruth, estimate: Estimate) -> None:
        """What the craft know at the epoch of the period, for those that steer by it."""
        if self._by_estimate.any():
            # The estimate is of the epoch; the next wrench begins half a period later.
            self._estimated = State(
                rotation=estimate.rotation,
                position=estimate.position,
                velocity=estimate.velocity,
                angular_rate=estimate.angular_rate,
            ).ahead(self._period_s / 2)
        self.guided.learn(truth, estimate)

    def _wrench(self, frame: int, faults: Faults | None) -> tuple[Floats, Floats, OnboardWrench | None]:
        """What moves every craft in this period: its control, through its actuators, and what pushes it beside."""
        believed = self._believed(faults)
        reference = self.guided.steer(frame * self._period_s, believed)
        command = self.guided.command(reference, believed, self.orbit)
        wanted = control.wrench(command, reference, believed, self.world.mass, self.world.inertia)
        drive = self.actuators.drive(*wanted, believed, command, self._stuck(faults))
        self.command = drive.command.only(self._by_estimate)
        return *self._pushed(frame, drive, faults), drive.onboard

    def _believed(self, faults: Faults | None) -> State:
        """The states that the craft steer by; NaN where a craft is lost, or does not know any."""
        believed = self._true
        if self._by_estimate.any():
            believed = believed.where(~self._by_estimate, self._estimated)
        if faults is not None:
            idle = faults.out_of_control() | faults.restarting()
            believed = believed.where(~idle, unknown(len(idle)))
        return believed

    def _stuck(self, faults: Faults | None) -> ActuatorFaults | None:
        """The thrusters that do not obey."""
        stuck = [] if faults is None else faults.thrusters()
        if not stuck:
            return None
        open_, shut = np.zeros((2, len(self.world.names), self.actuators.most_thrusters), dtype=np.bool_)
        for who, thruster, on in stuck:
            (open_ if on else shut)[who, thruster] = True
        return ActuatorFaults(open_, shut)

    def _pushed(self, frame: int, drive: Drive, faults: Faults | None) -> tuple[Floats, Floats]:
        """Force and torque (C, 3) in the lighthouse frame: the drive's, and what pushes the craft beside it."""
        force, torque = drive.force, drive.torque
        if self.pushes.pushed.any():
            more = self.world.inertial_wrench(*self.pushes.at(frame))
            # What the spin asks for anyway is in the control's own wrench already.
            still = np.zeros_like(force)
            spin = self.world.inertial_wrench(still, still)
            force, torque = force + more[0] - spin[0], torque + more[1] - spin[1]
        kick = None if faults is None else faults.kick()
        if kick is not None:
            kicked = np.any(np.concatenate(kick, axis=1) != 0, axis=1)
            more = self.world.inertial_wrench(*(change / self._period_s for change in kick))
            force[kicked], torque[kicked] = more[0][kicked], more[1][kicked]
        pushed = self.motions.pushed
        if pushed.any():
            pushed_force, pushed_torque = self.world.inertial_wrench(*self.motions.disturbance(frame))
            force[pushed], torque[pushed] = pushed_force[pushed], pushed_torque[pushed]
        return force, torque
