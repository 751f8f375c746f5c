"""Inspection of an uncooperative target by craft with a LiDAR: the target's pose, per observer and fused.

Per scan and observer, at the epoch of the lighthouse period in which the scan is complete:

    scan, everything moved to the epoch                                  swarm.onboard.lidar
    -> no track: acquire, without a prediction, by all scans since then   estimators.lidar.evidence
    -> a track: register, from the filter's prediction                    estimators.lidar.tracking
    -> lost (residual, overlap, gate) in several successive scans: acquire again from this very scan
    -> pose of the target in the lighthouse frame, through the observer's own fix
    -> EKF, the same one as for craft                                     estimators.filter.filterpy_bank

All in the lighthouse frame. With the observer at (R_o, p_o), its scanner turned by R_l_s, the target found at
(R_s_t, p_s) in the scanner's frame, and r = p - p_o,

    R = R_l_s R_s_t,   p = p_l_s + R_l_s p_s,   P = A O A^T + B P_scan B^T,   B = diag(R_l_s, R_l_s)

with the covariance O of the observer's own filter and A of `swarm.onboard.own_error`: the error of the observer's own
fix lasts longer than a scan, and is considered as what it is, correlated from scan to scan. All rays of the target have
an age tau; wrong rates of the target shift the pose by tau times their error, which is the filter's coupling B = tau I.

The observers' poses of one target also update one further filter, observer by observer: the target's fused estimate.

All of these filters run several models of motion (`estimators.filter.interacting`), from the process noise of the
settings to a tenth of it, and turn by Euler's equation with the ratios of inertia that the attitudes so far have
told (`estimators.filter.tumble`). While no scan comes in, attitude, rate and their covariance are those of that
estimate, which knows how far its inertia may be wrong; filters go on as long as what they predict is near enough for
tracking.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from estimators import rotation as rot
from estimators.arrays import Bools, Floats
from estimators.filter.error_state import (
    DEFAULT_ACCELERATION_NOISE_M_S2,
    DEFAULT_ANGULAR_ACCELERATION_NOISE_RAD_S2,
    POSE_COLUMNS,
    RATE_COLUMNS,
)
from estimators.filter.filterpy_interacting import FilterpyInteractingBank
from estimators.filter.smoother import Models, Prediction, no_models, predicted
from estimators.filter.tumble import PARTS, Inertia, Tumble, tensors
from estimators.free_rotation import free_turns
from estimators.lidar.acquisition import Verdict
from estimators.lidar.evidence import Evidence
from estimators.lidar.scan import Scan
from estimators.lidar.shape import Shape
from estimators.lidar.symmetry import Symmetry, symmetry
from estimators.lidar.tracking import track
from estimators.state import State
from swarm.messages import LidarPattern, LidarScan
from swarm.onboard.lidar import at_epoch, scanner
from swarm.onboard.navigation import Estimate
from swarm.onboard.own_error import OwnErrors, own_part
from swarm.onboard.settings import Status

LIDAR_SENSOR = 6
"""Code of `swarm.results.columns.core.SENSORS`: no sum of `Sensor`s, as a pair of cameras is never one camera too."""
UNKNOWN_RATE = (0.3, 0.3)
"""Standard deviation per axis of a target's rates before they are known: angular [rad/s], linear [m/s]."""
MODELS, QUIETEST = 4, 0.1
"""Models of the target's motion, and the process noise of the quietest against the liveliest."""
QUIET_S, MANOEUVRE_S = 20.0, 2.0
"""Mean times after which a target begins to move more, and less [s]."""
BLIND_S = 0.5
"""Time without a pose from which on the tumbling body predicts [s]."""
LASTS = 8.0
"""Scans through which an error of the observer's own fix lasts: so many say of it no more than one."""
NEAR_RAD, NEAR = 0.1, 0.08
"""Standard deviations of attitude, and of position against the shape's radius, from which tracking starts safely."""
POSE, RATES = POSE_COLUMNS, RATE_COLUMNS
"""Indices of (attitude, position) and of their rates in the filter's state."""


class Observer(NamedTuple):
    """One LiDAR.

    craft: index of the craft that carries it. target: index of the craft that it observes. pattern: the LiDAR's
    pattern. shape: known shape of the target.
    """

    craft: int
    target: int
    pattern: LidarPattern
    shape: Shape


@dataclass(frozen=True)
class InspectionSettings:
    """Settings of the inspection, in SI units.

    frame_s: length of a lighthouse period. acceleration_noise_m_s2, angular_acceleration_noise_rad_s2: process noise of
    the target's filter. gate_probability: of the filter's gate. coast_limit_s: time without a pose after which the
    filter is stopped. lost_after: number of successive scans that do not track after which the target is lost.
    own_acceleration_noise_m_s2, own_angular_acceleration_noise_rad_s2: process noise of the observers' own filters.
    """

    frame_s: float
    acceleration_noise_m_s2: float = 0.005
    angular_acceleration_noise_rad_s2: float = np.radians(1.0)
    gate_probability: float = 0.99999
    coast_limit_s: float = 2.0
    lost_after: int = 3
    own_acceleration_noise_m_s2: float = DEFAULT_ACCELERATION_NOISE_M_S2
    own_angular_acceleration_noise_rad_s2: float = DEFAULT_ANGULAR_ACCELERATION_NOISE_RAD_S2


class LidarFix(NamedTuple):
    """Result of one scan; NaN without a pose.

    craft, target: indices. outcome: of `estimators`' Verdict (acquisition) or Outcome (tracking), in words, or why
    nothing was tried. acquired: whether it was an acquisition. points: number of returns of the target. residual_m,
    overlap, confidence: quality of the registration.

    rotation (3, 3), position (3,) [m], covariance (6, 6): the pose found, lighthouse frame. accepted: whether the
    filter accepted it. nis: its squared innovation, normalised. symmetry: the shape's own; a pose means its whole
    class. inertia: what all scans so far, the other observers' included, tell of the target's ratios of inertia; None
    before the first pose. ekf_rotation, ekf_position, ekf_covariance (6, 6): the observer's own filter afterwards.
    cloud: returns in the lighthouse frame, by the observer's own estimate, (n, 3) [m].
    """

    craft: int
    target: int
    outcome: str
    acquired: bool
    points: int
    residual_m: float
    overlap: float
    confidence: float
    rotation: Floats
    position: Floats
    covariance: Floats
    accepted: bool
    nis: float
    symmetry: Symmetry
    inertia: Inertia | None
    ekf_rotation: Floats
    ekf_position: Floats
    ekf_covariance: Floats
    cloud: Floats


class _Measured(NamedTuple):
    """A pose of the target in the lighthouse frame. of_own (6, 12), A, and own (12, 12), O, are of
    `swarm.onboard.own_error`, and part of the covariance (6, 6). age_s: mean time of the rays, from the epoch [s].
    """

    rotation: Floats
    position: Floats
    covariance: Floats
    of_own: Floats
    own: Floats
    age_s: float


class _Pose(NamedTuple):
    """A pose of the target in the scanner's frame; `good` if it is accepted."""

    rotation: Floats
    position: Floats
    covariance: Floats
    outcome: str
    good: bool
    acquired: bool
    points: int
    residual_m: float
    overlap: float
    confidence: float


class Inspection:
    """The computers of all observers: `step` takes the scans completed in a period and returns each observer's result.

    Rows of the filter bank: the observers, in order, then the fused targets.
    """

    def __init__(self, observers: Sequence[Observer], settings: InspectionSettings) -> None:
        self.observers, self.settings = tuple(observers), settings
        self.targets = sorted({o.target for o in observers})
        rows = len(self.observers) + len(self.targets)
        most = settings.acceleration_noise_m_s2, settings.angular_acceleration_noise_rad_s2
        self._filter = FilterpyInteractingBank(
            [(share * most[0], share * most[1]) for share in np.geomspace(1, QUIETEST, MODELS).tolist()],
            QUIET_S,
            MANOEUVRE_S,
            np.full(rows, MODELS),
            settings.gate_probability,
        )
        self._target = np.array([o.target for o in self.observers] + self.targets, dtype=np.int64)
        self._tumble: dict[int, Tumble] = {}
        self._waits_s = dict.fromkeys(self.targets, 0.0)
        self._refused = dict.fromkeys(self.targets, 0)
        fused = [(self._fused(i), i) for i in range(len(self.observers))]
        self._own = OwnErrors(
            [(i, i) for i in range(len(self.observers))] + fused,
            settings.own_acceleration_noise_m_s2,
            settings.own_angular_acceleration_noise_rad_s2,
        )
        self._since_s = np.full(rows, np.inf)
        self._failures = np.zeros(rows, dtype=np.int64)
        self._ambiguous = np.zeros(rows, dtype=np.bool_)
        self._evidence = [Evidence(o.shape) for o in self.observers]
        self._scanner = [(np.eye(3), np.zeros(3))] * len(self.observers)
        self._nis = np.full(rows, np.nan)
        self._prediction: Prediction | None = None
        self._started = np.zeros(rows, dtype=np.bool_)

    def _fused(self, i: int) -> int:
        """Return the row of the fused filter of an observer's target."""
        return len(self.observers) + self.targets.index(self.observers[i].target)

    def step(self, scans: Sequence[LidarScan | None], own: Estimate, epoch_s: float) -> list[LidarFix]:
        """Advance all tracks by one lighthouse period, to its epoch.

        Args:
            scans: scan of each observer, None if none was completed.
            own: every craft's own estimate at the epoch.
            epoch_s: epoch on the LiDARs' clock [s].
        """
        if not self.observers:
            return []
        s, bank = self.settings, self._filter
        self._started[:] = False
        self._prediction = None
        mine = {i: (own.angular_rate[o.craft], own.covariance[o.craft]) for i, o in enumerate(self.observers)}
        self._own.predict(s.frame_s, bank.transition(s.frame_s), mine)
        if own.prediction is None:
            self._predict()
        else:
            self._prediction = predicted(bank, s.frame_s, self._predict)
        self._since_s += s.frame_s
        self._wait()
        self._nis[:] = np.nan
        fixes = [self._observe(i, scan, own, epoch_s) for i, scan in enumerate(scans) if scan is not None]
        bank.stop(bank.active & (self._since_s > s.coast_limit_s) & ~self._near())
        return fixes

    def _predict(self) -> Floats | None:
        """Move all filters on by a period; return what free turns make of an error of attitude and rate."""
        bank, dt = self._filter, self.settings.frame_s
        active = bank.active
        free = active & np.isin(self._target, list(self._tumble))
        turns = None
        if free.any():
            ratio = np.array([self._tumble[t].ratio if t in self._tumble else np.zeros(PARTS) for t in self._target])
            turns = free_turns(free, bank.rotation, bank.angular_rate, *tensors(ratio), dt)
        bank.predict(dt, active)
        if turns is None:
            return None
        still = np.zeros_like(turns.turn)
        bank.add_motion(free, turns.turn, turns.rate, still, still, turns.coupling)
        return turns.coupling

    def _wait(self) -> None:
        """Let the tumbling bodies move on; where no scan comes in, they are what the filters know of the attitude."""
        bank, dt = self._filter, self.settings.frame_s
        blind = bank.active & (self._since_s > BLIND_S)
        for target, body in self._tumble.items():
            self._waits_s[target] += dt
            rows = blind & (self._target == target)
            if rows.any():
                self._move(target)
                state, covariance = bank.state, bank.covariance
                state.rotation[rows], state.angular_rate[rows] = body.rotation, body.angular_rate
                covariance[rows, :6, :] = 0.0
                covariance[rows, :, :6] = 0.0
                covariance[rows, :6, :6] = body.covariance[:6, :6]
                bank.adopt(rows, state, covariance)

    def _move(self, target: int) -> Tumble:
        """Return the tumbling body of a target, moved on to the present."""
        body = self._tumble[target]
        if self._waits_s[target] > 0:
            body.predict(self._waits_s[target])
            self._waits_s[target] = 0.0
        return body

    def _near(self) -> Bools:
        """Return the filters (R,) whose predictions are near enough to start tracking from."""
        bank = self._filter
        radius = {o.target: o.shape.radius_m for o in self.observers}
        out = bank.active
        for row in np.flatnonzero(out).tolist():
            covariance = bank.covariance_of(row)
            turn, place = np.diag(covariance)[:3].max(), np.diag(covariance)[6:9].max()
            tumbles = self._target[row] in self._tumble
            out[row] = tumbles and turn < NEAR_RAD**2 and place < (NEAR * radius[self._target[row]]) ** 2
        return out

    def into(self, own: Estimate) -> Estimate:
        """Return the estimate of all craft, with each target's row replaced by the fused estimate of its observers."""
        if not self.targets:
            return own
        bank = self._filter
        rotation, position, rate, velocity, covariance = (
            np.array(a) for a in (own.rotation, own.position, own.angular_rate, own.velocity, own.covariance)
        )
        status, nis, sensor = np.array(own.status), np.array(own.nis), np.array(own.sensor)
        for k, target in enumerate(self.targets):
            row = len(self.observers) + k
            of_target = [i for i, o in enumerate(self.observers) if o.target == target]
            status[target] = self._status(row, of_target)
            nis[target] = self._nis[row]
            fresh = self._since_s[row] == 0.0
            sensor[target] = LIDAR_SENSOR if fresh else 0
            for out, of_bank in (
                (rotation, bank.rotation),
                (position, bank.position),
                (rate, bank.angular_rate),
                (velocity, bank.velocity),
                (covariance, bank.covariance),
            ):
                out[target] = of_bank[row]
        return own._replace(
            status=status,
            rotation=rotation,
            position=position,
            angular_rate=rate,
            velocity=velocity,
            covariance=covariance,
            nis=nis,
            sensor=sensor,
            prediction=self._prediction_into(own.prediction),
            symmetry={o.target: group for o in self.observers if not (group := symmetry(o.shape)).trivial},
        )

    def _prediction_into(self, own: Prediction | None) -> Prediction | None:
        """Return the predictions of all craft, with each target's replaced by that of its fused filter."""
        mine = self._prediction
        if own is None or mine is None:
            return own
        mine = mine.ended(self._filter, self._filter.active & ~self._started)
        rows = len(self.observers) + np.arange(len(self.targets))
        continued, covariance, transition = own.continued.copy(), own.covariance.copy(), own.transition.copy()
        state = State(*(part.copy() for part in own.state))
        for out, of_filter in (
            (continued, mine.continued),
            (covariance, mine.covariance),
            (transition, mine.transition),
            *zip(state, mine.state, strict=True),
        ):
            out[self.targets] = of_filter[rows]
        assert mine.models is not None  # the fused filters are interacting ones
        models = Models(*(part.copy() for part in own.models or no_models(len(continued))))
        for into, of_models in zip(models, mine.models, strict=True):
            into[self.targets] = of_models[rows]
        return Prediction(continued, state, covariance, transition, models)

    def _status(self, row: int, of_target: list[int]) -> int:
        """Return TRACKING as long as no observer has missed a scan that was due."""
        if not self._filter.active[row]:
            return Status.AMBIGUOUS if self._ambiguous[of_target].any() else Status.SEARCHING
        slowest = max(self.observers[i].pattern.period_s for i in of_target)
        return Status.TRACKING if self._since_s[row] < 1.5 * slowest else Status.COASTING

    def _observe(self, i: int, scan: LidarScan, own: Estimate, epoch_s: float) -> LidarFix:
        o, bank = self.observers[i], self._filter
        me = own.state.of(o.craft)
        if not np.isfinite(me.rotation).all():
            return self._fix(i, None, None, None, np.zeros((0, 3)), "no own fix")
        known = bank.state.of(i) if bank.active[i] else None
        seen = at_epoch(scan, o.pattern, me, known, epoch_s)
        turn, place = scanner(me, o.pattern)
        found = self._found(i, seen, o, known, turn, place)
        cloud = seen.point @ turn.T + place
        if not found.good:
            return self._fix(i, found, None, None, cloud)
        rotation, position = turn @ found.rotation, place + turn @ found.position
        # The rays that determine the pose: those that returned from the target's position.
        back = scan.time_s[seen.returned]
        age = float(back[np.linalg.norm(seen.point - found.position, axis=1) < o.shape.radius_m].mean()) - epoch_s
        of_own, mine = own_part(position - me.position, age), own.covariance[o.craft]
        both = np.kron(np.eye(2), turn)
        covariance = of_own @ mine @ of_own.T + both @ found.covariance @ both.T
        measured = _Measured(rotation, position, (covariance + covariance.T) / 2, of_own, mine, age)
        self._take_in(i, measured, found.acquired)
        self._watch(o.target, measured)
        return self._fix(i, found, (rotation, position), measured.covariance, cloud)

    def _found(self, i: int, seen: Scan, o: Observer, known: State | None, turn: Floats, place: Floats) -> _Pose:
        """Track from the prediction, or acquire."""
        s = self.settings
        if known is not None and self._failures[i] < s.lost_after:
            rotation, position = turn.T @ known.rotation, turn.T @ (known.position - place)
            t = track(seen, o.shape, rotation, position)
            if t.tracked or self._failures[i] + 1 < s.lost_after:
                word, confidence = t.outcome.value, 1.0 if t.tracked else 0.0
                self._failures[i] = 0 if t.tracked else self._failures[i] + 1
                self._evidence[i].forget()
                return _Pose(
                    t.rotation,
                    t.position,
                    t.covariance,
                    word,
                    t.tracked,
                    False,
                    t.points,
                    t.residual_m,
                    t.overlap,
                    confidence,
                )
        before, there = self._scanner[i]
        a = self._evidence[i].take(seen, turn.T @ before, turn.T @ (there - place))
        self._scanner[i] = turn, place
        for row in (i, self._fused(i)):
            if a.found and self._filter.active[row]:
                a = a.nearest(o.shape, turn.T @ self._filter.rotation[row])
        self._ambiguous[i] = a.verdict is Verdict.AMBIGUOUS
        self._failures[i] = 0 if a.found else s.lost_after
        return _Pose(
            a.rotation,
            a.position,
            a.covariance,
            a.verdict.value,
            a.found,
            True,
            a.points,
            a.residual_m,
            a.overlap,
            a.confidence,
        )

    def _take_in(self, i: int, m: _Measured, acquired: bool) -> None:
        """Start or update the observer's filter and the fused one."""
        bank, s, fused = self._filter, self.settings, self._fused(i)
        for row in (i, fused):
            only = np.arange(len(self._since_s)) == row
            if bank.active[row]:
                if self._updated(row, i, only, m):
                    self._since_s[row] = 0.0
                    continue
                if row == i:
                    self._failures[i] += 1
                # A new acquisition contradicts the filter: the filter is wrong, not the acquisition, unless
                # the other observers have just confirmed it.
                lone = self._since_s[row] > s.lost_after * self.observers[i].pattern.period_s
                if not acquired or (row == fused and not lone):
                    continue
            turns, places, covariances, couplings = (
                np.broadcast_to(a, (len(only), *a.shape))
                for a in (m.rotation, m.position, m.covariance, m.age_s * np.eye(6))
            )
            bank.start(only, turns, places, covariances, UNKNOWN_RATE, couplings)
            self._own.restart(row, i, m.of_own, m.own)
            self._since_s[row], self._started[row] = 0.0, True

    def _watch(self, target: int, m: _Measured) -> None:
        """Let the tumbling body of a target take in an attitude; it begins anew where it disagrees several times."""
        own = m.of_own @ m.own @ m.of_own.T
        covariance = m.covariance[:3, :3] + (LASTS - 1) * own[:3, :3]
        if target in self._tumble:
            if self._move(target).update(m.rotation, covariance, m.age_s):
                self._refused[target] = 0
                return
            self._refused[target] += 1
            if self._refused[target] < self.settings.lost_after:
                return
        self._tumble[target] = Tumble(m.rotation, covariance, UNKNOWN_RATE[0])
        self._waits_s[target], self._refused[target] = 0.0, 0

    def _updated(self, row: int, i: int, only: Bools, m: _Measured) -> bool:
        """Update one filter with a pose; return whether it was accepted."""
        bank = self._filter
        y = np.concatenate([rot.log(m.rotation @ bank.rotation[row].T), m.position - bank.position[row]])
        h = np.zeros((6, 12))
        h[:, POSE], h[:, RATES] = np.eye(6), m.age_s * np.eye(6)
        before = bank.covariance[row].copy()
        known, noise = self._own.decorrelated(row, i, before, h, m.of_own, m.covariance)
        result = bank.update(only, *(np.broadcast_to(a, (len(only), *a.shape)) for a in (y, known, noise)))
        self._nis[row] = result.nis[row]
        if not result.accepted[row]:
            return False
        gain = np.linalg.solve(known @ before @ known.T + noise, known @ before).T
        self._own.update(row, i, gain, h, m.of_own, m.own)
        return True

    def _fix(
        self,
        i: int,
        found: _Pose | None,
        pose: tuple[Floats, Floats] | None,
        covariance: Floats | None,
        cloud: Floats,
        why: str = "",
    ) -> LidarFix:
        o, bank = self.observers[i], self._filter
        rotation, position = pose or (np.full((3, 3), np.nan), np.full(3, np.nan))
        nothing = np.full((6, 6), np.nan)
        return LidarFix(
            o.craft,
            o.target,
            found.outcome if found else why,
            found.acquired if found else False,
            found.points if found else 0,
            found.residual_m if found else np.nan,
            found.overlap if found else np.nan,
            found.confidence if found else 0.0,
            rotation,
            position,
            nothing if covariance is None else covariance,
            bool(pose is not None and self._since_s[i] == 0.0),
            float(self._nis[i]),
            symmetry(o.shape),
            self._tumble[o.target].inertia() if o.target in self._tumble else None,
            bank.rotation[i],
            bank.position[i],
            bank.covariance[i][np.ix_(POSE, POSE)] if bank.active[i] else nothing,
            cloud,
        )
