"""Steering of every craft: its reference, the wrench towards it, and the orders to its actuators.

    guidance, by estimates and broadcasts -> reference -> control -> wrench -> orders to thrusters and wheels

A craft steers by its own estimate, or, if the scenario says so, by the true state; its navigation never uses the true
state.
"""

from typing import NamedTuple, Protocol

import numpy as np

from estimators.arrays import Bools, Floats
from estimators.relative.pose import seen_from
from estimators.relative_orbit import RelativeOrbit
from estimators.state import STATES, Reference, State, Steered, unknown
from swarm.messages import Command, Order
from swarm.onboard import control
from swarm.onboard.actuation.actuation import Actuation
from swarm.onboard.guidance.guidance import Guidance, Knowledge
from swarm.onboard.guidance.neighbours import Neighbour
from swarm.onboard.navigation import Estimate
from swarm.onboard.own_controllers import NO_CONTROLLERS, Controllers, Steering
from swarm.onboard.settings import by_light


class Motions(Protocol):
    """The reference motions of C craft."""

    def at(self, time_s: float, steered: Steered | None = None) -> Reference:
        """Return the references at `time_s` [s]; `steered` replaces those of the craft that guidance steers."""


class Body(NamedTuple):
    """Mass properties of C craft as the craft know them: mass (C,) [kg] and inertia (C, 3, 3) [kg m^2], body frame."""

    mass: Floats
    inertia: Floats


class Pilot:
    """Guidance, control and actuator computers of C craft.

    guidance: guidance of the guided craft; None without any. by_estimate: craft that steer by their own estimate, (C,).
    """

    def __init__(
        self,
        motions: Motions,
        guidance: Guidance | None,
        actuation: Actuation,
        body: Body,
        by_estimate: Bools,
        period_s: float,
        orbit: RelativeOrbit | None = None,
        controllers: Controllers = NO_CONTROLLERS,
    ) -> None:
        """Start with craft whose own states are unknown.

        Args:
            motions: reference motions of the craft.
            guidance: guidance of the guided craft; None without any.
            actuation: computers of the craft's thrusters and wheels.
            body: mass and inertia of every craft.
            by_estimate: craft that steer by their own estimate, (C,); the others steer by the true state.
            period_s: length of a lighthouse period [s].
            orbit: the lighthouse's orbit; None in weightless space.
            controllers: controllers of the user, in the place of the feedback of some craft.
        """
        self._controllers, self._covariance = controllers, np.full((len(by_estimate), STATES, STATES), np.nan)
        self.guidance, self.by_estimate = guidance, by_estimate
        self._motions, self._actuation, self._body, self._orbit = motions, actuation, body, orbit
        self._period_s, self._craft = period_s, len(by_estimate)
        self._firm = control.feedback(self._craft) if guidance is None else guidance.feedback
        self._estimated = unknown(self._craft)
        nothing = np.zeros(self._craft)
        self._known = Knowledge(nothing > 0, nothing, nothing > 0)
        self._pairs: list[tuple[int, int]] = []
        self._neighbours: dict[tuple[int, int], Neighbour] = {}
        self._reference = motions.at(0.0)

    def steer(self, time_s: float, told: State, idle: Bools) -> Order:
        """Return the orders of every craft for the period that begins.

        Args:
            time_s: beginning of the period [s].
            told: true states, for the craft that steer by them.
            idle: craft whose control does nothing, (C,).
        """
        believed = self._believed(told, idle)
        steered = None if self.guidance is None else self.guidance.steer(time_s, believed, self._told(told))
        reference = self._reference = self._motions.at(time_s, steered)
        command = self._command(reference, believed)
        wrench = control.wrench(command, reference, believed, self._body.mass, self._body.inertia)
        steering = self._controllers.steer(time_s, believed, self._covariance, reference, Steering(command, *wrench))
        return self._actuation.order(steering.force, steering.torque, believed, steering.command)

    def learn(self, estimate: Estimate, latched: Bools) -> None:
        """Take in the results of the period that has ended; `latched` (C,) is the state of the ports' switches."""
        if self.by_estimate.any():
            # The estimate is of the epoch; the next order begins half a period later.
            self._estimated = estimate.state.ahead(self._period_s / 2)
            self._covariance = estimate.covariance
        if self.guidance is not None:
            sigma = np.sqrt(np.trace(estimate.covariance[:, 6:9, 6:9], axis1=1, axis2=2))
            tracking = by_light(estimate.status) & ~estimate.integrity.alert
            self._meet(estimate)
            self._known = Knowledge(
                np.where(self.by_estimate, tracking, True),
                np.where(self.by_estimate, sigma, 0.0),
                latched,
                self._neighbours,
            )

    def _meet(self, estimate: Estimate) -> None:
        """Take in where other craft are; those that are not heard of are carried on."""
        found = estimate.relative
        if found is None:
            return
        self._pairs = list(zip(found.craft.tolist(), found.to.tolist(), strict=True))
        for n, pair in enumerate(self._pairs):
            if np.isfinite(found.position[n]).all():
                state = seen_from(estimate.state.of(pair[0]), found.state.of(n)).ahead(self._period_s / 2)
                sigma = float(np.sqrt(np.trace(found.covariance[n, 6:9, 6:9])))
                self._neighbours[pair] = Neighbour(state, sigma, not found.alert[n])
            elif pair in self._neighbours:
                self._neighbours[pair] = self._neighbours[pair].ahead(self._period_s)

    def _told(self, told: State) -> Knowledge:
        """Return the inputs of guidance; who steers by the true state has that of other craft too."""
        by_truth = (pair for pair in self._pairs if not self.by_estimate[pair[0]])
        exact = {pair: Neighbour(told.of(pair[1]), 0.0, good=True) for pair in by_truth}
        return self._known._replace(neighbours={**self._known.neighbours, **exact}) if exact else self._known

    def reference_m(self) -> Floats:
        """Return the reference position of every craft at the epoch of the period that was steered last, (C, 3) [m]."""
        wanted, half = self._reference, self._period_s / 2
        return wanted.position + wanted.velocity * half + wanted.acceleration * half**2 / 2

    def _believed(self, told: State, idle: Bools) -> State:
        """Return the states by which the craft steer; NaN for a craft that is idle or does not know its state."""
        believed = told.where(~self.by_estimate, self._estimated) if self.by_estimate.any() else told
        return believed.where(~idle, unknown(self._craft)) if idle.any() else believed

    def _command(self, reference: Reference, believed: State) -> Command:
        """Return the feedback towards the reference, kept clear of other craft and less the gravitational part."""
        if self.guidance is None:
            return control.command(reference, believed, self._firm, self._orbit)
        wanted = control.command(reference, believed, self._firm)
        clear = self.guidance.clear(wanted, believed)
        if self._orbit is None:
            return clear
        return control.without_gravity(clear, reference.holds_position, believed, self._orbit)
