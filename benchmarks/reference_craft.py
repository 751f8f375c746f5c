"""A reference craft at a known place: the error of another one across the line of sight and along it, with and without.

    python benchmarks/reference_craft.py [--seeds 6] [--apart 0.5] [--references 2] [--station]

A mockup drifts as its filter assumes, 3 m before the lighthouse, others beside it hold their places. Flown with and
without `navigation.reference`, and with 2 % of a real station's fan errors left over; of the poses of single periods
and of the filter, after the first second. `theory` is what `benchmarks/filter_theory.py` makes, for a filter of one
model of motion, of the noise that is left with these references, and with some that had no noise.

With `--station` the same light is that of a [[station]], whose rows go into the filter one by one, without fan errors.
"""

import argparse
import json
from typing import Any

import numpy as np
from filter_theory import Model, Seen, separate

from estimators import rotation as rot
from estimators.arrays import Floats
from estimators.lighthouse.innovation import rows_of_sweeps
from estimators.lighthouse.rows import Station, linearise, packed
from estimators.lighthouse.sweep import LIGHTHOUSE_1
from swarm.flight import builders
from swarm.flight.flight import Flight
from swarm.scenario import load

SURVEY = load("survey").lighthouse
POSE = np.array([0, 1, 2, 6, 7, 8])


def scenario(seed: int, apart_m: float, references: int, referred: bool, share: float, station: bool) -> list[str]:
    """The overrides of a flight."""
    places = [(-apart_m, 0.0), (apart_m, 0.0), (0.0, apart_m), (0.0, -apart_m)][:references]
    bases = "".join(
        f',{{name="base{i}",motion={{kind="hold",position_m=[{x},{y},3.0]}}}}' for i, (x, y) in enumerate(places)
    )
    names = ",".join(f'"base{i}"' for i in range(references))
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
        'craft=[{name="probe",motion={kind="drift",position_m=[0.0,0.0,3.0]}},' + bases.lstrip(",") + "]",
        *(['station=[{name="light",kind="lighthouse-1",position_m=[0.0,0.0,0.0]}]'] if station else []),
        *(fans if share else []),
        *([f"navigation.fan_sigma={{{sigma}}}"] if share else []),
        *([f"navigation.reference=[{names}]"] if referred else []),
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


def theory(overrides: list[str], references: int) -> dict[str, float]:
    """Errors [mm] across the light of the filter by theory, with the photodiodes of a flight's third period."""
    given = load("static", overrides)
    flight = Flight(given)
    settings = builders.navigation(given)
    for frame in range(3):
        period = flight.period(frame)
    angles, truth = period.angles, period.truth
    assert truth is not None
    rows = rows_of_sweeps(angles.theta, angles.offset_s, np.isfinite(angles.theta)).of(0)
    still = np.zeros(3)
    at = rot.matrix_from_quaternion(truth.quaternion[0]), truth.position[0], still, still
    before = packed([Station(np.eye(3), still, LIGHTHOUSE_1)])
    _, h = linearise(rows, before, flight.world.photodiodes.point_m[0], *at)
    seen = Seen(h, np.zeros((len(h), 0)), np.asarray(rows.fan))
    number = np.isfinite(angles.theta[1 : 1 + references]).sum(axis=1).min(axis=1)
    own, shared = settings.noise.own_rad, settings.noise.shared_rad
    flash = shared**2 - settings.relations.common_rad[0] ** 2
    left = flash * (1 + (number**2).sum() / number.sum() ** 2) + own**2 / number.sum()
    out = {}
    for name, common in (("without", shared), ("with", left**0.5), ("with perfect references", 0.0)):
        push = settings.acceleration_noise_m_s2, settings.angular_acceleration_noise_rad_s2
        model = Model(own, common, np.zeros(0), *push, settings.frame_s, 180)
        covariance = separate([seen], model)
        out[name] = 1e3 * float(np.sqrt(np.trace(covariance[6:8, 6:8])))
    out["gain"] = out["without"] / out["with"]
    out["largest gain"] = out["without"] / out["with perfect references"]
    return out


def main() -> None:
    """Fly, and print JSON."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seeds", type=int, default=6)
    parser.add_argument("--apart", type=float, default=0.5, help="distance of both craft [m]")
    parser.add_argument("--references", type=int, choices=range(1, 5), default=2, help="number of reference craft")
    parser.add_argument("--station", action="store_true", help="light of a [[station]]")
    asked = parser.parse_args()
    result: dict[str, dict[str, float]] = {}
    where = asked.apart, asked.references
    for share in (0.0,) if asked.station else (0.0, 0.02):
        for referred in (False, True):
            runs = [flown(scenario(seed, *where, referred, share, asked.station)) for seed in range(asked.seeds)]
            figures = {"nees": float(np.mean(np.concatenate([run["nees"] for run in runs])))}
            for name in ("pose", "filter"):
                error = 1e3 * np.concatenate([np.array(run[name]) for run in runs])
                error = error[np.isfinite(error).all(axis=1)]
                figures[f"{name}_lateral_mm"] = float(np.sqrt(np.mean(error[:, 0] ** 2 + error[:, 1] ** 2)))
                figures[f"{name}_range_mm"] = float(np.sqrt(np.mean(error[:, 2] ** 2)))
            result[f"{'with' if referred else 'without'} references, {share:.0%} of the fan errors"] = figures
        ratio = {
            name: result[f"without references, {share:.0%} of the fan errors"][f"{name}_lateral_mm"]
            / result[f"with references, {share:.0%} of the fan errors"][f"{name}_lateral_mm"]
            for name in ("pose", "filter")
        }
        result[f"gain across the light, {share:.0%} of the fan errors"] = ratio
    result["theory without fan errors, across the light"] = theory(scenario(0, *where, False, 0.0, False), where[1])
    print(json.dumps(result, indent=2))


if __name__ == "__main__":
    main()
