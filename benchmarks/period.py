"""One period of `swarm1000`, taken apart: what every stage is given, once all craft have found themselves."""

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from estimators.arrays import Bools
from estimators.lighthouse.pnp import PoseSolution
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

    truth: at the epoch. refine, dilution: the arguments of the estimators' functions, as navigation has them.
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
    asked: list[tuple[tuple[Any, ...], PoseSolution]] = []
    function = vars(lighthouse_fix)["refine_with_dilution"]

    def noting(*given: Any) -> Any:
        kept = tuple(np.copy(value) if isinstance(value, np.ndarray) else value for value in given)
        result = function(*given)
        asked.append((kept, result[0]))
        return result

    try:
        vars(lighthouse_fix)["refine_with_dilution"] = noting
        estimate = computer.navigator.step(angles, None, flight.command)
    finally:
        vars(lighthouse_fix)["refine_with_dilution"] = function
    (*refine, correlation), solution = asked[-1]
    dilution = solution.rotation, solution.position, refine[1], refine[2], *refine[5:], correlation, solution.solved
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
        tuple(refine),
        dilution,
    )
