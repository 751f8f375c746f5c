"""The rungs of lighthouse-dynamic: the causes of error at work, the cures, and the computer that measures with them.

A rung is a lighthouse and an on-board computer beside the flight's own. All of them see the same motion and draw the
same noise; they differ by the station's systematic errors, by where the photodiodes really are, by whether the craft
moves within a period, and by what the craft knows: nothing, its motion, or what a calibration has found.
"""

from dataclasses import replace
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, NamedTuple, cast

import numpy as np

from estimators.arrays import Bools, Floats
from estimators.lighthouse.sweep import FanPair, correct
from swarm import random
from swarm.flight import builders
from swarm.flight.simulate import simulate
from swarm.hardware import Photodiodes
from swarm.onboard.navigation import Navigator
from swarm.onboard.settings import NavigationSettings
from swarm.random import Purpose
from swarm.scenario import Fan, Scenario, Wander, load
from swarm.scenario import Lighthouse as Station
from swarm.sensors.lighthouse import Lighthouse, fans
from swarm.studies.calibration.calibrate import calibrate_survey
from swarm.studies.calibration.survey import observe_run
from swarm.studies.papers.alignment import Alignment, align
from swarm.studies.papers.bench import Bench, Box
from swarm.world.world import PeriodTruth

UNCALIBRATED_NOISE = 4.0
"""An uncalibrated craft believes its angles so many times less: else its filter would refuse its own poses."""
ALIGNMENT_POSES, ALIGNMENT_FRAMES = 40, 30
"""The alignment: so many poses at rest, and periods at each."""


class Rung(NamedTuple):
    """The causes of error that are at work, and what is done about them."""

    name: str
    moving: bool = True
    fans: bool = True
    mounting: bool = True
    compensated: bool = False
    calibrated: bool = False


NOISE, FULL, BOTH = "noise only", "+ mounting", "both"
LADDER = (
    Rung(NOISE, moving=False, fans=False, mounting=False),
    Rung("+ motion", fans=False, mounting=False),
    Rung("+ fan errors", mounting=False),
    Rung(FULL),
    Rung("compensation", compensated=True),
    Rung("calibration", calibrated=True),
    Rung(BOTH, compensated=True, calibrated=True),
)


class Knowledge(NamedTuple):
    """A calibrated craft's knowledge of the station's fans, and of its photodiodes (1, K, 3) [m]."""

    fans: FanPair
    photodiodes: Photodiodes


class Track(NamedTuple):
    """Poses over N periods: rotation (N, 3, 3), position (N, 3) [m]; NaN where there is none."""

    rotation: Floats
    position: Floats


class Computer:
    """One rung: its own lighthouse and its own on-board computer, beside the flight's."""

    def __init__(self, rung: Rung, scenario: Scenario, layout: Photodiodes, key: int, known: Knowledge) -> None:
        """Set up the lighthouse and the computer of a rung.

        Args:
            rung: The rung.
            scenario: The flight's scenario.
            layout: Photodiodes as drawn.
            key: The craft's key, from which its draws follow.
            known: What the craft knows if it is calibrated.
        """
        self._moving = rung.moving
        self._lighthouse = Lighthouse(layout, station(scenario, rung), scenario.seed, [key])
        self._decoder = builders.decoder(scenario, layout.present)
        self._navigator = Navigator(known.photodiodes if rung.calibrated else layout, settings(scenario, rung, known))
        self._pnp: list[Track] = []
        self._filtered: list[Track] = []

    def step(self, truth: PeriodTruth, frame: int, lit: Bools) -> None:
        """Measure and navigate through one period.

        Args:
            truth: True motion of the craft.
            frame: Number of the period.
            lit: Photodiodes that are lit.
        """
        pulses = self._lighthouse.sweep(truth if self._moving else halted(truth), frame, lit)
        expected = partial(self._navigator.expected_angles, self._decoder.turn_s)
        estimate = self._navigator.step(self._decoder.decode(pulses, expected))
        self._pnp.append(Track(estimate.pnp.rotation[0], estimate.pnp.position[0]))
        self._filtered.append(Track(estimate.rotation[0], estimate.position[0]))

    @property
    def pnp(self) -> Track:
        """The poses that PnP found."""
        return _joined(self._pnp)

    @property
    def filtered(self) -> Track:
        """The filter's poses."""
        return _joined(self._filtered)


def _joined(poses: list[Track]) -> Track:
    return Track(np.array([pose.rotation for pose in poses]), np.array([pose.position for pose in poses]))


def calibrated(scenario: Scenario, layout: Photodiodes) -> Knowledge:
    """Return what `swarm calibrate` finds for this station and craft, from the survey scenario with known poses.

    layout: photodiodes as drawn. Raises SwarmError where the survey does not do.
    """
    # Another seed: the noise of the survey is not that of the runs. The hardware is the same, by its mounting_seed.
    survey = load("survey", seed=scenario.seed + 1).model_copy(update={"lighthouse": scenario.lighthouse})
    with TemporaryDirectory() as folder:
        flown = simulate(survey, out=Path(folder) / "survey", record=False)
        found = calibrate_survey(observe_run(flown.folder), "truth").station()
    points = found.by_name[survey.craft_names[0]]
    return Knowledge((found.fan_x, found.fan_y), layout._replace(point_m=points[None]))


def station(scenario: Scenario, rung: Rung) -> Station:
    """Return the station and the mounting, with the rung's errors only."""
    none: dict[str, Any] = {} if rung.fans else {"fan_x": Fan(), "fan_y": Fan()}
    return scenario.lighthouse.model_copy(update=none if rung.mounting else none | {"mounting_error_mm": 0.0})


def settings(scenario: Scenario, rung: Rung, known: Knowledge) -> NavigationSettings:
    """Return the on-board computer's settings.

    Args:
        scenario: The flight's scenario.
        rung: The rung.
        known: What the craft knows if it is calibrated.
    """
    out = replace(builders.navigation(scenario), motion_compensation=rung.compensated)
    if rung.calibrated:
        out = replace(out, fan_x=known.fans[0], fan_y=known.fans[1])
    trusted = (rung.calibrated and rung.compensated) or not rung.moving
    return out if trusted else replace(out, angle_noise_rad=UNCALIBRATED_NOISE * out.angle_noise_rad)


def halted(truth: PeriodTruth) -> PeriodTruth:
    """Return the same period, with everything at rest where it is at the epoch."""
    epoch = len(truth.time_s) // 2
    position, quaternion = (
        np.repeat(part[epoch][None], len(part), axis=0) for part in (truth.position, truth.quaternion)
    )
    still = np.zeros_like(truth.velocity)
    return PeriodTruth(truth.time_s, position, quaternion, still, still, truth.contact)


def alignment(rung: Rung, scenario: Scenario, mounted: Photodiodes, known: Knowledge) -> Alignment:
    """Align the frames with a rung's own PnP at poses at rest, as the paper's prior calibration does.

    Args:
        rung: The rung.
        scenario: The flight's scenario.
        mounted: Photodiodes where they really are.
        known: What the craft knows if it is calibrated.
    """
    bench = Bench(scenario.swarm.model)
    rng = random.stream(scenario.seed, Purpose.ALIGNMENT)
    motion = cast(Wander, scenario.swarm.motion)
    box = Box(motion.centre_m, motion.size_m, np.radians(motion.turn_deg))
    noise, correlation = bench.settings.angle_noise_rad, bench.settings.rotor_correlation
    errors = fans(station(scenario, rung))
    believed = known.photodiodes.point_m[0] if rung.calibrated else bench.point_m
    points = np.repeat(mounted.point_m if rung.mounting else bench.layout.point_m, ALIGNMENT_FRAMES, axis=0)
    measured: list[Floats] = []
    true: list[Floats] = []
    while len(true) < ALIGNMENT_POSES:
        pose, lit = bench.random_pose(rng, box)
        error = bench.noise(ALIGNMENT_FRAMES, rng, noise, correlation)
        lit = np.repeat(lit, ALIGNMENT_FRAMES, axis=0)
        rows = pose.repeat(ALIGNMENT_FRAMES)
        angles = bench.angles(rows, lit, error, rng, fans=errors, point_m=points)
        if rung.calibrated:
            angles = angles._replace(theta=correct(angles.theta, known.fans))
        first = bench.first_pose(angles, noise, believed)
        if first is None:
            continue
        solution = bench.solve(angles, first.repeat(ALIGNMENT_FRAMES), point_m=believed)
        measured.append(solution.position[solution.solved].mean(axis=0))
        true.append(pose.position[0])
    return align(np.array(measured), np.array(true))
