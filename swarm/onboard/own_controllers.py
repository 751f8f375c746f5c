"""Controllers of the user's own, in the place of the feedback of some craft.

The motion's reference, the broadcasts and the actuators are the program's: a controller returns a wrench, thrusters and
wheels give what they can of it, and the filter is told the accelerations that it stands for,

    a = F / m,    alpha = I^-1 (M - w x I w)        with I in the frame of the poses
"""

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple, Protocol

import numpy as np

from estimators.arrays import Bools, Floats
from estimators.state import STATES, Reference, State
from swarm.errors import SwarmError
from swarm.messages import Command
from swarm.onboard.guidance.broadcast import Broadcasts
from swarm.onboard.user_code import at, called, numbers
from swarm.plugin_files import PlugIn
from swarm.plugins import Controller, Moment, OwnCraft, Wrench


class Steering(NamedTuple):
    """Orders of C craft: the accelerations as their filters are told them, and force (C, 3) [N] and torque (C, 3) [N
    m] about their centres of mass, in the frame of the poses.
    """

    command: Command
    force: Floats
    torque: Floats


class Controllers(Protocol):
    """Controllers of craft, asked after the program's own feedback."""

    def steer(self, time_s: float, believed: State, covariance: Floats, wanted: Reference, usual: Steering) -> Steering:
        """Return the steering of all craft.

        Args:
            time_s: beginning of the period [s].
            believed: states by which the C craft steer, NaN where unknown.
            covariance: (C, 12, 12) of the estimates, NaN where unknown, also of craft that steer by the truth.
            wanted: references of the craft.
            usual: steering by the program's own feedback.
        """


class NoControllers:
    """Null controllers, where every craft has the program's feedback."""

    def steer(self, time_s: float, believed: State, covariance: Floats, wanted: Reference, usual: Steering) -> Steering:
        """Return the usual steering.

        Args:
            time_s: not used.
            believed: not used.
            covariance: not used.
            wanted: not used.
            usual: steering by the program's own feedback.
        """
        return usual


NO_CONTROLLERS = NoControllers()


class OwnControllers:
    """Controllers of the user for some of C craft."""

    def __init__(
        self,
        plug_ins: Mapping[int, PlugIn],
        crafts: Sequence[OwnCraft],
        by_estimate: Bools,
        speaks: Bools,
        period_s: float,
    ) -> None:
        """Make every controller.

        Args:
            plug_ins: their classes by the index of the craft.
            crafts: what each of the C craft knows of itself.
            by_estimate: craft that steer by their own estimate, (C,).
            speaks: craft that broadcast their state, (C,).
            period_s: length of a lighthouse period [s].
        """
        self._plug_ins, self._crafts, self._silent = dict(plug_ins), list(crafts), ~speaks
        self._by_estimate = by_estimate
        self._air = Broadcasts(len(crafts), period_s)
        self._own: dict[int, Controller] = {
            i: called(plug_in, f"craft {crafts[i].name!r}", plug_in.kind, crafts[i]) for i, plug_in in plug_ins.items()
        }

    def steer(self, time_s: float, believed: State, covariance: Floats, wanted: Reference, usual: Steering) -> Steering:
        """Return the steering of all craft, of those with a controller of the user by that.

        Args:
            time_s: beginning of the period [s].
            believed: states by which the C craft steer, NaN where unknown.
            covariance: (C, 12, 12) of the estimates, NaN where unknown, also of craft that steer by the truth.
            wanted: references of the craft.
            usual: steering by the program's own feedback.

        Raises:
            SwarmError: a controller has raised an exception, or its wrench is not one.
        """
        neighbours = self._heard(believed)
        out = Steering(usual.command.of(slice(None)), usual.force.copy(), usual.torque.copy())
        for i, controller in self._own.items():
            name, state = self._crafts[i].name, believed.of(i)
            wrench, turning = Wrench(np.zeros(3), np.zeros(3)), np.zeros(3)
            if all(np.isfinite(part).all() for part in state):
                others = {who: motion for who, motion in neighbours.items() if who != name}
                now = Moment(
                    time_s,
                    State(*(part.copy() for part in state)),
                    covariance[i].copy() if self._by_estimate[i] else np.full((STATES, STATES), np.nan),
                    Reference._make(part[i].copy() for part in wanted),
                    others,
                )
                where = at(name, time_s)
                wrench = _checked(self._plug_ins[i], where, called(self._plug_ins[i], where, controller.steer, now))
                turning = self._turning(i, state, wrench.torque, held=bool(wanted.holds_attitude[i]))
            out.force[i], out.torque[i] = wrench
            out.command.acceleration[i] = wrench.force / self._crafts[i].mass_kg
            out.command.angular_acceleration[i] = turning
        return out

    def _turning(self, craft: int, state: State, torque: Floats, *, held: bool) -> Floats:
        """Return the angular acceleration (3,) of a torque.

        The filter of a craft whose attitude is not held knows of its gyroscopic torque already.
        """
        inertia, rate = state.rotation @ self._crafts[craft].inertia_kg_m2 @ state.rotation.T, state.angular_rate
        gyroscopic = np.cross(rate, inertia @ rate) if held else np.zeros(3)
        return np.asarray(np.linalg.solve(inertia, torque - gyroscopic), dtype=np.float64)

    def _heard(self, believed: State) -> dict[str, tuple[Floats, Floats]]:
        """Return the motions of the craft as they have told them, and send those of now."""
        heard, silent = self._air.heard(), self._silent[:, None]
        self._air.tell(np.where(silent, np.nan, believed.position), np.where(silent, np.nan, believed.velocity), 0.0)
        return {
            craft.name: (heard.position[i].copy(), heard.velocity[i].copy())
            for i, craft in enumerate(self._crafts)
            if heard.known[i]
        }


def _checked(plug_in: PlugIn, where: str, wrench: Any) -> Wrench:
    """Return the wrench of a user's controller. Raises SwarmError where it is none."""
    if not isinstance(wrench, tuple | list) or len(wrench) != 2:
        raise SwarmError(
            f"{plug_in.said}: {where}: steer must return Wrench(force, torque), not {type(wrench).__name__}"
        )
    named = zip(("force", "torque"), wrench, strict=True)
    return Wrench(*(numbers(plug_in, where, f"{name} of the wrench", value, (3,)) for name, value in named))
