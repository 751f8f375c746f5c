"""Reasons for the limits of the numbers in a scenario, which the message about a number outside them gives.

    speed_m_s: Annotated[float, SPEED] = Field(ge=1e-6, le=100, ...)

Every number has a lower and an upper limit, and a reason for each. Within its limits a number flies: what it makes of
the flight may be useless, but it is computed, without an overflow, and is what the number says.
"""

from collections.abc import Iterator
from typing import Any, NamedTuple, get_args

from pydantic.fields import FieldInfo


class Why(NamedTuple):
    """Reasons for the lower and the upper limit of a number."""

    low: str
    high: str


class Limits(NamedTuple):
    """Limits of one number: at least `low`, at most `high`, None where there is none, and the reasons."""

    low: float | None
    high: float | None
    why: Why | None


def limits_of(field: FieldInfo) -> Iterator[Limits]:
    """Yield the limits of every number that a field may hold: its own, and those of a list's entries."""
    yield from _limits(field.annotation, tuple(field.metadata))


def _limits(annotation: Any, metadata: tuple[Any, ...]) -> Iterator[Limits]:
    if hasattr(annotation, "__metadata__"):
        own = tuple(m for part in annotation.__metadata__ for m in (part.metadata if _is_field(part) else (part,)))
        yield from _limits(get_args(annotation)[0], (*metadata, *own))
    elif annotation in (int, float):
        yield Limits(_first(metadata, "ge", "gt"), _first(metadata, "le", "lt"), _why(metadata))
    else:
        inner = () if isinstance(annotation, tuple) else get_args(annotation)
        # The limits of `float | None` are those of the number; the limits of a list are not those of its entries.
        union = type(None) in inner
        for part in inner:
            yield from _limits(part, metadata if union else ())


def _is_field(part: Any) -> bool:
    return isinstance(part, FieldInfo)


def _first(metadata: tuple[Any, ...], *names: str) -> float | None:
    return next((getattr(m, name) for m in metadata for name in names if hasattr(m, name)), None)


def _why(metadata: tuple[Any, ...]) -> Why | None:
    return next((m for m in metadata if isinstance(m, Why)), None)


_DAY = "no run is longer than a day"
_NOT_NEGATIVE = "a standard deviation is not negative"
_NO_DISTANCE = "a distance is not negative"
_FAR = "positions are within 1 km of the lighthouse, the largest range_max_m"
_HALF_TURN = "two directions are at most 180 deg apart"
_TEN_G = "100 m/s^2 is ten times the gravity on ground, more than any craft gives or withstands"
_SPIN_UP = "it would spin a craft up to ten turns per second within a tenth of a second"
_PERIOD = "a lighthouse period lasts 3 ms or more"
_NO_MORE = "no model has as many"

PROBABILITY = Why("a probability is at least 0", "a probability is at most 1")
SHARE_OF_NOISE = Why("a share is at least 0", "a share is at most 1: all noise is the rotor's")
SHARE = Why("one in a million sweeps is one in some hours of a craft's light", "a share is at most 1")
MOMENT = Why("a run begins at 0 s", _DAY)
SETTLING = Why(
    "the first poses tell no velocity: a craft that relied on them at once would throw itself about",
    "after an hour of good poses nothing better is to come",
)
SPAN = Why(f"a shorter time falls between two periods: {_PERIOD}", _DAY)
ONCE = Why("less than once in 30 years: a run of a day never sees it", "ten times a second is one lasting fault")
POSITION = Why(*[_FAR] * 2)
LENGTH = Why("a micrometre is the least that counts here: it must not be zero", _FAR)
POSITION_SIGMA = Why(_NOT_NEGATIVE, "craft start within 1 km of the lighthouse, and a draw may be four times as large")
SPACING = Why("craft closer than a millimetre are one inside the other", _FAR)
FIGURE = Why("a millimetre is the least radius or length: the craft must not be at one point", _FAR)
DISTANCE = Why(_NO_DISTANCE, _FAR)
SPEED = Why(
    "a micrometre per second is less than a centimetre per hour: the craft would not move",
    "a faster craft crosses the light in a fraction of a second, and moves by metres in one period",
)
SPEED_SIGMA = Why(_NOT_NEGATIVE, SPEED.high)
VELOCITY = Why(*[SPEED.high] * 2)
SPIN = Why(*["beyond ten turns per second, a craft turns by more than 60 deg between two poses"] * 2)
SPIN_SIGMA = Why(_NOT_NEGATIVE, SPIN.high)
TURNING = Why(*["a whole formation does not turn more than once per second"] * 2)
ELEVATION = Why(*["a direction is at most 90 deg off a plane"] * 2)
ANGLE = Why(*["one turn is the most: a larger angle repeats a smaller one"] * 2)
TILT = Why(*["a quarter of a turn is the most: beyond it, the circle repeats"] * 2)
TURN = Why(*["half a turn is the most: beyond it, the figure repeats"] * 2)
ATTITUDE_SIGMA = Why(_NOT_NEGATIVE, _HALF_TURN)
SWAY = Why("a largest turn is not negative", "half a turn to either side reaches every attitude")
ATTITUDE_LIMIT = Why("a thousandth of a degree is finer than any pose that the light gives", _HALF_TURN)
PUSH = Why(_NOT_NEGATIVE, _TEN_G)
TURNING_PUSH = Why(_NOT_NEGATIVE, _SPIN_UP)
EFFORT = Why("a nanometre, or one per second squared, is below what sunlight does to a craft", _TEN_G)
DEVIATION = Why("a nanometre is finer than any pose that the light gives", "a regulator that allows 100 m does nothing")
ACCELERATION = Why("a micrometre per second squared is as weak as sunlight on a craft", _TEN_G)
PROCESS = Why("less than a thousandth of what sunlight does to a small craft: no craft knows its motion better", _TEN_G)
TURNING_PROCESS = Why("less than a thousandth of what sunlight does to a small craft", _SPIN_UP)
NUMBER = Why("parts are counted from 0", _NO_MORE)
SEED = Why("a seed is not negative", "a seed has at most 18 digits, which every file of a run can hold")
RANGE_MIN = Why("a range is not negative", _FAR)
RANGE_MAX = Why("nearer than 1 cm is inside the instrument", _FAR)
APART_MIN = Why("a range is not negative", "craft are at most 3.5 km apart, whose positions are within 1 km")
APART_MAX = Why("nearer than 1 cm is inside the instrument", APART_MIN.high)
INCIDENCE = Why(
    "below 1 deg no surface faces the light long enough to be seen", "beyond 90 deg a surface is turned away"
)

# The flight as a whole.
DURATION = Why(
    "a run takes time, and less than a millisecond is none", "a longer run does not fit on a disk or in a working day"
)
STEPS = Why(
    "poses are told in the middle of a period",
    "the motion of a craft within 1/256 of a period is below a micrometre; more steps only take time",
)
COUNT = Why("a number of craft is not negative", "the physics and the filters of more craft do not fit in memory")
ALTITUDE = Why(
    "lower, the air brakes a craft out of its orbit within one revolution",
    "higher, the Moon and the Sun disturb the orbit: it is no longer that of two bodies",
)

# The light.
ROTOR_RATE = Why(
    "a slower rotor leaves more than a second between two poses",
    "a faster rotor sweeps the field while the flashes still last",
)
ANGLE_NOISE = Why(
    _NOT_NEGATIVE,
    "with more, residuals come near 5 mrad (1031 arcsec), above which a craft accepts no pose",
)
ASSUMED_NOISE = Why(
    "the rounding to ticks of 20 ns alone is 0.45 arcsec; no craft measures better",
    ANGLE_NOISE.high,
)
JITTER = Why(_NOT_NEGATIVE, "real flashes keep to 12 us of their time, and a craft looks for them within 150 us")
TICK = Why(
    "a day in ticks of 0.01 ns is the largest whole number that a double holds",
    "longer ticks do not tell the flashes apart, whose lengths differ by 10.4 us",
)
FIELD = Why(
    "a narrower field is smaller than a craft, which needs light on four photodiodes at once",
    "beyond it a fan grazes the plane of the lighthouse itself, and is seen from behind",
)
PHOTODIODE = Why(
    "a smaller photodiode gathers no light",
    "the sweep over a larger one lasts as long as a flash, out to 2 m and more",
)
MOUNTING = Why(
    _NOT_NEGATIVE,
    "photodiodes further from their place leave residuals above 5 mrad at 3 m, and no pose is accepted",
)
STRAY = Why(
    "a rate is not negative",
    "with more, every photodiode has stray pulses in every sweep, and hardly a pose is found",
)
FAN = Why(*["half a radian is eight times the largest error of a real lighthouse's fans"] * 2)
FAN_LEFT = Why("a standard deviation is not negative", FAN.high)
LISTENING = Why(
    "a photodiode is met within a millisecond once in twenty",
    "no period of circuits that sleep in between is longer than a second",
)
CHANNEL = Why("channels are counted from 1, as on the stations", "there are 16 channels")
BEAM = Why("a thickness is not negative", "a plane of light 5 cm thick would light a whole craft at once")
SURVEY = Why(_NOT_NEGATIVE, "a station surveyed a metre off its place is a station elsewhere")
SURVEY_TURN = Why(_NOT_NEGATIVE, "a station surveyed by 30 deg off looks elsewhere")
PHASE = Why(*["one turn is the most: a larger phase repeats a smaller one"] * 2)

# Navigation.
GATE = Why("the gate would refuse half of all good measurements", "the gate would let every measurement pass")
COAST = Why("a time is not negative", "after an hour without light a prediction says nothing")
MODELS = Why("one model is navigation.quiet.craft = 'none'", "their noises would be closer than the light tells apart")
STAY = Why("below 0.1 s a model lasts for a few periods", "in a million seconds a craft would change its motion once")
RARE = Why(
    "a double does not tell rarer events from impossible ones",
    "a test that is wrong half of the time is no test",
)
RISK = Why(RARE.low, "the bound of a protection level is proven for errors rarer than one in five")
FALSE_PHOTODIODES = Why(_NOT_NEGATIVE, "three at once are more than most craft could do without")
FALSE_STATIONS = Why(_NOT_NEGATIVE, "with two at once false, none is left that most craft could do with")
ALERT = Why("a millionth of a millimetre is finer than any pose", "an error of 1 km is beyond every position")
ALERT_ATTITUDE = Why("a millionth of a degree is finer than any pose", _HALF_TURN)

# Motions.
BANDWIDTH = Why("a slower motion takes hours for one sway", "a faster motion shakes between two periods of 60 Hz")
GLIDESLOPE = Why("a craft cannot brake within a tenth of a second", "an hour for the last metre is never flown")
CONTACT_SPEED = Why(SPEED.low, "a contact at more than 10 m/s is a collision")
LOST = Why(SPAN.low, "after an hour without a pose a craft is lost by any measure")
CORRIDOR = Why("a cone opens by 0 deg or more", "a cone of 90 deg or more is no corridor")
RETREATS = Why("a number is not negative", "a thousand retreats take longer than any run")

# Actuators.
THRUST = Why(_NOT_NEGATIVE, "a thruster off by more than half has failed: that is the fault thruster-stuck")
THRUST_TILT = Why(_NOT_NEGATIVE, "a thruster tilted by more than 30 deg is mounted elsewhere")

# Cameras.
FOCAL = Why("a lens shorter than a millimetre is no camera's", "a lens longer than a metre sees no craft whole nearby")
CAMERA_FIELD = Why("a narrower field does not hold one craft", "a flat image cannot hold half of space")
CONE = Why("a light that shines into less than a tenth of a degree is never met", "half of space is the most")
IMAGE_NOISE = Why(_NOT_NEGATIVE, "a tenth of a millimetre is ten pixels and more: no light is found so badly")
PIXEL = Why("a step is not negative", "a tenth of a millimetre is ten pixels")
BELIEVED_IMAGE = Why("a nanometre is less than a thousandth of a pixel", IMAGE_NOISE.high)
CAMERA_PLACE = Why(_NOT_NEGATIVE, "cameras that far from their place are mounted elsewhere")
CAMERA_TURN = Why(_NOT_NEGATIVE, "cameras turned by more than 2 deg are mounted elsewhere")
FAILURE = Why("more than ten failures a second are one lasting failure", _DAY)

# LiDAR.
LINES = Why("a LiDAR has one line at least", "more lines take minutes per scan, and no LiDAR has them")
LIDAR_FIELD = Why("a narrower field is one ray", "lines within 5 deg of the axis of the spin do not spread")
SCAN_WIDTH = Why("a narrower line is one ray", "a line goes round once")
RESOLUTION = Why("finer rays take minutes per scan", "ten degrees between rays leave no ray on a craft at 2 m")
SCAN_RATE = Why(
    "slower, a run of a quarter of an hour has no second scan",
    "at most one scan per lighthouse period, and 300 periods per second",
)
RANGE_NOISE = Why(_NOT_NEGATIVE, "ranges off by more than a decimetre say nothing about the shape of a craft")
RAY_JITTER = Why(_NOT_NEGATIVE, "rays off by more than a degree miss a craft at 30 m")

# Faults.
SWING = Why(*["beyond 0.09 % the flashes leave the place where a craft looks for them"] * 2)
SWING_TIME = Why(f"a shorter swing falls between two periods: {_PERIOD}", "an hour is longer than any swing")
RESTART = Why(f"a shorter restart falls between two periods: {_PERIOD}", "a computer that is off for an hour is lost")
GHOST_SPREAD = Why("a millionth of a degree is no error", "beyond 60 deg the reflection is outside the field")

# Criteria.
ANY_FIGURE = Why(*["no column of the telemetry reaches a thousand million"] * 2)
