"""Lighthouse 2.0: is raw light decoded to the tick, and which error terms does real light want, with which signs?

    python benchmarks/lighthouse_2.py --recording lh2_test_cal.rec.gz --object T20
    python benchmarks/lighthouse_2.py --log FLIGHT/log00 --truth FLIGHT/mocap00.npy [--windows 100]

A libsurvive recording needs its configuration beside it (`.json`) and an object at rest. One of Lighthouse 1.0 has the
signs of its terms tried in the same way as 2.0's. Of 2.0, its raw hits are decoded as
libsurvive does and compared with libsurvive's own angles, and decoded by the turns' own durations. Then a pose per turn
and station is fitted to the hits by least squares, with more and more of the factory's terms. An object of 10 cm tells
little of the terms that change slowly over the field; its pose takes them up.

A Crazyflie's log with motion capture tells more: the cameras know where it is all over the room. Fitted together are
the stations' poses, the marker's place on the craft, the clocks' difference, and an attitude per window of 20 ms; what
remains is due to the terms. Last, factors of tilt, gibbous, curve and ogee terms are fitted too: 1 is the factory's
value, with the sign and the size that `estimators/lighthouse/tilted.py` gives it, and 0 is no such term.
"""

import argparse
import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from harness import machine, pin, versions
from scipy.spatial.transform import Rotation

from estimators import rotation as rot
from estimators.arrays import Floats, Ints
from estimators.lighthouse.rotor import CHANNEL_CLOCK_HZ, CHANNEL_TICKS, share_of, track
from estimators.lighthouse.rows import Rows, Station, linearise, packed
from estimators.lighthouse.sweep import Fan, FanErrors, lighthouse_1, lighthouse_2, measured_angles
from estimators.lighthouse.tilted import from_station
from swarm.flight.recordings.crazyflie import POINT_M, CrazyflieLog, read_crazyflie
from swarm.flight.recordings.hits import Hits, Light
from swarm.flight.recordings.libsurvive import Recording, read_libsurvive
from swarm.flight.recordings.libsurvive_config import read_factory_stations
from swarm.flight.recordings.rotor_light import FRAME_HZ, RotorLog, decode_rotor_log
from swarm.flight.recordings.station_calibration import read_calibration
from swarm.flight.recordings.station_terms import SweepTerms
from swarm.flight.recordings.system_config import ConfiguredStation, read_system_config
from swarm.flight.recordings.trajectory import Trajectory, read_trajectory
from swarm.flight.recordings.windows import Windows
from swarm.studies.papers.alignment import NONE, Alignment, align

MOST_FEW = 100
"""Number of differences up to which they are too few for a scatter."""
WINDOW_S = 0.02
ROBUST_RAD = 5e-4
"""Residual beyond which a hit counts less [rad]: three times the median residual."""
ROUNDS = 60
"""Steps of a fit at most."""
FALSE_RAD = 2e-3
"""Mean residual of a window beyond which its attitude was not found [rad]."""
FACTORS = ("tilt", "gibbous", "curve", "ogee")
VARIANTS: dict[str, tuple[float, float, float, float, float]] = {
    "no terms": (0, 0, 0, 0, 0),
    "phase, tilt": (1, 1, 0, 0, 0),
    "phase, tilt, gibbous": (1, 1, 1, 0, 0),
    "and curve": (1, 1, 1, 1, 0),
    "and ogee": (1, 1, 1, 0, 1),
    "all": (1, 1, 1, 1, 1),
    "all, gibbous negative": (1, 1, -1, 1, 1),
    "all, curve negative": (1, 1, 1, -1, 1),
    "all, ogee negative": (1, 1, 1, 1, -1),
    "all, both negative": (1, 1, 1, -1, -1),
}
"""Factors of phase, tilt, gibbous, curve and ogee terms."""


def fans(terms: Sequence[SweepTerms], factors: Sequence[float]) -> tuple[Fan, Fan]:
    """The two planes of a station with its factory's terms, each times its factor."""
    phase, tilt, gibbous, curve, ogee = factors
    first, second = (
        from_station(
            phase * t.phase_rad,
            tilt * t.tilt,
            curve * t.curve,
            t.gibbous_phase_rad,
            gibbous * t.gibbous_magnitude,
            t.ogee_phase_rad,
            ogee * t.ogee_magnitude,
        )
        for t in terms
    )
    return lighthouse_2(first, second)


# A libsurvive recording.


def decoding(recording: Recording) -> dict[str, Any]:
    """How many of libsurvive's own angles are reproduced from its raw hits, and what of them is lost."""
    log = recording.rotors
    again, ours = decode_rotor_log(log, previous=True), decode_rotor_log(log)
    found = {(c, k, tick): (fan, angle) for c, k, tick, fan, angle in _keyed(again.hits)}
    columns = (log.own_channel, log.own_photodiode, log.own_tick, log.own_plane, log.own_angle)
    away, planes = [], 0
    for c, k, tick, plane, angle in zip(*(column.tolist() for column in columns), strict=True):
        fan, mine = found.get((c, k, tick), (-1, np.nan))
        planes += fan == plane
        away.append(abs(mine - angle) * CHANNEL_TICKS[c] / (2 * np.pi))
    ticks = np.array(away)
    return {
        "own_angles": len(ticks),
        "reproduced_within_one_tick_percent": 100 * float(np.mean(ticks <= 1)),
        "largest_ticks": float(np.nanmax(ticks)),
        "same_plane_percent": 100 * planes / len(ticks),
        "hits": len(ours.hits.tick),
        "lost": ours.lost._asdict(),
        "turn_hz": {c: 1 / s for c, s in ours.turn_s.items()},
        "nominal_hz": {c: CHANNEL_CLOCK_HZ / CHANNEL_TICKS[c] for c in ours.turn_s},
        "scatter_urad": {
            "turn's own duration": scatter(ours),
            "duration of the turn before (libsurvive)": scatter(again),
            "mean duration": scatter(_by_mean(log, ours)),
            "turn's own duration, what the photodiodes of a sweep do not share": own_scatter(ours),
        },
    }


def _by_mean(log: RotorLog, light: Light) -> Light:
    """The same light with all turns of a rotor taken as equally long, from the zero before each hit."""
    hits, angle = light.hits, light.hits.angle.copy()
    for station in light.stations():
        rotor = track(log.zero_tick[log.zero_channel == station], CHANNEL_TICKS[station])
        rows = np.flatnonzero((hits.station == station) & (hits.tick >= rotor.zero[0]))
        since = hits.tick[rows] - rotor.zero[np.searchsorted(rotor.zero, hits.tick[rows], side="right") - 1]
        # The share by the turn's own duration tells the plane and how often the rotor has turned since.
        share = since / rotor.period
        own = share_of(hits.angle[rows], hits.fan[rows])
        angle[rows] += 2 * np.pi * (share - own - np.round(share - own))
    return light._replace(hits=hits._replace(angle=angle))


def _keyed(hits: Hits) -> list[tuple[Any, ...]]:
    columns = (hits.station, hits.photodiode, hits.tick, hits.fan, hits.angle)
    return list(zip(*(column.tolist() for column in columns), strict=True))


def scatter(light: Light) -> dict[int, float]:
    """The hits' standard deviation at rest per station [urad]: from differences between turns, median."""
    out = {}
    for station in light.stations():
        columns = [column for step in np.diff(_table(light, station), axis=1) for column in _long(step)]
        out[station] = float(np.median([_spread(column) / np.sqrt(2) for column in columns]))
    return out


def own_scatter(light: Light) -> dict[int, float]:
    """The same of what the photodiodes of a sweep do not share: of their distances from the sweep's mean."""
    out = {}
    for station in light.stations():
        values = []
        for step in np.diff(_table(light, station), axis=1):
            step = step[np.count_nonzero(np.isfinite(step), axis=1) >= 4]
            seen = np.count_nonzero(np.isfinite(step), axis=1, keepdims=True)
            own = (step - np.nanmean(step, axis=1, keepdims=True)) * np.sqrt(seen / (seen - 1))
            values += [_spread(column) / np.sqrt(2) for column in _long(own)]
        out[station] = float(np.median(values))
    return out


def _table(light: Light, station: int) -> Floats:
    """The first angle of each fan, turn and photodiode of a station, (2, T, K) [rad], NaN where there is none."""
    hits = light.hits.of(light.hits.station == station)
    turn_ticks = light.turn_s[station] / light.tick_s
    zero = hits.tick - share_of(hits.angle, hits.fan) * turn_ticks
    turn = np.round((zero - zero.min()) / turn_ticks).astype(np.int64)
    table = np.full((2, turn.max() + 1, hits.photodiode.max() + 1), np.nan)
    table[hits.fan[::-1], turn[::-1], hits.photodiode[::-1]] = hits.angle[::-1]
    return table


def _long(table: Floats) -> list[Floats]:
    """The finite values of each column (photodiode) of a table (T, K) that has more than a few."""
    columns = (column[np.isfinite(column)] for column in table.T)
    return [column for column in columns if len(column) > MOST_FEW]


def _spread(values: Floats) -> float:
    """Standard deviation [urad] without values beyond four of it.

    The median deviation would not do: where all turns are equally long, angles are whole ticks, 6.7 urad.
    """
    for _ in range(5):
        values = values[np.abs(values - np.median(values)) < 4 * values.std()]
    return 1e6 * float(values.std())


def residuals(recording: Recording, light: Light, config: Path) -> dict[str, Any]:
    """Median RMS residual of a pose per turn [urad], per station and variant."""
    out: dict[str, Any] = {}
    for station in read_factory_stations(config):
        if station.channel not in light.turn_s or station.terms is None or station.pose is None:
            continue
        # libsurvive's pose of the object, by turns of pi about x into our frame of this station.
        ours = np.diag([1.0, -1.0, -1.0]) @ rot.matrix_from_quaternion(station.pose.quaternion).T
        start = (
            ours @ rot.matrix_from_quaternion(recording.peer.quaternion[0]),
            ours @ (recording.peer.position[0] - station.pose.position),
        )
        turns = _turns(light, station.channel)
        figures = {
            name: _fit_turns(turns, fans(station.terms, factors), recording.photodiodes.point_m[0], start)
            for name, factors in VARIANTS.items()
        }
        out[f"channel {station.channel}"] = figures
    return out


FIRST: dict[str, tuple[float, float, float, float]] = {
    "no terms": (0, 0, 0, 0),
    "phase, tilt": (1, 1, 0, 0),
    "phase, tilt, gibbous": (1, 1, 1, 0),
    "all": (1, 1, 1, 1),
    "all, tilt negative": (1, -1, 1, 1),
    "all, gibbous negative": (1, 1, -1, 1),
    "all, curve negative": (1, 1, 1, -1),
}
"""Factors of phase, tilt, gibbous and curve terms of Lighthouse 1.0."""


def first_generation(recording: Recording, config: Path) -> dict[str, Any]:
    """Median RMS residual of a pose per period of Lighthouse 1.0 light [urad], per station and variant."""
    out: dict[str, Any] = {}
    for station in (0, 1):
        known = read_calibration(config, station)
        windows = list(Windows(recording, station, "angles", known.pose))
        first = next(w for w in windows if np.isfinite(w.peer_position).all())
        start = rot.matrix_from_quaternion(first.peer_quaternion[0]), first.peer_position[0]
        periods = []
        for window in windows:
            sweeps = window.sweeps
            assert sweeps is not None
            seen = np.intersect1d(sweeps.photodiode[sweeps.fan == 0], sweeps.photodiode[sweeps.fan == 1])
            if len(seen) >= 5:
                none = np.zeros(len(sweeps.fan), dtype=np.int64)
                angle = sweeps.angle_rad - np.pi / 2
                periods.append(Hits(none, sweeps.fan, sweeps.photodiode, sweeps.offset_s, angle))
        out[f"station {station}"] = {
            name: _fit_turns(
                periods,
                lighthouse_1(*(_scaled(fan, factors) for fan in (known.fan_x, known.fan_y))),
                recording.photodiodes.point_m[0],
                start,
            )
            for name, factors in FIRST.items()
        }
    return out


def _scaled(errors: FanErrors, factors: Sequence[float]) -> FanErrors:
    phase, tilt, gibbous, curve = factors
    return FanErrors(
        phase * errors.phase_rad,
        tilt * errors.tilt_rad,
        curve * errors.curve,
        errors.gibbous_phase_rad,
        gibbous * errors.gibbous_magnitude,
    )


def _turns(light: Light, channel: int) -> list[Hits]:
    """The hits of each turn in which five photodiodes or more were hit by both planes."""
    hits = light.hits.of(light.hits.station == channel)
    gap = light.turn_s[channel] / light.tick_s / 2
    # The plane 1 of a turn comes a third of a turn after plane 0, and plane 0 of the next two thirds later.
    groups = np.split(np.arange(len(hits.tick)), np.flatnonzero(np.diff(hits.tick) > gap) + 1)
    turns = [hits.of(group) for group in groups]
    both = [np.intersect1d(t.photodiode[t.fan == 0], t.photodiode[t.fan == 1]) for t in turns]
    return [turn for turn, seen in zip(turns, both, strict=True) if len(seen) >= 5]


def _fit_turns(
    turns: list[Hits], planes: tuple[Fan, Fan], point_m: Floats, start: tuple[Floats, Floats]
) -> dict[str, float]:
    """Median RMS of the residuals of a pose per turn [urad], and number of turns."""
    station, still, rms = packed([Station(np.eye(3), np.zeros(3), planes)]), np.zeros(3), []
    rotation, position = start
    for turn in turns:
        none = np.zeros(len(turn.tick), dtype=np.int64)
        rows = Rows(none, turn.fan, turn.photodiode, none, np.zeros(len(none)), turn.angle)
        for _ in range(20):
            linear = linearise(rows, station, point_m, rotation, position, still, still)
            step = np.linalg.lstsq(linear.matrix[:, [0, 1, 2, 6, 7, 8]], linear.residual, rcond=None)[0]
            rotation, position = rot.exp(np.asarray(step[:3], dtype=np.float64)) @ rotation, position + step[3:]
            if np.max(np.abs(step)) < 1e-9:
                break
        rms.append(float(np.sqrt(np.mean(linear.residual**2))))
    return {"urad": 1e6 * float(np.median(rms)), "turns": len(turns)}


# A Crazyflie's log with motion capture.


class Sample(NamedTuple):
    """Hits of W windows, (N,) each: window, station, fan, photodiode, instant on the cameras' clock [s], angle; and the
    rates (W, 3) [rad/s] and middles (W,) [s] of the windows.
    """

    window: Ints
    station: Ints
    fan: Ints
    photodiode: Ints
    time_s: Floats
    angle: Floats
    rate: Floats
    middle_s: Floats


def sample(log: CrazyflieLog, truth: Trajectory, windows: int) -> Sample:
    """Windows in which both stations were seen and the cameras saw the marker, evenly from the whole flight."""
    light = log.light()
    hits, clock = light.hits, np.polyfit(log.frames.time_s, log.frames.tick * light.tick_s, 1)
    marks = np.polyval(clock, log.mark_s[[0, -1]])
    shift = float(np.mean(truth.time_s[[0, -1]] - marks))
    time_s = hits.tick * light.tick_s + shift
    after = np.clip(np.searchsorted(truth.time_s, time_s), 1, len(truth.time_s) - 1)
    seen = (time_s > truth.time_s[0]) & (np.diff(truth.time_s)[after - 1] < 0.012)
    number = np.floor(time_s / WINDOW_S).astype(np.int64)
    groups = np.split(np.arange(len(number)), np.flatnonzero(np.diff(number)) + 1)
    good = [g for g in groups if seen[g].all() and len(g) >= 14 and len(np.unique(hits.station[g])) == 2]
    picked = [good[i] for i in np.linspace(0, len(good) - 1, min(windows, len(good))).astype(np.int64)]
    rows = np.concatenate(picked)
    middle = np.array([time_s[g].mean() for g in picked])
    when = np.polyval(clock, log.inertial.time_s) + shift
    rate = np.stack([np.interp(middle, when, column) for column in log.inertial.rate.T], axis=1)
    window = np.repeat(np.arange(len(picked)), [len(g) for g in picked])
    return Sample(
        window, hits.station[rows], hits.fan[rows], hits.photodiode[rows], time_s[rows], hits.angle[rows], rate, middle
    )


GLOBAL = 16
"""Parameters that all windows share: rotation vector and position of two stations, marker, clock."""
_TO_OURS = np.array([[0.0, -1.0, 0.0], [0.0, 0.0, -1.0], [1.0, 0.0, 0.0]])
"""Our axes of a station (right, down, ahead) from Bitcraze's (ahead, left, up)."""


class Fit(NamedTuple):
    """Parameters x, residuals (N,) [rad], and the normal matrix."""

    x: Floats
    residual: Floats
    normal: Floats


def _cost(residual: Floats, robust: float) -> float:
    """Sum of the residuals' soft L1 loss."""
    return float(np.sum(2 * robust**2 * (np.sqrt(1 + (residual / robust) ** 2) - 1)))


class Room:
    """The residuals of a sample, as a function of GLOBAL parameters, factors that are free, and 3 per window."""

    def __init__(self, data: Sample, truth: Trajectory, stations: list[ConfiguredStation], free: bool) -> None:
        self.data, self.truth, self.stations = data, truth, stations
        self.shared = GLOBAL + (len(FACTORS) if free else 0)
        self.factors: Sequence[float] = VARIANTS["all"]

    def residual(self, x: Floats) -> Floats:
        """Measured less modelled angles (N,) [rad]; a hit that is modelled behind a station has 0.1."""
        d = self.data
        factors = (1.0, *x[GLOBAL : self.shared]) if self.shared > GLOBAL else self.factors
        turned = Rotation.from_rotvec(x[self.shared :].reshape(-1, 3))[d.window]
        turned = turned * Rotation.from_rotvec(d.rate[d.window] * (d.time_s - d.middle_s[d.window])[:, None])
        when = d.time_s + x[15]
        marker = np.stack([np.interp(when, self.truth.time_s, column) for column in self.truth.position.T], axis=1)
        point = marker + turned.apply(POINT_M[d.photodiode] - x[12:15])
        out = np.empty(len(d.angle))
        for s, station in enumerate(self.stations):
            assert station.terms is not None
            mine = d.station == s
            local = Rotation.from_rotvec(x[6 * s : 6 * s + 3]).inv().apply(point[mine] - x[6 * s + 3 : 6 * s + 6])
            angles = measured_angles(local @ _TO_OURS.T, fans(station.terms, factors))
            out[mine] = d.angle[mine] - np.where(d.fan[mine] == 0, angles[:, 0], angles[:, 1])
        return np.where(np.isfinite(out), out, 0.1)

    def jacobian(self, x: Floats) -> Floats:
        """By differences; the three parameters of all windows at once, since no hit depends on two windows."""
        base, step = self.residual(x), 1e-7
        out = np.zeros((len(base), len(x)))
        for i in range(self.shared):
            out[:, i] = (self.residual(x + step * (np.arange(len(x)) == i)) - base) / step
        for i in range(3):
            moved = x.copy()
            moved[self.shared + i :: 3] += step
            rows = np.arange(len(base))
            out[rows, self.shared + 3 * self.data.window + i] = (self.residual(moved) - base) / step
        return out

    def fit(self, x: Floats, robust: float = ROBUST_RAD) -> Fit:
        """The fit from a start, Levenberg-Marquardt on normal equations; residuals beyond `robust` [rad] count less."""
        r, damping = self.residual(x), 1e-3
        cost = _cost(r, robust)
        for _ in range(ROUNDS):
            jacobian = self.jacobian(x)
            weight = 1 / np.sqrt(1 + (r / robust) ** 2)
            normal, slope = jacobian.T @ (weight[:, None] * jacobian), jacobian.T @ (weight * r)
            before = cost
            while damping < 1e9:
                step = np.linalg.solve(normal + damping * np.diag(np.diag(normal) + 1e-12), -slope)
                trial = self.residual(x + step)
                if (tried := _cost(trial, robust)) < cost:
                    x, r, cost, damping = x + step, trial, tried, damping / 10
                    break
                damping *= 10
            if before - cost < 1e-7 * before:
                break
        return Fit(x, r, normal)

    def start(self, log: CrazyflieLog) -> Floats:
        """Stations as the client put them, moved into the cameras' frame; attitudes by trial."""
        frame = _frames(log, self.truth)
        x = np.zeros(self.shared + 3 * len(self.data.middle_s))
        x[GLOBAL : self.shared] = 1.0
        for s, station in enumerate(self.stations):
            assert station.rotation is not None
            assert station.position is not None
            x[6 * s : 6 * s + 3] = Rotation.from_matrix(frame.rotations(station.rotation)).as_rotvec()
            x[6 * s + 3 : 6 * s + 6] = frame.positions(station.position)
        windows, d = len(self.data.middle_s), self.data
        best, key = np.full(windows, np.inf), (d.window * 2 + d.station) * 2 + d.fan
        kept = np.zeros((windows, 3))
        for yaw in range(0, 360, 15):
            for lean in ((0, 0), (25, 0), (-25, 0), (0, 25), (0, -25)):
                trial = Rotation.from_matrix(frame.rotation) * Rotation.from_euler("zyx", [yaw, *lean], degrees=True)
                x[self.shared :] = np.tile(trial.as_rotvec(), windows)
                r = self.residual(x)
                # The pattern within a sweep tells the attitude; its mean also has the position's error.
                count = np.maximum(np.bincount(key, minlength=4 * windows), 1)
                r = r - (np.bincount(key, r, minlength=4 * windows) / count)[key]
                cost = np.bincount(d.window, r * r, minlength=windows)
                better = cost < best
                best[better], kept[better] = cost[better], trial.as_rotvec()
        x[self.shared :] = kept.ravel()
        return x


def _frames(log: CrazyflieLog, truth: Trajectory) -> Alignment:
    """The cameras' frame from the client's, from the positions that the firmware found of crossing beams, roughly."""
    clock = np.polyfit(log.frames.time_s, log.frames.tick / FRAME_HZ, 1)
    shift = float(np.mean(truth.time_s[[0, -1]] - np.polyval(clock, log.mark_s[[0, -1]])))
    when = np.polyval(clock, log.crossing.time_s) + shift
    after = np.clip(np.searchsorted(truth.time_s, when), 1, len(truth.time_s) - 1)
    seen = (when > truth.time_s[0]) & (np.diff(truth.time_s)[after - 1] < 0.012) & (log.crossing.apart_m < 0.02)
    a = log.crossing.position[seen]
    b = np.stack([np.interp(when[seen], truth.time_s, column) for column in truth.position.T], axis=1)
    rng, most, best = np.random.default_rng(1), -1, NONE
    for _ in range(500):
        rows = rng.choice(len(a), 6, replace=False)
        trial = align(a[rows], b[rows])
        near = int(np.count_nonzero(np.linalg.norm(trial.positions(a) - b, axis=1) < 0.05))
        if near > most:
            most, best = near, trial
    for _ in range(5):
        rows = np.flatnonzero(np.linalg.norm(best.positions(a) - b, axis=1) < 0.06)
        best = align(a[rows], b[rows])
    return best


def with_motion_capture(log: CrazyflieLog, truth: Trajectory, config: Path, windows: int) -> dict[str, Any]:
    """Residuals per variant in a room with motion capture, and the factors of the terms."""
    known = read_system_config(config)
    stations = [known.stations[s] for s in (0, 1)]
    data = sample(log, truth, windows)
    room = Room(data, truth, stations, free=False)
    first = room.fit(room.start(log), robust=2e-3)
    mean = np.bincount(data.window, np.abs(first.residual)) / np.bincount(data.window)
    keep = np.flatnonzero(mean < FALSE_RAD)
    room.data, x = _kept(data, first.x, keep)
    out: dict[str, Any] = {"windows": len(keep), "hits": len(room.data.angle), "variants": {}}
    for name, factors in VARIANTS.items():
        room.factors = factors
        r = np.abs(room.fit(x).residual)
        out["variants"][name] = {"median_urad": 1e6 * float(np.median(r)), "rms_of_90_percent_urad": _rms(r)}
    free = Room(room.data, truth, stations, free=True)
    found = free.fit(np.concatenate([x[:GLOBAL], np.ones(len(FACTORS)), x[GLOBAL:]]))
    spread = 1.4826 * float(np.median(np.abs(found.residual)))
    covariance = np.linalg.pinv(found.normal) * spread**2
    places = range(GLOBAL, free.shared)
    out["factors"] = {
        name: {"value": float(found.x[i]), "sigma": float(np.sqrt(covariance[i, i]))}
        for name, i in zip(FACTORS, places, strict=True)
    }
    r = np.abs(found.residual)
    out["free"] = {"median_urad": 1e6 * float(np.median(r)), "rms_of_90_percent_urad": _rms(r)}
    return out


def _kept(data: Sample, x: Floats, keep: Ints) -> tuple[Sample, Floats]:
    """The sample and the parameters of some windows only."""
    rows = np.isin(data.window, keep)
    number = np.searchsorted(keep, data.window[rows])
    kept = Sample(
        number,
        data.station[rows],
        data.fan[rows],
        data.photodiode[rows],
        data.time_s[rows],
        data.angle[rows],
        data.rate[keep],
        data.middle_s[keep],
    )
    return kept, np.concatenate([x[:GLOBAL], x[GLOBAL:].reshape(-1, 3)[keep].ravel()])


def _rms(residual: Floats) -> float:
    """Root of the mean of the nine smallest tenths of the squares [urad]."""
    square = np.sort(residual**2)
    return 1e6 * float(np.sqrt(np.mean(square[: int(0.9 * len(square))])))


def main() -> None:
    """Print the figures of a recording, or of a log with motion capture, as JSON."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--recording", type=Path, help="libsurvive recording")
    parser.add_argument("--object", default="T20", help="tracked object of the recording")
    parser.add_argument("--log", type=Path, help="Crazyflie event log, with system-config.yaml beside it")
    parser.add_argument("--truth", type=Path, help="motion capture of the log")
    parser.add_argument("--windows", type=int, default=100, help="windows of the log")
    given = parser.parse_args()
    pin()
    out: dict[str, Any] = {"machine": machine(), "versions": versions()}
    if given.recording is not None:
        recording = read_libsurvive(given.recording, given.object)
        out["losses"] = recording.losses.sentences()
        config = given.recording.with_name(given.recording.name + ".json")
        if not len(recording.rotors.hit_tick):
            out["residual_of_a_pose_per_period"] = first_generation(recording, config)
            print(json.dumps(out, indent=1))
            return
        out["decoding"] = decoding(recording)
        out["residual_of_a_pose_per_turn"] = residuals(recording, decode_rotor_log(recording.rotors), config)
    if given.log is not None and given.truth is not None:
        log, truth = read_crazyflie(given.log), read_trajectory(given.truth)
        config = given.log.with_name("system-config.yaml")
        out["motion_capture"] = with_motion_capture(log, truth, config, given.windows)
    print(json.dumps(out, indent=1))


if __name__ == "__main__":
    main()
