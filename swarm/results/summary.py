"""What a run has shown: figures per craft and for the swarm, from its telemetry.

Errors are distances and angles from the truth (25) at each period's epoch, as RMS and maximum over the periods that
have them. Consistency is the mean NEES (and NIS) against the band in which 95 % of such means fall if the filter is
consistent: the mean of n independent values, each chi-square with 6 degrees of freedom, is chi-square with 6 n degrees
of freedom, divided by n. The values of a run are not independent, so n is an effective number:

    n = (craft_eff) (periods) / tau,   tau = 1 + 2 sum rho_k,   craft_eff = var(NEES) / var(mean over a period's craft)

tau is the autocorrelation time of the mean over a period's craft, in periods: its sum is cut at the first lag beyond
5 tau (Sokal) and corrected for the mean being estimated too (Wolff 2004). craft_eff, between 1 and the number of craft,
says how much the craft of one period tell independently: a rotor error is one draw for all that a fan hits in a sweep.

The motion bias is the part of the raw PnP error (solution - truth) that is proportional to the true rate: by least
squares per axis of the lighthouse frame, position error against velocity and attitude error against angular rate. Its
slope is a time: the solution shows the craft where it is that much later. Without motion compensation the two fans,
T/2 apart, leave about -T/4 in x and +T/4 in y, which along the velocity of a turning ring would cancel. The slope's
1 sigma counts the craft of a period as one sample (errors summed per period before squaring).
"""

from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
from scipy.special import gammaincinv

from estimators.arrays import Bools, Floats, Ints
from estimators.rotation import angle_between, matrix_from_quaternion, mean_rotation
from swarm.results.columns.ccd import CCD_STATES
from swarm.results.columns.core import SENSORS, STATUS
from swarm.results.columns.schema import bystanders
from swarm.results.lidar_scans import summarise_scans
from swarm.results.reading import read_telemetry, telemetry_columns, values
from swarm.results.rows import attitude_errors_into

DOF = 6
MIN_RATE = 1e-4
"""Below this RMS rate [m/s], [rad/s] an axis is at rest, and no bias can be told from it."""

BLOCK = 65_536
"""Rows whose rotations are compared at a time."""

NOTES = {
    "nees": (
        "mean over the samples against its 95 % chi-square band for effective_samples independent ones: "
        "effective craft times periods over the autocorrelation time; craft of the same period share the rotor error"
    ),
    "pnp_motion_bias": "least-squares slope of (solution - truth) against the true rate, per axis x, y, z",
}


def _number(value: float | np.floating[Any]) -> float | None:
    return float(value) if np.isfinite(value) else None


def _mean(x: Floats) -> float | None:
    known = x[np.isfinite(x)]
    return _number(known.mean()) if known.size else None


def _median(x: Floats) -> float | None:
    known = x[np.isfinite(x)]
    return _number(np.median(known)) if known.size else None


def _rms(x: Floats) -> float | None:
    known = x[np.isfinite(x)]
    return _number(np.sqrt(np.mean(known**2))) if known.size else None


def _max(x: Floats) -> float | None:
    known = x[np.isfinite(x)]
    return _number(known.max()) if known.size else None


def autocorrelation_time(series: Floats) -> float:
    """tau = 1 + 2 sum rho_k of an evenly spaced series (n,), NaN where missing, in samples; at least 1, at most n."""
    known = np.isfinite(series)
    n = int(np.count_nonzero(known))
    centred = np.where(known, series - (series[known].mean() if n else 0.0), 0.0)
    size = 2 * len(series)
    spectrum, mask = np.fft.rfft(centred, size), np.fft.rfft(known.astype(np.float64), size)
    products = np.fft.irfft(np.abs(spectrum) ** 2, size)[: len(series)]
    pairs = np.rint(np.fft.irfft(np.abs(mask) ** 2, size)[: len(series)])
    if n < 2 or products[0] <= 0:
        return 1.0
    correlation = products / np.maximum(pairs, 1) / (products[0] / n)
    tau = 1 + 2 * np.cumsum(correlation[1:])
    beyond = np.flatnonzero(np.arange(1, len(series)) >= 5 * tau)
    last = int(beyond[0]) if beyond.size else len(tau) - 1
    # The mean was taken from the same values, which lowers every rho_k by about tau/n (Wolff 2004).
    return float(np.clip(tau[last] * (1 + (2 * last + 3) / n), 1.0, n))


def _per_frame(frame: Ints, x: Floats) -> tuple[Floats, Floats]:
    """Sum over each frame's rows and number of rows, on the even grid from the first frame to the last."""
    index = frame - frame.min()
    size = int(index.max()) + 1
    return np.bincount(index, x, size).astype(np.float64), np.bincount(index, minlength=size).astype(np.float64)


def consistency(frame: Ints, value: Floats, period_s: float) -> dict[str, Any] | None:
    """Mean of a chi-square figure (rows,) with 6 degrees of freedom, and the 95 % band it belongs in; None if no data.

    frame: (rows,) period of each value. period_s: a period's length [s].
    """
    known = np.isfinite(value)
    if not known.any():
        return None
    value, frame = value[known], frame[known]
    total, count = _per_frame(frame, value)
    mean = np.divide(total, count, out=np.full(len(total), np.nan), where=count > 0)
    per_period = float(count[count > 0].mean())
    variance = float(np.nanvar(mean))
    craft = float(np.clip(np.var(value) / variance, 1.0, per_period)) if variance > 0 else 1.0
    tau = autocorrelation_time(mean)
    samples = max(1.0, craft * np.count_nonzero(count) / tau)
    low, high = 2 * gammaincinv(DOF * samples / 2, np.array([0.025, 0.975])) / samples
    average = float(value.mean())
    return {
        "mean": average,
        "band_low": float(low),
        "band_high": float(high),
        "inside_band": bool(low <= average <= high),
        "samples": len(value),
        "effective_samples": samples,
        "effective_craft": craft,
        "correlation_time_s": tau * period_s,
    }


class _Slope:
    """Least squares of an error against a rate through the origin, per axis, from sums over rows that come in blocks.

    The 1 sigma of the slope b is that of sum v (e - b v) / sum v^2, with the rows of a frame summed before squaring.
    """

    def __init__(self, frames: int) -> None:
        self._product, self._square = np.zeros((frames, 3)), np.zeros((frames, 3))
        self._rows = 0

    def add(self, frame: Ints, error: Floats, rate: Floats) -> None:
        """Add rows: frame (n,) from zero, error (n, 3) and rate (n, 3)."""
        for axis in range(3):
            v = rate[:, axis]
            self._product[:, axis] += np.bincount(frame, error[:, axis] * v, len(self._product))
            self._square[:, axis] += np.bincount(frame, v * v, len(self._square))
        self._rows += len(frame)

    def solve(self) -> tuple[list[float | None], list[float | None], float | None]:
        """Slope [s] and its 1 sigma [s] per axis, None where at rest; RMS of the error that the slopes explain."""
        product, square = self._product.sum(axis=0), self._square.sum(axis=0)
        moving = square > self._rows * MIN_RATE**2
        slope = np.divide(product, square, out=np.full(3, np.nan), where=moving)
        score = np.sqrt(np.sum((self._product - slope * self._square) ** 2, axis=0))
        sigma = np.divide(score, square, out=np.full(3, np.nan), where=moving)
        explained = float(np.sqrt(np.nansum(slope**2 * square) / self._rows)) if self._rows else None
        return [_number(b) for b in slope], [_number(b) for b in sigma], explained


def _codes(table: pa.Table, name: str) -> Floats:
    """The codes of a dictionary column, NaN where null."""
    chunks = table.column(name).unify_dictionaries().chunks
    codes = [chunk.indices.to_numpy(zero_copy_only=False) for chunk in chunks] or [np.zeros(0)]
    return np.concatenate(codes).astype(np.float64)


class _Rows:
    """Telemetry columns as arrays, NaN where null, of all rows or of one craft's, which are neighbours.

    load: gives one column's table. order: of the rows, one craft after the other. rows: first, and one past the last.
    """

    def __init__(self, load: Callable[[str], pa.Table], order: Ints, rows: tuple[int, int]) -> None:
        self._load, self._order, self._rows = load, order, rows
        self._cache: dict[str, Floats] = {}

    def of(self, first: int, past: int) -> "_Rows":
        """A part of the rows; the columns are loaded once for all parts."""
        out = _Rows(self._load, self._order, (first, past))
        out._cache = self._cache
        return out

    def blocks(self) -> "Iterator[_Rows]":
        """These rows in parts of bounded size."""
        first, past = self._rows
        for start in range(first, past, BLOCK):
            yield self.of(start, min(start + BLOCK, past))

    def forget(self) -> None:
        """Drop the columns that were loaded, for all parts."""
        self._cache.clear()

    def column(self, name: str) -> Floats:
        if name not in self._cache:
            table = self._load(name)
            codes = name in ("craft", "status", "sensor", "ccd")
            self._cache[name] = (_codes(table, name) if codes else values(table, name))[self._order]
        return self._cache[name][slice(*self._rows)]

    def columns(self, *names: str) -> Floats:
        return np.stack([self.column(name) for name in names], axis=1)

    def position(self, prefix: str) -> Floats:
        return self.columns(*(f"{prefix}_p{a}_m" for a in "xyz"))

    def quaternion(self, prefix: str) -> Floats:
        return self.columns(*(f"{prefix}_q{a}" for a in "wxyz"))

    @property
    def frame(self) -> Ints:
        return self.column("frame").astype(np.int64)


def _motion_bias(rows: _Rows) -> dict[str, Any]:
    frame = rows.frame
    first, frames = int(frame.min()), int(frame.max() - frame.min()) + 1
    position, attitude = _Slope(frames), _Slope(frames)
    along, moving = 0.0, 0
    for part in rows.blocks():
        solution, truth = part.position("pnp"), part.position("true")
        known = np.isfinite(solution).all(axis=1) & np.isfinite(truth).all(axis=1)
        error, at = (solution - truth)[known], part.frame[known] - first
        velocity = part.columns("true_vx_m_s", "true_vy_m_s", "true_vz_m_s")[known]
        rate = part.columns("true_wx_rad_s", "true_wy_rad_s", "true_wz_rad_s")[known]
        turn = np.empty((len(at), 3))
        attitude_errors_into(part.quaternion("true")[known], part.quaternion("pnp")[known], turn)
        position.add(at, error, velocity)
        attitude.add(at, turn, rate)
        speed = np.linalg.norm(velocity, axis=1)
        moves = speed > MIN_RATE
        along += float(np.sum(np.sum(error * velocity, axis=1)[moves] / speed[moves]))
        moving += int(np.count_nonzero(moves))
    slope, sigma, explained = position.solve()
    turn_slope, turn_sigma, turn_explained = attitude.solve()
    return {
        "position_slope_s": slope,
        "position_slope_sigma_s": sigma,
        "position_rms_m": explained,
        "along_velocity_m": along / moving if moving else None,
        "attitude_slope_s": turn_slope,
        "attitude_slope_sigma_s": turn_sigma,
        "attitude_rms_deg": None if turn_explained is None else float(np.degrees(turn_explained)),
    }


def _peer_scatter(rows: _Rows) -> dict[str, Any]:
    """Distance and angle of the peer's pose from the PnP solution, a constant offset in the body frame removed."""
    position, peer = rows.position("pnp"), rows.position("peer")
    known = np.isfinite(position).all(axis=1) & np.isfinite(peer).all(axis=1)
    if np.count_nonzero(known) < 2:
        return {"peer_samples": int(np.count_nonzero(known)), "peer_position_scatter_mm": None}
    rotation = matrix_from_quaternion(rows.quaternion("pnp")[known])
    back = np.swapaxes(rotation, -1, -2)
    turn = back @ matrix_from_quaternion(rows.quaternion("peer")[known])
    shift = np.einsum("nij,nj->ni", back, (peer - position)[known])
    distance = np.linalg.norm(shift - np.median(shift, axis=0), axis=1)
    angle = np.degrees(angle_between(turn, mean_rotation(turn)))
    return {
        "peer_samples": len(distance),
        "peer_position_scatter_mm": float(np.median(distance) * 1e3),
        "peer_attitude_scatter_deg": float(np.median(angle)),
    }


def _ccd(rows: _Rows, period_s: float) -> dict[str, Any]:
    """What the cameras did for craft that carry them."""
    state = rows.column("ccd")
    sensor, on_board = rows.column("sensor"), np.isfinite(state)
    # Craft by craft, in the order of time.
    order = np.lexsort((rows.frame[on_board], rows.column("craft")[on_board]))
    who, used = rows.column("craft")[on_board][order], sensor[on_board][order]
    switched = np.count_nonzero((np.diff(used) != 0) & (np.diff(who) == 0))
    return {
        "ccd": {
            "samples": int(np.count_nonzero(on_board)),
            "stereo_share": float(np.mean(state[on_board] == CCD_STATES.index("stereo"))),
            "camera_share": float(np.mean(state[on_board] == CCD_STATES.index("camera"))),
            "sensor_share": {
                name: float(np.mean(sensor[on_board] == code))
                for code, name in enumerate(SENSORS)
                if np.any(sensor[on_board] == code)
            },
            "sensor_switches": int(switched),
            "position_rms_m": _rms(rows.column("ccd_position_error_m")),
            "attitude_rms_deg": _rms(rows.column("ccd_attitude_error_deg")),
            "nis": consistency(rows.frame, rows.column("ccd_nis"), period_s),
        }
        if on_board.any()
        else None
    }


def _integrity(rows: _Rows) -> dict[str, Any]:
    """How the craft's trust in their own poses held: errors against protection levels, in position or attitude."""
    tracking = rows.column("status") == STATUS.index("tracking")
    dropped = rows.column("dropped_photodiodes")

    def worst(prefix: str, among: Bools) -> tuple[Floats, dict[str, Any]]:
        shares = [
            rows.column(f"{prefix}{kind}_error_{unit}") / rows.column(f"{prefix}{kind}_protection_{unit}")
            for kind, unit in (("position", "m"), ("attitude", "deg"))
        ]
        share = np.fmax(*shares)[among]
        return share, {"samples": int(np.count_nonzero(np.isfinite(share))), "beyond": int(np.count_nonzero(share > 1))}

    pose, of_poses = worst("pnp_", tracking)
    estimate, of_estimates = worst("", np.ones(len(tracking), dtype=np.bool_))
    return {
        "integrity": {
            "accepted_poses": {**of_poses, "worst_share_of_level": _max(pose)},
            "estimates": {**of_estimates, "worst_share_of_level": _max(estimate)},
            "position_protection_median_m": _median(rows.column("position_protection_m")),
            "attitude_protection_median_deg": _median(rows.column("attitude_protection_deg")),
            "mean_dropped_photodiodes": _mean(np.maximum(dropped, 0)),
            "failed_residual_test_share": _mean(np.where(np.isfinite(dropped), dropped < 0, np.nan)),
            "alert_share": _mean(rows.column("alert")),
        }
    }


def _figures(
    rows: _Rows, period_s: float, replay: bool, ccd: bool, integrity: bool, motion_bias: dict[str, Any] | None
) -> dict[str, Any]:
    visible, solved = rows.column("visible"), np.isfinite(rows.column("pnp_px_m"))
    pnp = rows.column("pnp_position_error_m"), rows.column("pnp_attitude_error_deg")
    ekf = rows.column("position_error_m"), rows.column("attitude_error_deg")

    def share(of: Bools, among: Bools) -> float | None:
        return float(of[among].mean()) if among.any() else None

    def ratio(above: Floats, below: Floats) -> float | None:
        both = np.isfinite(above) & np.isfinite(below)
        a, b = _rms(above[both]), _rms(below[both])
        return a / b if a is not None and b else None

    frame = rows.frame
    out: dict[str, Any] = {
        "samples": len(visible),
        "tracking_share": share(rows.column("status") == STATUS.index("tracking"), visible >= 0),
        "refused_share": share(
            np.isfinite(rows.column("nis")) & (rows.column("status") != STATUS.index("tracking")), solved
        ),
        "mean_visible": _mean(visible),
        "contact_periods": int(np.count_nonzero(rows.column("contact") == 1)),
        "solved_share": share(solved, visible >= 4),
        "solved_share_with_5_photodiodes": share(solved, visible >= 5),
        "residual_median_rad": _median(rows.column("residual_rad")),
        "mean_iterations": _mean(rows.column("pnp_iterations")),
        "mean_adop_deg_per_rad": _mean(rows.column("adop_deg_per_rad")),
        "mean_pdop_m_per_rad": _mean(rows.column("pdop_m_per_rad")),
        "pnp_position_rms_m": _rms(pnp[0]),
        "pnp_position_max_m": _max(pnp[0]),
        "pnp_attitude_rms_deg": _rms(pnp[1]),
        "pnp_attitude_max_deg": _max(pnp[1]),
        "ekf_position_rms_m": _rms(ekf[0]),
        "ekf_position_max_m": _max(ekf[0]),
        "ekf_attitude_rms_deg": _rms(ekf[1]),
        "ekf_attitude_max_deg": _max(ekf[1]),
        "ekf_to_pnp_position_ratio": ratio(ekf[0], pnp[0]),
        "ekf_to_pnp_attitude_ratio": ratio(ekf[1], pnp[1]),
        "nees": consistency(frame, rows.column("nees"), period_s),
        "nis": consistency(frame, rows.column("nis"), period_s),
        "pnp_motion_bias": motion_bias,
    }
    if ccd:
        out |= _ccd(rows, period_s)
    if integrity:
        out |= _integrity(rows)
    return {**out, **_peer_scatter(rows)} if replay else out


def summarise(table: pa.Table) -> dict[str, Any]:
    """The summary of a run's telemetry, JSON-able: units in the keys' names, null where there is nothing to say.

    `swarm` is over all craft, `craft` has the same figures per craft. A replay (a table with peer columns) has no
    truth: its errors are null, and it says how far the peer's poses scatter about the solutions.
    """
    return _summary(lambda name: table.select([name]), table.column_names)


def summarise_run(folder: Path) -> dict[str, Any]:
    """`summarise` of the telemetry in a run's folder, column by column: half of it never is in memory."""
    summary = _summary(lambda name: read_telemetry(folder, [name]), telemetry_columns(folder))
    return summary | summarise_scans(folder)


def _summary(load: Callable[[str], pa.Table], columns: Sequence[str]) -> dict[str, Any]:
    kind = "peer_px_m" in columns, "ccd" in columns, "dropped_photodiodes" in columns
    craft = load("craft")
    codes = _codes(craft, "craft").astype(np.int64)
    names = craft.column("craft").unify_dictionaries().chunk(0).dictionary.to_pylist() if len(codes) else []
    # Craft that others observe, and those without any sensor, come last: they do not find themselves.
    observed = (
        np.isfinite(_codes(load("observer"), "observer")) if "observer" in columns else np.zeros(len(codes), bool)
    )
    without_sensors = [names.index(name) for name in bystanders(craft.schema) if name in names]
    aside = observed | np.isin(codes, without_sensors)
    ranks = codes + len(names) * aside
    everything = _Rows(load, np.argsort(ranks, kind="stable"), (0, len(codes)))
    frame, time_s = everything.frame, everything.column("time_s")
    if not len(frame):
        return {"periods": 0, "duration_s": 0.0, "craft_count": 0, "swarm": None, "craft": {}, "notes": NOTES}
    past = np.cumsum(np.bincount(ranks)).tolist()
    parts = {
        rank: everything.of(first, last)
        for rank, (first, last) in enumerate(zip([0, *past], past, strict=False))
        if last > first
    }
    span = int(frame.max() - frame.min())
    period_s = float(time_s.max() - time_s.min()) / span if span else 0.0
    # The bias takes half of all columns, and nothing else needs them.
    own = everything.of(0, len(codes) - int(np.count_nonzero(aside)))
    every = [own, *parts.values()]
    bias = [None if kind[0] else _motion_bias(rows) for rows in every]
    everything.forget()
    swarm, *single = (_figures(rows, period_s, *kind, drift) for rows, drift in zip(every, bias, strict=True))
    seen = set(codes[observed].tolist())
    out: dict[str, Any] = {
        "periods": len(np.unique(frame)),
        "duration_s": (span + 1) * period_s,
        "craft_count": len(names),
        "swarm": swarm,
        "craft": {
            names[rank % len(names)]: figures
            | ({"navigates": False, "tracking_share": None} if rank % len(names) in without_sensors else {})
            | ({"observed": rank % len(names) in seen} if "observer" in columns else {})
            for rank, figures in zip(parts, single, strict=True)
        },
        "notes": NOTES,
    }
    if "delta_v_m_s" in columns:
        spent = {rank: _max(rows.column("delta_v_m_s")) for rank, rows in parts.items()}
        for rank, delta_v in spent.items():
            out["craft"][names[rank % len(names)]]["delta_v_m_s"] = delta_v
        by_own = [delta_v for rank, delta_v in spent.items() if rank < len(names)]
        out["swarm"]["delta_v_m_s"] = _mean(np.array(by_own, dtype=np.float64))
    return out
