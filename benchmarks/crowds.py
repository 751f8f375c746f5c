"""Visibility against one `mj_ray` per ray, in crowded scenes of every shipped model, up to a thousand craft.

    python benchmarks/crowds.py [--craft 10 100 1000] [--scenes 4] [--out crowds.json]

The tests do the same with 10 and 100 craft. Scenes are cones full of craft, some facing the lighthouse, some anyhow,
some of them around its very source; a scene's rays are those that reach a photodiode's front within field and range.
Fails (exit 1) where a single photodiode differs.
"""

import sys
import time
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
from harness import finish, options, show

from estimators.arrays import Floats
from swarm import hardware as layout
from swarm.assets import find_model, models
from swarm.scenario import load
from swarm.sensors.sight import Sight
from swarm.sensors.visibility import THICKNESS_M, Visibility
from swarm.world.assembly import Placement, assemble, at_origin
from swarm.world.craft import load_craft

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "tests"))

from test_crowded_light import crowded

from swarm.scenario import Lighthouse
from swarm.units import si


def crowd(names: list[str], count: int) -> tuple[mujoco.MjModel, layout.Photodiodes, Visibility]:
    """`count` craft of these models in turn."""
    craft = [load_craft(find_model(names[i % len(names)]), passive=True) for i in range(count)]
    nowhere = np.zeros(3), np.array([1.0, 0, 0, 0])
    placements = [Placement(f"craft-{i}", model.spec, model.file_pose, *nowhere) for i, model in enumerate(craft)]
    model = assemble(placements, [at_origin(find_model(load("swarm1000").lighthouse.model))], 1e-3)
    photodiodes = layout.pad([m.point_m for m in craft], [m.normal for m in craft])
    return model, photodiodes, Visibility(model, photodiodes, model.jnt_bodyid, 1, Lighthouse())


def brute_force(model: mujoco.MjModel, data: mujoco.MjData, photodiodes: layout.Photodiodes) -> tuple[Floats, float]:
    """The sight of every photodiode (C, K) with one `mj_ray` for each that is in reach; the rays' CPU seconds."""
    limits, start = si(Lighthouse()), np.zeros(3)
    mujoco.mj_kinematics(model, data)
    place, turn = data.xpos[model.jnt_bodyid], data.xmat[model.jnt_bodyid].reshape(-1, 3, 3)
    point = np.einsum("cij,ckj->cki", turn, photodiodes.point_m) + place[:, None]
    normal = np.einsum("cij,ckj->cki", turn, photodiodes.normal)
    distance = np.linalg.norm(point, axis=2)
    half = np.tan(limits.field_rad / 2)
    reached = photodiodes.present & (point[..., 2] > 0) & (np.abs(point[..., :2]) <= half * point[..., 2:]).all(axis=2)
    reached &= (distance >= limits.range_min_m) & (distance <= limits.range_max_m)
    reached &= -np.sum(normal * point, axis=2) >= np.cos(limits.incidence_max_rad) * distance
    out = np.full(reached.shape, int(Sight.OUTSIDE), dtype=np.int8)
    began = time.process_time()
    for c, k in np.argwhere(reached):
        hit = mujoco.mj_ray(model, data, start, point[c, k] / distance[c, k], None, True, 1, None)
        out[c, k] = Sight.BLOCKED if 0 <= hit < distance[c, k] - THICKNESS_M else Sight.LIT
    return out, time.process_time() - began


def compare(names: list[str], count: int, scenes: int) -> dict[str, Any]:
    """Some scenes of `count` craft of these models."""
    model, photodiodes, visibility = crowd(names, count)
    data, rng = mujoco.MjData(model), np.random.default_rng(count)
    seen, different, ours_s, rays_s = np.zeros(3, dtype=np.int64), 0, 0.0, 0.0
    # A crowd of large ones in a narrow cone would leave no light at all.
    spreads = (0.3, 0.8) if count <= 100 else (1.0, 1.7)
    for spread_m in spreads:
        for i in range(scenes):
            position, quaternion = crowded(rng, count, spread_m, around=i == 1)
            data.qpos[:] = np.concatenate([position, quaternion], axis=1).ravel()
            expected, seconds = brute_force(model, data, photodiodes)
            began = time.process_time()
            state = visibility.state(position, quaternion)
            ours_s += time.process_time() - began
            rays_s += seconds
            different += int(np.count_nonzero(state != expected))
            seen += np.bincount(expected[photodiodes.present], minlength=3)
    return {
        "models": " + ".join(names),
        "craft": count,
        "scenes": len(spreads) * scenes,
        **{sight.name.lower(): int(seen[sight]) for sight in Sight},
        "different": different,
        "ours_cpu_s": ours_s,
        "mj_ray_cpu_s": rays_s,
    }


def main() -> None:
    """Ask, compare, show, write."""
    chosen = options(__doc__, craft=([10, 100, 1000], "craft"), scenes=(4, "scenes of each spread"))
    rows, differences = [], 0
    for names in [*([name] for name in sorted(models())), sorted(models())]:
        for count in chosen.craft:
            row = compare(names, count, chosen.scenes)
            rows.append(row)
            differences += row["different"]
    show(
        "Photodiodes, by what they see, and how many of them MuJoCo's own ray sees otherwise",
        ["models", "craft", "scenes", "outside", "blocked", "lit", "different", "ours [s]", "mj_ray [s]"],
        [list(row.values()) for row in rows],
    )
    finish("crowds", {"results": rows, "different": differences}, chosen.out)
    sys.exit(1 if differences else 0)


if __name__ == "__main__":
    main()
