"""Does a calibration find what is there? Fly `survey`, calibrate with known poses and without, compare with the truth.

    python benchmarks/calibration.py [--seeds 3] [--duration 60]

Per seed (of noise: the craft and the station stay the same) and mode: the held-out residual over what noise leaves, how
many parameters lie outside three of their own standard deviations, all of them together as chi-square with as many
degrees of freedom as there are parameters, and seconds (OPENBLAS_NUM_THREADS=1, as `swarm calibrate` sets it, makes
them shorter on a busy machine). Then, for the first seed, errors of another flight of the same craft before and after:
the filter's, and PnP's alone. Without known poses a craft's size and body frame are not to be known, so errors are also
given with those taken off: against the truth of a body frame and size such as it believes.
"""

import argparse
import json
import os
import platform
import sys
import tempfile
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np
from scipy.stats import chi2

from estimators import rotation as rot
from estimators.arrays import Floats
from estimators.calibration.model import linear_fans
from estimators.calibration.problem import Problem, to_gauge
from estimators.lighthouse.sweep import FanPair
from swarm.flight.flight import Flight
from swarm.flight.simulate import simulate
from swarm.results.table import doubles as values
from swarm.scenario import load
from swarm.studies.calibration.calibrate import Calibrated, calibrate_survey, held_out, to_survey
from swarm.studies.calibration.report import fan_sigmas, file_text
from swarm.studies.calibration.survey import observe_run

CALIBRATED = ["navigation.angle_noise_arcsec=8.8", "navigation.rotor_correlation=0.8717"]


def compare(found: Calibrated, true_point_m: Floats, fans: FanPair) -> dict[str, Any]:
    """A calibration against the truth, in the same gauge."""
    result, drawn = found.result, found.seen.believed.point_m[0]
    point = true_point_m if found.how == "truth" else to_gauge(true_point_m, drawn)
    sigmas = fan_sigmas(found)
    shown = found.station()
    off = [
        (np.array(got) - true) / np.array(sigma)
        for got, true, sigma in zip((shown.fan_x, shown.fan_y), fans, sigmas, strict=True)
    ]
    places = (result.point_m - point) / result.point_sigma_m
    seen = found.seen
    rates = seen.true_rates
    assert seen.truth is not None
    assert rates is not None
    survey = to_survey(seen, result.fans, drawn, seen.truth, rates, ~held_out(seen))
    basis = Problem(survey, seen.believed.noise, poses_known=found.how == "truth").basis
    error = np.concatenate([(result.fans - linear_fans(fans)).ravel(), (result.point_m - point).ravel()])
    free = basis.T @ error
    square = float(free @ np.linalg.solve(basis.T @ result.covariance @ basis, free))
    low, high = chi2.ppf([0.005, 0.995], len(free))
    return {
        "held_out_ratio": found.after.ratio,
        "held_out_ratio_before": found.before.ratio,
        "residual": result.residual,
        "condition": result.condition,
        "fan_errors_in_sigma": [[round(float(z), 2) for z in row] for row in off],
        "photodiode_errors_in_sigma": {
            "rms": float(np.sqrt(np.mean(places**2))),
            "max": float(np.abs(places).max()),
        },
        "outside_3_sigma": int(sum(np.count_nonzero(np.abs(z) > 3) for z in (*off, places))),
        "parameters": 10 + places.size,
        "chi_square": {"value": square, "freedom": len(free), "low": float(low), "high": float(high)},
        "photodiode_error_um_rms": 1e6 * float(np.sqrt(np.mean((result.point_m - point) ** 2))),
        "wall_s": found.wall_s,
    }


def flight(
    folder: Path, name: str, duration_s: float, point: tuple[Floats, Floats] | None, *more: str
) -> dict[str, Any]:
    """RMS errors of another flight; point: believed and true photodiodes, to take off what is not to be known."""
    run = simulate(load("survey", [*more, f"duration_s={duration_s}"], 101), out=folder / name, record=False)
    table = run.telemetry
    out: dict[str, Any] = {}
    for source in ("pnp", "ekf"):
        pose = {}
        for of in ("true", source):
            q = np.stack([values(table, f"{of}_q{a}") for a in "wxyz"], axis=1)
            pose[of] = rot.matrix_from_quaternion(q), np.stack([values(table, f"{of}_p{a}_m") for a in "xyz"], axis=1)
        pairs = {"": pose["true"]}
        if point is not None:
            # True points = scale turn believed + shift: that body frame and size, not the drawn one's.
            believed, true = point
            centre, c1 = believed.mean(axis=0), true - true.mean(axis=0)
            u, _, vt = np.linalg.svd(c1.T @ (believed - centre))
            turn = u @ np.diag([1.0, 1.0, np.linalg.det(u @ vt)]) @ vt
            scale = np.sum((c1 @ turn) * (believed - centre)) / np.sum((believed - centre) ** 2)
            shift = true.mean(axis=0) - scale * turn @ centre
            rotation, position = pose["true"]
            pairs["_own_frame_and_size"] = rotation @ turn, (position + rotation @ shift) / scale
        for name_, (rotation, position) in pairs.items():
            off = np.linalg.norm(position - pose[source][1], axis=1)
            angle = np.degrees(rot.angle_between(rotation, pose[source][0]))
            out[f"{source}_mm{name_}"] = 1e3 * float(np.sqrt(np.nanmean(off**2)))
            out[f"{source}_deg{name_}"] = float(np.sqrt(np.nanmean(angle**2)))
    return out


def main() -> None:
    """Fly, calibrate, and print JSON."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seeds", type=int, default=3)
    parser.add_argument("--duration", type=float, default=60.0)
    options = parser.parse_args()
    out: dict[str, Any] = {"truth": [], "own": []}
    placed: dict[str, Floats] = {}
    with tempfile.TemporaryDirectory() as temporary:
        folder = Path(temporary)
        for seed in range(1, options.seeds + 1):
            scenario = load("survey", [f"duration_s={options.duration}"], seed)
            truth = Flight(scenario).sensors.lighthouse
            run = simulate(scenario, out=folder / f"survey-{seed}", record=False)
            for how in ("truth", "own"):
                found = calibrate_survey(observe_run(run.folder), how)
                out[how].append(compare(found, truth.photodiodes.point_m[0], truth.fans))
                print(f"seed {seed}, poses {how}: held-out {found.after.ratio:.3f}", file=sys.stderr)
                if seed == 1:
                    (folder / f"{how}.toml").write_text(file_text(found))
                    placed[how] = found.result.point_m
        true = truth.photodiodes.point_m[0]
        another = min(options.duration, 20.0)
        out["flight"] = {"uncalibrated": flight(folder, "before", another, None)}
        for how in ("truth", "own"):
            file = f"navigation.calibration='{folder / how}.toml'"
            points = (placed["own"], true) if how == "own" else None
            out["flight"][f"calibrated_{how}"] = flight(folder, f"after-{how}", another, points, file, *CALIBRATED)
    out["blas_threads"] = os.environ.get("OPENBLAS_NUM_THREADS", "unset")
    out["machine"] = platform.processor() or platform.machine()
    out["versions"] = {name: version(name) for name in ("numpy", "scipy", "numba", "mujoco")}
    print(json.dumps(out, indent=2))


if __name__ == "__main__":
    main()
