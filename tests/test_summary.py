"""The summary against plain loops and against figures that were put into a made-up run."""

import json
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from scipy.stats import chi2
from synthetic_run import PERIOD_S, estimate_of, lost, period_of, truth_at

from estimators.rotation import exp, matrix_from_quaternion, quaternion_from_matrix
from swarm.results.columns.peer import PEER
from swarm.results.columns.schema import schema
from swarm.results.reading import read_telemetry
from swarm.results.records import Peer
from swarm.results.summary import Account, autocorrelation_time, consistency, figures, summarise, summarise_run
from swarm.results.summary.integrity import integrity
from swarm.results.summary.motion_bias import MotionBias
from swarm.results.summary.statistics import Moments
from swarm.results.table import TelemetryTable
from swarm.results.telemetry import Telemetry


def table_of(folder, periods, craft=4, estimates=estimate_of, replay=False, **options):
    folder.mkdir(exist_ok=True)
    rng = np.random.default_rng(11)
    out = Telemetry(folder, [f"craft-{i}" for i in range(craft)], [PEER] if replay else ())
    for k in range(periods):
        truth = truth_at(k * PERIOD_S, craft, rate_rad_s=0.3)
        estimate = estimates(truth, rng, **options)
        if k == 5 and craft > 2:
            estimate = lost(estimate, 2)
        if not replay:
            out.append(period_of((k + 0.5) * PERIOD_S, k, truth, estimate))
            continue
        # The peer tracks another point of the body, turned against ours, with noise of its own.
        at = matrix_from_quaternion(truth.quaternion)
        turn = exp(np.array([0.2, -0.1, 0.3]) + 1e-3 * rng.standard_normal((craft, 3)))
        position = truth.position + at @ np.array([0.01, 0.02, -0.03])
        peer = Peer(position + 1e-3 * rng.standard_normal((craft, 3)), quaternion_from_matrix(at @ turn))
        out.append(period_of((k + 0.5) * PERIOD_S, k, None, estimate, peer))
    out.close()
    return read_telemetry(folder)


def test_rms_maxima_and_shares_are_those_of_a_plain_loop(tmp_path):
    table = table_of(tmp_path, 40)
    summary = summarise(table)
    rows = table.to_pylist()
    for name in [None, "craft-0", "craft-2"]:
        figures = summary["swarm"] if name is None else summary["craft"][name]
        mine = [row for row in rows if name in (None, row["craft"])]
        for key, column in (
            ("pnp_position", "pnp_position_error_m"),
            ("pnp_attitude", "pnp_attitude_error_deg"),
            ("ekf_position", "position_error_m"),
            ("ekf_attitude", "attitude_error_deg"),
        ):
            unit = column.rsplit("_", 1)[1]
            square, largest, count = 0.0, 0.0, 0
            for row in mine:
                if row[column] is not None:
                    square, largest, count = square + row[column] ** 2, max(largest, row[column]), count + 1
            # Sums of a few hundred doubles in another order.
            assert figures[f"{key}_rms_{unit}"] == pytest.approx((square / count) ** 0.5, rel=1e-12)
            assert figures[f"{key}_max_{unit}"] == largest
        tracked = sum(row["status"] == "tracking" for row in mine)
        assert figures["tracking_share"] == pytest.approx(tracked / len(mine))
        assert figures["mean_visible"] == pytest.approx(sum(row["visible"] for row in mine) / len(mine))
        nees = [row["nees"] for row in mine if row["nees"] is not None]
        assert figures["nees"]["mean"] == pytest.approx(sum(nees) / len(nees))
        assert figures["nees"]["samples"] == len(nees) == len(mine) - (name != "craft-0")
        assert figures["mean_adop_deg_per_rad"] == 900.0
        assert figures["solved_share"] == 1.0
    assert summary["craft_count"] == 4
    assert summary["periods"] == 40
    assert summary["duration_s"] == pytest.approx(40 * PERIOD_S)
    assert json.loads(json.dumps(summary, allow_nan=False)) == summary


@pytest.mark.parametrize("replay", [False, True])
def test_a_folder_says_what_its_table_says(tmp_path, replay, monkeypatch):
    table = table_of(tmp_path, 40, replay=replay)
    whole = summarise(table)
    assert summarise_run(tmp_path) == whole
    monkeypatch.setattr("swarm.results.table.BLOCK", 7)
    assert summarise(table) == whole
    assert summarise_run(tmp_path / "nothing")["swarm"] is None


def test_rows_taken_while_a_run_flies_say_what_its_file_says(tmp_path):
    """Bit for bit, although the file's groups were joined: they are not the blocks that were taken."""
    account, craft, rng = Account([f"craft-{i}" for i in range(3)]), 3, np.random.default_rng(5)
    out = Telemetry(tmp_path, account.names, taken=account.take)
    for k in range(400):
        truth = truth_at(k * PERIOD_S, craft, rate_rad_s=0.3)
        out.append(period_of((k + 0.5) * PERIOD_S, k, truth, estimate_of(truth, rng)))
    out.close()
    assert pq.ParquetFile(tmp_path / "telemetry.parquet").num_row_groups == 1
    taken = summarise_run(tmp_path, account)
    assert taken["periods"] == 400
    assert taken == summarise_run(tmp_path)


def test_the_sigma_of_a_craft_is_that_of_least_squares_over_all_its_rows_at_once():
    """Its sum of squares is kept up to date with the slope; in one pass more it is a plain sum."""
    rng, n = np.random.default_rng(3), 500
    rate = 0.1 * rng.standard_normal((3, n))
    rate[2] = 0.0
    for noise in (1e-3, 1e-9):
        error = 0.004 * rate + noise * rng.standard_normal((3, n))
        error[0, 7] = np.nan
        bias = MotionBias(np.array([0]))
        for rows in np.array_split(np.arange(n), 7):
            bias.add(
                rows,
                np.zeros(len(rows), dtype=np.int64),
                *(tuple(np.ascontiguousarray(x[:, rows])) for x in (error, rate)),
            )
        known = np.isfinite(error).all(axis=0)
        x, y = (error * rate)[:2, known], (rate**2)[:2, known]
        slope = x.sum(axis=1) / y.sum(axis=1)
        sigma = np.sqrt(np.sum((x - slope[:, None] * y) ** 2, axis=1)) / y.sum(axis=1)
        for found in (bias.of_one(0), bias.of_groups(np.array([0]))):
            assert found.slope_s == [pytest.approx(slope[0], rel=1e-13), pytest.approx(slope[1], rel=1e-13), None]
            # What is left is a millionth of the errors where the noise is so small: so much more of it is rounding.
            assert found.sigma_s[:2] == pytest.approx(sigma, rel=1e-12 if noise == 1e-3 else 1e-9)


def flattened(figures, prefix=""):
    """Nested figures as one dictionary of numbers."""
    items = figures.items() if isinstance(figures, dict) else enumerate(figures)
    out: dict[str, Any] = {}
    for key, value in items:
        name = f"{prefix}.{key}"
        if isinstance(value, dict | list):
            out |= flattened(value, name)
        elif value is not None and not isinstance(value, str):
            out[name] = value
    return out


def test_a_table_in_another_order_says_the_same(tmp_path):
    table = table_of(tmp_path, 30)
    shuffled = table.take(np.random.default_rng(0).permutation(len(table)))
    straight, mixed = summarise(table)["craft"]["craft-1"], summarise(shuffled)["craft"]["craft-1"]
    flat = flattened(straight)
    assert len(flat) > 40
    assert flattened(mixed) == pytest.approx(flat, rel=1e-9)


def test_an_empty_table_has_nothing_to_say():
    summary = summarise(schema().empty_table())
    assert (summary["periods"], summary["craft"], summary["swarm"]) == (0, {}, None)


def test_autocorrelation_time_of_a_first_order_process():
    # x_k = a x_{k-1} + noise has rho_k = a^k and tau = (1 + a)/(1 - a): 19 for a = 0.9.
    rng, a, n = np.random.default_rng(2), 0.9, 20_000
    x = np.zeros(n)
    for k in range(1, n):
        x[k] = a * x[k - 1] + rng.standard_normal()
    # Sokal: the relative error of tau with a window W = 5 tau is sqrt(2 (2 W + 1)/n), here 0.14; allow three.
    assert autocorrelation_time(x) == pytest.approx(19.0, rel=0.42)
    holes = x.copy()
    holes[rng.random(n) < 0.3] = np.nan
    assert autocorrelation_time(holes) == pytest.approx(autocorrelation_time(x), rel=0.1)
    # White noise: 1 and a little sampling error, and never below 1.
    assert 1.0 <= autocorrelation_time(rng.standard_normal(n)) < 1.1
    assert autocorrelation_time(np.full(50, 6.0)) == 1.0
    assert autocorrelation_time(np.full(50, np.nan)) == 1.0


def test_autocorrelation_time_is_that_of_a_plain_loop():
    x = np.convolve(np.random.default_rng(4).standard_normal(400), np.ones(4), "valid")
    centred = x - x.mean()
    n, tau = len(x), 1.0
    variance = np.mean(centred**2)
    for lag in range(1, n):
        tau += 2 * np.mean(centred[:-lag] * centred[lag:]) / variance
        if lag >= 5 * tau:
            break
    tau *= 1 + (2 * lag + 1) / n
    # The fast Fourier transform of a few hundred values rounds to about 1e-14.
    assert autocorrelation_time(x) == pytest.approx(tau, rel=1e-9)


def test_the_band_of_independent_samples_is_chi_square():
    rng = np.random.default_rng(8)
    frames, craft = 2000, 6
    value = rng.chisquare(6, frames * craft)
    found = consistency(np.repeat(np.arange(frames), craft), value, PERIOD_S)
    assert found is not None
    n = found["effective_samples"]
    assert found["band_low"] == pytest.approx(chi2.ppf(0.025, 6 * n) / n, rel=1e-9)
    assert found["band_high"] == pytest.approx(chi2.ppf(0.975, 6 * n) / n, rel=1e-9)
    # Of 2000 periods the two variances are known to about 5 %, the autocorrelation time to 7 %.
    assert n == pytest.approx(frames * craft, rel=0.2)
    assert found["inside_band"]


@pytest.mark.parametrize(("correlation_frames", "shared"), [(1, False), (1, True), (20, False), (20, True)])
def test_the_band_holds_95_percent_of_the_means_of_correlated_samples(correlation_frames, shared):
    # Chi-square values that stay for some frames, and are the same for all craft: the naive band would be far too
    # narrow (for 20 frames and 8 craft by sqrt(160)), and would hold next to nothing.
    rng, frames, craft, runs, inside = np.random.default_rng(21), 1200, 8, 200, 0
    frame = np.repeat(np.arange(frames), craft)
    for _ in range(runs):
        drawn = rng.chisquare(6, (frames // correlation_frames, 1 if shared else craft))
        value = np.broadcast_to(np.repeat(drawn, correlation_frames, axis=0), (frames, craft))
        found = consistency(frame, value.ravel(), PERIOD_S)
        assert found is not None
        inside += found["inside_band"]
    # Binomial 200 x 0.95: 190 +- 3.1. Three sigma, and 3 % for the number of samples being estimated from 60 blocks.
    assert 175 <= inside <= 199


def test_a_refused_pose_is_none_of_the_accepted_ones_though_the_craft_tracks_by_its_cameras():
    table: dict[str, Any] = {
        "craft": pa.array(["a"] * 4).dictionary_encode(),
        "status": pa.array(["tracking"] * 4).dictionary_encode(),
        "coupling": pa.array(["loose", "loose", "none", "none"]).dictionary_encode(),
        "dropped_photodiodes": [0, 0, 0, 0],
        "alert": [False] * 4,
    }
    for kind, unit in (("position", "m"), ("attitude", "deg")):
        table[f"{kind}_error_{unit}"], table[f"{kind}_protection_{unit}"] = [0.1] * 4, [1.0] * 4
        table[f"pnp_{kind}_error_{unit}"], table[f"pnp_{kind}_protection_{unit}"] = [0.2, 0.5, 3.0, None], [1.0] * 4
    series = integrity(TelemetryTable.of(pa.table(table))).items()
    found = {name: statistic(*map(Moments.of, values)) for name, (statistic, *values) in series}
    accepted = [found[f"integrity.accepted_poses.{name}"] for name in ("samples", "beyond", "worst_share_of_level")]
    assert accepted == [2, 0, 0.5]
    assert found["integrity.estimates.samples"] == 4


def test_light_that_a_replay_refused_is_no_part_of_the_mean_nis():
    table = {
        "time_s": np.arange(4) * PERIOD_S,
        "frame": np.arange(4),
        "craft": pa.array(["a"] * 4).dictionary_encode(),
        "status": pa.array(["tracking", "single_sweeps", "coasting", "coasting"]).dictionary_encode(),
        "rows": [6, 6, 0, 0],
        "nis": [5.0, 7.0, 90_000.0, np.nan],
    }
    simulated = figures._nis(TelemetryTable.of(pa.table(table)))
    assert np.count_nonzero(np.isfinite(simulated)) == 3
    replayed = figures._nis(TelemetryTable.of(pa.table({**table, "peer_px_m": [0.0] * 4})))
    assert replayed[np.isfinite(replayed)] == pytest.approx([5.0, 7.0], rel=1e-15)


def test_no_nees_is_null():
    assert consistency(np.arange(3), np.full(3, np.nan), PERIOD_S) is None


def test_a_delay_shows_as_the_motion_bias(tmp_path):
    delay_s = 0.004
    table = table_of(tmp_path, 600, pnp_delay_s=delay_s)
    bias = summarise(table)["swarm"]["pnp_motion_bias"]
    for axis in (0, 1):
        slope, sigma = bias["position_slope_s"][axis], bias["position_slope_sigma_s"][axis]
        # PnP noise of 1 mm per axis; velocity 0.3 cos(): sum of squares 2400 x 0.045 m^2/s^2.
        assert sigma == pytest.approx(1e-3 / np.sqrt(2400 * 0.045), rel=0.15)
        assert abs(slope + delay_s) < 4 * sigma
    assert bias["position_slope_s"][2] is None
    assert bias["along_velocity_m"] == pytest.approx(-delay_s * 0.3, abs=4 * 1e-3 / np.sqrt(2400))
    assert bias["position_rms_m"] == pytest.approx(delay_s * 0.3, rel=0.1)
    assert bias["attitude_slope_s"][:2] == [None, None]
    assert abs(bias["attitude_slope_s"][2]) < 4 * bias["attitude_slope_sigma_s"][2]


def test_a_bias_of_opposite_sign_in_x_and_y_is_not_lost_in_the_mean(tmp_path):
    """What the two fans do to an uncompensated craft: -T/4 in x, +T/4 in y; along a ring's velocity it cancels."""
    quarter = PERIOD_S / 4

    def swept(truth, rng):
        estimate = estimate_of(truth, rng)
        shift = truth.velocity * np.array([-quarter, quarter, 0.0])
        return estimate._replace(pnp=estimate.pnp._replace(position=estimate.pnp.position + shift))

    bias = summarise(table_of(tmp_path, 600, estimates=swept))["swarm"]["pnp_motion_bias"]
    x, y, _ = bias["position_slope_s"]
    sigma = bias["position_slope_sigma_s"][0]
    assert x == pytest.approx(-quarter, abs=4 * sigma)
    assert y == pytest.approx(quarter, abs=4 * sigma)
    assert abs(bias["along_velocity_m"]) < 1e-4 < bias["position_rms_m"]


def test_a_replay_has_scatter_instead_of_errors(tmp_path):
    table = table_of(tmp_path, 300, craft=3, replay=True)
    figures = summarise(table)["craft"]["craft-0"]
    for key in ("ekf_position_rms_m", "pnp_attitude_max_deg", "nees", "pnp_motion_bias", "ekf_to_pnp_position_ratio"):
        assert figures[key] is None
    assert figures["nis"]["samples"] == 300
    assert figures["residual_median_rad"] == pytest.approx(4e-5)
    # Noise per axis: the solution's 1 mm (twice 0.5) and the peer's 1 mm, and the lever of 37 mm times 1e-3 rad is
    # nothing beside. The median length of three such axes is sqrt(chi2.ppf(0.5, 3)); of 300 known to about 4 %.
    median = np.sqrt(chi2.ppf(0.5, 3))
    assert figures["peer_position_scatter_mm"] == pytest.approx(median * np.sqrt(2), rel=0.15)
    assert figures["peer_attitude_scatter_deg"] == pytest.approx(np.degrees(median * np.sqrt(2) * 1e-3), rel=0.15)
    assert summarise(table)["craft"]["craft-2"]["peer_samples"] == 299
    json.dumps(summarise(table), allow_nan=False)


def test_a_replay_without_a_peer_pose(tmp_path):
    table = table_of(tmp_path, 10, craft=1, replay=True)
    nothing = pa.nulls(len(table), pa.float64())
    for axis in "xyz":
        column = table.schema.get_field_index(f"peer_p{axis}_m")
        table = table.set_column(column, f"peer_p{axis}_m", nothing)
    figures = summarise(table)["swarm"]
    assert (figures["peer_samples"], figures["peer_position_scatter_mm"]) == (0, None)
