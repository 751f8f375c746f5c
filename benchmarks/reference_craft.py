"""A reference craft at a known place: the error of another one across the line of sight and along it, with and without.

    python benchmarks/reference_craft.py [--seeds 6] [--apart 0.5]

A mockup drifts as its filter assumes, 3 m before the lighthouse, another one beside it holds its place. Flown with and
without `navigation.reference`, and with 2 % of a real station's fan errors left over; of the poses of single periods
and of the filter, after the first second.
"""

import argparse
import json
from typing import Any

import numpy as np

from estimators import rotation as rot
from estimators.arrays import Floats
from swarm.flight.flight import Flight
from swarm.scenario import load

SURVEY = load("survey").lighthouse
POSE = np.array([0, 1, 2, 6, 7, 8])


def scenario(seed: int, apart_m: float, referred: bool, share: float) -> list[str]:
    """The overrides of a flight."""
    fans = []
    for name in ("fan_x", "fan_y"):
        table = getattr(SURVEY, name)
        terms = {"phase_rad": table.phase_rad, "tilt_rad": table.tilt_rad, "curve": table.curve}
        terms["gibbous_magnitude"] = table.gibbous_magnitude
        said = ",".join(f"{key}={share * value}" for key, value in terms.items())
        fans.append(f"lighthouse.{name}={{gibbous_phase_rad={table.gibbous_phase_rad},{said}}}")
    sigma = (
        f"phase_rad={share * 0.039},tilt_rad={share * 0.0087},curve={share * 0.002},gibbous_magnitude={share * 0.0068}"
    )
    return [
        f"seed={seed}",
        "duration_s=4",
        "swarm.count=0",
        "recording.enabled=false",
        'craft=[{name="probe",motion={kind="drift",position_m=[0.0,0.0,3.0]}},'
        f'{{name="base",motion={{kind="hold",position_m=[{-apart_m},0.0,3.0]}}}}]',
        *(fans if share else []),
        *([f"navigation.fan_sigma={{{sigma}}}"] if share else []),
        *(['navigation.reference="base"'] if referred else []),
    ]


def flown(overrides: list[str]) -> dict[str, list[Floats]]:
    """Errors of one flight: of poses and of the filter (n, 3) [m], and the NEES (n,)."""
    flight = Flight(load("static", overrides))
    out: dict[str, list[Any]] = {"pose": [], "filter": [], "nees": []}
    for frame in range(flight.periods):
        period = flight.period(frame)
        truth, estimate = period.truth, period.estimate
        if truth is None or frame < 60 or not np.isfinite(estimate.position[0]).all():
            continue
        out["pose"].append(truth.position[0] - estimate.pnp.position[0])
        out["filter"].append(truth.position[0] - estimate.position[0])
        turn = rot.log(rot.matrix_from_quaternion(truth.quaternion[0]) @ estimate.rotation[0].T)
        error = np.concatenate([turn, out["filter"][-1]])
        out["nees"].append(error @ np.linalg.solve(estimate.covariance[0][np.ix_(POSE, POSE)], error))
    return out


def main() -> None:
    """Fly, and print JSON."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seeds", type=int, default=6)
    parser.add_argument("--apart", type=float, default=0.5, help="distance of both craft [m]")
    asked = parser.parse_args()
    result: dict[str, dict[str, float]] = {}
    for share in (0.0, 0.02):
        for referred in (False, True):
            runs = [flown(scenario(seed, asked.apart, referred, share)) for seed in range(asked.seeds)]
            figures = {"nees": float(np.mean(np.concatenate([run["nees"] for run in runs])))}
            for name in ("pose", "filter"):
                error = 1e3 * np.concatenate([np.array(run[name]) for run in runs])
                error = error[np.isfinite(error).all(axis=1)]
                figures[f"{name}_lateral_mm"] = float(np.sqrt(np.mean(error[:, 0] ** 2 + error[:, 1] ** 2)))
                figures[f"{name}_range_mm"] = float(np.sqrt(np.mean(error[:, 2] ** 2)))
            result[f"{'with' if referred else 'without'} a reference, {share:.0%} of the fan errors"] = figures
    print(json.dumps(result, indent=2))


if __name__ == "__main__":
    main()
