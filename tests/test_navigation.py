"""What a craft makes of its own pulses: alone as in a swarm, through loss of light, never a silent wrong pose."""

from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np
import pytest

import swarm
from estimators import rotation as rot
from estimators.arrays import Bools
from swarm.flight import builders
from swarm.flight.flight import Flight
from swarm.hardware import Photodiodes, pad
from swarm.messages import Pulses, Signals
from swarm.onboard.acquisition import DECISIVE, Sighting, follow, search
from swarm.onboard.computer import Computer
from swarm.onboard.decoder import Expect, PulseDecoder, SweepAngles
from swarm.onboard.navigation import Estimate, Navigator
from swarm.onboard.settings import NavigationSettings, Status
from swarm.results.period import Period
from swarm.scenario import load
from swarm.sensors.lighthouse import Rotor
from swarm.world.world import PeriodTruth

PERIOD_S = 1 / 60
NOISE_RAD = np.radians(8.8 / 3600)
RHO = 0.8717
SETTINGS = NavigationSettings(frame_s=PERIOD_S, angle_noise_rad=NOISE_RAD, rotor_correlation=RHO)


def angles_of(points_m: np.ndarray, rng: np.random.Generator, noise_rad: float, seen: np.ndarray) -> SweepAngles:
    """Angles of points (C, K, 3) [m] in the lighthouse frame, all at the epoch, with noise as in (19)."""
    shared, own = rng.standard_normal(2), rng.standard_normal((*seen.shape, 2))
    noise = noise_rad * (np.sqrt(RHO) * shared + np.sqrt(1 - RHO) * own)
    theta = np.arctan2(points_m[..., 2:], points_m[..., :2]) + noise
    none = np.zeros(len(seen), dtype=np.int64)
    theta[~seen] = np.nan
    return SweepAngles(theta, np.zeros_like(theta), seen, none, none, none)


def layout_of(points: np.ndarray) -> Photodiodes:
    return pad([points], [np.tile([0.0, 0.0, 1.0], (len(points), 1))])


def alone(pulses: Pulses, craft: int) -> Pulses:
    total = int(pulses.total[craft])
    one = slice(craft, craft + 1)
    photodiode, rise, width = pulses.photodiode, pulses.rise_tick, pulses.width_tick
    return Pulses(photodiode[one, :total], rise[one, :total], width[one, :total], pulses.total[one])


def decoded(decoder: PulseDecoder, navigator: Navigator, pulses: Pulses) -> Estimate:
    """One period of pulses, decoded by what the tracks expect, and navigated by."""
    return navigator.step(decoder.decode(pulses, partial(navigator.expected_angles, decoder.turn_s)))


def beside(pulses: Pulses, off_rad: float) -> Pulses:
    """The pulses with a second one beside every sweep's, as wide as that, as of a reflection."""
    flash = pulses.width_tick > 30e-6 / 20e-9
    later = round(off_rad / (2 * np.pi) * PERIOD_S / 20e-9)
    last = np.int64(2**62)
    rise = np.concatenate([pulses.rise_tick, np.where(flash, last, pulses.rise_tick + later)], axis=1)
    real = np.arange(pulses.rise_tick.shape[1]) < pulses.total[:, None]
    rise = np.where(np.concatenate([real, real & ~flash], axis=1), rise, last)
    order = np.argsort(rise, axis=1, kind="stable")
    twice = (np.take_along_axis(np.concatenate([column] * 2, axis=1), order, axis=1) for column in pulses[:3:2])
    photodiode, width = twice
    total = (np.take_along_axis(rise, order, axis=1) < last).sum(axis=1)
    return Pulses(photodiode, np.take_along_axis(rise, order, axis=1), width, total.astype(np.int32))


def flown_with_strays(first: int) -> list[Period]:
    """Forty periods of `static`, with a second pulse beside every sweep's from period `first` on."""
    flight = Flight(load("static", ["duration_s=1", "seed=5"]))
    signals = flight.sensors.signals

    def doubled(truth: PeriodTruth, frame: int, lit: Bools, rotor: Rotor | None = None) -> Signals:
        found = signals(truth, frame, lit, rotor)
        return found if frame < first else found._replace(pulses=beside(found.pulses, 15e-3))

    flight.sensors.signals = doubled  # type: ignore[method-assign]
    return [flight.period(frame) for frame in range(40)]


def test_of_two_pulses_in_a_sweep_a_track_takes_the_true_one_and_without_a_track_both_are_dropped() -> None:
    before, after = (flown_with_strays(first=20)[frame] for frame in (19, 39))
    assert before.angles.lit.any(axis=1).all()
    np.testing.assert_array_equal(after.angles.lit, before.angles.lit)
    np.testing.assert_allclose(after.angles.theta, before.angles.theta, atol=6 * NOISE_RAD)
    assert (after.estimate.status == Status.TRACKING).all()
    np.testing.assert_array_equal(after.angles.rejected, 2 * after.angles.lit.sum(axis=1))

    blind = flown_with_strays(first=0)
    assert not any(period.angles.lit.any() for period in blind)
    assert (blind[39].angles.rejected >= 4 * before.angles.lit.sum(axis=1)).all()


@pytest.fixture(scope="module")
def swarm_run() -> tuple[Flight, list[Pulses], list[Estimate]]:
    """Two kinds of craft that occlude each other, with pulses lost, missed and stray: the pulses and the estimates."""
    scenario = load(
        "crossing",
        [
            "duration_s=3",
            "lighthouse.missed_sync_probability=0.02",
            "lighthouse.lost_pulse_probability=0.05",
            "lighthouse.stray_pulse_rate_hz=20",
        ],
    )
    flight = Flight(scenario)
    pulses: list[Pulses] = []
    assert isinstance(flight.computer, Computer)
    decoder = flight.computer.decoder
    decode = decoder.decode

    def kept(found: Pulses, expected: Expect | None = None) -> SweepAngles:
        pulses.append(found)
        return decode(found, expected)

    decoder.decode = kept  # type: ignore[method-assign, assignment]
    return flight, pulses, [flight.period(frame).estimate for frame in range(180)]


@pytest.mark.parametrize("bank", ["filterpy", "compiled"])
def test_a_craft_knows_the_same_alone_and_in_a_swarm_bit_for_bit(swarm_run, bank):
    flight, pulses, together = swarm_run
    settings = replace(builders.navigation(load("crossing")), filter=bank)
    if bank != "filterpy":
        decoder = builders.decoder(load("crossing"), flight.world.photodiodes.present)
        navigator = Navigator(flight.world.photodiodes, settings)
        together = [decoded(decoder, navigator, period) for period in pulses]
    tracked = 0
    for craft in range(flight.world.photodiodes.craft_count):
        layout = flight.world.photodiodes.of(craft)
        decoder = builders.decoder(load("crossing"), layout.present)
        navigator = Navigator(layout, settings)
        for every, period in zip(together, pulses, strict=True):
            own = decoded(decoder, navigator, alone(period, craft))
            for name in ("status", "visible", "rotation", "position", "velocity", "covariance", "nis", "rejected"):
                np.testing.assert_array_equal(getattr(own, name)[0], getattr(every, name)[craft], err_msg=name)
            np.testing.assert_array_equal(own.pnp.position[0], every.pnp.position[craft])
            np.testing.assert_array_equal(own.dilution.covariance[0], every.dilution.covariance[craft])
            tracked += own.status[0] == Status.TRACKING
    assert tracked > 500, "the comparison must be of craft that track, not of nothing"


def test_filterpy_is_the_filter_its_numbers_are_the_estimate(swarm_run, monkeypatch):
    from filterpy.kalman import ExtendedKalmanFilter

    flight, pulses, _ = swarm_run
    layout = flight.world.photodiodes.of(0)
    decoder, navigator = PulseDecoder(layout.present, 20e-9), Navigator(layout, SETTINGS)
    seen: list[tuple[np.ndarray, float]] = []
    update = ExtendedKalmanFilter.update

    def spy(self, *args, **kwargs):
        update(self, *args, **kwargs)
        seen.append((self.P.copy(), self.mahalanobis**2))

    monkeypatch.setattr(ExtendedKalmanFilter, "update", spy)
    updates = 0
    for period in pulses[:60]:
        seen.clear()
        estimate = decoded(decoder, navigator, alone(period, 0))
        if seen and estimate.status[0] == Status.TRACKING:
            np.testing.assert_array_equal(estimate.covariance[0], seen[0][0])
            assert estimate.nis[0] == seen[0][1]
            updates += 1
    assert updates > 40


def test_two_poses_that_fit_alike_are_kept_and_said_to_be_ambiguous_until_more_light_decides():
    # A flat, small square far away, turned by 20 degrees: its mirror image fits almost as well.
    rng = np.random.default_rng(4)
    square = 0.03 * np.array([[1.0, 1, 0], [-1, 1, 0], [-1, -1, 0], [1, -1, 0]])
    bump = np.array([[0.0, 0.0, 0.06], [0.02, 0.0, 0.05]])
    points = np.concatenate([square, bump])
    layout = layout_of(points)
    rotation = rot.exp(np.array([0.0, np.radians(180 - 20), 0.0]))
    in_light = points @ rotation.T + [0.1, -0.1, 6.0]
    navigator = Navigator(layout, SETTINGS)
    flat = np.array([[True] * 4 + [False] * 2])
    first = navigator.step(angles_of(in_light[None], rng, NOISE_RAD, flat))
    assert first.status[0] == Status.AMBIGUOUS
    assert np.isnan(first.position).all()
    assert not first.pnp.solved[0], "an ambiguous craft gives no pose at all"
    every = np.ones((1, 6), dtype=bool)
    for _ in range(5):
        last = navigator.step(angles_of(in_light[None], rng, NOISE_RAD, every))
    assert last.status[0] == Status.TRACKING
    error = rot.angle_between(last.rotation[0], rotation)
    assert error < 5 * np.sqrt(np.trace(last.covariance[0, :3, :3]))


def test_the_evidence_of_a_flat_target_never_decides_for_the_mirror_pose():
    rng = np.random.default_rng(8)
    square = 0.03 * np.array([[1.0, 1, 0], [-1, 1, 0], [-1, -1, 0], [1, -1, 0]])
    independent = NOISE_RAD * np.sqrt(1 - RHO)
    decided = wrong = 0
    for _ in range(40):
        tilt = np.radians(rng.uniform(15, 50)) * np.array([*rng.standard_normal(2), 0.0])
        rotation = rot.exp(np.array([0.0, np.pi, 0.0])) @ rot.exp(tilt)
        in_light = square @ rotation.T + [*rng.uniform(-1, 1, 2), rng.uniform(2, 5)]
        hypotheses = None
        for _ in range(60):
            seen = angles_of(in_light[None], rng, NOISE_RAD, np.ones((1, 4), dtype=bool))
            sighting = Sighting(seen.theta[0], seen.lit[0], square, seen.offset_s[0])
            hypotheses = (
                search(sighting, independent) if hypotheses is None else follow(hypotheses, sighting, independent)
            )
            if len(hypotheses.evidence) == 0 or hypotheses.decided:
                break
        assert hypotheses is not None
        if len(hypotheses.evidence) and hypotheses.decided:
            decided += 1
            # The mirror pose of a plane tilted by 15 degrees or more is at least some 20 degrees away.
            wrong += rot.angle_between(hypotheses.rotation[0], rotation) > np.radians(10)
    assert decided > 10
    assert wrong == 0
    assert DECISIVE == 25.0, "5 sigma: 3e-7 per decision"


def test_it_coasts_without_light_gives_up_after_the_limit_and_finds_itself_again():
    rng = np.random.default_rng(2)
    points = rng.uniform(-0.06, 0.06, (8, 3))
    layout = layout_of(points)
    rotation = rot.exp(np.array([0.2, 2.8, 0.1]))
    in_light = (points @ rotation.T + [0.2, 0.1, 3.0])[None]
    every, few = np.ones((1, 8), dtype=bool), np.array([[True] * 3 + [False] * 5])
    navigator = Navigator(layout, replace(SETTINGS, coast_limit_s=0.5, coupling="loose"))

    def step(seen):
        return navigator.step(angles_of(in_light, rng, NOISE_RAD, seen))

    for _ in range(30):
        lit = step(every)
    assert lit.status[0] == Status.TRACKING
    coasting = [step(few) for _ in range(29)]
    assert {int(e.status[0]) for e in coasting} == {Status.COASTING}
    spread = [np.trace(e.covariance[0, 6:9, 6:9]) for e in coasting]
    assert np.all(np.diff(spread) > 0), "without light the uncertainty can only grow"
    assert all(np.isnan(e.pnp.position).all() for e in coasting)
    lost = [step(few) for _ in range(5)][-1]
    assert lost.status[0] == Status.SEARCHING
    assert np.isnan(lost.position).all()
    assert step(every).status[0] == Status.TRACKING


def test_a_pose_that_the_filter_does_not_believe_is_refused_and_a_jump_that_stays_is_found_again():
    rng = np.random.default_rng(3)
    points = rng.uniform(-0.06, 0.06, (8, 3))
    rotation = rot.exp(np.array([0.2, 2.8, 0.1]))
    every = np.ones((1, 8), dtype=bool)
    navigator = Navigator(layout_of(points), SETTINGS)

    def step(position):
        return navigator.step(angles_of((points @ rotation.T + position)[None], rng, NOISE_RAD, every))

    for _ in range(60):
        step([0.0, 0.0, 3.0])
    jumped = step([0.5, 0.0, 3.0])
    assert jumped.status[0] == Status.COASTING
    assert jumped.nis[0] > 100
    assert abs(jumped.position[0, 0]) < 0.01
    for _ in range(SETTINGS.rejections_limit):
        after = step([0.5, 0.0, 3.0])
    assert after.status[0] == Status.TRACKING
    assert after.position[0, 0] == pytest.approx(0.5, abs=0.01)


def test_nothing_seen_from_the_start_is_a_search_and_no_number():
    navigator = Navigator(layout_of(np.eye(4, 3)), SETTINGS)
    nothing = navigator.step(angles_of(np.ones((1, 4, 3)), np.random.default_rng(0), 0.0, np.zeros((1, 4), dtype=bool)))
    assert nothing.status[0] == Status.SEARCHING
    for part in (nothing.position, nothing.rotation, nothing.covariance, nothing.nis, nothing.pnp.position):
        assert np.isnan(part).all()


@pytest.mark.parametrize(("tick_ns", "jitter_ns"), [(1, 100), (20, 100), (200, 0), (200, 100)])
def test_the_filter_knows_the_noise_of_ticks_and_jitter(tick_ns: float, jitter_ns: float, tmp_path: Path) -> None:
    """Their variances add to the sweep's: without them the NEES of 200 ns is 12.

    With 100 ns of jitter the mean of one flight is 6.5 with a standard deviation of 0.18 (20 flights); three count.
    """
    timing = [f"lighthouse.tick_ns={tick_ns}", f"lighthouse.sync_jitter_ns={jitter_ns}", "navigation.filter=compiled"]
    nees = []
    for seed in (1, 2, 3):
        run = swarm.simulate(load("drift", [*timing, f"seed={seed}"]), out=tmp_path / str(seed), record=False)
        nees.append(run.summary["swarm"]["nees"]["mean"])
        assert run.summary["swarm"]["integrity"]["failed_residual_test_share"] < 1e-3
    assert 5.3 < np.mean(nees) < 6.7
