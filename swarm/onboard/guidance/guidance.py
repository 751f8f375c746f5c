"""All guidance: once per lighthouse period, the references of the guided craft, and their collision avoidance.

Every craft is guided by its own estimate and by the others' broadcasts; the results computed here for several craft at
once are those that each craft computes for itself. Craft that steer by the truth are guided by it, for comparison.
"""

from collections.abc import Sequence
from types import MappingProxyType
from typing import NamedTuple

import numpy as np

from estimators.arrays import Bools, Floats, Ints
from estimators.relative.pose import relative
from estimators.rotation import skew
from estimators.state import Motion, State, Steered, Turning
from swarm.hardware import Closing, closing, placed
from swarm.messages import Command
from swarm.onboard.control import Feedback, feedback
from swarm.onboard.guidance.avoidance import barriers, safe
from swarm.onboard.guidance.broadcast import Broadcasts
from swarm.onboard.guidance.docking import Docking
from swarm.onboard.guidance.formation import Formation
from swarm.onboard.guidance.gains import Gains
from swarm.onboard.guidance.glideslope import Moving, at_rest
from swarm.onboard.guidance.neighbours import Neighbours, at_rest_in, carried
from swarm.onboard.guidance.phase import Phase


class Knowledge(NamedTuple):
    """Further inputs of the guidance of C craft, (C,) each.

    tracking: whether light has gone into the craft's filter in the last period, as a pose or as single sweeps, and its
    protection level is within its limit. sigma_m: standard deviation of its position [m]. latched: state of the switch
    in its port. neighbours: other craft that they navigate relative to.
    """

    tracking: Bools
    sigma_m: Floats
    latched: Bools
    neighbours: Neighbours = MappingProxyType({})


class Clearance(NamedTuple):
    """Distances that M craft keep from every other craft that they hear, (M,) each.

    craft: index. distance_m: least distance [m]. brake_m_s2: braking acceleration [m/s^2].
    """

    craft: Ints
    distance_m: Floats
    brake_m_s2: Floats


class Guidance:
    """The guided craft among C, period by period: `steer`, then `clear` with the command that the control wants."""

    def __init__(
        self,
        period_s: float,
        gains: Sequence[Gains | None],
        dockings: Sequence[Docking],
        formations: Sequence[Formation],
        clearance: Clearance,
        broadcasts: Bools,
    ) -> None:
        """Start with every guided craft in its place.

        Args:
            period_s: length of a lighthouse period [s].
            gains: feedback gains of each of the C craft; None for a craft that is not guided.
            dockings: approaches to docking ports.
            formations: formations.
            clearance: distances that craft keep from each other.
            broadcasts: craft that broadcast their state, (C,).
        """
        count = len(gains)
        self._dockings, self._formations = list(dockings), list(formations)
        self._clearance, self._speaks = clearance, broadcasts
        self._air = Broadcasts(count, period_s)
        guided = np.array([g is not None for g in gains], dtype=np.bool_)
        self.feedback: Feedback = feedback(count)
        """Feedback of every craft; that of a guided craft is its regulator's."""
        for i, own in enumerate(gains):
            if own is not None:
                self.feedback.stiffness[i], self.feedback.damping[i] = own
        self.phase: Ints = np.where(guided, Phase.KEEP, Phase.NONE).astype(np.int64)
        """Phase of every craft, (C,), codes of `Phase`."""
        self.gave_way: Bools = np.zeros(count, dtype=np.bool_)
        """Craft whose wanted acceleration was changed to keep clear, (C,)."""

    def steer(self, time_s: float, believed: State, known: Knowledge) -> Steered:
        """Return the references of the craft that do not follow a fixed path.

        Args:
            time_s: beginning of the period [s].
            believed: states by which the C craft steer, NaN where unknown.
            known: further inputs of their guidance.
        """
        silent = ~self._speaks[:, None]
        self._air.tell(np.where(silent, np.nan, believed.position), np.where(silent, np.nan, believed.velocity), 0.0)
        craft: list[Ints] = []
        motions: list[Motion] = []
        heard = self._air.heard()
        for formation in self._formations:
            craft.append(formation.craft)
            motions.append(formation.at(time_s, heard, known.neighbours))
            self.phase[formation.craft] = formation.phase(time_s)
        turnings: list[Turning] = []
        for docking in self._dockings:
            i = docking.craft
            if docking.rides is None:
                tracking, sigma, latched = bool(known.tracking[i]), float(known.sigma_m[i]), bool(known.latched[i])
                own = believed.of(i)
                at = _stands(docking, own)
                moving = docking.step(time_s, own.position, own.velocity, at, tracking, sigma, latched)
            else:
                moving = _ridden(docking, time_s, believed.of(i), known, turnings)
            craft.append(np.array([i]))
            motions.append(Motion(*(part[None] for part in moving)))
            self.phase[i] = docking.phase
        if not craft:
            return Steered(np.zeros(0, dtype=np.int64), Motion(*np.zeros((3, 0, 3))), np.zeros(0, dtype=np.bool_))
        who = np.concatenate(craft)
        parts = (np.concatenate(list(part)) for part in zip(*motions, strict=True))
        turned = Turning(*(np.concatenate(list(part)) for part in zip(*turnings, strict=True))) if turnings else None
        return Steered(who, Motion(*parts), self.phase[who] == Phase.DOCKED, turned)

    def clear(self, command: Command, believed: State) -> Command:
        """Return the command nearest to `command` that keeps the craft clear of each other.

        `swarm.onboard.guidance.avoidance` finds it from the broadcasts.
        """
        self.gave_way[:] = False
        watching = self._clearance
        able = np.isfinite(believed.position[watching.craft]).all(axis=1)
        who, distance, brake = watching.craft[able], watching.distance_m[able], watching.brake_m_s2[able]
        if not len(who):
            return command
        conditions = barriers(who, believed.position[who], believed.velocity[who], self._air.heard(), distance, brake)
        most = np.zeros(len(self.phase))
        most[who] = brake
        acceleration, self.gave_way = safe(command.acceleration, conditions, most)
        return command._replace(acceleration=acceleration)


def _stands(docking: Docking, believed: State) -> Closing:
    """Return the estimated closing of the craft's port on the target's, which is at rest in the state's frame."""
    own = placed(docking.own, believed.rotation, believed.position)
    arm = believed.rotation @ docking.own.position
    return closing(own, docking.target, believed.velocity + skew(believed.angular_rate) @ arm)


def _ridden(docking: Docking, time_s: float, believed: State, known: Knowledge, turnings: list[Turning]) -> Moving:
    """Return the reference in the world of a craft that docks to one that moves; the turning goes into `turnings`.

    Args:
        docking: the approach, in the target's axes.
        time_s: beginning of the period [s].
        believed: the craft's own state, without the craft axis.
        known: further inputs.
        turnings: attitudes that are asked for.
    """
    i = docking.craft
    other = known.neighbours.get((i, docking.rides if docking.rides is not None else -1))
    if other is None:
        return at_rest(np.array(docking.from_m))
    if docking.phase == Phase.WAIT:
        docking.begin(at_rest_in(other.state, docking.from_m))
    own = State._make(relative(other.state, believed)[:4])
    tracking = bool(known.tracking[i]) and other.good
    moving = docking.step(
        time_s, own.position, own.velocity, _stands(docking, own), tracking, other.sigma_m, bool(known.latched[i])
    )
    turn = other.state.rotation @ docking.docked_rotation
    turnings.append(Turning(np.array([i]), turn[None], other.state.angular_rate[None]))
    return carried(other.state, moving)
