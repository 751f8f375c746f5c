"""Noise of several stations and their false photodiodes, found in the redundancy of a recording's rows.

A period's n rows leave n - 6 numbers over. With R = a^2 I + b^2 1 1^T of each station's sweeps (`innovation`), the
fit's Jacobian J and residuals v, Q = R - J (J^T R^-1 J)^-1 J^T is the covariance of v. Within a sweep the residuals
about their mean tell a, the means tell b: with C the projection on either, the variance components (W. Foerstner,
Zeitschrift fuer Vermessungswesen 104, 1979) are

    factor = v^T C v / tr(C Q),   a^2 or b^2 + a^2 / n times the factor, until it is one

The factor is that of the median period. What geometry and calibration leave behind moves whole sweeps of a small
object, so it is in b, and weighs less than what the photodiodes of a sweep agree upon. Two stations that disagree do
not tell which of them is wrong: b is one for all. One station's means have no redundancy; there b = a.

A photodiode is false before a station in a period if the fit without its rows is better by more than chance allows;
with u = R^-1 v, P = R^-1 Q R^-1 and B its rows, F falls by u_B^T P_BB^-1 u_B. What is false in half of its periods is
left out of all: it sees a constant reflection, or is not where it is taken to be.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from scipy.special import betainc

from estimators.arrays import Bools, Floats, Ints
from estimators.lighthouse.innovation import noise_of
from estimators.lighthouse.integrity import AngleNoise
from estimators.lighthouse.rows import Packed, Rows, Station, linearise, packed
from estimators.state import State
from swarm.flight.recordings.consistency import CHANCE, FALSE_SHARE, FEWEST_PERIODS

ROUNDS, SETTLED = 8, 0.02
"""Rounds of the components at most, and their relative change that ends them."""
LEAST_RAD = 1e-6
"""Least noise that is believed [rad]: a tenth of the best light's."""
MOST_SAMPLES = 200
_POSE = [0, 1, 2, 6, 7, 8]
_FEWEST_SPARE = 2
_REDUNDANT = 0.02
"""Share of a sweep's variance that must be left to its mean's residual for it to tell the rotor's noise."""


class RowSample(NamedTuple):
    """One period of one object: its rows, and the state at the fit to them."""

    rows: Rows
    state: State


class RowConsistency(NamedTuple):
    """Findings about one recording.

    noise: of each station, None if too few periods tell it. false: (S, K), photodiodes that are left out before a
    station in all periods; share: of the periods in which each was tested and found false, (S, K).
    """

    noise: list[AngleNoise] | None
    false: Bools
    share: Floats


class _Fit(NamedTuple):
    """One period's rows with their residuals v (n,) and Jacobian J (n, 6). sweeps: station and rows of each sweep."""

    rows: Rows
    residual: Floats
    jacobian: Floats
    sweeps: list[tuple[int, Ints]]

    def of(self, kept: Bools) -> "_Fit":
        """Return the fit with some of its rows."""
        return _fit_of(Rows._make(part[kept] for part in self.rows), self.residual[kept], self.jacobian[kept])


def _fit_of(rows: Rows, residual: Floats, jacobian: Floats) -> _Fit:
    key = (rows.station * 2 + rows.fan) * 1000 + rows.sweep
    groups = [np.flatnonzero(key == k) for k in np.unique(key)]
    return _Fit(rows, residual, jacobian, [(int(rows.station[at[0]]), at) for at in groups])


def assess_rows(
    samples: Sequence[RowSample], stations: Sequence[Station], point_m: Floats, start: Sequence[AngleNoise]
) -> RowConsistency:
    """Return the noise and the false photodiodes of periods; those without redundancy are passed over.

    Args:
        samples: of one object.
        stations: that the rows name.
        point_m: (K, 3) [m], photodiodes in the body frame.
        start: noise to begin with.
    """
    step = max(1, -(-len(samples) // MOST_SAMPLES))
    fits = [fit for sample in samples[::step] if (fit := _fit(sample, packed(stations), point_m)) is not None]
    shape = len(stations), len(point_m)
    none = RowConsistency(None, np.zeros(shape, dtype=np.bool_), np.zeros(shape))
    if len(fits) < FEWEST_PERIODS:
        return none
    noise = _components(fits, list(start), several=len(stations) > 1)
    tested, dropped = np.zeros((2, *shape), dtype=np.int64)
    honest = []
    for fit in fits:
        kept, seen = _agreeing(fit, noise, len(point_m))
        tested.reshape(-1)[seen] += 1
        dropped.reshape(-1)[np.setdiff1d(seen, np.unique(_sources(fit, len(point_m))[kept]))] += 1
        honest.append(fit.of(kept))
    noise = _components(honest, noise, several=len(stations) > 1)
    share = dropped / np.maximum(tested, 1)
    return RowConsistency(noise, (share >= FALSE_SHARE) & (tested >= FEWEST_PERIODS), share)


def _fit(sample: RowSample, stations: Packed, point_m: Floats) -> _Fit | None:
    """Return a period's residuals and Jacobian, None where too few rows are left over."""
    if len(sample.rows.angle) < 6 + _FEWEST_SPARE:
        return None
    s = sample.state
    linear = linearise(sample.rows, stations, point_m, s.rotation, s.position, s.velocity, s.angular_rate)
    if not np.isfinite(linear.residual).all():
        return None
    return _fit_of(sample.rows, linear.residual, linear.matrix[:, _POSE])


def _sources(fit: _Fit, photodiodes: int) -> Ints:
    """Return a number per row of its station and photodiode."""
    return fit.rows.station * photodiodes + fit.rows.photodiode


def _left(fit: _Fit, noise: Sequence[AngleNoise]) -> tuple[Floats, Floats, Floats] | None:
    """Return R^-1, the residuals v after the fit with this noise, and their covariance Q; None where it is singular."""
    r = noise_of(fit.rows, noise)
    inverse = np.asarray(np.linalg.inv(r), dtype=np.float64)
    normal = fit.jacobian.T @ inverse @ fit.jacobian
    # Attitude and position have units of their own: scaled, a singular matrix is told from a small one.
    scale = 1 / np.sqrt(np.diag(normal))
    scaled = normal * scale[:, None] * scale
    if not np.isfinite(scaled).all() or np.linalg.cond(scaled) > 1e12:
        return None
    covariance = np.linalg.inv(scaled) * scale[:, None] * scale
    v: Floats = fit.residual - fit.jacobian @ (covariance @ (fit.jacobian.T @ (inverse @ fit.residual)))
    return inverse, v, r - fit.jacobian @ covariance @ fit.jacobian.T


def _components(fits: Sequence[_Fit], noise: list[AngleNoise], *, several: bool) -> list[AngleNoise]:
    """Return the noise of each station that explains the median period."""
    for _ in range(ROUNDS):
        own: list[list[float]] = [[] for _ in noise]
        shared: list[float] = []
        for fit in fits:
            if (left := _left(fit, noise)) is not None:
                _collect(fit, noise, left[1], left[2], own, shared)
        found = []
        for s, before in enumerate(noise):
            a2 = before.own_rad**2 * (float(np.median(own[s])) if len(own[s]) >= FEWEST_PERIODS else 1.0)
            b2 = a2
            if several and len(shared) >= FEWEST_PERIODS:
                b2 = float(np.median(shared))
            found.append(AngleNoise(max(float(np.sqrt(a2)), LEAST_RAD), max(float(np.sqrt(max(b2, 0.0))), LEAST_RAD)))
        change = np.max(np.abs(np.array(found) / np.array(noise) - 1))
        noise = found
        if change < SETTLED:
            break
    return noise


def _collect(
    fit: _Fit,
    noise: Sequence[AngleNoise],
    v: Floats,
    q: Floats,
    own: list[list[float]],
    shared: list[float],
) -> None:
    """Add one period's factor of a^2 to each station's, and its b^2.

    Args:
        fit: the period.
        noise: of each station.
        v: residuals, (n,).
        q: their covariance, (n, n).
        own: factors of a^2 per station, extended.
        shared: values of b^2 [rad^2], extended.
    """
    means = spread = number = whole = rotor = 0.0
    for s in {station for station, _ in fit.sweeps}:
        square = expected = 0.0
        for at in (at for station, at in fit.sweeps if station == s):
            n = len(at)
            block = q[np.ix_(at, at)]
            mean, variance = float(v[at].mean()), float(block.mean())
            square += float(np.sum((v[at] - mean) ** 2))
            expected += float(np.trace(block)) - n * variance
            single = noise[s].own_rad ** 2 / n
            if variance > _REDUNDANT * (single + noise[s].shared_rad ** 2):
                means, spread, number = means + mean * mean, spread + variance, number + 1
                whole, rotor = whole + single, rotor + noise[s].shared_rad ** 2
        freedom = expected / noise[s].own_rad ** 2
        if freedom > 0.5:
            own[s].append(square / expected / _median_factor(freedom))
    if number:
        factor = means / spread / _median_factor(max(number / 2, 0.5))
        shared.append((whole + rotor) / number * factor - whole / number)


def _median_factor(freedom: float) -> float:
    """Return the median of a chi-square over its mean (Wilson and Hilferty)."""
    return max((1 - 2 / (9 * freedom)) ** 3, 0.1)


def _agreeing(fit: _Fit, noise: Sequence[AngleNoise], photodiodes: int) -> tuple[Bools, Ints]:
    """Return the rows (n,) of photodiodes that agree, and the sources that could be tested."""
    sources = _sources(fit, photodiodes)
    kept: Bools = np.ones(len(sources), dtype=np.bool_)
    tested: Ints = np.zeros(0, dtype=np.int64)
    most = len(np.unique(sources)) // 2
    for count in range(most + 1):
        part = fit.of(kept)
        left = _left(part, noise) if np.count_nonzero(kept) > 6 + _FEWEST_SPARE else None
        if left is None:
            break
        inverse, v, q = left
        u, p, total = inverse @ v, inverse @ q @ inverse, float(v @ inverse @ v)
        here, best = sources[kept], (1.0, -1)
        able = []
        for source in np.unique(here).tolist():
            at = np.flatnonzero(here == source)
            spare = len(here) - 6 - len(at)
            if spare < 1:
                continue
            block = p[np.ix_(at, at)]
            if np.linalg.cond(block) > 1e10:
                continue
            able.append(source)
            fall = float(u[at] @ np.linalg.solve(block, u[at]))
            chance = float(betainc(spare / 2, len(at) / 2, min(max(1 - fall / total, 0.0), 1.0)))
            best = min(best, (chance, source))
        if count == 0:
            tested = np.array(able, dtype=np.int64)
        if best[1] < 0 or best[0] * len(able) >= CHANCE or count == most:
            break
        kept &= sources != best[1]
    return kept, tested
