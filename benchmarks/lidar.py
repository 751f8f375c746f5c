"""Acquisition and tracking of the satellite, beside Open3D and small_gicp on the same clouds. Errors and time, as JSON.

    PYTHONPATH=. python benchmarks/lidar.py [--scans 40] [--seed 0]          (needs the extra `bench`)

Scans of the turntable (`swarm.studies.papers.lidar`: 16 lines, 1 cm, 5 m) at attitudes drawn over SO(3). The reference
cloud of the peers is the target's whole surface, 20 000 points with normals; ours works on the mesh. Tracking starts up
to 5 degrees and 5 cm off. Time is of the processor, one thread, median per scan, after one that is not counted:

    acquisition  ours | Open3D: FPFH features, RANSAC, then point-to-plane ICP
    tracking     ours | Open3D: point-to-plane ICP | small_gicp: point-to-plane ICP, and GICP

Right: attitude within 2 degrees. What the peers know of their own failure is their fitness and inliers; none is used.
"""

import argparse
import json
import os
import platform
import time
from collections.abc import Callable
from importlib.metadata import version
from typing import Any

# One core for everybody, before anything starts its threads.
os.environ |= {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}
import numpy as np
import open3d as o3d
import small_gicp

from estimators import rotation as rot
from estimators.arrays import Floats
from estimators.lidar.acquisition import acquire
from estimators.lidar.scan import Scan
from estimators.lidar.shape import Shape
from estimators.lidar.tracking import track
from swarm.studies.papers.lidar import Turntable, error_deg
from swarm.studies.papers.lidar_acquisition import random_rotations

REFERENCE_POINTS, VOXEL_M, REACH_M = 20_000, 0.05, 0.3
TURN_DEG, SHIFT_M, RIGHT_DEG = 5.0, 0.05, 2.0
TOLERANCE = 1e-5

Solver = Callable[[Scan, Floats, Floats], Floats]
"""A scan and the prediction, rotation (3, 3), position (3,), to the attitude R_s_t (3, 3)."""


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


def peers(reference: Shape) -> tuple[dict[str, Solver], dict[str, Solver]]:
    """Acquisition and tracking of the other libraries."""
    registration = o3d.pipelines.registration
    target = cloud(reference.point, reference.normal)
    coarse = target.voxel_down_sample(VOXEL_M)
    around = o3d.geometry.KDTreeSearchParamHybrid(radius=5 * VOXEL_M, max_nn=100)
    feature = registration.compute_fpfh_feature(coarse, around)
    to_plane = registration.TransformationEstimationPointToPlane()

    def icp(point: Floats, start: Floats, reach_m: float) -> Floats:
        criteria = registration.ICPConvergenceCriteria(TOLERANCE, TOLERANCE, 100)
        found = registration.registration_icp(cloud(point), target, reach_m, start, to_plane, criteria)
        return np.linalg.inv(found.transformation)[:3, :3]

    def open3d_acquire(scan: Scan, _rotation: Floats, _position: Floats) -> Floats:
        own = cloud(scan.point)
        own.estimate_normals(o3d.geometry.KDTreeSearchParamHybrid(radius=0.3, max_nn=20))
        own.orient_normals_towards_camera_location(np.zeros(3))
        found = registration.registration_ransac_based_on_feature_matching(
            own,
            coarse,
            registration.compute_fpfh_feature(own, around),
            feature,
            False,
            0.1,
            registration.TransformationEstimationPointToPoint(False),
            3,
            [registration.CorrespondenceCheckerBasedOnDistance(0.1)],
            registration.RANSACConvergenceCriteria(100_000, 0.999),
        )
        return icp(scan.point, found.transformation, 0.1)

    def open3d_track(scan: Scan, rotation: Floats, position: Floats) -> Floats:
        return icp(scan.point, np.asarray(np.linalg.inv(matrix(rotation, position)), dtype=np.float64), REACH_M)

    gicp_target = small_gicp.PointCloud(reference.point)
    tree = small_gicp.KdTree(gicp_target, num_threads=1)
    small_gicp.estimate_normals_covariances(gicp_target, tree, num_neighbors=10, num_threads=1)

    def gicp(kind: str) -> Solver:
        def solve(scan: Scan, rotation: Floats, position: Floats) -> Floats:
            own = small_gicp.PointCloud(scan.point)
            small_gicp.estimate_normals_covariances(own, num_neighbors=10, num_threads=1)
            found = small_gicp.align(
                gicp_target,
                own,
                tree,
                np.linalg.inv(matrix(rotation, position)),
                kind,
                max_correspondence_distance=REACH_M,
                num_threads=1,
                max_iterations=100,
                rotation_epsilon=TOLERANCE,
                translation_epsilon=TOLERANCE,
            )
            return np.linalg.inv(found.T_target_source)[:3, :3]

        return solve

    return (
        {"Open3D FPFH + RANSAC + ICP": open3d_acquire},
        {
            "Open3D point-to-plane ICP": open3d_track,
            "small_gicp PLANE_ICP": gicp("PLANE_ICP"),
            "small_gicp GICP": gicp("GICP"),
        },
    )


def measure(solve: Solver, scans: list[Scan], truths: Floats, starts: list[tuple[Floats, Floats]]) -> dict[str, float]:
    """Errors and time of one solver."""
    errors, seconds = [], []
    solve(scans[0], *starts[0])
    for scan, truth, start in zip(scans, truths, starts, strict=True):
        before = time.process_time()
        found = solve(scan, *start)
        seconds.append(time.process_time() - before)
        errors.append(float(error_deg(truth, found)))
    right = np.array(errors) < RIGHT_DEG
    of_right = np.array(errors)[right]
    return {
        "right_share": float(right.mean()),
        "median_deg": float(np.median(errors)),
        "median_of_right_deg": float(np.median(of_right)) if len(of_right) else float("nan"),
        "95_percent_deg": float(np.quantile(errors, 0.95)),
        "median_ms": 1e3 * float(np.median(seconds)),
        "slowest_ms": 1e3 * float(np.max(seconds)),
    }


def main() -> None:
    """Run, and print."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--scans", type=int, default=40)
    parser.add_argument("--seed", type=int, default=0)
    given = parser.parse_args()
    o3d.utility.random.seed(given.seed)
    o3d.utility.set_verbosity_level(o3d.utility.VerbosityLevel.Error)
    rng = np.random.default_rng(given.seed)
    bench = Turntable(given.seed)
    mesh = bench.shape.mesh
    # Triangle soup, so that the reference is the same surface for everybody.
    corners = np.concatenate([mesh.corner, mesh.corner + mesh.edge1, mesh.corner + mesh.edge2])
    faces = np.arange(len(corners)).reshape(3, -1).T
    truths = random_rotations(given.scans, rng)
    scans = [bench.scan(truth) for truth in truths]
    turns = rot.exp(np.radians(rng.uniform(-TURN_DEG, TURN_DEG, (given.scans, 3)) / np.sqrt(3)))
    shifts = bench.position + rng.uniform(-SHIFT_M, SHIFT_M, (given.scans, 3)) / np.sqrt(3)
    starts = list(zip(turns @ truths, shifts, strict=True))
    theirs = peers(Shape(corners, faces, points=REFERENCE_POINTS))
    ours: tuple[dict[str, Solver], dict[str, Solver]] = (
        {"ours": lambda scan, _r, _p: acquire(scan, bench.shape).rotation},
        {"ours": lambda scan, r, p: track(scan, bench.shape, r, p).rotation},
    )
    out: dict[str, Any] = {
        "scans": given.scans,
        "points_median": float(np.median([np.count_nonzero(scan.returned) for scan in scans])),
        "reference_points": REFERENCE_POINTS,
    }
    for name, own, other in zip(("acquisition", "tracking"), ours, theirs, strict=True):
        out[name] = {label: measure(solve, scans, truths, starts) for label, solve in (own | other).items()}
    packages = ("numpy", "scipy", "numba", "open3d", "small_gicp")
    out["versions"] = {"python": platform.python_version()} | {name: version(name) for name in packages}
    out["machine"] = {"system": platform.platform(), "processor": platform.machine(), "cores": os.cpu_count()}
    print(json.dumps(out, indent=2))


if __name__ == "__main__":
    main()
