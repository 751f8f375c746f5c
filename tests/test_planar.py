"""Light in one plane: rows against first order and against draws, the spread of a face-on start, and who says what."""

import numpy as np
import pytest
from convex_target import ANGLE_NOISE, RHO, angle_errors, angles

from estimators.arrays import Floats
from estimators.frame import WORLD, Frame
from estimators.lighthouse.dop import dilution
from estimators.lighthouse.integrity import AngleNoise, Sweeps
from estimators.lighthouse.planar import Side, bends, is_flat, pose_rows, spread
from estimators.lighthouse.pnp import refine
from estimators.rotation import exp, log
from swarm.flight import builders
from swarm.flight.flight import Flight
from swarm.onboard.acquisition import DECISIVE, Sighting, search
from swarm.report.findings import warnings
from swarm.scenario import load

NOISE = AngleNoise(ANGLE_NOISE * np.sqrt(1 - RHO), ANGLE_NOISE * np.sqrt(RHO))
POINT = np.array([[55.0, 55, 5], [-55, 55, 5], [-55, -55, 5], [55, -55, 5], [55, 10, 5], [-20, 55, 5]]) / 1000
POSITION = np.array([0.3, -0.4, 3.0])


def facing(tilt_deg: float, around_deg: float = 30.0) -> Floats:
    """Attitude of a plate at POSITION, turned away from face-on."""
    ray = POSITION / np.linalg.norm(POSITION)
    axis = np.cross([0.0, 0, 1], ray)
    turn = exp(axis / np.linalg.norm(axis) * np.arccos(ray[2])) @ exp(np.array([0.0, np.pi, 0]))
    around = np.radians(around_deg)
    out: Floats = turn @ exp(np.radians(tilt_deg) * np.array([np.cos(around), np.sin(around), 0.0]))
    return out


def sweeps(theta: Floats) -> Sweeps:
    """One period of C plates that are at rest."""
    count = len(theta)
    lit, point = np.ones(theta.shape[:2], dtype=np.bool_), np.broadcast_to(POINT, (count, *POINT.shape))
    return Sweeps(theta, lit, point, np.zeros_like(theta), *np.zeros((2, count, 3)))


def seen(rotation: Floats, position: Floats) -> Floats:
    """Noise-free angles (C, K, 2)."""
    count = len(rotation)
    point = np.broadcast_to(POINT, (count, *POINT.shape))
    return angles(rotation, position, point, np.zeros((count, len(POINT), 2)), *np.zeros((2, count, 3)))


def test_a_plane_is_flat_and_a_dome_is_not_and_only_a_coarse_attitude_bends() -> None:
    assert is_flat(POINT)
    assert is_flat(POINT + 1e-4 * np.random.default_rng(0).normal(size=POINT.shape))
    assert not is_flat(POINT + np.array([0.0, 0.0, 0.03]) * (np.arange(6) % 2)[:, None])
    # One on a boom of a metre, or far away, makes no plane of the others' dome.
    dome = POINT + np.array([0.0, 0.0, 0.03]) * (np.arange(6) % 2)[:, None]
    for boom in ([1.0, 0, 0], [-40.0, 40, 100.5]):
        assert not is_flat(np.vstack([dome, boom]))
        assert is_flat(np.vstack([POINT, [*boom[:2], POINT[0, 2]]]))
    # 5.5 cm at 3 m, own noise 3.15 arcsec: half a sigma^2 a/d is 0.02 of the noise at 0.33 deg.
    sigma = np.radians([0.2, 0.5, np.nan])
    assert bends(sigma, np.full(3, 0.055), np.full(3, 3.0), NOISE).tolist() == [False, True, False]


def test_rows_of_a_certain_prediction_are_the_first_order_measurement() -> None:
    truth, rng = facing(10.0), np.random.default_rng(1)
    one = sweeps(seen(truth[None], POSITION[None]) + angle_errors(rng, 1, 6))
    rows = pose_rows(one, np.ones(1, bool), truth[None], POSITION[None], np.eye(6)[None] * 1e-12, NOISE)
    motion = one.offset_s, one.angular_rate, one.velocity
    h = dilution(truth[None], POSITION[None], one.lit, one.point_m, *motion, RHO, np.ones(1, bool)).covariance[0]
    information = rows.pose[0].T @ rows.pose[0]
    # A turn of the fan shifts its angles alike, so the rotor's part costs (18) nothing; the weights of PnP are those of
    # the measured angles, 1e-4 off.
    np.testing.assert_allclose(np.linalg.eigvals(information @ h * ANGLE_NOISE**2).real, 1.0, atol=1e-3)
    solved = refine(*one[:3], truth[None], POSITION[None], *motion)
    error = np.concatenate([log(solved.rotation[0] @ truth.T), solved.position[0] - POSITION])
    # What the rows say of the error of the prediction is what PnP says, within the second order of its step.
    off = np.linalg.solve(information, rows.pose[0].T @ rows.y[0]) - error
    assert off @ information @ off < 0.5


@pytest.mark.parametrize("tilt_deg", [0.0, 3.0])
def test_rows_allow_for_the_second_order_of_an_uncertain_prediction(tilt_deg: float) -> None:
    """With errors of the prediction drawn from its covariance, y - H d has mean zero and no more than unit variance."""
    rng, count = np.random.default_rng(2), 300
    predicted = facing(tilt_deg)
    covariance = np.diag(np.square([*np.radians([2.0, 2.0, 0.2]), 1e-4, 1e-4, 1e-3]))
    error = rng.multivariate_normal(np.zeros(6), covariance, size=count)
    truth = exp(error[:, :3]) @ predicted, POSITION + error[:, 3:]
    many = sweeps(seen(*truth) + angle_errors(rng, count, 6))
    pose = np.broadcast_to(predicted, (count, 3, 3)), np.broadcast_to(POSITION, (count, 3))
    mask, wide = np.ones(count, bool), np.broadcast_to(covariance, (count, 6, 6))
    rows = pose_rows(many, mask, *pose, wide, NOISE)
    left = rows.y - (rows.pose @ error[..., None])[..., 0]
    # Mean square 6 of unit variances; of 300 draws, with the heavy tail of a square of squares, within a quarter.
    assert np.sum(left**2, axis=1).mean() == pytest.approx(6.0, rel=0.25)
    assert np.abs(left.mean(axis=0)).max() < 5 / np.sqrt(count)
    # Without the second order it is not: what the test is there for.
    flat = pose_rows(many, mask, *pose, np.broadcast_to(1e-12 * np.eye(6), (count, 6, 6)), NOISE)
    bare = flat.y - (flat.pose @ error[..., None])[..., 0]
    assert np.sum(bare**2, axis=1).mean() > 9.0


def test_face_on_starts_are_spread_or_ambiguous_and_never_silently_wrong() -> None:
    """The 10 000 of all kinds are benchmarks/face_on.py."""
    rng, nees, kept = np.random.default_rng(3), [], 0
    for _ in range(40):
        truth = facing(4 * rng.random(), 360 * rng.random())
        one = sweeps(seen(truth[None], POSITION[None]) + angle_errors(rng, 1, 6))
        found = search(Sighting(one.theta[0], one.lit[0], POINT, one.offset_s[0]), NOISE.own_rad)
        if not found.decided:
            continue
        best = found.rotation[0], found.position[0], NOISE, (0.0, 0.0)
        possible = spread(one, *best, found.rotation[1:], DECISIVE)
        if possible is None or not possible.contained:
            continue
        kept += 1
        error = np.concatenate([log(truth @ possible.rotation.T), POSITION - possible.position])
        nees.append(error @ np.linalg.solve(possible.covariance, error))
    assert kept > 10
    # The covariance is raised where it must reach farther than five sigmas: the mean lies below 6.
    assert 3.5 < np.mean(nees) < 7.5
    assert np.max(nees) < 44.6


def test_evidence_on_the_sign_of_a_tilt_is_summed_and_decides() -> None:
    truth, rng = facing(3.0), np.random.default_rng(5)
    side, leads = None, []
    for _ in range(30):
        one = sweeps(seen(truth[None], POSITION[None]) + angle_errors(rng, 1, 6))
        solved = refine(*one[:3], truth[None], POSITION[None], one.offset_s, one.angular_rate, one.velocity)
        best = solved.rotation[0], solved.position[0], NOISE, (0.0, 0.0), np.empty((0, 3, 3)), DECISIVE
        possible = spread(one, *best, side)
        assert possible is not None
        side, contained, rotation = possible.side, possible.contained, possible.rotation
        leads.append(side.lead)
        if side.lead >= DECISIVE:
            break
    assert side is not None
    assert side.lead >= DECISIVE
    assert contained
    # The other way round, the same light excludes the start's own side.
    wrong = spread(one, *best, Side(-side.turn, leads[-1] - 2 * leads[-1]))
    assert wrong is not None
    assert np.allclose(wrong.rotation, rotation, atol=2e-2)


def test_a_plane_far_from_face_on_keeps_its_first_order_covariance() -> None:
    truth = facing(40.0)
    one = sweeps(seen(truth[None], POSITION[None]))
    assert spread(one, truth, POSITION, NOISE, (0.0, 0.0), np.empty((0, 3, 3)), DECISIVE) is None


def test_a_frame_takes_covariances_in_and_rows_out() -> None:
    rng = np.random.default_rng(4)
    frame = Frame(exp(np.array([0.4, -0.7, 0.3])), np.array([2.0, -1.0, 0.5]))
    rows, root = rng.normal(size=(2, 6, 6))
    covariance = root @ root.T
    np.testing.assert_allclose(frame.matrix_out(frame.matrix_into(covariance)), covariance, atol=1e-12)
    out = frame.rows_out(rows)
    np.testing.assert_allclose(out @ covariance @ out.T, rows @ frame.matrix_into(covariance) @ rows.T, atol=1e-12)
    assert WORLD.matrix_into(covariance) is covariance
    assert WORLD.rows_out(rows) is rows


def test_the_summary_gives_the_reason_of_an_ambiguous_pose() -> None:
    figures = {"mean_visible": 4.0, "refused_share": 0.3, "nees": None}
    (said,) = warnings({"plate": {**figures, "ambiguous_share": 0.4}})
    assert said.text.startswith(
        "The pose of plate was ambiguous in 40 % of the periods: its lit photodiodes lie in one"
    )
    (said,) = warnings({"plate": figures})
    assert "acceleration_noise" in said.text
    # A target that others observe by LiDAR has no light of its own.
    target = {"mean_visible": 0.0, "observed": True, "nees": None, "ambiguous_share": 0.4}
    assert warnings({"target": target}) == []


def test_check_names_the_flat_craft() -> None:
    for settings, flat in (
        (load("plate"), ["across", "turning", "head-on", "slanted"]),
        (load("crossing", ["craft[1].lighthouse=false"]), []),
    ):
        assert builders.flat_craft(settings, Flight(settings).sensors.lighthouse.photodiodes) == flat
