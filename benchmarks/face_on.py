"""Cold starts of flat craft near face-on: decided, ambiguous, and silently wrong. Prints JSON.

    PYTHONPATH=. python benchmarks/face_on.py [--starts 10000] [--seed 0]

4 to 12 photodiodes in one plane: half of the starts a random layout in a square of 10 to 30 cm, a quarter a square of
four, a quarter what a mockup shows that is lit on its top only. 1.5 m to 8 m, within 35 deg of boresight, tilted 0 to
15 deg, 4 to 20 arcsec of angle noise with rho = 0.8717. The craft are at rest and know it; unknown rates are part of
`swarm run plate`.

A start is *ambiguous* where the on-board search keeps it so after one period. Else it has a pose with a covariance, to
*first* order at the minimum, or the *spread* of all poses that the angles allow. It is *wrong* beyond what the
covariance claims at 1e-7: NEES (6 degrees of freedom, against the truth) above the chi-square quantile, or an attitude
or position error beyond 5.33 sqrt(trace), the protection level's part for noise. `before_all_to_first_order` counts the
same starts as if every decided minimum were taken with its first-order covariance.
"""

import argparse
import json
import platform
import sys
import time
from importlib.metadata import version
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from scipy.special import chdtri, ndtri

from estimators.arrays import Bools, Floats
from estimators.lighthouse.dop import dilution
from estimators.lighthouse.integrity import AngleNoise, Sweeps
from estimators.lighthouse.planar import is_flat, spread
from estimators.rotation import exp, log
from swarm.onboard.acquisition import DECISIVE, Sighting, search

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "tests"))

from convex_target import ARCSEC, RHO, angle_errors, angles

RISK = 1e-7
NEES_LIMIT = float(chdtri(6, RISK))
QUANTILE = -float(ndtri(RISK / 2))
MOCKUP_TOP = 0.018 * np.array([[1.0, 1, 0], [-1, 1, 0], [-1, -1, 0], [1, -1, 0]]) + [0, 0, 0.038]


class Scene(NamedTuple):
    """A pose to find: rotation (3, 3), position (3,) [m], photodiodes (n, 3) [m] and the noise of an angle [rad]."""

    rotation: Floats
    position: Floats
    point: Floats
    sigma_rad: float


class Outcome(NamedTuple):
    """What one way of claiming a precision came to: nees, and whether the error is beyond the claim."""

    nees: float
    wrong: bool


def scene(rng: np.random.Generator) -> Scene:
    """Return a random flat craft near face-on."""
    kind = rng.integers(4)
    half = rng.uniform(0.05, 0.15)
    if kind < 2:
        plane = half * rng.uniform(-1, 1, (rng.integers(4, 13), 2))
        point = np.column_stack([plane, np.full(len(plane), rng.uniform(-0.05, 0.05))])
    elif kind == 2:
        point = half * np.array([[1.0, 1, 0], [-1, 1, 0], [-1, -1, 0], [1, -1, 0]])
    else:
        point = MOCKUP_TOP
    off, around = np.deg2rad(35) * np.sqrt(rng.random()), 2 * np.pi * rng.random()
    ray = np.array([np.sin(off) * np.cos(around), np.sin(off) * np.sin(around), np.cos(off)])
    facing = exp(np.cross([0.0, 0, 1], ray) / np.sin(off) * off) @ exp(np.array([0.0, np.pi, 0]))
    direction = 2 * np.pi * rng.random()
    tilt = np.deg2rad(rng.uniform(0, 15)) * np.array([np.cos(direction), np.sin(direction), 0])
    rotation = facing @ exp(tilt) @ exp(np.array([0, 0, 2 * np.pi * rng.random()]))
    return Scene(rotation, ray * rng.uniform(1.5, 8.0), point, ARCSEC * rng.uniform(4, 20))


def outcome(scene: Scene, rotation: Floats, position: Floats, covariance: Floats) -> Outcome:
    """Return how far a pose is from the truth by its covariance."""
    error = np.concatenate([log(scene.rotation @ rotation.T), scene.position - position])
    nees = float(error @ np.linalg.solve(covariance, error))
    beyond = any(
        np.linalg.norm(error[part]) > QUANTILE * np.sqrt(np.trace(covariance[part, part]))
        for part in (slice(3), slice(3, 6))
    )
    return Outcome(nees, nees > NEES_LIMIT or beyond)


def first_order(scene: Scene, lit: Bools, rotation: Floats, position: Floats) -> Floats:
    """Return s^2 H of (18), (6, 6)."""
    still = np.zeros((1, len(lit), 2)), np.zeros((1, 3)), np.zeros((1, 3))
    pose = rotation[None], position[None], lit[None], scene.point[None]
    h = dilution(*pose, *still, RHO, np.ones(1, dtype=np.bool_)).covariance[0]
    return scene.sigma_rad**2 * h


def start(scene: Scene, rng: np.random.Generator) -> tuple[str, Outcome | None, Outcome | None, float]:
    """Return what a craft makes of one period's light, as on board, what first order would, and the time [s]."""
    count, still = len(scene.point), np.zeros((1, 3))
    truth = scene.rotation[None], scene.position[None], scene.point[None]
    theta = angles(*truth, np.zeros((1, count, 2)), still, still) + angle_errors(rng, 1, count, scene.sigma_rad)
    lit, offset = np.ones(count, dtype=np.bool_), np.zeros((count, 2))
    noise = AngleNoise(scene.sigma_rad * np.sqrt(1 - RHO), scene.sigma_rad * np.sqrt(RHO))
    began = time.perf_counter()
    found = search(Sighting(theta[0], lit, scene.point, offset), noise.own_rad)
    if not found.decided:
        return "ambiguous", None, None, time.perf_counter() - began
    best = found.rotation[0], found.position[0]
    plain = outcome(scene, *best, first_order(scene, lit, *best))
    assert is_flat(scene.point)
    one = Sweeps(theta, lit[None], scene.point[None], offset[None], still, still)
    possible = spread(one, *best, noise, (0.0, 0.0), found.rotation[1:], DECISIVE)
    took = time.perf_counter() - began
    if possible is None:
        return "first_order", plain, plain, took
    if not possible.contained:
        return "merged", None, plain, took
    return "spread", outcome(scene, possible.rotation, possible.position, possible.covariance), plain, took


def counted(outcomes: list[Outcome]) -> dict[str, Any]:
    """Return the figures of some outcomes."""
    nees = np.array([o.nees for o in outcomes])
    if not len(nees):
        return {"starts": 0}
    return {
        "starts": len(nees),
        "wrong_unflagged": sum(o.wrong for o in outcomes),
        "nees_mean": float(nees.mean()),
        "nees_max": float(nees.max()),
    }


def main() -> None:
    """Draw, start, count, print."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--starts", type=int, default=10_000)
    parser.add_argument("--seed", type=int, default=0)
    options = parser.parse_args()
    rng = np.random.default_rng(options.seed)
    told: dict[str, int] = {}
    claims: dict[str, list[Outcome]] = {"first_order": [], "spread": []}
    plain: list[Outcome] = []
    seconds = []
    for _ in range(options.starts):
        said, own, before, took = start(scene(rng), rng)
        told[said] = told.get(said, 0) + 1
        seconds.append(took)
        if own is not None:
            claims[said].append(own)
        if before is not None:
            plain.append(before)
    result = {
        "benchmark": "face_on",
        "starts": options.starts,
        "seed": options.seed,
        "machine": {"platform": platform.platform(), "processor": platform.machine()},
        "versions": {"python": platform.python_version(), **{n: version(n) for n in ("numpy", "numba", "scipy")}},
        "ambiguous_two_minima": told.get("ambiguous", 0),
        "ambiguous_merged": told.get("merged", 0),
        "decided": counted(claims["first_order"] + claims["spread"]),
        "decided_to_first_order": counted(claims["first_order"]),
        "decided_by_spread": counted(claims["spread"]),
        "before_all_to_first_order": counted(plain),
        "ms_mean": 1e3 * float(np.mean(seconds)),
    }
    print(json.dumps(result, indent=2))


if __name__ == "__main__":
    main()
