"""What are several stations worth? Crossing lines of sight, hand-over, overlapping beams, and a thousand robots.

    python benchmarks/stations.py --crossing [--periods 1500]   raw position of two stations over that of one
    python benchmarks/stations.py --handover [--seeds 100]      steps of the estimate where stations change, NEES
    python benchmarks/stations.py --overlaps [--seconds 60]     hits lost to a second beam, against the closed form
    python benchmarks/stations.py --robots [--seconds 20]       speed of dotbots1000, errors, share of robots localised;
                                  [--recorded]                  with telemetry and recording
    python benchmarks/stations.py --riding [--seeds 8]          a station on a craft that tells its own estimate, NEES
    python benchmarks/stations.py --constellation [--seconds 4] constellation16: tracking, errors, NEES, time by part

crossing: a mockup at rest, 3 m from one or two Lighthouse 1.0 stations with the noise of the lighthouse (8.8 arcsec,
rho = 0.8717), whose lines of sight cross at an angle; poses of the rows of one period alone, from the truth as a start.
Theory is the covariance (H^T R^-1 H)^-1 of the same rows at the truth, with H by finite differences and R written once
more here. The craft faces between the stations, turned by 20 deg about two axes, the same for one station as for two.

handover: `two-stations` with WALKERS walkers in one flight, each with noise of its own. A switch is a period whose
stations are not those of the light before; its step is the estimate minus the filter's own prediction. What a gained
station takes away of the uncertainty of a consistent filter was in its error: the step of such a filter has the
covariance P- - P+, its square along that matrix's longest axis is 1 on average in its units, and it is below one sigma
of P- as often as "exact filter" says, which is not always. A station that is lost takes nothing. NEES every NEES_EVERY
periods of each walker, by the number of stations in the light, and its mean over all flights at one time against the
95 % band. In a real flight velocity is the derivative of position; MuJoCo's own steps are half a step apart, which is
a push of jerk times half a step: `--steps` makes the steps smaller.
With `--feedback truth` the walkers are carried: their filters do not know what moves them.

riding: a chief in the light of a ground station, RIDERS craft farther away that see only the station on the chief, all
pushed a little at random. NEES of the riders by their own covariance, and by what their filters believe.
"""

import tempfile
import time
import tomllib
from collections.abc import Callable
from contextlib import ExitStack
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from harness import finish, options, show
from scipy.stats import chi2

from estimators import rotation as rot
from estimators.arrays import Floats
from estimators.filter.error_state import POSE_COLUMNS
from estimators.lighthouse.innovation import RowBatch, light_of
from estimators.lighthouse.integrity import AngleNoise
from estimators.lighthouse.row_pose import solve_rows
from estimators.lighthouse.rows import Rows, Station, packed
from estimators.lighthouse.sweep import measured_angles
from estimators.state import State
from swarm.flight import builders
from swarm.flight.flight import Flight
from swarm.flight.scene import scene
from swarm.onboard.settings import Status
from swarm.onboard.turns import TurnDecoder
from swarm.results.period import Period
from swarm.results.run_writer import writing_run
from swarm.scenario import Scenario, load, validate
from swarm.sensors.sight import Sight

DISTANCE_M = 3.0
SCENARIOS = Path(__file__).resolve().parents[1] / "scenarios"
WALKERS = 10
"""Walkers in one flight of the hand-over."""
SETTLED_S = 2.0
"""Time that filters have to settle [s]."""
NEES_EVERY = 6
"""Periods between samples of NEES."""
AMID_FROM_S = 0.5
"""Time after which craft amid many stations count [s]."""
RIDERS = 6
"""Craft that navigate by the station on another one."""
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


def raw_error(settings: Scenario, periods: int) -> tuple[float, float, float]:
    """Return the RMS of the position of single periods' poses, that of theory [m], and the first one's standard error
    as a share of it.
    """
    flight = Flight(settings)
    computer = flight.computer
    known, noise = builders.stations.known_stations(settings), builders.stations.station_noise(settings)
    light, point_m = light_of(packed(known), noise), flight.sensors.lighthouse.photodiodes.point_m
    square: list[float] = []
    variance = []
    for frame in range(periods):
        truth, sight = flight.move(frame)
        signals = flight.sensors.signals(truth, frame, sight == Sight.LIT)
        assert isinstance(computer.decoder, TurnDecoder)
        rows: RowBatch = computer.decoder.decode(signals.pulses).rows
        state = truth.state(truth.epoch)
        mask = np.ones(1, dtype=np.bool_)
        pose = solve_rows(rows, np.ones(len(rows.angle), dtype=np.bool_), mask, light, point_m, state)
        if pose.solved[0]:
            square.append(float(np.sum((pose.position[0] - state.position[0]) ** 2)))
            if frame % (periods // 10) == 5:
                own = bound(rows.of(0), known, noise, point_m[0], state.of(0))
                variance.append(float(np.trace(own[3:, 3:])))
    mean = float(np.mean(square))
    share = float(np.std(square)) / (2 * mean * np.sqrt(len(square)))
    return float(np.sqrt(mean)), float(np.sqrt(np.mean(variance))), share


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


def crossing(periods: int, angles: list[float]) -> dict[str, Any]:
    """Return the gain of a second station by the angle of the lines of sight."""
    out: dict[str, Any] = {}
    for angle in angles:
        one, two = (raw_error(crossing_scenario(angle, count, 1), periods) for count in (1, 2))
        measured, theory = one[0] / two[0], one[1] / two[1]
        out[f"{angle:.0f} deg"] = {
            "one_mm": 1e3 * one[0],
            "two_mm": 1e3 * two[0],
            "gain": measured,
            "theory": theory,
            "over_theory": measured / theory,
            "standard_error": float(np.hypot(one[2], two[2])) * measured / theory,
            "theory_all_lit": all_lit(angle),
        }
        print(f"{angle:.0f} deg: {measured:.2f} times, theory {theory:.2f}", flush=True)
    return out


def walkers(seed: int, count: int, feedback: str, steps: int = 8) -> Scenario:
    """Return `two-stations` with several walkers, one above the other and each somewhat later than the one before.

    Args:
        seed: seed of the run.
        count: number of walkers.
        feedback: pose that they steer by, "estimate" or "truth".
        steps: physics steps per period.
    """
    data = tomllib.loads((SCENARIOS / "two-stations.toml").read_text(encoding="utf-8"))
    walker, satellite = data["craft"]
    motion, craft = walker["motion"], []
    for i in range(count):
        up, later = 0.2 * (i - (count - 1) / 2), 0.1 * i
        path = [[x, y + up, z] for x, y, z in motion["points_m"]]
        times = [t + later for t in motion["times_s"]]
        own = {**motion, "points_m": path, "times_s": times}
        craft.append({**walker, "name": f"walker-{i}", "feedback": feedback, "motion": own})
    data |= {"seed": seed, "craft": [*craft, satellite], "criteria": [], "physics": {"steps_per_period": steps}}
    return validate(data, file="two-stations", folder=SCENARIOS)


class Steps(NamedTuple):
    """Steps of the estimated position at switches: over the root of the trace of the covariance before; squared, along
    the line on which most of the uncertainty goes, and normalised by the variance that an exact filter's step has
    there; and the probability that such a filter's step is below one sigma. Three lists of numbers.
    """

    sigmas: list[float]
    square: list[float]
    chance: list[float]


def _note(steps: Steps, step: Floats, before: Floats, after: Floats, draws: Floats) -> None:
    """Add a step (3,) [m] from the covariance `before` (3, 3) to the one `after`; draws (N, 3): standard normal."""
    value, vector = np.linalg.eigh(before - after)
    sigma, value = np.sqrt(np.trace(before)), np.maximum(value, 0.0)
    steps.sigmas.append(float(np.linalg.norm(step) / sigma))
    if value[-1] > 0:
        steps.square.append(float((vector[:, -1] @ step) ** 2 / value[-1]))
    steps.chance.append(float(np.mean(np.sum(draws**2 * value, axis=1) < sigma**2)))


def handover(seeds: int, feedback: str, steps_per_period: int) -> dict[str, Any]:
    """Return the steps where a station is gained or lost, and NEES by what is seen, of so many flights."""
    gained, lost = (Steps([], [], []) for _ in range(2))
    draws = np.random.default_rng(1).standard_normal((2000, 3))
    nees: dict[int, list[float]] = {1: [], 2: []}
    by_time: dict[int, list[float]] = {}
    blind, pose = 0, POSE_COLUMNS
    for seed in range(-(-seeds // WALKERS)):
        scenario = walkers(seed, min(WALKERS, seeds - WALKERS * seed), feedback, steps_per_period)
        flight = Flight(scenario, history=True)
        sources: dict[int, Any] = {}
        for period in flight.fly():
            e, truth, prior = period.estimate, period.truth, period.estimate.prediction
            assert truth is not None
            assert prior is not None
            assert e.station_rows is not None
            error = difference(truth, e)
            for c in range(len(error) - 1):
                if period.time_s < SETTLED_S:
                    continue
                if not np.isfinite(e.position[c]).all():
                    blind += 1
                    continue
                used = e.station_rows[c] > 0
                if not used.any():
                    continue
                own = error[c, pose] @ np.linalg.solve(e.covariance[c][np.ix_(pose, pose)], error[c, pose])
                if period.frame % NEES_EVERY == c % NEES_EVERY:
                    nees[int(used.sum())].append(float(own))
                    by_time.setdefault(period.frame // NEES_EVERY, []).append(float(own))
                if c in sources and not np.array_equal(used, sources[c]) and prior.continued[c]:
                    steps = gained if used.sum() > sources[c].sum() else lost
                    step = e.position[c] - prior.state.position[c]
                    _note(steps, step, prior.covariance[c, 6:9, 6:9], e.covariance[c, 6:9, 6:9], draws)
                sources[c] = used
        one, two = (f"{np.mean(nees[k]):.2f}" for k in (1, 2))
        below = 100 * float(np.mean(np.array(gained.sigmas) < 1))
        print(f"{WALKERS * (seed + 1)} walkers: NEES {one} and {two}, {below:.1f} % of gains below 1 sigma", flush=True)
    out: dict[str, Any] = {"flights": seeds}
    for name, steps in (("gained", gained), ("lost", lost)):
        count = len(steps.sigmas)
        out[f"{name}_switches"] = count
        out[f"{name}_below_one_sigma_percent"] = 100 * float(np.mean(np.array(steps.sigmas) < 1))
        out[f"{name}_exact_filter_percent"] = 100 * float(np.mean(steps.chance))
        out[f"{name}_largest_sigma"] = max(steps.sigmas)
        out[f"{name}_square_of_1"] = float(np.mean(steps.square))
        out[f"{name}_square_band"] = band(1, count)
    for stations, found in nees.items():
        out[f"nees_of_6_with_{stations}"] = float(np.mean(found))
    means = np.array([np.mean(found) for found in by_time.values() if len(found) == seeds])
    low, high = band(6, seeds)
    out |= {
        "nees_band": [low, high],
        "nees_instants_in_band_percent": 100 * float(np.mean((means > low) & (means < high))),
        "nees_instants_above_percent": 100 * float(np.mean(means >= high)),
        "nees_instants_below_percent": 100 * float(np.mean(means <= low)),
        "nees_largest_of_an_instant": float(means.max()),
        "periods_without_pose": blind,
    }
    return out


def band(freedom: int, count: int) -> list[float]:
    """Return the 95 % band of the mean of so many squares of so many degrees of freedom."""
    return [float(x) for x in chi2.ppf([0.025, 0.975], freedom * count) / count]


def difference(truth: Any, estimate: Any) -> Floats:
    """Return truth minus estimate as the filter's error state, (C, 12)."""
    turn = rot.log(rot.matrix_from_quaternion(truth.quaternion) @ np.swapaxes(estimate.rotation, 1, 2))
    rest = [getattr(truth, part) - getattr(estimate, part) for part in ("angular_rate", "position", "velocity")]
    out: Floats = np.concatenate([turn, *rest], axis=1)
    return out


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


def robots(seconds: float, recorded: bool) -> dict[str, Any]:
    """Return speed, errors and the share of robots localised of dotbots1000, writing the run or nothing.

    Args:
        seconds: time flown.
        recorded: whether telemetry and recording are written, whose time counts.
    """
    given = load("dotbots1000", {"duration_s": seconds})
    flight = Flight(given)
    error, known, cpu, rows = [], [], [], []
    with ExitStack() as open_files:
        write: Callable[[Period], None] | None = None
        if recorded:
            folder = open_files.enter_context(tempfile.TemporaryDirectory())
            writing = writing_run(given, Path(folder) / "run", scene(given, flight), force=False, duration_s=seconds)
            write = open_files.enter_context(writing).append
        for frame in range(flight.periods):
            began = time.process_time()
            period = flight.period(frame)
            if write is not None:
                write(period)
            cpu.append(time.process_time() - began)
            assert period.truth is not None
            away = np.linalg.norm(period.estimate.position - period.truth.position, axis=1)
            if period.time_s > 1.0:
                error.append(away)
                known.append(np.isfinite(away))
                rows.append(period.estimate.rows.mean())
        began = time.process_time()
    closing = time.process_time() - began
    away = np.concatenate(error)
    away = away[np.isfinite(away)]
    later = cpu[10:]
    return {
        "period_ms": 1e3 * flight.period_s,
        "cpu_ms_median": 1e3 * float(np.median(later)),
        "cpu_ms_least": 1e3 * float(np.min(later)),
        "cpu_ms_mean": 1e3 * float(np.mean(later)),
        "cpu_s_closing": closing,
        # Not every period is drawn: with a recording the mean tells.
        "times_real_time": flight.period_s / float(np.mean(later) if recorded else np.median(later)),
        "localised_percent": 100 * float(np.mean(known)),
        "rows_per_robot": float(np.mean(rows)),
        "error_mm_median": 1e3 * float(np.median(away)),
        "error_mm_95_percent": 1e3 * float(np.percentile(away, 95)),
        "error_mm_largest": 1e3 * float(away.max()),
    }


def nees(error: Floats, covariance: Floats) -> float:
    """Return the normalised error squared of a pose, from an error (12,) and its covariance (12, 12)."""
    own = error[POSE_COLUMNS]
    return float(own @ np.linalg.solve(covariance[np.ix_(POSE_COLUMNS, POSE_COLUMNS)], own))


def riders(seed: int, seconds: float) -> Scenario:
    """Return a chief before a station, and craft that see only the station that rides on the chief."""

    def pushed(place: list[float]) -> dict[str, Any]:
        push = {"acceleration_m_s2": 0.02, "angular_acceleration_deg_s2": 1.2}
        return {"kind": "drift", "position_m": place, **push}

    ring = 2 * np.pi * np.arange(RIDERS) / RIDERS
    places = [[0.0, 0.0, 3.0], *([float(np.cos(a)), float(np.sin(a)), 6.0] for a in ring)]
    craft = [{"name": f"craft-{i}", "motion": pushed(place)} for i, place in enumerate(places)]
    ground = {"name": "ground", "attitude": {"towards_m": [0.0, 0.0, 3.0]}}
    rides: dict[str, Any] = {"name": "rides", "craft": "craft-0", "bearer": "estimate", "position_m": [0.0, 0.0, -0.15]}
    rides["attitude"] = {"towards_m": [0.0, 0.0, -3.0]}
    light = {"range_max_m": 4.5}
    data = {"name": "riding", "seed": seed, "duration_s": seconds, "lighthouse": light}
    return validate({**data, "station": [ground, rides], "craft": craft}, file="riding", folder=Path())


def riding(seeds: int, seconds: float) -> dict[str, Any]:
    """Return errors and NEES of a chief, and of craft that navigate by the station on it."""
    found: dict[bool, list[tuple[float, ...]]] = {True: [], False: []}
    blind = 0
    for seed in range(seeds):
        flight = Flight(riders(seed, seconds))
        for period in flight.fly():
            if period.time_s < SETTLED_S or period.frame % 30:
                continue
            assert period.truth is not None
            e, believed = period.estimate, flight.computer.navigator.tracks.bank.covariance
            error = difference(period.truth, e)
            for c, own in enumerate(error):
                if not np.isfinite(own).all():
                    blind += 1
                    continue
                away = 1e3 * float(np.linalg.norm(own[6:9])), float(np.degrees(np.linalg.norm(own[:3])))
                found[c == 0].append((*away, nees(own, e.covariance[c]), nees(own, believed[c])))
    out: dict[str, Any] = {"flights": seeds, "without_pose": blind, "nees_band_of_chief": band(6, len(found[True]))}
    for chief, name in ((True, "chief"), (False, "riders")):
        part = np.array(found[chief])
        out[f"{name}_rms_mm"] = float(np.sqrt(np.mean(part[:, 0] ** 2)))
        out[f"{name}_rms_deg"] = float(np.sqrt(np.mean(part[:, 1] ** 2)))
        out[f"{name}_nees_of_6"] = float(np.mean(part[:, 2]))
        out[f"{name}_nees_by_the_filter_alone"] = float(np.mean(part[:, 3]))
    return out


class Amid:
    """What craft amid many stations know, over some periods.

    away_mm: errors of position of craft that know theirs. nees: of every tenth period. rows, stations: means of the
    craft, by period. tracking: craft-periods. gained: stations that had sent no light in the period before. overlaps:
    hits lost to two beams at once. dropped: craft-periods in which a photodiode was left out as false.
    """

    def __init__(self) -> None:
        self.away_mm: list[float] = []
        self.nees: list[float] = []
        self.rows: list[float] = []
        self.stations: list[float] = []
        self.tracking = self.gained = self.overlaps = self.dropped = 0

    def take(self, period: Any) -> None:
        """Count one period."""
        e = period.estimate
        error = difference(period.truth, e)
        known = np.isfinite(error).all(axis=1)
        self.away_mm += (1e3 * np.linalg.norm(error[known, 6:9], axis=1)).tolist()
        if len(self.rows) % 10 == 0:
            self.nees += [nees(error[c], e.covariance[c]) for c in np.flatnonzero(known)]
        self.rows.append(float(e.rows.mean()))
        self.stations.append(float(e.stations.mean()))
        self.tracking += int(np.count_nonzero(e.status == Status.TRACKING))
        self.overlaps += 0 if period.overlaps is None else int(period.overlaps.sum())
        self.dropped += int(np.count_nonzero(e.integrity.dropped != 0))


def constellation(seconds: float) -> dict[str, Any]:
    """Return what 200 craft amid 16 stations know, and the time that parts of a period take, without writing."""
    flight = Flight(load("constellation16", {"duration_s": seconds}))
    sensors, computer = flight.sensors, flight.computer
    part: dict[str, list[float]] = {}

    def timed(owner: Any, method: str, name: str) -> None:
        """Count the time of a method."""
        call = getattr(owner, method)

        def counted(*args: Any, **values: Any) -> Any:
            began = time.process_time()
            out = call(*args, **values)
            part.setdefault(name, []).append(1e3 * (time.process_time() - began))
            return out

        setattr(owner, method, counted)

    timed(flight.world, "advance", "physics")
    timed(sensors, "sight", "rays")
    timed(sensors, "signals", "light")
    timed(computer.decoder, "decode", "decoder")
    timed(computer.navigator, "step", "navigation")
    found, whole, before, count = Amid(), [], np.zeros(0, dtype=np.int64), flight.world.mass.size
    for frame in range(flight.periods):
        began = time.process_time()
        period = flight.period(frame)
        whole.append(1e3 * (time.process_time() - began))
        used = period.estimate.station_rows
        assert used is not None
        if period.time_s >= AMID_FROM_S:
            found.take(period)
            found.gained += int(np.count_nonzero((used > 0) & (before == 0)))
        before = used
        if frame % 10 == 9:
            now = f"median {np.median(found.away_mm):.4f} mm, NEES {np.mean(found.nees):.2f}" if found.away_mm else ""
            print(f"{period.time_s:.2f} s: {now} {np.median(whole[-10:]):.0f} ms of CPU per period", flush=True)
    away, craft_periods = np.array(found.away_mm), count * len(found.rows)
    rows = count * sum(found.rows)
    out = {
        "craft": count,
        "periods": len(found.rows),
        "localised_percent": 100 * len(away) / craft_periods,
        "tracking_percent": 100 * found.tracking / craft_periods,
        "rows_per_craft": rows / craft_periods,
        "stations_per_craft": float(np.mean(found.stations)),
        "stations_gained_per_craft_and_second": found.gained / (craft_periods * flight.period_s),
        "hits_lost_to_two_beams_percent": 100 * found.overlaps / (found.overlaps + rows),
        "photodiodes_left_out_percent": 100 * found.dropped / craft_periods,
        "error_mm_median": float(np.median(away)),
        "error_mm_95_percent": float(np.percentile(away, 95)),
        "error_mm_largest": float(away.max()),
        "nees_of_6": float(np.mean(found.nees)),
        "nees_band": band(6, len(found.nees)),
        "first_period_s": 1e-3 * whole[0],
        "period_ms_median": float(np.median(whole[10:])),
        "times_real_time": 1e3 * flight.period_s / float(np.median(whole[10:])),
    }
    return out | {f"{name}_ms": float(np.median(each[10:])) for name, each in part.items()}


def main() -> None:
    """Measure what was asked for."""
    args = options(
        __doc__,
        crossing=(False, "two stations whose lines of sight cross"),
        handover=(False, "hand-over between stations"),
        overlaps=(False, "beams that overlap"),
        robots=(False, "dotbots1000"),
        recorded=(False, "its telemetry and recording are written, too"),
        riding=(False, "a station on a craft that tells its estimate"),
        constellation=(False, "constellation16"),
        periods=(1500, "periods per angle"),
        angles=([30.0, 60.0, 90.0], "angles of the lines of sight [deg]"),
        seeds=(100, "flights of the hand-over, ten at a time"),
        feedback=("estimate", "pose that its walkers steer by: estimate or truth"),
        steps=(8, "physics steps per period of the hand-over"),
        seconds=(20.0, "time flown of overlaps, robots, riders and constellation"),
    )
    found: dict[str, Any] = {}
    if args.crossing:
        found["crossing"] = crossing(args.periods, args.angles)
    if args.handover:
        found["handover"] = handover(args.seeds, args.feedback, args.steps)
    if args.overlaps:
        found["overlaps"] = overlaps(args.seconds)
    if args.robots:
        found["robots"] = robots(args.seconds, args.recorded)
    if args.riding:
        found["riding"] = riding(args.seeds, args.seconds)
    if args.constellation:
        found["constellation"] = constellation(args.seconds)
    for name, part in found.items():
        rows = part.items() if name != "crossing" else [(k, *v.values()) for k, v in part.items()]
        first = next(iter(part.values()))
        columns = ["what", "value"] if name != "crossing" else ["angle", *first]
        show(name, columns, [list(row) for row in rows])
    finish("stations", found, args.out)


if __name__ == "__main__":
    main()
