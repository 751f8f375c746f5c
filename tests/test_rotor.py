import numpy as np
import pytest

from estimators.arrays import Ints
from estimators.lighthouse.rotor import CHANNEL_TICKS, UNCERTAIN, Located, locate, planes, share_of, track

PERIOD = 919_000.0


def turns(count: int, period: float = PERIOD) -> np.ndarray:
    return 5e6 + period * np.arange(count)


def test_every_channel_has_a_period_of_its_own() -> None:
    assert len(set(CHANNEL_TICKS)) == 16
    assert 48e6 / max(CHANNEL_TICKS) == pytest.approx(50.05, abs=0.01)
    assert 48e6 / min(CHANNEL_TICKS) == pytest.approx(54.11, abs=0.01)


def test_the_period_is_measured_and_several_observations_of_a_passage_are_one() -> None:
    period = PERIOD * (1 - 1.1e-5)
    zero = turns(40, period)
    rng = np.random.default_rng(1)
    observed = np.concatenate([zero - 2, zero, zero + 2])
    rng.shuffle(observed)
    rotor = track(observed, PERIOD)
    np.testing.assert_allclose(rotor.zero, zero, atol=1e-6)
    assert rotor.period == pytest.approx(period, rel=1e-12)
    assert rotor.turn.tolist() == list(range(40))
    assert rotor.rejected == 0


def test_missing_zeros_are_bridged_and_false_ones_rejected() -> None:
    zero = turns(30)
    kept = np.delete(zero, [5, 6, 7, 20])
    rotor = track(np.append(kept, [zero[10] + 300_000, zero[22] + 5000]), PERIOD)
    np.testing.assert_array_equal(rotor.zero, kept)
    assert rotor.rejected == 2
    located = locate(rotor, zero[[5, 6, 20]] + 0.25 * PERIOD)
    np.testing.assert_allclose(located.share, 0.25, atol=1e-9)
    assert located.turn.tolist() == [5, 6, 20]


def test_the_turns_own_duration_counts_and_libsurvives_is_the_one_before() -> None:
    duration = PERIOD + np.array([0.0, 30.0, -30.0, 0.0])
    zero = np.concatenate([[0.0], np.cumsum(duration)])
    rotor = track(zero, PERIOD)
    tick = zero[:-1] + 0.4 * duration
    np.testing.assert_allclose(locate(rotor, tick).share, 0.4, atol=1e-12)
    np.testing.assert_allclose(
        locate(rotor, tick[1:], previous=True).share, 0.4 * duration[1:] / duration[:-1], atol=1e-12
    )


def test_a_long_gap_and_a_step_of_the_clock_begin_a_new_stretch() -> None:
    zero = np.concatenate([turns(10), turns(10) + 1e9 + 12_345])
    rotor = track(zero, PERIOD)
    assert len(rotor.zero) == 20
    assert rotor.stretch.tolist() == [0] * 10 + [1] * 10
    assert np.all(np.diff(rotor.turn) > 0)
    middle = locate(rotor, np.array([zero[9] + 20 * PERIOD, zero[9] + 0.3 * PERIOD, zero[10] - 0.3 * PERIOD]))
    np.testing.assert_allclose(middle.share, [np.nan, 0.3, 0.7], atol=1e-9)


@pytest.mark.parametrize("observed", [[], [3e6]])
def test_without_two_zeros_nothing_is_known(observed: list[float]) -> None:
    rotor = track(np.array(observed), PERIOD)
    assert (len(rotor.zero), rotor.period) == (0, PERIOD)
    assert np.isnan(locate(rotor, np.array([3e6, 4e6])).share).all()
    assert locate(rotor, np.zeros(0)).share.shape == (0,)


def on(turn: list[int], share: list[float], photodiode: list[int]) -> tuple[Located, Ints]:
    return Located(np.array(turn), np.array(share)), np.array(photodiode)


def test_plane_and_angle_follow_from_the_share() -> None:
    found = planes(*on([0, 0, 1], [1 / 3, 2 / 3, np.nan], [0, 0, 0]))
    assert found.plane.tolist() == [0, 1, -1]
    np.testing.assert_allclose(found.angle, [0, 0, np.nan], atol=1e-15)
    # 0.1 rad to the left is met later, by either plane.
    later = 0.1 / (2 * np.pi)
    np.testing.assert_allclose(planes(*on([0, 0], [1 / 3 + later, 2 / 3 + later], [0, 0])).angle, 0.1)


def test_the_share_of_an_angle_is_the_inverse() -> None:
    located, photodiode = on([0, 0, 1], [0.3, 0.71, 0.44], [0, 0, 0])
    found = planes(located, photodiode)
    np.testing.assert_allclose(share_of(found.angle, found.plane), located.share, atol=1e-15)


def test_a_hit_that_may_be_of_either_plane_is_told_by_the_other_of_its_turn() -> None:
    near = 0.5 + UNCERTAIN / 2
    assert planes(*on([4], [near], [1])).plane.tolist() == [-1]
    assert planes(*on([4, 4], [near, 0.8], [1, 1])).plane.tolist() == [0, 1]
    assert planes(*on([4, 4], [0.2, near], [1, 1])).plane.tolist() == [0, 1]
    # Not by one of another photodiode or turn, nor of three, nor by its own echo.
    assert planes(*on([4, 4], [near, 0.8], [1, 2])).plane.tolist() == [-1, 1]
    assert planes(*on([4, 5], [near, 0.8], [1, 1])).plane.tolist() == [-1, 1]
    assert planes(*on([4, 4, 4], [near, 0.8, 0.81], [1, 1, 1])).plane.tolist() == [-1, 1, 1]
    assert planes(*on([4, 4], [0.5, 0.5 + UNCERTAIN / 3], [1, 1])).plane.tolist() == [-1, -1]
