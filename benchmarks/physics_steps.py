"""Errors of the physics steps that every scenario takes, against 64 steps in a period, beside their bounds.

    python benchmarks/physics_steps.py [--scenarios NAME ...] [--steps N] [--seconds 4]

A scenario flies as it is; in every period a second world takes the same wrenches from the same state in 64 steps, and
a third one from every second on without being set back. The largest differences of any craft at the ends of periods
and seconds stand beside the bounds of `swarm.world.step_error`. Left out are periods in which a craft touches another,
or is struck by a fault within one period: a blow has no size that a bound could know.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any
from unittest.mock import patch

import numpy as np
from harness import finish, options

from estimators.arrays import Bools, Floats
from estimators.rotation import angle_between, matrix_from_quaternion
from swarm.assets import scenarios
from swarm.flight import builders
from swarm.flight.flight import Flight
from swarm.messages import Order
from swarm.scenario import Scenario, load
from swarm.world.actuators import Actuators, Drive
from swarm.world.execution import StuckThruster
from swarm.world.pushes import Blow
from swarm.world.world import PeriodTruth, World
from swarm.world.wrench import OnboardWrench

FINE = 64


@dataclass
class Beside:
    """A world of fine steps beside a flight's own.

    onboard: wrench of its actuators in this period. most_m, most_rad: largest differences so far. fair: craft that were
    neither touched nor struck.
    """

    world: World
    actuators: Actuators
    onboard: OnboardWrench | None = None
    most_m: float = 0.0
    most_rad: float = 0.0
    fair: Bools = field(default_factory=lambda: np.zeros(0, dtype=bool))

    def begin(self, own: World) -> None:
        """Take over the state of the flight's world."""
        self.world._pose[:], self.world._rate[:] = own._pose, own._rate
        self.fair = np.ones(len(own.names), dtype=bool)

    def compare(self, own: World) -> None:
        """Compare with the flight's world."""
        apart = np.linalg.norm(self.world._pose[:, :3] - own._pose[:, :3], axis=1)[self.fair]
        turned = angle_between(
            matrix_from_quaternion(self.world._pose[:, 3:]), matrix_from_quaternion(own._pose[:, 3:])
        )[self.fair]
        self.most_m = max(self.most_m, float(apart.max(initial=0.0)))
        self.most_rad = max(self.most_rad, float(turned.max(initial=0.0)))


def beside(scenario: Scenario) -> Beside:
    """Return a world of fine steps for a scenario."""
    world = builders.world(scenario, builders.fleet(scenario), FINE)
    return Beside(world, builders.actuators(scenario, world))


def errors(scenario: Scenario, seconds: float) -> dict[str, Any]:
    """Return the bounds and the largest differences of a scenario."""
    flight, close, free = Flight(scenario), beside(scenario), beside(scenario)
    second = max(1, round(1 / flight.period_s))
    for frame in range(min(flight.periods, max(second, round(seconds / flight.period_s)))):
        if frame % second == 0:
            free.begin(flight.world)
        close.begin(flight.world)
        _advance(flight, frame, (close, free))
        close.compare(flight.world)
        if frame % second == second - 1:
            free.compare(flight.world)
    bounds = flight.steps.errors
    pairs = {
        "period_um": (close.most_m, bounds.period_m, 1e6),
        "period_arcsec": (close.most_rad, bounds.period_rad, np.degrees(3600)),
        "second_mm": (free.most_m, bounds.second_m, 1e3),
        "second_deg": (free.most_rad, bounds.second_rad, np.degrees(1)),
    }
    measured = {name: unit * error for name, (error, _, unit) in pairs.items()}
    bound = {f"bound_{name}": unit * float(most.max()) for name, (_, most, unit) in pairs.items()}
    return {"steps": flight.steps.number, **measured, **bound}


def _advance(flight: Flight, frame: int, others: tuple[Beside, Beside]) -> None:
    """Fly a period, and let the other worlds take the same wrenches."""
    drive, advance, blow = flight.actuators.drive, flight.world.advance, flight.faults.blow
    struck = np.zeros(len(flight.world.names), dtype=np.bool_)

    def driven(order: Order, stuck: Sequence[StuckThruster] = ()) -> Drive:
        for other in others:
            other.onboard = other.actuators.drive(order, stuck).onboard
        return drive(order, stuck)

    def blown() -> Blow | None:
        found = blow()
        if found is not None:
            struck[:] = np.any(np.concatenate([found.velocity, found.angular_rate], axis=1) != 0, axis=1)
        return found

    def advanced(force: Floats, torque: Floats, onboard: OnboardWrench | None = None) -> PeriodTruth:
        truth = advance(force, torque, onboard)
        for other in others:
            touched = other.world.advance(force, torque, other.onboard).contact
            other.fair &= ~(touched | truth.contact | struck)
        return truth

    with (
        patch.object(flight.actuators, "drive", driven),
        patch.object(flight.world, "advance", advanced),
        patch.object(flight.faults, "blow", blown),
    ):
        flight.period(frame)


def row(found: dict[str, Any]) -> str:
    """Return measured figures and bounds as a row of a table."""
    names = "period_um", "period_arcsec", "second_mm", "second_deg"
    return " | ".join(f"{found[name]:.2g} of {found['bound_' + name]:.2g}" for name in names)


def main() -> None:
    """Fly, compare, and print a row as each scenario is done."""
    chosen = options(
        __doc__,
        scenarios=(sorted(scenarios()), "scenarios to fly"),
        steps=(0, "steps in a period; 0: as the scenario does"),
        seconds=(4.0, "simulated time of each"),
    )
    found = {}
    print("| scenario | steps | in a period, um | arcsec | in a second, mm | deg |\n|---|---|---|---|---|---|")
    for name in chosen.scenarios:
        fewer = ["swarm.count=50"] if load(name).swarm.count > 50 else []
        steps = [f"physics.steps_per_period={chosen.steps}"] if chosen.steps else []
        found[name] = errors(load(name, [*fewer, *steps, "recording.enabled=false"]), chosen.seconds)
        print(f"| {name} | {found[name]['steps']} | {row(found[name])} |", flush=True)
    finish("physics_steps", found, chosen.out)


if __name__ == "__main__":
    main()
