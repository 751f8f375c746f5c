"""Replay by several stations on public recordings: residuals, disagreement, and errors against motion capture.

    python benchmarks/replay_stations.py DATA [--only lh2_move] [--stations lh2.toml] [--stations lh1.toml] [--all]
        [--imu with|without|both]

prints a row per recording and choice of stations while it runs, of all stations and, unless `--all`, of each alone; of
recordings with a gyroscope and accelerometer with them, without, or both. `--json FILE` keeps all figures.

DATA is a folder with `lighthouse-v1/lh1_test_cal.rec.gz`, `lighthouse-v2/lh2_test_cal.rec.gz` and `crazyflie/lh1_move`,
`crazyflie/lh2_move`; what is missing is left out. Per recording and choice of stations (all, and each alone):

- share of the periods by status, noise as found, median residual of a period's own pose per station
- of libsurvive's recordings: median offset from its own pose, and scatter about it; of objects at rest, what the
  accelerometer shows in the world, whose z libsurvive has put upwards
- of the Crazyflie's: distance from motion capture after one rigid transformation, one time shift and the marker's place
  on the craft (fitted, soft L1): median, 90 % and maximum over the periods with light in the filter, and over
  those that track; how many of these are off by more than 100 mm, and by three times what the filter says as well;
  the mean square of error over sigma, (error^2 / tr P), which is one where covariances are honest; in every period with
  an estimate, also without light, how many are off by more than 100 mm and three times what the filter says
- of each station alone: by how much its attitude differs from that by all stations, median and 90 %, and in how
  many of its periods it is another one, by more than 60 deg, while it tracks; and the same of the two stations alone
"""

import argparse
import json
import platform
from importlib.metadata import version
from itertools import combinations
from pathlib import Path
from typing import Any

import numpy as np
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation

from estimators.arrays import Bools, Floats
from swarm.errors import SwarmError
from swarm.flight.recordings.crazyflie import GRAVITY
from swarm.flight.recordings.object_light import ObjectLight, read_object
from swarm.flight.recordings.stations_file import PlacedStations, read_stations
from swarm.flight.recordings.trajectory import Trajectory, read_trajectory
from swarm.flight.station_replay import StationPlayback, choose_stations
from swarm.onboard.settings import Status, by_light
from swarm.scenario import for_replay

CASES = {
    "lh1_test_cal": ("lighthouse-v1/lh1_test_cal.rec.gz", "HMD", None),
    "lh1_test_T20": ("lighthouse-v1/lh1_test_cal.rec.gz", "T20", None),
    "lh2_test_cal": ("lighthouse-v2/lh2_test_cal.rec.gz", "T20", None),
    "lh1_move": ("crazyflie/lh1_move/log02", None, "mocap02.npy"),
    "lh2_move": ("crazyflie/lh2_move/log00", None, "mocap00.npy"),
}
FAR_MM = 100.0
OTHER_DEG = 60.0
"""Turn beyond which an attitude is another one: that of a mirror image."""
TOGETHER_S = 0.017
"""Longest time between two estimates that are compared: half a period, of clocks that begin at any time."""
GAP_S, ROBUST_M = 0.03, 0.01
"""Longest gap of the cameras that is bridged, and error beyond which a period counts less in the alignment."""


def flown(source: ObjectLight, file: PlacedStations | None, lighthouse: int | None, *, imu: bool) -> dict[str, Any]:
    """Figures of one replay, with its poses under keys that begin with an underscore."""
    playback = StationPlayback(
        source, for_replay(source.path), choose_stations(source, file, lighthouse), given=file is not None, imu=imu
    )
    status, time_s, position, rotation, rate, residual, peer = [], [], [], [], [], [], []
    sigma, normalised = [], []
    for period in playback.fly():
        estimate = period.estimate
        status.append(int(estimate.status[0]))
        time_s.append(period.time_s)
        position.append(estimate.position[0])
        rotation.append(estimate.rotation[0])
        rate.append(estimate.angular_rate[0])
        residual.append(estimate.pnp.residual_rad[0])
        with np.errstate(invalid="ignore"):
            sigma.append(np.sqrt(np.trace(estimate.covariance[0][6:9, 6:9])))
        normalised.append(estimate.nis[0] / estimate.rows[0] if estimate.rows[0] else np.nan)
        assert period.peer is not None
        peer.append(period.peer.position[0])
    codes, number = np.unique(status, return_counts=True)
    fresh = np.isfinite(normalised).any()
    out: dict[str, Any] = {
        "stations": [placed.name for placed in playback.placed],
        "status_percent": {
            Status(c).name.lower(): 100 * n / len(status) for c, n in zip(codes.tolist(), number.tolist(), strict=True)
        },
        "own_urad": [1e6 * noise.own_rad for noise in playback.noise],
        "shared_urad": [1e6 * noise.shared_rad for noise in playback.noise],
        "residual_median_urad": 1e6 * float(np.nanmedian(residual)) if np.isfinite(residual).any() else None,
        "nis_per_row_mean_median": [float(f(normalised)) if fresh else np.nan for f in (np.nanmean, np.nanmedian)],
        "acceleration_m_s2": playback.settings.navigation.acceleration_noise_m_s2,
        "angular_acceleration_deg_s2": playback.settings.navigation.angular_acceleration_noise_deg_s2,
        "_time_s": np.array(time_s),
        "_sigma": np.array(sigma),
        "_tracking": np.array(status) == Status.TRACKING,
        "_position": np.array(position),
        "_rotation": np.array(rotation),
        "_rate": np.array(rate),
        "_clock_s": playback.begin_s + np.array(time_s),
        "_light": by_light(np.array(status)),
    }
    away = np.array(position) - np.array(peer)
    known = np.isfinite(away).all(axis=1)
    if np.count_nonzero(known) > 20:
        middle = np.median(away[known], axis=0)
        scatter = np.linalg.norm(away[known] - middle, axis=1)
        out["peer"] = {"offset_mm": (1e3 * middle).tolist(), "scatter_mm": 1e3 * float(np.median(scatter))}
    return out


def against(truth: Trajectory, found: dict[str, Any]) -> dict[str, float] | None:
    """Errors against motion capture; None where too few periods can be compared."""
    light = found["_light"]
    if np.count_nonzero(light) < 100:
        return None
    time_s, position, rotation = (found[key][light] for key in ("_time_s", "_position", "_rotation"))
    known_s = truth.time_s - truth.time_s[0]

    def marker(at: Floats) -> tuple[Floats, Bools]:
        after = np.clip(np.searchsorted(known_s, at), 1, len(known_s) - 1)
        seen = (at > known_s[0]) & (at < known_s[-1]) & (known_s[after] - known_s[after - 1] < GAP_S)
        return np.stack([np.interp(at, known_s, column) for column in truth.position.T], axis=1), seen

    def rigid(shift: float, every: int = 1) -> tuple[float, Floats, Floats]:
        place, seen = marker(time_s[::every] + shift)
        if np.count_nonzero(seen) < max(0.3 * len(seen), 20):
            return np.inf, np.zeros(3), np.zeros(3)
        a, b = position[::every][seen], place[seen]
        turn = Rotation.align_vectors(b - b.mean(axis=0), a - a.mean(axis=0))[0]
        rest = b - turn.apply(a)
        middle = np.median(rest, axis=0)
        cost = float(np.median(np.linalg.norm(rest - middle, axis=1)) / np.sqrt(np.mean(seen)))
        return cost, turn.as_rotvec(), middle

    shifts = np.arange(-time_s[-1] / 2, known_s[-1], 0.05)
    shift = float(shifts[int(np.argmin([rigid(s, 10)[0] for s in shifts]))])
    _, turn, middle = rigid(shift)
    seen = marker(time_s + shift)[1]

    def residual(x: Floats) -> Floats:
        place = Rotation.from_rotvec(x[:3]).apply(position + rotation @ x[6:9]) + x[3:6]
        out: Floats = place - marker(time_s + x[9])[0]
        return out

    start = np.concatenate([turn, middle, np.zeros(3), [shift]])
    scale = np.array([0.1] * 6 + [0.05] * 3 + [0.01])
    fit = least_squares(lambda x: residual(x)[seen].ravel(), start, loss="soft_l1", f_scale=ROBUST_M, x_scale=scale)
    error = 1e3 * np.linalg.norm(residual(fit.x)[seen], axis=1)
    sigma, tracking = 1e3 * found["_sigma"][light][seen], found["_tracking"][light][seen]
    tracked, far = error[tracking], tracking & (error > FAR_MM)
    seen = marker(found["_time_s"] + fit.x[9])[1]
    known = np.isfinite(found["_position"]).all(axis=1) & seen
    time_s, position, rotation = (found[key][known] for key in ("_time_s", "_position", "_rotation"))
    whole, whole_sigma = 1e3 * np.linalg.norm(residual(fit.x), axis=1), 1e3 * found["_sigma"][known]
    wrong = (whole > FAR_MM) & (whole > 3 * whole_sigma)
    return {
        "periods": int(np.count_nonzero(seen)),
        "median_mm": float(np.median(error)),
        "percentile_90_mm": float(np.quantile(error, 0.9)),
        "largest_mm": float(error.max()),
        "error_over_sigma_median": float(np.median(error / sigma)),
        "tracking_median_mm": float(np.median(tracked)) if len(tracked) else np.nan,
        "tracking_percentile_90_mm": float(np.quantile(tracked, 0.9)) if len(tracked) else np.nan,
        "tracking_largest_mm": float(tracked.max(initial=0.0)),
        "tracking_periods": len(tracked),
        "tracking_square_over_trace_mean_median": [
            float(np.mean(np.square(tracked / sigma[tracking]))),
            float(np.median(np.square(tracked / sigma[tracking]))),
        ]
        if len(tracked)
        else None,
        "tracking_over_100_mm": int(np.count_nonzero(far)),
        "tracking_over_100_mm_and_3_sigma": int(np.count_nonzero(far & (error > 3 * sigma))),
        "known_percent": 100 * float(np.mean(known[seen])),
        "known_mm_median_90_largest": [float(np.median(whole)), float(np.quantile(whole, 0.9)), float(whole.max())],
        "known_wrong": int(np.count_nonzero(wrong)),
        "known_beyond_3_sigma": float(np.mean(whole > 3 * whole_sigma)),
        "marker_mm": (1e3 * fit.x[6:9]).tolist(),
    }


HEAD = (
    f"{'recording':14}{'stations':20}{'median':>8}{'90 %':>8}{'most':>8} mm{'track':>7}{'sweeps':>8}{'other':>7} %"
    f"{'wrong':>7}{'nis':>7}{'e2/trP':>8}   {'every estimate: %':>18}{'median':>8}{'90 %':>8}{'most':>8} mm{'wrong':>7}"
)


def turned(one: dict[str, Any], other: dict[str, Any]) -> dict[str, float] | None:
    """Difference of two replays' attitudes where both have one at nearly the same instant, of the first's tracking."""
    clock, there = one["_clock_s"], other["_clock_s"]
    near = np.clip(np.searchsorted(there, clock), 1, len(there) - 1)
    near -= np.abs(there[near - 1] - clock) < np.abs(there[near] - clock)
    kept = one["_tracking"] & other["_tracking"][near] & (np.abs(there[near] - clock) < TOGETHER_S)
    if np.count_nonzero(kept) < 10:
        return None
    near, later = near[kept], (clock - there[near])[kept]
    moved = Rotation.from_rotvec(other["_rate"][near] * later[:, None]) * Rotation.from_matrix(other["_rotation"][near])
    angle = np.degrees((Rotation.from_matrix(one["_rotation"][kept]) * moved.inv()).magnitude())
    return {
        "periods": len(angle),
        "median_deg": float(np.median(angle)),
        "percentile_90_deg": float(np.quantile(angle, 0.9)),
        "other_pose": int(np.count_nonzero(angle > OTHER_DEG)),
    }


def _told(name: str, key: str, found: dict[str, Any]) -> str:
    """Return a row: errors of the tracking periods, shares of the states, periods that are wrong and certain."""
    share, truth = found["status_percent"], found.get("motion_capture")
    text = f"{name:14}{key:20}"
    if truth is None:
        text += f"{'':27}"
    else:
        errors = (truth[f"tracking_{what}_mm"] for what in ("median", "percentile_90", "largest"))
        text += "".join(f"{value:8.1f}" for value in errors) + "   "
    tracking, sweeps = share.get("tracking", 0.0), share.get("single_sweeps", 0.0)
    text += f"{tracking:7.1f}{sweeps:8.1f}{100 - tracking - sweeps:7.1f}  "
    wrong = "" if truth is None else truth["tracking_over_100_mm_and_3_sigma"]
    text += f"{wrong:>7}{found['nis_per_row_mean_median'][0]:7.2f}"
    square = None if truth is None else truth["tracking_square_over_trace_mean_median"]
    text += f"{'':8}" if square is None else f"{square[0]:8.2f}"
    if "peer" in found:
        offset = float(np.linalg.norm(found["peer"]["offset_mm"]))
        text += f"   {offset:.1f} mm from the recording's own pose, scatter {found['peer']['scatter_mm']:.2f} mm"
    if truth is not None:
        median, most_90, most = truth["known_mm_median_90_largest"]
        text += f"   {truth['known_percent']:18.1f}{median:8.1f}{most_90:8.1f}{most:8.1f}   {truth['known_wrong']:7}"
    return text


def _told_force(name: str, source: ObjectLight, found: dict[str, Any]) -> str:
    """Return a row: size and direction in the world of what an accelerometer shows where the object tracks."""
    kept = found["_tracking"]
    clock, turns = found["_clock_s"][kept], Rotation.from_matrix(found["_rotation"][kept])
    at = np.clip(np.searchsorted(clock, source.inertial.time_s), 0, len(clock) - 1)
    near = np.abs(clock[at] - source.inertial.time_s) < TOGETHER_S
    force = np.median(turns[at[near]].apply(source.inertial.acceleration[near]), axis=0)
    size = float(np.linalg.norm(force))
    aslope = np.degrees(np.arccos(force[2] / size))
    return (
        f"{name:14}accelerometer at rest: {size / GRAVITY:.4f} g, {aslope:.2f} deg from the "
        f"world's z; gyroscope {np.degrees(np.linalg.norm(np.median(source.inertial.rate, axis=0))):.2f} deg/s"
    )


def _told_turn(name: str, key: str, turn: dict[str, float] | None) -> str:
    """Return a row: how far attitudes differ."""
    if turn is None:
        return f"{name:14}{key}: never both track"
    return (
        f"{name:14}{key}: attitudes {turn['median_deg']:.2f} deg apart in the median, "
        f"{turn['percentile_90_deg']:.2f} for 90 %, of {turn['periods']} periods; "
        f"{turn['other_pose']} more than {OTHER_DEG:.0f} deg"
    )


def case(folder: Path, name: str, files: list[PlacedStations], imu: str, *, only_all: bool) -> dict[str, Any]:
    """Figures of one recording, of all stations and of each alone; of the files that of its generation is taken."""
    place, device, mocap = CASES[name]
    source = read_object(folder / place, device)
    own = source.light.generation
    file = next((f for f in files if all(station.generation == own for station in f.stations)), None)
    truth = None if mocap is None else read_trajectory((folder / place).with_name(mocap))
    out: dict[str, Any] = {"notes": source.notes}
    each = {} if only_all else {f"station {n}": n for n in source.light.stations()}
    wanted = (True, False) if imu == "both" else (imu == "with",)
    for taken in wanted if len(source.inertial.time_s) else (False,):
        flights: dict[str, dict[str, Any]] = {}
        for choice, which in {"all": None, **each}.items():
            key = f"{choice}, IMU" if taken else choice
            try:
                found = flights[choice] = flown(source, file, which, imu=taken)
            except SwarmError as error:
                out[key] = str(error)
                continue
            if truth is not None:
                found["motion_capture"] = against(truth, found)
            out[key] = {name: value for name, value in found.items() if not name.startswith("_")}
            print(_told(name, key, found), flush=True)
            if choice == "all" and truth is None and len(source.inertial.time_s):
                print(_told_force(name, source, found))
        for one, other in combinations(flights, 2):
            key = f"{other}, {one}" + (", IMU" if taken else "")
            out[key] = turned(flights[other], flights[one])
            print(_told_turn(name, key, out[key]), flush=True)
    if only_all:
        return out
    if truth is None:
        bare = {
            n: placed._replace(errors=(type(placed.errors[0])(), type(placed.errors[1])()))
            for n, placed in source.placed.items()
        }
        found = flown(source._replace(placed=bare, errors={}), None, None, imu=False)
        out["all, without calibration"] = {name: value for name, value in found.items() if not name.startswith("_")}
    return out


def main() -> None:
    """Print a row per replay, and keep the figures as JSON."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("data", type=Path, help="folder with the recordings")
    parser.add_argument("--only", choices=CASES, action="append", help="only this recording; repeatable")
    parser.add_argument(
        "--stations",
        type=Path,
        action="append",
        default=[],
        help="file of stations to take instead of the recordings' own of this generation; repeatable",
    )
    parser.add_argument("--all", action="store_true", help="all stations together, and none alone")
    parser.add_argument("--imu", choices=("with", "without", "both"), default="with", help="inertial sensors")
    parser.add_argument("--json", type=Path, help="file for all figures")
    given = parser.parse_args()
    files = [read_stations(path) for path in given.stations]
    print(HEAD)
    out: dict[str, Any] = {"machine": platform.platform(), "numpy": version("numpy"), "scipy": version("scipy")}
    for name in given.only or CASES:
        if (given.data / CASES[name][0]).exists():
            out[name] = case(given.data, name, files, given.imu, only_all=given.all)
    if given.json is not None:
        given.json.write_text(json.dumps(out, indent=1) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
