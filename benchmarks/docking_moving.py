"""Dockings to a client that drifts and turns, under a station whose fans are off as a real one's and not calibrated.

    python benchmarks/docking_moving.py [--flights 100] [--first 1] [--share 1.0]

Flies the last quarter of a metre of the scenario `docking-moving` with as many seeds: noise, thruster errors, the
servicer's start and the client's motion are drawn anew in each. Prints JSON: how many made contact within 10 mm and 1
degree, the offsets at contact, the absolute error, and the relative error, its NEES and its level then.
"""

import argparse
import json
import sys
from typing import Any

import numpy as np

from estimators import rotation as rot
from estimators.rotation import matrix_from_quaternion
from swarm.flight.flight import Flight
from swarm.scenario import load

LATERAL_M, ANGLE_DEG = 0.01, 1.0
SHORT = [
    "craft[0].motion.from_m=[0.30,0.0,3.09]",
    "craft[0].motion.hold_ranges_m=[0.2]",
    "craft[0].motion.hold_s=[1.0]",
]
"""A short approach: the last quarter of a metre."""
POSE = np.array([0, 1, 2, 6, 7, 8])
SERVICER, CLIENT = 0, 1


def overrides(share: float) -> list[str]:
    """Return those of the fans: a share of the scenario's errors, and of what the craft take to be left."""
    settings, out = load("docking-moving"), ["recording.enabled=false", "navigation.filter=compiled", *SHORT]
    for name in ("fan_x", "fan_y"):
        fan = getattr(settings.lighthouse, name)
        out += [f"lighthouse.{name}.{key}={share * getattr(fan, key)}" for key in ("phase_rad", "tilt_rad", "curve")]
        out.append(f"lighthouse.{name}.gibbous_magnitude={share * fan.gibbous_magnitude}")
    left = settings.navigation.fan_sigma
    keys = ("phase_rad", "tilt_rad", "curve", "gibbous_magnitude")
    return out + [f"navigation.fan_sigma.{key}={share * getattr(left, key)}" for key in keys]


def flown(seed: int, share: float) -> dict[str, Any]:
    """Fly once, until contact or the end."""
    flight = Flight(load("docking-moving", overrides(share), seed))
    out: dict[str, Any] = {"seed": seed, "docked": False}
    for period in flight.fly():
        assert period.guided is not None
        assert period.truth is not None
        assert period.estimate.relative is not None
        if flight.latches.closed[SERVICER]:
            out["docked"] = True
            break
        closing, truth, found = period.guided.docking[0][1], period.truth, period.estimate.relative
        turn = matrix_from_quaternion(truth.quaternion)
        away = turn[SERVICER].T @ (truth.position[CLIENT] - truth.position[SERVICER]) - found.position[0]
        error = np.concatenate([rot.log(turn[SERVICER].T @ turn[CLIENT] @ found.rotation[0].T), away])
        covariance = found.covariance[0][np.ix_(POSE, POSE)]
        out.update(
            time_s=float(period.time_s),
            lateral_mm=1e3 * float(closing.lateral_m),
            angle_deg=float(np.degrees(closing.angle_rad)),
            speed_mm_s=1e3 * float(closing.speed_m_s),
            absolute_mm=1e3 * float(np.linalg.norm(truth.position[SERVICER] - period.estimate.position[SERVICER])),
            relative_mm=1e3 * float(np.linalg.norm(away)),
            relative_deg=float(np.degrees(np.linalg.norm(error[:3]))),
            relative_sigma_mm=1e3 * float(np.sqrt(np.trace(covariance[3:, 3:]))),
            nees=float(error @ np.linalg.solve(covariance, error)),
            level_mm=1e3 * float(found.position_level_m[0]),
        )
    return out


def main() -> None:
    """Fly, and print JSON."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--flights", type=int, default=100)
    parser.add_argument("--first", type=int, default=1, help="first seed")
    parser.add_argument("--share", type=float, default=1.0, help="of a real station's fan errors")
    asked = parser.parse_args()
    runs = []
    for seed in range(asked.first, asked.first + asked.flights):
        runs.append(flown(seed, asked.share))
        print(json.dumps(runs[-1]), file=sys.stderr, flush=True)
    good = [run["docked"] and run["lateral_mm"] <= 1e3 * LATERAL_M and run["angle_deg"] <= ANGLE_DEG for run in runs]
    names = [name for name in runs[0] if name not in ("seed", "docked")]
    figures = {
        name: {"median": float(np.median(values)), "largest": float(np.max(values))}
        for name in names
        if (values := [run[name] for run in runs])
    }
    print(
        json.dumps(
            {
                "flights": len(runs),
                "docked": sum(run["docked"] for run in runs),
                "within": sum(good),
                "missed": [run for run, fine in zip(runs, good, strict=True) if not fine],
                **figures,
            },
            indent=2,
        )
    )


if __name__ == "__main__":
    main()
