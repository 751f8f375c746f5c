"""Objects in hands: pose and motion from some hundredths of a second, mirror images, and filters that are wrong."""

import numpy as np
import pytest
from rows_made import DECK, room, seen

from estimators.arrays import Floats
from estimators.lighthouse.innovation import RowBatch, gathered, light_of
from estimators.lighthouse.integrity import AngleNoise
from estimators.lighthouse.row_motion import HandMotion, solve_motion
from estimators.lighthouse.rows import Rows, packed
from estimators.rotation import angle_between, exp
from estimators.state import State
from swarm.onboard.motion_search import MotionSearch

FRAME_S, FRAMES = 0.02, 4
NOISE = [AngleNoise(5e-5, 5e-5)] * 2
PUSH = np.array([6.0, -5.0, 4.0])
SPEED, RATE = np.array([2.0, -1.5, 1.0]), np.array([0.5, -1.0, 0.8])
TURN = exp(np.array([0.9, 0.3, -0.4]))
PLACE = np.array([0.2, -0.1, 0.3])


def state_at(time_s: float) -> State:
    """Return the true state (1, ...) of a deck that is carried past and pushed."""
    return State(
        (exp(RATE * time_s) @ TURN)[None],
        (PLACE + SPEED * time_s + PUSH * time_s**2 / 2)[None],
        (SPEED + PUSH * time_s)[None],
        RATE[None],
    )


def frames() -> list[RowBatch]:
    """Return the rows of the last frames, the newest with its epoch at time zero."""
    rng, stations = np.random.default_rng(4), room((2, 2))
    return [seen(stations, DECK, state_at(-age * FRAME_S), NOISE, rng) for age in range(FRAMES)]


def search() -> MotionSearch:
    """Return a search that has seen all frames."""
    out = MotionSearch(DECK[None], room((2, 2)), NOISE, FRAME_S, HandMotion())
    for rows in frames()[::-1]:
        out.gather(rows)
    return out


def mirrored(state: State, flip: Floats) -> State:
    """Return the state (1, ...) with the mirror image of its attitude before the first station."""
    ahead = state.position[0] - room((2, 2))[0].position
    ahead /= np.linalg.norm(ahead)
    turned = (np.eye(3) - 2 * ahead[:, None] * ahead) @ state.rotation[0] @ flip
    return state._replace(rotation=turned[None])


def test_pose_rates_and_covariance_of_a_pushed_object() -> None:
    parts = [
        rows.of(0)._replace(offset_s=rows.offset_s - age * FRAME_S, sweep=rows.sweep + age)
        for age, rows in enumerate(frames())
    ]
    rows = Rows._make(np.concatenate(column) for column in zip(*parts, strict=True))
    one = gathered(np.zeros(len(rows.angle), dtype=np.int64), rows, 1)
    true, still = state_at(0.0), np.zeros((1, 3))
    start = State(exp(np.array([[0.1, -0.1, 0.1]])) @ true.rotation, true.position + 0.05, still, still)
    found = solve_motion(one, light_of(packed(room((2, 2))), NOISE), DECK[None], start, HandMotion())
    assert found.solved[0]
    away = np.concatenate([found.state.position[0] - true.position[0], found.state.velocity[0] - true.velocity[0]])
    p = found.covariance[0][6:, 6:]
    assert away @ np.linalg.solve(p, away) < 22.5  # chi-square of six, 0.1 %
    assert np.linalg.norm(away[:3]) < 3e-3
    assert np.linalg.norm(away[3:]) < 0.15
    assert angle_between(found.state.rotation, true.rotation)[0] < 0.1


def test_a_fast_deck_is_found_and_not_its_mirror_image() -> None:
    found = search().search(0)
    true = state_at(0.0)
    assert found.state is not None
    assert np.linalg.norm(found.state.position - true.position[0]) < 5e-3
    assert angle_between(found.state.rotation[None], true.rotation)[0] < 0.15


@pytest.mark.parametrize("wrong", ["nothing", "mirror", "place"])
def test_the_watch_starts_only_a_filter_that_is_wrong_again(wrong: str) -> None:
    true = state_at(0.0)
    state, covariance = true, np.diag([1e-4] * 3 + [1e-2] * 3 + [1e-6] * 3 + [1e-2] * 3)
    if wrong == "mirror":
        state = mirrored(true, np.diag([1.0, 1.0, -1.0]))
        assert angle_between(state.rotation, true.rotation)[0] > 0.5
    if wrong == "place":
        state = true._replace(position=true.position + 0.2)
    watch = search()
    looks = [watch.watched(0, state.of(0), covariance, doubted=False)]
    for _ in range(4):
        watch.gather(RowBatch._make((np.zeros(2, dtype=np.int64), *(part[:0] for part in frames()[0][1:]))))
        looks.append(watch.watched(0, state.of(0), covariance, doubted=False))
    found = next((look for look in looks if look.state is not None), None)
    if wrong == "nothing":
        assert found is None
        assert any(look.confirmed for look in looks)
        return
    assert found is not None
    assert found.state is not None
    assert angle_between(found.state.rotation[None], true.rotation)[0] < 0.5


def test_one_station_leaves_the_mirror_image_of_a_deck_open() -> None:
    one = MotionSearch(DECK[None], room((2,)), NOISE[:1], FRAME_S, HandMotion())
    for rows in frames()[::-1]:
        one.gather(rows.where(rows.station == 0))
    found = one.search(0)
    assert found.undecided
    assert found.state is None
