"""Acquisition and tracking beside KISS-Matcher, Open3D and small_gicp on the same clouds. Errors and time, as JSON.

    PYTHONPATH=. python benchmarks/lidar.py [FOLDER --shapes HST ...] [--scans 40] [--far] [--seed 0]
                                                                         (needs the extra `bench`)

Scans of the turntable (`swarm.studies.papers.lidar`: 16 lines, 1 cm) at attitudes drawn over SO(3): of the satellite
from 5 m, or of the shapes NAME.obj in FOLDER from their nearer range, `--far`: their further one
(`swarm.studies.papers.lidar_shapes`). The reference cloud of the peers is the target's whole surface, 20 000 points
with normals; ours works on the mesh. Tracking starts up to 5 degrees, and 5 cm or 1/60 of the shape's length, off. Time
is of the processor, one thread, median per scan, after one that is not counted:

    acquisition  ours | KISS-Matcher, then point-to-plane ICP | Open3D: FPFH features, RANSAC, then point-to-plane ICP
    tracking     ours | Open3D: point-to-plane ICP | small_gicp: point-to-plane ICP, and GICP

Voxels and reaches of the peers are those of the satellite, scaled with the shape's length. Right: within 2 degrees and
5 % of the length, modulo symmetry. Ours counts as right only what it believes, and what it believes and is not right as
`believed_wrong`; what the peers know of their own failure is their fitness and inliers, and none is used.
"""

import argparse
import json
import os
import platform
import sys
import time
from collections.abc import Callable
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

# One core for everybody, before anything starts its threads.
os.environ |= {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}
import kiss_matcher
import numpy as np
import open3d as o3d
import small_gicp

from estimators import rotation as rot
from estimators.arrays import Floats
from estimators.lidar.acquisition import acquire
from estimators.lidar.scan import Scan
from estimators.lidar.shape import Shape
from estimators.lidar.tracking import track
from swarm.assets import find_model
from swarm.studies.papers.lidar import Turntable
from swarm.studies.papers.lidar_acquisition import random_rotations
from swarm.studies.papers.lidar_shapes import bench_of, errors, is_right

REFERENCE_POINTS, VOXEL, REACH, SHIFT = 20_000, 1 / 60, 0.1, 1 / 60
"""Points of the reference; voxel, reach of a match, and shift of a start, against the shape's length."""
TURN_DEG = 5.0
TOLERANCE = 1e-5
FEWEST = 40
"""Returns without which nobody tries."""

Pose = tuple[Floats, Floats, bool]
"""Rotation R_s_t (3, 3), position (3,) [m], and whether it is believed."""
Solver = Callable[[Scan, Floats, Floats], Pose]
"""A scan and the prediction, rotation (3, 3), position (3,), to the pose."""


def matrix(rotation: Floats, position: Floats) -> Floats:
    """4 x 4."""
    out = np.eye(4)
    out[:3, :3], out[:3, 3] = rotation, position
    return out


def cloud(point: Floats, normal: Floats | None = None) -> Any:
    """Open3D's."""
    out = o3d.geometry.PointCloud(o3d.utility.Vector3dVector(point))
    if normal is not None:
        out.normals = o3d.utility.Vector3dVector(normal)
    return out


def pose(transformation: Floats) -> Pose:
    """Return the pose whose inverse maps a scan to the reference."""
    back = np.linalg.inv(np.asarray(transformation, dtype=np.float64))
    return back[:3, :3], back[:3, 3], True


def peers(reference: Shape, length_m: float) -> tuple[dict[str, Solver], dict[str, Solver]]:
    """Return acquisition and tracking of the other libraries.

    Args:
        reference: the shape, as they know it.
        length_m: its length [m].
    """
    voxel_m, reach_m = VOXEL * length_m, REACH * length_m
    registration = o3d.pipelines.registration
    target = cloud(reference.point, reference.normal)
    coarse = target.voxel_down_sample(voxel_m)
    around = o3d.geometry.KDTreeSearchParamHybrid(radius=5 * voxel_m, max_nn=100)
    feature = registration.compute_fpfh_feature(coarse, around)
    to_plane = registration.TransformationEstimationPointToPlane()

    def icp(point: Floats, start: Floats, within_m: float) -> Pose:
        criteria = registration.ICPConvergenceCriteria(TOLERANCE, TOLERANCE, 100)
        return pose(
            registration.registration_icp(cloud(point), target, within_m, start, to_plane, criteria).transformation
        )

    def open3d_acquire(scan: Scan, _rotation: Floats, _position: Floats) -> Pose:
        own = cloud(scan.point)
        own.estimate_normals(o3d.geometry.KDTreeSearchParamHybrid(radius=reach_m, max_nn=20))
        own.orient_normals_towards_camera_location(np.zeros(3))
        found = registration.registration_ransac_based_on_feature_matching(
            own,
            coarse,
            registration.compute_fpfh_feature(own, around),
            feature,
            False,
            2 * voxel_m,
            registration.TransformationEstimationPointToPoint(False),
            3,
            [registration.CorrespondenceCheckerBasedOnDistance(2 * voxel_m)],
            registration.RANSACConvergenceCriteria(100_000, 0.999),
        )
        return icp(scan.point, found.transformation, 2 * voxel_m)

    def kiss_acquire(scan: Scan, _rotation: Floats, _position: Floats) -> Pose:
        matcher = kiss_matcher.KISSMatcher(kiss_matcher.KISSMatcherConfig(voxel_size=voxel_m))
        found = matcher.estimate(scan.point.astype(np.float32), reference.point.astype(np.float32))
        return icp(scan.point, matrix(np.asarray(found.rotation), np.asarray(found.translation)), 2 * voxel_m)

    def open3d_track(scan: Scan, rotation: Floats, position: Floats) -> Pose:
        return icp(scan.point, np.asarray(np.linalg.inv(matrix(rotation, position)), dtype=np.float64), reach_m)

    gicp_target = small_gicp.PointCloud(reference.point)
    tree = small_gicp.KdTree(gicp_target, num_threads=1)
    small_gicp.estimate_normals_covariances(gicp_target, tree, num_neighbors=10, num_threads=1)

    def gicp(kind: str) -> Solver:
        def solve(scan: Scan, rotation: Floats, position: Floats) -> Pose:
            own = small_gicp.PointCloud(scan.point)
            small_gicp.estimate_normals_covariances(own, num_neighbors=10, num_threads=1)
            found = small_gicp.align(
                gicp_target,
                own,
                tree,
                np.linalg.inv(matrix(rotation, position)),
                kind,
                max_correspondence_distance=reach_m,
                num_threads=1,
                max_iterations=100,
                rotation_epsilon=TOLERANCE,
                translation_epsilon=TOLERANCE,
            )
            return pose(found.T_target_source)

        return solve

    return (
        {"KISS-Matcher + ICP": kiss_acquire, "Open3D FPFH + RANSAC + ICP": open3d_acquire},
        {
            "Open3D point-to-plane ICP": open3d_track,
            "small_gicp PLANE_ICP": gicp("PLANE_ICP"),
            "small_gicp GICP": gicp("GICP"),
        },
    )


def our_acquisition(shape: Shape) -> Solver:
    """Return our acquisition of a shape."""

    def solve(scan: Scan, _rotation: Floats, _position: Floats) -> Pose:
        found = acquire(scan, shape)
        return found.rotation, found.position, found.found

    return solve


def our_tracking(shape: Shape) -> Solver:
    """Return our tracking of a shape."""

    def solve(scan: Scan, rotation: Floats, position: Floats) -> Pose:
        found = track(scan, shape, rotation, position)
        return found.rotation, found.position, found.tracked

    return solve


def measure(
    solve: Solver, bench: Turntable, scans: list[Scan], truths: Floats, starts: list[tuple[Floats, Floats]]
) -> dict[str, float | None]:
    """Return errors and time of one solver.

    Args:
        solve: the solver.
        bench: the turntable with the shape.
        scans: the scans.
        truths: (n, 3, 3), the true attitudes.
        starts: a prediction per scan.
    """
    shape, off, believed, seconds = bench.shape, [], [], []
    solve(scans[0], *starts[0])
    for scan, truth, start in zip(scans, truths, starts, strict=True):
        before = time.process_time()
        rotation, position, good = solve(scan, *start)
        seconds.append(time.process_time() - before)
        off.append(errors(shape, truth, bench.position, rotation, position))
        believed.append(good)
    near = np.array([is_right(shape, each) for each in off])
    right = near & np.array(believed)
    of_right = np.array(off)[right].reshape(-1, 2)

    def of(column: int, share: float | None) -> float | None:
        if not len(of_right):
            return None
        values = of_right[:, column]
        return float(values.mean() if share is None else np.quantile(values, share))

    return {
        "right_share": float(right.mean()),
        "believed_wrong": float(np.count_nonzero(np.array(believed) & ~near)),
        "median_deg": float(np.nanmedian(np.array(off)[:, 0])),
        "mean_of_right_deg": of(0, None),
        "median_of_right_deg": of(0, 0.5),
        "95_percent_of_right_deg": of(0, 0.95),
        "mean_of_right_mm": of(1, None),
        "median_ms": 1e3 * float(np.median(seconds)),
        "slowest_ms": 1e3 * float(np.max(seconds)),
    }


def beside(bench: Turntable, number: int, seed: int) -> dict[str, Any]:
    """Return the figures of all solvers on the scans of one shape.

    Args:
        bench: the turntable with the shape.
        number: of the scans.
        seed: of attitudes and starts.
    """
    rng = np.random.default_rng(seed)
    mesh, length_m = bench.shape.mesh, bench.shape.diameter_m
    # Triangle soup, so that the reference is the same surface for everybody.
    corners = np.concatenate([mesh.corner, mesh.corner + mesh.edge1, mesh.corner + mesh.edge2])
    faces = np.arange(len(corners)).reshape(3, -1).T
    drawn = random_rotations(number, rng)
    all_scans = [bench.scan(truth) for truth in drawn]
    some = [i for i, scan in enumerate(all_scans) if np.count_nonzero(scan.returned) >= FEWEST]
    out: dict[str, Any] = {
        "range_m": float(bench.position[0]),
        "scans": len(some),
        "too_few_returns": number - len(some),
    }
    if not some:
        return out
    truths, scans = drawn[some], [all_scans[i] for i in some]
    turns = rot.exp(np.radians(rng.uniform(-TURN_DEG, TURN_DEG, (len(some), 3)) / np.sqrt(3)))
    shifts = bench.position + SHIFT * length_m * rng.uniform(-1, 1, (len(some), 3)) / np.sqrt(3)
    starts = list(zip(turns @ truths, shifts, strict=True))
    theirs = peers(Shape(corners, faces, points=REFERENCE_POINTS), length_m)
    ours = {"ours": our_acquisition(bench.shape)}, {"ours": our_tracking(bench.shape)}
    out["points_median"] = float(np.median([np.count_nonzero(scan.returned) for scan in scans]))
    for name, own, other in zip(("acquisition", "tracking"), ours, theirs, strict=True):
        out[name] = {label: measure(solve, bench, scans, truths, starts) for label, solve in (own | other).items()}
    return out


def main() -> None:
    """Run, and print."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=Path, nargs="?")
    parser.add_argument("--shapes", nargs="+", default=["satellite"])
    parser.add_argument("--far", action="store_true")
    parser.add_argument("--scans", type=int, default=40)
    parser.add_argument("--seed", type=int, default=0)
    given = parser.parse_args()
    o3d.utility.random.seed(given.seed)
    o3d.utility.set_verbosity_level(o3d.utility.VerbosityLevel.Error)
    out: dict[str, Any] = {}
    for name in given.shapes:
        path = given.folder / f"{name}.obj" if given.folder else find_model(name)
        bench = bench_of(path, int(given.far), given.seed)
        out[name] = beside(bench, given.scans, given.seed)
        print(f"{name}: done", file=sys.stderr, flush=True)
    if list(out) == ["satellite"]:
        out = out["satellite"]
    packages = ("numpy", "scipy", "numba", "kiss_matcher", "open3d", "small_gicp")
    out["reference_points"] = REFERENCE_POINTS
    out["versions"] = {"python": platform.python_version()} | {name: installed(name) for name in packages}
    out["machine"] = {"system": platform.platform(), "processor": platform.machine(), "cores": os.cpu_count()}
    print(json.dumps(out, indent=2))


def installed(name: str) -> str:
    """Return the version of a package; Open3D is also installed as `open3d-cpu`."""
    try:
        return version(name)
    except PackageNotFoundError:
        return version(f"{name}-cpu")


if __name__ == "__main__":
    main()
