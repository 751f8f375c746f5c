"""PnP: Levenberg-Marquardt on the sweep angles of one period, beside OpenCV's SQPNP and PoseLib's refinement.

    python benchmarks/pnp.py [--craft 1000] [--repeats 7] [--out pnp.json]

The angles are those that the craft of `swarm1000` measure, moving, with noise; refinements start from the filter's
prediction, as on board, SQPNP and our cold start from nothing. The others solve for a craft at rest: they are given
each angle as it was measured, and pay with a bias for what our motion compensation knows. `at rest` is ours without
it. Found the truth: the share solved, and the median error against the true pose.
"""

import importlib

import numpy as np
from harness import finish, interleaved, options, show
from period import captured

from estimators.lighthouse.pnp import refine
from estimators.lighthouse.pnp_start import cold_starts
from estimators.lighthouse.projection import projections
from estimators.rotation import angle_between, matrix_from_quaternion, quaternion_from_matrix


def main() -> None:
    """Measure, show, write."""
    chosen = options(__doc__, craft=(1000, "craft"), repeats=(7, "repetitions"))
    c = captured(chosen.craft)
    theta, lit, point, start_rotation, start_position, offset, rate, _velocity = c.refine
    count, still = len(lit), np.zeros_like(rate)
    uv, true_rotation = projections(theta), matrix_from_quaternion(c.truth.quaternion)
    enough = lit.sum(axis=1) >= 4
    image = [uv[i, lit[i]].copy() for i in range(count)]
    target = [point[i, lit[i]].copy() for i in range(count)]
    answers: dict[str, tuple[np.ndarray, np.ndarray]] = {}

    def nothing() -> tuple[np.ndarray, np.ndarray]:
        return np.full((count, 3, 3), np.nan), np.full((count, 3), np.nan)

    def ours() -> None:
        solution = refine(*c.refine)
        answers["ours"] = solution.rotation, solution.position

    def at_rest() -> None:
        solution = refine(theta, lit, point, start_rotation, start_position, offset, still, still)
        answers["ours, at rest"] = solution.rotation, solution.position

    def cold() -> None:
        rotation, position = nothing()
        found = cold_starts(theta[enough], lit[enough], point[enough], offset[enough], still[enough], still[enough])
        for i, one in zip(np.flatnonzero(enough), found, strict=True):
            if len(one.cost):
                rotation[i], position[i] = one.rotation[0], one.position[0]
        answers["ours, cold start"] = rotation, position

    candidates = {"ours": ours, "ours, at rest": at_rest, "ours, cold start": cold}
    try:
        cv2 = importlib.import_module("cv2")
    except ImportError:
        print("OpenCV is not installed (the extra `bench`): left out")
    else:
        cv2.setNumThreads(1)
        camera = np.eye(3)

        def sqpnp() -> None:
            rotation, position = nothing()
            for i in np.flatnonzero(enough):
                try:
                    ok, turned, moved = cv2.solvePnP(target[i], image[i], camera, None, flags=cv2.SOLVEPNP_SQPNP)
                except cv2.error:
                    # It refuses a target that is small in the image.
                    continue
                if ok:
                    rotation[i], position[i] = cv2.Rodrigues(turned)[0], moved[:, 0]
            answers["OpenCV SQPNP"] = rotation, position

        candidates["OpenCV SQPNP"] = sqpnp
    try:
        poselib = importlib.import_module("poselib")
    except ImportError:
        print("PoseLib is not installed (the extra `bench`): left out")
    else:
        pinhole = {"model": "SIMPLE_PINHOLE", "width": 0, "height": 0, "params": [1.0, 0.0, 0.0]}
        known = np.flatnonzero(enough & np.isfinite(start_position).all(axis=1))
        quaternion = quaternion_from_matrix(np.where(np.isfinite(start_rotation), start_rotation, np.eye(3)))

        def refinement() -> None:
            rotation, position = nothing()
            for i in known:
                first = poselib.CameraPose()
                first.q, first.t = quaternion[i], start_position[i]
                pose, _ = poselib.refine_absolute_pose(image[i], target[i], first, pinhole, {"loss_type": "TRIVIAL"})
                rotation[i], position[i] = pose.R, pose.t
            answers["PoseLib refinement"] = rotation, position

        candidates["PoseLib refinement"] = refinement
    times = interleaved(candidates, chosen.repeats)
    solves = int(enough.sum())
    result = {}
    for name, (rotation, position) in answers.items():
        solved = np.isfinite(position).all(axis=1)
        turn = angle_between(rotation[solved], true_rotation[solved])
        result[name] = {
            **times[name].figures(solves),
            "solved": int(solved.sum()),
            "median_position_error_m": float(np.median(np.linalg.norm(position - c.truth.position, axis=1)[solved])),
            "median_attitude_error_deg": float(np.degrees(np.median(turn))),
            "wrong": int(np.count_nonzero(turn > 0.1)),
        }
    show(
        f"{solves} of {count} craft with 4 or more photodiodes lit ({lit.sum(axis=1)[enough].mean():.1f} on average); "
        "per solve [us]",
        ["", "CPU median", "CPU minimum", "wall median", "solved", "error [mm]", "error [deg]", "off by > 0.1 rad"],
        [
            [
                name,
                *(1e6 * r[k] for k in ("cpu_median_s", "cpu_minimum_s", "wall_median_s")),
                r["solved"],
                1e3 * r["median_position_error_m"],
                r["median_attitude_error_deg"],
                r["wrong"],
            ]
            for name, r in result.items()
        ],
    )
    finish("pnp", {"craft": count, "solves": solves, "results": result}, chosen.out)


if __name__ == "__main__":
    main()
