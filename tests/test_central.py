"""The central solver against a dense one, against each craft on its own, and its covariances against Monte Carlo."""

import numpy as np
import pytest
from convex_target import ANGLE_NOISE, RHO, angles, draw, sweep_offsets
from scipy.optimize import least_squares
from scipy.stats import chi2

from estimators import rotation as rot
from estimators.arrays import Floats
from estimators.lighthouse.central import CentralSolution, solve
from estimators.lighthouse.dop import dilution
from estimators.lighthouse.pnp import refine
from estimators.lighthouse.projection import angle_weights, projections


class Scene:
    """Craft at 1 m to 3 m, moving; `size` times the target of the paper's experiment."""

    def __init__(self, craft: int, seed: int = 0, size: float = 1.0, near_m: float = 1.0, far_m: float = 3.0) -> None:
        rng = np.random.default_rng(seed)
        d = draw(rng, craft, near_m, far_m, fewest=6)
        self.rotation, self.position, self.lit, self.point = d.rotation, d.position, d.lit, size * d.point
        self.offset = sweep_offsets(rng, craft, 12)
        self.rate, self.velocity = 0.3 * rng.standard_normal((craft, 3)), 0.2 * rng.standard_normal((craft, 3))
        self.exact = angles(self.rotation, self.position, self.point, self.offset, self.rate, self.velocity)
        self.rng = rng
        self.start = rot.exp(2e-3 * rng.standard_normal((craft, 3))) @ self.rotation
        self.start_position = self.position + 2e-3 * rng.standard_normal((craft, 3))
        self.all = np.ones(craft, dtype=np.bool_)

    def noisy(self, rho: float) -> tuple[Floats, Floats]:
        """Angles with the noise of (19), one draw per fan for the whole swarm, and that draw's errors (2,) [rad]."""
        shared = np.sqrt(rho) * ANGLE_NOISE * self.rng.standard_normal(2)
        own = np.sqrt(1 - rho) * ANGLE_NOISE * self.rng.standard_normal(self.exact.shape)
        return self.exact + shared + own, shared

    def solve(self, theta: Floats, rho: float = RHO) -> CentralSolution:
        motion = self.offset, self.rate, self.velocity
        return solve(theta, self.lit, self.point, self.start, self.start_position, *motion, rho, self.all)

    def errors(self, rotation: Floats, position: Floats) -> Floats:
        """(C, 6), true less estimated."""
        turn = rot.log(self.rotation @ np.swapaxes(rotation, 1, 2))
        return np.concatenate([turn, self.position - position], axis=1)


def dense(scene: Scene, theta: Floats, rho: float) -> tuple[Floats, Floats, Floats]:
    """The same problem as one vector of 6 C + 2 unknowns, by SciPy with numerical derivatives, in units of noise.

    Returns the answer as (C, 6) turns and shifts of the start, eps (2,) [rad], and the inverse of J^T J.
    """
    craft = len(scene.lit)
    uv = projections(theta)
    weight = angle_weights(uv)[scene.lit]
    independent, shared = ANGLE_NOISE * np.sqrt(1 - rho), ANGLE_NOISE * np.sqrt(rho)

    def residuals(x: Floats, base: Floats = scene.start) -> Floats:
        pose, eps = x[:-2].reshape(craft, 6), x[-2:] * ANGLE_NOISE
        rotation, position = rot.exp(pose[:, :3]) @ base, scene.start_position + pose[:, 3:]
        seen = angles(rotation, position, scene.point, scene.offset, scene.rate, scene.velocity)
        f = weight * (projections(seen) - uv)[scene.lit]
        return np.concatenate([((f - eps) / independent).ravel(), eps / shared])

    best = least_squares(residuals, np.zeros(6 * craft + 2), "3-point", x_scale=1e-3, xtol=1e-14, ftol=1e-15, gtol=1e-9)
    # Derivatives by a turn of the solution, not of the start: there exp(x + dx) is exp(dx) exp(x) only to |x| = 2e-3.
    step, at = best.x[:-2].reshape(craft, 6), best.x.copy()
    at[:-2].reshape(craft, 6)[:, :3] = 0
    base = rot.exp(step[:, :3]) @ scene.start
    steps = np.diag(np.append(np.full(6 * craft, 1e-5), [1e-3, 1e-3]))
    jacobian = np.stack([(residuals(at + h, base) - residuals(at - h, base)) / (2 * h.max()) for h in steps], axis=1)
    inverse = np.linalg.inv(jacobian.T @ jacobian)
    return step, best.x[-2:] * ANGLE_NOISE, inverse


@pytest.mark.parametrize("rho", [0.3, RHO])
@pytest.mark.parametrize("craft", [1, 5])
def test_the_arrow_and_the_dense_solver_agree(craft: int, rho: float) -> None:
    scene = Scene(craft, seed=craft)
    theta, _ = scene.noisy(rho)
    ours = scene.solve(theta, rho)
    assert ours.solved.all()
    step, eps, inverse = dense(scene, theta, rho)
    sigma = ANGLE_NOISE * np.sqrt(np.diagonal(ours.covariance, axis1=1, axis2=2))
    turn = rot.log(ours.rotation @ np.swapaxes(rot.exp(step[:, :3]) @ scene.start, 1, 2))
    # Both stop where a step is 1e-7 of a radian or metre at most: a thousandth of a standard deviation.
    np.testing.assert_allclose(turn / sigma[:, :3], 0, atol=2e-3)
    np.testing.assert_allclose((ours.position - scene.start_position - step[:, 3:]) / sigma[:, 3:], 0, atol=2e-3)
    np.testing.assert_allclose(ours.rotor_error_rad / ANGLE_NOISE, eps / ANGLE_NOISE, atol=2e-3)
    for c in range(craft):
        # What Gauss-Newton leaves out, f times second derivatives, is 1e-4 of the rest; the geometry amplifies it.
        expected = inverse[6 * c : 6 * c + 6, 6 * c : 6 * c + 6]
        size = np.sqrt(np.outer(np.diag(expected), np.diag(expected)))
        np.testing.assert_allclose(ANGLE_NOISE**2 * ours.covariance[c] / size, expected / size, atol=1e-3)
    np.testing.assert_allclose(ours.rotor_covariance, inverse[-2:, -2:], atol=1e-3 * rho)


def test_without_a_shared_error_every_craft_is_on_its_own() -> None:
    scene = Scene(6, seed=3)
    theta, _ = scene.noisy(RHO)
    central = scene.solve(theta, 0.0)
    own = refine(
        theta, scene.lit, scene.point, scene.start, scene.start_position, scene.offset, scene.rate, scene.velocity
    )
    # The same minimum, each found to 1e-7.
    np.testing.assert_allclose(central.position, own.position, atol=1e-7)
    np.testing.assert_allclose(central.rotation, own.rotation, atol=1e-7)
    np.testing.assert_array_equal(central.rotor_error_rad, 0)
    np.testing.assert_allclose(central.covariance, central.covariance_rotor_known)


def test_the_gain_is_the_predicted_one() -> None:
    """Large craft nearby, where a common shift of all angles is no pose: the rotor's errors are found."""
    scene, periods = Scene(12, seed=5, size=6.0, near_m=1.5, far_m=2.0), 300
    joint, found, own = [], [], []
    for _ in range(periods):
        theta, shared = scene.noisy(RHO)
        answer = scene.solve(theta)
        assert answer.solved.all()
        joint.append(scene.errors(answer.rotation, answer.position))
        found.append(shared - answer.rotor_error_rad)
        alone = refine(
            theta, scene.lit, scene.point, scene.start, scene.start_position, scene.offset, scene.rate, scene.velocity
        )
        own.append(scene.errors(alone.rotation, alone.position))
    error, alone_error = np.array(joint) / ANGLE_NOISE, np.array(own) / ANGLE_NOISE
    # The mean over n periods of a craft's normalised squared error is chi-square with 6 n degrees of freedom over n;
    # 12 craft share a sweep, so each is held to a band of its own that all 12 leave with a chance of 1 % together.
    nees = np.einsum("nci,cij,ncj->c", error, np.linalg.inv(answer.covariance), error)
    low, high = chi2.ppf([0.005 / 12, 1 - 0.005 / 12], 6 * periods)
    assert (nees > low).all()
    assert (nees < high).all()
    rotor = np.array(found) / ANGLE_NOISE
    low, high = chi2.ppf([0.005, 0.995], 2 * periods)
    assert low < np.einsum("ni,ij,nj->", rotor, np.linalg.inv(answer.rotor_covariance), rotor) < high
    # Here most of the swarm's error was the rotor's: the central solver takes a good part off, never more than all.
    mean_square = [np.mean(np.sum(e[..., 3:] ** 2, axis=-1)) for e in (error, alone_error)]
    bound = np.mean(np.trace(answer.covariance_rotor_known[:, 3:, 3:], axis1=1, axis2=2))
    assert mean_square[0] < 0.9 * mean_square[1]
    assert mean_square[0] > bound


def test_small_craft_gain_little() -> None:
    """A common shift of all angles is, for a craft small against its distance, a change of pose: hard to tell apart."""
    scene = Scene(40, seed=6, near_m=3.0, far_m=5.0)
    theta, _ = scene.noisy(RHO)
    together = scene.solve(theta)
    assert together.solved.all()
    d = scene.rotation, scene.position, scene.lit, scene.point, scene.offset, scene.rate, scene.velocity
    own = dilution(*d, RHO, scene.all)
    gain = np.sqrt(np.trace(together.covariance[:, 3:, 3:], axis1=1, axis2=2)) / own.pdop_m_per_rad
    # PnP's plain sum of squares is within 0.1 % of a craft's own bound; beyond it, 40 craft together find under 1 %.
    assert (gain > 0.98).all()
    assert (gain < 1.001).all()
    assert (np.diag(together.rotor_covariance) < RHO).all()


def test_craft_that_cannot_be_solved_take_no_part_and_change_nobody() -> None:
    scene = Scene(5, seed=7)
    theta, _ = scene.noisy(RHO)
    scene.lit[1, np.flatnonzero(scene.lit[1])[3:]] = False
    theta[3, np.flatnonzero(scene.lit[3])[0], 0] = np.nan
    some = scene.solve(theta)
    np.testing.assert_array_equal(some.solved, [True, False, True, False, True])
    for part in (some.rotation, some.position, some.covariance):
        np.testing.assert_array_equal(np.isfinite(part).reshape(5, -1).all(axis=1), some.solved)
        np.testing.assert_array_equal(np.isfinite(part).reshape(5, -1).any(axis=1), some.solved)
    keep = some.solved
    only = solve(
        theta[keep],
        scene.lit[keep],
        scene.point[keep],
        scene.start[keep],
        scene.start_position[keep],
        scene.offset[keep],
        scene.rate[keep],
        scene.velocity[keep],
        RHO,
        scene.all[keep],
    )
    np.testing.assert_array_equal(only.position, some.position[keep])
    nobody = scene.solve(np.full_like(theta, np.nan))
    assert not nobody.solved.any()
    assert np.isnan(nobody.rotor_error_rad).all()


def test_what_is_asked_wrongly_is_named() -> None:
    scene = Scene(2, seed=8)
    with pytest.raises(ValueError, match=r"rotor_correlation is 1\.0, outside \[0, 1\)"):
        scene.solve(scene.exact, 1.0)
    with pytest.raises(ValueError, match="theta has shape"):
        scene.solve(scene.exact[:1])
