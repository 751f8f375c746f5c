"""The processor time of the craft's computers, as a swarm in one batch and as one craft by itself.

`OnboardCost` takes the place of the flight's computers, steps them as they are, and takes the time.
After the flight craft 0 flies once more on a computer of its own, a batch of one that gets its own pulses and nothing
else, as a real craft would. Medians over the periods, without the first ones, in which it searches.
"""

from functools import partial
from time import thread_time
from typing import Any

import numpy as np

from estimators.arrays import Bools, Floats
from swarm.errors import SwarmError
from swarm.flight import builders
from swarm.flight.flight import Flight
from swarm.hardware import Photodiodes
from swarm.messages import Command, Pulses, Signals
from swarm.onboard.computer import Computer, Known
from swarm.onboard.navigation import Navigator
from swarm.scenario import Scenario
from swarm.studies.campaign.processor_time import median_us

WARM_UP = 6
"""Periods at the start that no median counts."""


class OnboardCost(Computer):
    """Times the swarm's computers, and after the flight the computer of craft 0 alone, on the pulses that it got."""

    def __init__(self, scenario: Scenario, flight: Flight) -> None:
        """Stand in the place of the flight's computers."""
        own, layout = flight.computer, flight.world.photodiodes
        if not isinstance(own, Computer):
            raise SwarmError(f"scenario {scenario.name}: the cost on board is measured with the one lighthouse only")
        super().__init__(own.decoder, own.navigator, own.inspection)
        self._craft, self._scenario = layout.craft_count, scenario
        self._inertia = own.navigator.tracks.inertia[:1]
        self._one = Photodiodes(layout.point_m[:1], layout.normal[:1], layout.present[:1])
        self._settings = builders.navigation(scenario, flight.world.steps)
        self._swarm_s: list[float] = []
        self._pulses: list[Pulses] = []
        self._commands: list[Command | None] = []
        self._positions: list[Floats] = []
        flight.computer = self

    def step(self, signals: Signals, command: Command | None = None, off: Bools | None = None) -> Known:
        """Step all computers, and keep what craft 0 got.

        Args:
            signals: Signals of the period.
            command: Commands to the actuators, if there are any.
            off: Craft whose computers are off (C,).
        """
        pulses, few = signals.pulses, int(signals.pulses.total[0])
        self._pulses.append(
            Pulses(
                pulses.photodiode[:1, :few].copy(),
                pulses.rise_tick[:1, :few].copy(),
                pulses.width_tick[:1, :few].copy(),
                pulses.total[:1].copy(),
            )
        )
        self._commands.append(None if command is None else command.of(slice(1)))
        began = thread_time()
        known = super().step(signals, command, off)
        self._swarm_s.append(thread_time() - began)
        self._positions.append(known.estimate.position[0].copy())
        return known

    def metrics(self) -> dict[str, Any]:
        """Fly craft 0 once more on its own pulses, and return the figures."""
        decoder = builders.decoder(self._scenario, self._one.present)
        navigator = Navigator(self._one, self._settings, inertia=self._inertia)
        own_s, apart_m = [], 0.0
        for pulses, command, position in zip(self._pulses, self._commands, self._positions, strict=True):
            began = thread_time()
            expected = partial(navigator.expected_angles, decoder.turn_s)
            estimate = navigator.step(decoder.decode(pulses, expected), None, command)
            own_s.append(thread_time() - began)
            apart = np.linalg.norm(estimate.position[0] - position)
            apart_m = max(apart_m, 0.0 if np.isnan(apart) else float(apart))
        return {
            "onboard_alone_us": median_us(own_s[WARM_UP:]),
            "onboard_swarm_per_craft_us": median_us(self._swarm_s[WARM_UP:], self._craft),
            "onboard_alone_apart_m": apart_m,
        }
