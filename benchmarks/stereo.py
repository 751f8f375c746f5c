"""Pose of source 2's marker from the same noisy images: closed form, fits, and OpenCV. Errors and time, as JSON.

    PYTHONPATH=. python benchmarks/stereo.py [--poses 2000] [--seed 0]

Images of 1 um (3 sigma) at 28 mm, 0 m to 30 m between the docking points (`swarm.studies.papers.stereo`), all five
lights seen. Per stretch of distance the RMS errors of attitude [deg] and of the target's position in the main camera's
frame [mm], and per solver the time per pose on one thread. Ours take all poses in one call, and one by one, as a flight
does; OpenCV takes them one by one:

    triangulatePoints     points by DLT, then the rigid transform of least squares (SVD): what the closed form does
    solvePnP ITERATIVE    the main camera alone, from the start that our fit has (its own needs six points)
    solvePnP SQPNP        the main camera alone, without a start
"""

import argparse
import importlib
import json
import os
import platform
import sys
import time
from collections.abc import Callable, Iterable
from functools import partial
from importlib.metadata import version
from typing import Any

import numpy as np

from estimators import rotation as rot
from estimators.arrays import Bools, Floats
from estimators.stereo.cameras import refine_cameras
from estimators.stereo.closed_form import stereo_pose
from swarm.studies.papers import stereo
from swarm.studies.papers.stereo import MARKER_M, Poses

NOISE = stereo.IMAGE_NOISE_M / stereo.FOCAL_M
STRETCHES_M = ((0, 5), (5, 10), (10, 20), (20, 30))
REPEATS = 5

Solved = tuple[Floats, Floats]
"""rotation (N, 3, 3), position (N, 3)."""


def best(work: Callable[[], Any]) -> float:
    """The shortest of some runs [s]."""
    out = []
    for _ in range(REPEATS):
        start = time.perf_counter()
        work()
        out.append(time.perf_counter() - start)
    return min(out)


def each(solve: Callable[[Any], Any], rows: Iterable[Any]) -> None:
    """Solve one by one."""
    for one in rows:
        solve(one)


def report(poses: Poses, solved: Solved) -> dict[str, Any]:
    """RMS errors per stretch."""
    error = stereo.errors(poses, *solved)
    out = {}
    for low, high in STRETCHES_M:
        inside = (poses.distance_m >= low) & (poses.distance_m <= high)
        turn, shift = (np.sqrt(np.nanmean(np.sum(e[inside] ** 2, axis=1))) for e in (error[:, :3], error[:, 3:]))
        out[f"{low}-{high} m"] = {
            "attitude_deg": float(np.rad2deg(turn)),
            "position_mm": float(1e3 * shift),
            "unsolved": int(np.count_nonzero(np.isnan(error[inside, 0]))),
        }
    return out


def ours(poses: Poses, uv: Floats, start: Solved) -> dict[str, Any]:
    """The closed form, and the fits that start where a filter's prediction would be."""
    rig, both = stereo.rig(), stereo.all_seen(uv)
    alone = both.copy()
    alone[:, 1] = False

    def closed(rows: slice) -> Solved:
        pose = stereo_pose(uv[rows], both[rows], MARKER_M, rig)
        return pose.rotation, pose.position

    def fit(which: Bools, from_closed: bool) -> Callable[[slice], Solved]:
        def solve(rows: slice) -> Solved:
            begin = closed(rows) if from_closed else (start[0][rows], start[1][rows])
            pose = refine_cameras(uv[rows], which[rows], MARKER_M, rig, *begin).pose
            return pose.rotation, pose.position

        return solve

    out = {}
    for name, solve in (
        ("closed form, with covariance", closed),
        ("closed form, then the fit to both cameras, with covariance", fit(both, True)),
        ("fit to both cameras from the prediction, with covariance", fit(both, False)),
        ("fit to the main camera from the prediction, with covariance", fit(alone, False)),
    ):
        found = solve(slice(None))
        single = min(200, len(uv))
        out[name] = {
            "us_per_pose_in_one_call": 1e6 * best(partial(solve, slice(None))) / len(uv),
            "us_per_pose_one_by_one": 1e6
            * best(partial(each, solve, [slice(i, i + 1) for i in range(single)]))
            / single,
            "errors": report(poses, found),
        }
    return out


def opencv(cv2: Any, poses: Poses, uv: Floats, start: Solved) -> dict[str, Any]:
    """OpenCV on the same images, one pose at a time, in double precision."""
    rig, k = stereo.rig(), np.eye(3)
    p1 = np.eye(3, 4)
    p2 = np.column_stack([rig.rotation.T, -rig.rotation.T @ rig.origin_m])
    v = MARKER_M - MARKER_M.mean(axis=0)
    begin = [(cv2.Rodrigues(r)[0], t.reshape(3, 1)) for r, t in zip(*start, strict=True)]

    def triangulated(i: int) -> tuple[Floats, Floats]:
        h = cv2.triangulatePoints(p1, p2, uv[i, 0].T.copy(), uv[i, 1].T.copy())
        r = (h[:3] / h[3]).T
        mean = r.mean(axis=0)
        w, _, z = np.linalg.svd((r - mean).T @ v)
        c = w @ np.diag([1, 1, np.linalg.det(w @ z)]) @ z
        return c, mean - c @ MARKER_M.mean(axis=0)

    def pnp(flag: int, guess: bool) -> Callable[[int], tuple[Floats, Floats]]:
        def solve(i: int) -> tuple[Floats, Floats]:
            first = (begin[i][0].copy(), begin[i][1].copy(), True) if guess else (None, None, False)
            ok, r, t = cv2.solvePnP(MARKER_M, uv[i, 0], k, None, *first, flags=flag)
            return (cv2.Rodrigues(r)[0], t[:, 0]) if ok else (np.full((3, 3), np.nan), np.full(3, np.nan))

        return solve

    out = {}
    for name, solve in (
        ("triangulatePoints, then the rigid transform by SVD", triangulated),
        ("solvePnP ITERATIVE, from the prediction", pnp(cv2.SOLVEPNP_ITERATIVE, True)),
        ("solvePnP SQPNP", pnp(cv2.SOLVEPNP_SQPNP, False)),
    ):
        found = [solve(i) for i in range(len(uv))]
        rotation, position = (np.array(part) for part in zip(*found, strict=True))
        single = min(500, len(uv))
        out[name] = {
            "us_per_pose_one_by_one": 1e6 * best(partial(each, solve, range(single))) / single,
            "errors": report(poses, (rotation, position)),
        }
    return out


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--poses", type=int, default=2000)
    parser.add_argument("--seed", type=int, default=0)
    options = parser.parse_args()
    rng = np.random.default_rng(options.seed)
    poses = stereo.random_poses(rng.uniform(0, stereo.RANGE_M, options.poses), rng)
    uv = stereo.images(poses, MARKER_M, stereo.rig())
    uv += NOISE * rng.standard_normal(uv.shape)
    # A prediction off by half a degree and by 2 % of the distance.
    off = np.deg2rad(0.5) * rng.standard_normal((len(uv), 3))
    shift = 0.02 * poses.position[:, 2:] * rng.standard_normal((len(uv), 3))
    start = rot.exp(off) @ poses.rotation, poses.position + shift
    result: dict[str, Any] = {
        "benchmark": "stereo",
        "machine": {"platform": platform.platform(), "processor": platform.machine(), "cpus": os.cpu_count()},
        "versions": {"python": platform.python_version(), **{p: version(p) for p in ("numpy", "numba")}},
        "poses": options.poses,
        "seed": options.seed,
        "image_noise_um": 1e6 * stereo.IMAGE_NOISE_M,
        "ours": ours(poses, uv, start),
    }
    try:
        cv2 = importlib.import_module("cv2")
    except ImportError:
        result["opencv"] = "not installed (pip install opencv-python-headless)"
    else:
        cv2.setNumThreads(1)
        result["versions"]["opencv"] = cv2.__version__
        result["opencv"] = opencv(cv2, poses, uv, start)
    json.dump(result, sys.stdout, indent=2)
    print()


if __name__ == "__main__":
    main()
