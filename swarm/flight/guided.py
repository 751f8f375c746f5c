"""The guided craft of one flight: between what the craft know, what their control does, and what truly happens.

steer     what all craft should do now: the fixed motions, and what guidance decides
command   the control's feedback towards that, kept clear of other craft
learn     after the period: latches close, and the craft's switches and navigation are read for the next one
"""

import numpy as np

from estimators.arrays import Bools, Floats
from estimators.relative_orbit import RelativeOrbit
from estimators.rotation import matrix_from_quaternion
from estimators.state import Reference, State
from swarm.flight import builders
from swarm.hardware import Closing
from swarm.onboard import control
from swarm.onboard.control import Command
from swarm.onboard.guidance.guidance import Knowledge
from swarm.onboard.navigation import Estimate, Status
from swarm.results.columns import guidance as guidance_columns
from swarm.results.columns.extra import Extra
from swarm.scenario import Scenario
from swarm.world.docking import Mating
from swarm.world.motion.fleet import Fleet
from swarm.world.world import PeriodTruth, World


class GuidedFlight:
    """The motions and the guidance of a scenario's C craft; without guided craft, just the motions."""

    def __init__(self, settings: Scenario, motions: Fleet, world: World, steers_by_estimate: Bools) -> None:
        station = motions.at(0.0)
        self._motions, self._world = motions, world
        self._blind = steers_by_estimate
        self._matings = builders.matings(settings)
        self._guidance = builders.guidance(settings, self._matings, station)
        nothing = np.zeros(len(steers_by_estimate))
        self._known = Knowledge(nothing > 0, nothing, nothing > 0)
        self._period_s = 1 / settings.lighthouse.rate_hz
        self._reference = station
        self.columns: tuple[Extra, ...] = () if self._guidance is None else guidance_columns.COLUMNS
        """The telemetry columns that this flight has beside the usual ones."""
        if self._matings:
            self.columns += guidance_columns.DOCKING_COLUMNS
        self.values: Floats = np.zeros((len(nothing), 0))
        """Their values for the last period, (C, N)."""

    def steer(self, time_s: float, believed: State) -> Reference:
        """Where every craft should be at `time_s` [s], as far as they know by `believed` where they are."""
        steered = None if self._guidance is None else self._guidance.steer(time_s, believed, self._known)
        self._reference = self._motions.at(time_s, steered)
        return self._reference

    def command(self, reference: Reference, believed: State, orbit: RelativeOrbit | None) -> Command:
        """What every craft orders its actuators to do, to get there; orbit: the lighthouse's."""
        if self._guidance is None:
            return control.command(reference, believed, orbit)
        wanted = control.command(reference, believed, firm=self._guidance.feedback)
        clear = self._guidance.clear(wanted, believed)
        return clear if orbit is None else control.without_gravity(clear, reference.holds_position, believed, orbit)

    def learn(self, truth: PeriodTruth, estimate: Estimate) -> None:
        """What the period that has ended brings."""
        if self._guidance is None:
            return
        pairs = self._latch(truth)
        sigma = np.sqrt(np.trace(estimate.covariance[:, 6:9, 6:9], axis1=1, axis2=2))
        tracking = (estimate.status == Status.TRACKING) & ~estimate.integrity.alert
        self._known = self._known._replace(
            tracking=np.where(self._blind, tracking, True), sigma_m=np.where(self._blind, sigma, 0.0)
        )
        epoch, wanted, half = len(truth.time_s) // 2, self._reference, self._period_s / 2
        reference = wanted.position + wanted.velocity * half + wanted.acceleration * half**2 / 2
        guidance = self._guidance
        block = [guidance_columns.values(guidance.phase, guidance.gave_way, reference, truth.position[epoch])]
        if self._matings:
            block.append(guidance_columns.docking_values(len(guidance.phase), pairs))
        self.values = np.concatenate(block, axis=1)

    def _latch(self, truth: PeriodTruth) -> list[tuple[int, Closing]]:
        """Close the latches that have met; how every pair stands at the epoch."""
        epoch, last = len(truth.time_s) // 2, -1
        for number, mating in enumerate(self._matings):
            i = mating.craft
            met = truth.contact[i] and truth.contact[mating.target] and not self._known.latched[i]
            if met and mating.within_reach(_closing(mating, truth, last)):
                self._world.latch(number)
                self._known.latched[i] = True
        return [(mating.craft, _closing(mating, truth, epoch)) for mating in self._matings]


def _closing(mating: Mating, truth: PeriodTruth, knot: int) -> Closing:
    """How the two ports stand at one knot of the period."""
    rotation = matrix_from_quaternion(truth.quaternion[knot])
    return mating.closing(rotation, truth.position[knot], truth.velocity[knot], truth.angular_rate[knot])
