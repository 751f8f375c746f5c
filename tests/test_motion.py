"""References: their rates against finite differences, their places against geometry, their draws against statistics."""

from typing import Any

import numpy as np
import pytest
from scipy import stats

from estimators import rotation as rot
from swarm.errors import SwarmError
from swarm.flight import builders
from swarm.scenario import load
from swarm.scenario.motions import (
    Approach,
    Attitude,
    Drift,
    Hold,
    Place,
    Ring,
    Tumble,
    Wander,
    Waypoints,
)
from swarm.scenario.motions.tones import tones
from swarm.world.motion.fleet import Fleet

DEG = 180 / np.pi
TURNED = Attitude(roll_deg=0.3 * DEG, pitch_deg=-0.4 * DEG, yaw_deg=0.2 * DEG, spin_deg_s=0.7 * DEG)
FIXED = Attitude(facing=False, roll_deg=0.1 * DEG, pitch_deg=0.2 * DEG, yaw_deg=0.3 * DEG)
ZIGZAG = ((0.5, 0.2, 3.0), (-0.5, 0.4, 4.0), (-1.0, -0.3, 2.5), (0.0, 0.0, 3.0))
FROM, TO = (1.0, 0.5, 8.0), (0.0, 0.0, 1.0)


def hold(position_m, **more):
    return Hold(kind="hold", position_m=position_m, **more)


def ring(radius_m, rate_rad_s, tilt_rad, centre_m=(0.1, 0.2, 3.0), **more):
    turning = {"rate_deg_s": rate_rad_s * DEG, "tilt_deg": tilt_rad * DEG}
    return Ring(kind="ring", centre_m=centre_m, radius_m=radius_m, **turning, **more)


def waypoints(points_m, times_s, **more):
    return Waypoints(kind="waypoints", points_m=points_m, times_s=times_s, **more)


def approach(from_m=FROM, to_m=TO, start_s=2.0, speed_m_s=1.5, **more):
    return Approach(kind="approach", from_m=from_m, to_m=to_m, start_s=start_s, speed_m_s=speed_m_s, **more)


def wander(size_m, speed_m_s, turn_rad, turn_rate_rad_s, bandwidth_hz, **more):
    turning = {"turn_deg": turn_rad * DEG, "turn_rate_deg_s": turn_rate_rad_s * DEG}
    return Wander(kind="wander", size_m=size_m, speed_m_s=speed_m_s, bandwidth_hz=bandwidth_hz, **turning, **more)


FREE: dict[str, Any] = {"position_m": (0.0, 0.5, 3.0), "velocity_m_s": (0.1, 0.2, -0.1), "attitude": TURNED}
MOTIONS = {
    "hold": hold((0.4, -0.3, 2.0)),
    "hold, spinning": hold((0.4, -0.3, 2.0), attitude=TURNED),
    "ring": ring(1.0, 0.5, 0.4),
    "ring, turned": ring(1.0, -0.5, 1.2, attitude=TURNED),
    "waypoints": waypoints(ZIGZAG, (1.0, 4.0, 6.0, 9.0), attitude=TURNED),
    "one waypoint": waypoints(ZIGZAG[:1], (1.0,)),
    "two waypoints": waypoints(ZIGZAG[:2], (0.0, 5.0)),
    "approach": approach(attitude=TURNED),
    "fixed attitude": approach(
        (1.0, 0.5, 4.0), start_s=0.0, speed_m_s=0.5, attitude=FIXED.model_copy(update={"spin_deg_s": 0.4 * DEG})
    ),
    "tumble": Tumble(kind="tumble", angular_rate_deg_s=(0.4 * DEG, 0.5 * DEG, 0.6 * DEG), **FREE),
    "wander": wander((4.0, 2.0, 3.0), 0.3, 0.5, 0.7, 1.0, centre_m=(0.1, 0.2, 3.0), attitude=TURNED),
    "wander, fixed attitude": wander((1.0, 0.0, 1.0), 0.2, 0.3, 0.2, 0.7, attitude=FIXED),
    "drift": Drift(kind="drift", acceleration_m_s2=0.02, angular_acceleration_deg_s2=0.1 * DEG, **FREE),
}


def fleet(*motions, seed=0):
    return Fleet([motion.course(Place(seed=seed, key=i)) for i, motion in enumerate(motions)], seed)


def swarm_of(motion, count):
    return Fleet([motion.course(Place(i, count)) for i in range(count)])


@pytest.mark.parametrize("time_s", [0.7, 2.3, 3.9, 5.3, 6.8, 20.0])
def test_rates_and_accelerations_are_the_derivatives(time_s):
    """Every motion at once, against central differences: error h^2 / 6 times the third derivative, rounding 1e-16 / h.

    The paths' fourth and fifth derivatives reach 10, those of the facing frame near the lighthouse more: 1e-6 holds.
    """
    flight, h = fleet(*MOTIONS.values()), 1e-4
    before, now, after = (flight.at(time_s + step) for step in (-h, 0, h))
    assert np.allclose(now.velocity, (after.position - before.position) / (2 * h), atol=1e-6)
    assert np.allclose(now.acceleration, (after.velocity - before.velocity) / (2 * h), atol=1e-6)
    turn = rot.log(after.rotation @ np.swapaxes(before.rotation, -1, -2)) / (2 * h)
    assert np.allclose(now.angular_rate, turn, atol=1e-6)
    change = (after.angular_rate - before.angular_rate) / (2 * h)
    assert np.allclose(now.angular_acceleration, change, atol=1e-6)


@pytest.mark.parametrize("name", ["waypoints", "two waypoints", "approach"])
def test_acceleration_has_no_jump(name):
    """Across the whole motion, its ends included: 4 ms never change it by more than the jerk allows."""
    flight = fleet(MOTIONS[name])
    times = np.arange(0, 12, 0.004)
    acceleration = np.array([flight.at(t).acceleration[0] for t in times])
    jump = np.linalg.norm(np.diff(acceleration, axis=0), axis=1).max()
    # Jerk stays below 25 m/s^3 here; a jump would be of the order of the accelerations, 0.3 m/s^2 and more.
    assert jump < 0.1


@pytest.mark.parametrize("name", MOTIONS)
def test_rotations_are_rotations(name):
    for time_s in (0.0, 3.0, 50.0):
        rotation = fleet(MOTIONS[name]).at(time_s).rotation
        assert np.allclose(rotation @ np.swapaxes(rotation, -1, -2), np.eye(3), atol=1e-12)
        assert np.allclose(np.linalg.det(rotation), 1)


def test_facing_looks_at_the_lighthouse_with_down_below():
    flight = fleet(*(hold(p) for p in [(0, 0, 3), (1, 0, 2), (-1, 1, 2), (0, -1.5, 1)]))
    now = flight.at(1.0)
    front = now.rotation[:, :, 2]
    assert np.allclose(front, -now.position / np.linalg.norm(now.position, axis=1, keepdims=True), atol=1e-15)
    assert np.all(now.rotation[:, 1, 1] > 0), "the body's y axis points down"
    assert np.allclose(now.rotation[:, 1, 0], 0, atol=1e-15), "the body's x axis is level"
    # Straight ahead: half a turn about the vertical.
    assert np.allclose(now.rotation[0], np.diag([-1, 1, -1]), atol=1e-15)


def test_offsets_turn_about_body_axes_x_y_z():
    angles = {"yaw_deg": 0, "pitch_deg": 1, "roll_deg": 2}
    for name, axis in angles.items():
        turned = fleet(hold((0, 0, 3), attitude=Attitude(facing=False, **{name: 0.3 * DEG}))).at(0.0)
        assert np.allclose(rot.log(turned.rotation[0]), 0.3 * np.eye(3)[axis], atol=1e-15)
    spun = fleet(hold((0, 0, 3), attitude=Attitude(spin_deg_s=0.5 * DEG))).at(2.0)
    still = fleet(hold((0, 0, 3), attitude=Attitude(roll_deg=DEG))).at(2.0)
    assert np.allclose(spun.rotation, still.rotation, atol=1e-14)


def test_ring_spreads_the_craft_evenly_in_its_plane():
    tilt = 0.4
    now = swarm_of(ring(1.5, 0.2, tilt, (0, 0, 3)), 8).at(7.0)
    arm = now.position - [0, 0, 3]
    normal = rot.exp(np.array([tilt, 0, 0])) @ [0, 0, 1]
    assert np.allclose(np.linalg.norm(arm, axis=1), 1.5)
    assert np.allclose(arm @ normal, 0, atol=1e-14)
    neighbour = np.linalg.norm(arm - np.roll(arm, 1, axis=0), axis=1)
    assert np.allclose(neighbour, 2 * 1.5 * np.sin(np.pi / 8))
    # Right-handed about the normal.
    assert np.allclose(np.cross(0.2 * normal, arm), now.velocity, atol=1e-14)


def test_swarm_grid_is_centred_and_square():
    for count in (1, 2, 4, 7, 9):
        position = swarm_of(hold((1, 2, 3), spacing_m=0.5), count).at(0.0).position
        assert np.allclose((position.max(axis=0) + position.min(axis=0)) / 2, [1, 2, 3])
        gaps = np.linalg.norm(position[:, None] - position[None], axis=2)[np.triu_indices(count, 1)]
        assert np.all(gaps > 0.5 - 1e-12)
        assert np.all(position[:, 2] == 3)
    assert np.allclose(np.ptp(position, axis=0), [1, 1, 0])


def test_waypoints_are_met_at_rest_at_both_ends():
    flight, times = fleet(MOTIONS["waypoints"]), (1.0, 4.0, 6.0, 9.0)
    for point, time_s in zip(ZIGZAG, times, strict=True):
        assert np.allclose(flight.at(time_s).position[0], point, atol=1e-12)
    for time_s in (0.0, 1.0, 9.0, 30.0):
        now = flight.at(time_s)
        assert np.allclose([now.velocity, now.acceleration], 0, atol=1e-11)
        assert np.allclose(now.position[0], ZIGZAG[0 if time_s <= 1 else -1], atol=1e-12)


def test_waypoints_are_never_overshot():
    """In no coordinate beyond the two neighbouring points, for random points at very uneven times."""
    random = np.random.default_rng(5)
    for _ in range(20):
        points = random.uniform(-2, 2, (6, 3))
        times = np.cumsum(10 ** random.uniform(-1, 1, 6))
        flight = fleet(waypoints(points.tolist(), times.tolist()))
        for i in range(5):
            low, high = np.sort(points[i : i + 2], axis=0)
            for time_s in np.linspace(times[i], times[i + 1], 40):
                position = flight.at(time_s).position[0]
                assert np.all(position >= low - 1e-9)
                assert np.all(position <= high + 1e-9)


def test_two_waypoints_make_the_minimum_jerk_motion():
    """The closed form 10 s^3 - 15 s^4 + 6 s^5 (Flash and Hogan 1985)."""
    flight = fleet(MOTIONS["two waypoints"])
    a, b = np.array(ZIGZAG[0]), np.array(ZIGZAG[1])
    for s in (0.1, 0.5, 0.83):
        expected = a + (b - a) * (10 * s**3 - 15 * s**4 + 6 * s**5)
        assert np.allclose(flight.at(5 * s).position[0], expected, atol=1e-12)


def test_approach_flies_its_corridor_at_its_speed():
    motion = MOTIONS["approach"]
    flight = fleet(motion)
    a, b = np.array(motion.from_m), np.array(motion.to_m)
    length = np.linalg.norm(b - a)
    end_s = motion.start_s + 1.25 * length / motion.speed_m_s
    now = [flight.at(t) for t in np.linspace(0, end_s + 1, 400)]
    arm = np.array([n.position[0] for n in now]) - a
    off = arm - np.outer(arm @ (b - a), b - a) / length**2
    assert np.allclose(off, 0, atol=1e-12)
    speed = np.array([np.linalg.norm(n.velocity[0]) for n in now])
    assert speed.max() == pytest.approx(1.5, abs=1e-12)
    assert np.allclose(flight.at(motion.start_s).position[0], a, atol=1e-12)
    assert np.allclose(flight.at(end_s).position[0], b, atol=1e-12)
    assert np.linalg.norm(flight.at(end_s - 0.05).position[0] - b) > 1e-6, "not there before its time"
    assert np.all(np.diff(arm @ (b - a)) >= -1e-12), "never backwards"


def test_start_is_the_reference_at_time_zero():
    flight = fleet(*MOTIONS.values())
    start, first = flight.start(), flight.at(0.0)
    assert np.array_equal(start.position, first.position)
    assert np.array_equal(start.velocity, first.velocity)
    assert np.array_equal(start.angular_rate, first.angular_rate)
    assert np.allclose(rot.matrix_from_quaternion(start.quaternion), first.rotation, atol=1e-14)


def test_free_motions_are_not_held():
    now = fleet(*MOTIONS.values()).at(1.0)
    free = np.array([name in ("tumble", "drift") for name in MOTIONS])
    assert np.array_equal(now.holds_position, ~free)
    assert np.array_equal(now.holds_attitude, ~free)
    start = fleet(MOTIONS["tumble"]).start()
    spin_axis = rot.matrix_from_quaternion(start.quaternion[0])[:, 2]
    assert np.allclose(start.angular_rate[0], [0.4, 0.5, 0.6] + 0.7 * spin_axis)


def test_one_fleet_equals_many():
    """The batch against one craft at a time, bit for bit."""
    together = fleet(*MOTIONS.values()).at(3.3)
    for i, (name, motion) in enumerate(MOTIONS.items()):
        if "wander" in name:  # Its draws go by the craft's key, here its place.
            continue
        alone = fleet(motion).at(3.3)
        for batch, single in zip(together, alone, strict=True):
            assert np.array_equal(batch[i], single[0])


def test_no_craft_at_all():
    assert fleet().at(1.0).position.shape == (0, 3)
    assert fleet().disturbance(0).acceleration.shape == (0, 3)


# Drift


def test_drift_draws_do_not_depend_on_company_or_order():
    drift = MOTIONS["drift"]
    alone, company = fleet(drift, seed=3), fleet(drift, drift, hold((0, 0, 3)), seed=3)
    frames = [0, 1, 255, 256, 700, 5, 256]
    for frame in frames:
        assert np.array_equal(alone.disturbance(frame).acceleration[0], company.disturbance(frame).acceleration[0])
    again = fleet(drift, seed=3)
    for frame in reversed(frames):
        one, other = alone.disturbance(frame), again.disturbance(frame)
        assert np.array_equal(one.angular_acceleration, other.angular_acceleration)
    assert not np.array_equal(alone.disturbance(1).acceleration, fleet(drift, seed=4).disturbance(1).acceleration)
    both = company.disturbance(1).acceleration
    assert not np.array_equal(both[0], both[1])
    assert not company.disturbance(1).acceleration[2].any()


def test_drift_is_white_with_its_sigma():
    """Chi-square band of the variance and the normal band of the lag-1 correlation, both at 99.99 % two-sided."""
    flight = fleet(*[MOTIONS["drift"]] * 3, seed=11)
    draws = [flight.disturbance(frame) for frame in range(2000)]
    for sigma, sample in (
        (0.02, np.array([d.acceleration for d in draws])),
        (0.1, np.array([d.angular_acceleration for d in draws])),
    ):
        low, high = stats.chi2.ppf([5e-5, 1 - 5e-5], sample.size)
        assert low < np.sum((sample / sigma) ** 2) < high
        correlation = np.mean(sample[1:] * sample[:-1]) / sigma**2
        assert abs(correlation) < stats.norm.ppf(1 - 5e-5) / np.sqrt(sample[1:].size)


# Mistakes


@pytest.mark.parametrize(
    ("motion", "message"),
    [
        (lambda: waypoints(ZIGZAG, (0.0, 1.0)), "2 times for 4 points_m"),
        (lambda: waypoints((), ()), "points_m"),
        (lambda: waypoints(ZIGZAG[:2], (1.0, 1.0)), "increase strictly"),
        (lambda: approach((0, 0, 3), (0, 0, 3)), "must differ from from_m"),
        (lambda: approach(speed_m_s=0.0), "speed_m_s"),
    ],
)
def test_motions_without_sense(motion, message):
    with pytest.raises(SwarmError, match=message):
        motion()


def test_nobody_faces_the_lighthouse_from_beside_it():
    with pytest.raises(SwarmError, match=r"\[0.0, 1.0, 0.0\] m cannot face the lighthouse"):
        fleet(hold((0.0, 1.0, 0.0)))


def test_a_box_is_filled_evenly_and_places_do_not_depend_on_the_number() -> None:
    """Boxes from one corner hold their share of the places, twice as nearly as of random ones at least."""
    size, centre = np.array([4.0, 2.0, 1.0]), np.array([1.0, 0.0, 5.0])
    motion = hold((1.0, 0.0, 5.0), box_m=(4.0, 2.0, 1.0))
    many, few = (swarm_of(motion, count).at(0.0).position for count in (500, 20))
    np.testing.assert_array_equal(few, many[:20])
    np.testing.assert_allclose(many[0], centre)
    share = (many - centre) / size + 0.5
    assert share.min() >= 0
    assert share.max() < 1
    rng = np.random.default_rng(0)
    corners = rng.random((2000, 3))

    def discrepancy(places: np.ndarray) -> float:
        inside = (places[None] < corners[:, None]).all(axis=-1).mean(axis=1)
        return float(np.abs(inside - corners.prod(axis=1)).max())

    assert discrepancy(share) < 0.5 * np.median([discrepancy(rng.random((500, 3))) for _ in range(9)])


def test_wandering_keeps_to_its_bounds_its_speed_and_its_band():
    """An hour: RMS of 8 tones, the slowest of a minute, averages to 2 %; the bounds are exact."""
    bound, speed, step_s = np.array([2.0, 1.0, 1.5, 0.5]), np.array([0.2, 0.1, 0.2, 0.4]), 0.2
    made = tones(bound, speed, 1.0, np.random.default_rng(5))
    value, rate = (np.array(each) for each in zip(*(made.at(t)[:2] for t in np.arange(0, 3600, step_s)), strict=True))
    assert np.all(np.abs(value) <= bound)
    # It uses its room: by construction all tones together reach just the bound.
    assert np.all(np.ptp(value, axis=0) > 0.6 * 2 * bound)
    assert np.sum(made.amplitude, axis=1) == pytest.approx(bound)
    assert np.sqrt(np.mean(rate**2, axis=0)) == pytest.approx(speed, rel=0.06)
    power = np.abs(np.fft.rfft(rate * np.hanning(len(rate))[:, None], axis=0)) ** 2
    above = np.fft.rfftfreq(len(rate), step_s) > 1.01
    assert power[above].sum() < 1e-6 * power.sum()


def test_wandering_follows_from_the_seed_and_the_craft_alone():
    motion = MOTIONS["wander"]
    alone, among = fleet(motion, seed=3).at(2.0), fleet(motion, motion, seed=3).at(2.0)
    assert np.array_equal(alone.position[0], among.position[0])
    assert not np.allclose(among.position[0], among.position[1])
    assert not np.allclose(fleet(motion, seed=4).at(2.0).position, alone.position)


@pytest.mark.parametrize("motion", ['{kind="wander"}', '{kind="drift"}'])
def test_adding_a_craft_does_not_change_the_motion_of_another(motion, tmp_path):
    """A craft alone and among others, which come before it: bit for bit the same."""
    own = f'[[craft]]\nname = "own"\nmotion = {motion}\n'
    others = "".join(f'[[craft]]\nname = "other-{i}"\nmotion = {motion}\n' for i in range(3))
    file = tmp_path / "some.toml"
    made = []
    for text in (own, f"[swarm]\ncount = 2\nmotion = {motion}\n{others}{own}"):
        file.write_text(text)
        made.append(builders.fleet(load(file, seed=5)))
    alone, among = made
    for time_s in (0.0, 1.3, 20.0):
        for one, many in zip(alone.at(time_s), among.at(time_s), strict=True):
            assert np.array_equal(one[0], many[-1])
    for frame in (0, 300):
        push, pushes = alone.disturbance(frame), among.disturbance(frame)
        assert np.array_equal(push.acceleration[0], pushes.acceleration[-1])
        assert np.array_equal(push.angular_acceleration[0], pushes.angular_acceleration[-1])
    # And no two craft share their draws.
    drawn = among.disturbance(0).acceleration if "drift" in motion else among.at(1.3).position
    assert len(np.unique(drawn, axis=0)) == 6


def test_wandering_too_fast_for_its_box_is_refused():
    with pytest.raises(SwarmError, match=r"cannot stay within 0\.1 of the middle at bandwidth_hz = 0\.5"):
        fleet(wander((0.2, 0.2, 0.2), 1.0, 0.5, 0.5, 0.5))
