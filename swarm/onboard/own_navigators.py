"""Navigators of the user's own, in the place of the filter of some craft.

The program's navigation decodes the light, solves the poses and searches for every craft. Where a craft has a navigator
of its own, the filter's result of the period is thrown away; what the user's navigator believes becomes the state of
that filter, from which the next period's angles are expected and its pose is solved.
"""

from collections.abc import Callable, Mapping, Sequence
from typing import Any, NamedTuple, NoReturn, Protocol

import numpy as np

from estimators.arrays import Bools, Floats
from estimators.filter.error_state import POSE_COLUMNS
from estimators.frame import Frame
from estimators.lighthouse.innovation import RowBatch, rows_of_sweeps
from estimators.lighthouse.rows import Station
from estimators.lighthouse.sweep import lighthouse_1
from estimators.state import STATES, State
from swarm.errors import SwarmError
from swarm.messages import Command
from swarm.onboard.decoder import SweepAngles
from swarm.onboard.integrity import Integrity
from swarm.onboard.navigation import Estimate
from swarm.onboard.settings import Coupling, NavigationSettings, Sensor, Status
from swarm.onboard.tracks import Tracks
from swarm.onboard.user_code import at, called, numbers
from swarm.plugin_files import PlugIn
from swarm.plugins import Belief, Light, Navigator, OwnCraft, Pose

ROTATION_TOLERANCE = 1e-6
"""Largest error of an element of R R^T that is taken for rounding."""
SYMMETRY_TOLERANCE = 1e-6
"""Largest asymmetry of a covariance, as a share of the roots of the variances."""


class Rowed(NamedTuple):
    """Light of C craft as rows, of which photodiodes without light have none, and the stations that they name."""

    rows: RowBatch
    stations: Sequence[Station]


class Navigators(Protocol):
    """Navigators of craft, asked after the program's own navigation."""

    def forget(self, mask: Bools) -> None:
        """Begin anew for the craft of the mask (C,)."""

    def step(
        self,
        estimate: Estimate,
        light: Callable[[], Rowed],
        tracks: Tracks,
        command: Command | None,
        time_s: float,
    ) -> Estimate:
        """Return the estimate with the beliefs of the user's navigators.

        Args:
            estimate: of the program's own navigation.
            light: returns the sweep angles of all craft.
            tracks: filters of the program, which take the beliefs over.
            command: orders of the craft for the period that ends with it.
            time_s: epoch [s].
        """


class NoNavigators:
    """Null navigators, where every craft has the program's filter."""

    def forget(self, mask: Bools) -> None:
        """Do nothing."""

    def step(
        self,
        estimate: Estimate,
        light: Callable[[], Rowed],
        tracks: Tracks,
        command: Command | None,
        time_s: float,
    ) -> Estimate:
        """Return the estimate as it is.

        Args:
            estimate: of the program's own navigation.
            light: not used.
            tracks: not used.
            command: not used.
            time_s: not used.
        """
        return estimate


NO_NAVIGATORS = NoNavigators()


class OwnNavigators:
    """Navigators of the user for some of C craft."""

    def __init__(
        self,
        plug_ins: Mapping[int, PlugIn],
        crafts: Sequence[OwnCraft],
        unit_rad: float,
        frame: Frame,
    ) -> None:
        """Make every navigator.

        Args:
            plug_ins: their classes by the index of the craft.
            crafts: what each of the C craft knows of itself.
            unit_rad: angle noise by which the dilution's covariance is multiplied [rad].
            frame: frame of that covariance in the frame of the poses.
        """
        self._plug_ins, self._crafts, self._unit_rad, self._frame = dict(plug_ins), list(crafts), unit_rad, frame
        self._last: Command | None = None
        self._own: dict[int, Navigator | None] = {i: self._made(i) for i in plug_ins}
        self._off: set[int] = set()
        self._known: Bools = np.zeros(len(crafts), dtype=np.bool_)

    def _made(self, craft: int) -> Navigator:
        plug_in, known = self._plug_ins[craft], self._crafts[craft]
        made: Navigator = called(plug_in, f"craft {known.name!r}", plug_in.kind, known)
        return made

    def forget(self, mask: Bools) -> None:
        """Take the navigators away from the craft of the mask (C,), which are off; they will have new ones."""
        self._off = {i for i in self._own if mask[i]}
        self._own.update(dict.fromkeys(self._off))

    def step(
        self,
        estimate: Estimate,
        light: Callable[[], Rowed],
        tracks: Tracks,
        command: Command | None,
        time_s: float,
    ) -> Estimate:
        """Return the estimate with the beliefs of the user's navigators, which the filters take over.

        Args:
            estimate: of the program's own navigation.
            light: returns the sweep angles of all craft.
            tracks: filters of the program, which take the beliefs over.
            command: orders of the craft for the period that ends with it.
            time_s: epoch [s].

        Raises:
            SwarmError: a navigator has raised an exception, or its belief has a wrong shape or no sense.
        """
        out = estimate._replace(
            **{
                name: getattr(estimate, name).copy()
                for name in (*State._fields, "covariance", "status", "nis", "sensor", "coupling", "rows")
            },
            prediction=None,
        )
        rowed = light()
        for i in self._own:
            own, belief = self._light(i, estimate, rowed, command, time_s), None
            if i not in self._off:
                navigator = self._own[i] = self._own[i] or self._made(i)
                plug_in, where = self._plug_ins[i], at(self._crafts[i].name, time_s)
                belief = called(plug_in, where, navigator.step, own)
                belief = None if belief is None else _checked(plug_in, where, belief)
            _write(i, belief, own, out)
        self._last, self._off = command, set()
        self._hand_over(out, tracks)
        return out._replace(integrity=self._without_levels(out.integrity))

    def _light(self, craft: int, estimate: Estimate, rowed: Rowed, command: Command | None, time_s: float) -> Light:
        pose, begun = None, bool(np.isfinite(estimate.position[craft]).all())
        # Before there is a belief, a pose may be one of several: only what starts the program's filter is certain.
        if estimate.pnp.solved[craft] and (begun or self._known[craft]):
            covariance = self._frame.matrix_out(self._unit_rad**2 * estimate.dilution.covariance[craft])
            pose = Pose(estimate.pnp.rotation[craft].copy(), estimate.pnp.position[craft].copy(), covariance)
        elif begun and not self._known[craft]:
            covariance = estimate.covariance[craft][np.ix_(POSE_COLUMNS, POSE_COLUMNS)]
            pose = Pose(estimate.rotation[craft].copy(), estimate.position[craft].copy(), covariance)
        push, turn = np.zeros(3), np.zeros(3)
        if command is not None:
            # Epochs are in the middle of periods: half of the time between them belongs to the last one.
            last = self._last or command
            push = (command.acceleration[craft] + last.acceleration[craft]) / 2
            turn = (command.angular_acceleration[craft] + last.angular_acceleration[craft]) / 2
        return Light(time_s, rowed.rows.of(craft), pose, push, turn, rowed.stations)

    def _hand_over(self, out: Estimate, tracks: Tracks) -> None:
        """Make the beliefs the states of the program's filters."""
        craft = len(out.status)
        own: Bools = np.isin(np.arange(craft), list(self._own))
        known = self._known = own & np.isfinite(out.position).all(axis=1)
        tracks.bank.stop(own & ~known)
        tracks.bank.adopt(known, out.state, out.covariance)
        lit = known & (out.status != Status.COASTING)
        tracks.since_update_s[lit] = 0.0
        tracks.since_pose_s[known & (out.status == Status.TRACKING)] = 0.0

    def _without_levels(self, integrity: Integrity) -> Integrity:
        """Take away the protection levels of these craft's filters: they are those of the program's own filter."""
        position, attitude = integrity.position_m.copy(), integrity.attitude_deg.copy()
        for levels in (position, attitude):
            levels[list(self._own)] = np.nan
        return integrity._replace(position_m=position, attitude_deg=attitude)


def lighthouse_station(settings: NavigationSettings) -> Station:
    """Return the one lighthouse as a station of rows, with the errors of its fans that the craft know."""
    return Station(settings.station.rotation, settings.station.position, lighthouse_1(settings.fan_x, settings.fan_y))


def rows_of(angles: SweepAngles, settings: NavigationSettings) -> Rowed:
    """Return the sweep angles of the one lighthouse as rows."""
    offset = angles.offset_s if settings.motion_compensation else np.zeros_like(angles.offset_s)
    rows = rows_of_sweeps(angles.theta, offset)
    return Rowed(rows, (lighthouse_station(settings),))


def _write(craft: int, belief: Belief | None, light: Light, out: Estimate) -> None:
    """Write the belief of a craft into the estimate of all."""
    if belief is None:
        for name in (*State._fields, "covariance", "nis"):
            getattr(out, name)[craft] = np.nan
        if out.status[craft] != Status.AMBIGUOUS:
            out.status[craft] = Status.SEARCHING
        out.sensor[craft], out.coupling[craft], out.rows[craft] = Sensor.NONE, Coupling.NONE, 0
        return
    for name in (*State._fields, "covariance"):
        getattr(out, name)[craft] = getattr(belief, name)
    took = belief.took_light and len(light.rows.angle) > 0
    by_light = Status.TRACKING if light.pose is not None else Status.SINGLE_SWEEPS
    out.status[craft] = by_light if took else Status.COASTING
    out.sensor[craft] = Sensor.LIGHTHOUSE if took else Sensor.NONE
    out.coupling[craft] = Coupling.TIGHT if took else Coupling.NONE
    out.nis[craft], out.rows[craft] = (belief.nis, belief.freedom) if took else (np.nan, 0)


def _checked(plug_in: PlugIn, where: str, belief: Any) -> Belief:
    """Return a belief of a user's navigator, with every value as it must be. Raises SwarmError where one is not."""

    def refuse(what: str) -> NoReturn:
        raise SwarmError(f"{plug_in.said}: {where}: {what}")

    if not isinstance(belief, Belief):
        refuse(f"step must return a Belief or None, not {type(belief).__name__}")

    def part(name: str, *shape: int) -> Floats:
        return numbers(plug_in, where, f"{name} of the belief", getattr(belief, name), shape)

    rotation, covariance = part("rotation", 3, 3), part("covariance", STATES, STATES)
    position, velocity, rate = (part(name, 3) for name in ("position", "velocity", "angular_rate"))
    if abs(rotation @ rotation.T - np.eye(3)).max() > ROTATION_TOLERANCE or np.linalg.det(rotation) < 0:
        refuse("rotation of the belief is not a rotation matrix: R R^T is not 1, or det R not 1")
    variance = np.diagonal(covariance)
    if not (variance > 0).all():
        refuse("covariance of the belief has a variance that is not above zero")
    scaled = covariance / np.sqrt(np.outer(variance, variance))
    if abs(scaled - scaled.T).max() > SYMMETRY_TOLERANCE:
        refuse("covariance of the belief is not symmetric")
    if np.linalg.eigvalsh((scaled + scaled.T) / 2)[0] <= 0:
        refuse("covariance of the belief is not positive definite")
    try:
        took, nis, freedom = bool(belief.took_light), float(belief.nis), int(belief.freedom)
    except (TypeError, ValueError):
        refuse("took_light, nis and freedom of the belief must be true or false, a number and a whole number")
    if freedom < 1:
        refuse(f"freedom of the belief must be at least 1, not {freedom}")
    return Belief(rotation, position, velocity, rate, (covariance + covariance.T) / 2, took, nis, freedom)
