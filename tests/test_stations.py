"""Several stations as physics: whose light meets what and when, overlaps, words, flashes that take turns."""

from typing import Any, NamedTuple

import mujoco
import numpy as np
import pytest
from scipy.optimize import brentq
from scipy.spatial.transform import Rotation, Slerp

from estimators.frame import WORLD, Frame
from estimators.lighthouse.rotor import CHANNEL_CLOCK_HZ, CHANNEL_TICKS
from estimators.lighthouse.sweep import FanErrors, kernel_fans, lighthouse_1, lighthouse_2, measured_angles
from estimators.lighthouse.tilted import TiltedErrors
from swarm.draws import key_of
from swarm.errors import SwarmError
from swarm.flight import builders
from swarm.hardware import Photodiodes
from swarm.onboard.decoder import PulseDecoder
from swarm.random import Purpose
from swarm.scenario import Lighthouse as Receiver
from swarm.scenario import Pointing, Scenario, Swarm, load
from swarm.scenario.stations import Station, channels
from swarm.sensors.lighthouse import Lighthouse
from swarm.sensors.passage import Sweeps, no_passages, pass_into, segments
from swarm.sensors.sight import Sight
from swarm.sensors.stations import SLOT_S, Emitter, Stations

PERIOD_S, STEPS = 1 / 60, 8
QUIET = Receiver(angle_noise_arcsec=0.0)
SECOND = lighthouse_2(
    TiltedErrors(0.01, -0.045, 0.3, 1.0, 0.004, 0.5, 0.35), TiltedErrors(-0.02, 0.05, -0.2, 2.0, 0.003, 1.5, 0.4)
)
FIRST = lighthouse_1(FanErrors(0.02, 0.01, -0.01, 0.5, 0.01), FanErrors(-0.01, 0.02, 0.01, 1.5, 0.02))


class Moving(NamedTuple):
    """The motion of C craft over one period, at knots."""

    time_s: np.ndarray
    position: np.ndarray
    quaternion: np.ndarray


def moving(rng: np.random.Generator, craft: int, frame: int = 0) -> Moving:
    """Return craft 2 m to 4 m ahead, which turn and move as fast as a thrown one."""
    time_s = (frame + np.arange(STEPS + 1) / STEPS) * PERIOD_S
    start = rng.uniform([-0.8, -0.8, 2], [0.8, 0.8, 4], (craft, 3))
    velocity, rate = rng.normal(0, 3, (2, craft, 3))
    wobble = np.cumsum(rng.normal(0, 2e-3, (STEPS + 1, craft, 3)), axis=0)
    position = start + velocity * (time_s - time_s[0])[:, None, None] + wobble
    turn = Rotation.random(craft, random_state=rng)
    quaternion = np.stack(
        [(Rotation.from_rotvec(rate * (t - time_s[0])) * turn).as_quat()[:, [3, 0, 1, 2]] for t in time_s]
    )
    return Moving(time_s, position, quaternion)


def emitter(name: str, channel: int, **values: Any) -> Emitter:
    """Return a station without rays, whose light reaches what a test says."""
    usual = {
        "key": sum(map(ord, name)),
        "fans": SECOND if channel else FIRST,
        "noise_rad": 0.0,
        "correlation": 0.3,
        "beam_m": 0.0,
        "phase": 0.3,
        "craft": -1,
        "frame": WORLD,
        "visibility": None,
    }
    return Emitter(name=name, channel=channel, **{**usual, **values})


def layout(rng: np.random.Generator, craft: int, count: int = 5) -> Photodiodes:
    """Return photodiodes anywhere on craft 0.2 m across."""
    normals = rng.normal(size=(craft, count, 3))
    normals /= np.linalg.norm(normals, axis=-1, keepdims=True)
    return Photodiodes(rng.uniform(-0.1, 0.1, (craft, count, 3)), normals, np.ones((craft, count), dtype=bool))


def station(rng: np.random.Generator, emitters: list[Emitter], light: Receiver = QUIET, craft: int = 3) -> Stations:
    """Return the light of stations on craft."""
    turns = 1 if emitters[0].channel else len(emitters)
    keys = list(range(craft))
    return Stations(Lighthouse(layout(rng, craft), light, 5, keys), emitters, 5, keys, turns / light.rate_hz)


def everywhere(light: Stations) -> np.ndarray:
    """Return that every photodiode is lit from every station."""
    return np.ones((*light.photodiodes.present.shape, light.looks * len(light.emitters)), dtype=bool)


def pose_at(motion: Moving, craft: int, t: float) -> tuple[np.ndarray, Rotation]:
    """Return a craft's pose as SciPy interpolates it, beyond the ends as in the last interval."""
    knot = motion.time_s - motion.time_s[0]
    j = int(np.clip(np.searchsorted(knot, t, side="right") - 1, 0, STEPS - 1))
    turns = Rotation.from_quat(motion.quaternion[j : j + 2, craft][:, [1, 2, 3, 0]])
    share = (t - knot[j]) / (knot[j + 1] - knot[j])
    position = motion.position[j, craft] + share * (motion.position[j + 1, craft] - motion.position[j, craft])
    turned = Rotation.from_rotvec(share * (turns[1] * turns[0].inv()).as_rotvec()) * turns[0]
    if 0 <= share <= 1:
        assert turned.approx_equal(Slerp([0, 1], turns)(share), atol=1e-12)
    return position, turned


@pytest.mark.parametrize("channel", [0, 3])
@pytest.mark.parametrize("rides", [False, True])
def test_passages_are_where_a_root_finder_finds_them(channel: int, rides: bool) -> None:
    rng = np.random.default_rng(3)
    motion = moving(rng, 4)
    if rides:
        frame = Frame(Rotation.from_rotvec([0.1, 0.2, -0.1]).as_matrix(), np.array([0.05, 0.1, -0.1]))
        # The bearer, craft 3, looks at the others from behind.
        motion.position[:, 3] += np.array([0.0, 0.0, -3.0]) - motion.position[0, 3]
        back = Rotation.from_quat(motion.quaternion[0, 3][[1, 2, 3, 0]]).inv()
        for k in range(STEPS + 1):
            turned = Rotation.from_quat(motion.quaternion[k, 3][[1, 2, 3, 0]]) * back
            motion.quaternion[k, 3] = turned.as_quat()[[3, 0, 1, 2]]
        source = emitter("s", channel, craft=3, frame=frame)
    else:
        source = emitter("s", channel, frame=Frame(np.eye(3), np.array([0.3, -0.2, -0.5])))
    light = station(rng, [source], craft=4)
    lit = everywhere(light)
    lit[2:], lit[:, 3:] = False, False
    found, count = light._passages(motion, 0, lit)
    turn_s = CHANNEL_TICKS[channel - 1] / CHANNEL_CLOCK_HZ if channel else 1 / 60
    checked = 0
    for plane in range(2):
        share = (1 + plane) / 3 + 0.3 if channel else 0.25 + plane / 2
        for number in range(-2, 2) if channel else (0,):
            boresight = (number + share) * turn_s
            for c in range(2):
                for k in range(3):

                    def off(
                        t: float, c: int = c, k: int = k, plane: int = plane, boresight: float = boresight
                    ) -> float:
                        p, turned = pose_at(motion, c, t)
                        place = p + turned.apply(light.photodiodes.point_m[c, k])
                        if rides:
                            bearer, turned = pose_at(motion, 3, t)
                            origin = bearer + turned.apply(source.frame.position)
                            q = source.frame.rotation.T @ turned.inv().apply(place - origin)
                        else:
                            q = place - source.frame.position
                        angle = measured_angles(q, source.fans)[plane]
                        return float(angle - 2 * np.pi / turn_s * (t - boresight))

                    t = brentq(off, boresight - turn_s / 4, boresight + turn_s / 4, xtol=1e-13, rtol=1e-14)
                    own = (found.craft[:count] == c) & (found.photodiode[:count] == k)
                    own &= (found.plane[:count] == plane) & (found.sweep[:count] == number)
                    assert own.sum() == (0 <= t < PERIOD_S)
                    if own.any():
                        assert abs(found.instant_s[:count][own][0] - t) < 1e-9
                        checked += 1
    assert checked == count >= 6


def test_every_sweep_is_logged_once_whatever_period_it_falls_into() -> None:
    rng = np.random.default_rng(0)
    light = station(rng, [emitter("a", 16), emitter("b", 1, phase=0.9)], craft=2)
    still = moving(rng, 2)
    still.position[:], still.quaternion[:] = still.position[0], still.quaternion[0]
    seen: dict[tuple[int, ...], int] = {}
    periods = 40
    for frame in range(periods):
        now = still._replace(time_s=still.time_s + frame * PERIOD_S)
        found, count = light._passages(now, frame, everywhere(light))
        for i in range(count):
            name = tuple(int(part[i]) for part in found[:5])
            seen[name] = seen.get(name, 0) + 1
    assert set(seen.values()) == {1}
    for s, channel in enumerate((16, 1)):
        turns = periods * PERIOD_S * CHANNEL_CLOCK_HZ / CHANNEL_TICKS[channel - 1]
        for c in range(2):
            for k in range(5):
                numbers = sorted(n for (cc, kk, ss, plane, n) in seen if (cc, kk, ss, plane) == (c, k, s, 0))
                assert np.all(np.diff(numbers) == 1)
                assert abs(len(numbers) - turns) <= 1


def test_hits_of_a_craft_do_not_depend_on_the_others() -> None:
    rng = np.random.default_rng(1)
    sources = [emitter("a", 1, noise_rad=1e-4), emitter("b", 2, noise_rad=1e-4, phase=0.7)]
    receiver = Receiver(lost_pulse_probability=0.2)
    light = station(rng, sources, receiver, craft=3)
    motion = moving(rng, 3)
    of_all = light.shine(motion, 7, everywhere(light))[1]
    photodiodes = light.photodiodes
    alone = Stations(Lighthouse(photodiodes.of(1), receiver, 5, [1]), sources, 5, [1], PERIOD_S)
    one = Moving(motion.time_s, motion.position[:, 1:2], motion.quaternion[:, 1:2])
    own = alone.shine(one, 7, everywhere(alone))[1]
    assert of_all is not None
    assert own is not None
    n = int(own.total[0])
    assert n == of_all.total[1] > 5
    for name in ("photodiode", "rise_tick", "width_tick", "channel", "offset_tick"):
        assert np.array_equal(getattr(own, name)[0, :n], getattr(of_all, name)[1, :n]), name


def test_overlapping_beams_are_lost_by_time_as_often_as_the_closed_form_says() -> None:
    rng = np.random.default_rng(2)
    sources = [
        emitter(f"s{i}", i + 1, fans=lighthouse_2(TiltedErrors(), TiltedErrors()), phase=p)
        for i, p in enumerate(rng.uniform(size=16))
    ]
    light = station(rng, sources, craft=8)
    motion = moving(rng, 8)
    # Near, where a hit lasts longest, and at rest.
    motion.position[:] = motion.position[0] * [0.1, 0.1, 0.3]
    motion.quaternion[:] = motion.quaternion[0]
    width = np.zeros((16, 8, 5))
    logged = met = 0
    for frame in range(150):
        now = motion._replace(time_s=motion.time_s + frame * PERIOD_S)
        found, count = light._passages(now, frame, everywhere(light))
        width[found.station[:count], found.craft[:count], found.photodiode[:count]] = found.width_s[:count]
        hits = light._beams(frame, found, count)
        met, logged = met + count, logged + int(hits.total.sum())
        # No hit is lost otherwise.
        assert light.overlaps is not None
        assert np.array_equal(np.bincount(found.craft[:count], minlength=8) - hits.total, light.overlaps)
    turn_s = np.array(CHANNEL_TICKS) / CHANNEL_CLOCK_HZ
    # (1) of swarm.sensors.reception, of all pairs; few hits are overlapped twice.
    pair = 2 * (width[:, None] + width[None]) / turn_s[None, :, None, None]
    pair[np.arange(16), np.arange(16)] = 0
    lost = (1 - np.prod(1 - pair, axis=1)).mean(axis=(1, 2))
    expected = float(np.average(lost, weights=1 / turn_s))
    assert expected > 0.03
    # 160 000 hits of which one in 33 is lost, mostly two at once: one sigma is 2 %.
    assert (met - logged) / met == pytest.approx(expected, rel=0.1)


def test_a_hit_knows_its_station_only_by_two_words() -> None:
    rng = np.random.default_rng(4)
    near = station(rng, [emitter("s", 5, beam_m=4e-3)], craft=1)
    far = station(rng, [emitter("s", 5, beam_m=4e-3, frame=Frame(np.eye(3), np.array([0, 0, -12.0])))], craft=1)
    motion = moving(rng, 1)
    motion.position[:, 0] = [0.1, 0.1, 3.0]
    for light, known in ((near, True), (far, False)):
        hits = light.shine(motion, 1, everywhere(light))[1]
        assert hits is not None
        assert hits.total[0] > 4
        assert ((hits.channel == 5).all() and (hits.offset_tick > 0).all()) == known
        assert known or not hits.channel.any()
    lit = everywhere(near)
    lit[:, 1:] = False
    hits = near.shine(motion, 1, lit)[1]
    assert hits is not None
    assert hits.total[0] > 0
    assert not hits.channel.any()
    # What the bits say is the angle, to a tick.
    hits = near.shine(motion, 1, everywhere(near))[1]
    found, count = near._passages(motion, 1, everywhere(near))
    assert hits is not None
    tick = near.settings.tick_s
    for i, order in enumerate(np.argsort(found.instant_s[:count])):
        zero = (found.sweep[order] + 0.3) * near._turn_s(near.emitters[0]) - PERIOD_S
        assert hits.offset_tick[0, i] == pytest.approx((found.instant_s[order] - zero) / tick, abs=0.51)
        middle = hits.rise_tick[0, i] + hits.width_tick[0, i] / 2 - near._start_tick(1)[0]
        assert middle == pytest.approx(found.instant_s[order] / tick, abs=0.51)


def test_lighthouse_1_stations_take_turns_and_their_decoders_tell_them_apart() -> None:
    rng = np.random.default_rng(6)
    frames = [Frame(np.eye(3), np.zeros(3)), Frame(np.eye(3), np.array([0.4, 0.1, 0.2]))]
    light = station(rng, [emitter("a", 0, frame=frames[0]), emitter("b", 0, frame=frames[1])], craft=2)
    decoders = [
        PulseDecoder(light.photodiodes.present, light.settings.tick_s, frame_s=2 / 60, slot=slot) for slot in (0, 1)
    ]
    still = moving(rng, 2)
    still.position[:], still.quaternion[:] = still.position[0], still.quaternion[0]
    turn = Rotation.from_quat(still.quaternion[0][:, [1, 2, 3, 0]])
    for frame in range(3):
        time_s = (frame + np.arange(STEPS + 1) / STEPS) * 2 * PERIOD_S
        pulses, beams = light.shine(still._replace(time_s=time_s), frame, everywhere(light))
        assert beams is None
        for slot, decoder in enumerate(decoders):
            got = decoder.decode(pulses)
            assert got.lit.all()
            assert got.missed_sync.sum() == 0
            for c in range(2):
                place = still.position[0, c] + turn[c].apply(light.photodiodes.point_m[c]) - frames[slot].position
                wanted = np.pi / 2 + measured_angles(place, FIRST)
                # Three roundings to ticks of 20 ns, at 2 pi 60 rad/s.
                assert np.abs(got.theta[c] - wanted).max() < 3 * 20e-9 * 2 * np.pi * 60
            start = light._start_tick(frame)
            wanted = start + ((slot + 0.5) * PERIOD_S + slot * SLOT_S) / light.settings.tick_s
            assert np.abs(got.epoch_tick - wanted).max() <= 1


CORNER = """
duration_s = 1.0
[swarm]
count = 12
motion = { kind = "hold", position_m = [0.0, 0.0, 3.0], spacing_m = 0.2 }
[[craft]]
model = "satellite"
passive = true
motion = { kind = "hold", position_m = [-1.2, -0.15, 2.0], attitude = { facing = false } }
[[station]]
name = "left"
position_m = [-2.5, -0.3, 1.0]
attitude = { towards_m = [0.0, 0.0, 3.0] }
[[station]]
name = "above"
position_m = [0.1, -2.0, 2.0]
attitude = { towards_m = [0.0, 0.0, 3.0], roll_deg = 20.0 }
[[station]]
name = "chief"
craft = "craft-5"
position_m = [0.0, 0.0, 0.1]
"""


def scenario_of(text: str, tmp_path: Any) -> Scenario:
    """Return a scenario from its text."""
    file = tmp_path / "corner.toml"
    file.write_text(text)
    return load(file)


def test_sight_from_every_station_is_that_of_mj_ray(tmp_path: Any) -> None:
    settings = scenario_of(CORNER, tmp_path)
    motions = builders.fleet(settings)
    world = builders.world(settings, motions)
    suite = builders.sensors(settings, world, motions)
    nothing = np.zeros((13, 3))
    truth = world.advance(nothing, nothing)
    sight = suite.sight(truth)
    assert world.stations == ("left", "above")
    data = mujoco.MjData(world.model)
    k = STEPS // 2
    pose = np.concatenate([truth.position[k], truth.quaternion[k]], axis=1)
    data.qpos[:] = pose.ravel()
    mujoco.mj_kinematics(world.model, data)
    mockup = world.photodiodes
    blocked = lit = 0
    for s, table in enumerate(settings.station):
        at = builders.stations.frame(table)
        if table.craft is not None:
            body = Rotation.from_quat(truth.quaternion[k, 5][[1, 2, 3, 0]]).as_matrix()
            at = Frame(body @ at.rotation, truth.position[k, 5] + body @ at.position)
        own = world.station_bodies[s] if s < 2 else -1
        for c in range(12):
            turn = Rotation.from_quat(truth.quaternion[k, c][[1, 2, 3, 0]]).as_matrix()
            for d in range(12):
                ray = truth.position[k, c] + turn @ mockup.point_m[c, d] - at.position
                reach = float(np.linalg.norm(ray))
                q = at.rotation.T @ ray
                half = np.tan(np.radians(60))
                inside = q[2] > 0 and max(abs(q[0]), abs(q[1])) <= half * q[2] and 0.3 <= reach <= 20
                inside = inside and -(turn @ mockup.normal[c, d]) @ ray / reach >= np.cos(np.radians(80))
                hit = mujoco.mj_ray(world.model, data, at.position, ray / reach, None, 1, own, np.zeros(1, np.int32))
                free = not 0 <= hit < reach - 1e-3
                wanted = Sight.OUTSIDE if not inside else Sight.LIT if free else Sight.BLOCKED
                assert sight[c, d, s] == wanted, (table.name, c, d)
                lit, blocked = lit + (wanted == Sight.LIT), blocked + (wanted == Sight.BLOCKED)
    assert lit > 50
    assert blocked > 10
    assert np.array_equal(suite.seen(sight), sight.max(axis=2))


def test_stations_point_where_they_should() -> None:
    there = builders.stations.frame(
        Station(name="a", position_m=(3.0, 0.0, 3.0), attitude=Pointing(towards_m=(0.0, 0.0, 3.0)))
    )
    assert np.allclose(there.rotation @ [0, 0, 1], [-1, 0, 0])
    assert np.allclose(there.rotation @ [0, 1, 0], [0, 1, 0])
    straight = builders.stations.frame(
        Station(name="a", position_m=(0.0, -2.0, 0.0), attitude=Pointing(towards_m=(0.0, 0.0, 0.0)))
    )
    assert np.allclose(straight.rotation @ [0, 0, 1], [0, 1, 0])
    assert np.linalg.det(straight.rotation) == pytest.approx(1)
    turned = builders.stations.frame(Station(name="a", attitude=Pointing(pitch_deg=90.0)))
    assert np.allclose(turned.rotation @ [0, 0, 1], [1, 0, 0])


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"station[1].name": "left"}, "another station has this name"),
        ({"station[1].name": "craft-3"}, "is the name of a craft"),
        ({"station[1].craft": "craft-99"}, "no craft has this name"),
        ({"station[1].kind": "lighthouse-1"}, "of one kind"),
        ({"station[0].channel": 2, "station[1].channel": 2}, "another station has this channel"),
        ({"station[0].fan_x.curve": 0.1}, "has no fan_x"),
        ({"station[0].attitude.towards_m": [-2.5, -0.3, 1.0]}, "cannot look at its own place"),
        ({"lighthouse.sync_jitter_ns": 10.0}, "has no flash"),
        ({"lighthouse.fan_x.curve": 0.1}, "errors of its own"),
        ({"navigation.coupling": "loose"}, "by rows"),
        ({"station[0].beam_mm": 51.0}, "would light a whole craft"),
    ],
)
def test_mistakes_of_stations_are_told(change: dict[str, Any], said: str, tmp_path: Any) -> None:
    file = tmp_path / "corner.toml"
    file.write_text(CORNER)
    with pytest.raises(SwarmError, match=said):
        load(file, change)


def test_channels_and_counts() -> None:
    tables = [Station(name="a"), Station(name="b", channel=1), Station(name="c"), Station(name="d", channel=7)]
    assert channels(tables) == [2, 1, 3, 7]
    many = tuple(Station(name=f"s{i}", kind="lighthouse-1") for i in range(3))
    with pytest.raises(SwarmError, match="at most 2 stations"):
        Scenario(station=many, swarm=Swarm(count=1))
    assert Scenario(station=many[:2], swarm=Swarm(count=1)).period_s == 2 / 60


def test_a_sweep_shares_the_error_of_the_rotor() -> None:
    rng = np.random.default_rng(8)
    light = station(rng, [emitter("s", 4, noise_rad=1e-3, correlation=0.4)], craft=6)
    quiet = station(np.random.default_rng(8), [emitter("s", 4)], craft=6)
    still = moving(rng, 6)
    still.position[:], still.quaternion[:] = still.position[0], still.quaternion[0]
    w = 2 * np.pi * CHANNEL_CLOCK_HZ / CHANNEL_TICKS[3]
    errors = []
    for frame in range(120):
        now = still._replace(time_s=still.time_s + frame * PERIOD_S)
        noisy, n = light._passages(now, frame, everywhere(light))
        plain, m = quiet._passages(now, frame, everywhere(quiet))
        late = {tuple(int(p[i]) for p in noisy[:5]): noisy.instant_s[i] for i in range(n)}
        pairs: dict[tuple[int, int], list[float]] = {(name[3], name[4]): [] for name in late}
        for i in range(m):
            name = tuple(int(p[i]) for p in plain[:5])
            if name in late:
                pairs[name[3], name[4]].append(w * (late[name] - plain.instant_s[i]))
        errors += [np.array(sweep) for sweep in pairs.values() if len(sweep) == 30]
    each = np.array(errors)
    assert len(each) > 150
    # Of some 200 sweeps the variance of their means is known to 10 %, that about them to 2 %.
    assert each.mean(axis=1).var() == pytest.approx(1e-6 * (0.4 + 0.6 / 30), rel=0.3)
    assert each.var(axis=1, ddof=1).mean() == pytest.approx(0.6e-6, rel=0.1)


def test_no_sweep_is_found_behind_a_station() -> None:
    rng = np.random.default_rng(9)
    motion = moving(rng, 1)
    motion.position[..., 2] *= -1
    out = no_passages(50)
    sweeps = Sweeps(np.array([PERIOD_S / 2]), np.array([0]), np.array([0]))
    own = layout(rng, 1)
    still = np.zeros((STEPS + 1, 1, 3)), np.tile([1.0, 0, 0, 0], (STEPS + 1, 1, 1))
    count = pass_into(
        motion.time_s,
        segments(motion.time_s, motion.position, motion.quaternion),
        segments(motion.time_s, *still)[:, 0],
        own.point_m,
        own.normal,
        np.ones((1, 1, 5), dtype=bool),
        sweeps,
        kernel_fans(SECOND)[0],
        300.0,
        key_of(0, Purpose.LIGHT),
        np.array([key_of(1, Purpose.LIGHT)]),
        0.0,
        0.0,
        (3e-3, 0.0),
        (0.0, PERIOD_S),
        0,
        out,
    )
    assert count == 0
