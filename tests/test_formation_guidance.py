"""Formations: figures against geometry and the orbit's equations, assignment against all permutations, transfers by
quadrature, the regulator against its limit and a plain recursion."""

from itertools import combinations, permutations

import numpy as np
import pytest

from estimators.relative_orbit import acceleration, circular
from estimators.state import State
from swarm.onboard.guidance.assignment import assign
from swarm.onboard.guidance.broadcast import FORGOTTEN_S, Broadcasts, Heard
from swarm.onboard.guidance.formation import Formation
from swarm.onboard.guidance.gains import regulator
from swarm.onboard.guidance.neighbours import Neighbour
from swarm.onboard.guidance.phase import Phase
from swarm.scenario import Figure
from swarm.scenario import Formation as Table
from swarm.scenario.motions.shapes import shape_of

T = 1 / 60
DEG = 180 / np.pi
FRONT = (0.0, 0.0, 4.0)


def rigid(shape, centre_m, size_m, tilt_rad=0.0, turn_rad=0.0, rate_rad_s=0.0):
    return shape_of(figure(shape, size_m, tilt_rad, turn_rad, rate_rad_s), centre_m, None)


def figure(shape, size_m, tilt_rad=0.0, turn_rad=0.0, rate_rad_s=0.0, at_s=0.0):
    turned = {"tilt_deg": tilt_rad * DEG, "turn_deg": turn_rad * DEG, "rate_deg_s": rate_rad_s * DEG}
    return Figure(shape=shape, at_s=at_s, **{"length_m" if shape == "line" else "radius_m": size_m}, **turned)


def flown(*figures, count, speed_m_s):
    return Formation(np.arange(count), Table(kind="formation", figures=figures, speed_m_s=speed_m_s))


def test_figures_that_move_with_a_craft_are_carried_by_what_each_member_knows_of_it():
    table = Table(
        kind="formation",
        centre_m=FRONT,
        figures=(figure("line", 1.0), figure("ring", 1.0, at_s=10.0)),
        about="leader",
    )
    start, still = np.array([0.5, 0.0, 4.0]), flown(*table.figures, count=2, speed_m_s=table.speed_m_s)
    moving = Formation(np.arange(2), table, about=(2, start))
    unit = np.eye(3)
    for t in (0.0, 3.0, 10.0, 12.0):
        way, speed = np.array([0.1, -0.2, 0.05]) * t, np.array([0.1, -0.2, 0.05])
        # Each member believes the leader elsewhere, as its own estimate is off.
        off = np.array([[0.03, 0.0, 0.0], [0.0, -0.04, 0.0]])
        known = {
            (n, 2): Neighbour(State(unit, start + way + off[n], speed, np.zeros(3)), 0.001, good=True) for n in (0, 1)
        }
        place = still.at(t, Heard(np.zeros((3, 3)), np.zeros((3, 3)), np.array([False, False, False])))
        at = moving.at(t, Heard(np.zeros((3, 3)), np.zeros((3, 3)), np.array([False, False, False])), known)
        assert at.position == pytest.approx(place.position + way + off, abs=1e-12)
        assert at.velocity == pytest.approx(place.velocity + speed, abs=1e-12)


def test_figures_have_their_geometry():
    ring = rigid("ring", (1.0, 2.0, 3.0), 1.5, tilt_rad=0.4, turn_rad=0.7).at(0.0, 7).position - [1, 2, 3]
    assert np.allclose(np.linalg.norm(ring, axis=1), 1.5)
    sides = np.linalg.norm(np.roll(ring, 1, axis=0) - ring, axis=1)
    assert np.allclose(sides, 2 * 1.5 * np.sin(np.pi / 7))
    line = rigid("line", (0.0, 0.0, 4.0), 4.4, turn_rad=np.pi / 2).at(0.0, 12).position
    assert np.allclose(line[:, 1], np.linspace(-2.2, 2.2, 12))
    corners = rigid("tetrahedron", (0.0, 0.0, 0.0), 1.5).at(0.0, 4).position
    edges = [np.linalg.norm(corners[a] - corners[b]) for a, b in combinations(range(4), 2)]
    # Edge over circumradius of a regular tetrahedron: sqrt(8/3).
    assert np.allclose(edges, 1.5 * np.sqrt(8 / 3))
    twelve = rigid("tetrahedron", (0.0, 0.0, 0.0), 1.5).at(0.0, 12).position
    assert np.allclose(twelve[:4], corners)
    apart = min(np.linalg.norm(a - b) for a, b in combinations(twelve, 2))
    # Eight more on six edges: two edges in thirds, four in halves.
    assert apart == pytest.approx(1.5 * np.sqrt(8 / 3) / 3)


@pytest.mark.parametrize("kind", ["ring", "line", "tetrahedron"])
def test_turning_figures_have_their_own_rates(kind):
    shape, h = rigid(kind, (0.3, 0.0, 4.0), 1.2, 0.5, -0.3, rate_rad_s=0.2), 1e-4
    before, now, after = (shape.at(2.0 + d, 5) for d in (-h, 0.0, h))
    # Central differences: truncation h^2, rounding eps / h^2.
    assert np.allclose((after.position - before.position) / (2 * h), now.velocity, atol=1e-8)
    assert np.allclose((after.velocity - before.velocity) / (2 * h), now.acceleration, atol=1e-8)


@pytest.mark.parametrize("boresight", ["v-bar", "-v-bar", "r-bar", "h-bar"])
def test_projected_circle_is_a_free_motion_of_the_orbit(boresight):
    orbit = circular(500e3, boresight)
    down = orbit.axes[2]
    shape = shape_of(Figure(shape="projected-circle", radius_m=2.0), (0.0, 0.0, 0.0), orbit)
    for time_s in (0.0, 700.0, 3000.0):
        motion = shape.at(time_s, 6)
        free = acceleration(orbit, motion.position, motion.velocity)
        assert np.allclose(motion.acceleration, free, atol=1e-15)
        seen = motion.position - np.outer(motion.position @ down, down)
        assert np.allclose(np.linalg.norm(seen, axis=1), 2.0)
    h = 1e-2
    before, after = shape.at(700.0 - h, 6), shape.at(700.0 + h, 6)
    assert np.allclose((after.position - before.position) / (2 * h), shape.at(700.0, 6).velocity, atol=1e-9)


def test_assignment_is_the_best_of_all_permutations():
    rng = np.random.default_rng(5)
    for _ in range(10):
        position, places = rng.normal(size=(2, 6, 3))
        best = min(permutations(range(6)), key=lambda p: np.sum((position - places[list(p)]) ** 2))
        assert assign(position, places).tolist() == list(best)


def test_straight_lines_so_assigned_stay_apart():
    """Theorem 1 of CAPT: from and to places more than 2 sqrt(2) R apart, in step, nobody comes nearer than 2 R."""
    rng = np.random.default_rng(6)
    for _ in range(20):
        grids = []
        for _ in range(2):
            cells = rng.choice(64, 12, replace=False)
            # Cells of 1 m with a margin: no two places nearer than 0.8 m.
            grids.append(np.stack(np.unravel_index(cells, (4, 4, 4)), axis=1) + rng.uniform(-0.1, 0.1, (12, 3)))
        a, b = grids
        least = min(np.linalg.norm(g[i] - g[j]) for g in grids for i, j in combinations(range(12), 2))
        b = b[assign(a, b)]
        nearest = min(
            np.linalg.norm((1 - s) * (a[i] - a[j]) + s * (b[i] - b[j]))
            for s in np.linspace(0, 1, 101)
            for i, j in combinations(range(12), 2)
        )
        assert nearest >= least / np.sqrt(2) - 1e-12


def silence(count):
    return Heard(np.full((count, 3), np.nan), np.full((count, 3), np.nan), np.zeros(count, dtype=np.bool_))


def a_formation(count=8):
    ring, line = figure("ring", 1.0, rate_rad_s=0.1), figure("line", 3.0, at_s=2.0)
    return flown(ring, line, count=count, speed_m_s=0.15)


def test_transfer_is_smooth_and_arrives_at_the_figure():
    formation, count = a_formation(), 8
    times = np.arange(0, 36, T)
    path = [formation.at(t, silence(count)) for t in times]
    position, velocity = (np.array([getattr(p, part) for p in path]) for part in ("position", "velocity"))
    steer = np.array([p.acceleration for p in path])
    # Trapezium rule: its error is T^2 / 12 times the third derivative, below 0.01 m/s^3 here but for its own ends.
    assert np.allclose(np.diff(position, axis=0), T * (velocity[1:] + velocity[:-1]) / 2, atol=1e-6)
    assert np.allclose(np.diff(velocity, axis=0), T * (steer[1:] + steer[:-1]) / 2, atol=1e-5)
    assert np.linalg.norm(velocity[0], axis=1) == pytest.approx(0.1 * np.ones(count))
    line = rigid("line", (0.0, 0.0, 4.0), 3.0).at(0.0, count).position
    last = position[-1]
    assert sorted(last[:, 0]) == pytest.approx(sorted(line[:, 0]))
    assert np.allclose(velocity[-1], 0)
    assert formation.phase(35.0) == Phase.KEEP
    assert formation.phase(5.0) == Phase.TRANSFER
    straight = position[-1] - position[round(2 / T)]
    assert np.linalg.norm(velocity, axis=2).max() < 0.15 + 0.1 + 1e-9
    assert np.linalg.norm(straight, axis=1).max() > 0.3


def test_places_follow_from_what_is_heard():
    line = rigid("line", FRONT, 3.0)
    rng = np.random.default_rng(2)
    believed = rng.normal(size=(6, 3)) + np.array([0, 0, 4])
    formation = flown(figure("ring", 1.0), figure("line", 3.0, at_s=1.0), count=6, speed_m_s=0.1)
    formation.at(0.0, silence(6))
    formation.at(1.0, Heard(believed, np.zeros((6, 3)), np.ones(6, dtype=np.bool_)))
    places = line.at(0.0, 6).position
    arrived = formation.at(1000.0, silence(6)).position
    assert np.allclose(arrived, places[assign(believed, places)])


def test_broadcasts_are_heard_a_period_later_carried_on_and_forgotten():
    air = Broadcasts(2, T)
    position, velocity = np.array([[1.0, 0, 0], [0, 2.0, 0]]), np.array([[0.6, 0, 0], [0, 0, 0.3]])
    air.tell(position, velocity, 0.0)
    assert not air.heard().known.any()
    gone = np.array([[np.nan] * 3, [0, 2.1, 0]])
    air.tell(gone, velocity, 0.0)
    heard = air.heard()
    assert heard.known.all()
    assert np.allclose(heard.position, position + velocity * T)
    air.tell(gone, velocity, 0.0)
    # The first is silent since: straight on from its last message. The second has said more.
    assert np.allclose(air.heard().position, [position[0] + velocity[0] * 2 * T, gone[1] + velocity[1] * T])
    for _ in range(round(FORGOTTEN_S / T) + 2):
        air.tell(gone, velocity, 0.0)
    assert air.heard().known.tolist() == [False, True]


def test_regulator_is_the_best_feedback_and_tends_to_its_limit():
    limit = regulator(0.01, 0.001, 1e-3)
    assert limit.stiffness == pytest.approx(0.1, rel=1e-3)
    assert limit.damping == pytest.approx(np.sqrt(0.2), rel=1e-3)
    gains = regulator(0.01, 0.001, 0.5)
    a, b = np.array([[1, 0.5], [0, 1]]), np.array([0.125, 0.5])

    def cost(k):
        state, total = np.array([0.02, -0.01]), 0.0
        for _ in range(400):
            u = -(k @ state)
            total += (state[0] / 0.01) ** 2 + (u / 0.001) ** 2
            state = a @ state + b * u
        return total

    best = cost(np.array(gains))
    for change in ([1e-3, 0], [-1e-3, 0], [0, 1e-3], [0, -1e-3]):
        assert cost(np.array(gains) + change) > best
