"""Plug-ins in Python: inputs and answers of a navigator or a controller of your own, one object per craft.

    [swarm]
    navigator = "ukf.py:Ukf"               # a class in a file beside the scenario, or the name of an entry point
    controller = "my_controller.py:Spring"

The class is called once per craft with its `OwnCraft`. Then `step` of a navigator is called once per lighthouse period
with the light of this craft, and `steer` of a controller with its own belief; neither ever gets the truth, unless the
scenario steers the craft by it (feedback = "truth").

Frames: a pose is (R, p) of the body in the lighthouse frame, with several stations in the world's (x_l = R x_b + p).
Rates are of that frame: velocity dp/dt [m/s], angular rate w [rad/s] with dR/dt = [w]x R. Errors of attitude are
active, on the left: R_true = Exp([d]x) R_estimated. Covariances are in the order (attitude d, angular rate, position,
velocity).
"""

from collections.abc import Mapping, Sequence
from typing import NamedTuple, Protocol

import numpy as np

from estimators.arrays import Floats
from estimators.lighthouse.integrity import AngleNoise
from estimators.lighthouse.rows import Rows, Station, linearise, packed
from estimators.relative_orbit import RelativeOrbit
from estimators.state import Reference, State

__all__ = ["Belief", "Controller", "Light", "Moment", "Navigator", "OwnCraft", "Pose", "Wrench", "unexplained"]


class OwnCraft(NamedTuple):
    """Knowledge of a craft about itself before it flies.

    name: its name. period_s: length of a lighthouse period [s]. mass_kg: [kg]. inertia_kg_m2: (3, 3) about the centre
    of mass, body frame. centre_of_mass_m: (3,) [m], body frame. All three are NaN in a replay. photodiode_m: (K, 3)
    [m], body frame, as the craft assumes them. stations: of one lighthouse this alone. noise: of a sweep angle by
    station: the photodiode's own part and the rotor's, which a sweep shares [rad]. acceleration_noise_m_s2,
    angular_acceleration_noise_rad_s2: process noise that the scenario's filter assumes: white, standard deviation per
    axis and period. orbit: the lighthouse's orbit, None in weightless space. random: a generator by the run's seed and
    the craft's name; draws from any other one would not be the same in the next run.
    """

    name: str
    period_s: float
    mass_kg: float
    inertia_kg_m2: Floats
    centre_of_mass_m: Floats
    photodiode_m: Floats
    stations: Sequence[Station]
    noise: Sequence[AngleNoise]
    acceleration_noise_m_s2: float
    angular_acceleration_noise_rad_s2: float
    orbit: RelativeOrbit | None
    random: np.random.Generator

    def angle_covariance(self, rows: Rows) -> Floats:
        """Return the covariance (M, M) [rad^2] of the noise of M rows: angles of one sweep share the rotor's part."""
        own, rotor = np.array(self.noise).reshape(-1, 2)[rows.station].T
        sweep = np.stack([rows.station, rows.fan, rows.sweep], axis=1)
        same = (sweep[:, None] == sweep[None]).all(axis=2)
        out: Floats = np.diag(own**2) + same * np.outer(rotor, rotor)
        return out


class Pose(NamedTuple):
    """A pose from the light of one period alone: rotation (3, 3), position (3,) [m], at the epoch; covariance (6, 6) of
    (attitude, position) [rad, m].
    """

    rotation: Floats
    position: Floats
    covariance: Floats


class Light(NamedTuple):
    """All that a craft has learned in a period.

    time_s: the epoch, the middle of the period [s]. rows: every sweep angle, M of them (none where it is dark), each
    with its own instant. pose: what four or more photodiodes decide, or a search before the first belief, solved with
    the rates that the navigator returned last; None where they do not. acceleration, angular_acceleration: (3,) [m/s^2,
    rad/s^2], what the craft has ordered from its actuators, mean since the last epoch. stations: the stations that the
    rows name.
    """

    time_s: float
    rows: Rows
    pose: Pose | None
    acceleration: Floats
    angular_acceleration: Floats
    stations: Sequence[Station]


class Belief(NamedTuple):
    """Knowledge of a navigator at the epoch.

    rotation: (3, 3). position: (3,) [m]. velocity: (3,) [m/s]. angular_rate: (3,) [rad/s]. covariance: (12, 12), of
    (attitude, angular rate, position, velocity). took_light: whether light of this period went into it. nis: normalised
    innovation squared of that light, NaN if it is not told; freedom: its degrees of freedom.
    """

    rotation: Floats
    position: Floats
    velocity: Floats
    angular_rate: Floats
    covariance: Floats
    took_light: bool = True
    nis: float = float("nan")
    freedom: int = 6


class Navigator(Protocol):
    """A navigator: a class that is called with the `OwnCraft`. After a restart of its computer a craft has a new
    one.
    """

    def step(self, light: Light) -> Belief | None:
        """Take in a period, and return the belief at its epoch; None where the craft does not know its pose."""


class Moment(NamedTuple):
    """All that a craft steers by, at the beginning of a period.

    time_s: [s]. state: of the craft, without the craft axis: rotation (3, 3), position (3,), velocity (3,),
    angular_rate (3,). covariance: (12, 12) of its estimate at the last epoch; NaN where the scenario steers the craft
    by the truth. reference: the state that the craft's motion wants now, likewise without the craft axis; its
    holds_position and holds_attitude are False where the motion wants nothing. neighbours: positions (3,) [m] and
    velocities (3,) [m/s] of the other craft by their names, as their last broadcasts tell; who is silent for 5 s is
    left out.
    """

    time_s: float
    state: State
    covariance: Floats
    reference: Reference
    neighbours: Mapping[str, tuple[Floats, Floats]]


class Wrench(NamedTuple):
    """Wanted wrench for a period: force (3,) [N] and torque (3,) [N m] about the centre of mass, in the
    frame of the poses, not of the body.
    """

    force: Floats
    torque: Floats


class Controller(Protocol):
    """A controller: a class that is called with the `OwnCraft`. It is asked only while the craft knows its state."""

    def steer(self, now: Moment) -> Wrench:
        """Return the wrench for the period that begins."""


def unexplained(
    craft: OwnCraft,
    light: Light,
    rotation: Floats,
    position: Floats,
    velocity: Floats,
    angular_rate: Floats,
) -> tuple[Floats, Floats]:
    """Return what a state does not explain of the angles: y (M,) [rad], measured minus expected, and H (M, 12).

    y = H x + noise for the error x of the state; the covariance of the noise is `OwnCraft.angle_covariance`. Both are
    NaN for a photodiode that would be behind its station.

    Args:
        craft: the craft.
        light: with the M rows.
        rotation: (3, 3), at the epoch.
        position: (3,) [m].
        velocity: (3,) [m/s].
        angular_rate: (3,) [rad/s].
    """
    stations = packed(light.stations)
    found = linearise(light.rows, stations, craft.photodiode_m, rotation, position, velocity, angular_rate)
    return found.residual, found.matrix
