"""A reference craft at a known place: the error of another one across the line of sight and along it, with and without.

    python benchmarks/reference_craft.py [--seeds 6] [--apart 0.5] [--references 2] [--seconds 4] [--shares 0 0.02]
                                         [--station]

A mockup drifts as its filter assumes, 3 m before the lighthouse, others beside it hold their places. Flown with and
without `navigation.reference`, and with 2 % of a real station's fan errors left over; of the poses of single periods
and of the filter, after the first second. `theory` is what `benchmarks/filter_theory.py` makes, for a filter of one
model of motion, of the noise that is left with these references, and with some that had no noise: of the photodiodes
lit at instants of all flights, mean squares as of the errors. Standard errors are those of flights left out in turn.

With `--station` the same light is that of a [[station]], whose rows go into the filter one by one, without fan errors.
"""

import argparse
import json
from typing import Any, NamedTuple

import numpy as np
from filter_theory import Model, Seen, separate
from numpy.typing import NDArray

from estimators import rotation as rot
from estimators.arrays import Floats
from estimators.lighthouse.innovation import rows_of_sweeps
from estimators.lighthouse.rows import Station, linearise, packed
from estimators.lighthouse.sweep import LIGHTHOUSE_1
from swarm.flight import builders
from swarm.flight.flight import Flight
from swarm.results.period import Period
from swarm.scenario import load

SURVEY = load("survey").lighthouse
POSE = np.array([0, 1, 2, 6, 7, 8])
APART, FORGOTTEN = 30, 60
"""Periods between instants of which theory takes the light, and after which a filter has forgotten its start."""


class Asked(NamedTuple):
    """What is flown: duration [s], distance of the references [m], their number, and by whose light."""

    seconds: float
    apart: float
    references: int
    station: bool


def scenario(asked: Asked, seed: int, referred: bool, share: float) -> list[str]:
    """The overrides of a flight."""
    apart_m, references = asked.apart, asked.references
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
        f"duration_s={asked.seconds}",
        "swarm.count=0",
        "recording.enabled=false",
        'craft=[{name="probe",motion={kind="drift",position_m=[0.0,0.0,3.0]}},' + bases.lstrip(",") + "]",
        *(['station=[{name="light",kind="lighthouse-1",position_m=[0.0,0.0,0.0]}]'] if asked.station else []),
        *(fans if share else []),
        *([f"navigation.fan_sigma={{{sigma}}}"] if share else []),
        *([f"navigation.reference=[{names}]"] if referred else []),
    ]


class Light(NamedTuple):
    """Light of one instant: the rows that the probe has seen, and the number of photodiodes of each reference."""

    seen: Seen
    references: NDArray[np.int64]


def lit(period: Period, point_m: Floats, references: int) -> Light:
    """The light of a period; point_m: (K, 3) [m], photodiodes of the probe."""
    angles, truth = period.angles, period.truth
    assert truth is not None
    rows = rows_of_sweeps(angles.theta, angles.offset_s).of(0)
    still = np.zeros(3)
    at = rot.matrix_from_quaternion(truth.quaternion[0]), truth.position[0], still, still
    _, h = linearise(rows, packed([Station(np.eye(3), still, LIGHTHOUSE_1)]), point_m, *at)
    number = np.isfinite(angles.theta[1 : 1 + references]).sum(axis=1).min(axis=1)
    return Light(Seen(h, np.zeros((len(h), 0)), np.asarray(rows.fan)), number)


def flown(overrides: list[str], references: int) -> dict[str, list[Any]]:
    """Errors of one flight: of poses and of the filter (n, 3) [m], and the NEES (n,); its light at instants."""
    given = load("static", overrides)
    flight = Flight(given)
    out: dict[str, list[Any]] = {"pose": [], "filter": [], "nees": [], "light": []}
    for frame in range(flight.periods):
        period = flight.period(frame)
        truth, estimate = period.truth, period.estimate
        if truth is None or frame < 60 or not np.isfinite(estimate.position[0]).all():
            continue
        if frame % APART == 0 and not given.station:
            out["light"].append(lit(period, flight.world.photodiodes.point_m[0], references))
        out["pose"].append(truth.position[0] - estimate.pnp.position[0])
        out["filter"].append(truth.position[0] - estimate.position[0])
        turn = rot.log(rot.matrix_from_quaternion(truth.quaternion[0]) @ estimate.rotation[0].T)
        error = np.concatenate([turn, out["filter"][-1]])
        out["nees"].append(error @ np.linalg.solve(estimate.covariance[0][np.ix_(POSE, POSE)], error))
    return out


def theory(overrides: list[str], light: list[Light]) -> dict[str, float]:
    """Errors [mm] across the light of the filter by theory, root mean square over instants."""
    settings = builders.navigation(load("static", overrides))
    own, shared = settings.noise.own_rad, settings.noise.shared_rad
    flash = shared**2 - settings.relations.common_rad[0] ** 2
    push = settings.acceleration_noise_m_s2, settings.angular_acceleration_noise_rad_s2
    square = np.zeros(3)
    for seen, number in light:
        left = flash * (1 + (number**2).sum() / number.sum() ** 2) + own**2 / number.sum()
        for i, common in enumerate((shared, left**0.5, 0.0)):
            covariance = separate([seen], Model(own, common, np.zeros(0), *push, settings.frame_s, FORGOTTEN))
            square[i] += float(np.trace(covariance[6:8, 6:8])) / len(light)
    without, referred, perfect = 1e3 * np.sqrt(square)
    return {
        "without": float(without),
        "with": float(referred),
        "with perfect references": float(perfect),
        "gain": float(without / referred),
        "largest gain": float(without / perfect),
    }


def lateral(error: Floats) -> float:
    """Mean square of errors (n, 3) across the light [mm^2]."""
    known = error[np.isfinite(error).all(axis=1)]
    return float(1e6 * np.mean(known[:, 0] ** 2 + known[:, 1] ** 2))


def gain(before: list[dict[str, list[Any]]], after: list[dict[str, list[Any]]], name: str) -> tuple[float, float]:
    """The ratio of the errors across the light of flights without and with references, and its standard error."""
    square = np.array([[lateral(np.array(run[name])) for run in runs] for runs in (before, after)])
    n, ratio = square.shape[1], np.sqrt(square[0].mean() / square[1].mean())
    left_out = square.sum(axis=1, keepdims=True) - square
    each = np.sqrt(left_out[0] / left_out[1])
    spread = np.sqrt((n - 1) / n * np.sum((each - each.mean()) ** 2))
    return float(ratio), float(spread) if n > 1 else float("nan")


def main() -> None:
    """Fly, and print JSON."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seeds", type=int, default=6)
    parser.add_argument("--apart", type=float, default=0.5, help="distance of both craft [m]")
    parser.add_argument("--references", type=int, choices=range(1, 5), default=2, help="number of reference craft")
    parser.add_argument("--seconds", type=float, default=4.0, help="of a flight, of which the first is left out")
    parser.add_argument("--shares", type=float, nargs="+", default=[0.0, 0.02], help="of the fan errors, left over")
    parser.add_argument("--station", action="store_true", help="light of a [[station]]")
    given = parser.parse_args()
    asked = Asked(given.seconds, given.apart, given.references, given.station)
    result: dict[str, dict[str, float]] = {}
    light: list[Light] = []
    for share in (0.0,) if asked.station else given.shares:
        before, after = (
            [flown(scenario(asked, seed, referred, share), asked.references) for seed in range(given.seeds)]
            for referred in (False, True)
        )
        for name, runs in (("without", before), ("with", after)):
            figures = {"nees": float(np.mean(np.concatenate([run["nees"] for run in runs])))}
            for what in ("pose", "filter"):
                error = np.concatenate([np.array(run[what]) for run in runs])
                figures[f"{what}_lateral_mm"] = lateral(error) ** 0.5
                figures[f"{what}_range_mm"] = 1e3 * float(np.sqrt(np.nanmean(error[:, 2] ** 2)))
            result[f"{name} references, {100 * share:.0f} % of the fan errors"] = figures
        light = light or [one for run in before for one in run["light"]]
        ratio = {}
        for what in ("pose", "filter"):
            ratio[what], ratio[f"{what}_standard_error"] = gain(before, after, what)
        result[f"gain across the light, {100 * share:.0f} % of the fan errors"] = ratio
    if asked.station:
        alone = asked._replace(station=False)
        runs = [flown(scenario(alone, seed, False, 0.0), asked.references) for seed in range(given.seeds)]
        light = [one for run in runs for one in run["light"]]
    overrides = scenario(asked._replace(station=False), 0, False, 0.0)
    result["theory without fan errors, across the light"] = theory(overrides, light)
    print(json.dumps(result, indent=2))


if __name__ == "__main__":
    main()
