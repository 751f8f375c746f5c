"""Flights before several stations: rows that the circuits make, craft by themselves, stations that ride, hand-over."""

from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from estimators.arrays import Floats
from estimators.lighthouse.sweep import measured_angles
from swarm.flight import builders
from swarm.flight.flight import Flight
from swarm.messages import BeamHits
from swarm.onboard.beams import BeamDecoder
from swarm.onboard.settings import Status
from swarm.onboard.turns import TurnDecoder
from swarm.results.period import Period
from swarm.scenario import Scenario, load

SECOND = """
[[station]]
name = "a"
position_m = [-1.5, -0.2, 0.5]
attitude = { towards_m = [0.0, 0.0, 3.0], roll_deg = 10.0 }
channel = 3
plane_1 = { phase_rad = 0.01, tilt_rad = -0.04, curve = 0.2, ogee_magnitude = 0.3 }
[[station]]
name = "b"
position_m = [1.5, 0.3, 1.0]
attitude = { towards_m = [0.0, 0.0, 3.0] }
"""
FIRST = SECOND.replace("[[station]]", '[[station]]\nkind = "lighthouse-1"').replace(
    "channel = 3\nplane_1 = { phase_rad = 0.01, tilt_rad = -0.04, curve = 0.2, ogee_magnitude = 0.3 }",
    "fan_x = { phase_rad = 0.02, curve = 0.01 }",
)
CRAFT = """
duration_s = 0.5
seed = 3
[[craft]]
name = "one"
[craft.motion]
kind = "wander"
centre_m = [0.0, 0.0, 3.0]
size_m = [0.3, 0.3, 0.3]
speed_m_s = 0.1
turn_deg = 20.0
turn_rate_deg_s = 10.0
bandwidth_hz = 0.3
"""
OTHERS = """
[[craft]]
name = "two"
motion = { kind = "hold", position_m = [0.6, 0.4, 3.2] }
[[craft]]
name = "three"
motion = { kind = "hold", position_m = [-0.6, 0.5, 2.8] }
"""


def scenario_of(tmp_path: Any, *parts: str, **changes: Any) -> Scenario:
    """Return a scenario of several pieces of text."""
    file = tmp_path / "flight.toml"
    file.write_text("".join(parts))
    return load(file, changes)


def flown(settings: Scenario) -> list[Period]:
    """Return all periods of a flight."""
    return list(Flight(settings).fly())


@pytest.mark.parametrize("stations", [FIRST, SECOND], ids=["lighthouse-1", "lighthouse-2"])
def test_rows_are_the_angles_that_the_planes_measure(stations: str, tmp_path: Any) -> None:
    quiet = "[lighthouse]\nangle_noise_arcsec = 0.0\n"
    stations = stations.replace('name = "', 'angle_noise_arcsec = 0.0\nname = "')
    settings = scenario_of(tmp_path, CRAFT, quiet, stations)
    flight, known, tick_s = Flight(settings), builders.stations.known_stations(settings), 20e-9
    light = flight.sensors.stations
    assert light is not None
    checked = 0
    for frame in range(4):
        truth, sight = flight.move(frame)
        signals = flight.sensors.signals(truth, frame, sight == 2)
        decoder = flight.computer.decoder
        if isinstance(decoder, BeamDecoder):
            assert signals.beams is not None
            rows = decoder.decode(signals.beams).rows
        else:
            assert isinstance(decoder, TurnDecoder)
            rows = decoder.decode(signals.pulses).rows
        knot = truth.time_s - truth.time_s[truth.epoch]
        turns = Rotation.from_quat(truth.quaternion[:, 0][:, [1, 2, 3, 0]])
        for s, f, k, _, offset, angle in zip(*rows[1:], strict=True):
            j = int(np.clip(np.searchsorted(knot, offset, side="right") - 1, 0, len(knot) - 2))
            share = (offset - knot[j]) / (knot[j + 1] - knot[j])
            turned = Rotation.from_rotvec(share * (turns[j + 1] * turns[j].inv()).as_rotvec()) * turns[j]
            at = truth.position[j, 0] + share * (truth.position[j + 1, 0] - truth.position[j, 0])
            q = (at + turned.apply(light.photodiodes.point_m[0, k]) - known[s].position) @ known[s].rotation
            wanted = measured_angles(q, known[s].fans)[f]
            # A hit, and the flash of Lighthouse 1.0, are each within a tick; ends of the period within a tick as well.
            assert angle == pytest.approx(wanted, abs=3 * tick_s * 2 * np.pi * 60)
            checked += 1
    assert checked > 40


@pytest.mark.parametrize("stations", [FIRST, SECOND], ids=["lighthouse-1", "lighthouse-2"])
def test_a_craft_estimates_the_same_alone_and_in_the_swarm(stations: str, tmp_path: Any) -> None:
    alone = flown(scenario_of(tmp_path, CRAFT, stations))
    among = flown(scenario_of(tmp_path, CRAFT, OTHERS, stations))
    for one, all_of_them in zip(alone, among, strict=True):
        for name in ("position", "rotation", "covariance", "nis", "rows", "status"):
            own, same = getattr(one.estimate, name)[0], getattr(all_of_them.estimate, name)[0]
            assert np.array_equal(own, same, equal_nan=True), (one.frame, name)
    assert alone[-1].estimate.status[0] == Status.TRACKING
    assert alone[-1].estimate.stations is not None
    assert alone[-1].estimate.stations[0] == 2


def errors(periods: list[Period], craft: int) -> Floats:
    """Return the distances of one craft's estimates from the truth, (n,) [m]."""
    found = []
    for period in periods:
        assert period.truth is not None
        found.append(np.linalg.norm(period.estimate.position[craft] - period.truth.position[craft]))
    return np.array(found)


def test_a_station_that_rides_on_a_moving_craft_is_as_good_as_one_that_stands(tmp_path: Any) -> None:
    bearer = """
[[craft]]
name = "chief"
lighthouse = false
[craft.motion]
kind = "wander"
centre_m = [1.5, 0.3, 1.0]
size_m = [0.3, 0.3, 0.3]
speed_m_s = 0.3
turn_deg = 15.0
attitude = { facing = false }
"""
    rides = """
[[station]]
name = "c"
craft = "chief"
position_m = [0.0, 0.0, 0.1]
attitude = { towards_m = [-1.5, -0.3, 2.0] }
"""
    periods = flown(scenario_of(tmp_path, CRAFT, bearer, rides, SECOND.split('[[station]]\nname = "b"')[0]))
    apart = errors(periods, 0)
    assert periods[-1].estimate.stations is not None
    assert periods[-1].estimate.stations[0] == 2
    # Some hundredths of a millimetre across two lines of sight; the bearer moves by 5 mm in a period, and by 0.05 mm
    # less or more than its speed at the epoch says.
    assert np.sqrt(np.mean(apart[10:] ** 2)) < 1.5e-4


def test_hits_without_bits_belong_to_the_sweep_around_them() -> None:
    decoder = BeamDecoder(np.ones((1, 4), dtype=bool), 20e-9, [7, 2], [0.02, 0.019])
    tick = 20e-9

    def hits(*each: tuple[int, int, int, int]) -> BeamHits:
        photodiode, middle, channel, offset = (np.array([column]) for column in zip(*each, strict=True))
        return BeamHits(
            photodiode.astype(np.int16),
            middle - 50,
            np.full(middle.shape, 100, dtype=np.int32),
            channel.astype(np.int16),
            offset,
            np.array([len(each)], dtype=np.int32),
            np.array([10_000_000]),
        )

    one = decoder.decode(hits((0, 10_000_000, 7, 300_000), (1, 10_005_000, 0, -1), (2, 10_008_000, 7, 308_000)))
    assert one.rejected.tolist() == [0]
    assert one.rows.station.tolist() == [0, 0, 0]
    turned = 2 * np.pi * tick / 0.02
    assert one.rows.angle[1] - one.rows.angle[0] == pytest.approx(5000 * turned)
    assert one.rows.offset_s.tolist() == pytest.approx([0.0, 1e-4, 1.6e-4])
    far = decoder.decode(hits((0, 10_000_000, 7, 300_000), (2, 10_008_000, 7, 308_000), (1, 10_017_000, 0, -1)))
    assert far.rejected.tolist() == [1]
    own = decoder.decode(hits((0, 10_000_000, 7, 300_000), (0, 10_005_000, 0, -1), (2, 10_008_000, 7, 308_000)))
    assert own.rejected.tolist() == [1]
    both = decoder.decode(hits((0, 10_000_000, 7, 300_000), (1, 10_005_000, 0, -1), (2, 10_008_000, 2, 308_000)))
    assert both.rejected.tolist() == [1]
    foreign = decoder.decode(hits((0, 10_000_000, 5, 300_000), (1, 10_005_000, 0, -1)))
    assert foreign.rejected.tolist() == [2]


def test_a_craft_without_light_coasts_and_finds_itself_again(tmp_path: Any) -> None:
    dark = '[[fault]]\nkind = "lighthouse-dark"\nat_s = 0.2\nfor_s = 0.1\n'
    dead = '[[fault]]\nkind = "photodiode-dead"\nat_s = 0.0\nphotodiodes = [0, 1]\ncraft = ["one"]\n'
    periods = flown(scenario_of(tmp_path, CRAFT, SECOND, dark, dead))
    state = np.array([int(period.estimate.status[0]) for period in periods])
    assert set(state[13:17]) == {Status.COASTING}
    assert state[-1] == Status.TRACKING
    assert max(period.estimate.visible[0] for period in periods) <= 10
    assert not any(period.angles.lit[0, :2].any() for period in periods)
