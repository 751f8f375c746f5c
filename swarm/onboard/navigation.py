"""One craft's way from sweep angles to its pose, for C craft side by side: PnP, dilution of precision, EKF.

Per lighthouse period and craft:

    angles, less the known errors of the fans            estimators.lighthouse.sweep
    -> pose at the epoch, LM on (7) from the prediction   estimators.lighthouse.pnp        (searching: from nothing,
    acquisition) -> residuals tested, false photodiodes dropped        estimators.lighthouse.integrity, by
    swarm.onboard.integrity -> H, ADOP, PDOP at that pose (13) to (22)            estimators.lighthouse.dop -> EKF with
    measurement covariance s^2 H              estimators.filter.filterpy_bank, or for a large swarm compiled_filter

Craft with a pair of cameras then give the same EKF the pose that these see, `swarm.onboard.ccd`, with its covariance:
two sensors are two updates, one after the other, and either is enough.

A craft is *searching* (no pose), *ambiguous* (more than one pose fits: none is given), *tracking* (this period's pose
went into the filter) or *coasting* (prediction only: too few photodiodes lit, or the pose was not believed).
Every craft uses its own angles, layout and filter; nothing in here mixes rows of the craft axis.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field
from enum import IntEnum, IntFlag
from typing import NamedTuple

import numpy as np

from estimators import rotation as rot
from estimators.arrays import Bools, Floats, Ints
from estimators.filter.bank import FilterBank
from estimators.filter.compiled import CompiledFilterBank
from estimators.filter.error_state import (
    DEFAULT_ACCELERATION_NOISE_M_S2,
    DEFAULT_ANGULAR_ACCELERATION_NOISE_RAD_S2,
    RATE_COLUMNS,
)
from estimators.filter.filterpy_bank import PoseFilterBank
from estimators.lighthouse.dop import Dilution, dilution
from estimators.lighthouse.integrity import Sweeps
from estimators.lighthouse.pnp import PoseSolution, refine
from estimators.lighthouse.sweep import FanErrors, correct
from estimators.relative_orbit import RelativeOrbit, acceleration
from swarm.hardware import Photodiodes
from swarm.messages import LightImages
from swarm.onboard import ccd
from swarm.onboard.acquisition import NONE, Hypotheses, Sighting, advance, search
from swarm.onboard.ccd import CcdCalibration, CcdFix, CcdState
from swarm.onboard.control import Command
from swarm.onboard.decoder import SweepAngles
from swarm.onboard.integrity import Filtered, Integrity, IntegritySettings, Monitor, Screened

MIN_LIT = 4
"""Photodiodes that a pose needs (source 1, section 2)."""
MOST_BY_FILTERPY = 64
"""A swarm of more craft is filtered by the compiled bank, unless the scenario says otherwise."""
UNKNOWN_RATE = (1.0, 0.5)
"""1 sigma per axis of a craft's rates before it knows them: angular [rad/s], linear [m/s]."""


class Status(IntEnum):
    """What a craft knows of its pose."""

    SEARCHING = 0
    TRACKING = 1
    COASTING = 2
    AMBIGUOUS = 3


class Sensor(IntFlag):
    """Whose pose went into a craft's filter this period; the names are `swarm.results.columns.schema.SENSORS`."""

    NONE = 0
    LIGHTHOUSE = 1
    STEREO = 2
    CAMERA = 4


@dataclass(frozen=True)
class NavigationSettings:
    """What a craft's computer is configured with, in SI units.

    angle_noise_rad and rotor_correlation are s and rho of (18), (19). residual_limit_rad: a worse fit is not a pose.
    rejections_limit: so many poses in a row refused by the gate mean that the filter is wrong, not they. filter:
    "filterpy", "compiled", which has the same numbers sooner, or "auto", which goes by the number of craft. orbit: the
    lighthouse's, None in weightless space.
    """

    frame_s: float
    angle_noise_rad: float
    rotor_correlation: float
    motion_compensation: bool = True
    acceleration_noise_m_s2: float = DEFAULT_ACCELERATION_NOISE_M_S2
    angular_acceleration_noise_rad_s2: float = DEFAULT_ANGULAR_ACCELERATION_NOISE_RAD_S2
    gate_probability: float = 0.99999
    coast_limit_s: float = 2.0
    residual_limit_rad: float = 5e-3
    rejections_limit: int = 6
    search_again_s: float = 0.25
    filter: str = "auto"
    fan_x: FanErrors = field(default_factory=FanErrors)
    fan_y: FanErrors = field(default_factory=FanErrors)
    integrity: IntegritySettings = field(default_factory=IntegritySettings)
    orbit: RelativeOrbit | None = None


class Estimate(NamedTuple):
    """What C craft know at one epoch; NaN where unknown.

    status: (C,), of `Status`. visible: (C,), photodiodes seen by both fans. pnp: this period's own poses. dilution: at
    those poses. rotation (C, 3, 3), position (C, 3) [m], angular_rate (C, 3) [rad/s], velocity (C, 3) [m/s] and
    covariance (C, 12, 12), ordered (attitude, angular rate, position, velocity): the filter's, in the lighthouse frame.
    nis: (C,), normalised innovation squared of this period's pose. missed_sync, rejected: (C,), from the decoder.
    sensor: (C,), of `Sensor`. ccd: what the cameras found; None where no craft has any. integrity: what the craft make
    of their own poses.
    """

    status: Ints
    visible: Ints
    pnp: PoseSolution
    dilution: Dilution
    rotation: Floats
    position: Floats
    angular_rate: Floats
    velocity: Floats
    covariance: Floats
    nis: Floats
    missed_sync: Ints
    rejected: Ints
    sensor: Ints
    ccd: CcdFix | None
    integrity: Integrity


class Navigator:
    """The navigation computers of C craft: `step` takes one period's angles of each and returns what each knows."""

    def __init__(
        self, photodiodes: Photodiodes, settings: NavigationSettings, cameras: Sequence[CcdCalibration] = ()
    ) -> None:
        """photodiodes: each craft's own layout as it believes it to be (nominal or calibrated).

        cameras: of the craft that carry a pair, in the order of their images.
        """
        craft = photodiodes.craft_count
        self._cameras = tuple(cameras)
        self._command: Command | None = None
        self.settings = settings
        self._point_m = photodiodes.point_m
        compiled = craft > MOST_BY_FILTERPY if settings.filter == "auto" else settings.filter == "compiled"
        bank: type[FilterBank] = CompiledFilterBank if compiled else PoseFilterBank
        self._filter = bank(
            craft,
            acceleration_noise_m_s2=settings.acceleration_noise_m_s2,
            angular_acceleration_noise_rad_s2=settings.angular_acceleration_noise_rad_s2,
            gate_probability=settings.gate_probability,
        )
        self._hypotheses: list[Hypotheses] = [NONE] * craft
        self._undecided = np.zeros(craft, dtype=np.bool_)
        self._since_update_s = np.zeros(craft)
        self._rejections = np.zeros(craft, dtype=np.int64)
        self._independent_noise_rad = settings.angle_noise_rad * float(np.sqrt(1 - settings.rotor_correlation))
        noise = settings.angle_noise_rad, settings.rotor_correlation
        self._monitor = Monitor(settings.integrity, *noise, (craft, photodiodes.present.shape[1]))

    def forget(self, mask: Bools) -> None:
        """Forget everything that the computers of these craft (C,) have found out, as one does that starts again."""
        self._filter.stop(mask)
        for craft in np.flatnonzero(mask):
            self._hypotheses[craft] = NONE
        self._undecided[mask] = False
        self._since_update_s[mask], self._rejections[mask] = 0.0, 0
        if self._command is not None:
            self._command = self._command.only(~mask)
        self._monitor.forget(mask)

    def step(self, angles: SweepAngles, images: LightImages | None = None, command: Command | None = None) -> Estimate:
        """Advance every craft by one lighthouse period; the result refers to the epoch of `angles`.

        images: what the cameras saw at the epoch; craft with cameras need them. command: what the craft have ordered
        their actuators to do in this period, from its beginning to its end.
        """
        s, bank = self.settings, self._filter
        speed = self._monitor.speed(angles, s.frame_s)
        turned = angles.theta if speed is None else angles.theta * speed[:, None, None]
        theta = correct(turned, (s.fan_x, s.fan_y))
        lit = angles.lit & np.isfinite(theta[..., 0]) & np.isfinite(theta[..., 1])
        visible = np.count_nonzero(lit, axis=1)
        enough = visible >= MIN_LIT

        active = bank.active
        pull = None if s.orbit is None else acceleration(s.orbit, bank.position, bank.velocity)
        bank.predict(s.frame_s, active)
        if pull is not None:
            still = np.zeros_like(pull)
            bank.add_motion(active, still, still, pull * s.frame_s**2 / 2, pull * s.frame_s)
        if command is not None:
            self._add_command(command)
        found, start_rotation, start_position = self._acquire(theta, lit, angles.offset_s, enough)
        known = enough & (active | found)

        # The motion within the period, as each craft believes it; a craft that has only just found itself knows none.
        moves = active[:, None] & s.motion_compensation
        angular_rate = np.where(moves, bank.angular_rate, 0.0)
        velocity = np.where(moves, bank.velocity, 0.0)
        sweeps = Sweeps(theta, lit & known[:, None], self._point_m, angles.offset_s, angular_rate, velocity)
        pnp = refine(*sweeps[:3], start_rotation, start_position, *sweeps[3:])
        pnp = pnp._replace(solved=pnp.solved & (pnp.residual_rad < s.residual_limit_rad))
        start = start_rotation, start_position
        screened = self._monitor.screen(sweeps, known, visible, pnp, start, self._rate_covariance)
        pnp = screened.solution
        precision = dilution(pnp.rotation, pnp.position, screened.lit, *sweeps[2:], s.rotor_correlation, pnp.solved)
        nis, fresh, refused = self._filter_poses(pnp, precision, found)
        by_gate = refused
        sensor = np.where(fresh, Sensor.LIGHTHOUSE, Sensor.NONE)
        seen = None
        if images is not None:
            seen, by_camera, refused_too = self._filter_fixes(images)
            fresh, refused = fresh | by_camera, refused | refused_too
            kind = np.where(seen.state == CcdState.STEREO, Sensor.STEREO, Sensor.CAMERA)
            sensor = np.where(by_camera, sensor | kind, sensor)
        self._count(fresh, refused)
        return self._estimate(angles, visible, screened, precision, nis, sensor, seen, by_gate)

    def _rate_covariance(self, craft: int) -> Floats:
        """Of the rates (angular, linear) that a craft assumes within the period, (6, 6): predicted, or none at all."""
        if self._filter.active[craft]:
            covariance: Floats = self._filter.covariance[craft][np.ix_(RATE_COLUMNS, RATE_COLUMNS)]
            return covariance
        return np.diag(np.repeat(np.square(UNKNOWN_RATE), 3))

    def _add_command(self, command: Command) -> None:
        """Add what the craft did between the epochs, T apart: half a period by the last command, half by this one."""
        last, half = self._command or command, self.settings.frame_s / 2
        self._command = command
        if not any(order.any() for order in (*last, *command)):
            # A swarm that is steered by the truth orders nothing that its filters could know.
            return
        rate, velocity = ((a + b) * half for a, b in zip(last[::-1], command[::-1], strict=True))
        turn, shift = ((3 * a + b) * half**2 / 2 for a, b in zip(last[::-1], command[::-1], strict=True))
        self._filter.add_motion(self._filter.active, turn, rate, shift, velocity)

    def _acquire(self, theta: Floats, lit: Bools, offset_s: Floats, enough: Bools) -> tuple[Bools, Floats, Floats]:
        """Start poses for this period's LM: the prediction, or for a craft without one what a search decided on.

        Returns found (C,), the craft that have just found themselves, and rotation (C, 3, 3), position (C, 3).
        """
        bank, active = self._filter, self._filter.active
        rotation, position = bank.rotation, bank.position
        found = np.zeros(len(enough), dtype=np.bool_)
        lost = active & (self._since_update_s > self.settings.search_again_s)
        who = np.flatnonzero(enough & (lost | ~active))
        before = [self._hypotheses[i] for i in who]
        sightings = [Sighting(theta[i], lit[i], self._point_m[i], offset_s[i]) for i in who]
        for i, hypotheses in zip(who, advance(before, sightings, self._independent_noise_rad), strict=True):
            if not active[i] and len(hypotheses.evidence) and not hypotheses.decided:
                seen = Sighting(theta[i], lit[i], self._point_m[i], offset_s[i])
                hypotheses = self._without_false(int(i), hypotheses, seen)
            if hypotheses.decided:
                rotation[i], position[i] = hypotheses.rotation[0], hypotheses.position[0]
                found[i] = not active[i]
                hypotheses = NONE
            elif active[i] and len(hypotheses.evidence):
                # After a long coast the prediction itself tells mirror poses apart; the gate has the last word.
                nearest = int(np.argmin(rot.angle_between(hypotheses.rotation, rotation[i])))
                rotation[i], position[i] = hypotheses.rotation[nearest], hypotheses.position[nearest]
                hypotheses = NONE
            self._hypotheses[i] = hypotheses
            self._undecided[i] = len(hypotheses.evidence) > 0
        return found, rotation, position

    def _without_false(self, craft: int, hypotheses: Hypotheses, seen: Sighting) -> Hypotheses:
        """The hypotheses of a craft that is searching, or where a false photodiode spoils them those of the others."""
        rest = np.zeros((1, 3))
        one = Sweeps(seen.theta[None], seen.lit[None], seen.point_m[None], seen.offset_s[None], rest, rest)
        best = hypotheses.rotation[0], hypotheses.position[0]
        lit = self._monitor.honest(one, *best, self._rate_covariance(craft))
        return hypotheses if lit is None else search(seen._replace(lit=lit), self._independent_noise_rad)

    def _filter_poses(self, pnp: PoseSolution, precision: Dilution, found: Bools) -> tuple[Floats, Bools, Bools]:
        """Feed this period's poses to the filters, start filters; NIS, taken in, refused by the gate, each (C,)."""
        s, bank = self.settings, self._filter
        usable = pnp.solved & np.isfinite(precision.pdop_m_per_rad)
        covariance = s.angle_noise_rad**2 * precision.covariance
        coupling = precision.rate_coupling if s.motion_compensation else np.zeros_like(precision.rate_coupling)

        update = usable & bank.active
        result = bank.update_pose(update, pnp.rotation, pnp.position, covariance, coupling)

        start = usable & found
        bank.start(start, pnp.rotation, pnp.position, covariance, UNKNOWN_RATE, precision.rate_coupling)

        return np.where(update, result.nis, np.nan), start | result.accepted, update & ~result.accepted

    def _filter_fixes(self, images: LightImages) -> tuple[CcdFix, Bools, Bools]:
        """The same with the cameras' poses, after the lighthouse's; an image has one instant, so no rate enters."""
        bank = self._filter
        active = bank.active
        found = ccd.fix(len(active), self._cameras, images, bank.rotation, bank.position)
        update, start = found.known & active, found.known & ~active
        none = np.zeros_like(found.covariance)
        result = bank.update_pose(update, found.rotation, found.position, found.covariance, none)
        bank.start(start, found.rotation, found.position, found.covariance, UNKNOWN_RATE)
        nis = np.where(update, result.nis, np.nan)
        return found._replace(nis=nis), start | result.accepted, update & ~result.accepted

    def _count(self, fresh: Bools, refused: Bools) -> None:
        """Note who has had a pose; stop the filters of those who have had none for long, or refused too many."""
        s, bank = self.settings, self._filter
        self._since_update_s = np.where(fresh, 0.0, self._since_update_s + s.frame_s)
        self._rejections = np.where(fresh, 0, self._rejections + refused)
        bank.stop(bank.active & ((self._since_update_s > s.coast_limit_s) | (self._rejections >= s.rejections_limit)))

    def _estimate(
        self,
        angles: SweepAngles,
        visible: Ints,
        screened: Screened,
        precision: Dilution,
        nis: Floats,
        sensor: Ints,
        seen: CcdFix | None,
        refused: Bools,
    ) -> Estimate:
        bank, by_lighthouse = self._filter, (sensor & Sensor.LIGHTHOUSE) != 0
        active, pose = bank.active, (bank.rotation, bank.position, bank.covariance)
        filtered = Filtered(by_lighthouse, refused & active, active, *pose)
        status = np.where(self._undecided, Status.AMBIGUOUS, Status.SEARCHING)
        fresh = np.where(self._since_update_s == 0.0, Status.TRACKING, Status.COASTING)
        return Estimate(
            status=np.where(active, fresh, status).astype(np.int64),
            visible=visible,
            pnp=screened.solution,
            dilution=precision,
            rotation=filtered.rotation,
            position=filtered.position,
            angular_rate=bank.angular_rate,
            velocity=bank.velocity,
            covariance=filtered.covariance,
            nis=nis,
            missed_sync=angles.missed_sync,
            rejected=angles.rejected,
            sensor=sensor.astype(np.int64),
            ccd=seen,
            integrity=self._monitor.levels(screened, precision, filtered),
        )
