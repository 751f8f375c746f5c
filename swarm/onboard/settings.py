"""The configuration of a craft's computer, and the codes of its reports."""

from dataclasses import dataclass, field
from enum import IntEnum, IntFlag
from math import sqrt

import numpy as np

from estimators.arrays import Bools, Floats, Ints
from estimators.filter.error_state import (
    DEFAULT_ACCELERATION_NOISE_M_S2,
    DEFAULT_ANGULAR_ACCELERATION_NOISE_RAD_S2,
)
from estimators.frame import WORLD, Frame
from estimators.kernel import kernel
from estimators.lighthouse.integrity import AngleNoise
from estimators.lighthouse.row_motion import HandMotion
from estimators.lighthouse.sweep import FanErrors
from estimators.relative_orbit import RelativeOrbit
from swarm.onboard.inertial import InertialSensors
from swarm.onboard.integrity import IntegritySettings
from swarm.onboard.place_errors import PlaceSigma
from swarm.onboard.reference_craft import ReferencePlace
from swarm.onboard.shared_errors import Relations

MIN_LIT = 4
"""Least number of photodiodes for a pose (source 1, section 2)."""

LEAST_OWN = 1e-3
"""Least share of a photodiode's own noise in an angle's: all of it from the rotor would make angles certain."""


class Status(IntEnum):
    """State of a craft's knowledge of its pose.

    Searching: no pose. Tracking: this period's pose went into the filter, or sweep angles of as many photodiodes as
    decide one. Coasting: prediction only. Ambiguous: more than one pose fits, and none is reported. Single sweeps:
    sweep angles of fewer photodiodes went into the filter.
    """

    SEARCHING = 0
    TRACKING = 1
    COASTING = 2
    AMBIGUOUS = 3
    SINGLE_SWEEPS = 4


SEARCHING, TRACKING, COASTING, AMBIGUOUS, SINGLE_SWEEPS = (int(status) for status in Status)
"""The codes as plain numbers, which NumPy takes at once."""
BY_LIGHT = (Status.TRACKING, Status.SINGLE_SWEEPS)
"""States of a craft whose filter took in light in this period."""


@kernel
def status_codes(active: Bools, ambiguous: Bools, since_update_s: Floats, since_pose_s: Floats) -> Ints:
    """Return the codes of `Status` (C,) after a period.

    Args:
        active: (C,), craft with an estimate.
        ambiguous: (C,), those of the others whose light fits more than one pose.
        since_update_s: (C,), time since a filter took in a pose or single sweeps [s].
        since_pose_s: (C,), time since it took in a pose, or sweep angles of as many photodiodes as decide one [s].
    """
    out = np.empty(len(active), dtype=np.int64)
    for c in range(len(active)):
        if not active[c]:
            out[c] = AMBIGUOUS if ambiguous[c] else SEARCHING
        elif since_pose_s[c] == 0.0:
            out[c] = TRACKING
        else:
            out[c] = SINGLE_SWEEPS if since_update_s[c] == 0.0 else COASTING
    return out


def by_light(status: Ints) -> Bools:
    """Return the craft whose filter took in light in this period, by their codes of `Status`, any shape."""
    out: Bools = (status == TRACKING) | (status == SINGLE_SWEEPS)
    return out


class Coupling(IntEnum):
    """Coupling in force in a period: no light in the filter, a pose (loose), or single sweeps (tight)."""

    NONE = 0
    LOOSE = 1
    TIGHT = 2


class Sensor(IntFlag):
    """The sensors whose poses, or single sweeps, went into a craft's filter in a period."""

    NONE = 0
    LIGHTHOUSE = 1
    STEREO = 2
    CAMERA = 4


@dataclass(frozen=True)
class QuietModel:
    """The models of craft that move less than the one that manoeuvres, in SI units.

    acceleration_noise_m_s2, angular_acceleration_noise_rad_s2: process noise of the quietest. quiet_s: mean time until
    a craft is taken to move more. manoeuvre_s: mean time until it is taken to move less. only_free: whether only craft
    that turn without torque have them. models: number of all models, with noises in geometric series.
    """

    acceleration_noise_m_s2: float
    angular_acceleration_noise_rad_s2: float
    quiet_s: float
    manoeuvre_s: float
    only_free: bool = False
    models: int = 6


@dataclass(frozen=True)
class NavigationSettings:
    """The configuration of every craft's navigation, in SI units.

    frame_s: length of a lighthouse period. angle_noise_rad, rotor_correlation: s and rho of (18), (19).
    motion_compensation: whether poses are solved with the motion within the period. acceleration_noise_m_s2,
    angular_acceleration_noise_rad_s2: process noise of the filter, of its liveliest model if it has several. quiet: its
    quieter models; None for one model. gate_probability: of the filter's gate.
    coast_limit_s: time without light after which the filter is stopped. residual_limit_rad: residual above which a fit
    is rejected. rejections_limit: number of successive poses refused by the gate after which the filter counts as
    wrong. search_again_s: time without light after which a search begins beside the filter. filter: "filterpy";
    "compiled", which returns the same numbers faster; or "auto", which chooses by the number of craft. coupling:
    "loose", "tight" or "auto" (`swarm.onboard.single_sweeps`). fan_x, fan_y:
    known errors of the fans. integrity: settings of the integrity monitor. orbit: the lighthouse's orbit, None in
    weightless space. station: the lighthouse's frame in the world. history: whether estimates carry the filter's
    prediction, for a smoother. place_sigma_m: by how much photodiodes may be off their places on the craft all the
    time [m], which limits what several stations' rows tell of mirror images. relations: errors that craft share, and
    who navigates relative to whom. reference: craft at known places that take each sweep's error off all angles.
    hand: how a hand moves the craft; None: searches take them to be at rest, and nothing watches mirror images.
    places: how far stations and photodiodes may be off, which covariances consider; None: not at all.
    order_lead_s: by how much earlier than its beginning a period's orders begin to act [s].
    inertial: the gyroscope and accelerometer whose samples come with the light of several stations; None: there are
    none.
    """

    frame_s: float
    angle_noise_rad: float
    rotor_correlation: float
    motion_compensation: bool = True
    acceleration_noise_m_s2: float = DEFAULT_ACCELERATION_NOISE_M_S2
    angular_acceleration_noise_rad_s2: float = DEFAULT_ANGULAR_ACCELERATION_NOISE_RAD_S2
    quiet: QuietModel | None = None
    gate_probability: float = 0.99999
    coast_limit_s: float = 2.0
    residual_limit_rad: float = 5e-3
    rejections_limit: int = 6
    search_again_s: float = 0.25
    filter: str = "auto"
    coupling: str = "auto"
    fan_x: FanErrors = field(default_factory=FanErrors)
    fan_y: FanErrors = field(default_factory=FanErrors)
    integrity: IntegritySettings = field(default_factory=IntegritySettings)
    orbit: RelativeOrbit | None = None
    station: Frame = WORLD
    history: bool = False
    place_sigma_m: float = 0.0
    reference: tuple[ReferencePlace, ...] = ()
    relations: Relations = field(default_factory=Relations)
    hand: HandMotion | None = None
    places: PlaceSigma | None = None
    order_lead_s: float = 0.0
    inertial: InertialSensors | None = None

    @property
    def noise(self) -> AngleNoise:
        """The noise of an angle, the photodiode's own part and the rotor's."""
        own = max(sqrt(1 - self.rotor_correlation), LEAST_OWN)
        return AngleNoise(self.angle_noise_rad * own, self.angle_noise_rad * sqrt(self.rotor_correlation))
