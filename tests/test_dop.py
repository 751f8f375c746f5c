"""Dilution of precision against source 1's own matrices, Monte Carlo, and the solver's answer to wrong rates."""

import numpy as np
import pytest
from convex_target import ANGLE_NOISE, RHO, angle_errors, angles, draw, sweep_offsets

from estimators import rotation as rot
from estimators.arrays import Floats
from estimators.lighthouse.dop import Dilution, dilution
from estimators.lighthouse.pnp import refine

CRAFT = 30


class Scene:
    """Craft at 1 m to 4 m with 30 deg/s and 0.3 m/s (one sigma per axis)."""

    def __init__(self, seed: int = 0) -> None:
        rng = np.random.default_rng(seed)
        self.truth = draw(rng, CRAFT, 1.0, 4.0)
        self.offset = sweep_offsets(rng, CRAFT, 12)
        self.angular_rate = np.deg2rad(30) * rng.standard_normal((CRAFT, 3))
        self.velocity = 0.3 * rng.standard_normal((CRAFT, 3))
        self.all = np.ones(CRAFT, dtype=np.bool_)

    def dilution(self, rho: float = RHO) -> Dilution:
        d, motion = self.truth, (self.offset, self.angular_rate, self.velocity)
        return dilution(d.rotation, d.position, d.lit, d.point, *motion, rho, self.all)

    def theta(self, craft: int, phi: Floats, position: Floats) -> Floats:
        """The lit photodiodes' angles (2 n,), fan X first, of a passive vector phi (3,)."""
        d, lit, one = self.truth, self.truth.lit[craft], slice(craft, craft + 1)
        w, v = self.angular_rate[one], self.velocity[one]
        pose = rot.matrix_from_passive_vector(phi)[None], position[None]
        return np.asarray(angles(*pose, d.point[one, lit], self.offset[one, lit], w, v)[0].T.reshape(-1))

    def paper_jacobian(self, craft: int) -> Floats:
        """J (14) of the angles by psi = [phi; t], by central differences of (2), (3), (5)."""
        phi, t, h = rot.passive_vector(self.truth.rotation[craft]), self.truth.position[craft], 1e-6
        columns = [
            self.theta(craft, phi + h * e[:3], t + h * e[3:]) - self.theta(craft, phi - h * e[:3], t - h * e[3:])
            for e in np.eye(6)
        ]
        return np.asarray(np.stack(columns, axis=-1) / (2 * h))


def correlation(n: int, rho: float) -> Floats:
    """R_theta (2 n, 2 n) of (19) in full."""
    out: Floats = np.kron(np.eye(2), rho * np.ones((n, n)) + (1 - rho) * np.eye(n)).astype(np.float64)
    return out


@pytest.mark.parametrize("rho", [0.0, RHO, 1.0])
def test_paper_form(rho: float) -> None:
    scene = Scene()
    ours = scene.dilution(rho)
    for c in range(CRAFT):
        jacobian = scene.paper_jacobian(c)
        pseudo_inverse = np.linalg.inv(jacobian.T @ jacobian) @ jacobian.T
        h = pseudo_inverse @ correlation(int(scene.truth.lit[c].sum()), rho) @ pseudo_inverse.T
        j_r = rot.passive_jacobian(rot.passive_vector(scene.truth.rotation[c]))
        # Central differences leave 1e-10 in J; the geometry amplifies it by up to 1e4.
        adop = np.rad2deg(np.sqrt(np.trace(j_r @ h[:3, :3] @ j_r.T)))
        assert ours.adop_deg_per_rad[c] == pytest.approx(adop, rel=1e-5)
        assert ours.pdop_m_per_rad[c] == pytest.approx(np.sqrt(np.trace(h[3:, 3:])), rel=1e-5)
        # The active error is d = -J_r dphi: the cross block changes its sign, the attitude block does not.
        to_error = np.block([[-j_r, np.zeros((3, 3))], [np.zeros((3, 3)), np.eye(3)]])
        expected = to_error @ h @ to_error.T
        size = np.sqrt(np.outer(np.diag(expected), np.diag(expected)))
        np.testing.assert_allclose(ours.covariance[c] / size, expected / size, atol=1e-5)


def test_monte_carlo_static_precision() -> None:
    # (24): s_rot = ADOP s, s_trans = PDOP s. An RMS over N = 40 000 deviates by at most 1 / sqrt(2 N) = 0.35 %.
    scene, samples = Scene(1), 40_000
    d, predicted = scene.truth, scene.dilution()
    rng = np.random.default_rng(2)
    for c in range(3):

        def many(array: Floats, c: int = c) -> Floats:
            return np.broadcast_to(array[c], (samples, *array.shape[1:]))

        motion = many(scene.offset), many(scene.angular_rate), many(scene.velocity)
        exact = angles(*(a[c : c + 1] for a in (d.rotation, d.position, d.point)), *(m[:1] for m in motion))
        theta = exact + angle_errors(rng, samples, 12)
        lit = np.broadcast_to(d.lit[c], (samples, 12))
        solution = refine(theta, lit, many(d.point), many(d.rotation), many(d.position), *motion)
        # R_true = Exp(d) R_est, p_true = p_est + dp.
        error = np.hstack(
            [rot.log(d.rotation[c] @ np.swapaxes(solution.rotation, -1, -2)), d.position[c] - solution.position]
        )
        s_rot = np.rad2deg(np.sqrt(np.mean(np.sum(error[:, :3] ** 2, axis=-1))))
        s_trans = np.sqrt(np.mean(np.sum(error[:, 3:] ** 2, axis=-1)))
        assert s_rot == pytest.approx(predicted.adop_deg_per_rad[c] * ANGLE_NOISE, rel=0.02)
        assert s_trans == pytest.approx(predicted.pdop_m_per_rad[c] * ANGLE_NOISE, rel=0.02)
        # The whole matrix, cross terms and their signs included: whitened, the sample covariance is I within five
        # deviations of its diagonal, 5 sqrt(2 / N) = 0.035.
        white = np.linalg.solve(np.linalg.cholesky(predicted.covariance[c]), error.T) / ANGLE_NOISE
        np.testing.assert_allclose(white @ white.T / samples, np.eye(6), atol=0.035)


def test_rate_coupling_is_the_solver_fed_wrong_rates() -> None:
    scene = Scene(3)
    d, coupling = scene.truth, scene.dilution().rate_coupling
    motion = scene.offset, scene.angular_rate, scene.velocity
    theta = angles(d.rotation, d.position, d.point, *motion)
    step = 1e-3
    for k in range(6):
        wrong = step * np.eye(6)[k]
        shifted = [
            refine(
                theta,
                d.lit,
                d.point,
                d.rotation,
                d.position,
                motion[0],
                motion[1] - s * wrong[:3],
                motion[2] - s * wrong[3:],
            )
            for s in (1, -1)
        ]
        attitude = rot.log(shifted[0].rotation @ np.swapaxes(shifted[1].rotation, -1, -2)) / (2 * step)
        position = (shifted[0].position - shifted[1].position) / (2 * step)
        error = np.hstack([attitude, position]) - coupling[:, :, k]
        # First order in w tau: B takes d/dw Exp(w tau) at w = 0, and |w| tau is up to 0.02 here.
        assert np.max(np.abs(error[:, :3])) < 0.02 * np.max(np.abs(coupling[:, :3]))
        assert np.max(np.abs(error[:, 3:])) < 0.02 * np.max(np.abs(coupling[:, 3:]))


def test_common_instant_couples_as_pure_motion() -> None:
    # All angles at one instant tau after the epoch: the solver sees the pose there, so B = tau I exactly.
    scene = Scene(4)
    scene.offset = np.full_like(scene.offset, 4e-3)
    still = np.zeros((CRAFT, 3))
    scene.angular_rate, scene.velocity = still, still
    # (J^T J)^-1 J^T J is I within 1e-16 times the condition, up to 1e9 here.
    np.testing.assert_allclose(scene.dilution().rate_coupling, np.tile(4e-3 * np.eye(6), (CRAFT, 1, 1)), atol=1e-8)


def test_not_computed_is_nan() -> None:
    scene = Scene(5)
    d, rotation, position, lit = (
        scene.truth,
        scene.truth.rotation.copy(),
        scene.truth.position.copy(),
        scene.truth.lit.copy(),
    )
    point = d.point.copy()
    mask = scene.all.copy()
    mask[0] = False
    lit[1, np.nonzero(lit[1])[0][2:]] = False
    position[2, 2] = -1.0
    rotation[3] = np.nan
    point[4] = np.linspace(-0.05, 0.05, 12)[:, None] * np.array([0.6, 0.0, 0.8])
    lit[5] = False
    out = dilution(rotation, position, lit, point, scene.offset, scene.angular_rate, scene.velocity, RHO, mask)
    for field in out:
        assert np.isnan(field[:6]).all()
        assert np.isfinite(field[6:]).all()
    for mine, whole in zip(out, scene.dilution(), strict=True):
        np.testing.assert_array_equal(mine[6:], whole[6:])


@pytest.mark.parametrize(
    "argument", ["rotation", "position", "lit", "point_m", "offset_s", "angular_rate", "velocity", "mask"]
)
def test_wrong_shapes_name_the_argument(argument: str) -> None:
    shapes = {"rotation": (2, 3, 3), "position": (2, 3), "lit": (2, 5), "point_m": (2, 5, 3), "offset_s": (2, 5, 2)}
    shapes |= {"angular_rate": (2, 3), "velocity": (2, 3), "mask": (2,)}
    shapes[argument] = (*shapes[argument], 1)
    arrays = {name: np.ones(shape) for name, shape in shapes.items()}
    with pytest.raises(ValueError, match=argument):
        dilution(rotor_correlation=0.5, **arrays)  # type: ignore[arg-type]


def test_impossible_correlation() -> None:
    scene = Scene()
    with pytest.raises(ValueError, match=r"rotor_correlation is 1\.5"):
        scene.dilution(1.5)
