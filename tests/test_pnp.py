"""PnP against finite differences, SciPy, the Cramer-Rao bound, and everything that must not be solved."""

import numpy as np
import pytest
from convex_target import (
    ANGLE_NOISE,
    RHO,
    Draw,
    angle_errors,
    angles,
    dome,
    draw,
    random_rotation,
    sweep_offsets,
)
from scipy.optimize import least_squares

from estimators import rotation as rot
from estimators.arrays import Floats
from estimators.levenberg_marquardt import STEP_SMALL
from estimators.lighthouse.pnp import PoseSolution, refine, refine_projections
from estimators.lighthouse.projection import COLUMNS, add_curvature, gather, project, projections

RATES = (3, np.deg2rad(30.0), 0.3)


class Scene:
    """Craft of a draw that turn at 30 deg/s and move at 0.3 m/s (one sigma per axis), and their noise-free angles."""

    def __init__(self, count: int, seed: int, near_m: float = 1.0, far_m: float = 5.0) -> None:
        rng = np.random.default_rng(seed)
        self.draw: Draw = draw(rng, count, near_m, far_m)
        self.offset = sweep_offsets(rng, count, 12)
        self.angular_rate = RATES[1] * rng.standard_normal((count, 3))
        self.velocity = RATES[2] * rng.standard_normal((count, 3))
        d = self.draw
        self.theta = angles(d.rotation, d.position, d.point, self.offset, self.angular_rate, self.velocity)
        self.noise = angle_errors(rng, count, 12)
        attitude = rng.standard_normal((count, 3))
        self.start = (
            rot.exp(np.deg2rad(0.5) * attitude / np.linalg.norm(attitude, axis=-1, keepdims=True)) @ d.rotation,
            d.position + 3e-3 * rng.standard_normal((count, 3)),
        )

    def table(self, c: int) -> tuple[Floats, Floats]:
        """The angles of all photodiodes of one craft, as the kernels take them, and its position."""
        d, out = self.draw, np.empty((24, COLUMNS))
        every = np.ones(12, dtype=np.bool_)
        assert gather(every, d.point[c], self.offset[c], self.angular_rate[c], self.velocity[c], out) == 12
        return out, d.position[c]

    def solve(self, theta: Floats) -> PoseSolution:
        d = self.draw
        return refine(theta, d.lit, d.point, *self.start, self.offset, self.angular_rate, self.velocity)


def test_rows_by_finite_differences() -> None:
    scene = Scene(20, seed=1)
    d, step = scene.draw, 1e-6

    def seen(delta: Floats) -> Floats:
        moved = rot.exp(delta[:3]) @ d.rotation, d.position + delta[3:]
        return projections(angles(*moved, d.point, scene.offset, scene.angular_rate, scene.velocity))

    numeric = np.stack([(seen(step * e) - seen(-step * e)) / (2 * step) for e in np.eye(6)], axis=-1)
    for c, i, fan in np.ndindex(20, 12, 2):
        table, place = scene.table(c)
        value, z, over, *turned = project(table, 12 * fan + i, d.rotation[c], float(place[fan]), float(place[2]))
        row = over * np.array([*turned, 0.0, 0.0, -value])
        row[3 + fan] = over
        assert over == 1 / z
        assert value == pytest.approx(projections(scene.theta)[c, i, fan], abs=1e-14)
        assert z > 0
        # Central differences at h = 1e-6: rounding 1e-16 (u up to 2) / h = 2e-10, truncation h^2 / z^3 = 1e-12.
        np.testing.assert_allclose(row, numeric[c, i, fan], atol=2e-9)


def test_curvature_by_finite_differences() -> None:
    scene = Scene(5, seed=17)
    d, step = scene.draw, 1e-4
    motion = scene.offset, scene.angular_rate, scene.velocity

    def seen(delta: Floats) -> Floats:
        return projections(angles(rot.exp(delta[:3]) @ d.rotation, d.position + delta[3:], d.point, *motion))

    basis, numeric = step * np.eye(6), np.empty((5, 12, 2, 6, 6))
    for a, b in np.ndindex(6, 6):
        ahead, behind = seen(basis[a] + basis[b]), seen(-basis[a] - basis[b])
        across = seen(basis[a] - basis[b]) + seen(basis[b] - basis[a])
        numeric[..., a, b] = (ahead + behind - across) / (4 * step**2)
    for c, i, fan in np.ndindex(5, 12, 2):
        out = np.zeros((6, 6))
        table, place = scene.table(c)
        add_curvature(table, 12 * fan + i, fan, d.rotation[c], float(place[fan]), float(place[2]), 1.0, out)
        # Second differences at h = 1e-4: rounding 1e-16 (u up to 2) / h^2 = 1e-8 some times over, truncation as small.
        np.testing.assert_allclose(out, np.tril(numeric[c, i, fan]), atol=2e-7)


def test_paper_jacobian_and_its_chain_rule() -> None:
    # (8) with J_r (9) in the passive vector phi, R = exp(-[phi]x), against finite differences of (3) and (5).
    rng = np.random.default_rng(2)
    step = 1e-6
    for _ in range(50):
        phi, w_p, t = rng.uniform(-1.5, 1.5, 3), rng.uniform(-1, 1, 3), rng.uniform(-1, 1, 3)
        p = rot.matrix_from_passive_vector(phi) @ w_p + t
        ahead = rot.matrix_from_passive_vector(phi + step * np.eye(3)) @ w_p
        behind = rot.matrix_from_passive_vector(phi - step * np.eye(3)) @ w_p
        paper = rot.skew(p - t) @ rot.passive_jacobian(phi)
        # Rounding 2e-16 / h and truncation h^2: both near 1e-10.
        np.testing.assert_allclose(paper, ((ahead - behind) / (2 * step)).T, atol=2e-9)
        # The active left error is d = -J_r dphi, dp/dd = -[p - t]x: the same derivative by the chain rule.
        chain = -rot.skew(p - t) @ -rot.passive_jacobian(phi)
        np.testing.assert_array_equal(paper, chain)
        turned = rot.matrix_from_passive_vector(phi + step * np.eye(3)) @ rot.matrix_from_passive_vector(phi).T
        np.testing.assert_allclose(rot.log(turned).T / step, -rot.passive_jacobian(phi), atol=1e-5)


def test_round_trip() -> None:
    scene = Scene(500, seed=3)
    solution = scene.solve(scene.theta)
    assert solution.solved.all()
    # Angles are rounded to 2e-16; the worst geometry here (5 m, 12 cm) multiplies that by some 1e4.
    assert np.max(rot.angle_between(solution.rotation, scene.draw.rotation)) < 1e-11
    assert np.max(np.abs(solution.position - scene.draw.position)) < 1e-11
    assert np.max(solution.residual_rad) < 1e-14


def test_warm_start_needs_four_iterations_at_most() -> None:
    scene = Scene(5000, seed=4)
    solution = scene.solve(scene.theta + scene.noise)
    assert solution.solved.all()
    within_four = np.mean(solution.iterations <= 4)
    print(f"warm starts within 4 iterations: {within_four:.4f}, mean {solution.iterations.mean():.2f}")
    # Demanded is 0.95; measured is 1.0000 (mean 3.1).
    assert within_four > 0.999


@pytest.mark.parametrize(
    ("near_m", "far_m", "degrees", "metres"), [(1, 5, 0.1, 2e-3), (5, 30, 0.2, 5e-3), (2, 10, 8, 0.2)]
)
def test_what_is_left_to_go_where_the_search_ends(near_m: float, far_m: float, degrees: float, metres: float) -> None:
    # The search goes on from its own answer as long as steps are longer than rounding makes them: six more searches.
    scene, rng = Scene(4000, 21, near_m, far_m), np.random.default_rng(22)
    d, theta = scene.draw, scene.theta + scene.noise
    scene.start = (
        rot.exp(np.deg2rad(degrees) * rng.standard_normal((4000, 3))) @ d.rotation,
        d.position + metres * rng.standard_normal((4000, 3)),
    )
    found = scene.solve(theta)
    scene.start = np.nan_to_num(found.rotation), np.nan_to_num(found.position)
    for _ in range(6):
        end = scene.solve(theta)
        scene.start = np.nan_to_num(end.rotation), np.nan_to_num(end.position)
    left = np.linalg.norm(found.position - end.position, axis=1), rot.angle_between(found.rotation, end.rotation)
    most = [float(np.nanmax(part)) for part in left]
    print(f"{near_m} m to {far_m} m: {found.iterations.mean():.2f} solves, left {most[0]:.1e} m, {most[1]:.1e} rad")
    assert found.solved.mean() > 0.998
    assert max(most) < STEP_SMALL


def test_against_scipy_least_squares() -> None:
    scene = Scene(40, seed=5)
    d, theta = scene.draw, scene.theta + scene.noise
    solution = scene.solve(theta)
    for c in range(40):
        lit, start = d.lit[c], scene.start
        point, offset, measured = d.point[c, lit][None], scene.offset[c, lit][None], projections(theta[c, lit])
        weight = np.sin(theta[c, lit]) ** 2
        motion = scene.angular_rate[c][None], scene.velocity[c][None]

        def residual(
            x: Floats, c: int = c, fixed: tuple[Floats, ...] = (point, offset, *motion, measured, weight)
        ) -> Floats:
            pose = rot.exp(x[None, :3]) @ scene.start[0][c], x[None, 3:]
            return np.asarray(fixed[5] * (projections(angles(*pose, *fixed[:4]))[0] - fixed[4])).ravel()

        tight = {"xtol": 1e-15, "ftol": 1e-15, "gtol": 1e-15}
        theirs = least_squares(residual, np.r_[0, 0, 0, start[1][c]], method="lm", x_scale="jac", **tight)
        # SciPy's Jacobian is a forward difference (1e-8), so its minimum is where J^T f is that noise: 1e-8 of 1e-4
        # (residuals), times a geometry gain of up to 1e4.
        turned = rot.exp(theirs.x[:3]) @ start[0][c]
        assert rot.angle_between(turned, solution.rotation[c]) < 1e-7
        assert np.max(np.abs(theirs.x[3:] - solution.position[c])) < 1e-7


def test_reported_cost_is_the_angle_residuals() -> None:
    scene = Scene(50, seed=6)
    d, theta = scene.draw, scene.theta + scene.noise
    solution = scene.solve(theta)
    motion = scene.offset, scene.angular_rate, scene.velocity
    error = np.where(d.lit[..., None], angles(solution.rotation, solution.position, d.point, *motion) - theta, 0.0)
    cost = np.sum(error**2, axis=(1, 2))
    # W f is the angle residual to first order: the next is the residual itself, some 5e-5, times cot theta < 1.8.
    np.testing.assert_allclose(solution.cost, cost, rtol=2e-4)
    np.testing.assert_allclose(solution.residual_rad, np.sqrt(cost / (2 * d.lit.sum(axis=1))), rtol=1e-4)


def cramer_rao(scene: Scene, craft: int) -> Floats:
    """(J^T R_theta^-1 J)^-1 (6, 6) of unit angle noise, R_theta (19) in full; rows by finite differences of (2)."""
    d, step = scene.draw, 1e-6
    lit, motion = d.lit[craft], (scene.angular_rate[craft][None], scene.velocity[craft][None])

    def seen(delta: Floats) -> Floats:
        pose = rot.exp(delta[None, :3]) @ d.rotation[craft], d.position[craft][None] + delta[3:]
        return np.asarray(
            angles(*pose, d.point[craft, lit][None], scene.offset[craft, lit][None], *motion)[0].T.reshape(-1)
        )

    jacobian = np.stack([(seen(step * e) - seen(-step * e)) / (2 * step) for e in np.eye(6)], axis=-1)
    n = int(lit.sum())
    correlation = np.kron(np.eye(2), RHO * np.ones((n, n)) + (1 - RHO) * np.eye(n))
    return np.asarray(np.linalg.inv(jacobian.T @ np.linalg.inv(correlation) @ jacobian))


def precision(scene: Scene, craft: int, samples: int, weighted: bool) -> Floats:
    """RMS of the solved attitude and position errors of one craft, over the Cramer-Rao bound's."""
    d, rng = scene.draw, np.random.default_rng(craft)

    def many(array: Floats) -> Floats:
        return np.broadcast_to(array[craft], (samples, *array.shape[1:]))

    theta = scene.theta[craft] + angle_errors(rng, samples, 12)
    motion = many(scene.offset), many(scene.angular_rate), many(scene.velocity)
    weight = np.sin(theta) ** 2 if weighted else np.ones_like(theta)
    lit = np.broadcast_to(d.lit[craft], (samples, 12))
    pose = many(d.rotation), many(d.position)
    solution = refine_projections(projections(theta), weight, lit, many(d.point), *pose, *motion)
    assert solution.solved.all()
    attitude, position = rot.log(solution.rotation @ d.rotation[craft].T), solution.position - d.position[craft]
    bound = ANGLE_NOISE**2 * cramer_rao(scene, craft)
    square = [np.mean(np.sum(error**2, axis=-1)) for error in (attitude, position)]
    return np.asarray(np.sqrt(np.array(square) / [np.trace(bound[:3, :3]), np.trace(bound[3:, 3:])]))


def test_static_precision_is_the_cramer_rao_bound() -> None:
    # Anywhere in the field. RMS over N samples of a vector error has a relative deviation of at most 1 / sqrt(2 N)
    # (when one direction dominates): 0.35 % for N = 40 000, so 2 % is more than five deviations.
    scene = Scene(8, seed=7, far_m=3.0)
    ratio = np.array([precision(scene, c, 40_000, weighted=True) for c in range(8)])
    print("RMS over Cramer-Rao bound, attitude and position:", ratio.round(4).tolist())
    assert np.max(np.abs(ratio - 1)) < 0.02


def test_source_1_cost_without_weights_loses_precision_off_boresight() -> None:
    # Why (7) is weighted by (13) here. The same deviation, 0.35 %.
    scene = Scene(8, seed=7, far_m=3.0)
    ratio = np.array([precision(scene, c, 40_000, weighted=False) for c in range(8)])
    print("the same with the plain cotangent residuals of (7):", ratio.round(4).tolist())
    assert np.max(ratio) > 1.05


def test_motion_at_two_instants_biases_a_static_solver() -> None:
    # Source 1's unnamed cause: 0.3 m/s over T/2 is 2.5 mm between the fans. Compensated, the bias is gone.
    scene = Scene(200, seed=9)
    d, still = scene.draw, np.zeros((200, 3))
    static = refine(scene.theta, d.lit, d.point, *scene.start, scene.offset, still, still)
    assert np.median(np.linalg.norm(static.position - d.position, axis=-1)) > 1e-3
    assert np.max(np.linalg.norm(scene.solve(scene.theta).position - d.position, axis=-1)) < 1e-10


def test_pinhole_camera() -> None:
    # The same solver with u = x/f: one instant for the whole image.
    rng = np.random.default_rng(10)
    rotation, focal_mm = random_rotation(rng, 30), 16.0
    position, point = np.tile([0.2, -0.1, 2.0], (30, 1)), np.tile(dome()[0], (30, 1, 1))
    p = np.einsum("cij,ckj->cki", rotation, point) + position[:, None]
    image_mm = focal_mm * p[..., :2] / p[..., 2:]
    start = rot.exp(np.full((30, 3), 0.02)) @ rotation, position + 0.01
    still = np.zeros((30, 12, 2)), np.zeros((30, 3)), np.zeros((30, 3))
    solution = refine_projections(
        image_mm / focal_mm, np.ones((30, 12, 2)), np.ones((30, 12), dtype=np.bool_), point, *start, *still
    )
    assert solution.solved.all()
    assert np.max(rot.angle_between(solution.rotation, rotation)) < 1e-11


def test_a_batch_is_its_craft_alone_bit_for_bit() -> None:
    scene = Scene(30, seed=11)
    d, theta = scene.draw, scene.theta + scene.noise
    together = scene.solve(theta)
    start = scene.start[0].copy(), scene.start[1].copy()
    for c in range(30):
        one = slice(c, c + 1)
        motion = scene.offset[one], scene.angular_rate[one], scene.velocity[one]
        alone = refine(theta[one], d.lit[one], d.point[one], start[0][one], start[1][one], *motion)
        for a, b in zip(alone, together, strict=True):
            np.testing.assert_array_equal(a, b[one])
    np.testing.assert_array_equal(start[0], scene.start[0])
    np.testing.assert_array_equal(start[1], scene.start[1])


def test_a_wild_start_is_damped_or_refused() -> None:
    # 25 deg and 20 % of range off: undamped steps overshoot. What is solved must be a minimum with the truth's residual
    # or another one, never a pose behind the lighthouse; most find the truth.
    scene = Scene(1000, seed=12)
    d = scene.draw
    axis = np.random.default_rng(13).standard_normal((1000, 3))
    axis /= np.linalg.norm(axis, axis=-1, keepdims=True)
    start = rot.exp(np.deg2rad(25) * axis) @ d.rotation, 1.2 * d.position
    solution = refine(scene.theta, d.lit, d.point, *start, scene.offset, scene.angular_rate, scene.velocity)
    right = solution.solved & (rot.angle_between(np.nan_to_num(solution.rotation), d.rotation) < 1e-9)
    print(f"wild starts: solved {solution.solved.mean():.3f}, right {right.mean():.3f}")
    assert right.mean() > 0.99
    assert (solution.position[solution.solved, 2] > 0).all()


def test_a_plane_that_faces_the_lighthouse_converges() -> None:
    # Its two mirror minima meet there, and the angles change with the tilt to second order only.
    rng, count = np.random.default_rng(18), 2000
    point = np.tile(0.0625 * np.array([[1.0, 1, 0], [-1, 1, 0], [-1, -1, 0], [1, -1, 0]]), (count, 1, 1))
    rotation = rot.exp(np.deg2rad(3) * rng.standard_normal((count, 3))) @ np.diag([1.0, -1.0, -1.0])
    position = np.tile([0.1, 0.2, 3.0], (count, 1))
    still = np.zeros((count, 4, 2)), np.zeros((count, 3)), np.zeros((count, 3))
    theta = angles(rotation, position, point, *still) + angle_errors(rng, count, 4)
    solution = refine(theta, np.ones((count, 4), dtype=np.bool_), point, rotation, position, *still)
    print(f"facing plane: solved {solution.solved.mean():.4f}, 99 % within {np.quantile(solution.iterations, 0.99)}")
    # Measured: all, 99 % within 8 iterations. With Gauss-Newton alone 7 of the 2000 need more than 30.
    assert solution.solved.all()
    assert np.quantile(solution.iterations, 0.99) <= 10


def test_what_cannot_be_solved_says_so() -> None:
    scene = Scene(8, seed=14)
    d = scene.draw
    theta, lit, point = scene.theta.copy(), d.lit.copy(), d.point.copy()
    rotation, position = scene.start[0].copy(), scene.start[1].copy()
    lit[0, np.nonzero(lit[0])[0][3:]] = False
    theta[1, np.nonzero(lit[1])[0][2], 1] = np.nan
    position[2] = -position[2]
    point[3] = np.linspace(-0.05, 0.05, 12)[:, None] * np.array([0.6, 0.0, 0.8])
    theta[4, np.nonzero(lit[4])[0][0], 0] = 4.0
    position[5] = np.nan
    lit[6] = False
    motion = scene.offset, scene.angular_rate, scene.velocity
    # Craft 3's angles are those of its collinear photodiodes, so that only their geometry is at fault.
    theta[3] = angles(d.rotation[3:4], d.position[3:4], point[3:4], *(m[3:4] for m in motion))[0]
    solution = refine(theta, lit, point, rotation, position, *motion)
    np.testing.assert_array_equal(solution.solved, [False] * 7 + [True])
    for field in (solution.rotation, solution.position, solution.residual_rad, solution.cost):
        assert np.isnan(field[:7]).all()
        assert np.isfinite(field[7]).all()
    np.testing.assert_array_equal(solution.iterations[[0, 1, 2, 3, 4, 5, 6]], 0)


def test_collinear_photodiodes_at_every_distance() -> None:
    # Far away the normal matrix is so ill-conditioned that rounding hides its missing rank: the geometry must decide.
    rng = np.random.default_rng(15)
    count = 200
    line = np.linspace(-0.06, 0.06, 6)[:, None] * rng.standard_normal((count, 1, 3)) + rng.standard_normal(
        (count, 1, 3)
    )
    rotation, still = random_rotation(rng, count), (np.zeros((count, 6, 2)), np.zeros((count, 3)), np.zeros((count, 3)))
    position = np.column_stack([np.zeros(count), np.zeros(count), np.geomspace(5, 50, count)])
    theta = angles(rotation, position, line, *still)
    lit = np.ones((count, 6), dtype=np.bool_)
    assert not refine(theta, lit, line, rotation, position + 1e-3, *still).solved.any()


def test_angles_of_dark_photodiodes_do_not_matter() -> None:
    scene = Scene(20, seed=16)
    dark = np.where(scene.draw.lit[..., None], scene.theta, np.nan)
    for a, b in zip(scene.solve(dark), scene.solve(scene.theta), strict=True):
        np.testing.assert_array_equal(a, b)


def test_no_craft() -> None:
    none = np.zeros((0, 5, 3))
    solution = refine(
        none[..., :2], none[..., 0] > 0, none, np.zeros((0, 3, 3)), none[:, 0], none[..., :2], none[:, 0], none[:, 0]
    )
    assert solution.position.shape == (0, 3)


@pytest.mark.parametrize(
    "argument", ["theta", "lit", "point_m", "rotation", "position", "offset_s", "angular_rate", "velocity"]
)
def test_wrong_shapes_name_the_argument(argument: str) -> None:
    shapes = {"theta": (2, 5, 2), "lit": (2, 5), "point_m": (2, 5, 3), "rotation": (2, 3, 3), "position": (2, 3)}
    shapes |= {"offset_s": (2, 5, 2), "angular_rate": (2, 3), "velocity": (2, 3)}
    shapes[argument] = (*shapes[argument], 1)
    with pytest.raises(ValueError, match=argument):
        refine(**{name: np.ones(shape) for name, shape in shapes.items()})  # type: ignore[arg-type]
