"""One lighthouse period after the other, for all craft: move, see, navigate.

    dynamics (MuJoCo's truth over one period) -> line of sight -> the lighthouse's pulses -> every craft's decoder
    -> its navigation, with its cameras -> LiDARs -> what it believes, by which it steers next

Nothing but pulses passes from the lighthouse to a craft.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from estimators.arrays import Bools, Floats
from swarm import random
from swarm.flight import builders
from swarm.flight.dynamics import Dynamics
from swarm.flight.scene import scene
from swarm.onboard.decoder import SweepAngles
from swarm.onboard.inspection import LidarFix
from swarm.onboard.navigation import Estimate, Navigator
from swarm.results.angles import believed
from swarm.results.columns import integrity as integrity_columns
from swarm.results.records import Truth
from swarm.scenario import Scenario
from swarm.sensors.ccd import Ccd
from swarm.sensors.lighthouse import Lighthouse
from swarm.sensors.visibility import Sight, Visibility
from swarm.world.world import PeriodTruth


class Seen(NamedTuple):
    """One period at its epoch: time_s, the truth, the `Sight` of every photodiode (C, K), what each craft knows."""

    time_s: float
    truth: Truth
    sight: NDArray[np.int8]
    estimate: Estimate


class Flight:
    """The world, its sensors and every craft's computer.

    After each period, angles: what every craft's decoder made of it; scans: what became of the LiDARs' scans that it
    completed; extra: the values of the telemetry's extra columns, (C, N). scene: what a recording is told beforehand.
    """

    def __init__(self, scenario: Scenario) -> None:
        """Build everything. Raises SwarmError where the scenario cannot fly."""
        station = scenario.lighthouse
        self.dynamics = Dynamics(scenario)
        self.world = self.dynamics.world
        layout = builders.photodiodes(scenario, self.world)
        self.visibility = Visibility(
            self.world.model, layout, self.world.craft_bodies, self.world.lighthouse_body, station
        )
        self.lighthouse = Lighthouse(layout, station, scenario.seed, random.keys(scenario.craft_names))
        self.faults = builders.faults(scenario, self.world, self.lighthouse, self.visibility)
        self.decoder = builders.decoder(scenario, layout.present)
        cameras = builders.cameras(scenario, self.world, self.dynamics.motions.at(0.0))
        pairs = [true for true, _ in cameras]
        self.ccd = Ccd(pairs, self.visibility, scenario.seed, scenario.duration_s) if cameras else None
        self.lidars = builders.lidars(scenario, self.world)
        self.inspection = builders.inspection(scenario, self.lidars)
        navigation = builders.navigation(scenario)
        own_layout = builders.believed_layout(scenario, self.world.photodiodes)
        own_layout = own_layout._replace(present=layout.present)
        self.navigator = Navigator(own_layout, navigation, [known for _, known in cameras])
        fans, noise = (navigation.fan_x, navigation.fan_y), builders.angle_noise(scenario)
        self.believed = believed(self.world.names, own_layout, fans, noise)
        self.angles: SweepAngles | None = None
        self.scans: list[LidarFix] = []
        self.extra: Floats | None = None
        self.period_s = 1 / station.rate_hz
        fault = [] if self.faults is None else [integrity_columns.fault_column(self.faults.schedule.names)]
        limits = scenario.navigation.integrity
        watched = bool(fault) or limits.alert_position_mm is not None or limits.alert_attitude_deg is not None
        own = integrity_columns.columns(watched)
        extra = [*own, *self.dynamics.actuators.columns, *self.dynamics.guided.columns, *fault]
        self.scene = scene(scenario, self.world, layout, pairs, self.inspection, extra)

    def period(self, frame: int) -> Seen:
        """Fly one lighthouse period."""
        truth, sight = self.move(frame)
        self.angles = self._measure(truth, frame, sight == Sight.LIT)
        images = self.ccd.expose(truth, frame) if self.ccd is not None else None
        estimate = self.navigator.step(self.angles, images, self.dynamics.command)
        at_epoch = _at_epoch(truth)
        time_s = float(truth.time_s[len(truth.time_s) // 2])
        if self.inspection is not None:
            found = [scan for lidar in self.lidars for scan in lidar.sweep(truth)]
            self.scans = self.inspection.step(found, estimate, time_s)
            estimate = self.inspection.into(estimate)
        self.dynamics.learn(truth, estimate)
        self.extra = self._extra(estimate)
        return Seen(time_s, at_epoch, np.minimum(sight[..., 0], sight[..., 1]), estimate)

    def move(self, frame: int) -> tuple[PeriodTruth, NDArray[np.int8]]:
        """Move every craft through one lighthouse period, and no more: nobody measures, nobody navigates.

        Returns the truth, and the `Sight` of every photodiode as each fan sweeps, (C, K, 2).
        """
        if self.faults is not None:
            self.faults.begin(frame)
        truth = self.dynamics.advance(frame, self.faults)
        return truth, self._sight(truth)

    def _sight(self, truth: PeriodTruth) -> NDArray[np.int8]:
        """The `Sight` of every photodiode as each fan sweeps, (C, K, 2): taken at the knots in mid-sweep."""
        steps = len(truth.time_s) - 1
        out = np.empty((*self.visibility.shape, 2), dtype=np.int8)
        for fan, k in enumerate((steps // 4, 3 * steps // 4)):
            out[..., fan] = self.visibility.state(truth.position[k], truth.quaternion[k])
        return out

    def _measure(self, truth: PeriodTruth, frame: int, lit: Bools) -> SweepAngles:
        """What every craft's decoder makes of this period's light, (C, K, 2), and of what is wrong with it."""
        faults = self.faults
        if faults is None:
            return self.decoder.decode(self.lighthouse.sweep(truth, frame, lit))
        lit, off = faults.light(lit), faults.restarting()
        pulses = faults.pulses(truth, lit, self.lighthouse.sweep(truth, frame, lit, faults.rotor()))
        if off.any():
            self.decoder.forget(off)
            self.navigator.forget(off)
        angles = self.decoder.decode(pulses)
        return angles._replace(lit=angles.lit & ~off[:, None])

    def _extra(self, estimate: Estimate) -> Floats:
        """The values of the scene's extra columns, (C, N), in their order."""
        states = [] if self.faults is None else [self.faults.states()[:, None]]
        own = integrity_columns.values(estimate.integrity)
        return np.concatenate([own, self.dynamics.actuators.work(), self.dynamics.guided.values, *states], axis=1)


def _at_epoch(truth: PeriodTruth) -> Truth:
    """The truth at the period's epoch, its middle."""
    k = len(truth.time_s) // 2
    return Truth(truth.position[k], truth.quaternion[k], truth.velocity[k], truth.angular_rate[k], truth.contact)
