"""Every fault happens where and when the scenario says, shows in telemetry and recording, and the craft get over it."""

from collections import Counter
from functools import cache

import mujoco
import numpy as np
import pytest

import swarm
from estimators import rotation as rot
from estimators.rotation import quaternion_from_matrix
from swarm.errors import SwarmError
from swarm.flight.faults.schedule import Schedule, speed_swing
from swarm.flight.flight import Flight
from swarm.messages import Pulses
from swarm.onboard.decoder import PulseDecoder
from swarm.onboard.settings import Status
from swarm.scenario.faults import KINDS, LighthouseDark, PhotodiodeDead, SyncLoss, too_late
from swarm.sensors import mirror
from swarm.sensors import pulse_faults as pulses
from swarm.sensors.lighthouse import Rotor
from swarm.sensors.pulse_faults import Clock, Register, Row
from swarm.sensors.sight import Sight

PERIOD_S = 1 / 60
NAMES, KEYS = ("a", "b", "c"), (11, 12, 13)


def schedule(*faults, names=NAMES, keys=KEYS, end_s=10.0, seed=0):
    return Schedule(faults, names, keys, seed, 60.0, end_s)


# When.


def test_a_fault_lasts_from_the_period_that_begins_then_until_the_one_that_begins_at_its_end():
    dead = PhotodiodeDead(kind="photodiode-dead", craft=("b",), photodiodes=(1,), at_s=0.5, for_s=0.2)
    dark = LighthouseDark(kind="lighthouse-dark", at_s=0.6, until_s=1.0)
    made = schedule(dead, dark)
    assert [(w.craft, w.first, w.past) for w in made.windows] == [(1, 30, 42), (-1, 36, 60)]
    assert made.names == ("none", "photodiode-dead", "lighthouse-dark", "photodiode-dead + lighthouse-dark")
    told = [[made.names[i] for i in made.states(frame)] for frame in (29, 30, 36, 42, 60)]
    assert told == [
        ["none"] * 3,
        ["none", "photodiode-dead", "none"],
        ["lighthouse-dark", "photodiode-dead + lighthouse-dark", "lighthouse-dark"],
        ["lighthouse-dark"] * 3,
        ["none"] * 3,
    ]


def test_random_strikes_come_at_their_rate_and_a_craft_keeps_its_own_whoever_else_flies():
    burst = SyncLoss(kind="sync-loss", probability_per_s=0.5, for_s=0.1)
    names = tuple(f"craft-{i}" for i in range(40))
    made = schedule(burst, names=names, keys=range(40), end_s=100.0)
    # Poisson: 0.5 per second of the time that is not spent in a burst, 1 / (2 s + 0.1 s).
    count, expected = len(made.windows), 40 * 100 / 2.1
    assert abs(count - expected) < 4 * np.sqrt(expected)
    alone = schedule(burst, names=names[7:8], keys=[7], end_s=100.0)
    with_another = schedule(
        burst, LighthouseDark(kind="lighthouse-dark", at_s=1), names=names, keys=range(40), end_s=100
    )
    for other in (alone, with_another):
        mine = [w[3:] for w in other.windows if w.craft == (0 if other is alone else 7)]
        assert mine == [w[3:] for w in made.windows if w.craft == 7]


def test_the_rotors_phase_is_the_integral_of_its_speed():
    time_s = np.linspace(0, 4, 4001)
    speed, phase = speed_swing(time_s, 4.0, 3e-4)
    integral = -np.concatenate([[0], np.cumsum((speed[1:] + speed[:-1]) / 2 * np.diff(time_s))])
    np.testing.assert_allclose(phase, integral, atol=1e-10)
    assert phase[-1] == pytest.approx(0, abs=1e-15)


# Pulses.

CLOCK = Clock(start_tick=1e6 + 0.3, tick_s=20e-9, period_s=PERIOD_S)


def row() -> Row:
    """Flashes and sweeps of photodiodes 0 and 1: X at a quarter of the half turn, Y at three quarters of it."""
    half = PERIOD_S / 2
    instant = np.array([33e-6, 33e-6, half / 4, half / 4 + 1e-5, half + 38e-6, half + 38e-6, 1.75 * half, 1.75 * half])
    width = np.array([62.5e-6, 62.5e-6, 1e-6, 1e-6, 73e-6, 73e-6, 1e-6, 1e-6])
    return CLOCK.pulse(np.array([0, 1] * 4), instant, width)


def test_what_faults_do_to_a_row_of_pulses():
    before = row()
    assert CLOCK.fan(before).tolist() == [0, 0, 0, 0, 1, 1, 1, 1]
    assert CLOCK.flash(before).tolist() == [True, True, False, False] * 2
    dead = pulses.only(before, ~pulses.of_photodiodes(before, (0,)))
    assert set(dead.photodiode.tolist()) == {1}
    deaf = pulses.without_flashes(before, CLOCK, np.array([False, True]))
    assert CLOCK.flash(deaf).tolist() == [True, True, False, False, False, False]
    struck, shift = np.array([[True, False], [False, False]]), np.full((2, 2), 0.1)
    ghost = pulses.moved(before, CLOCK, struck, shift)
    late = ghost.rise[(ghost.photodiode == 0) & ~CLOCK.flash(ghost)] - before.rise[[2, 6]]
    # The rotor turns by 0.1 rad in 0.1 T / 2 pi.
    assert late.tolist() == [round(0.1 * PERIOD_S / (2 * np.pi) / 20e-9), 0]
    assert np.all(np.diff(ghost.rise) >= 0), "in order of rise"


def test_a_stuck_register_repeats_the_first_sweeps_that_it_had_from_both_fans():
    register = Register()
    half_seen = pulses.only(row(), ~((CLOCK.fan(row()) == 1) & ~CLOCK.flash(row())))
    np.testing.assert_array_equal(register.stuck(half_seen, CLOCK, 0).rise, half_seen.rise)
    register.stuck(row(), CLOCK, 0)
    # A period later everything comes 1 us later by the craft's clock, and photodiode 0 has gone dark.
    later = CLOCK._replace(start_tick=CLOCK.start_tick + PERIOD_S / 20e-9)
    now = pulses.only(row(), row().photodiode == 1)
    now = now._replace(rise=now.rise + round(PERIOD_S / 20e-9) + 50)
    after = register.stuck(now, later, 0)
    held = after.photodiode == 0
    np.testing.assert_allclose(
        later.instant(Row(*(part[held] for part in after))), CLOCK.instant(row())[[2, 6]], atol=20e-9
    )
    np.testing.assert_array_equal(after.rise[~held], now.rise)


def test_rows_go_back_wider_and_narrower_than_they_came():
    given = Pulses(
        np.array([[0, 1], [0, -1]], dtype=np.int16),
        np.array([[5, 6], [7, 0]]),
        np.ones((2, 2), dtype=np.int32),
        np.array([2, 1], dtype=np.int32),
    )
    more = Row(np.array([0, 1, 1]), np.array([1, 2, 3]), np.array([4, 4, 4]))
    out = pulses.with_rows(given, {1: more})
    assert out.total.tolist() == [2, 3]
    np.testing.assert_array_equal(pulses.row_of(out, 1).rise, more.rise)
    np.testing.assert_array_equal(pulses.row_of(out, 0).rise, [5, 6])
    assert [part.dtype for part in out] == [part.dtype for part in given]
    none = pulses.with_rows(given, {0: Row(*np.zeros((3, 0), dtype=np.int64))})
    assert none.total.tolist() == [0, 1]
    assert none.photodiode[0].tolist() == [-1, -1]


def test_a_rotor_off_speed_shows_in_the_angles_and_the_flashes_tell_by_how_much():
    flight = Flight(swarm.load("static", ["lighthouse.angle_noise_arcsec=0"]))
    truth, sight = flight.move(0)
    lit = sight == 2
    still, off = PulseDecoder(lit[..., 0], 20e-9), PulseDecoder(lit[..., 0], 20e-9)
    for frame in range(3):
        speed = 1 + 3e-4
        # A phase that lets the flashes come as such a rotor's: each turn as much sooner.
        rotor = Rotor(speed, -frame * PERIOD_S * (1 - 1 / speed))
        exact = still.decode(flight.sensors.lighthouse.sweep(truth, frame, lit))
        fast = off.decode(flight.sensors.lighthouse.sweep(truth, frame, lit, rotor))
    seen = exact.lit & fast.lit
    # Rounding to ticks, 7.5 urad each, of sweep and flash.
    np.testing.assert_allclose(fast.theta[seen] * speed, exact.theta[seen], atol=1.6e-5)
    assert np.abs(fast.theta[seen] - exact.theta[seen]).max() > 2e-4


# Mirrors.


@pytest.fixture(scope="module")
def hall():
    """Two craft with panels, the second one's turned so that they light the first one's back."""
    single = "model='cubesat6u', motion={kind='hold', position_m="
    craft = f"craft=[{{name='victim', {single}[-0.5, 0, 2.5]}}}}, {{name='mirror', {single}[0.4, 0, 4]}}}}]"
    return Flight(swarm.load("static", ["swarm.count=0", craft]))


def poses(flight: Flight, tilt_deg: float):
    reference = flight.motions.at(0.0)
    rotation = reference.rotation.copy()
    rotation[1] = rotation[1] @ rot.exp(np.array([0, np.radians(tilt_deg), 0]))
    return reference.position, quaternion_from_matrix(rotation)


def ghosts(flight: Flight, pose):
    layout, settings = flight.sensors.lighthouse.photodiodes, flight.sensors.lighthouse.settings
    return mirror.ghosts(flight.sensors.visibility, layout, 0, [1], settings, *pose)


@pytest.mark.parametrize("tilt_deg", [7.0, 8.0, 13.0])
def test_a_reflection_obeys_the_mirror_and_mujocos_rays_go_the_same_way(hall, tilt_deg):
    position, quaternion = poses(hall, tilt_deg)
    seen = ghosts(hall, (position, quaternion))
    assert len(seen.photodiode) >= 3
    model, data = hall.world.model, mujoco.MjData(hall.world.model)
    data.qpos[:] = np.concatenate([position, quaternion], axis=1).ravel()
    mujoco.mj_forward(model, data)
    layout, turn = hall.sensors.lighthouse.photodiodes, rot.matrix_from_quaternion(quaternion)
    geom, normal = np.zeros(1, dtype=np.int32), np.zeros(3)
    for k, q, way in zip(seen.photodiode, seen.point_m, seen.way_m, strict=True):
        reach = np.linalg.norm(q)
        hit = mujoco.mj_ray(model, data, np.zeros(3), q / reach, None, 1, hall.world.lighthouse_body, geom, normal)
        assert hit == pytest.approx(reach, abs=1e-6), "the first thing that the light meets is the mirror"
        assert model.geom_bodyid[geom[0]] == hall.world.craft_bodies[1]
        onward = q / reach - 2 * (normal @ q / reach) * normal
        p = turn[0] @ layout.point_m[0, k] + position[0]
        hit = mujoco.mj_ray(model, data, q + 1e-5 * normal, onward, None, 1, -1, geom, None)
        assert hit == pytest.approx(np.linalg.norm(p - q), abs=1.2e-3), "and the next one is the photodiode's place"
        assert model.geom_bodyid[geom[0]] == hall.world.craft_bodies[0]
        np.testing.assert_allclose(q + onward * np.linalg.norm(p - q), p, atol=1e-5)
        assert way == pytest.approx(reach + np.linalg.norm(p - q), rel=1e-9)


def test_no_reflection_is_overlooked_by_a_fine_search_over_the_faces(hall):
    # Fermat: of all points of a face the mirror's makes the way stationary; here it is looked for on a grid.
    position, quaternion = poses(hall, 8.0)
    seen = Counter(ghosts(hall, (position, quaternion)).photodiode.tolist())
    layout, turn = hall.sensors.lighthouse.photodiodes, rot.matrix_from_quaternion(quaternion)
    p = layout.point_m[0, layout.present[0]] @ turn[0].T + position[0]
    n_p = layout.normal[0, layout.present[0]] @ turn[0].T
    n = -turn[1] @ np.array([0, 0, -1.0])
    found = set()
    # The panels' front faces, 2 mm ahead of their middles.
    side = np.stack(np.meshgrid(np.linspace(-0.15, 0.15, 151), np.linspace(-0.09, 0.09, 91)), axis=-1).reshape(-1, 2)
    for centre in (0.205, -0.205):
        point = np.column_stack([side[:, 0] + centre, side[:, 1], np.full(len(side), 0.002)]) @ turn[1].T + position[1]
        ray = point / np.linalg.norm(point, axis=1, keepdims=True)
        onward = ray - 2 * (ray @ n)[:, None] * n
        for k in range(len(p)):
            away = p[k] - point
            miss = np.linalg.norm(np.cross(away, onward), axis=1)
            back = -away / np.linalg.norm(away, axis=1, keepdims=True)
            good = (miss < 2e-3) & (back @ n_p[k] > np.cos(np.radians(80))) & (np.sum(away * onward, axis=1) > 0)
            scene = position, quaternion
            for i in np.flatnonzero(good)[:1]:
                through = hall.sensors.visibility.blocked(np.zeros(3), point[i][None], *scene, through_lighthouse=True)[
                    0
                ]
                if not through and not hall.sensors.visibility.blocked(point[i] + 1e-4 * n, p[k][None], *scene)[0]:
                    found.add(k)
    assert found
    assert found <= set(seen)


# In flight.


@pytest.fixture(scope="module")
def flown(tmp_path_factory):
    folder = tmp_path_factory.mktemp("runs")

    @cache
    def fly(name: str, *overrides: str, record: bool = False):
        out = folder / f"{name}-{abs(hash(overrides))}"
        return swarm.simulate(swarm.load(name, overrides), out=out, record=record)

    return fly


def column(run, name, craft=None):
    values = run.telemetry.column(name).to_pylist()
    who = run.telemetry.column("craft").to_pylist()
    kept = [v for v, c in zip(values, who, strict=True) if craft in (None, c)]
    return np.array([np.nan if v is None else v for v in kept])


@pytest.mark.long
def test_every_fault_of_the_parade_is_in_telemetry_and_recording_and_no_accepted_pose_is_beyond_its_level(flown):
    from test_recording import read

    run = flown("fault-parade", record=True)
    fault, craft = column(run, "fault"), column(run, "craft")
    seen = {kind for state in np.unique(fault) for kind in str(state).split(" + ")}
    assert seen == {"none", *KINDS}
    assert sum(np.mean(fault[craft == c] == "none") < 1 for c in np.unique(craft)) == 6
    for c in ("victim", "stray"):
        lane = read(run.folder / "recording.rrd", f"status/{c}/fault", "StateChange:state")
        assert [state[0] for state in lane] == fault[craft == c].tolist()
    found = run.summary["swarm"]["integrity"]
    assert found["accepted_poses"]["samples"] > 10_000
    assert found["accepted_poses"]["beyond"] == 0
    assert not column(run, "contact").any()
    dropped = column(run, "dropped_photodiodes", "victim")
    assert np.median(dropped[240:480]) >= 3, "the reflections on its back are found out"
    assert np.all(dropped[:240] == 0)


def test_after_five_seconds_of_darkness_craft_track_again_within_half_a_second(flown):
    dark = 'fault=[{kind="lighthouse-dark", at_s=1, for_s=5}]'
    run = flown(
        "formation", dark, 'swarm.feedback="estimate"', "duration_s=8", "navigation.integrity.alert_position_mm=50"
    )
    status, time_s = column(run, "status"), column(run, "time_s")
    assert np.all(status[(time_s > 1) & (time_s < 6)] != "tracking")
    assert np.all(status[time_s > 6.5] == "tracking")
    alert = column(run, "alert")
    assert not alert[time_s < 1].any()
    assert alert[(time_s > 4) & (time_s < 6)].all()
    assert not column(run, "contact").any()


def test_what_is_seen_of_a_photodiode_is_what_its_faults_leave_of_it():
    dead = '{kind="photodiode-dead", craft="near", photodiodes=[0, 3], at_s=0.1, for_s=0.1}'
    dark = '{kind="lighthouse-dark", at_s=0.15, for_s=0.1}'
    struck, whole = (Flight(swarm.load("static", [f"fault=[{each}]"])) for each in (f"{dead}, {dark}", ""))
    for frame in range(18):
        near, *others = whole.period(frame).sight
        assert near[0] == near[3] == Sight.LIT
        if 9 <= frame < 15:
            near[:] = Sight.OUTSIDE
            others = [np.full_like(near, Sight.OUTSIDE)] * len(others)
        if 6 <= frame < 12:
            near[[0, 3]] = Sight.DEAD
        np.testing.assert_array_equal(struck.period(frame).sight, [near, *others])


@pytest.mark.long
def test_reflections_in_5_percent_of_the_sweeps_cost_little(flown):
    clean = flown("formation", "duration_s=5").summary["swarm"]
    struck = flown("formation", "duration_s=5", 'fault=[{kind="ghosts", share=0.05, at_s=0}]').summary["swarm"]
    # The figure over 1e5 craft-periods is 1.05 (benchmarks/integrity.py); 2400 of them scatter by some percent.
    assert struck["ekf_position_rms_m"] < 1.3 * clean["ekf_position_rms_m"]
    assert struck["integrity"]["accepted_poses"]["beyond"] == 0
    assert struck["integrity"]["mean_dropped_photodiodes"] > 0.5
    assert clean["integrity"]["mean_dropped_photodiodes"] == 0


@pytest.mark.parametrize("spread_deg", [0.01, 0.05])
def test_ghosts_too_small_to_be_found_stay_within_the_protection_level(flown, spread_deg):
    ghosts = f'fault=[{{kind="ghosts", share=0.02, spread_deg={spread_deg}, at_s=0}}]'
    found = flown("formation", "duration_s=5", ghosts).summary["swarm"]["integrity"]
    assert found["accepted_poses"]["beyond"] == 0
    assert found["estimates"]["beyond"] == 0


def test_without_faults_the_test_changes_nothing_and_without_the_test_ghosts_do_harm(flown):
    with_it, without = (
        flown("formation", "duration_s=2"),
        flown("formation", "duration_s=2", "navigation.integrity.residual_test=false"),
    )
    same = [name for name in with_it.telemetry.column_names if "protection" not in name]
    assert with_it.telemetry.select(same).equals(without.telemetry.select(same))
    ghosts = 'fault=[{kind="ghosts", share=0.05, at_s=0.5, spread_deg=0.2}]'
    blind = flown("formation", "duration_s=2", ghosts, "navigation.integrity.residual_test=false").summary["swarm"]
    assert blind["ekf_position_rms_m"] > 2 * with_it.summary["swarm"]["ekf_position_rms_m"]


def test_a_craft_drops_the_same_photodiodes_alone_and_in_a_swarm():
    ghosts = 'fault=[{kind="ghosts", share=0.05, at_s=0, craft="craft-0"}]'
    one, two = (Flight(swarm.load("formation", [ghosts, f"swarm.count={count}"])) for count in (1, 2))
    # The first craft of a ring is at the same place, however many there are.
    for frame in range(60):
        alone, beside = one.period(frame).estimate, two.period(frame).estimate
        assert alone.integrity.dropped[0] == beside.integrity.dropped[0]
        np.testing.assert_array_equal(alone.position[0], beside.position[0])
        assert beside.integrity.dropped[1] == 0


def test_a_restarted_computer_knows_nothing_and_finds_itself_again(flown):
    run = flown("static", 'fault=[{kind="restart", craft="near", at_s=1, for_s=0.5}]', "duration_s=3")
    status, other = column(run, "status", "near"), column(run, "status", "far")
    assert np.all(status[60:90] == "searching")
    assert np.isnan(column(run, "ekf_px_m", "near")[60:90]).all()
    assert np.all(status[95:] == "tracking")
    assert np.all(other[2:] == "tracking")


def test_a_computer_that_restarts_beside_a_stuck_photodiode_finds_itself_at_once():
    stuck = '{kind="photodiode-stuck", craft="shuttle", photodiodes=[8], at_s=0.2}'
    restart = '{kind="restart", craft="shuttle", at_s=3, for_s=0.2}'
    overrides = [f"fault=[{stuck}, {restart}]", "criteria=[]"]
    flight = Flight(swarm.load("fault-parade", overrides))
    status, error, dropped = [], [], []
    for frame in range(222):
        period = flight.period(frame)
        truth, estimate = period.truth, period.estimate
        assert truth is not None
        status.append(int(estimate.status[2]))
        error.append(np.linalg.norm(estimate.position[2] - truth.position[2]))
        dropped.append(int(estimate.integrity.dropped[2]))
    assert status[180:192] == [Status.SEARCHING] * 12
    # Half a second, and never a wrong pose: its sigma at 3 m is a millimetre.
    assert status[-1] == Status.TRACKING
    assert np.nanmax(error[192:]) < 0.02
    assert dropped[-1] == 1


def test_a_lost_craft_flies_on_as_it_was_kicked(flown):
    lost = (
        'fault=[{kind="craft-lost", craft="near", at_s=1, velocity_m_s=[0.1, 0, 0.2], angular_rate_deg_s=[0, 0, 90]}]'
    )
    run = flown("static", lost, "duration_s=2")
    velocity = np.stack([column(run, f"true_v{a}_m_s", "near") for a in "xyz"], axis=1)
    np.testing.assert_allclose(velocity[62:], np.tile([0.1, 0, 0.2], (58, 1)), atol=2e-3)
    # From then on it nutates as a free body.
    np.testing.assert_allclose(column(run, "true_wz_rad_s", "near")[61], np.pi / 2, atol=1e-3)


def test_a_rotor_that_hunts_is_followed_by_its_flashes(flown):
    drift = 'fault=[{kind="rotor-drift", at_s=1, for_s=2, speed_ppm=500}]'
    steady, hunting = (flown("static", "duration_s=4", *more).summary["swarm"] for more in ((), (drift,)))
    # 500 ppm of 90 degrees are 0.8 mrad: millimetres at metres if they were not taken off.
    assert hunting["ekf_position_rms_m"] < 1.3 * steady["ekf_position_rms_m"]
    assert hunting["integrity"]["accepted_poses"]["beyond"] == 0


def test_missed_flashes_are_predicted_for_a_while(flown):
    run = flown("static", 'fault=[{kind="sync-loss", at_s=1, for_s=0.5}]', "duration_s=2")
    missed, status = column(run, "missed_sync", "near"), column(run, "status", "near")
    assert np.all(missed[60:90] == 2)
    assert (status[60:64] == "tracking").all()
    assert (status[70:90] == "coasting").all()
    assert (status[92:] == "tracking").all()


def test_thrusters_do_not_obey():
    stuck = 'fault=[{kind="thruster-stuck", thruster=2, state="on", at_s=0.1, for_s=0.1, craft="i"}]'
    craft = 'craft=[{name="i", model="cubesat12u", motion={kind="hold"}}]'
    flight = Flight(swarm.load("static", ["swarm.count=0", craft, stuck, "duration_s=1"]))
    opened = []
    for frame in range(20):
        work = flight.period(frame).work
        assert work is not None
        opened.append(work.thrusters_open[0])
    assert opened[:6] == [0] * 6, "at rest nothing fires"
    assert min(opened[6:12]) >= 1


# Mistakes.


@pytest.mark.parametrize(
    ("fault", "words"),
    [
        ('{kind="photodiode-dead", photodiodes=[0]}', "at_s or probability_per_s"),
        ('{kind="photodiode-dead", photodiodes=[0], at_s=1, probability_per_s=0.1}', "at_s or probability_per_s"),
        ('{kind="sync-loss", at_s=1, until_s=0.5}', "must come after at_s"),
        ('{kind="sync-loss", probability_per_s=0.1, until_s=5}', "needs at_s"),
        ('{kind="rotor-drift", at_s=1, for_s=60, speed_ppm=500}', "below 3000"),
        ('{kind="sync-loss", at_s=1, craft="craft-9"}', "craft-9.*: no craft has this name"),
        ('{kind="reflection", at_s=1, mirrors=["carft-1"]}', "did you mean 'craft-1'"),
        ('{kind="ghost", at_s=1, share=0.1}', "did you mean 'ghosts'"),
    ],
)
def test_a_fault_that_makes_no_sense_is_told(fault, words):
    with pytest.raises(SwarmError, match=words):
        swarm.load("formation", [f"fault=[{fault}]"])


def test_a_fault_that_strikes_after_the_end_is_told():
    parade = swarm.load("fault-parade", ["duration_s=16"]).fault
    told = too_late(parade, 16.0)
    late = [i for i, fault in enumerate(parade) if (fault.at_s or 0.0) >= 16]
    assert 0 < len(late) < len(parade)
    assert len(told) == len(late)
    assert told[0] == (
        f"fault[{late[0]}] ({parade[late[0]].kind}) does not strike: at_s = 16 s is not before the end of the run, "
        "duration_s = 16 s"
    )
    assert not too_late(parade, 86400.0)


def test_a_photodiode_or_thruster_that_is_not_there_is_told():
    for fault, words in (
        ('{kind="photodiode-stuck", photodiodes=[12], at_s=0}', "fault.0..photodiodes: .* 'craft-0' has 12"),
        ('{kind="thruster-stuck", thruster=0, state="on", at_s=0}', "fault.0..thruster: .* has 0 thrusters"),
    ):
        with pytest.raises(SwarmError, match=words):
            Flight(swarm.load("formation", [f"fault=[{fault}]"]))


def test_a_scenario_with_faults_is_written_out_and_read_again(tmp_path):
    scenario = swarm.load("fault-parade")
    (tmp_path / "again.toml").write_text(swarm.scenario.to_toml(scenario))
    again = swarm.load(tmp_path / "again.toml")
    assert again.fault == scenario.fault


@pytest.mark.parametrize(
    ("fault", "message"),
    [
        (
            'kind="thruster-stuck", at_s=1, thruster=0',
            "--set: fault[0].state: missing: State in which the thruster is stuck.",
        ),
        ('kind="restart", at_s=1, crft="a"', "--set: fault[0].crft = \"a\": unknown key; did you mean 'craft'?"),
        ('kind="restart", at_s=-1', "--set: fault[0].at_s = -1: must be at least 0 s"),
        ('kind="restart", at_s=1, craft="nobody"', '--set: fault[0].craft[0] = "nobody": no craft has this name'),
    ],
)
def test_a_mistake_in_a_fault_is_told_by_its_place(fault, message):
    with pytest.raises(SwarmError) as raised:
        swarm.load("formation", [f"fault=[{{{fault}}}]"])
    assert message in str(raised.value)
