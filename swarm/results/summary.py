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

from typing import Any

import numpy as np
import pyarrow as pa
from scipy.special import gammaincinv

from estimators.arrays import Bools, Floats, Ints
from estimators.rotation import angle_between, log, matrix_from_quaternion, mean_rotation
from swarm.results.telemetry import STATUS, values

DOF = 6
MIN_RATE = 1e-4
"""Below this RMS rate [m/s], [rad/s] an axis is at rest, and no bias can be told from it."""

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


def _slopes(frame: Ints, error: Floats, rate: Floats) -> tuple[list[float | None], list[float | None]]:
    """Slope [s] of error (rows, 3) against rate (rows, 3) per axis and its 1 sigma, the rows of a frame as one."""
    slope: list[float | None] = []
    sigma: list[float | None] = []
    for axis in range(3):
        e, v = error[:, axis], rate[:, axis]
        square = float(v @ v)
        if not len(v) or square < len(v) * MIN_RATE**2:
            slope.append(None)
            sigma.append(None)
            continue
        b = float(e @ v) / square
        score, _ = _per_frame(frame, v * (e - b * v))
        slope.append(b)
        sigma.append(float(np.sqrt(score @ score)) / square)
    return slope, sigma


def _codes(table: pa.Table, name: str) -> Floats:
    """The codes of a dictionary column."""
    chunks = table.column(name).unify_dictionaries().chunks
    return np.concatenate([chunk.indices.to_numpy() for chunk in chunks]).astype(np.float64)


class _Rows:
    """Telemetry columns as arrays, NaN where null, of all rows or of one craft's."""

    def __init__(self, table: pa.Table) -> None:
        self._table, self._cache, self._rows = table, dict[str, Floats](), np.arange(len(table))

    def of(self, rows: Ints) -> "_Rows":
        """A part of the rows; the columns are converted once for all parts."""
        out = _Rows(self._table)
        out._cache, out._rows = self._cache, rows
        return out

    def column(self, name: str) -> Floats:
        if name not in self._cache:
            self._cache[name] = _codes(self._table, name) if name == "status" else values(self._table, name)
        return self._cache[name][self._rows]

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
    position_error = rows.position("pnp") - rows.position("true")
    velocity = rows.columns("true_vx_m_s", "true_vy_m_s", "true_vz_m_s")
    angular_rate = rows.columns("true_wx_rad_s", "true_wy_rad_s", "true_wz_rad_s")
    known = np.isfinite(position_error).all(axis=1) & np.isfinite(velocity).all(axis=1)
    frame, position_error = rows.frame[known], position_error[known]
    velocity, angular_rate = velocity[known], angular_rate[known]
    solution = matrix_from_quaternion(rows.quaternion("pnp")[known])
    truth = matrix_from_quaternion(rows.quaternion("true")[known])
    attitude_error = log(solution @ np.swapaxes(truth, -1, -2))
    slope, sigma = _slopes(frame, position_error, velocity)
    turn_slope, turn_sigma = _slopes(frame, attitude_error, angular_rate)
    speed = np.linalg.norm(velocity, axis=1)
    moving = speed > MIN_RATE
    along = np.sum(position_error * velocity, axis=1)[moving] / speed[moving]
    explained = np.array([b or 0.0 for b in slope]) * velocity
    turn_explained = np.array([b or 0.0 for b in turn_slope]) * angular_rate
    return {
        "position_slope_s": slope,
        "position_slope_sigma_s": sigma,
        "position_rms_m": _rms(np.linalg.norm(explained, axis=1)),
        "along_velocity_m": _mean(along),
        "attitude_slope_s": turn_slope,
        "attitude_slope_sigma_s": turn_sigma,
        "attitude_rms_deg": _rms(np.degrees(np.linalg.norm(turn_explained, axis=1))),
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


def _figures(rows: _Rows, period_s: float, replay: bool) -> dict[str, Any]:
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
        "mean_visible": _mean(visible),
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
        "pnp_motion_bias": None if replay else _motion_bias(rows),
    }
    return {**out, **_peer_scatter(rows)} if replay else out


def summarise(table: pa.Table) -> dict[str, Any]:
    """The summary of a run's telemetry, JSON-able: units in the keys' names, null where there is nothing to say.

    `swarm` is over all craft, `craft` has the same figures per craft. A replay (a table with peer columns) has no
    truth: its errors are null, and it says how far the peer's poses scatter about the solutions.
    """
    replay = "peer_px_m" in table.column_names
    if not len(table):
        return {"periods": 0, "duration_s": 0.0, "craft_count": 0, "swarm": None, "craft": {}, "notes": NOTES}
    names = table.column("craft").unify_dictionaries().chunk(0).dictionary.to_pylist()
    codes = _codes(table, "craft").astype(np.int64)
    ends = np.cumsum(np.bincount(codes, minlength=len(names)))[:-1]
    per_craft = np.split(np.argsort(codes, kind="stable"), ends)
    everything = _Rows(table)
    frame, time_s = everything.frame, everything.column("time_s")
    span = int(frame.max() - frame.min())
    period_s = float(time_s.max() - time_s.min()) / span if span else 0.0
    return {
        "periods": len(np.unique(frame)),
        "duration_s": (span + 1) * period_s,
        "craft_count": len(names),
        "swarm": _figures(everything, period_s, replay),
        "craft": {
            name: _figures(everything.of(rows), period_s, replay)
            for name, rows in zip(names, per_craft, strict=True)
            if len(rows)
        },
        "notes": NOTES,
    }
