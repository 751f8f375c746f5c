"""Places of stations: the worth of a second one against theory, and the search against hands and bounds. Prints JSON.

    PYTHONPATH=. python benchmarks/placement.py [--poses 6000] [--seed 0] [--skip-hall]

`second_station`: Lighthouse 1.0, 8.8 arcsec with rho = 0.8717, both stations 3 m from a mockup at any attitude, light
within 60 degrees of a photodiode's normal, poses at which each station lights four. Medians of the position and the
attitude error of one station over those of both, at 30, 60 and 90 degrees between their lines of sight.

`hall`: Lighthouse 2.0 in a hall of 6 m by 6 m by 3 m, a mockup within 1 m of the middle and 0.3 m to 1.5 m above the
floor, its front within 30 degrees of up. The error e (0.1 degrees, 2 mm) at 95 % of 2000 unseen poses: as placed by
`swarm place`, in the corners and on the middles of the walls under the ceiling, aimed at the volume's middle, and the
bound at the poses of the search with what the placement reaches there; without a loss and with any one station lost.
"""

import argparse
import json
import platform
from importlib.metadata import version
from typing import Any

import numpy as np

from estimators.arrays import Floats
from estimators.layout.error import percentile
from estimators.placement.search import errors
from swarm.studies.placement import judgement, search
from swarm.studies.placement.candidates import Stand, look
from swarm.studies.placement.request import Request, checked
from swarm.studies.placement.task import Task, views

THEORY = {30: 4.1, 60: 6.9, 90: 8.5}
"""Position, by linearised covariances outside of this program."""
HALL = {"volume": "-1,1,-1,1,0.3,1.5", "tilt_deg": 30.0, "room": "-3,3,-3,3,0,3"}
HALF_M, HEIGHT_M = 3.0, 3.0


def aimed(position: Floats, target: Floats) -> Stand:
    """Return a station that looks at a target."""
    return Stand(look(target - position, np.array([0.0, 0.0, 1.0])), position, 0)


def second_station(poses: int, seed: int) -> dict[str, Any]:
    """Return the gains by a second station."""
    noise = {"kind": "lighthouse-1", "angle_noise_arcsec": 8.8, "rotor_correlation": 0.8717}
    overrides = ["lighthouse.incidence_max_deg=60"]
    task = checked(Request("mockup", 2, volume="0,0,0,0,0,0", overrides=overrides, **noise)).task  # type: ignore[arg-type]
    out = {}
    for crossing, theory in THEORY.items():
        turn = np.radians([0, crossing])
        places = 3.0 * np.column_stack([np.cos(turn), np.sin(turn), np.zeros(2)])
        seen = views(task, task.stations([aimed(place, np.zeros(3)) for place in places]), task.poses(poses, seed))
        both = np.asarray((seen.lit >= 4).all(axis=0))
        one, two = (judgement.parts(task, each, both) for each in (seen.at(np.array([0])), seen))
        gains = [float(np.median(one[i][both] / two[i][both])) for i in (0, 1)]
        out[str(crossing)] = {
            "poses": int(both.sum()),
            "position_times": gains[0],
            "attitude_times": gains[1],
            "position_theory": theory,
            "over_theory": gains[0] / theory,
        }
    return out


def by_hand(count: int) -> dict[str, Floats]:
    """Return symmetrical places (count, 3) under the ceiling, in opposite corners or on opposite walls first."""
    order = [0, 2, 1, 3][:count]
    quarter = np.pi / 2 * np.array(order)
    corners = HALF_M * np.sqrt(2) * np.column_stack([np.cos(quarter + np.pi / 4), np.sin(quarter + np.pi / 4)])
    walls = HALF_M * np.column_stack([np.cos(quarter), np.sin(quarter)])
    return {
        name: np.column_stack([at, np.full(count, HEIGHT_M)]) for name, at in (("corners", corners), ("walls", walls))
    }


def hall(count: int, losses: int, seed: int) -> dict[str, Any]:
    """Return the errors of a placement, of those by hand, and the bound."""
    task: Task = checked(Request("mockup", count, losses=losses, **HALL)).task  # type: ignore[arg-type]
    at = search.places(task)
    found = search.find(task, at, count, seed=seed)
    least = judgement.bound(task, at, found)
    poses = judgement.sample(task)
    hands = {
        name: [aimed(place, task.site.volume.middle) for place in places] for name, places in by_hand(count).items()
    }
    out: dict[str, Any] = {"stations": count, "losses": losses}
    for name, stands in {"placed": found.stands, **hands}.items():
        error = errors(views(task, task.stations(stands), poses), losses)
        at_share = percentile(error, task.share)
        out[name] = {
            "error": at_share if np.isfinite(at_share) else None,
            "decided_share": float(np.mean(np.isfinite(error))),
        }
    lost = bool(losses)
    out["bound"] = least.lost if lost else least.error
    out["reached_at_the_same_poses"] = least.reached_lost if lost else least.reached
    out["reached_over_bound"] = out["reached_at_the_same_poses"] / out["bound"]
    return out


def main() -> None:
    """Run, and print JSON."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--poses", type=int, default=6000)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--skip-hall", action="store_true")
    options = parser.parse_args()
    rows = [] if options.skip_hall else [(2, 0), (4, 0), (4, 1)]
    result = {
        "benchmark": "placement",
        "seed": options.seed,
        "machine": {"platform": platform.platform(), "processor": platform.machine()},
        "versions": {"python": platform.python_version(), **{n: version(n) for n in ("numpy", "numba", "scipy")}},
        "second_station": second_station(options.poses, options.seed),
        "hall": {
            f"{count}{'_one_lost' if losses else ''}": hall(count, losses, options.seed) for count, losses in rows
        },
    }
    print(json.dumps(result, indent=2))


if __name__ == "__main__":
    main()
