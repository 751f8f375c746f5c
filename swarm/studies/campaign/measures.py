"""What a study can measure beside a run's summary: the computers' time, and what a central solver would do instead.

`Instruments` stands between the lighthouse and the flight's computers and passes everything on unchanged.

onboard: the swarm's decoder and navigator are timed as they run, for all craft at once; and after the flight craft 0
flies once more on a computer of its own, a batch of one that gets its own pulses and nothing else, as a real craft
would. Medians over the periods, without the first ones, in which it searches.

central: every 15th period, the poses of all craft that track are solved once more in one least squares with the rotor
errors as unknowns (`estimators.lighthouse.central`), from the same angles and from the same predicted poses as the
craft used. Errors are against the truth, for both over the same craft and periods. The time of a craft's own solution,
PnP and dilution, is that of craft 0 alone.

All times are of the processor, not of the wall: what else the machine runs meanwhile disturbs them through its caches
only.

Bytes on the air of the central scheme: 4 for every angle that a craft sends down, 28 for the pose (position and
quaternion in single precision) that it gets back. On its own a craft sends and receives nothing but the light.
"""

from collections.abc import Callable, Collection
from time import thread_time
from typing import Any, NamedTuple, TypeVar

import numpy as np

from estimators import rotation as rot
from estimators.arrays import Bools, Floats
from estimators.lighthouse import central
from estimators.lighthouse.dop import dilution
from estimators.lighthouse.pnp import refine
from estimators.lighthouse.sweep import correct
from swarm.flight import builders
from swarm.flight.flight import Flight
from swarm.hardware import Photodiodes
from swarm.messages import Command, Pulses, Signals
from swarm.onboard.computer import Computer, Known
from swarm.onboard.decoder import SweepAngles
from swarm.onboard.navigation import Estimate, Navigator
from swarm.onboard.settings import Status
from swarm.results.period import Period
from swarm.results.records import Truth
from swarm.scenario import Scenario

WARM_UP = 6
"""Periods at the start that no median counts."""
CENTRAL_EVERY = 15
ANGLE_BYTES, POSE_BYTES = 4, 28
REPEATS = 3
"""A timed solution is run so often, and the fastest counts: the others were disturbed."""

Metrics = dict[str, Any]
T = TypeVar("T")


class _Problem(NamedTuple):
    """A pose problem as the craft had it: angles, lit, layout, start, instants, rates; mask: who takes part."""

    theta: Floats
    lit: Bools
    point_m: Floats
    rotation: Floats
    position: Floats
    offset_s: Floats
    angular_rate: Floats
    velocity: Floats
    mask: Bools

    def of(self, chosen: Bools) -> "_Problem":
        """The same for some of the craft."""
        return _Problem._make(part[chosen] for part in self)


class Instruments:
    """Watches one flight; `metrics` says what was found. Wall-clock figures end in `_us`."""

    def __init__(self, scenario: Scenario, measure: Collection[str]) -> None:
        self._scenario, self._measure = scenario, measure
        self._photodiodes = 0.0
        self._onboard: _Onboard | None = None
        self._central: _Central | None = None

    def begin(self, flight: Flight) -> None:
        """Time the flight's computers, and stand beside them."""
        layout = flight.sensors.lighthouse.photodiodes
        self._photodiodes = float(layout.present.sum(axis=1).mean())
        if "onboard" in self._measure:
            self._onboard = _Onboard(self._scenario, flight)
            flight.computer = self._onboard
        if "central" in self._measure:
            self._central = _Central(self._scenario, flight.world.photodiodes)

    def period(self, period: Period) -> None:
        """Compare with the truth, where that is wanted."""
        if self._central is not None:
            self._central.period(period)

    def metrics(self, summary: Metrics) -> Metrics:
        """Figures, units in their names; None where there is nothing to say. summary: the run's."""
        swarm = summary.get("swarm") or {}
        visible = swarm.get("mean_visible")
        out: Metrics = {"lit_share": None if visible is None else visible / self._photodiodes}
        if "first_craft" in self._measure:
            first: Metrics = next(iter(summary.get("craft", {}).values()), {})
            visible = first.get("mean_visible")
            out["first_craft_lit_share"] = None if visible is None else visible / self._photodiodes
            for name in ("tracking_share", "ekf_position_rms_m", "ekf_attitude_rms_deg"):
                out[f"first_craft_{name}"] = first.get(name)
            out["first_craft_nees_mean"] = (first.get("nees") or {}).get("mean")
        for instrument in (self._onboard, self._central):
            out |= {} if instrument is None else instrument.metrics()
        return out


class _Onboard(Computer):
    """Times the swarm's computers, and after the flight the computer of craft 0 alone, on the pulses that it got."""

    def __init__(self, scenario: Scenario, flight: Flight) -> None:
        own, layout = flight.computer, flight.world.photodiodes
        super().__init__(own.decoder, own.navigator, own.inspection)
        self._craft, self._scenario = layout.craft_count, scenario
        self._one = Photodiodes(layout.point_m[:1], layout.normal[:1], layout.present[:1])
        self._swarm_s: list[float] = []
        self._pulses: list[Pulses] = []
        self._commands: list[Command | None] = []
        self._positions: list[Floats] = []

    def step(self, signals: Signals, command: Command | None = None, off: Bools | None = None) -> Known:
        """Step all computers, and keep what craft 0 got."""
        p, few = signals.pulses, int(signals.pulses.total[0])
        own = Pulses(p.photodiode[:1, :few], p.rise_tick[:1, :few], p.width_tick[:1, :few], p.total[:1])
        self._pulses.append(Pulses._make(part.copy() for part in own))
        self._commands.append(None if command is None else Command._make(part[:1].copy() for part in command))
        began = thread_time()
        known = super().step(signals, command, off)
        self._swarm_s.append(thread_time() - began)
        self._positions.append(known.estimate.position[0].copy())
        return known

    def metrics(self) -> Metrics:
        """Fly craft 0 once more on its own pulses, and compare."""
        decoder = builders.decoder(self._scenario, self._one.present)
        navigator = Navigator(self._one, builders.navigation(self._scenario))
        own_s, apart_m = [], 0.0
        for pulses, command, position in zip(self._pulses, self._commands, self._positions, strict=True):
            began = thread_time()
            estimate = navigator.step(decoder.decode(pulses), None, command)
            own_s.append(thread_time() - began)
            apart = np.linalg.norm(estimate.position[0] - position)
            apart_m = max(apart_m, 0.0 if np.isnan(apart) else float(apart))
        return {
            "onboard_alone_us": _median_us(own_s[WARM_UP:]),
            "onboard_swarm_per_craft_us": _median_us(self._swarm_s[WARM_UP:], self._craft),
            "onboard_alone_apart_m": apart_m,
        }


class _Central:
    """Solves sampled periods centrally, beside the craft's own solutions."""

    def __init__(self, scenario: Scenario, photodiodes: Photodiodes) -> None:
        self._layout = photodiodes
        self._settings = builders.navigation(scenario)
        self._rate_hz = scenario.lighthouse.rate_hz
        self._before: Estimate | None = None
        self._times: list[tuple[float, float]] = []
        self._sums: list[Floats] = []
        self._counts: list[tuple[int, int, int]] = []

    def period(self, period: Period) -> None:
        """Compare one period of some; keep what the craft know."""
        if period.frame % CENTRAL_EVERY == CENTRAL_EVERY - 1 and period.truth is not None:
            self._compare(period.truth, period.estimate, period.angles)
        self._before = period.estimate

    def _compare(self, truth: Truth, estimate: Estimate, angles: SweepAngles) -> None:
        """Solve the last period centrally, and by craft 0 alone; add up errors and times."""
        rho = self._settings.rotor_correlation
        problem = self._problem(estimate, angles)
        if problem is None or not problem.mask.any() or rho >= 1:
            return
        first = np.arange(len(problem.mask)) == np.flatnonzero(problem.mask)[0]
        answer, central_s = _timed(lambda: central.solve(*problem[:-1], rho, problem.mask))
        _, own_s = _timed(lambda: _alone(problem.of(first), rho))
        took = answer.solved & estimate.pnp.solved
        if not took.any():
            return
        self._times.append((central_s, own_s))
        self._counts.append((int(took.sum()), answer.iterations, int(np.count_nonzero(problem.lit[took]))))
        own_covariance = estimate.dilution.covariance[took]
        true = rot.matrix_from_quaternion(truth.quaternion[took])
        squares = [
            np.sum((truth.position[took] - answer.position[took]) ** 2, axis=1),
            np.sum((truth.position[took] - estimate.pnp.position[took]) ** 2, axis=1),
            rot.angle_between(answer.rotation[took], true) ** 2,
            rot.angle_between(estimate.pnp.rotation[took], true) ** 2,
            *(
                np.trace(covariance[:, part, part], axis1=1, axis2=2)
                for part in (slice(3, 6), slice(0, 3))
                for covariance in (answer.covariance[took], own_covariance, answer.covariance_rotor_known[took])
            ),
            np.full(int(took.sum()), 1 - np.trace(answer.rotor_covariance) / (2 * rho) if rho > 0 else 0.0),
        ]
        self._sums.append(np.array([part.sum() for part in squares]))

    def _problem(self, estimate: Estimate, angles: SweepAngles) -> _Problem | None:
        before, settings = self._before, self._settings
        if before is None:
            return None
        theta = correct(angles.theta, (settings.fan_x, settings.fan_y))
        tracked = (before.status == Status.TRACKING) & estimate.pnp.solved & np.isfinite(before.position).all(axis=1)
        moves = tracked[:, None] & np.full((1, 1), settings.motion_compensation)
        turn = rot.exp(np.nan_to_num(before.angular_rate) * settings.frame_s)
        return _Problem(
            theta,
            angles.lit & np.isfinite(theta).all(axis=-1),
            self._layout.point_m,
            turn @ before.rotation,
            before.position + before.velocity * settings.frame_s,
            angles.offset_s,
            np.where(moves, before.angular_rate, 0.0),
            np.where(moves, before.velocity, 0.0),
            tracked,
        )

    def metrics(self) -> Metrics:
        if not self._sums:
            return {}
        central_s, own_s = zip(*self._times, strict=True)
        craft, iterations, lit = np.mean(np.array(self._counts, dtype=np.float64), axis=0)
        total = np.array(self._sums).sum(axis=0) / sum(count[0] for count in self._counts)
        rms = np.sqrt(total[:10])
        return {
            "central_solve_us": _median_us(central_s),
            "own_solve_us": _median_us(own_s),
            "central_craft": float(craft),
            "central_iterations": float(iterations),
            "central_air_bytes_per_s": float((2 * lit * ANGLE_BYTES + craft * POSE_BYTES) * self._rate_hz),
            "own_air_bytes_per_s": 0.0,
            "central_position_rms_m": float(rms[0]),
            "own_position_rms_m": float(rms[1]),
            "central_attitude_rms_deg": float(np.degrees(rms[2])),
            "own_attitude_rms_deg": float(np.degrees(rms[3])),
            "central_position_gain_share": float(1 - rms[4] / rms[5]),
            "rotor_known_position_gain_share": float(1 - rms[6] / rms[5]),
            "central_attitude_gain_share": float(1 - rms[7] / rms[8]),
            "rotor_known_attitude_gain_share": float(1 - rms[9] / rms[8]),
            "rotor_variance_found_share": float(total[10]),
        }


def _alone(problem: _Problem, rho: float) -> None:
    """What one craft computes for its pose."""
    p = problem
    solution = refine(*p[:-1])
    motion = p.offset_s, p.angular_rate, p.velocity
    dilution(solution.rotation, solution.position, p.lit, p.point_m, *motion, rho, solution.solved)


def _timed(work: Callable[[], T]) -> tuple[T, float]:
    """The result, and the fastest of some repeats [s]."""
    fastest = np.inf
    for _ in range(REPEATS):
        began = thread_time()
        result = work()
        fastest = min(fastest, thread_time() - began)
    return result, fastest


def _median_us(seconds: Collection[float], among: int = 1) -> float | None:
    return float(np.median(list(seconds)) * 1e6 / among) if len(seconds) else None
