"""Two cameras: triangulation, attitude and pose against other solutions of the same problem, and what has no pose."""

import numpy as np
import pytest
from scipy.optimize import least_squares

from estimators import rotation as rot
from estimators.stereo.cameras import first_pose, refine_cameras
from estimators.stereo.closed_form import Reason, stereo_pose
from estimators.stereo.precision import plane_point
from estimators.stereo.triangulation import Rig, toed_in, triangulate
from estimators.stereo.vector_attitude import attitude_into, minimum_norm
from swarm.studies.papers import stereo
from swarm.studies.papers.stereo import MARKER_M, errors, images

RIG = toed_in(0.3, np.deg2rad(2.0))
FLAT_M = MARKER_M * [1, 1, 0]
NOISE = 1.2e-5
"""1/3 um at 28 mm."""


@pytest.fixture
def rng():
    return np.random.default_rng(4)


@pytest.fixture
def poses(rng):
    return stereo.random_poses(np.linspace(0, 30, 61), rng)


def noisy(uv, rng, noise=NOISE):
    return uv + noise * rng.standard_normal(uv.shape)


def seen(uv):
    return np.ones(uv.shape[:-1], dtype=bool)


def by_least_squares(uv1, uv2, rig):
    """(7) as source 2 writes it: A r1 = B, with the focal length as the unit."""
    c = rig.rotation
    a = np.array([[1, 0, -uv1[0]], [0, 1, -uv1[1]], c[:, 0] - uv2[0] * c[:, 2], c[:, 1] - uv2[1] * c[:, 2]])
    b = np.array([0, 0, *(a[2:] @ rig.origin_m)])
    return np.linalg.lstsq(a, b, rcond=None)[0]


def test_triangulation_is_the_least_squares_solution_of_7(poses, rng):
    """Noise that leaves a residual; lstsq loses the condition number of A, 200, times 1e-16 of 30 m."""
    uv = noisy(images(poses, MARKER_M, RIG), rng, 1e-4)
    point = triangulate(uv[:, 0], uv[:, 1], RIG).point_m
    for n, k in rng.integers([61, 5], size=(40, 2)):
        assert point[n, k] == pytest.approx(by_least_squares(uv[n, 0, k], uv[n, 1, k], RIG), abs=1e-10)


def test_triangulation_covariance_is_its_derivative(poses, rng):
    uv = images(poses, MARKER_M, RIG)[7:9]
    h, slope = 1e-6, []
    for camera, axis in ((0, 0), (0, 1), (1, 0), (1, 1)):
        step = np.zeros((2, 1, 2))
        step[camera, 0, axis] = h
        shifted = [uv + s * step for s in (1, -1)]
        moved = [triangulate(images[:, 0], images[:, 1], RIG).point_m for images in shifted]
        slope.append((moved[0] - moved[1]) / (2 * h))
    slopes = np.stack(slope, axis=-1)
    said = triangulate(uv[:, 0], uv[:, 1], RIG).covariance
    # Differences: h^2 times third derivatives (some 1e-8), and rounding of 1e-14 m over h.
    assert said == pytest.approx(slopes @ np.swapaxes(slopes, -1, -2), rel=1e-6, abs=1e-6)


def test_any_rig_triangulates(rng):
    """Cameras turned about all axes, the second one ahead of and above the first."""
    rig = Rig(rot.exp(np.array([0.2, -0.3, 0.5])), np.array([0.4, -0.3, 0.2]))
    r1 = rng.uniform([-1, -1, 4], [1, 1, 9], (50, 3))
    r2 = (r1 - rig.origin_m) @ rig.rotation
    assert triangulate(r1[:, :2] / r1[:, 2:], r2[:, :2] / r2[:, 2:], rig).point_m == pytest.approx(r1, abs=1e-12)


def test_17_equals_7_for_the_stated_angles_and_for_no_others(poses):
    """tan theta_1 = x1/f towards camera 2, tan theta_2 = -x2/f towards camera 1."""
    uv = images(poses, MARKER_M, RIG)
    point = triangulate(uv[:, 0], uv[:, 1], RIG).point_m
    assert plane_point(uv[:, 0], uv[:, 1, :, 0], 0.3, np.deg2rad(2.0)).point_m == pytest.approx(point, abs=1e-12)
    for first, second in ((1, -1), (-1, 1), (-1, -1)):
        other = plane_point(uv[:, 0] * [first, 1], second * uv[:, 1, :, 0], 0.3, np.deg2rad(2.0)).point_m
        wrong = np.abs(other - point).max(axis=-1) > 0.01
        assert np.all(wrong | np.isnan(other).any(axis=-1))


def test_partial_derivatives_20_to_22(poses):
    uv = images(poses, MARKER_M, RIG)[:, :, :3]
    u2, toed, h = uv[:, 1, :, 0], (0.3, np.deg2rad(2.0)), 1e-6
    found = plane_point(uv[:, 0], u2, *toed)
    steps = (([h, 0], 0.0), ([0, h], 0.0), ([0, 0], h))
    for i, (first, second) in enumerate(steps):
        up, down = (plane_point(uv[:, 0] + s * np.array(first), u2 + s * second, *toed).point_m for s in (1, -1))
        scale = np.abs(found.slope).max(axis=(-1, -2))[..., None]
        assert np.all(np.abs((up - down) / (2 * h) - found.slope[..., i]) < 1e-6 * scale)
    # Y by (19) is worse than by (7), which uses both y; X and Z are the same.
    sigma = np.sqrt(np.diagonal(triangulate(uv[:, 0], uv[:, 1], RIG).covariance, axis1=-1, axis2=-2))
    ratio = sigma / found.sigma_m(1.0)
    assert np.all((ratio[..., 1] > 0.7) & (ratio[..., 1] <= 1 + 1e-9))
    assert ratio[..., [0, 2]] == pytest.approx(1, abs=1e-4)


def kabsch(u, v):
    """The rotation of least |U - C V| by SVD."""
    w, _, z = np.linalg.svd(u @ v.T)
    return w @ np.diag([1, 1, np.linalg.det(w @ z)]) @ z


@pytest.mark.parametrize("kind", ["space", "plane", "half turn"])
def test_attitude_is_the_polar_factor_of_u_vt(kind, rng):
    for _ in range(50):
        v = rng.standard_normal((3, 5)) * [[1], [0.4], [0.0 if kind == "plane" else 0.2]]
        angle = np.pi if kind == "half turn" else rng.uniform(0, 3)
        axis = rng.standard_normal(3)
        u = rot.exp(angle * axis / np.linalg.norm(axis)) @ v + 0.05 * rng.standard_normal((3, 5))
        found = np.empty((3, 3))
        assert attitude_into(u @ v.T, found)
        assert found == pytest.approx(kabsch(u, v), abs=1e-12)
        assert np.linalg.det(found) == pytest.approx(1, abs=1e-14)


def test_the_planes_normal_as_another_vector_changes_nothing(rng):
    """Source 2's third case: the normal of the plane joins U and V; the solution is the one without."""
    v = rng.standard_normal((3, 4)) * [[1], [0.5], [0]]
    u = rot.exp(np.array([0.3, -0.8, 1.1])) @ v + 0.03 * rng.standard_normal((3, 4))
    w = np.linalg.svd(u @ v.T)[0]
    bare, joined = np.empty((3, 3)), np.empty((3, 3))
    attitude_into(u @ v.T, bare)
    normal = w[:, 2] * np.sign(w[:, 2] @ bare[:, 2])
    attitude_into(u @ v.T + np.outer(normal, [0, 0, 1]), joined)
    assert joined == pytest.approx(bare, abs=1e-13)


def test_orthogonalising_the_minimum_norm_solution_is_not_the_smallest_correction(rng):
    v = rng.standard_normal((3, 5)) * [[1], [1], [0.1]]
    turn = rot.exp(np.array([0.5, 0.2, -0.4]))
    assert minimum_norm(turn @ v, v) == pytest.approx(turn, abs=1e-12)
    u = turn @ v + 0.05 * rng.standard_normal((3, 5))
    w, _, z = np.linalg.svd(minimum_norm(u, v))
    best = np.empty((3, 3))
    attitude_into(u @ v.T, best)
    assert np.linalg.norm(u - best @ v) < 0.98 * np.linalg.norm(u - w @ z @ v)
    with pytest.raises(ValueError, match="in one plane"):
        minimum_norm(u, v * [[1], [1], [0]])


@pytest.mark.parametrize("marker", [MARKER_M, FLAT_M, MARKER_M[:3]], ids=["five", "coplanar", "three"])
def test_exact_images_give_the_exact_pose(marker, rng):
    """Source 2, figure 3, at 1/16 of its poses: below 1e-12 m and 1e-10 deg up to 30 m."""
    poses = stereo.draw_poses(32, rng)
    uv = images(poses, marker, RIG)
    solved = stereo_pose(uv, seen(uv), marker, RIG)
    assert np.all(solved.reason == Reason.SOLVED)
    error = errors(poses, solved.rotation, solved.position)
    assert np.linalg.norm(error[:, 3:], axis=1).max() < 1e-12
    if len(marker) == 5:
        assert np.rad2deg(np.linalg.norm(error[:, :3], axis=1).max()) < 1e-10


def test_the_pose_is_the_rigid_transform_of_the_triangulated_lights(poses, rng):
    uv = noisy(images(poses, MARKER_M, RIG), rng)
    solved = stereo_pose(uv, seen(uv), MARKER_M, RIG)
    lights = triangulate(uv[:, 0], uv[:, 1], RIG).point_m
    v = MARKER_M - MARKER_M.mean(axis=0)
    for n in range(0, 61, 6):
        c = kabsch((lights[n] - lights[n].mean(axis=0)).T, v.T)
        assert solved.rotation[n] == pytest.approx(c, abs=1e-10)
        assert solved.position[n] == pytest.approx(lights[n].mean(axis=0) - c @ MARKER_M.mean(axis=0), abs=1e-10)


def test_covariance_is_that_of_the_solution(rng):
    """6000 draws at 12 m: each standard deviation to 0.9 % (1 sigma), the mean NEES of 6 to 0.045; 4 sigma each."""
    poses = stereo.random_poses(np.full(1, 12.0), rng).repeat(6000)
    uv = noisy(images(poses, MARKER_M, RIG), rng)
    solved = stereo_pose(uv, seen(uv), MARKER_M, RIG)
    exact = images(poses, MARKER_M, RIG)[:1]
    covariance = NOISE**2 * stereo_pose(exact, seen(exact), MARKER_M, RIG).covariance[0]
    error = errors(poses, solved.rotation, solved.position)
    assert error.std(axis=0) == pytest.approx(np.sqrt(np.diagonal(covariance)), rel=0.037)
    assert np.mean(np.einsum("ni,ij,nj->n", error, np.linalg.inv(covariance), error)) == pytest.approx(6, abs=0.18)


def test_a_misplaced_light_costs_the_same_at_any_distance(rng):
    """Source 2, figure 4: the closed form's error is a constant of the marker."""
    poses = stereo.draw_poses(8, rng)
    true = MARKER_M.copy()
    true[0] += [0.6e-3, 0, 0.8e-3]
    uv = images(poses, true, RIG)
    solved = stereo_pose(uv, seen(uv), MARKER_M, RIG)
    error = errors(poses, solved.rotation, solved.position)
    for part in (error[:, :3], error[:, 3:]):
        assert np.ptp(np.linalg.norm(part, axis=1)) < 1e-6 * np.linalg.norm(part[0])


def alone(uv):
    only = seen(uv)
    only[:, 1] = False
    return only


def reprojection(pose6, uv, which, marker):
    c, m = rot.exp(pose6[:3]), pose6[3:]
    r1 = marker @ c.T + m
    r2 = (r1 - RIG.origin_m) @ RIG.rotation
    said = np.stack([r1[:, :2] / r1[:, 2:], r2[:, :2] / r2[:, 2:]])
    return (said - uv)[which].ravel()


@pytest.mark.parametrize("both", [True, False])
def test_the_fit_is_the_least_squares_of_the_images(both, rng):
    """SciPy on the images as they are: camera 2's turned image has its noise as weight, but not the correlation of
    u' and v' (2 %), which moves the solution by a hundredth of its sigma."""
    poses = stereo.random_poses(np.array([1.0, 10.0, 25.0]), rng)
    uv = noisy(images(poses, MARKER_M, RIG), rng)
    which = seen(uv) if both else alone(uv)
    fit = refine_cameras(uv, which, MARKER_M, RIG, poses.rotation, poses.position)
    assert np.all(fit.reason == Reason.SOLVED)
    for n in range(3):
        start = np.concatenate([rot.log(poses.rotation[n]), poses.position[n]])
        scipy = least_squares(reprojection, start, x_scale=[1e-3] * 3 + [1e-2] * 3, args=(uv[n], which[n], MARKER_M))
        c, m = rot.exp(scipy.x[:3]), scipy.x[3:]
        off = np.concatenate([rot.log(c @ fit.pose.rotation[n].T), m - fit.pose.position[n]])
        sigma = NOISE * np.sqrt(np.diagonal(fit.dilution.covariance[n]))
        assert np.all(np.abs(off) < (0.05 if both else 0.01) * sigma)


def test_the_fits_covariance_is_the_dilution_with_the_image_jacobian(rng):
    """Mean NEES over 3000 poses, 6 +- 0.063 (1 sigma), with one camera and with two."""
    poses = stereo.random_poses(rng.uniform(0, 30, 3000), rng)
    uv = noisy(images(poses, MARKER_M, RIG), rng)
    for which in (seen(uv), alone(uv)):
        fit = refine_cameras(uv, which, MARKER_M, RIG, poses.rotation, poses.position)
        error = errors(poses, fit.pose.rotation, fit.pose.position)
        covariance = NOISE**2 * fit.dilution.covariance
        nees = np.einsum("ni,ni->n", error, np.linalg.solve(covariance, error[..., None])[..., 0])
        assert nees.mean() == pytest.approx(6, abs=0.25)


def test_two_cameras_are_better_than_one_and_the_fit_better_than_the_closed_form(poses):
    uv = images(poses, MARKER_M, RIG)
    closed = stereo_pose(uv, seen(uv), MARKER_M, RIG).covariance
    start = poses.rotation, poses.position
    both, main = (refine_cameras(uv, w, MARKER_M, RIG, *start).dilution.covariance for w in (seen(uv), alone(uv)))
    for better, worse in ((both, main), (both, closed)):
        # The difference of the covariances is positive semidefinite, but for the correlation that the fit leaves out.
        assert np.linalg.eigvalsh(worse - 0.97 * better).min() > 0


def test_a_cold_start_by_one_camera_finds_the_pose(rng):
    poses = stereo.random_poses(np.array([0.5, 5.0, 20.0]), rng)
    uv = noisy(images(poses, MARKER_M, RIG), rng)
    for n in range(3):
        found = first_pose(uv[n, 0], np.ones(5, bool), MARKER_M)
        assert np.rad2deg(rot.angle_between(found.rotation[0], poses.rotation[n])) < 1
        assert len(found.cost) == 1 or found.cost[1] - found.cost[0] > 25 * NOISE**2


ONE = np.array([[[[0.1, 0.0], [0.0, 0.1], [-0.1, 0.0], [0.0, -0.1], [0.0, 0.0]]] * 2])


def case(name, rng):
    """uv, seen, marker and the reason that is due, for the closed form and for the fit."""
    poses = stereo.random_poses(np.array([5.0]), rng)
    marker = MARKER_M.copy()
    uv, which = images(poses, marker, RIG), np.ones((1, 2, 5), bool)
    match name:
        case "collinear":
            marker = np.outer(np.linspace(-0.3, 0.3, 5), [1.0, 0.5, 0.0])
            return images(poses, marker, RIG), which, marker, Reason.COLLINEAR, Reason.COLLINEAR
        case "duplicates leave a line":
            marker[2:] = marker[0]
            return images(poses, marker, RIG), which, marker, Reason.COLLINEAR, Reason.COLLINEAR
        case "behind":
            back = poses._replace(position=-poses.position)
            return images(back, marker, RIG), which, marker, Reason.BEHIND, None
        case "other lights":
            which = np.array([[[1, 1, 1, 0, 0], [0, 0, 1, 1, 1]]], bool)
            return uv, which, marker, Reason.TOO_FEW, Reason.SOLVED
        case "nothing":
            return uv, ~which, marker, Reason.TOO_FEW, Reason.TOO_FEW
        case "NaN":
            uv[0, 1, 3, 0] = np.nan
            return uv, which, marker, Reason.NOT_FINITE, Reason.NOT_FINITE
        case "NaN in the marker":
            marker[1, 1] = np.nan
            return uv, which, marker, Reason.NOT_FINITE, Reason.NOT_FINITE
        case "infinite":
            uv[0, 0, 3, 0] = np.inf
            return uv, which, marker, Reason.NOT_FINITE, Reason.NOT_FINITE
        case "parallel rays":
            far = Rig(np.eye(3), np.array([0.3, 0, 0]))
            assert np.isnan(triangulate(ONE[:, 0], ONE[:, 1], far).point_m).all()
            return uv[:, [0, 0]], which, marker, None, None
    raise AssertionError(name)


@pytest.mark.parametrize(
    "name",
    [
        "collinear",
        "duplicates leave a line",
        "behind",
        "other lights",
        "nothing",
        "NaN",
        "NaN in the marker",
        "infinite",
        "parallel rays",
    ],
)
def test_what_has_no_pose_says_why(name, rng):
    uv, which, marker, closed_reason, fit_reason = case(name, rng)
    closed = stereo_pose(uv, which, marker, RIG)
    if closed_reason is not None:
        assert closed.reason[0] == closed_reason
    nothing = closed.reason[0] != Reason.SOLVED
    for array in (closed.rotation, closed.position, closed.covariance):
        assert np.isnan(array).all() == nothing
    start = np.eye(3)[None], np.array([[0.0, 0.0, 7.0]])
    fit = refine_cameras(uv, which, marker, RIG, *start)
    if fit_reason is not None:
        assert fit.reason[0] == fit_reason
    assert np.isnan(fit.pose.position).all() == (fit.reason[0] != Reason.SOLVED)


def test_what_is_not_seen_is_not_read(rng):
    poses = stereo.random_poses(np.array([5.0]), rng)
    uv = images(poses, MARKER_M, RIG)
    which = seen(uv)
    which[0, 0, 4] = which[0, 1, 0] = False
    uv[~which] = np.nan
    assert stereo_pose(uv, which, MARKER_M, RIG).position == pytest.approx(poses.position, abs=1e-12)
    start = poses.rotation, poses.position + 0.01
    assert refine_cameras(uv, which, MARKER_M, RIG, *start).pose.position == pytest.approx(poses.position, abs=1e-9)


def test_swapped_lights_leave_a_residual_that_gives_them_away(poses):
    """Two lights taken for each other in one camera, or in both: the images do not fit by a tenth of their distance."""
    uv = images(poses, MARKER_M, RIG)
    spacing = 0.4 / poses.position[:, 2]
    for cameras in ([0], [0, 1]):
        wrong = uv.copy()
        for camera in cameras:
            wrong[:, camera, [0, 1]] = uv[:, camera, [1, 0]]
        found = stereo_pose(wrong, seen(wrong), MARKER_M, RIG)
        assert np.all((found.reason != Reason.SOLVED) | (found.residual_rad > 0.1 * spacing))
    crossed = stereo_pose(uv[:, ::-1], seen(uv), MARKER_M, RIG)
    far = poses.position[:, 2] > 5  # where the axes cross, 4.3 m away, an image may be the other camera's
    assert np.all((crossed.reason != Reason.SOLVED) | (crossed.residual_rad > 1e-3) | ~far)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"seen": np.ones((1, 5), bool)}, "seen has shape"),
        ({"uv": np.zeros((1, 2, 4, 2))}, "uv has shape"),
        ({"point_m": np.zeros((4, 3))}, "point_m has shape"),
        ({"rig": Rig(2 * np.eye(3), np.array([0.3, 0, 0]))}, "rig.rotation is not a rotation"),
        ({"rig": Rig(np.eye(3), np.zeros(3))}, "two cameras need two places"),
    ],
)
def test_wrong_arguments_are_named(change, message):
    good = {"uv": ONE, "seen": np.ones((1, 2, 5), bool), "point_m": MARKER_M, "rig": RIG}
    with pytest.raises(ValueError, match=message):
        stereo_pose(**{**good, **change})
    with pytest.raises(ValueError, match=message):
        refine_cameras(**{**good, **change}, rotation=np.eye(3)[None], position=np.ones((1, 3)))
