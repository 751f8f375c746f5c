"""Visibility: which photodiodes the light reaches, beside MuJoCo's `mj_multiRay` and Embree, all on the same rays.

    python benchmarks/visibility.py [--craft 1000] [--repeats 9] [--out visibility.json]

One answer for every photodiode of `swarm1000`, at one instant. MuJoCo and Embree are asked only of the rays that reach
a photodiode's front within range and field; Embree has to build its tree first, since the craft move (its times are
given with and without). Found the truth: the share of those rays with the answer of a loop of `mj_ray`.
"""

import importlib
from typing import Any

import mujoco
import numpy as np
from harness import finish, interleaved, options, show
from period import captured

from estimators.rotation import matrix_from_quaternion
from swarm.sensors.sight import Sight
from swarm.sensors.visibility import THICKNESS_M


def main() -> None:
    """Measure, show, write."""
    chosen = options(__doc__, craft=(1000, "craft"), repeats=(9, "repetitions"))
    c = captured(chosen.craft)
    visibility, world = c.flight.sensors.visibility, c.flight.world
    position, quaternion = c.truth.position, c.truth.quaternion
    state = visibility.state(position, quaternion)
    data = visibility._placed_rays(position, quaternion)._data
    who, photodiode = np.nonzero(state != Sight.OUTSIDE)
    point = matrix_from_quaternion(quaternion[who]) @ visibility._photodiodes.point_m[who, photodiode, :, None]
    point = point[..., 0] + position[who]
    distance = np.linalg.norm(point, axis=1)
    ray, reach, start = point / distance[:, None], distance - THICKNESS_M, np.zeros(3)
    ours = state[who, photodiode] == Sight.LIT
    model, station, count = world.model, world.lighthouse_body, len(ray)
    hit, geom = np.empty(count), np.empty(count, dtype=np.int32)

    def many() -> np.ndarray:
        mujoco.mj_multiRay(
            model,
            data,
            pnt=start,
            vec=ray.ravel(),
            geomgroup=None,
            flg_static=True,
            bodyexclude=station,
            geomid=geom,
            dist=hit,
            normal=None,
            nray=count,
            cutoff=float(distance.max()),
        )
        return ~((hit >= 0) & (hit < reach))

    def one_by_one() -> np.ndarray:
        first = np.array([mujoco.mj_ray(model, data, start, one, None, True, station, None) for one in ray])
        return ~((first >= 0) & (first < reach))

    answers = {"lighthouse-swarm": ours, "mj_multiRay": many(), "mj_ray, one by one": one_by_one()}
    candidates = {"lighthouse-swarm": lambda: visibility.state(position, quaternion), "mj_multiRay": many}
    try:
        scenes = importlib.import_module("embreex.rtcore_scene")
        meshes = importlib.import_module("embreex.mesh_construction")
    except ImportError:
        print("Embree is not installed (embreex, in the extra `bench`): left out")
    else:
        parts = [world.visuals(i) for i in range(chosen.craft)]
        turn = matrix_from_quaternion(quaternion)
        origin, direction = np.zeros((count, 3), np.float32), ray.astype(np.float32)
        limit = reach.astype(np.float32)

        def build() -> object:
            scene = scenes.EmbreeScene()
            triangle = [
                (mesh.vertex @ turn[i].T + position[i])[mesh.face]
                for i, visual in enumerate(parts)
                for mesh, _ in visual
            ]
            meshes.TriangleMesh(scene, np.concatenate(triangle).astype(np.float32))
            return scene

        scene = build()

        def embree(in_scene: Any = scene) -> np.ndarray:
            return np.asarray(in_scene.run(origin, direction, limit.copy(), query="OCCLUDED")) < 0

        answers["Embree"] = embree()
        candidates |= {"Embree, tree at hand": embree, "Embree, tree built": lambda: embree(build())}
    times = interleaved(candidates, chosen.repeats)
    truth = answers["mj_ray, one by one"]
    per = {name: t.figures(count) for name, t in times.items()}
    equal = {name: float(np.mean(answer == truth)) for name, answer in answers.items()}
    show(
        f"{chosen.craft} craft, {count} rays, {np.count_nonzero(~truth)} of them blocked; per ray [us]",
        ["", "CPU median", "CPU minimum", "wall median", "as mj_ray"],
        [
            [
                name,
                *(1e6 * f[k] for k in ("cpu_median_s", "cpu_minimum_s", "wall_median_s")),
                f"{100 * equal.get(name, equal.get('Embree', np.nan)):.4f} %",
            ]
            for name, f in per.items()
        ],
    )
    finish("visibility", {"craft": chosen.craft, "rays": count, "per_ray": per, "same_as_mj_ray": equal}, chosen.out)


if __name__ == "__main__":
    main()
