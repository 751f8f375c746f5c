"""What are several stations worth? Crossing lines of sight, hand-over, overlapping beams, and a thousand robots.

    python benchmarks/stations.py --crossing [--periods 1500]   raw position of two stations over that of one
    python benchmarks/stations.py --handover [--seeds 100]      steps of the estimate where stations change, NEES
    python benchmarks/stations.py --overlaps [--seconds 60]     hits lost to a second beam, against the closed form
    python benchmarks/stations.py --robots [--seconds 20]       speed of dotbots1000, errors, share of robots localised

crossing: a mockup at rest, 3 m from one or two Lighthouse 1.0 stations with the noise of the lighthouse (8.8 arcsec,
rho = 0.8717), whose lines of sight cross at an angle; poses of the rows of one period alone, from the truth as a start.
Theory is the covariance (H^T R^-1 H)^-1 of the same rows at the truth, with H by finite differences and R written once
more here. The craft faces between the stations, turned by 20 deg about two axes, the same for one station as for two.

handover: `two-stations`. A switch is a period whose stations are not those of the period before; the
step is that of the estimate from its own prediction, by constant rates, over the root of the covariance before. What a
station that is gained takes away of a consistent filter's uncertainty was in its error: in 68 of 100 the step is below
one sigma where nearly all of it goes, along one line of sight. A station that is lost takes nothing.
"""

import time
from pathlib import Path
from typing import Any

import numpy as np
from harness import finish, options, show

from estimators import rotation as rot
from estimators.arrays import Floats
from estimators.lighthouse.innovation import RowBatch, light_of
from estimators.lighthouse.integrity import AngleNoise
from estimators.lighthouse.row_pose import solve_rows
from estimators.lighthouse.rows import Rows, Station, packed
from estimators.lighthouse.sweep import measured_angles
from estimators.state import State
from swarm.flight import builders
from swarm.flight.flight import Flight
from swarm.onboard.turns import TurnDecoder
from swarm.scenario import Scenario, load, validate
from swarm.sensors.sight import Sight

DISTANCE_M = 3.0
STEP = 1e-6
"""Of the finite differences [m, rad]."""


def crossing_scenario(angle_deg: float, count: int, seed: int) -> Scenario:
    """Return a craft at the origin's 3 m mark before one or two stations whose lines of sight cross at an angle."""
    half = np.radians(angle_deg / 2)
    place = [[sign * DISTANCE_M * np.sin(half), 0.0, DISTANCE_M - DISTANCE_M * np.cos(half)] for sign in (-1, 1)]
    stations = [
        {
            "name": name,
            "kind": "lighthouse-1",
            "position_m": at,
            "attitude": {"towards_m": [0.0, 0.0, DISTANCE_M]},
        }
        for name, at in zip(("left", "right"), place, strict=True)
    ]
    motion = {
        "kind": "hold",
        "position_m": [0.0, 0.0, DISTANCE_M],
        "attitude": {"facing": True, "yaw_deg": 20.0, "pitch_deg": 20.0},
    }
    data: dict[str, Any] = {
        "name": "crossing",
        "seed": seed,
        "station": stations[:count],
        "craft": [{"motion": motion}],
    }
    return validate(data, file="crossing", folder=Path())


def angle_of(state: State, station: Station, fan: int, point: Floats, offset_s: float) -> float:
    """Return what a fan measures of a photodiode at an instant after the epoch."""
    turn = rot.exp(state.angular_rate * offset_s) @ state.rotation
    place = state.position + state.velocity * offset_s + turn @ point
    return float(measured_angles((place - station.position) @ station.rotation, station.fans)[fan])


def bound(rows: Rows, stations: list[Station], noise: list[AngleNoise], point_m: Floats, state: State) -> Floats:
    """Return the covariance (6, 6) of the pose that the rows allow, (attitude, position)."""
    n = len(rows.angle)
    h, r = np.empty((n, 6)), np.zeros((n, n))
    for i in range(6):
        step = np.zeros(6)
        step[i] = STEP
        both = []
        for sign in (1, -1):
            moved = state._replace(
                rotation=rot.exp(sign * step[:3]) @ state.rotation, position=state.position + sign * step[3:]
            )
            both.append(
                [
                    angle_of(moved, stations[s], f, point_m[k], t)
                    for s, f, k, t in zip(rows.station, rows.fan, rows.photodiode, rows.offset_s, strict=True)
                ]
            )
        h[:, i] = (np.array(both[0]) - np.array(both[1])) / (2 * STEP)
    for a in range(n):
        for b in range(n):
            if (rows.station[a], rows.fan[a], rows.sweep[a]) == (rows.station[b], rows.fan[b], rows.sweep[b]):
                own, shared = noise[rows.station[a]][:2]
                r[a, b] = shared**2 + (own**2 if a == b else 0.0)
    return np.linalg.inv(h.T @ np.linalg.solve(r, h))


def raw_error(settings: Scenario, periods: int) -> tuple[float, float]:
    """Return the RMS of the position of single periods' poses, and that of theory [m]."""
    flight = Flight(settings)
    computer = flight.computer
    known, noise = builders.stations.known_stations(settings), builders.stations.station_noise(settings)
    light, point_m = light_of(packed(known), noise), flight.sensors.lighthouse.photodiodes.point_m
    square, variance, count = 0.0, [], 0
    for frame in range(periods):
        truth, sight = flight.move(frame)
        signals = flight.sensors.signals(truth, frame, sight == Sight.LIT)
        assert isinstance(computer.decoder, TurnDecoder)
        rows: RowBatch = computer.decoder.decode(signals.pulses).rows
        state = truth.state(truth.epoch)
        mask = np.ones(1, dtype=np.bool_)
        pose = solve_rows(rows, np.ones(len(rows.angle), dtype=np.bool_), mask, light, point_m, state)
        if pose.solved[0]:
            square += float(np.sum((pose.position[0] - state.position[0]) ** 2))
            count += 1
            if frame % (periods // 10) == 5:
                own = bound(rows.of(0), known, noise, point_m[0], state.of(0))
                variance.append(float(np.trace(own[3:, 3:])))
    return float(np.sqrt(square / count)), float(np.sqrt(np.mean(variance)))


def all_lit(angle_deg: float) -> float:
    """Return the gain in theory where every photodiode has light from both stations, whatever its side."""
    settings = crossing_scenario(angle_deg, 2, 1)
    flight = Flight(settings)
    truth, _ = flight.move(0)
    known, noise = builders.stations.known_stations(settings), builders.stations.station_noise(settings)
    point_m, state = flight.sensors.lighthouse.photodiodes.point_m[0], truth.state(truth.epoch).of(0)
    sigma = []
    for count in (1, 2):
        s, f, k = (part.ravel() for part in np.meshgrid(range(count), range(2), range(len(point_m)), indexing="ij"))
        none = np.zeros(len(s))
        rows = Rows(s, f, k, none.astype(np.int64), none, none)
        sigma.append(np.sqrt(np.trace(bound(rows, known, noise, point_m, state)[3:, 3:])))
    return float(sigma[0] / sigma[1])


def crossing(periods: int) -> dict[str, Any]:
    """Return the gain of a second station by the angle of the lines of sight."""
    out: dict[str, Any] = {}
    for angle in (30.0, 60.0, 90.0):
        one, two = (raw_error(crossing_scenario(angle, count, 1), periods) for count in (1, 2))
        measured, theory = one[0] / two[0], one[1] / two[1]
        out[f"{angle:.0f} deg"] = {
            "one_mm": 1e3 * one[0],
            "two_mm": 1e3 * two[0],
            "gain": measured,
            "theory": theory,
            "over_theory": measured / theory,
            "theory_all_lit": all_lit(angle),
        }
    return out


def _nees(period: Any) -> float:
    """Return the squared pose error of craft 0 normalised by its covariance, NaN where it has none."""
    estimate, truth = period.estimate, period.truth
    turn = rot.matrix_from_quaternion(truth.quaternion[:1])[0] @ estimate.rotation[0].T
    error = np.concatenate([rot.log(turn), truth.position[0] - estimate.position[0]])
    index = np.array([0, 1, 2, 6, 7, 8])
    return float(error @ np.linalg.solve(estimate.covariance[0][np.ix_(index, index)], error))


def handover(seeds: int) -> dict[str, Any]:
    """Return the steps where a station is gained or lost, in sigmas, and NEES."""
    gained, lost, nees, blind = list[float](), list[float](), list[float](), 0
    index = np.array([6, 7, 8])
    for seed in range(seeds):
        flight, before, sources = Flight(load("two-stations", seed=seed)), None, None
        for period in flight.fly():
            estimate = period.estimate
            if not np.isfinite(estimate.position[0]).all():
                blind += period.time_s > 2.0
                before = None
                continue
            assert estimate.station_rows is not None
            used = estimate.station_rows[0] > 0
            if before is not None and period.time_s > 2.0:
                nees.append(_nees(period))
                if used.any() and sources is not None and not np.array_equal(used, sources):
                    step = estimate.position[0] - before.position[0] - before.velocity[0] * flight.period_s
                    sigma = np.sqrt(np.trace(before.covariance[0][np.ix_(index, index)]))
                    size = float(np.linalg.norm(step) / sigma)
                    (gained if used.sum() > sources.sum() else lost).append(size)
            before, sources = estimate, used if used.any() else sources
        print(seed, np.round(gained[-3:], 2), np.round(lost[-3:], 2), f"{np.mean(nees):.2f}", flush=True)
    return {
        "seeds": seeds,
        "stations_gained": len(gained),
        "stations_lost": len(lost),
        "gained_below_one_sigma_percent": 100 * float(np.mean(np.array(gained) < 1)),
        "gained_rms_sigma": float(np.sqrt(np.mean(np.square(gained)))),
        "gained_largest_sigma": max(gained),
        "lost_below_one_sigma_percent": 100 * float(np.mean(np.array(lost) < 1)),
        "lost_largest_sigma": max(lost),
        "nees_mean_of_6": float(np.mean(nees)),
        "periods_without_pose": int(blind),
    }


def overlaps(seconds: float) -> dict[str, Any]:
    """Return the share of hits that a second station's beam costs, per other station, and the closed form."""
    motion = {"kind": "hold", "position_m": [0.0, 0.0, 3.0], "attitude": {"facing": True}}
    ring = [[0.2 * np.cos(a), 0.2 * np.sin(a), 0.0] for a in 2 * np.pi * np.arange(16) / 16]
    stations = [
        {"name": f"s{i}", "position_m": at, "attitude": {"towards_m": [0.0, 0.0, 3.0]}, "beam_mm": 0.0}
        for i, at in enumerate(ring)
    ]
    settings = validate(
        {"name": "overlaps", "station": stations, "craft": [{"motion": motion}]}, file="overlaps", folder=Path()
    )
    flight = Flight(settings)
    light = flight.sensors.stations
    assert light is not None
    truth, sight = flight.move(0)
    met = logged = 0
    width: dict[tuple[int, int], float] = {}
    for frame in range(round(seconds / flight.period_s)):
        now = truth._replace(time_s=truth.time_s + frame * flight.period_s)
        found, count = light._passages(now, frame, sight == Sight.LIT)
        for s, k, w in zip(found.station[:count], found.photodiode[:count], found.width_s[:count], strict=True):
            width[int(s), int(k)] = float(w)
        met, logged = met + count, logged + int(light._beams(frame, found, count).total.sum())
    turn = [light._turn_s(emitter) for emitter in light.emitters]
    expected, weight = 0.0, 0.0
    for (s, k), own in width.items():
        kept = float(np.prod([1 - 2 * (own + width[j, k]) / turn[j] for j in range(16) if j != s and (j, k) in width]))
        expected, weight = expected + (1 - kept) / turn[s], weight + 1 / turn[s]
    share, theory = (met - logged) / met, expected / weight
    return {
        "hits": met,
        "lost_percent_per_other_station": 100 * share / 15,
        "closed_form_percent": 100 * theory / 15,
        "over_closed_form": share / theory,
    }


def robots(seconds: float) -> dict[str, Any]:
    """Return speed, errors and the share of robots localised of dotbots1000, without writing anything."""
    flight = Flight(load("dotbots1000", {"duration_s": seconds}))
    error, known, cpu, rows = [], [], [], []
    for frame in range(flight.periods):
        began = time.process_time()
        period = flight.period(frame)
        cpu.append(time.process_time() - began)
        assert period.truth is not None
        away = np.linalg.norm(period.estimate.position - period.truth.position, axis=1)
        if period.time_s > 1.0:
            error.append(away)
            known.append(np.isfinite(away))
            rows.append(period.estimate.rows.mean())
    away = np.concatenate(error)
    away = away[np.isfinite(away)]
    later = cpu[10:]
    return {
        "period_ms": 1e3 * flight.period_s,
        "cpu_ms_median": 1e3 * float(np.median(later)),
        "cpu_ms_least": 1e3 * float(np.min(later)),
        "times_real_time": flight.period_s / float(np.median(later)),
        "localised_percent": 100 * float(np.mean(known)),
        "rows_per_robot": float(np.mean(rows)),
        "error_mm_median": 1e3 * float(np.median(away)),
        "error_mm_95_percent": 1e3 * float(np.percentile(away, 95)),
        "error_mm_largest": 1e3 * float(away.max()),
    }


def main() -> None:
    """Measure what was asked for."""
    args = options(
        __doc__,
        crossing=(False, "two stations whose lines of sight cross"),
        handover=(False, "hand-over between stations"),
        overlaps=(False, "beams that overlap"),
        robots=(False, "dotbots1000"),
        periods=(1500, "periods per angle"),
        seeds=(100, "seeds of the hand-over"),
        seconds=(20.0, "time flown of overlaps and robots"),
    )
    found: dict[str, Any] = {}
    if args.crossing:
        found["crossing"] = crossing(args.periods)
    if args.handover:
        found["handover"] = handover(args.seeds)
    if args.overlaps:
        found["overlaps"] = overlaps(args.seconds)
    if args.robots:
        found["robots"] = robots(args.seconds)
    for name, part in found.items():
        rows = part.items() if name != "crossing" else [(k, *v.values()) for k, v in part.items()]
        first = next(iter(part.values()))
        columns = ["what", "value"] if name != "crossing" else ["angle", *first]
        show(name, columns, [list(row) for row in rows])
    finish("stations", found, args.out)


if __name__ == "__main__":
    main()
