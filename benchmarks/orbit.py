"""One whole orbit of free drift in MuJoCo at 60 Hz, eight steps per period, against the closed form.

    python benchmarks/orbit.py > orbit.json

Three craft start within some 10 m, one at rest 10 m below the lighthouse, from where it drifts 377 m away. Prints JSON:
the largest distance of any craft from the closed solution of the Clohessy-Wiltshire equations over the orbit, looked at
every second, the change of their integral, and what the orbit's force costs per period beside a world without one.
"""

import json
import platform
import time

import mujoco
import numpy as np

from estimators.relative_orbit import circular, integral, transition
from swarm.assets import find_model
from swarm.world.world import CraftStart, World

STARTS = np.array([[3.0, -2, 10, 0.01, -0.02, 0.005], [0, 10, 2, 0, 0, 0], [-1, 0, 8, 0, 0, -0.01]])
RATE_HZ = 60
TIMED = 6000


def world(orbit):
    """The three craft in an orbit, or without one."""
    still = np.zeros(3)
    craft = [
        CraftStart(str(i), find_model("cubesat6u"), s[:3], np.array([1.0, 0, 0, 0]), s[3:], still)
        for i, s in enumerate(STARTS)
    ]
    return World(craft, find_model("lighthouse"), RATE_HZ, orbit=orbit)


def period_us(built):
    """Mean time of one period of the world."""
    nothing = np.zeros((len(STARTS), 3))
    started = time.perf_counter()
    for _ in range(TIMED):
        built.advance(nothing, nothing)
    return 1e6 * (time.perf_counter() - started) / TIMED


def main():
    """Fly, compare, print."""
    orbit, nothing = circular(400e3), np.zeros((len(STARTS), 3))
    period_us(world(orbit))
    cost_us, without_us = period_us(world(orbit)), period_us(world(None))
    built, worst_m, energy = world(orbit), 0.0, integral(orbit, STARTS[:, :3], STARTS[:, 3:])
    drift = 0.0
    for k in range(int(orbit.period_s * RATE_HZ) + 1):
        truth = built.advance(nothing, nothing)
        if k % RATE_HZ == 0:
            expected = STARTS @ transition(orbit, truth.time_s[4])[:3].T
            worst_m = max(worst_m, float(np.linalg.norm(truth.position[4] - expected, axis=1).max()))
            middle = (truth.velocity[4] + truth.velocity[5]) / 2
            change = integral(orbit, truth.position[4], middle) - energy
            drift = max(drift, float(np.abs(change).max()))
    print(
        json.dumps(
            {
                "orbit_s": orbit.period_s,
                "steps_per_period": 8,
                "farthest_m": float(np.linalg.norm(truth.position[-1] - STARTS[:, :3], axis=1).max()),
                "worst_position_error_m": worst_m,
                "worst_integral_change_m2_s2": drift,
                "period_us": cost_us,
                "period_without_orbit_us": without_us,
                "mujoco": mujoco.__version__,
                "machine": platform.platform(),
            },
            indent=2,
        )
    )


if __name__ == "__main__":
    main()
