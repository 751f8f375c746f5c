"""The orbit: Clohessy-Wiltshire against the matrix exponential, two-body motion, and MuJoCo against the closed form."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.linalg import expm

import swarm
from estimators.filter.filterpy_bank import PoseFilterBank
from estimators.relative_orbit import (
    BORESIGHTS,
    EARTH_MU_M3_S2,
    EARTH_RADIUS_M,
    RelativeOrbit,
    acceleration,
    circular,
    integral,
    transition,
)
from swarm.assets import find_model
from swarm.hardware import Photodiodes
from swarm.onboard.decoder import SweepAngles
from swarm.onboard.navigation import Navigator
from swarm.onboard.settings import NavigationSettings
from swarm.scenario import validate
from swarm.world.world import CraftStart, World
from swarm.world.wrench import most_force

LEO = circular(400e3)
LIGHTHOUSE = find_model("lighthouse")
STARTS = np.array([[3.0, -2, 10, 0.01, -0.02, 0.005], [0, 10, 2, 0, 0, 0], [-1, 0, 8, 0, 0, -0.01]])
"""Position [m] and velocity [m/s]; the second one rests 10 m below the lighthouse, where the drift is strongest."""


def hill_matrix(orbit):
    """d/dt (position, velocity) in the lighthouse frame, from the equations as Hill's axes have them: x radially
    outward, y along the velocity, z along the angular momentum; x'' = 3 n^2 x + 2 n y', y'' = -2 n x', z'' = -n^2 z."""
    n = orbit.mean_motion_rad_s
    v_bar, h_bar, r_bar = orbit.axes
    to_hill = np.stack([-r_bar, v_bar, -h_bar])
    out = np.zeros((6, 6))
    out[:3, 3:] = np.eye(3)
    out[3:, :3] = to_hill.T @ np.diag([3 * n**2, 0, -(n**2)]) @ to_hill
    out[3:, 3:] = to_hill.T @ np.array([[0, 2 * n, 0], [-2 * n, 0, 0], [0, 0, 0]]) @ to_hill
    return out


def world(starts=STARTS, models=("cubesat6u",) * 3, orbit=LEO, **options):
    still = np.zeros(3)
    craft = [
        CraftStart(f"craft-{i}", find_model(model), s[:3], np.array([1.0, 0, 0, 0]), s[3:], still)
        for i, (s, model) in enumerate(zip(starts, models, strict=True))
    ]
    return World(craft, LIGHTHOUSE, orbit=orbit, **options)


# The equations


@pytest.mark.parametrize("boresight", BORESIGHTS)
def test_transition_is_the_matrix_exponential(boresight):
    orbit = circular(550e3, boresight)
    matrix = hill_matrix(orbit)
    state = np.random.default_rng(1).normal(size=(20, 6))
    assert acceleration(orbit, state[:, :3], state[:, 3:]) == pytest.approx(state @ matrix[3:].T, abs=1e-18)
    for time_s in (-7.0, 1 / 480, 60.0, orbit.period_s):
        # Rounding grows with the elements, up to 3 T in the drift: 1.7e4 s.
        assert transition(orbit, time_s) == pytest.approx(expm(matrix * time_s), abs=1e-9)


def test_the_orbit_of_the_space_station():
    """At 400 km: 92.56 minutes (4 pi^2 a^3 = mu T^2); the lighthouse looks back along V-bar, down is to the Earth."""
    assert LEO.period_s / 60 == pytest.approx(92.56, abs=0.005)
    assert LEO.period_s == pytest.approx(2 * np.pi * np.sqrt((EARTH_RADIUS_M + 400e3) ** 3 / EARTH_MU_M3_S2), rel=1e-14)
    v_bar, _, r_bar = LEO.axes
    assert np.array_equal(v_bar, [0, 0, -1])
    assert np.array_equal(r_bar, [0, 1, 0])
    for name, rows in BORESIGHTS.items():
        v, h, r = circular(400e3, name).axes
        assert np.array_equal(np.cross(v, h), r), name
        along = {"v": v, "h": h, "r": r}[name.strip("-")[0]]
        assert along[2] == (-1 if name.startswith("-") else 1)
        assert np.linalg.det(rows) == pytest.approx(1)
    with pytest.raises(ValueError, match="'x-bar' is not one of v-bar"):
        circular(400e3, "x-bar")


def two_body(position, velocity, time_s):
    """Where a craft is in the station's axes (V, H, R) after both have flown around the Earth, in full gravity."""
    radius = EARTH_RADIUS_M + 400e3
    n = np.sqrt(EARTH_MU_M3_S2 / radius**3)
    # Inertial axes: x from the Earth to the station at the start, y along its velocity.
    axes = np.array([[0.0, 1, 0], [0, 0, -1], [-1, 0, 0]])
    away, about = axes.T @ position, np.array([0, 0, n])
    place = np.array([radius, 0, 0]) + away
    speed = np.array([0, n * radius, 0]) + axes.T @ velocity + np.cross(about, away)
    start = np.concatenate([place, speed])

    def fall(_, s):
        return np.concatenate([s[3:], -EARTH_MU_M3_S2 * s[:3] / np.linalg.norm(s[:3]) ** 3])

    end = solve_ivp(fall, (0, time_s), start, method="DOP853", rtol=1e-13, atol=1e-7).y[:3, -1]
    c, s = np.cos(n * time_s), np.sin(n * time_s)
    turned = np.array([[c, s, 0], [-s, c, 0], [0, 0, 1]]) @ end
    return axes @ (turned - [radius, 0, 0])


@pytest.mark.parametrize(("where", "drift"), [((1.0, 0, 0), 0), ((0, 0, 1.0), 0), ((0, 0, 1.0), 1.5)])
def test_what_the_linearisation_leaves_out_falls_with_the_square_of_the_distance(where, drift):
    """The next term of gravity is 3/2 n^2 d^2 / a: half the distance, a quarter of the error; 1.1 cm in an orbit from
    rest 10 m below, where the craft drifts 377 m away, and below 1 mm where it stays within its 10 m."""
    orbit = RelativeOrbit(LEO.mean_motion_rad_s, np.eye(3))
    error = []
    for distance in (10.0, 20.0):
        position = distance * np.array(where)
        velocity = np.array([drift * orbit.mean_motion_rad_s * position[2], 0, 0])
        linear = transition(orbit, orbit.period_s)[:3] @ np.concatenate([position, velocity])
        error.append(np.linalg.norm(two_body(position, velocity, orbit.period_s) - linear))
    # 3 % for the third order, and the integrator's own 1e-7 m or so.
    assert error[1] / error[0] == pytest.approx(4, rel=0.03)
    assert error[0] < (1e-3 if drift or where[0] else 1.2e-2)


# The world


def test_free_drift_over_one_orbit_at_eight_steps_per_period():
    """MuJoCo's knots lie on the closed form whatever the step: here 1/8 s. What is left is rounding, 1e-8 m where a
    craft drifts 377 m. The issue asks for 1 mm; at 60 Hz `benchmarks/orbit.py` has the same."""
    built, nothing = world(rate_hz=1.0), np.zeros((3, 3))
    energy = integral(LEO, STARTS[:, :3], STARTS[:, 3:])
    previous = None
    for k in range(int(LEO.period_s)):
        truth = built.advance(nothing, nothing)
        if k % 500 == 0 and previous is not None:
            # The velocity at a knot, from both sides: exact to (n h)^2 / 6 = 3e-9 of it.
            middle = (truth.velocity[0] + truth.velocity[1]) / 2
            # The integral is a difference of terms up to some 1e-1 m^2/s^2 large.
            assert integral(LEO, truth.position[0], middle) == pytest.approx(energy, abs=1e-9)
        previous = truth
    expected = STARTS @ transition(LEO, truth.time_s[-1])[:3].T
    assert np.linalg.norm(expected - STARTS[:, :3], axis=1).max() > 300
    assert np.abs(truth.position[-1] - expected).max() < 1e-7


def test_the_first_seconds_at_the_default_rate():
    """Here the steps are 1/480 s; also the mean velocity over the interval before the start is right at once."""
    built, nothing = world(), np.zeros((3, 3))
    for _ in range(120):
        truth = built.advance(nothing, nothing)
        for time_s, position in zip(truth.time_s, truth.position, strict=True):
            # Rounding over 960 steps of numbers of the size of 10.
            assert position == pytest.approx(STARTS @ transition(LEO, time_s)[:3].T, abs=1e-12)


def test_without_an_orbit_nothing_pulls():
    built, nothing = world(orbit=None), np.zeros((3, 3))
    truth = built.advance(nothing, nothing)
    assert truth.position[-1] == pytest.approx(STARTS[:, :3] + STARTS[:, 3:] / 60, abs=1e-14)


def test_the_centre_of_mass_drifts_also_of_a_craft_that_spins_about_it(tmp_path):
    """The body's origin, 5 cm off, goes round it."""
    sites = "".join(f'<site name="photodiode{i}" pos="{i % 2 / 10} {i // 2 / 10} 0.11"/>' for i in range(4))
    path = tmp_path / "off.xml"
    path.write_text(
        '<mujoco><worldbody><body><inertial pos="0.05 0 0" mass="2" diaginertia="0.02 0.02 0.02"/>'
        f'<geom type="sphere" size="0.1"/>{sites}</body></worldbody></mujoco>'
    )
    spin, arm = np.array([0, 0, 0.02]), np.array([0.05, 0, 0])
    velocity = -np.cross(spin, arm)
    start = CraftStart("off", path, np.array([0, 10.0, 5]) - arm, np.array([1.0, 0, 0, 0]), velocity, spin)
    built = World([start], LIGHTHOUSE, rate_hz=2.0, orbit=LEO)
    for _ in range(600):
        truth = built.advance(np.zeros((1, 3)), np.zeros((1, 3)))
    angle = 0.02 * truth.time_s[-1]
    centre = truth.position[-1, 0] + 0.05 * np.array([np.cos(angle), np.sin(angle), 0])
    expected = transition(LEO, truth.time_s[-1])[:3] @ np.array([0, 10.0, 5, 0, 0, 0])
    assert np.linalg.norm(expected - [0, 10, 5]) > 1
    # MuJoCo's first-order steps lose w^2 h r / 2 of the centre's speed, 6e-7 m/s, for 300 s.
    assert centre == pytest.approx(expected, abs=3e-4)


def test_the_force_that_contacts_are_looked_for_with_is_never_exceeded():
    """Else two craft could touch in a period in which MuJoCo was told not to look."""
    rng = np.random.default_rng(3)
    built = world(rng.normal(size=(3, 6)) * [5, 5, 5, 1, 1, 1] + [0, 0, 10, 0, 0, 0], rate_hz=0.5)
    force = rng.normal(size=(3, 3)) * 1e-4
    for _ in range(5):
        bound = np.linalg.norm(
            most_force(built._pose, built._rate, built.mass, built.com_m, force, None, built._orbit.n, 2.0), axis=1
        )
        velocity = np.diff(built.advance(force, np.zeros((3, 3))).velocity, axis=0)
        mean_force = np.linalg.norm(velocity, axis=2) * built.mass * 0.5 * 8
        assert np.all(mean_force <= bound)
        # Loose enough to be simple, tight enough to spare the search: a micronewton moves nothing in a period.
        assert np.all(bound < 10 * mean_force.max(axis=0))


# On board


def test_a_craft_in_the_dark_predicts_its_drift():
    """A filter that coasts for 30 s follows the closed form; without the orbit it is 4 cm off."""
    none = np.full((1, 4, 2), np.nan)
    zero = np.zeros(1, dtype=np.int64)
    dark = SweepAngles(none, np.zeros((1, 4, 2)), np.zeros((1, 4), dtype=np.bool_), zero, zero, zero)
    layout = Photodiodes(np.zeros((1, 4, 3)), np.zeros((1, 4, 3)), np.ones((1, 4), dtype=np.bool_))
    start = np.array([0.5, 10.0, 5, 0.01, 0, 0.02])
    end = {}
    for orbit in (LEO, None):
        settings = NavigationSettings(1 / 60, 4e-5, 0.87, coast_limit_s=100.0, orbit=orbit)
        navigator = Navigator(layout, settings)
        bank = navigator.tracks.bank
        assert isinstance(bank, PoseFilterBank)
        one = np.ones(1, dtype=np.bool_)
        bank.start(one, np.eye(3)[None], start[None, :3], 1e-6 * np.eye(6)[None], (0.1, 0.1))
        still = np.zeros((1, 3))
        bank.add_motion(one, still, still, still, start[None, 3:])
        for _ in range(30 * 60):
            estimate = navigator.step(dark)
        end[orbit is None] = estimate.position[0]
    expected = transition(LEO, 30.0)[:3] @ start
    # Taken as constant over each period, the acceleration lags by half of one: a T t^2 / 4 of 4e-5 m/s^2.
    assert end[False] == pytest.approx(expected, abs=1e-6)
    assert np.linalg.norm(end[True] - expected) > 0.01


def test_holding_station_below_costs_three_n_squared_z(tmp_path):
    """At rest 10 m below, gravity pulls down by 3 n^2 z: the delta-v is that times the time, and nothing moves."""
    hold = {"kind": "hold", "position_m": [0.0, 10.0, 8.0]}
    data = {"duration_s": 2.0, "orbit": {"altitude_km": 400.0}, "swarm": {"count": 1, "motion": hold}}
    data["physics"] = {"steps_per_period": 8}
    run = swarm.simulate(validate(data, file="test", folder=tmp_path), out=tmp_path / "run", record=False)
    delta_v, down = (run.telemetry[name][-1].as_py() for name in ("delta_v_m_s", "true_py_m"))
    # The start's velocity, h / 2 of gravity's, is taken out first: 4e-8 of the 8e-5 m/s.
    assert delta_v == pytest.approx(3 * LEO.mean_motion_rad_s**2 * 10 * 2.0, rel=2e-3)
    # Feedback alone, at w = 1 rad/s, would let it sink by 3 n^2 z / w^2 = 38 um, by 20 um in these two seconds.
    assert down == pytest.approx(10.0, abs=1e-7)
