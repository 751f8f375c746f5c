"""Gyroscope and accelerometer beside a filter: the dark, biases, mirror images, and the samples of a log."""

from pathlib import Path

import made_recording
import numpy as np
import pytest
from rows_made import DECK, room, seen

from estimators.arrays import Floats
from estimators.filter.compiled import CompiledFilterBank
from estimators.lighthouse.innovation import RowBatch
from estimators.lighthouse.integrity import AngleNoise
from estimators.lighthouse.row_motion import HandMotion
from estimators.pivot import PIVOT
from estimators.rotation import exp, log
from estimators.state import State
from swarm.flight.recordings.crazyflie import Inertial
from swarm.flight.recordings.libsurvive import Recording, read_libsurvive
from swarm.flight.recordings.object_light import object_of
from swarm.flight.recordings.row_windows import shown
from swarm.hardware import pad
from swarm.onboard.inertial import Inertial as Biased
from swarm.onboard.inertial import InertialLight, InertialSensors
from swarm.onboard.place_errors import PlaceErrors, PlaceSigma
from swarm.onboard.settings import NavigationSettings, Status
from swarm.onboard.stations import RowLight, StationNavigator

FRAME_S, PERIODS, DARK = 0.02, 61, 40
NOISE = [AngleNoise(5e-5, 2e-5)] * 2
UP = np.array([0.0, 0.0, 9.80665])
GYRO_BIAS, FORCE_BIAS = np.array([0.02, -0.01, 0.015]), np.array([0.2, -0.1, 0.15])
NONE = np.zeros(1, dtype=np.int64)


def attitude(time_s: float) -> Floats:
    """Return R of a deck that a hand turns to and fro."""
    angles = np.array([0.5 * np.sin(5 * time_s), 0.4 * np.sin(4 * time_s + 1), 0.6 * np.sin(3 * time_s)])
    out: Floats = (exp(angles[None]) @ exp(np.array([[0.9, 0.3, -0.4]])))[0]
    return out


def place(time_s: float) -> Floats:
    return np.array([0.3 * np.sin(6 * time_s), 0.25 * np.sin(5 * time_s + 0.5), 0.2 * np.sin(7 * time_s)])


def state_at(time_s: float, d: float = 1e-4) -> State:
    """Return the true state (1, ...), with rates by differences."""
    turn = log((attitude(time_s + d) @ attitude(time_s - d).T)[None]) / (2 * d)
    speed = (place(time_s + d) - place(time_s - d)) / (2 * d)
    return State(attitude(time_s)[None], place(time_s)[None], speed[None], turn)


def sensors(time_s: Floats) -> Inertial:
    """Return what biased sensors show."""
    d = 1e-4
    rate, force = np.empty((2, len(time_s), 3))
    for i, t in enumerate(time_s.tolist()):
        rotation = attitude(t)
        push = (place(t + d) - 2 * place(t) + place(t - d)) / d**2
        rate[i] = rotation.T @ state_at(t).angular_rate[0] + GYRO_BIAS
        force[i] = rotation.T @ (push + UP) + FORCE_BIAS
    return Inertial(time_s, rate, force)


def flown(
    stations_seen: int, *, inertial: bool, first: int = 0
) -> tuple[StationNavigator, list[tuple[int, float, float]]]:
    """Return a navigator, and status, error [m] and sigma [m] of each period; from period DARK on there is no light."""
    rng, stations = np.random.default_rng(2), room((2, 2))
    epochs = np.arange(1, PERIODS + 1) * FRAME_S
    samples = shown(sensors(np.arange(-2, PERIODS * 2 + 6) / 100.0), epochs.astype(np.float64), FRAME_S)
    assert samples is not None
    settings = NavigationSettings(
        frame_s=FRAME_S,
        angle_noise_rad=5e-5,
        rotor_correlation=0.1,
        acceleration_noise_m_s2=10.0,
        angular_acceleration_noise_rad_s2=20.0,
        coast_limit_s=1.0,
        coupling="tight",
        hand=HandMotion(),
        inertial=InertialSensors((0.0, 0.0, 9.80665), 0.5) if inertial else None,
    )
    layout = pad([DECK], [np.tile([0.0, 0.0, 1.0], (len(DECK), 1))])
    navigator, out = StationNavigator(layout, settings, stations, NOISE), []
    for i in range(PERIODS):
        truth = state_at(float(epochs[i]))
        rows = seen(stations, DECK, truth, NOISE, rng)
        kept = (rows.station < stations_seen + first) & (rows.station >= first) & (i < DARK)
        own = InertialLight._make(part[i : i + 1] for part in samples)
        light = RowLight(rows.where(kept), NONE, NONE, own if inertial else None)
        estimate = navigator.step(light)
        error = float(np.linalg.norm(estimate.position[0] - truth.position[0]))
        sigma = float(np.sqrt(np.trace(estimate.covariance[0][6:9, 6:9])))
        out.append((int(estimate.status[0]), error, sigma))
    return navigator, out


def test_sensors_carry_a_filter_through_the_dark_and_their_biases_are_found() -> None:
    navigator, aided = flown(2, inertial=True)
    _, alone = flown(2, inertial=False)
    assert aided[DARK - 1][0] == Status.TRACKING
    dark = DARK + round(0.4 / FRAME_S)
    assert aided[dark][0] == alone[dark][0] == Status.COASTING
    # Without sensors the hand leads anywhere within 0.4 s; both say how far.
    assert alone[dark][1] > 0.15
    assert aided[dark][1] < 0.03
    assert all(error < 4 * sigma for _, error, sigma in aided[10:] + alone[10:])
    found = navigator._inertial
    assert found is not None
    sigma = np.sqrt(np.diag(found._variance[0]))
    assert np.all(np.abs(found.bias[0, :3] - GYRO_BIAS) < 4 * sigma[:3])
    assert np.all(sigma[:3] < 0.02)
    # Of gravity and the accelerometer's bias the sum alone is known well, as long as the attitude hardly changes.
    assert np.all(np.abs(found.bias[0, 3:6] - FORCE_BIAS) < 4 * sigma[3:6])


def test_one_station_and_a_plane_are_decided_by_what_the_sensors_show() -> None:
    _, alone = flown(1, inertial=False)
    _, aided = flown(1, inertial=True)
    known = [
        np.mean([status in (Status.TRACKING, Status.SINGLE_SWEEPS) for status, _, _ in run[:DARK]])
        for run in (alone, aided)
    ]
    assert known[1] > 0.8
    assert known[1] >= known[0]
    assert all(
        error < max(0.1, 4 * sigma) for status, error, sigma in aided if status != Status.AMBIGUOUS and sigma > 0
    )


def test_what_is_known_of_biases_never_turns_negative() -> None:
    """Rows that turn an attitude far, of a filter that hardly knew it, do not break what is known beside it."""
    rng, bank, own = np.random.default_rng(3), CompiledFilterBank(1, gate_probability=1.0), np.array([True])
    bank.adopt(own, state_at(0.3), np.diag(np.repeat([0.6, 5.0, 1.0, 1.0], 3) ** 2)[None])
    found = Biased(1, InertialSensors((0.0, 0.0, 9.80665), 0.5))
    for _ in range(20):
        found.begin(bank, FRAME_S)
        bank.predict(FRAME_S, own)
        found.carry(bank, InertialLight(*rng.normal(0, 3.0, (3, 1, 3))), FRAME_S, (10.0, 20.0))
        h, d = 100 * rng.standard_normal((3, 12)), 10 * rng.standard_normal((3, 9))
        before = bank.covariance[0]
        y = np.sqrt(np.diag(h @ before @ h.T)) * rng.standard_normal(3)
        bank.update(own, y[None], h[None], np.ones((1, 3)), pivot=np.full((1, PIVOT), 0.3))
        found.rows(0, y, h, bank, before, d)
        assert np.linalg.eigvalsh(found._variance[0])[0] > 0


def test_samples_are_means_over_periods_and_gaps_are_none() -> None:
    time_s = np.concatenate([np.arange(0, 0.2, 0.01), np.arange(0.3, 0.5, 0.01)])
    ramp = np.stack([time_s, 2 * time_s, -time_s], axis=1)
    found = shown(Inertial(time_s, ramp, ramp), np.array([0.1, 0.195, 0.25, 0.31, 0.4, 0.6]), 0.02)
    assert found is not None
    assert found.known.tolist() == [True, False, False, False, True, False]
    assert found.rate[0] == pytest.approx([0.1, 0.2, -0.1])
    assert found.before[0] == pytest.approx([0.08, 0.16, -0.08])
    assert found.force[4] == pytest.approx([0.39, 0.78, -0.39])
    assert shown(Inertial(np.zeros(0), np.zeros((0, 3)), np.zeros((0, 3))), np.array([0.1]), 0.02) is None


def test_considered_errors_do_not_grow_where_the_state_is_corrected_far() -> None:
    """A filter that a few rows move by many degrees: with derivatives after it, the sensitivities would explode."""
    rng, stations, layout = np.random.default_rng(1), room((2, 2)), pad([DECK], [np.tile([0.0, 0.0, 1.0], (4, 1))])
    truth = state_at(0.3)
    rows: RowBatch = seen(stations, DECK, truth, NOISE, rng)
    one = rows.where(rows.station == 0)
    sigma = PlaceSigma(np.zeros((2, 6, 6)), np.full(2, 5e-5), 1e-4, np.full(2, 5e-5))
    places = PlaceErrors(sigma, stations, NOISE, layout)
    off = truth._replace(rotation=exp(np.array([[0.5, -0.4, 0.3]])) @ truth.rotation)
    p = np.diag(np.repeat([0.3, 3.0, 0.1, 2.0], 3) ** 2)[None]
    every = np.ones(len(one.angle), dtype=np.bool_)
    for _ in range(20):
        places.rows(one, every, np.ones(1, dtype=np.bool_), (off, p))
    grown = np.sqrt(np.trace(places.widened(np.zeros((1, 12, 12)))[0][6:9, 6:9]))
    assert grown < 1.0


@pytest.fixture(scope="module", params=["i", "I"])
def recorded(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Recording:
    """A second of a hand with inertial sensors, in counts or in g and rad/s."""
    made = made_recording.Made(duration_s=1.0, imu=request.param)
    file = made_recording.write(tmp_path_factory.mktemp("imu") / "hand.rec.gz", made_recording.lines(made))
    return read_libsurvive(file, made_recording.DEVICE)


def test_lines_of_libsurvive_are_what_the_object_does_at_its_origin(recorded: Recording) -> None:
    light = object_of(recorded)
    at_s = light.inertial.time_s - 1.0
    assert len(at_s) > 200
    rate, _, force = made_recording.moved(at_s)
    left = np.concatenate([0.1 * made_recording.GYRO_BIAS, 0.1 * made_recording.FORCE_BIAS])
    turned = made_recording.IMU_TURN.apply(left.reshape(2, 3))
    inner = slice(2, -2)
    assert np.abs(light.inertial.rate - rate - turned[0])[inner].max() < 2e-3
    # A count of the gyroscope makes 0.1 rad/s^2 of the rate's change, and that 5 mm/s^2 per 50 mm.
    assert np.abs(light.inertial.acceleration - force - turned[1])[inner].max() < 0.02


def test_sensors_of_which_nobody_knows_how_they_sit_are_left_out_in_a_sentence(tmp_path: Path) -> None:
    text = made_recording.lines(made_recording.Made(duration_s=0.3, imu="i"))
    for wrong in ('"plus_q"', '"plus_x": 3, "plus_y"'):
        config = [line.replace('"plus_x"', wrong) for line in text]
        found = read_libsurvive(made_recording.write(tmp_path / "hand.rec.gz", config), made_recording.DEVICE)
        assert not len(found.inertial.time_s)
        assert any("CONFIG does not tell how they sit" in sentence for sentence in found.losses.sentences())
