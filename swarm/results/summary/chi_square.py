"""Consistency of a filter: the mean of a chi-square figure against the band in which 95 % of such means fall.

The mean of n independent values, each chi-square with 6 degrees of freedom, is chi-square with 6 n degrees of freedom,
divided by n. The values of a run are not independent, so n is an effective number:

    n = (craft_eff) (periods) / tau,   tau = 1 + 2 sum rho_k,   craft_eff = var(NEES) / var(mean over a period's craft)

tau is the autocorrelation time of the mean over a period's craft, in periods: its sum is cut at the first lag beyond
5 tau (Sokal) and corrected for the mean being estimated too (Wolff 2004). craft_eff, between 1 and the number of craft,
says how much the craft of one period tell independently: a rotor error is one draw for all that a fan hits in a sweep.
"""

from typing import Any

import numpy as np
from scipy.special import gammaincinv

from estimators.arrays import Floats, Ints
from estimators.kernel import kernel

DOF = 6


def autocorrelation_time(series: Floats) -> float:
    """Return tau = 1 + 2 sum rho_k of an evenly spaced series (n,), NaN where missing, in samples, within 1 to n."""
    known = np.isfinite(series)
    n = int(np.count_nonzero(known))
    centred = np.where(known, series - (series[known].mean() if n else 0.0), 0.0)
    products = _correlated(centred)
    pairs = np.arange(n, 0, -1) if n == len(series) else np.rint(_correlated(known.astype(np.float64)))
    if n < 2 or products[0] <= 0:
        return 1.0
    correlation = products / np.maximum(pairs, 1) / (products[0] / n)
    tau = 1 + 2 * np.cumsum(correlation[1:])
    beyond = np.flatnonzero(np.arange(1, len(series)) >= 5 * tau)
    last = int(beyond[0]) if beyond.size else len(tau) - 1
    # The mean was taken from the same values, which lowers every rho_k by about tau/n (Wolff 2004).
    return float(np.clip(tau[last] * (1 + (2 * last + 3) / n), 1.0, n))


def _correlated(series: Floats) -> Floats:
    """Return the sums (n,) of the products of a series (n,) with itself, by the lag between them."""
    size = 2 * len(series)
    out: Floats = np.fft.irfft(np.abs(np.fft.rfft(series, size)) ** 2, size)[: len(series)]
    return out


@kernel
def _sum_by_frame(frame: Floats, value: Floats, first: int, total: Floats, count: Floats) -> tuple[float, float]:
    """Add the known values (rows,) to the sums and numbers (frames,) of their frames (rows,).

    Returns the mean and the variance of the known values.
    """
    n = sum_of = square = 0.0
    for i in range(len(value)):
        if np.isfinite(value[i]):
            n += 1.0
            sum_of += value[i]
            total[int(frame[i]) - first] += value[i]
            count[int(frame[i]) - first] += 1.0
    if n == 0:
        return np.nan, np.nan
    mean = sum_of / n
    for i in range(len(value)):
        if np.isfinite(value[i]):
            square += (value[i] - mean) ** 2
    return mean, square / n


def consistency(frame: Floats | Ints, value: Floats, period_s: float) -> dict[str, Any] | None:
    """Return the mean of a chi-square figure with 6 degrees of freedom, and its 95 % band; None without data.

    Args:
        frame: Period of each value, (rows,).
        value: The figure, (rows,), NaN where unknown.
        period_s: Length of a period [s].
    """
    first, last = (int(frame.min()), int(frame.max())) if len(frame) else (0, -1)
    total, count = np.zeros((2, last - first + 1))
    average, variance = _sum_by_frame(frame.astype(np.float64, copy=False), value, first, total, count)
    known = np.flatnonzero(count)
    if not known.size:
        return None
    # The even grid of frames begins and ends with one that has a value.
    total, count = total[known[0] : known[-1] + 1], count[known[0] : known[-1] + 1]
    mean = np.divide(total, count, out=np.full(len(total), np.nan), where=count > 0)
    samples_known = int(count.sum())
    of_means = float(np.nanvar(mean))
    craft = float(np.clip(variance / of_means, 1.0, samples_known / len(known))) if of_means > 0 else 1.0
    tau = autocorrelation_time(mean)
    samples = max(1.0, craft * len(known) / tau)
    low, high = 2 * gammaincinv(DOF * samples / 2, np.array([0.025, 0.975])) / samples
    return {
        "mean": average,
        "band_low": float(low),
        "band_high": float(high),
        "inside_band": bool(low <= average <= high),
        "samples": samples_known,
        "effective_samples": samples,
        "effective_craft": craft,
        "correlation_time_s": tau * period_s,
    }
