"""The guided craft of one flight: between what the craft know, what their control does, and what truly happens.

steer     what all craft should do now: the fixed motions, and what guidance decides
command   the control's feedback towards that, kept clear of other craft
learn     after the period: latches close, and the craft's switches and navigation are read for the next one
"""

import numpy as np

from estimators.arrays import Bools
from estimators.relative_orbit import RelativeOrbit
from estimators.rotation import matrix_from_quaternion
from estimators.state import Reference, State
from swarm.flight import builders
from swarm.hardware import Closing
from swarm.onboard import control
from swarm.onboard.control import Command
from swarm.onboard.guidance.guidance import Knowledge
from swarm.onboard.navigation import Estimate, Status
from swarm.results.period import Guided
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
        self.guides, self.docks = self._guidance is not None, bool(self._matings)
        """There are guided craft, and craft that dock."""

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

    def learn(self, truth: PeriodTruth, estimate: Estimate) -> Guided | None:
        """Take in the period that has ended; return what guidance does at its epoch."""
        guidance = self._guidance
        if guidance is None:
            return None
        pairs = self._latch(truth)
        sigma = np.sqrt(np.trace(estimate.covariance[:, 6:9, 6:9], axis1=1, axis2=2))
        tracking = (estimate.status == Status.TRACKING) & ~estimate.integrity.alert
        self._known = self._known._replace(
            tracking=np.where(self._blind, tracking, True), sigma_m=np.where(self._blind, sigma, 0.0)
        )
        wanted, half = self._reference, self._period_s / 2
        reference = wanted.position + wanted.velocity * half + wanted.acceleration * half**2 / 2
        return Guided(guidance.phase, reference, guidance.gave_way, pairs)

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
