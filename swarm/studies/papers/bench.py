"""One craft before the lighthouse, many independent periods of it as one batch.

The sensor chain is the simulator's own: a ray cast says which photodiodes are lit, the crossing instants are solved on
the moving craft, pulses are rounded to ticks of a clock of random phase and decoded (1). But a row of the batch is a
period, not a craft: the rotor's error is shared by the photodiodes of a row and fan, and drawn afresh for every row.
"""

from pathlib import Path
from typing import NamedTuple

import numpy as np

from estimators import rotation as rot
from estimators.arrays import Bools, Floats
from estimators.lighthouse.pnp import PoseSolution, refine
from estimators.lighthouse.sweep import FanErrors, FanPair, kernel_fans, lighthouse_1
from swarm.flight import builders
from swarm.hardware import Photodiodes
from swarm.messages import SYNC_WIDTH_S, SYNC_WIDTH_STEP_S, Pulses
from swarm.onboard.acquisition import NONE, Sighting, follow, search
from swarm.onboard.decoder import PulseDecoder, SweepAngles
from swarm.scenario import validate
from swarm.sensors.crossing import cross_into, knots_of, side_by_side
from swarm.sensors.pulses import pack_into, pulse_room
from swarm.sensors.visibility import Visibility
from swarm.units import SI, si
from swarm.world.motion.pointing import facing

PERFECT: FanPair = (FanErrors(), FanErrors())
FIRST_TICK, CLOCK_S = 1e6, 1200.0
"""A clock shows between so many ticks and so many seconds more at a period's start."""


class Motion(NamedTuple):
    """The motion of N rows within their period, in straight lines at constant rates about the epoch.

    rotation (N, 3, 3), position (N, 3) [m] at the epoch; angular_rate (N, 3) [rad/s], velocity (N, 3) [m/s].
    """

    rotation: Floats
    position: Floats
    angular_rate: Floats
    velocity: Floats

    @classmethod
    def rest(cls, rotation: Floats, position: Floats) -> "Motion":
        """Return rows that do not move."""
        return cls(rotation, position, np.zeros_like(position), np.zeros_like(position))

    def repeat(self, count: int) -> "Motion":
        """Return every row `count` times, one after the other."""
        row = np.repeat(np.arange(len(self.position)), count)
        return Motion(self.rotation[row], self.position[row], self.angular_rate[row], self.velocity[row])


class Box(NamedTuple):
    """The box that poses are drawn in.

    The craft faces the lighthouse but for a turn of at most turn_rad, with at least fewest_lit photodiodes lit.
    """

    centre_m: tuple[float, float, float]
    size_m: tuple[float, float, float]
    turn_rad: float
    fewest_lit: int = 6


class Bench:
    """A craft model before a lighthouse of default settings."""

    settings: SI
    """The station, in SI units."""
    layout: Photodiodes
    """The photodiodes of the one craft, (1, K)."""

    def __init__(self, model: str = "mockup") -> None:
        """Build the craft's world, for its shape. Raises SwarmError where there is no such model."""
        scenario = validate({"swarm": {"count": 1, "model": model}}, file=model, folder=Path.cwd())
        self.settings = si(scenario.lighthouse)
        world = builders.world(scenario, builders.fleet(scenario))
        self.layout = world.photodiodes
        self._visibility = Visibility(
            world.model, self.layout, world.craft_bodies, world.lighthouse_body, scenario.lighthouse
        )

    @property
    def point_m(self) -> Floats:
        """The places of the photodiodes as drawn, (K, 3) [m] in the body frame."""
        point: Floats = self.layout.point_m[0]
        return point

    @property
    def period_s(self) -> float:
        """One turn of the rotors [s]."""
        return 1.0 / float(self.settings.rate_hz)

    def lit(self, rotation: Floats, position: Floats) -> Bools:
        """Tell by ray cast which photodiodes (N, K) are lit with the craft at poses (N, 3, 3), (N, 3) [m]."""
        quaternion = rot.quaternion_from_matrix(rotation)
        out = np.zeros((len(position), self.layout.present.shape[1]), dtype=np.bool_)
        for i in range(len(position)):
            out[i] = self._visibility.lit(position[i : i + 1], quaternion[i : i + 1])[0]
        return out

    def random_pose(self, rng: np.random.Generator, box: Box) -> tuple[Motion, Bools]:
        """Draw a pose at rest (one row) within `box`; return it with its lit photodiodes (1, K)."""
        still = np.zeros((1, 3))
        while True:
            place = np.array(box.centre_m) + np.array(box.size_m) * rng.uniform(-0.5, 0.5, 3)
            turned = rot.exp(box.turn_rad * rng.uniform(-1, 1, 3) / np.sqrt(3))
            rotation = facing(place[None], still, still).rotation @ turned
            lit = self.lit(rotation, place[None])
            if np.count_nonzero(lit) >= box.fewest_lit:
                return Motion.rest(rotation, place[None]), lit

    def noise(self, rows: int, rng: np.random.Generator, noise_rad: float, rotor_correlation: float) -> Floats:
        """Draw angle errors (19): the rotor's, shared within a row and fan, and each angle's own.

        Args:
            rows: Number of rows N.
            rng: Source of the draws.
            noise_rad: Standard deviation of an angle [rad].
            rotor_correlation: Share of the variance that is the rotor's.

        Returns:
            Errors (N, K, 2) [rad].
        """
        own = rng.standard_normal((rows, self.layout.present.shape[1], 2))
        shared = rng.standard_normal((rows, 1, 2))
        out: Floats = noise_rad * (np.sqrt(rotor_correlation) * shared + np.sqrt(1 - rotor_correlation) * own)
        return out

    def angles(
        self,
        motion: Motion,
        lit: Bools,
        error_rad: Floats,
        rng: np.random.Generator,
        *,
        fans: FanPair = PERFECT,
        point_m: Floats | None = None,
        tick_s: float | None = None,
    ) -> SweepAngles:
        """Return the angles that N independent periods of the craft deliver on board.

        Args:
            motion: Motion of the N rows.
            lit: Photodiodes that are lit (N, K).
            error_rad: Errors added to the fans' angles (N, K, 2) [rad].
            rng: Source of the clocks' phases.
            fans: The station's systematic errors.
            point_m: Where the photodiodes really are (N, K, 3) [m]; default: as drawn.
            tick_s: Tick of the clocks [s]; default: the station's.
        """
        rows, photodiodes = lit.shape
        tick = self.settings.tick_s if tick_s is None else tick_s
        pulses = Pulses(
            np.full((rows, 4 * photodiodes), -1, dtype=np.int16),
            np.zeros((rows, 4 * photodiodes), dtype=np.int64),
            np.zeros((rows, 4 * photodiodes), dtype=np.int32),
            np.zeros(rows, dtype=np.int32),
        )
        points = np.broadcast_to(self.layout.point_m, (rows, photodiodes, 3)) if point_m is None else point_m
        both = np.repeat(lit[..., None], 2, axis=-1)
        instant, width = self._crossings(motion, np.where(both, error_rad, np.nan), fans, points)
        clock = FIRST_TICK + CLOCK_S / tick * np.asarray(rng.random(rows))
        flash_width = (SYNC_WIDTH_S + SYNC_WIDTH_STEP_S * np.arange(2)) / tick
        pack_into(
            both,
            instant,
            width,
            np.zeros(rows, dtype=np.int64),
            np.zeros((rows, 0, 3)),
            np.array([0.0, self.period_s / 2]),
            np.rint(flash_width).astype(np.int64),
            clock,
            tick,
            pulse_room(photodiodes),
            pulses,
        )
        present = np.broadcast_to(self.layout.present, (rows, photodiodes))
        half = self.settings.field_rad / 2 + builders.FAN_ERROR_MAX_RAD
        return PulseDecoder(present, tick, rate_hz=self.settings.rate_hz, field_half_angle_rad=half).decode(pulses)

    def _crossings(self, motion: Motion, error_rad: Floats, fans: FanPair, point_m: Floats) -> tuple[Floats, Floats]:
        """Return the instants and widths of the sweeps [s], craft side by side, of errors (N, K, 2), NaN if not lit."""
        error = side_by_side(error_rad)
        instant, width = np.empty_like(error), np.empty_like(error)
        knot = np.linspace(0.0, self.period_s, 3)
        since = knot[:, None, None] - self.period_s / 2
        cross_into(
            knots_of(
                knot,
                motion.position + motion.velocity * since,
                rot.quaternion_from_matrix(rot.exp(motion.angular_rate * since) @ motion.rotation),
            ),
            side_by_side(point_m),
            side_by_side(np.broadcast_to(self.layout.normal, point_m.shape)),
            error,
            kernel_fans(lighthouse_1(*fans)),
            self.period_s,
            self.settings.photodiode_diameter_m,
            instant,
            width,
        )
        return instant, width

    def solve(
        self, angles: SweepAngles, start: Motion, *, at_rest: bool = True, point_m: Floats | None = None
    ) -> PoseSolution:
        """Solve every row by PnP.

        Args:
            angles: Measured angles of the N rows.
            start: Poses to start from, and the rows' true rates.
            at_rest: Take the rows to be at rest, instead of moving at their true rates.
            point_m: Where the photodiodes are believed to be (K, 3) [m]; default: as drawn.
        """
        still = np.zeros_like(start.velocity)
        return refine(
            angles.theta,
            angles.lit,
            np.broadcast_to(self.point_m if point_m is None else point_m, (*angles.lit.shape, 3)),
            start.rotation,
            start.position,
            angles.offset_s,
            still if at_rest else start.angular_rate,
            still if at_rest else start.velocity,
        )

    def first_pose(self, angles: SweepAngles, noise_rad: float, point_m: Floats | None = None) -> Motion | None:
        """Find the pose of a craft at rest from nothing, as on board: one row after the other.

        Args:
            angles: Measured angles of the N rows, all of one pose.
            noise_rad: Independent part of the angle noise [rad].
            point_m: Where the photodiodes are believed to be (K, 3) [m]; default: as drawn.

        Returns:
            The pose, one row; None where it stays ambiguous to the last row.
        """
        hypotheses, points = NONE, self.point_m if point_m is None else point_m
        for i in range(len(angles.lit)):
            sighting = Sighting(angles.theta[i], angles.lit[i], points, angles.offset_s[i])
            known = follow(hypotheses, sighting, noise_rad) if len(hypotheses.evidence) else NONE
            hypotheses = known if len(known.evidence) else search(sighting, noise_rad)
            if hypotheses.decided:
                return Motion.rest(hypotheses.rotation[:1], hypotheses.position[:1])
        return None
