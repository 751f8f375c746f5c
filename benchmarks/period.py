"""One period of `swarm1000`, taken apart: what every stage is given, once all craft have found themselves."""

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from estimators.arrays import Bools
from swarm.flight.flight import Flight
from swarm.messages import Pulses
from swarm.onboard import lighthouse_fix
from swarm.onboard.computer import Computer
from swarm.onboard.decoder import SweepAngles
from swarm.onboard.navigation import Estimate
from swarm.results.records import Truth
from swarm.scenario import load
from swarm.sensors.sight import Sight
from swarm.world.world import PeriodTruth


class Captured(NamedTuple):
    """motion: of the period. sight, lit (C, K, 2): as each fan sweeps. pulses, angles, estimate: what became of it.

    truth: at the epoch. refine, dilution: the arguments that navigation called the estimators with.
    """

    flight: Flight
    frame: int
    motion: PeriodTruth
    sight: NDArray[np.int8]
    lit: Bools
    pulses: Pulses
    angles: SweepAngles
    estimate: Estimate
    truth: Truth
    refine: tuple[Any, ...]
    dilution: tuple[Any, ...]


def captured(craft: int, *overrides: str, periods: int = 60) -> Captured:
    """The period after `periods` of a flight of `craft` craft."""
    flight = Flight(load("swarm1000", [f"swarm.count={craft}", *overrides]))
    for frame in range(periods):
        flight.period(frame)
    motion, sight = flight.move(periods)
    lit = sight == Sight.LIT
    pulses = flight.sensors.lighthouse.sweep(motion, periods, lit)
    computer = flight.computer
    if not isinstance(computer, Computer):
        raise TypeError("the period is that of one lighthouse")
    angles = computer.decoder.decode(pulses)
    arguments: dict[str, tuple[Any, ...]] = {}
    functions = {name: getattr(lighthouse_fix, name) for name in ("refine", "dilution")}

    def noting(name: str) -> Any:
        def run(*given: Any) -> Any:
            arguments[name] = tuple(np.copy(value) if isinstance(value, np.ndarray) else value for value in given)
            return functions[name](*given)

        return run

    try:
        for name in functions:
            setattr(lighthouse_fix, name, noting(name))
        estimate = computer.navigator.step(angles, None, flight.command)
    finally:
        for name, function in functions.items():
            setattr(lighthouse_fix, name, function)
    epoch = len(motion.time_s) // 2
    truth = Truth(
        motion.position[epoch],
        motion.quaternion[epoch],
        motion.velocity[epoch],
        motion.angular_rate[epoch],
        motion.contact,
    )
    return Captured(
        flight,
        periods,
        motion,
        sight,
        lit,
        pulses,
        angles,
        estimate,
        truth,
        arguments["refine"],
        arguments["dilution"],
    )
