"""Fly a scenario: one short loop over lighthouse periods.

    world (MuJoCo's truth over one period) -> visibility -> the lighthouse's pulses -> every craft's own navigation
    -> its control -> forces back to the world; beside it, telemetry and the recording.

Nothing but pulses passes from the lighthouse to a craft; `feedback = "truth"` steers by the true state instead of the
craft's own, but never navigates by it.
"""

from collections.abc import Callable
from pathlib import Path
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from estimators.arrays import Bools, Floats
from estimators.rotation import matrix_from_quaternion
from swarm import build
from swarm.actuation.actuators import Drive
from swarm.actuation.execution import ActuatorFaults
from swarm.assets import find_model
from swarm.guided_flight import GuidedFlight
from swarm.onboard import control
from swarm.onboard.control import Command, State
from swarm.onboard.decoder import SweepAngles
from swarm.onboard.inspection import LidarFix
from swarm.onboard.navigation import Estimate, Navigator
from swarm.results import integrity_columns
from swarm.results.angles import believed
from swarm.results.progress import Progress
from swarm.results.recorder import CcdScene, Scene
from swarm.results.run_folder import Run
from swarm.results.run_writer import writing_run
from swarm.results.telemetry import Truth
from swarm.scenario import Scenario, craft
from swarm.sensors.ccd import Ccd
from swarm.sensors.lighthouse import Lighthouse
from swarm.sensors.visibility import Sight, Visibility
from swarm.world.craft import visuals
from swarm.world.world import PeriodTruth


class Observer(Protocol):
    """Watches a flight from outside, for instance to time its computers; it changes nothing."""

    def begin(self, flight: "Flight") -> None:
        """See the flight before its first period."""

    def period(self, frame: int, truth: Truth, estimate: Estimate) -> None:
        """See one period at its epoch."""


def simulate(
    scenario: Scenario,
    *,
    out: str | Path | None = None,
    force: bool = False,
    live: bool = False,
    record: bool = True,
    progress: Callable[[Progress], None] | None = None,
    observer: Observer | None = None,
) -> Run:
    """Fly `scenario` and write the run to `out` (default `runs/<scenario>-<seed>`); the run, opened.

    force: replace a run that is there. live: open the viewer. record: write recording.rrd. progress: told now and then.
    observer: sees the flight and every period.
    Raises SwarmError: a scenario that cannot fly, a folder that cannot be written; KeyboardInterrupt closes the run,
    marks it as interrupted, and is raised again.
    """
    flight = Flight(scenario)
    if observer is not None:
        observer.begin(flight)
    duration_s, record = scenario.duration_s, record and scenario.recording.enabled
    angles = flight.believed if scenario.recording.angles else None
    with writing_run(
        scenario, out, flight.scene, force=force, duration_s=duration_s, record=record, live=live, angles=angles
    ) as writer:
        for frame in range(max(1, round(duration_s / flight.period_s))):
            time_s, truth, sight, estimate = flight.period(frame)
            writer.append(
                frame, time_s, truth, sight, estimate, angles=flight.angles, scans=flight.scans, extra=flight.extra
            )
            if observer is not None:
                observer.period(frame, truth, estimate)
            if progress is not None:
                progress(writer.progress)
    return writer.run


class Flight:
    """The world, the lighthouse and every craft's computer, period by period."""

    def __init__(self, scenario: Scenario) -> None:
        """Build everything. Raises SwarmError where the scenario cannot fly."""
        settings = build.lighthouse(scenario)
        self.motions = build.fleet(scenario)
        self.world = build.world(scenario, self.motions)
        layout = build.photodiodes(scenario, self.world)
        self.visibility = Visibility(
            self.world.model, layout, self.world.craft_bodies, self.world.lighthouse_body, settings
        )
        self.lighthouse = Lighthouse(layout, settings, scenario.seed, build.craft_keys(scenario))
        cameras = build.cameras(scenario, self.world, self.motions.at(0.0))
        pairs = [true for true, _ in cameras]
        self.ccd = Ccd(pairs, self.visibility, scenario.seed, scenario.duration_s) if cameras else None
        self.lidars = build.lidars(scenario, self.world)
        self.inspection = build.inspection(scenario, self.lidars)
        self.scans: list[LidarFix] = []
        """What became of the LiDARs' scans that the last period completed."""
        self.pushes = build.pushes(scenario)
        self.faults = build.faults(scenario, self.world, self.lighthouse, self.visibility)
        self.orbit = build.orbit(scenario)
        self.actuators = build.actuators(scenario, self.world)
        self.decoder = build.decoder(scenario, layout.present)
        navigation, own_layout = build.navigation(scenario), build.believed_layout(scenario, self.world.photodiodes)
        own_layout = own_layout._replace(present=layout.present)
        self.navigator = Navigator(own_layout, navigation, [known for _, known in cameras])
        fans, noise = (navigation.fan_x, navigation.fan_y), build.angle_noise(scenario)
        self.believed = believed(self.world.names, own_layout, fans, noise)
        self.angles: SweepAngles | None = None
        """What every craft's decoder made of the last period."""
        fault = [] if self.faults is None else [integrity_columns.fault_column(self.faults.schedule.names)]
        limits = scenario.navigation.integrity
        watched = bool(fault) or limits.alert_position_mm is not None or limits.alert_attitude_deg is not None
        self.extra: Floats | None = None
        """The last period's values of the telemetry's extra columns, (C, N)."""
        self.steers_by_estimate = np.array([craft.feedback == "estimate" for craft in craft(scenario)])
        self.period_s = 1 / settings.rate_hz
        self.guided = GuidedFlight(scenario, self.motions, self.world, self.steers_by_estimate)
        self.scene = Scene(
            craft=self.world.names,
            visuals=[self.world.visuals(i) for i in range(layout.craft_count)],
            photodiodes=layout,
            lighthouse=visuals(find_model(scenario.lighthouse.model)),
            field_deg=scenario.lighthouse.field_deg,
            detail=scenario.recording.detail,
            ccd=[
                CcdScene(
                    pair.craft,
                    pair.target,
                    pair.cameras.position_m,
                    pair.cameras.rotation,
                    pair.lights.point_m,
                    pair.field_rad,
                )
                for pair in pairs
            ],
            lidar=[(o.craft, o.target) for o in self.inspection.observers] if self.inspection is not None else (),
            extra=[*integrity_columns.columns(watched), *self.actuators.columns, *self.guided.columns, *fault],
        )
        start = build.start(scenario, self.motions)
        self._true = State(matrix_from_quaternion(start.quaternion), start.angular_rate, start.position, start.velocity)
        self._estimated = control.unknown(layout.craft_count)
        self._command = Command(*np.zeros((2, layout.craft_count, 3)))

    def period(self, frame: int) -> tuple[float, Truth, NDArray[np.int8], Estimate]:
        """Fly one lighthouse period.

        Returns its epoch [s], the truth at the epoch, the `Sight` of every photodiode (C, K), what each craft knows.
        """
        truth, sight = self.move(frame)
        self.angles = self._measure(truth, frame, sight == Sight.LIT)
        images = self.ccd.expose(truth, frame) if self.ccd is not None else None
        estimate = self.navigator.step(self.angles, images, self._command)
        epoch = len(truth.time_s) // 2
        if self.inspection is not None:
            found = [scan for lidar in self.lidars for scan in lidar.sweep(truth)]
            self.scans = self.inspection.step(found, estimate, float(truth.time_s[epoch]))
            estimate = self.inspection.into(estimate)

        if self.steers_by_estimate.any():
            # The estimate is of the epoch; the next wrench begins half a period later.
            self._estimated = State(
                estimate.rotation, estimate.angular_rate, estimate.position, estimate.velocity
            ).ahead(self.period_s / 2)
        states = [] if self.faults is None else [self.faults.states()[:, None]]
        own = integrity_columns.values(estimate.integrity)
        self.guided.learn(truth, estimate)
        self.extra = np.concatenate([own, self.actuators.work(), self.guided.values, *states], axis=1)
        epoch = len(truth.time_s) // 2
        at_epoch = Truth(
            truth.position[epoch],
            truth.quaternion[epoch],
            truth.velocity[epoch],
            truth.angular_rate[epoch],
            truth.contact,
        )
        return float(truth.time_s[epoch]), at_epoch, np.minimum(sight[..., 0], sight[..., 1]), estimate

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

    def move(self, frame: int) -> tuple[PeriodTruth, NDArray[np.int8]]:
        """Move every craft through one lighthouse period, and no more: nobody measures, nobody navigates.

        Returns the truth, and the `Sight` of every photodiode as each fan sweeps, (C, K, 2).
        """
        if self.faults is not None:
            self.faults.begin(frame)
        drive = self._wrench(frame)
        self._command = drive.command
        truth = self.world.advance(drive.force, drive.torque, drive.onboard)
        last = -1
        self._true = State(
            matrix_from_quaternion(truth.quaternion[last]),
            truth.angular_rate[last],
            truth.position[last],
            truth.velocity[last],
        )
        return truth, self._sight(truth)

    def _sight(self, truth: PeriodTruth) -> NDArray[np.int8]:
        """The `Sight` of every photodiode as each fan sweeps, (C, K, 2): taken at the knots in mid-sweep."""
        steps = len(truth.time_s) - 1
        out = np.empty((*self.visibility.shape, 2), dtype=np.int8)
        for fan, k in enumerate((steps // 4, 3 * steps // 4)):
            out[..., fan] = self.visibility.state(truth.position[k], truth.quaternion[k])
        return out

    def _stuck(self) -> ActuatorFaults | None:
        """The thrusters that do not obey."""
        stuck = [] if self.faults is None else self.faults.thrusters()
        if not stuck:
            return None
        open_, shut = np.zeros((2, len(self.world.names), self.actuators.most_thrusters), dtype=np.bool_)
        for who, thruster, on in stuck:
            (open_ if on else shut)[who, thruster] = True
        return ActuatorFaults(open_, shut)

    def _wrench(self, frame: int) -> Drive:
        """What moves every craft in period `frame`: its control, through its actuators, and what pushes it at random.

        With the command that its navigation knows: none of a craft that is steered by the truth, which must not reach
        its filter that way.
        """
        believed = self._true
        if self.steers_by_estimate.any():
            believed = self._true.where(~self.steers_by_estimate, self._estimated)
        if self.faults is not None:
            idle = self.faults.out_of_control() | self.faults.restarting()
            believed = believed.where(~idle, control.unknown(len(idle)))
        reference = self.guided.steer(frame * self.period_s, believed)
        command = self.guided.command(reference, believed, self.orbit)
        wanted = control.wrench(command, reference, believed, self.world.mass, self.world.inertia)
        force, torque, onboard, command = self.actuators.drive(*wanted, believed, command, self._stuck())
        if self.pushes.pushed.any():
            more = self.world.inertial_wrench(*self.pushes.at(frame))
            # What the spin asks for anyway is in the control's own wrench already.
            still = np.zeros_like(force)
            spin = self.world.inertial_wrench(still, still)
            force, torque = force + more[0] - spin[0], torque + more[1] - spin[1]
        kick = None if self.faults is None else self.faults.kick()
        if kick is not None:
            kicked = np.any(np.concatenate(kick, axis=1) != 0, axis=1)
            more = self.world.inertial_wrench(*(change / self.period_s for change in kick))
            force[kicked], torque[kicked] = more[0][kicked], more[1][kicked]
        pushed = self.motions.pushed
        if pushed.any():
            pushed_force, pushed_torque = self.world.inertial_wrench(*self.motions.disturbance(frame))
            force[pushed], torque[pushed] = pushed_force[pushed], pushed_torque[pushed]
        return Drive(force, torque, onboard, command.only(self.steers_by_estimate))
