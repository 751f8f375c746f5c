"""On board: scans become a target's pose in the lighthouse frame, lost and found again, per observer and fused."""

from types import SimpleNamespace
from typing import Any, NamedTuple, cast

import numpy as np
import pytest
from lidar_target import NOISE_M, attitudes, crooked, directions, scan_of

from estimators import rotation as rot
from estimators.arrays import Floats
from estimators.free_rotation import free_turns
from estimators.rotation import quaternion_from_matrix
from estimators.state import State
from swarm.messages import LidarPattern, LidarScan
from swarm.onboard.inspection import LIDAR_SENSOR, Inspection, InspectionSettings, Observer
from swarm.onboard.lidar import at_epoch
from swarm.onboard.settings import Status
from swarm.report.findings import inspections
from swarm.results.columns.core import SENSORS
from swarm.results.lidar_scans import ScanWriter
from swarm.results.period import Period
from swarm.results.summary.scans import scans

PERIOD_S = 0.1
PATTERN = LidarPattern(np.eye(3), np.zeros(3), np.radians(2.0), NOISE_M, PERIOD_S)
TARGET = 2


class Own(NamedTuple):
    """What `Inspection` reads of the navigation's estimate: two observers at rest, and the target's empty row."""

    rotation: Floats
    position: Floats
    angular_rate: Floats
    velocity: Floats
    covariance: Floats
    status: np.ndarray
    nis: Floats
    sensor: np.ndarray
    prediction: None = None
    symmetry: Any = None

    @property
    def state(self) -> State:
        return State(
            rotation=self.rotation, position=self.position, velocity=self.velocity, angular_rate=self.angular_rate
        )


def own() -> Any:
    turn = np.stack([np.eye(3), rot.exp(np.array([0, 0, np.pi / 2])), np.full((3, 3), np.nan)])
    place = np.array([[0.0, 0, 0], [5.0, -5.0, 0], [np.nan] * 3])
    return Own(
        turn,
        place,
        np.zeros((3, 3)),
        np.zeros((3, 3)),
        np.tile(1e-8 * np.eye(12), (3, 1, 1)),
        np.full(3, Status.TRACKING),
        np.full(3, np.nan),
        np.ones(3, dtype=np.int64),
    )


def seen_by(craft, truth, where, rng, time_s):
    me = own()
    turn = me.rotation[craft].T
    scan = scan_of(crooked(), turn @ truth, turn @ (where - me.position[craft]), rng)
    return LidarScan(scan.direction, scan.range_m, np.full(len(scan.range_m), time_s), scan.line, scan.step)


def observers(count):
    return [Observer(craft, TARGET, PATTERN, crooked()) for craft in range(count)]


def test_acquires_tracks_loses_and_finds_again():
    """The target jumps by 90 degrees between two scans, which no tracking can follow; the third is acquired from."""
    rng, rate = np.random.default_rng(0), np.radians([3.0, -2.0, 4.0])
    computer = Inspection(observers(1), InspectionSettings(frame_s=PERIOD_S))
    attitude, where = attitudes(1, seed=1)[0], np.array([5.0, 0.2, -0.1])
    history = []
    for i in range(16):
        attitude = rot.exp(rate * PERIOD_S) @ attitude
        if i == 8:
            attitude = rot.exp(np.radians([90.0, 0, 0])) @ attitude
        fix = computer.step([seen_by(0, attitude, where, rng, i * PERIOD_S)], own(), i * PERIOD_S)[0]
        error = (
            np.degrees(rot.angle_between(attitude, fix.ekf_rotation)) if np.isfinite(fix.ekf_rotation).all() else 180
        )
        history.append((fix.outcome, fix.acquired, fix.accepted, error))
    assert history[0][:3] == ("found", True, True)
    assert [h[0] for h in history[1:8]] == ["tracked"] * 7
    assert history[7][3] < 0.5
    assert history[8][0] not in ("tracked", "found")
    again = [i for i in range(8, 16) if history[i][1]]
    assert again == [10], "two scans without, then acquired from the third itself"
    assert history[10][0] == "found"
    assert [h[0] for h in history[11:]] == ["tracked"] * 5
    assert history[15][3] < 0.5


def test_the_status_says_what_is_known():
    rng = np.random.default_rng(2)
    computer = Inspection(observers(1), InspectionSettings(frame_s=PERIOD_S, coast_limit_s=0.35))
    truth, where = attitudes(1, seed=3)[0], np.array([5.0, 0.0, 0.0])
    assert computer.into(own()).status[TARGET] == Status.SEARCHING
    computer.step([seen_by(0, truth, where, rng, 0.0)], own(), 0.0)
    estimate = computer.into(own())
    assert estimate.status[TARGET] == Status.TRACKING
    assert SENSORS[estimate.sensor[TARGET]] == SENSORS[LIDAR_SENSOR] == "lidar"
    assert estimate.status[0] == Status.TRACKING
    assert estimate.sensor[0] == 1, "the others' rows are as they were"
    nothing = seen_by(0, truth, where, rng, 0.1)._replace(range_m=np.full(len(directions()[0]), np.nan))
    states = []
    for i in range(1, 6):
        fix = computer.step([nothing], own(), i * PERIOD_S)[0]
        assert fix.outcome == "too few returns"
        assert np.isnan(fix.position).all()
        states.append(computer.into(own()).status[TARGET])
    assert states[1] == Status.COASTING
    assert states[-1] == Status.SEARCHING
    assert np.isnan(computer.into(own()).position[TARGET]).all()


def test_an_observer_that_does_not_know_its_own_pose_says_so():
    computer = Inspection(observers(1), InspectionSettings(frame_s=PERIOD_S))
    lost = own()._replace(rotation=np.full((3, 3, 3), np.nan))
    scan = seen_by(0, np.eye(3), np.array([5.0, 0, 0]), np.random.default_rng(4), 0.0)
    fix = computer.step([scan], lost, 0.0)[0]
    assert fix.outcome == "no own fix"
    assert computer.into(own()).status[TARGET] == Status.SEARCHING


def test_two_observers_are_better_than_one_and_the_order_of_frames_is_right():
    rng = np.random.default_rng(5)
    computer = Inspection(observers(2), InspectionSettings(frame_s=PERIOD_S))
    truth, where = attitudes(1, seed=6)[0], np.array([5.0, 0.0, 0.0])
    single, fused = [], []
    for i in range(12):
        scans = [seen_by(craft, truth, where, rng, i * PERIOD_S) for craft in (0, 1)]
        fixes = computer.step(scans, own(), i * PERIOD_S)
        for fix in fixes:
            assert np.degrees(rot.angle_between(truth, fix.rotation)) < 1.0
            assert np.linalg.norm(fix.position - where) < 0.02
            # The cloud lies where the target is, in the lighthouse frame.
            assert np.linalg.norm(np.median(fix.cloud, axis=0) - where) < 1.0
        both = computer.into(own())
        single.append(np.mean([np.trace(fix.ekf_covariance) for fix in fixes]))
        fused.append(np.trace(both.covariance[TARGET][np.ix_([0, 1, 2, 6, 7, 8], [0, 1, 2, 6, 7, 8])]))
    assert np.degrees(rot.angle_between(truth, both.rotation[TARGET])) < 0.5
    assert fused[-1] < 0.8 * single[-1]


def test_one_observer_alone_does_not_overrule_the_others():
    """Observer 1 acquires a pose that is wrong: its own filter may start there, the fused one stays."""
    rng = np.random.default_rng(7)
    computer = Inspection(observers(2), InspectionSettings(frame_s=PERIOD_S))
    truth, where = attitudes(1, seed=8)[0], np.array([5.0, 0.0, 0.0])
    for i in range(4):
        computer.step([seen_by(0, truth, where, rng, i * PERIOD_S), None], own(), i * PERIOD_S)
    # What observer 1 scans is a metre beside the target: it acquires that.
    beside = seen_by(1, truth, where + np.array([1.0, 0, 0]), rng, 4 * PERIOD_S)
    fixes = computer.step([seen_by(0, truth, where, rng, 4 * PERIOD_S), beside], own(), 4 * PERIOD_S)
    assert fixes[1].acquired
    assert fixes[1].outcome == "found"
    assert fixes[1].position == pytest.approx(where + np.array([1.0, 0, 0]), abs=0.02)
    assert computer.into(own()).position[TARGET] == pytest.approx(where, abs=0.02)


def test_a_scan_is_moved_to_its_epoch():
    """Scanner and target move while the scanner turns: with the true rates, the scan is that of a moment."""
    rng = np.random.default_rng(9)
    me = State(
        rotation=np.eye(3),
        position=np.zeros(3),
        velocity=np.array([0.0, 0.4, 0.0]),
        angular_rate=np.radians([0.0, 0.0, 8.0]),
    )
    target = State(
        rotation=attitudes(1, seed=10)[0],
        position=np.array([5.0, 0, 0]),
        velocity=np.array([0.3, 0, 0]),
        angular_rate=np.radians([5.0, -9.0, 7.0]),
    )
    still = scan_of(crooked(), target.rotation, target.position, rng, noise_m=1e-12)
    tau = np.linspace(-0.1, 0.0, len(still.range_m))
    # Every point, moved back to when it was seen, in the scanner's frame of then.
    hit = np.flatnonzero(still.returned)
    then = []
    for i in hit:
        back = rot.exp(target.angular_rate * tau[i])
        x = (
            target.position
            + target.velocity * tau[i]
            + back @ (still.direction[i] * still.range_m[i] - target.position)
        )
        then.append(rot.exp(me.angular_rate * tau[i]).T @ (x - me.velocity * tau[i]))
    points = np.array(then)
    depth = np.linalg.norm(points, axis=1)
    scan = LidarScan(points / depth[:, None], depth, tau[hit], still.line[hit], still.step[hit])
    found = at_epoch(scan, PATTERN, me, target, 0.0)
    assert found.point == pytest.approx(still.point, abs=1e-9)
    unmoved = at_epoch(scan, PATTERN, me, None, 0.0)
    assert np.abs(unmoved.point - still.point).max() > 0.02


def test_ten_seconds_without_a_scan_and_tracked_again_by_the_first(tmp_path):
    """The target tumbles by Euler's equation; its rates and its inertia are found from the scans before.

    Summary and report tell the true principal moments, 16 : 26 : 32 against their mean, within what they promise.
    """
    rng, tensor = np.random.default_rng(9), np.diag([32.0, 16.0, 26.0])[None]
    computer = Inspection(observers(1), InspectionSettings(frame_s=0.25))
    attitude, rate, where = attitudes(1, seed=8)[0], np.radians([3.0, -2.0, 4.0]), np.array([5.0, 0.2, -0.1])
    one, nothing = np.ones(1, dtype=np.bool_), [None]
    for i in range(81):
        step = free_turns(one, attitude[None], rate[None], tensor, np.linalg.inv(tensor), 0.25)
        attitude, rate = rot.exp(step.turn[0]) @ rot.exp(rate * 0.25) @ attitude, rate + step.rate[0]
        seen = i < 40 or i == 80
        scan = [seen_by(0, attitude, where, rng, i * 0.25)] if seen else nothing
        fixes = computer.step(scan, own(), i * 0.25)
        if i == 79:
            known = computer.into(own())
            off = np.concatenate([rot.log(attitude @ known.rotation[TARGET].T), where - known.position[TARGET]])
            columns = np.ix_([0, 1, 2, 6, 7, 8], [0, 1, 2, 6, 7, 8])
            covariance = known.covariance[TARGET][columns]
            assert known.status[TARGET] == Status.COASTING
    assert off @ np.linalg.solve(covariance, off) < 21.0, "99.8 % of six degrees of freedom"
    assert np.degrees(np.sqrt(np.trace(covariance[:3, :3]))) < 5.0, "not by saying that nothing is known"
    assert (fixes[0].outcome, fixes[0].acquired) == ("tracked", False)
    assert np.degrees(rot.angle_between(attitude, fixes[0].rotation)) < 0.7
    writer = ScanWriter(tmp_path, ["a", "b", "t"])
    place = np.stack([np.zeros(3), np.zeros(3), where])
    turn = quaternion_from_matrix(np.stack([np.eye(3), np.eye(3), attitude]))
    truth = SimpleNamespace(position=place, quaternion=turn)
    writer.append(cast(Period, SimpleNamespace(time_s=20.0, frame=200, scans=fixes, truth=truth)))
    writer.close()
    lidar = scans(tmp_path)["lidar"]
    told = lidar["a"]["inertia"]
    moments, sigma = np.array(told["moments"]), np.array(told["moments"]) * told["sigmas"]
    assert sigma.max() < 0.2, "not by saying that nothing is known"
    assert (np.abs(moments - 3 * np.array([16.0, 26.0, 32.0]) / 74) < 3 * sigma).all()
    assert told["observed"] >= 3
    words = " : ".join(f"{m:.3f} ± {s:.3f}" for m, s in zip(moments, sigma, strict=True))
    assert f"principal moments of inertia as {words}, {told['observed']} of 5" in inspections(lidar)[0].text
