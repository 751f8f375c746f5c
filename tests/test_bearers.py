"""Errors of craft that carry stations: the covariance of those that navigate by them against the whole joint one."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from estimators import rotation as rot
from estimators.arrays import Floats
from estimators.lighthouse.rows import Rows, Station, linearise, packed
from estimators.lighthouse.shared import Shared
from estimators.lighthouse.sweep import lighthouse_2
from estimators.lighthouse.tilted import TiltedErrors
from estimators.relative.bearers import BearerErrors, moved_alike, with_common_error
from estimators.relative.error_step import predicted, updated
from estimators.state import STATES, State
from swarm.errors import SwarmError
from swarm.flight.flight import Flight
from swarm.scenario import Scenario, validate

CRAFT, BEARERS = 4, np.array([1, 3])


def block(i: int) -> slice:
    return slice(STATES * i, STATES * (i + 1))


def test_covariances_are_those_of_all_errors_together() -> None:
    rng = np.random.default_rng(4)
    errors = BearerErrors(BEARERS, CRAFT)
    running, everyone = np.ones(CRAFT, dtype=bool), np.ones(CRAFT, dtype=bool)
    p = np.tile(np.eye(STATES), (CRAFT, 1, 1))
    joint = np.eye(CRAFT * STATES)
    draws = 2
    for period in range(12):
        f = np.eye(STATES) + 0.03 * rng.normal(size=(CRAFT, STATES, STATES))
        q = np.array([0.002 * np.eye(STATES)] * CRAFT)
        p = f @ p @ np.swapaxes(f, 1, 2) + q
        whole = np.zeros_like(joint)
        for c in range(CRAFT):
            whole[block(c), block(c)] = f[c]
        joint = whole @ joint @ whole.T + np.kron(np.eye(CRAFT), 0.002 * np.eye(STATES))
        step = predicted(f, running, draws, STATES * len(BEARERS))
        told = errors.told(running, f, p, np.zeros_like(p))
        for j, b in enumerate(BEARERS):
            np.testing.assert_allclose(told.covariance[j], joint[block(b), block(b)], atol=1e-9)
        alike = np.eye(STATES) + 0.2 * rng.normal(size=(CRAFT, 2, STATES, STATES))
        gain, own_noise = np.zeros_like(joint), np.zeros_like(joint)
        drawn = np.zeros((CRAFT * STATES, draws))
        information, columns = np.zeros_like(p), np.zeros((CRAFT, STATES, 2 * STATES))
        sweeps = np.zeros((CRAFT, STATES, draws))
        after = np.empty_like(p)
        for c in range(CRAFT):
            # Rows of the ground with two draws that all craft share, and rows of either bearer's station.
            ground, g = rng.normal(size=(9, STATES)), 0.5 * rng.normal(size=(9, draws))
            h, r = [ground], [np.eye(9) + g @ g.T]
            ridden = []
            for j, b in enumerate(BEARERS):
                if b == c or (c == 0 and period % 3 == j):
                    continue
                own = 2 * rng.normal(size=(4, STATES))
                h.append(own)
                of = own @ alike[c, j]
                r.append(np.eye(4) + of @ told.covariance[j] @ of.T)
                ridden.append((j, of, sum(len(part) for part in h[:-1])))
            rows = np.concatenate(h)
            noise, at = np.zeros((len(rows), len(rows))), 0
            for part in r:
                noise[at : at + len(part), at : at + len(part)] = part
                at += len(part)
            k = p[c] @ rows.T @ np.linalg.inv(rows @ p[c] @ rows.T + noise)
            after[c] = (np.eye(STATES) - k @ rows) @ p[c]
            gain[block(c), block(c)] = np.eye(STATES) - k @ rows
            weight = rows.T @ np.linalg.inv(noise)
            information[c], sweeps[c] = weight @ rows, weight[:, :9] @ g
            for j, of, first in ridden:
                own_k = k[:, first : first + 4]
                gain[block(c), block(BEARERS[j])] += own_k @ of
                columns[c, :, block(j)] = -weight[:, first : first + 4] @ of
            drawn[block(c)] = k[:, :9] @ g
            own_noise[block(c), block(c)] = k @ k.T
        joint = gain @ joint @ gain.T + own_noise + drawn @ drawn.T
        instant = np.tile([0.001, 0.006], (CRAFT, 1)) + period
        step = updated(step, everyone, after, Shared(information, sweeps, columns, instant))
        p = after
        taken = -step.considered
        errors.end(step._replace(considered=step.considered[..., :0]), taken, told)
        for c in range(CRAFT):
            np.testing.assert_allclose(p[c] + errors.beyond[c], joint[block(c), block(c)], atol=1e-8)
            for j, b in enumerate(BEARERS):
                if b != c:
                    np.testing.assert_allclose(errors.cross[c, :, block(j)], joint[block(c), block(b)], atol=1e-8)
    # It matters: what the filters believe is not what is.
    assert np.trace(joint[block(0), block(0)]) > 1.1 * np.trace(p[0])


def test_an_error_of_the_bearer_is_one_of_the_craft() -> None:
    rng = np.random.default_rng(2)
    state = State(rot.exp(rng.normal(size=(1, 3))), np.array([[0.3, -0.2, 3.0]]), *rng.normal(size=(2, 1, 3)))
    bearer = State(rot.exp(rng.normal(size=3) * 0.1), np.array([0.1, 0.2, -0.1]), *rng.normal(size=(2, 3)))
    fans = lighthouse_2(TiltedErrors(), TiltedErrors())
    mounted = rot.exp(np.array([0.1, -0.2, 0.05])), np.array([0.05, 0.1, 0.1])
    point = rng.uniform(-0.1, 0.1, (5, 3))
    offset, size = np.full(10, 4e-3), 1e-6

    def rows_of(error: Floats) -> tuple[Floats, Floats]:
        """Return y and H where the bearer is off by an error of (attitude, rate, position, velocity)."""
        turn = rot.exp(error[:3] + offset[0] * error[3:6]) @ rot.exp(bearer.angular_rate * offset[0]) @ bearer.rotation
        place = bearer.position + error[6:9] + offset[0] * (bearer.velocity + error[9:])
        there = packed([Station(turn @ mounted[0], place + turn @ mounted[1], fans)])
        photodiode, fan = np.tile(np.arange(5), 2), np.repeat([0, 1], 5)
        zero = np.zeros(10, dtype=np.int64)
        rows = Rows(zero, fan, photodiode, zero, offset, np.zeros(10))
        y, h = linearise(rows, there, point, *(part[0] for part in _of_row(state)))
        return y, h

    alike = moved_alike(state, bearer.position, bearer.velocity)[0]
    y, h = rows_of(np.zeros(STATES))
    for i in range(STATES):
        error = np.zeros(STATES)
        error[i] = size
        # y is measured minus expected: where the bearer truly is off, the measured angle changes by minus this.
        change = (rows_of(error)[0] - y) / size
        np.testing.assert_allclose(change, (h @ alike)[:, i], atol=2e-3 * np.abs(h).max())


def _of_row(state: State) -> tuple[Floats, Floats, Floats, Floats]:
    return state.rotation, state.position, state.velocity, state.angular_rate


def test_rows_with_a_common_error_have_noise_of_one() -> None:
    rng = np.random.default_rng(3)
    y, h = rng.normal(size=7), rng.normal(size=(7, STATES))
    n = np.cov(rng.normal(size=(STATES, 30)))
    whitened, moved = with_common_error(y, h, n)
    r = np.eye(7) + h @ n @ h.T
    np.testing.assert_allclose(moved.T @ moved, h.T @ np.linalg.solve(r, h), atol=1e-10)
    np.testing.assert_allclose(whitened @ whitened, y @ np.linalg.solve(r, y), atol=1e-10)


def ridden(*others: str, bearer: str = "estimate", **chief: Any) -> Scenario:
    """Return a chief in the light of the ground, whose station lights others out of the ground's range."""
    place = {"a": [0.4, 0.0, 6.0], "b": [-0.4, 0.1, 6.0]}
    craft = [{"name": "chief", "motion": {"kind": "hold", "position_m": [0.0, 0.0, 3.0]}, **chief}]
    craft += [{"name": name, "motion": {"kind": "hold", "position_m": place[name]}} for name in others]
    ground = {"name": "ground", "attitude": {"towards_m": [0.0, 0.0, 3.0]}}
    rides: dict[str, Any] = {"name": "ride", "craft": "chief", "bearer": bearer, "position_m": [0.0, 0.0, -0.15]}
    stations = [ground, {**rides, "attitude": {"towards_m": [0.0, 0.0, -3.0]}}]
    table = {"name": "ridden", "duration_s": 0.3, "lighthouse": {"range_max_m": 4.5}}
    return validate({**table, "station": stations, "craft": craft}, file="ridden", folder=Path())


def test_craft_are_no_surer_than_the_one_whose_station_they_use_and_by_themselves() -> None:
    alone, both, sure = (
        list(Flight(settings).fly()) for settings in (ridden("a"), ridden("a", "b"), ridden("a", bearer="truth"))
    )
    assert alone[-1].estimate.station_rows is not None
    assert alone[-1].estimate.station_rows[1].tolist()[0] == 0
    assert alone[-1].estimate.station_rows[1].tolist()[1] > 0
    for one, other in zip(alone, both, strict=True):
        for part in ("rotation", "position", "velocity", "angular_rate", "covariance"):
            np.testing.assert_array_equal(getattr(one.estimate, part), getattr(other.estimate, part)[:2])
    chief, own, known = (run[-1].estimate.covariance[c] for run, c in ((alone, 0), (alone, 1), (sure, 1)))
    # The chief's attitude turns the other about it, 3 m away.
    lateral = np.trace(own[6:8, 6:8]) - np.trace(known[6:8, 6:8])
    assert lateral > 0.5 * 3.0**2 * np.trace(chief[:2, :2])
    assert np.all(np.linalg.eigvalsh(own) > 0)


def test_what_rides_on_no_craft_has_no_bearer() -> None:
    with pytest.raises(SwarmError, match="rides on no craft"):
        validate(
            {"name": "x", "station": [{"name": "s", "bearer": "estimate"}], "swarm": {"count": 1}},
            file="x",
            folder=Path(),
        )
    with pytest.raises(SwarmError, match="tells no estimate"):
        ridden("a", passive=True)
