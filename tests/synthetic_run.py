"""A made-up run for the tests of results: craft on a turning ring, with an estimate whose errors are drawn from a
known covariance. No navigation runs, so every figure that telemetry and summary must find is known beforehand."""

from typing import Any, NamedTuple

import numpy as np

from estimators.arrays import Bools, Floats, Ints
from estimators.rotation import exp, matrix_from_quaternion, quaternion_from_matrix
from swarm.results.period import Period
from swarm.results.records import Peer, Truth

PERIOD_S = 1 / 60


class Pose(NamedTuple):
    """Stands for estimators.lighthouse.pnp.PoseSolution."""

    rotation: Floats
    position: Floats
    solved: Bools
    iterations: Ints
    residual_rad: Floats
    cost: Floats


class Dop(NamedTuple):
    """Stands for estimators.lighthouse.dop.Dilution."""

    covariance: Floats
    adop_deg_per_rad: Floats
    pdop_m_per_rad: Floats
    rate_coupling: Floats


class Estimate(NamedTuple):
    """Stands for swarm.onboard.navigation.Estimate."""

    status: Ints
    visible: Ints
    pnp: Pose
    dilution: Dop
    rotation: Floats
    position: Floats
    angular_rate: Floats
    velocity: Floats
    covariance: Floats
    nis: Floats
    missed_sync: Ints
    rejected: Ints
    sensor: Ints
    ccd: None = None
    coupling: Ints | int = 0
    rows: Ints | int = 0
    symmetry: tuple[()] = ()
    station_rows: Ints | None = None
    relative: None = None


def period_of(
    time_s: float,
    frame: int,
    truth: Truth | None,
    estimate: Estimate,
    peer: Peer | None = None,
    sight: Ints | None = None,
) -> Period:
    """The run's record of one period; nobody reads the sweep angles."""
    angles: Any = None
    seen: Any = sight
    known: Any = estimate
    return Period(frame, time_s, truth, seen, angles, known, peer)


def truth_at(time_s: float, craft: int = 8, rate_rad_s: float = 0.3, radius_m: float = 1.0) -> Truth:
    """`craft` craft on a ring around (0, 0, 3 m) that turns about z; each turns with it, front to the lighthouse."""
    angle = rate_rad_s * time_s + 2 * np.pi * np.arange(craft) / craft
    cosine, sine, none = np.cos(angle), np.sin(angle), np.zeros(craft)
    position = np.stack([radius_m * cosine, radius_m * sine, none + 3.0], axis=1)
    velocity = radius_m * rate_rad_s * np.stack([-sine, cosine, none], axis=1)
    turn = exp(np.stack([none, none, angle], axis=1)) @ exp(np.array([np.pi - 0.2, 0.1, 0.0]))
    rate = np.stack([none, none, none + rate_rad_s], axis=1)
    return Truth(position, quaternion_from_matrix(turn), velocity, rate, np.zeros(craft, dtype=np.bool_))


def estimate_of(
    truth: Truth,
    rng: np.random.Generator,
    attitude_sigma_rad: float = 5e-4,
    position_sigma_m: float = 5e-4,
    pnp_delay_s: float = 0.0,
    correlation: float = 0.3,
) -> Estimate:
    """An estimate whose error is drawn from its own 12x12 covariance (sigmas per axis; attitude x with position y)."""
    craft = len(truth.position)
    sigma = np.repeat([attitude_sigma_rad, 1e-2, position_sigma_m, 1e-2], 3)
    covariance = np.diag(sigma**2)
    covariance[0, 7] = covariance[7, 0] = correlation * sigma[0] * sigma[7]
    lower = np.linalg.cholesky(covariance)
    error = rng.standard_normal((craft, 12)) @ lower.T
    worse = 2.0 * rng.standard_normal((craft, 6)) * sigma[[0, 1, 2, 6, 7, 8]]
    rotation = matrix_from_quaternion(truth.quaternion)
    unknown = np.full((craft, 6, 6), np.nan)
    lit = np.full(craft, 9)
    pnp = Pose(
        exp(-worse[:, :3]) @ rotation,
        truth.position - pnp_delay_s * truth.velocity - worse[:, 3:],
        np.ones(craft, dtype=np.bool_),
        np.full(craft, 3),
        np.full(craft, 4e-5),
        np.full(craft, 1e-8),
    )
    dop = Dop(unknown, np.full(craft, 900.0), np.full(craft, 15.0), unknown)
    return Estimate(
        np.ones(craft, dtype=np.int64),
        lit,
        pnp,
        dop,
        exp(-error[:, :3]) @ rotation,
        truth.position - error[:, 6:9],
        truth.angular_rate - error[:, 3:6],
        truth.velocity - error[:, 9:],
        np.tile(covariance, (craft, 1, 1)),
        rng.chisquare(6, craft),
        np.zeros(craft, dtype=np.int64),
        np.zeros(craft, dtype=np.int64),
        np.ones(craft, dtype=np.int64),
        coupling=np.ones(craft, dtype=np.int64),
        rows=np.zeros(craft, dtype=np.int64),
    )


def lost(estimate: Estimate, craft: int) -> Estimate:
    """The same estimate, but `craft` is searching: it knows nothing."""

    def blank(values: Floats) -> Floats:
        out = values.copy()
        out[craft] = np.nan
        return out

    def zero(values: Ints) -> Ints:
        out = values.copy()
        out[craft] = 0
        return out

    pnp, dop = estimate.pnp, estimate.dilution
    return Estimate(
        zero(estimate.status),
        zero(estimate.visible),
        Pose(
            blank(pnp.rotation),
            blank(pnp.position),
            pnp.solved & (np.arange(len(pnp.solved)) != craft),
            zero(pnp.iterations),
            blank(pnp.residual_rad),
            blank(pnp.cost),
        ),
        Dop(*(blank(values) for values in dop)),
        blank(estimate.rotation),
        blank(estimate.position),
        blank(estimate.angular_rate),
        blank(estimate.velocity),
        blank(estimate.covariance),
        blank(estimate.nis),
        estimate.missed_sync,
        estimate.rejected,
        zero(estimate.sensor),
        coupling=np.zeros_like(estimate.status),
        rows=np.zeros_like(estimate.status),
    )
