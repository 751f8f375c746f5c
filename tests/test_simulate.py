"""Every shipped scenario flies, and shows what it is for. Bounds are the product's promises, not what came out."""

import json
from functools import cache
from io import StringIO
from typing import Any

import numpy as np
import pyarrow.compute as pc
import pytest
from rich.console import Console
from scipy.stats import chi2

import swarm
import swarm.scenario as swarm_scenario
from estimators import rotation as rot
from estimators.arrays import Floats
from swarm.assets import scenarios
from swarm.errors import SwarmError
from swarm.flight import builders
from swarm.flight.flight import Flight
from swarm.report.run_table import print_report
from swarm.results.period import Period
from swarm.results.run_folder import Run
from swarm.results.summary import consistency


@pytest.fixture(scope="module")
def flown(tmp_path_factory):
    folder = tmp_path_factory.mktemp("runs")

    @cache
    def fly(name: str, *overrides: str) -> Run:
        out = folder / f"{name}-{abs(hash(overrides))}"
        return swarm.simulate(swarm.load(name, overrides), out=out, record=False)

    return fly


def column(run: Run, name: str, craft: str | None = None) -> np.ndarray:
    table = run.telemetry if craft is None else run.telemetry.filter(pc.equal(run.telemetry["craft"], craft))
    return table[name].to_numpy()


# The survey's craft is uncalibrated on purpose: its errors are not the noise that a filter can know of. The fan errors
# that docking-moving considers are one draw in the whole flight.
# In the parade of faults a craft gets a kick, in a docking the blow of contact, that no filter can know of. Guided
# craft fly in shorter form in test_guided_flight, LiDARs in test_lidar, flat craft and
# craft whose photodiodes are often dark below.
ELSEWHERE = {
    "drift",
    "survey",
    "ccd-docking",
    "swarm1000",
    "constellation16",
    "dotbots1000",
    "fault-parade",
    "docking",
    "docking-moving",
    "formation-reconfigure",
    "inspection",
    "inspect-satellite",
    "inspect-shuttle",
    "swarm-inspect",
    "plate",
    "tumble",
    "eclipse",
}
STEERED = {"crossing", "formation"}
"""Scenarios whose craft move smoothly, by orders that their filters do not know."""
LONG = {"cloud", "crossing", "free-flight", "orbit", "rendezvous", "static", "two-stations"}
SEEDS = {"static": (3, 4, 5, 6)}
"""Flights whose mean counts, of few craft at rest, which average for seconds: one alone has 4.9 with a standard
deviation of 0.5."""


@pytest.mark.parametrize(
    "name",
    [
        pytest.param(
            name,
            marks=[pytest.mark.long] if name in LONG else [],
        )
        for name in sorted(set(scenarios()) - ELSEWHERE)
    ],
)
def test_the_filter_is_neither_vain_nor_timid_in_any_scenario_with_one_set_of_process_noise(flown, name):
    # 6 is what the filter promises on motion like one of its models; a smooth motion lies between the 4.5 of a filter
    # that expects accelerations which never come (alpha-beta theory at low tracking index) and 7.5.
    low, high = (5.0, 7.0) if name in STEERED else (4.5, 7.5)
    several: list[list[str]] = [["navigation.filter=compiled", f"seed={seed}"] for seed in SEEDS.get(name, ())]
    means = [flown(name, *overrides).summary["swarm"]["nees"]["mean"] for overrides in several or [[]]]
    assert low < np.mean(means) < high


def test_tumbling_craft_keep_their_pose_by_single_sweeps(flown):
    """With four photodiodes or nothing a third of the time had no estimate, at errors of 8.9 mm and 1.24 deg."""
    run = flown("tumble", "duration_s=10")
    settled = column(run, "time_s") > 2.0
    known = np.isfinite(column(run, "position_error_m"))
    assert np.mean(~known[settled]) <= 0.1
    few = settled & known & (column(run, "visible") < 4)
    assert few.sum() > 500
    position_m, attitude_deg = column(run, "position_error_m")[few], column(run, "attitude_error_deg")[few]
    assert np.sqrt(np.mean(position_m**2)) <= 8.9e-3 / 3
    assert np.sqrt(np.mean(attitude_deg**2)) <= 1.24 / 3


def bound(flight: Flight, period: Period) -> Floats:
    """Return the posterior Cramer-Rao bound (C, 12, 12) of craft that keep the pose and the light of a period.

    By the information recursion of Tichavsky, Muravchik and Nehorai: J' = (Q + F J^-1 F^T)^-1 + sum of H^T R^-1 H.
    """
    settings, truth, seen = flight.computer.navigator.settings, period.truth, period.angles.lit
    assert truth is not None
    dt, noise = settings.frame_s, settings.noise
    arm = np.einsum("cij,ckj->cki", rot.matrix_from_quaternion(truth.quaternion), flight.world.photodiodes.point_m)
    q, light = truth.position[:, None] + arm, np.zeros((len(seen), 12, 12))
    for fan, begin in enumerate((-0.25, 0.25)):
        across, away = q[..., fan], q[..., 2]
        tau = (begin - np.arctan2(across, away) / (2 * np.pi)) * dt
        slope = np.zeros(q.shape)
        slope[..., fan], slope[..., 2] = -away / (across**2 + away**2), across / (across**2 + away**2)
        turn = np.cross(arm, slope)
        h = np.concatenate([turn, turn * tau[..., None], slope, slope * tau[..., None]], axis=-1)
        h = np.where(seen[..., None], h, 0.0)
        both, count = h.sum(axis=1), seen.sum(axis=1)
        k = noise.shared_rad**2 / (noise.own_rad**2 + count * noise.shared_rad**2)
        light += (np.swapaxes(h, 1, 2) @ h - k[:, None, None] * both[:, :, None] * both[:, None]) / noise.own_rad**2
    sigma = settings.angular_acceleration_noise_rad_s2, settings.acceleration_noise_m_s2
    gamma, ahead = np.array([dt**2 / 2, dt]), np.array([[1.0, dt], [0.0, 1.0]])
    q_noise = np.kron(np.diag(np.square(sigma)), np.kron(np.outer(gamma, gamma), np.eye(3)))
    f = np.kron(np.eye(2), np.kron(ahead, np.eye(3)))
    p = np.tile(np.diag(np.repeat([0.1, 1.0, 0.1, 1.0], 3)), (len(seen), 1, 1))
    for _ in range(60):
        p = np.linalg.inv(np.linalg.inv(f @ p @ f.T + q_noise) + light)
    return p


def test_drift_is_consistent_with_the_chi_square_band_and_near_the_posterior_bound():
    """Over 1000 independent values of NEES: their mean is known to 1.8 % (1 sigma), so that 12 % of P is 6 sigma away.

    Independent are the values after their correlation in time and the rotor's noise, which the craft share. Two of 24
    craft that drift among each other touch in every other flight: no filter knows of the blow, and they are left out
    from then on.
    """
    craft, pose = 24, np.ix_(*[[0, 1, 2, 6, 7, 8]] * 2)
    values = [f"swarm.count={craft}", "swarm.motion.spacing_m=0.6", "duration_s=10", "navigation.filter=compiled"]
    flight = Flight(swarm.load("drift", values))
    nees, nis, errors, bounds = [], [], [], []
    touched = np.zeros(craft, dtype=bool)
    for period in flight.fly():
        truth, estimate = period.truth, period.estimate
        assert truth is not None
        touched |= truth.contact
        if period.frame % 120 == 60:
            best = np.diagonal(bound(flight, period), axis1=1, axis2=2)
            bounds.append(np.where(touched[:, None], np.nan, best))
        turn = rot.log(rot.matrix_from_quaternion(truth.quaternion) @ np.swapaxes(estimate.rotation, 1, 2))
        error = np.concatenate([turn, truth.position - estimate.position], axis=1)[..., None]
        error[touched] = np.nan
        errors.append(error[..., 0])
        covariance = np.stack([own[pose] for own in estimate.covariance])
        nees.append((np.swapaxes(error, 1, 2) @ np.linalg.solve(covariance, error))[:, 0, 0])
        nis.append(np.where(touched, np.nan, estimate.nis))
    assert touched.sum() <= 2
    for every in (np.array(nees), np.array(nis)):
        settled = every[30:]
        known = np.isfinite(settled)
        assert known.mean() > 0.95
        found = consistency(np.nonzero(known)[0], settled[known], flight.period_s)
        assert found is not None
        effective = found["effective_samples"]
        assert effective > 1000
        low, high = chi2.ppf([0.0005, 0.9995], 6 * effective) / effective
        assert low < found["mean"] < high
    square, variance = np.array(errors)[30:], np.array(bounds)
    for part, of in ((slice(0, 3), slice(0, 3)), (slice(3, 6), slice(6, 9))):
        ratio = np.sqrt(
            np.nanmean(np.sum(square[..., part] ** 2, axis=2)) / np.nanmean(np.sum(variance[..., of], axis=2))
        )
        # 3 % is two sigmas of an RMS of over 1000 independent errors.
        assert 0.97 < ratio < 1.05


def test_the_time_of_a_period_is_its_epoch():
    """Truth and estimate of a period are those of `time_s`, its middle: at 1 m/s half a period is 8 mm."""
    motion = "swarm.motion={kind='drift', acceleration_m_s2=0, angular_acceleration_deg_s2=0, velocity_m_s=[1, 0, 0]}"
    flight = Flight(
        swarm.load("drift", ["swarm.count=1", "duration_s=0.5", motion, "swarm.motion.position_m=[0, 0, 3]"])
    )
    for period in flight.fly():
        assert period.truth is not None
        assert period.time_s == pytest.approx((period.frame + 0.5) * flight.period_s, abs=1e-12)
        at = [period.time_s, 0.0, 3.0]
        assert period.truth.position[0] == pytest.approx(at, abs=1e-9)
    # The estimate errs by a millimetre or so; its rate is known by now.
    assert period.estimate.position[0] == pytest.approx(at, abs=3e-3)


def test_a_plate_that_is_face_on_has_the_errors_that_its_filter_promises(tmp_path):
    """Eight of each: the filter of a craft at rest averages for seconds, so that five are hardly one sample."""
    plate = swarm.load("plate", ["duration_s=5"])
    craft = []
    for one in plate.craft:
        if one.name in ("head-on", "slanted"):
            hold: Any = one.motion
            _, y, z = hold.position_m
            for i in range(8):
                motion = hold.model_copy(update={"position_m": (0.3 * i - 1.05, y, z)})
                craft.append(one.model_copy(update={"name": f"{one.name}-{i}", "motion": motion}))
    run = swarm.simulate(plate.model_copy(update={"craft": craft}), out=tmp_path / "run", record=False)
    # To first order the NEES of those that are face-on is 14. The first sign of their tilt takes a period or two.
    for name in ("head-on", "slanted"):
        same = [run.summary["craft"][f"{name}-{i}"] for i in range(8)]
        share = [one["tracking_share"] for one in same]
        # Where both images are likely, both are followed until one leads.
        assert np.mean(share) > 0.97
        assert min(share) > 0.9
        assert 4.0 < np.mean([one["nees"]["mean"] for one in same]) < 7.5


def test_formation_tracks_and_its_filter_is_worth_having(flown):
    figures = flown("formation").summary["swarm"]
    assert figures["tracking_share"] > 0.99
    assert figures["ekf_to_pnp_position_ratio"] <= 0.6
    assert figures["ekf_to_pnp_attitude_ratio"] <= 0.6


def test_rendezvous_arrives_on_its_own_estimate(flown):
    run = flown("rendezvous")
    distance = np.hypot(
        np.hypot(column(run, "true_px_m", "chaser"), column(run, "true_py_m", "chaser")),
        column(run, "true_pz_m", "chaser"),
    )
    assert distance[0] == pytest.approx(8.0, abs=0.01)
    # The last second: at 1 m, with the controller's answer to millimetre noise of the estimate.
    assert np.abs(distance[-60:] - 1.0).max() < 0.01
    assert not column(run, "contact").any()


def test_crossing_darkens_photodiodes_and_every_craft_comes_back(flown):
    run = flown("crossing")
    assert run.telemetry.num_rows == 5 * 20 * 60
    dark = 0
    for name in ("left", "middle", "right"):
        visible, status = column(run, "visible", name), column(run, "status", name)
        dark += visible.min() < 4
        assert visible[:30].min() >= 4
        assert (status[-30:] == "tracking").all()
    assert dark >= 1, "somebody must have gone fully dark"
    coasted = column(run, "status") == "coasting"
    assert coasted.any()


@pytest.mark.long
def test_without_motion_compensation_the_summary_names_the_bias(flown):
    # x is swept a quarter period before the epoch, y a quarter after: the pose is that much early and late.
    quarter_s = 1 / 240
    off = flown("formation", "navigation.motion_compensation=false", "duration_s=10").summary["swarm"][
        "pnp_motion_bias"
    ]
    on = flown("formation", "duration_s=10").summary["swarm"]["pnp_motion_bias"]
    slope, sigma = np.array(off["position_slope_s"][:2]), np.array(off["position_slope_sigma_s"][:2])
    # Small sweep angles off centre shift the instants by up to 10 %: the ring is 22 degrees off boresight.
    np.testing.assert_allclose(slope, [-quarter_s, quarter_s], rtol=0.15)
    assert np.all(np.abs(slope) > 10 * sigma)
    assert np.all(np.abs(on["position_slope_s"][:2]) < 0.1 * quarter_s)


def test_the_same_seed_gives_the_same_telemetry_bit_for_bit_and_another_seed_does_not(tmp_path):
    def fly(folder: str, seed: int):
        return swarm.simulate(swarm.load("formation", ["duration_s=1"], seed), out=tmp_path / folder, record=False)

    first, again, other = fly("first", 1), fly("again", 1), fly("other", 2)
    assert first.telemetry.equals(again.telemetry)
    assert not first.telemetry.equals(other.telemetry)


def test_the_resolved_scenario_of_a_run_flies_the_same_run(tmp_path):
    first = swarm.simulate(swarm.load("crossing", ["duration_s=2"]), out=tmp_path / "first", record=False)
    again = swarm.simulate(swarm.load(first.folder / "scenario.toml"), out=tmp_path / "again", record=False)
    assert first.telemetry.equals(again.telemetry)


def test_more_craft_change_nothing_for_those_that_were_there(tmp_path):
    # Craft far apart do not shade each other; every draw goes by the craft's name.
    grid = "swarm.motion={kind='hold', position_m=[0, 0, 4], spacing_m=1.0, attitude={yaw_deg=15}}"
    alone = Flight(swarm.load("static", ["duration_s=1"]))
    beside = Flight(swarm.load("static", ["duration_s=1", grid, "swarm.count=1"]))
    for frame in range(30):
        one, two = alone.period(frame).estimate, beside.period(frame).estimate
        np.testing.assert_array_equal(one.position, two.position[1:])
        np.testing.assert_array_equal(one.covariance, two.covariance[1:])


def test_ctrl_c_leaves_a_run_that_opens_and_says_that_it_was_stopped(tmp_path):
    def stop(progress):
        if progress.time_s > 0.5:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        swarm.simulate(swarm.load("formation"), out=tmp_path / "run", record=False, progress=stop)
    run = swarm.open_run(tmp_path / "run")
    assert run.status == "interrupted"
    assert run.telemetry.num_rows == 8 * 31
    assert json.loads((tmp_path / "run" / "summary.json").read_text())["swarm"]["samples"] == 8 * 31


def test_a_run_is_never_overwritten_without_force(tmp_path):
    scenario = swarm.load("static", ["duration_s=0.1"])
    swarm.simulate(scenario, out=tmp_path / "run", record=False)
    with pytest.raises(SwarmError, match="--force"):
        swarm.simulate(scenario, out=tmp_path / "run", record=False)
    assert swarm.simulate(scenario, out=tmp_path / "run", record=False, force=True).status == "complete"


def test_a_swarm_fills_the_field_and_nearly_all_of_it_tracks(flown):
    """Half of swarm1000, in a fraction of its time: some stand in another's light, and nobody touches."""
    run = flown("swarm1000", "swarm.count=500", "duration_s=0.5")
    figures = run.summary["swarm"]
    assert run.telemetry.num_rows == 500 * 30
    assert 0.85 < figures["tracking_share"] < 1.0
    assert figures["ekf_position_rms_m"] < 0.02
    assert not column(run, "contact").any()
    settings = swarm.load("swarm1000")
    first = builders.fleet(settings).start().position
    field = np.tan(np.radians(settings.lighthouse.field_deg / 2))
    assert np.all(np.abs(first[:, :2]) < field * first[:, 2:])
    assert np.linalg.norm(first, axis=1).max() < settings.lighthouse.range_max_m


@pytest.mark.parametrize("table", [{"passive": True, "model": "satellite"}, {"lighthouse": False}])
def test_a_flight_in_which_no_craft_navigates_ends_with_nulls_for_what_cannot_be_measured(tmp_path, table):
    scenario = swarm_scenario.validate(
        {"duration_s": 0.1, "swarm": {"count": 2, "motion": {"kind": "hold", "spacing_m": 5.0}, **table}},
        file="nobody",
        folder=tmp_path,
    )
    assert builders.flat_craft(scenario, Flight(scenario).sensors.lighthouse.photodiodes) == []
    run = swarm.simulate(scenario, out=tmp_path / "run", record=False)
    assert run.status == "complete"
    assert run.summary["periods"] == 6
    swarm_figures = run.summary["swarm"]
    assert swarm_figures["samples"] == 0
    assert swarm_figures["tracking_share"] is None
    assert swarm_figures["pnp_motion_bias"]["position_slope_s"] == [None] * 3
    assert sorted(run.summary["craft"]) == ["craft-0", "craft-1"]
    printed = StringIO()
    print_report(Console(file=printed, width=80), run.summary, run.folder)
    assert "No craft navigates in this run" in printed.getvalue()
