"""The CCD sensor and what a craft makes of its images: projection, line of sight, failures, fall-back, own pose."""

from dataclasses import replace
from functools import cache
from types import SimpleNamespace

import mujoco
import numpy as np
import pytest
from scipy.stats import chi2

import swarm
from estimators import rotation as rot
from estimators.filter.error_state import POSE_COLUMNS
from swarm.assets import find_model
from swarm.errors import SwarmError
from swarm.flight import builders
from swarm.flight.flight import Flight
from swarm.messages import LightImages
from swarm.onboard import ccd as onboard
from swarm.onboard.ccd import CcdState
from swarm.onboard.settings import Sensor
from swarm.results.columns.core import SENSORS
from swarm.scenario import Outage, load, to_toml, validate
from swarm.sensors.ccd import Ccd
from swarm.sensors.visibility import Visibility
from swarm.world.craft import load_craft

TURNED = np.array([0.0, 0.0, 1.0, 0.0])
"""Half a turn about y: the chaser faces the target."""
STATION = np.array([0.0, 2.5, 4.0])


MRAD = 0.18 / np.pi * 3600
"""A thousandth of a radian [arcsec]."""


def changed(pair, **values):
    """The pair of cameras with other values in its table."""
    return replace(pair, table=pair.table.model_copy(update=values))


class Free:
    """No craft stands in the way."""

    def blocked(self, origin, point, position, quaternion):
        return np.zeros(len(point), bool)


@pytest.fixture(scope="module")
def scene():
    """The scenario's world, its pair of cameras, what the chaser knows of them, and the ray cast."""
    scenario = load("ccd-docking")
    motions = builders.fleet(scenario)
    world = builders.world(scenario, motions)
    true, known = builders.cameras(scenario, world, motions.at(0.0))[0]
    line = Visibility(world.model, world.photodiodes, world.craft_bodies, world.lighthouse_body, scenario.lighthouse)
    quiet = changed(true, image_noise_um=0.0, outages=())
    return SimpleNamespace(world=world, true=quiet, outages=true.table.outages, known=known, line=line)


def at(range_m, aside=(0.0, 0.0), turn=(0.0, 0.0, 0.0), time_s=0.0):
    """The chaser so far from the marker's circle, facing the target."""
    position = np.stack([STATION + np.array([*aside, 0.3705 + 0.5 + range_m]), STATION])
    chaser = rot.quaternion_multiply(rot.quaternion_from_matrix(rot.exp(np.array(turn))), TURNED)
    quaternion = np.stack([chaser, [1.0, 0, 0, 0]])
    return SimpleNamespace(
        time_s=np.full(9, time_s), position=np.tile(position, (9, 1, 1)), quaternion=[quaternion] * 9
    )


def expose(pair, motion, line=None, frame=0, seed=1, duration_s=100.0):
    return Ccd([pair], line or Free(), seed, duration_s).expose(motion, frame)


def test_the_rig_in_the_model_is_source_2s(scene):
    rig = scene.known.rig
    assert rig.baseline_m == pytest.approx(0.3)
    assert np.rad2deg(np.linalg.norm(rot.log(rig.rotation))) == pytest.approx(4.0)
    radius = np.linalg.norm(scene.true.lights.point_m[:, :2], axis=1)
    assert radius == pytest.approx([0.3, 0.3, 0.3, 0.3, 0.0])
    assert np.ptp(scene.true.lights.point_m[:, 2]) == pytest.approx(0.2)


def light_at(scene, data, light):
    """Where MuJoCo has a light of the target: the sites themselves are not in the world."""
    body = scene.world.craft_bodies[1]
    return data.xpos[body] + data.xmat[body].reshape(3, 3) @ scene.true.lights.point_m[light]


def test_images_are_what_mujocos_own_cameras_are_turned_to(scene):
    """x = f X/Z, y = f Y/Z with the camera poses that MuJoCo computes for the placed craft: x right, y down."""
    motion = at(9.0, (0.4, -0.3), (0.02, -0.03, 0.1))
    data = mujoco.MjData(scene.world.model)
    data.qpos[:] = np.concatenate([motion.position[4], motion.quaternion[4]], axis=1).ravel()
    mujoco.mj_forward(scene.world.model, data)
    seen = expose(scene.true, motion)
    assert seen.seen.all()
    for camera, name in enumerate(("ccd1_main", "ccd2_backup")):
        place = data.camera(f"chaser/{name}")
        for light in range(5):
            r = place.xmat.reshape(3, 3).T @ (light_at(scene, data, light) - place.xpos)
            # MuJoCo's cameras look along -z with y up.
            expected = 0.028 * np.array([r[0], -r[1]]) / -r[2]
            assert seen.image_m[0, camera, light] == pytest.approx(expected, abs=1e-12)


def test_field_range_and_cone_limit_what_is_seen(scene):
    assert not expose(scene.true, at(36.0)).seen.any(), "out of range"
    assert expose(scene.true, at(34.0)).seen.all()
    # 1 m from the marker only the lights on the cameras' own sides are within 12 degrees.
    near = expose(scene.true, at(1.0)).seen[0]
    assert 0 < near.sum() < 10
    assert expose(changed(scene.true, field_deg=80.0), at(1.0)).seen.all()
    # Turned by 13 degrees the target leaves the field; the target seen from 70 degrees aside does not shine that way.
    assert not expose(scene.true, at(9.0, turn=(0.0, np.deg2rad(20), 0.0))).seen.any()
    aside = at(9.0, (25.0, 0.0), (0.0, np.arctan2(25.0, 9.4), 0.0))
    assert not expose(scene.true, aside).seen.any()
    assert expose(changed(scene.true, light_cone_deg=85.0), aside).seen.all()


def test_a_light_behind_the_target_or_its_post_is_hidden(scene):
    """Turned by 30 degrees the post of the fifth light crosses a line of sight; from behind nothing is seen."""
    assert expose(scene.true, at(9.0), scene.line).seen.all()
    motion, wide = at(9.0), changed(scene.true, light_cone_deg=180.0)
    away = motion.quaternion[4].copy()
    away[1] = TURNED
    motion.quaternion = [away] * 9
    assert not expose(wide, motion, scene.line).seen.any()
    assert expose(wide, motion).seen.all()
    data, hidden = mujoco.MjData(scene.world.model), 0
    for angle in np.deg2rad(np.arange(20, 60, 0.5)):
        motion = at(4.0)
        turned = motion.quaternion[4].copy()
        turned[1] = rot.quaternion_from_matrix(rot.exp(np.array([0.0, angle, 0.0])))
        motion.quaternion = [turned] * 9
        seen = expose(wide, motion, scene.line).seen[0]
        data.qpos[:] = np.concatenate([motion.position[4], turned], axis=1).ravel()
        mujoco.mj_forward(scene.world.model, data)
        for camera, name in enumerate(("ccd1_main", "ccd2_backup")):
            eye = data.camera(f"chaser/{name}").xpos
            for light in range(5):
                ray = light_at(scene, data, light) - eye
                distance, geom = np.linalg.norm(ray), np.zeros(1, np.int32)
                hit = mujoco.mj_ray(scene.world.model, data, eye, ray / distance, None, True, -1, geom)
                assert seen[camera, light] == (hit < 0 or hit >= distance - 1e-3)
        hidden += int(np.count_nonzero(~seen))
    assert hidden > 0


def test_noise_and_resolution(scene):
    pair = changed(scene.true, image_noise_um=1.0)
    exact, sensor = expose(scene.true, at(9.0)).image_m, Ccd([pair], Free(), 3, 1.0)
    error = np.array([sensor.expose(at(9.0), frame).image_m - exact for frame in range(300)])
    # 6000 numbers: the standard deviation to 0.9 %; the correlation of any two of the 20 to 1 / sqrt(300).
    assert error.std() == pytest.approx(1e-6, rel=0.04)
    assert np.abs(np.corrcoef(error.reshape(300, 20).T) - np.eye(20)).max() < 0.26
    rounded = expose(changed(scene.true, resolution_um=5.0), at(9.0)).image_m
    assert np.abs(rounded - exact).max() <= 2.5e-6
    assert rounded / 5e-6 == pytest.approx(np.rint(rounded / 5e-6), abs=1e-9)


def test_draws_depend_on_seed_frame_and_craft_alone(scene):
    pair = changed(scene.true, image_noise_um=1.0, mounting_error_arcsec=MRAD, lost_image_probability=0.3)
    forth, back = Ccd([pair], Free(), 3, 1.0), Ccd([replace(pair, key=99), pair], Free(), 3, 1.0)
    frames = [0, 1, 63, 64, 200]
    first = [forth.expose(at(9.0), f).image_m[0] for f in frames]
    second = [back.expose(at(9.0), f).image_m[1] for f in reversed(frames)][::-1]
    assert np.array_equal(first, second, equal_nan=True)
    assert not np.array_equal(first[0], Ccd([pair], Free(), 4, 1.0).expose(at(9.0), 0).image_m[0])


def test_lenses_are_mounted_with_an_error_that_stays(scene):
    pair = changed(scene.true, mounting_error_arcsec=MRAD, mounting_error_mm=1.0)
    sensors = [Ccd([replace(pair, key=k)], Free(), 1, 1.0).mounted[0] for k in range(200)]
    shift = np.array([s.position_m - pair.cameras.position_m for s in sensors])
    turn = np.array([rot.log(np.swapaxes(pair.cameras.rotation, 1, 2) @ s.rotation) for s in sensors])
    # 1200 numbers each: 2 % (1 sigma).
    assert shift.std() == pytest.approx(1e-3, rel=0.08)
    assert turn.std() == pytest.approx(1e-3, rel=0.08)


def test_cameras_fail_by_time_by_distance_and_at_random(scene):
    pair = changed(scene.true, outages=(Outage(from_m=12.0, to_m=6.0), Outage(camera="main", from_s=3.0, to_s=4.0)))
    for range_m, time_s, main, backup in (
        (13.0, 0.0, True, True),
        (9.0, 0.0, True, False),
        (5.0, 0.0, True, True),
        (9.0, 3.0, False, False),
        (13.0, 4.0, True, True),
    ):
        seen = expose(pair, at(range_m, time_s=time_s)).seen[0]
        assert seen.any(axis=1).tolist() == [main, backup]
    # Failing every 10 s for 5 s on average, a third of the time: 2000 s hold 133 such cycles, 6 % of a third (1 sigma).
    pair = changed(scene.true, failure_every_s=10.0, failure_length_s=5.0)
    sensor = Ccd([pair], Free(), 1, 2000.0)
    seen = np.array([sensor.expose(at(9.0, time_s=t), 0).seen[0, :, 0] for t in np.arange(0, 2000, 1.0)])
    assert (1 - seen.mean(axis=0)) == pytest.approx(1 / 3, abs=0.08)
    assert abs(np.corrcoef(seen.T)[0, 1]) < 0.2
    lost = changed(scene.true, lost_image_probability=0.25)
    sensor = Ccd([lost], Free(), 1, 1.0)
    seen = np.array([sensor.expose(at(9.0), f).seen[0, :, 0] for f in range(1000)])
    assert 1 - seen.mean(axis=0) == pytest.approx(0.25, abs=0.06)


def fix(scene, images, predicted=None):
    rotation, position = (np.full((2, 3, 3), np.nan), np.full((2, 3), np.nan)) if predicted is None else predicted
    return onboard.fix([scene.known], images, rotation, position)


def truth(motion):
    return rot.matrix_from_quaternion(motion.quaternion[4]), motion.position[4]


def test_the_own_pose_comes_out_of_exact_images(scene):
    motion = at(20.0, (1.0, -0.5), (0.02, -0.03, 0.1))
    rotation, position = truth(motion)
    images = expose(scene.true, motion)
    c, m = scene.known.seen_from(rotation[0], position[0])
    back = scene.known.own_pose(c, m)
    assert back[0] == pytest.approx(rotation[0], abs=1e-14)
    assert back[1] == pytest.approx(position[0], abs=1e-13)
    found = fix(scene, images)
    assert found.state.tolist() == [CcdState.STEREO, CcdState.ABSENT]
    assert found.lights.tolist() == [[5, 5], [0, 0]]
    assert found.position[0] == pytest.approx(position[0], abs=1e-6)
    assert rot.angle_between(found.rotation[0], rotation[0]) < 1e-8
    assert np.isnan(found.position[1]).all()


def test_the_covariance_is_turned_with_the_lever_of_the_distance(scene):
    """Against differences of the pose by (attitude, position) of the target in the camera."""
    rotation, position = truth(at(20.0, (1.0, -0.5), (0.02, -0.03, 0.1)))
    c, m = scene.known.seen_from(rotation[0], position[0])
    h, slope = 1e-5, np.empty((6, 6))
    for i, step in enumerate(h * np.eye(6)):
        ends = [scene.known.own_pose(rot.exp(s * step[:3]) @ c, m + s * step[3:]) for s in (1, -1)]
        turn = [rot.log(r @ rotation[0].T) for r, _ in ends]
        slope[:, i] = np.concatenate([turn[0] - turn[1], ends[0][1] - ends[1][1]]) / (2 * h)
    assert scene.known.own_covariance(c, m, np.eye(6)) == pytest.approx(slope @ slope.T, rel=1e-6, abs=1e-6)


def hide(images, *hidden):
    seen = images.seen.copy()
    for camera, light in hidden:
        seen[0, camera, light] = False
    return LightImages(np.where(seen[..., None], images.image_m, np.nan), seen)


def test_stereo_while_both_see_three_else_the_main_camera_alone_else_the_reason(scene):
    motion = at(9.0, (0.1, 0.1), (0.01, -0.02, 0.05))
    images = expose(changed(scene.true, image_noise_um=0.3), motion)
    for hidden, state in (
        ((), CcdState.STEREO),
        (((0, 0), (1, 1)), CcdState.STEREO),
        ([(1, i) for i in range(5)], CcdState.CAMERA),
        ([(1, i) for i in range(3)], CcdState.CAMERA),
        ([(0, 0), *((1, i) for i in range(5))], CcdState.CAMERA),
        ([(0, 0), (0, 1), *((1, i) for i in range(5))], CcdState.TOO_FEW),
        ([(0, i) for i in range(5)], CcdState.TOO_FEW),
        ([(c, i) for c in range(2) for i in range(5)], CcdState.TOO_FEW),
    ):
        for predicted in (None, truth(motion)):
            found = fix(scene, hide(images, *hidden), predicted)
            assert found.state[0] == state
            known = state in (CcdState.STEREO, CcdState.CAMERA)
            assert known == np.isfinite(found.position[0]).all() == np.isfinite(found.covariance[0]).all()
            if known:
                error = np.concatenate(
                    [rot.log(truth(motion)[0][0] @ found.rotation[0].T), truth(motion)[1][0] - found.position[0]]
                )
                # A chi-square of 6: 35 is 5e-6.
                assert error @ np.linalg.solve(found.covariance[0], error) < 35


def test_wrong_images_give_no_pose_but_a_reason(scene):
    motion = at(9.0)
    images = expose(scene.true, motion)
    broken = images.image_m.copy()
    broken[0, :, 2, 0] = np.nan
    assert fix(scene, LightImages(broken, images.seen)).state[0] in (CcdState.NOT_FINITE, CcdState.UNDECIDED)
    only_backup = images.image_m.copy()
    only_backup[0, 1, 2, 0] = np.nan
    assert fix(scene, LightImages(only_backup, images.seen)).state[0] == CcdState.CAMERA, "the main camera is sound"
    for closed_form in (False, True):
        known = replace(scene.known, closed_form=closed_form)
        for swapped in ([[0, 1], [1, 0]], [[0, 4], [4, 0]], [[0, 1, 2, 3], [1, 2, 3, 0]]):
            wrong = images.image_m.copy()
            wrong[:, :, swapped[0]] = images.image_m[:, :, swapped[1]]
            rotation, position = truth(motion)
            state = onboard.fix([known], LightImages(wrong, images.seen), rotation, position).state[0]
            if len(swapped[0]) == 2:
                assert state not in (CcdState.STEREO, CcdState.CAMERA)
    collinear = replace(scene.known, light_m=np.outer(np.linspace(-1, 1, 5), [0.3, 0.1, 0.0]))
    state = onboard.fix([collinear], images, *truth(motion)).state[0]
    assert state == CcdState.COLLINEAR


@cache
def flight(*overrides):
    """A shorter approach, from 11.5 m to 3 m with the outage from 10 m to 4 m, flown and gathered by column."""
    short = ("craft[0].motion.from_m=[0, 2.5, 18.371]", "craft[0].motion.to_m=[0, 2.5, 9.871]", "duration_s=11")
    f = Flight(load("ccd-docking", [*short, "craft[0].motion.start_s=1", "craft[0].motion.speed_m_s=1.2", *overrides]))
    out = SimpleNamespace(sensor=[], nees=[], error=[], sigma=[], distance=[])
    for frame in range(round(11 / f.period_s)):
        period = f.period(frame)
        true, e = period.truth, period.estimate
        assert true is not None
        turn = rot.matrix_from_quaternion(true.quaternion[0]) @ e.rotation[0].T
        error = np.concatenate([rot.log(turn), true.position[0] - e.position[0]])
        covariance = e.covariance[0][np.ix_(POSE_COLUMNS, POSE_COLUMNS)]
        out.sensor.append(int(e.sensor[0]))
        out.error.append(error)
        out.sigma.append(np.sqrt(np.diagonal(covariance)))
        out.nees.append(error @ np.linalg.solve(covariance, error))
        out.distance.append(true.position[0, 2] - 6.871)
    return SimpleNamespace(**{name: np.array(values) for name, values in vars(out).items()})


@pytest.mark.parametrize("lighthouse", [False, True])
def test_the_fall_back_makes_no_jump_and_the_filter_stays_consistent(lighthouse):
    flown = flight(f"craft[0].lighthouse={str(lighthouse).lower()}")
    more = Sensor.LIGHTHOUSE if lighthouse else Sensor.NONE
    # The gate refuses one good pose in 10^5, of either sensor: that period lacks one of them, and nothing else does.
    full = [int(more | Sensor.STEREO), int(more | Sensor.CAMERA)]
    known = np.isin(flown.sensor, full)
    assert known.mean() > 0.998
    assert np.isin(flown.sensor[1:], [*full, Sensor.STEREO, Sensor.CAMERA, more]).all()
    used = flown.sensor[known]
    switches = np.flatnonzero(known)[1:][np.diff(used) != 0]
    assert flown.distance[switches] == pytest.approx([10.0, 4.0], abs=0.05)
    jump = np.abs(np.diff(flown.error, axis=0)) / flown.sigma[:-1]
    assert jump[switches - 1].max() < 3
    for high, low in ((15, 10), (10, 4), (4, 2.5)):
        nees = flown.nees[60:][(flown.distance[60:] <= high) & (flown.distance[60:] > low)]
        # Errors of the filter live some 15 periods: so many fewer independent values; 0.999 of such means.
        independent = len(nees) / 15
        low_band, high_band = chi2.ppf([5e-4, 1 - 5e-4], 6 * independent) / independent
        assert low_band < nees.mean() < high_band


def test_both_sensors_together_are_better_than_either():
    cameras, both = flight("craft[0].lighthouse=false"), flight("craft[0].lighthouse=true")
    # The filter with both sees the braking sooner, and for a moment allows for more of it than the other one.
    assert np.mean(both.sigma[60:] < cameras.sigma[60:], axis=0).min() > 0.95
    late = slice(60, None)
    assert np.all(np.mean(both.sigma[late] ** 2, axis=0) < np.mean(cameras.sigma[late] ** 2, axis=0))
    assert np.mean(both.error[late, 3:] ** 2) < 0.5 * np.mean(cameras.error[late, 3:] ** 2)


def test_a_craft_steered_by_the_truth_gets_no_command_in_its_filter():
    """It would be a way for the truth into navigation."""
    f = Flight(load("ccd-docking", ["craft[0].feedback=truth"]))
    f.move(0)
    assert not f.command.acceleration.any()
    assert not f.command.angular_acceleration.any()


def test_the_run_records_what_the_cameras_did(tmp_path):
    short = ["craft[0].motion.from_m=[0, 2.5, 17.071]", "craft[0].motion.to_m=[0, 2.5, 8.871]", "duration_s=2.5"]
    run = swarm.simulate(
        load("ccd-docking", [*short, "craft[0].motion.start_s=0", "craft[0].motion.speed_m_s=1"]), out=tmp_path / "run"
    )
    rows = [row for row in run.telemetry.to_pylist() if row["craft"] == "chaser"]
    assert {row["sensor"] for row in rows} >= {"stereo", "camera"}
    assert {row["ccd"] for row in rows} == {"stereo", "camera"}
    assert all(row["ccd_main_lights"] == 5 for row in rows)
    assert {row["ccd_backup_lights"] for row in rows} == {0, 5}
    assert all(row["pnp_px_m"] is None and row["visible"] == 0 for row in rows), "no lighthouse on board"
    assert all(row["ccd_position_error_m"] < 0.2 and row["ccd_pdop_m_per_rad"] > 0 for row in rows)
    target = next(row for row in run.telemetry.to_pylist() if row["craft"] == "target")
    assert target["ccd"] is None
    assert target["ccd_main_lights"] is None
    assert target["sensor"] in SENSORS
    figures = run.summary["craft"]["chaser"]["ccd"]
    assert figures["sensor_switches"] >= 1
    assert figures["stereo_share"] + figures["camera_share"] == pytest.approx(1)
    assert run.summary["craft"]["target"]["ccd"] is None
    assert (tmp_path / "run" / "recording.rrd").stat().st_size > 1e5


@pytest.mark.parametrize(
    ("override", "message"),
    [
        (
            "craft[0].ccd.target=targt",
            "craft[0].ccd.target = \"targt\": no craft has this name; did you mean 'target'?",
        ),
        ("craft[0].ccd.target=chaser", "a craft cannot be its own target"),
        ("craft[1].feedback=estimate", 'must hold its position exactly: feedback = "truth"'),
        ("craft[1].motion.attitude.spin_deg_s=1", "must hold its position without spin"),
        ("craft[0].ccd.range_min_m=40", "must be below range_max_m = 35.0 m"),
        ("craft[0].ccd.outages=[{from_s = 3.0, to_s = 2.0}]", "must be after from_s = 3.0 s"),
        ("craft[0].ccd.outages=[{from_m = 3.0, to_m = 4.0}]", "must be nearer than from_m = 3.0 m"),
        ('craft[0].ccd.outages=[{camera = "left"}]', "must be 'main' or 'backup'"),
        ("craft[0].ccd.image_noise_um=0", "no filter takes exact poses"),
        ("craft[0].ccd.focal_lenght_mm=3", "did you mean 'focal_length_mm' (in mm)?"),
    ],
)
def test_mistakes_in_the_scenario_are_named(override, message):
    with pytest.raises(SwarmError) as raised:
        load("ccd-docking", [override])
    assert message in str(raised.value)


def test_models_without_cameras_or_lights_are_named():
    for override, message in (
        ("craft[0].model=cubesat6u", "has no cameras (two whose name starts with 'ccd')"),
        ("craft[1].model=cubesat6u", "has 0 lights (sites whose name starts with 'light'), at least 3 are needed"),
    ):
        with pytest.raises(SwarmError) as raised:
            Flight(load("ccd-docking", [override]))
        assert message in str(raised.value)


def test_one_camera_or_three_are_no_pair(tmp_path):
    text = find_model("chaser").read_text()
    path = tmp_path / "one.xml"
    path.write_text(text.replace('name="ccd2_backup"', 'name="other"'))
    with pytest.raises(SwarmError, match=r"1 cameras .*: a pair is two, main and backup"):
        load_craft(path)


def test_a_scenario_with_outages_writes_out_and_reads_back_equal(tmp_path):
    first = load(
        "ccd-docking", ["craft[0].ccd.outages=[{camera='main', from_s=1.0, to_s=2.0}, {from_m=9.0, to_m=8.0}]"]
    )
    file = tmp_path / "again.toml"
    file.write_text(to_toml(first))
    assert load(file) == first
    assert validate({"name": "x", "swarm": {"count": 1}}, file="x", folder=tmp_path).swarm.lighthouse


def test_pushes_are_what_the_scenario_says_and_no_others():
    settings = load("ccd-docking")
    pushes = builders.pushes(settings)
    assert pushes.pushed.tolist() == [True, False]
    drawn = [pushes.at(frame) for frame in range(3000)]
    acceleration = np.array([d.acceleration[0] for d in drawn])
    assert acceleration.std() == pytest.approx(0.02, rel=0.05)
    assert not any(d.acceleration[1].any() for d in drawn[:300])
    again = builders.pushes(load("ccd-docking", ["craft[1].disturbance.acceleration_m_s2=1"]))
    assert np.array_equal(again.at(700).acceleration[0], drawn[700].acceleration[0])
