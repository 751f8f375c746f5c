"""Physics: one lighthouse period of the world, at 4 and 8 steps, beside `mj_step` alone.

    python benchmarks/physics.py [--craft 1000] [--repeats 15] [--out physics.json]

The world adds to MuJoCo's own steps: the search for craft that could touch, the wrenches, the knots of the motion.
Found the truth: after the run a swarm that nothing pushes is where its first velocity carries it, and its angular
momentum is what it was; the greatest deviation of each, the second relative.
"""

import mujoco
import numpy as np
from harness import finish, interleaved, options, show

from estimators.arrays import Floats
from estimators.rotation import matrix_from_quaternion
from swarm.flight import builders
from swarm.scenario import load
from swarm.world.world import World


def momentum(world: World, quaternion: Floats, rate: Floats) -> Floats:
    """Angular momentum (C, 3) [N m s] about the centre of mass."""
    turn = matrix_from_quaternion(quaternion)
    return np.asarray((turn @ world.inertia @ np.swapaxes(turn, 1, 2) @ rate[..., None])[..., 0])


def main() -> None:
    """Measure, show, write."""
    chosen = options(__doc__, craft=(1000, "craft"), repeats=(15, "repetitions"))
    none = np.zeros((chosen.craft, 3))
    candidates, worlds = {}, {}
    for steps in (4, 8):
        scenario = load("swarm1000", [f"swarm.count={chosen.craft}", f"physics.steps_per_period={steps}"])
        world = worlds[steps] = builders.world(scenario, builders.fleet(scenario))
        # Some millimetres a second, so that nobody meets anybody.
        world._rate[:, :3] = np.random.default_rng(0).normal(0, 1e-3, (chosen.craft, 3))
        free = builders.world(scenario, builders.fleet(scenario))
        free.model.opt.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_CONTACT)

        def alone(world: World = free, steps: int = steps) -> None:
            for _ in range(steps):
                mujoco.mj_step(world.model, world._data)

        candidates[f"world, {steps} steps"] = lambda world=world: world.advance(none, none)
        candidates[f"mj_step alone, {steps} steps"] = alone
    first = {steps: world.advance(none, none) for steps, world in worlds.items()}
    times = interleaved(candidates, chosen.repeats)
    truth = {}
    for steps, world in worlds.items():
        begin, end = first[steps], world.advance(none, none)
        path = begin.position[0] + begin.velocity[0] * (end.time_s[-1] - begin.time_s[0])
        before = momentum(world, begin.quaternion[0], begin.angular_rate[0])
        after = momentum(world, end.quaternion[-1], end.angular_rate[-1])
        size = np.linalg.norm(before, axis=1)
        truth[f"{steps} steps"] = {
            "path_m": float(np.abs(end.position[-1] - path).max()),
            "angular_momentum": float(np.max(np.linalg.norm(after - before, axis=1) / size)),
            "after_s": float(end.time_s[-1] - begin.time_s[0]),
        }
    per = {name: t.figures(chosen.craft) for name, t in times.items()}
    show(
        f"{chosen.craft} craft; per craft and period [us]",
        ["", "CPU median", "CPU minimum", "wall median"],
        [[n, *(1e6 * f[k] for k in ("cpu_median_s", "cpu_minimum_s", "wall_median_s"))] for n, f in per.items()],
    )
    for name, found in truth.items():
        print(f"{name}: " + ", ".join(f"{what} {value:.2e}" for what, value in found.items()))
    finish("physics", {"craft": chosen.craft, "per_craft": per, "truth": truth}, chosen.out)


if __name__ == "__main__":
    main()
