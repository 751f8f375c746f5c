"""A PettingZoo environment (`ParallelEnv`): every craft is an agent, and knows only what its own computer knows.

A step is one lighthouse period: the craft move under the agents' wrenches, light is measured, every craft navigates.
World, light, faults and filters are those of the scenario; nothing of the truth reaches an observation.

Action, (6,) in -1..1: force and torque in the body frame, as shares of `force_n` and `torque_nm`. A craft with
thrusters or wheels gives what these can. A craft that does not know its attitude orders nothing.

Observation, a row of numbers per craft (`NAMES` says which), zero where nothing is known:

    known            1 where the filter has an estimate
    status           one-hot codes of `Status`
    estimate         position [m], first two columns of the attitude R, velocity [m/s], angular rate [rad/s]
    sigma            standard deviations of attitude, angular rate, position and velocity
    dilution         ADOP [rad/rad] and PDOP [m/rad] over `DILUTION`
    goal             reference position and velocity of the scenario's motion, less the estimate
    neighbours       of the nearest craft by their broadcasts, one period old: known, position and velocity less the own

Reward: minus the distance [m] between estimate and reference, minus `EFFORT` times the mean square of the action. An
agent ends (termination) when its craft touches something; all end (truncation) with the scenario's duration.
"""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray
from pettingzoo import ParallelEnv
from scipy.spatial import cKDTree

from estimators.arrays import Bools, Floats
from swarm.environments.remote_pilot import RemotePilot
from swarm.errors import SwarmError
from swarm.flight.flight import Flight
from swarm.onboard.guidance.broadcast import Broadcasts
from swarm.onboard.settings import Status
from swarm.results.period import Period
from swarm.scenario import Scenario, checked, load
from swarm.scenario.load import Overrides

EFFORT = 0.01
USUAL_NEIGHBOURS = 3
DILUTION = np.array([3000.0, 50.0])
"""Usual ADOP [deg/rad] and PDOP [m/rad], by which they are divided."""
STATUS = [status.name.lower() for status in Status]
AXES = "xyz"
OWN = (
    "known",
    *(f"status_{name}" for name in STATUS),
    *(f"position_{axis}" for axis in AXES),
    *(f"attitude_{column}{axis}" for column in "xy" for axis in AXES),
    *(f"velocity_{axis}" for axis in AXES),
    *(f"rate_{axis}" for axis in AXES),
    *(f"sigma_{what}_{axis}" for what in ("attitude", "rate", "position", "velocity") for axis in AXES),
    "adop",
    "pdop",
    *(f"goal_{what}_{axis}" for what in ("position", "velocity") for axis in AXES),
)
OF_NEIGHBOUR = ("known", *(f"{what}_{axis}" for what in ("position", "velocity") for axis in AXES))
Rows = NDArray[np.float32]


class SwarmEnv(ParallelEnv[str, Rows, Rows]):
    """A scenario as a parallel environment. names: what each number of an observation is."""

    metadata: ClassVar[dict[str, Any]] = {"name": "lighthouse_swarm_v0", "render_modes": []}
    render_mode = None

    def __init__(
        self,
        scenario: str | Path | Scenario = "formation",
        overrides: Overrides = (),
        *,
        neighbours: int | None = None,
        force_n: float = 0.05,
        torque_nm: float = 0.002,
    ) -> None:
        """Take a scenario; its worlds are built by `reset`.

        Args:
            scenario: its name, its file, or loaded.
            overrides: changed values, as in `swarm.load`; only with a name or a file.
            neighbours: number of other craft in an observation; None: three, or as many as there are.
            force_n: force of a full action [N].
            torque_nm: torque of a full action [N m].

        Raises:
            SwarmError: the scenario cannot fly, or a value is out of its range.
        """
        self.scenario = checked(scenario) if isinstance(scenario, Scenario) else load(scenario, overrides)
        if any(table.controller is not None for _, table in self.scenario.tables):
            raise SwarmError("controller: an agent steers every craft here: leave the scenario's own controllers out")
        count = len(self.scenario.craft_names)
        others = max(count - 1, 0)
        if neighbours is None:
            neighbours = min(USUAL_NEIGHBOURS, others)
        if not 0 <= neighbours <= others:
            raise SwarmError(f"neighbours: {neighbours} must be from 0 to {others}, the other craft")
        if not (force_n > 0 and torque_nm > 0):
            raise SwarmError(f"force_n and torque_nm must be above 0, not {force_n} and {torque_nm}")
        self.possible_agents = list(self.scenario.craft_names)
        self.agents: list[str] = []
        self.names = (*OWN, *(f"neighbour{i}_{name}" for i in range(neighbours) for name in OF_NEIGHBOUR))
        self._neighbours, self._full = neighbours, np.repeat([force_n, torque_nm], 3)
        self._observation = spaces.Box(-np.inf, np.inf, (len(self.names),), np.float32)
        self._action = spaces.Box(-1.0, 1.0, (6,), np.float32)
        self.observation_spaces = dict.fromkeys(self.possible_agents, self._observation)
        self.action_spaces = dict.fromkeys(self.possible_agents, self._action)
        self._index = {name: i for i, name in enumerate(self.possible_agents)}
        self._flight: Flight | None = None

    def observation_space(self, agent: str) -> spaces.Space[Any]:
        """Return the space of an agent's observations, which all share."""
        return self.observation_spaces[agent]

    def action_space(self, agent: str) -> spaces.Space[Any]:
        """Return the space of an agent's actions, which all share."""
        return self.action_spaces[agent]

    def reset(
        self, seed: int | None = None, options: Mapping[str, Any] | None = None
    ) -> tuple[dict[str, Rows], dict[str, dict[str, Any]]]:
        """Begin anew, with the first period flown without an action; the same seed gives the same bits.

        Args:
            seed: seed of all random draws; None: the scenario's, then the next ones.
            options: not used.
        """
        if seed is not None:
            self._seed = int(seed)
        else:
            self._seed = self.scenario.seed if self._flight is None else self._seed + 1
        self._flight = Flight(self.scenario.model_copy(update={"seed": self._seed}), pilot=RemotePilot)
        assert isinstance(self._flight.pilot, RemotePilot)
        self._pilot = self._flight.pilot
        self._told = Broadcasts(len(self.possible_agents), self._flight.period_s)
        self.agents = list(self.possible_agents)
        self._frame = 0
        rows = self._observed(self._flown())
        return dict(zip(self.agents, rows, strict=True)), {name: {} for name in self.agents}

    def step(
        self, actions: Mapping[str, Rows]
    ) -> tuple[dict[str, Rows], dict[str, float], dict[str, bool], dict[str, bool], dict[str, dict[str, Any]]]:
        """Fly one lighthouse period; an agent without an action, or that has ended, does nothing.

        Args:
            actions: an action per agent, (6,).

        Returns:
            Observations, rewards, terminations, truncations and infos by agent.
        """
        if self._flight is None:
            raise SwarmError("reset begins an episode, before its first step")
        whole = np.zeros((len(self.possible_agents), 6))
        present = [name for name in self.agents if name in actions]
        if present:
            given = np.stack([actions[name] for name in present]).astype(np.float64)
            whole[[self._index[name] for name in present]] = np.clip(np.nan_to_num(given), -1.0, 1.0)
        wrench = whole * self._full
        self._pilot.force, self._pilot.torque = wrench[:, :3].copy(), wrench[:, 3:].copy()
        period = self._flown()
        rows = self._observed(period)
        first = OWN.index("goal_position_x")
        reward = -np.linalg.norm(rows[:, first : first + 3], axis=1) - EFFORT * np.mean(whole**2, axis=1)
        assert period.truth is not None
        contact, over = period.truth.contact, self._frame >= self._flight.periods
        index = [self._index[name] for name in self.agents]
        told = dict(zip(self.agents, rows[index], strict=True))
        rewards = dict(zip(self.agents, reward[index].tolist(), strict=True))
        ended = dict(zip(self.agents, contact[index].tolist(), strict=True))
        truncated = dict.fromkeys(self.agents, over)
        infos: dict[str, dict[str, Any]] = {name: {} for name in self.agents}
        self.agents = [] if over else [name for name in self.agents if not ended[name]]
        return told, rewards, ended, truncated, infos

    def render(self) -> None:
        """Draw nothing; `swarm video` draws a run."""

    def close(self) -> None:
        """Give the memory back."""
        self._flight, self.agents = None, []

    def _flown(self) -> Period:
        assert self._flight is not None
        period = self._flight.period(self._frame)
        self._frame += 1
        return period

    def _observed(self, period: Period) -> Rows:
        """Return the observations of all craft, (C, numbers)."""
        estimate = period.estimate
        state, count = estimate.state, len(self.possible_agents)
        known: Bools = np.isfinite(state.position.sum(axis=1))
        variance = np.diagonal(estimate.covariance, axis1=1, axis2=2)
        dilution = np.stack([estimate.dilution.adop_deg_per_rad, estimate.dilution.pdop_m_per_rad], axis=1)
        goal = self._pilot.reference(period.time_s)
        columns = [
            known[:, None],
            estimate.status[:, None] == np.array([int(status) for status in Status]),
            state.position,
            state.rotation[:, :, 0],
            state.rotation[:, :, 1],
            state.velocity,
            state.angular_rate,
            np.sqrt(np.maximum(variance, 0.0)),
            dilution / DILUTION,
            goal.position - state.position,
            goal.velocity - state.velocity,
        ]
        if self._neighbours:
            columns.append(self._heard(state.position, state.velocity).reshape(count, -1))
        rows = np.concatenate(columns, axis=1)
        out: Rows = np.nan_to_num(rows, nan=0.0, posinf=0.0, neginf=0.0).astype(np.float32)
        return out

    def _heard(self, position: Floats, velocity: Floats) -> Floats:
        """Return the nearest craft by their broadcasts, (C, neighbours, 7), and send the own states."""
        assert self._flight is not None
        heard = self._told.heard()
        self._told.tell(position, velocity, 0.0)
        out = np.zeros((len(position), self._neighbours, 7))
        heard_of, listening = np.flatnonzero(heard.known), np.flatnonzero(np.isfinite(position).all(axis=1))
        if len(heard_of) < 2 or not len(listening):
            return out
        most = min(self._neighbours + 1, len(heard_of))
        _, found = cKDTree(heard.position[heard_of]).query(position[listening], k=most)
        others = heard_of[found]
        own = others == listening[:, None]
        order = np.argsort(own, axis=1, kind="stable")[:, : most - 1]  # the craft itself is the nearest, but for errors
        others = np.take_along_axis(others, order, axis=1)
        out[listening, : most - 1, 0] = 1.0
        out[listening, : most - 1, 1:4] = heard.position[others] - position[listening, None]
        out[listening, : most - 1, 4:] = heard.velocity[others] - velocity[listening, None]
        return out


def parallel_env(
    scenario: str | Path | Scenario = "formation", overrides: Sequence[str] = (), **options: Any
) -> SwarmEnv:
    """Return the environment of a scenario; the usual name of PettingZoo's constructors.

    Args:
        scenario: its name, its file, or loaded.
        overrides: changed values, as in `swarm.load`.
        **options: more of `SwarmEnv`.
    """
    return SwarmEnv(scenario, overrides, **options)
