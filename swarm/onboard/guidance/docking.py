"""One craft's approach to a docking port: from hold point to hold point along the docking axis, then slowly to contact.

    WAIT -> TRANSFER -> HOLD -> APPROACH -> HOLD ... -> FINAL -> DOCKED
                          ^--------- RETREAT <-----'       (out of the corridor, or the port missed)
    any -> LOST -> RETREAT or the phase before             (no pose for a while, or a poor one)

The craft decides by its own estimate, and by a switch in the port that reports when the latch has closed. It leaves a
hold point inwards only while it is inside the corridor (`swarm.onboard.guidance.corridor`) and its navigation is good;
out of the corridor it flies back to the hold point that it came from. While its navigation is lost it brakes, by the
state that its filter predicts from the craft's own orders, and stays; once the navigation is back, the craft retreats
if it was on the axis. After a number of retreats it gives up.

The target's port is known in some frame, in which everything here is: the lighthouse's where the target stands still,
the target's own axes where it moves and turns; who calls `step` has the craft's motion in that frame.

The reference is a point moved by `swarm.onboard.guidance.glideslope`; in the last leg it passes the port at the closing
speed.
"""

import numpy as np

from estimators.arrays import Floats
from swarm.hardware import Closing, Port, docked_pose
from swarm.onboard.guidance.corridor import in_corridor
from swarm.onboard.guidance.glideslope import Glideslope, Moving, at_rest, brake, through, towards
from swarm.onboard.guidance.phase import Phase
from swarm.scenario import Dock
from swarm.units import si

ARRIVED_M = 0.01
"""Distance from a hold point below which the reference has arrived there [m]."""
OVERTRAVEL_M = 0.02
"""Distance that the reference moves on beyond the port to make contact [m]."""


class Docking:
    """The state of one approach; `step` once per lighthouse period."""

    def __init__(
        self, craft: int, own: Port, target: Port, table: Dock, period_s: float, rides: int | None = None
    ) -> None:
        """Begin at the position that the table gives.

        Args:
            craft: index of the craft.
            own: the craft's port in its body frame.
            target: the target's port in the lighthouse frame, or in the axes of the craft `rides`.
            table: the scenario's table.
            period_s: time between two steps [s].
            rides: index of the target, which moves and turns; None where it stands still.
        """
        self.craft, self.own, self.target, self.phase, self.rides = craft, own, target, Phase.WAIT, rides
        self._plan, self._ranges_m = si(table), table.hold_ranges_m
        self._slope = Glideslope(1 / table.glideslope_s, table.speed_m_s, table.acceleration_m_s2)
        self._period_s = period_s
        self.from_m = table.from_m
        self._reference = at_rest(np.array(table.from_m))
        self._axis = target.rotation[:, 2]
        self.docked_rotation, self._docked_m = docked_pose(own, target)
        self._leg = 0
        """Index of the hold point at which the craft is, to which it flies, or from which it came in FINAL."""
        self._since_s = 0.0
        self._good_s = self._blind_s = 0.0
        self._retreats = 0
        self._interrupted = Phase.WAIT

    def step(
        self,
        time_s: float,
        position: Floats,
        velocity: Floats,
        at: Closing,
        tracking: bool,
        sigma_m: float,
        latched: bool,
    ) -> Moving:
        """Return the craft's reference at `time_s`, with the acceleration of the period that begins.

        Args:
            time_s: beginning of the period [s].
            position: the craft's estimated position, (3,) [m], NaN if unknown.
            velocity: the craft's estimated velocity, (3,) [m/s], NaN if unknown.
            at: estimated range, offset, angle and closing speed of its port relative to the target's.
            tracking: whether the craft has had a pose in this period.
            sigma_m: standard deviation of its position [m].
            latched: state of the switch in the port.
        """
        self._judge_navigation(tracking and sigma_m <= self._plan.sigma_limit_m)
        self._decide(time_s, position, velocity, at, latched)
        now = self._reference
        self._reference = self._follow(now)
        # The acceleration of the step that follows leads on from here.
        return Moving(now.position, now.velocity, self._reference.acceleration)

    def begin(self, at: Moving) -> None:
        """Wait from a point on that is known only now, in the target's axes."""
        self._reference = at

    def _judge_navigation(self, good: bool) -> None:
        self._good_s = self._good_s + self._period_s if good else 0.0
        self._blind_s = 0.0 if good else self._blind_s + self._period_s

    def _enter(self, phase: Phase, time_s: float) -> None:
        self.phase, self._since_s = phase, time_s

    def _decide(self, time_s: float, position: Floats, velocity: Floats, at: Closing, latched: bool) -> None:
        """Choose the phase of the period that begins."""
        plan, trusted = self._plan, self._good_s >= self._plan.settle_s
        inwards = self.phase in (Phase.APPROACH, Phase.FINAL)
        if self.phase == Phase.DOCKED:
            return
        if latched:
            self._enter(Phase.DOCKED, time_s)
        elif self.phase not in (Phase.LOST, Phase.WAIT) and self._blind_s > plan.lost_s:
            self._interrupted = self.phase
            self._enter(Phase.LOST, time_s)
        elif inwards and self._blind_s == 0 and (not in_corridor(plan, at) or self._missed()):
            self._retreat(time_s)
        elif self.phase == Phase.LOST and trusted:
            self._found(time_s, position, velocity)
        elif self.phase == Phase.WAIT and trusted and time_s >= plan.start_s:
            self._reference = Moving(position, velocity, np.zeros(3))
            self._enter(Phase.TRANSFER, time_s)
        elif self.phase in (Phase.TRANSFER, Phase.RETREAT, Phase.APPROACH) and self._arrived():
            self._enter(Phase.HOLD, time_s)
        elif self.phase == Phase.HOLD and trusted and time_s - self._since_s >= plan.hold_s[self._leg]:
            self._leave_inwards(time_s, at)

    def _missed(self) -> bool:
        """Return whether the port should have latched by now."""
        beyond = float((self._docked_m - self._reference.position) @ self._axis)
        return self.phase == Phase.FINAL and beyond > OVERTRAVEL_M

    def _retreat(self, time_s: float) -> None:
        """Retreat to the hold point that the craft came from; after too many retreats, to the first one for good."""
        if self.phase == Phase.APPROACH:
            self._leg -= 1
        self._retreats += 1
        if self._retreats > self._plan.retreats:
            self._leg = 0
            self._enter(Phase.ABORTED, time_s)
        else:
            self._enter(Phase.RETREAT, time_s)

    def _found(self, time_s: float, position: Floats, velocity: Floats) -> None:
        """Continue from the present estimate after the navigation has come back."""
        self._reference = Moving(position, velocity, np.zeros(3))
        if self._interrupted in (Phase.APPROACH, Phase.FINAL):
            if self._interrupted == Phase.APPROACH:
                self._leg -= 1
            self._enter(Phase.RETREAT, time_s)
        else:
            back = Phase.RETREAT if self._interrupted == Phase.HOLD else self._interrupted
            self._enter(back, time_s)

    def _leave_inwards(self, time_s: float, at: Closing) -> None:
        if not in_corridor(self._plan, at):
            return
        if self._leg + 1 < len(self._plan.hold_ranges_m):
            self._leg += 1
            self._enter(Phase.APPROACH, time_s)
        else:
            self._enter(Phase.FINAL, time_s)

    def _hold_point(self) -> Floats:
        return self._docked_m + self._ranges_m[self._leg] * self._axis

    def _arrived(self) -> bool:
        there = float(np.linalg.norm(self._reference.position - self._hold_point())) < ARRIVED_M
        return there and float(np.linalg.norm(self._reference.velocity)) < self._slope.slope_per_s * ARRIVED_M * 2

    def _follow(self, now: Moving) -> Moving:
        """Return the reference one period later."""
        plan, period = self._plan, self._period_s
        if self.phase in (Phase.WAIT, Phase.LOST, Phase.DOCKED):
            return brake(now, plan.brake_m_s2, period)
        if self.phase == Phase.FINAL:
            return through(now, self._docked_m, -plan.closing_speed_m_s * self._axis, self._slope, period)
        return towards(now, self._hold_point(), self._slope, period)
