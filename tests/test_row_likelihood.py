"""Noise and motion by likelihood, rows that contradict the others, and considered errors of stations' places."""

from types import SimpleNamespace
from typing import cast

import numpy as np
import pytest
from rows_made import BODY, DECK, room, seen

from estimators.arrays import Floats
from estimators.lighthouse.innovation import RowBatch
from estimators.lighthouse.integrity import AngleNoise
from estimators.lighthouse.row_motion import HandMotion
from estimators.lighthouse.row_snooping import snooped
from estimators.lighthouse.rows import Station, packed
from estimators.rotation import exp, log
from estimators.state import State
from swarm.flight.recordings import row_likelihood
from swarm.flight.recordings.row_windows import RowWindows
from swarm.hardware import pad
from swarm.onboard.motion_search import MotionSearch
from swarm.onboard.place_errors import PlaceSigma
from swarm.onboard.settings import NavigationSettings
from swarm.onboard.stations import RowLight, StationNavigator

FRAME_S = 0.02
NOISE = [AngleNoise(4e-5, 6e-5)] * 2
PUSHED, TURNED = 6.0, 15.0
LEVEL = exp(np.array([0.2, 0.1, -0.3]))


def pushed(count: int, false: float, seed: int = 2) -> list[RowBatch]:
    """Return the rows of periods of a body that white accelerations move; a share of them is 0.6 mrad off."""
    rng, stations = np.random.default_rng(seed), room((2, 2))
    rotation, place, velocity, rate, out = LEVEL, np.zeros(3), np.zeros(3), np.zeros(3), []
    for _ in range(count):
        # A hand that comes back, so that the body stays between the stations.
        push = PUSHED * rng.standard_normal(3) - 4 * place - 2 * velocity
        turn = TURNED * rng.standard_normal(3) - 2 * rate
        place = place + velocity * FRAME_S + push * FRAME_S**2 / 2
        rotation = exp((rate + turn * FRAME_S / 2) * FRAME_S) @ rotation
        velocity, rate = velocity + push * FRAME_S, rate + turn * FRAME_S
        rows = seen(stations, BODY, State(rotation[None], place[None], velocity[None], rate[None]), NOISE, rng)
        off = 6e-4 * (rng.random(len(rows.angle)) < false)
        out.append(rows._replace(angle=rows.angle + off))
    return out


@pytest.mark.parametrize("false", [0.0, 0.04])
def test_noise_and_motion_are_those_of_the_recording(monkeypatch: pytest.MonkeyPatch, false: float) -> None:
    periods = pushed(120, false)
    whole = cast(RowWindows, Windows(periods))
    monkeypatch.setattr(row_likelihood, "STRETCHES", 6)
    monkeypatch.setattr(row_likelihood, "STRETCH_S", 0.34)
    monkeypatch.setattr(row_likelihood, "ROUNDS", ((0.7, 40), (0.3, 25)))
    found = row_likelihood.likely(whole, room((2, 2)), BODY, HandMotion(), [8e-5, 8e-5])
    assert found is not None
    # Rows beyond 2.5 sigma are left out, honest ones as well.
    assert found.noise[0].own_rad == pytest.approx(4e-5, rel=0.2)
    assert found.noise[0].shared_rad == pytest.approx(6e-5, rel=0.25)
    assert found.acceleration_m_s2 == pytest.approx(PUSHED, rel=0.2)
    assert found.angular_acceleration_rad_s2 == pytest.approx(TURNED, rel=0.2)
    assert found.nis == pytest.approx(1.0, abs=0.25)


def test_a_row_that_contradicts_the_others_is_told_from_honest_ones() -> None:
    rng, stations, honest, right = np.random.default_rng(7), room((2, 2)), 0, 0
    covariance = np.diag([1e-4] * 3 + [1e-2] * 3 + [1e-6] * 3 + [1e-2] * 3)
    for _ in range(40):
        state = State(LEVEL[None], 0.2 * rng.normal(size=(1, 3)), np.zeros((1, 3)), np.zeros((1, 3)))
        rows = seen(stations, DECK, state, NOISE, rng).of(0)
        honest += int(np.count_nonzero(~snooped(rows, packed(stations), DECK, state.of(0), covariance, NOISE)))
        bad = int(rng.integers(len(rows.angle)))
        angle = rows.angle.copy()
        angle[bad] += 8e-4
        kept = snooped(rows._replace(angle=angle), packed(stations), DECK, state.of(0), covariance, NOISE)
        right += not kept[bad]
    assert honest < 0.05 * 40 * 16
    assert right == 40


class Windows:
    """Periods as a recording has them."""

    frame_s = FRAME_S

    def __init__(self, periods: list[RowBatch]) -> None:
        self._periods = periods

    def __len__(self) -> int:
        return len(self._periods)

    def window(self, i: int) -> SimpleNamespace:
        return SimpleNamespace(light=SimpleNamespace(rows=self._periods[i]))


def moved(station: Station, turn: Floats, shift: Floats) -> Station:
    return Station(exp(turn[None])[0] @ station.rotation, station.position + shift, station.fans)


def test_considered_errors_are_what_a_wrong_place_does_to_the_filter() -> None:
    """Estimates with a station turned and shifted differ by S times that from those with it in its place."""
    stations, away = room((2, 2)), np.array([2e-4, -1e-4, 3e-4, 1e-3, -2e-3, 1.5e-3])
    sigma = PlaceSigma(
        np.tile(np.outer(away, away), (2, 1, 1)) * np.array([0.0, 1.0])[:, None, None], np.zeros(2), 0.0, np.zeros(2)
    )
    settings = NavigationSettings(
        FRAME_S,
        8e-5,
        0.5,
        acceleration_noise_m_s2=PUSHED,
        angular_acceleration_noise_rad_s2=TURNED,
        hand=HandMotion(),
        places=sigma,
    )
    layout, none = pad([BODY], [np.tile([0.0, 0.0, 1.0], (len(BODY), 1))]), np.zeros(1, dtype=np.int64)
    wrong = [stations[0], moved(stations[1], away[:3], away[3:])]
    apart = [StationNavigator(layout, settings, known, NOISE) for known in (stations, wrong)]
    for rows in pushed(25, 0.0):
        right, other = (navigator.step(RowLight(rows, none, none)) for navigator in apart)
    found = np.concatenate([log(other.rotation @ right.rotation[0].T)[0], other.position[0] - right.position[0]])
    added = (right.covariance - apart[0].tracks.bank.covariance)[0][np.ix_([0, 1, 2, 6, 7, 8], [0, 1, 2, 6, 7, 8])]
    # One error alone: the covariance that it adds is the square of what it does.
    np.testing.assert_allclose(np.outer(found, found), added, atol=0.1 * np.abs(np.diag(added)).max())
    assert np.sqrt(added[3, 3]) > 2e-4


def test_a_mirror_image_is_doubtful_near_the_line_of_sight() -> None:
    stations, rng = room((2, 2)), np.random.default_rng(1)
    ahead = stations[0].position / np.linalg.norm(stations[0].position)
    level = np.stack([np.cross(ahead, stations[0].rotation[:, 0]), stations[0].rotation[:, 0], ahead], axis=1)
    search = MotionSearch(np.stack([DECK]), stations, NOISE, FRAME_S, HandMotion())
    covariance = np.diag(np.repeat(np.radians([2.0, 9.0, 1.0, 9.0]) ** 2, 3))

    def doubtful(tilt_deg: float, of: list[int], layout: Floats = DECK) -> bool:
        turned = exp(np.radians([[tilt_deg, 0.0, 0.0]]))[0]
        state = State((turned @ level)[None], np.zeros((1, 3)), np.zeros((1, 3)), np.zeros((1, 3)))
        rows = seen(stations, DECK, state, NOISE, rng)
        own = search if layout is DECK else MotionSearch(layout[None], stations, NOISE, FRAME_S, HandMotion())
        return own.mirror_doubtful(0, rows.where(np.isin(rows.station, of)).of(0), state.of(0), covariance)

    assert doubtful(2.0, [0])
    assert not doubtful(30.0, [0])
    assert not doubtful(2.0, [0, 1])
    assert not doubtful(2.0, [0], BODY)
