"""Time of a craft's allocation over thrusters and wheels, beside SciPy's bounded least squares, on the same problems.

    python benchmarks/allocation.py > allocation.json

The craft is the shipped `cubesat12u`: twelve thrusters, three wheels. Wrenches are drawn within and beyond its reach.
Prints JSON: microseconds per craft of the compiled batch and of `scipy.optimize.lsq_linear` (BVLS), rounds of the
active set, and the largest difference between the answers, in shares of an actuator's most.
"""

import json
import platform
import time

import numba
import numpy as np
import scipy
from scipy.optimize import lsq_linear

from swarm.assets import find_model
from swarm.hardware import Fitted, actuator_set
from swarm.onboard.actuation.allocation import allocate
from swarm.onboard.actuation.orders import THRUSTER_COST, WHEEL_COST
from swarm.world.craft import load_craft

CRAFT, BY_SCIPY, REPEATS = 2000, 300, 5


def problems():
    """What `allocate` takes, for CRAFT wrenches."""
    model, rng = load_craft(find_model("cubesat12u")), np.random.default_rng(0)
    effect = actuator_set([Fitted(model.thrusters, model.wheels, (0.0, 0.0), 0)], model.com_m[None]).effect
    effect = np.tile(effect, (CRAFT, 1, 1))
    thrusters, wheels = len(model.thrusters.force_n), len(model.wheels.torque_nm)
    low = np.tile(np.repeat([0.0, -1.0], [thrusters, wheels]), (CRAFT, 1))
    cost = np.tile(np.repeat([THRUSTER_COST, WHEEL_COST], [thrusters, wheels]), (CRAFT, 1))
    size = np.array([1.0, 1.0, 1.0, 0.02, 0.02, 0.02])
    wrench = rng.normal(size=(CRAFT, 6)) * size * rng.uniform(0.1, 3, (CRAFT, 1))
    scale = np.tile([1.0, 1, 1, 10, 10, 10], (CRAFT, 1))
    return effect, scale, cost, np.zeros_like(low), low, np.ones_like(low), wrench


def main():
    """Solve with both, compare, print."""
    arguments = problems()
    effect, scale, cost, _, low, high, wrench = arguments
    found, rounds = allocate(*arguments)
    times = []
    for _ in range(REPEATS):
        started = time.perf_counter()
        allocate(*arguments)
        times.append(time.perf_counter() - started)
    worst, started, spent = 0.0, 0.0, 0.0
    for c in range(BY_SCIPY):
        matrix = np.vstack([scale[c][:, None] * effect[c], np.diag(np.sqrt(cost[c]))])
        right = np.concatenate([scale[c] * wrench[c], np.zeros(len(low[c]))])
        started = time.perf_counter()
        peer = lsq_linear(matrix, right, (low[c], high[c]), method="bvls", tol=1e-15, max_iter=1000).x
        spent += time.perf_counter() - started
        worst = max(worst, float(np.abs(peer - found[c]).max()))
    print(
        json.dumps(
            {
                "allocation_us": 1e6 * min(times) / CRAFT,
                "rounds_mean": float(rounds.mean()),
                "rounds_max": int(rounds.max()),
                "scipy_lsq_linear_us": 1e6 * spent / BY_SCIPY,
                "largest_difference": worst,
                "numba": numba.__version__,
                "scipy": scipy.__version__,
                "machine": platform.platform(),
            },
            indent=2,
        )
    )


if __name__ == "__main__":
    main()
