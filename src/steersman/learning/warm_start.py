"""Demonstrations before a training, and what the agent learns from them."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from steersman.errors import DataError
from steersman.learning.datasets.source import load
from steersman.learning.datasets.trajectory import transitions
from steersman.learning.demonstration import WarmStart
from steersman.learning.least_squares import Dataset, LeastSquares
from steersman.learning.networks import make_moments, make_work
from steersman.learning.problem import Problem

if TYPE_CHECKING:
    from steersman.learning.off_policy import OffPolicySteering

# Updates in one call of an agent.
_CHUNK = 500


class Opening:
    """The stages of a warm start: recorded data first, then one for each round.

    How many are done is a counter of the agent, ``opened``, and so a part of its checkpoints.

    Sources: Nair et al., Overcoming exploration in reinforcement learning with demonstrations, ICRA
    2018 (demonstrations in the buffer); Hester et al., Deep Q-learning from demonstrations, AAAI
    2018 (updates before driving); Ross, Gordon and Bagnell, AISTATS 2011 (DAgger).
    """

    def __init__(self, settings: WarmStart, problem: Problem, vehicles: int) -> None:
        """``problem`` is whose observations, actions and rewards the data become."""
        self._settings, self._problem = settings, problem
        self.steps = -(-settings.steps // vehicles) * vehicles
        """Environment steps of all rounds, whole steps of all vehicles."""

    def demonstrates(self, steps: int) -> bool:
        """Whether the demonstrator drives all vehicles after so many environment steps."""
        return steps < self.steps / self._settings.rounds

    def due(self, agent: OffPolicySteering) -> bool:
        """Whether a stage is due before the next step of ``agent``."""
        rounds, done = self._settings.rounds, agent.opened
        return done == 0 or (done <= rounds and agent.num_timesteps >= done * self.steps / rounds)

    def advance(self, agent: OffPolicySteering) -> None:
        """Do what is due before the next step of ``agent``.

        Raises:
            DataError: the data cannot be read, or do not fit into the replay buffer.
            ConfigError: they are of another car, control period or sensor.
        """
        settings = self._settings
        if agent.opened == 0:
            self._load(agent)
            agent.opened = 1
        while self.due(agent):
            done = agent.opened
            first, last = ((done - k) * settings.cloning // settings.rounds for k in (1, 0))
            self._clone(agent, last - first)
            agent.opened += 1
            if done == settings.rounds:
                if settings.share > 0.0:
                    agent.buffer.keep(settings.share)
                for k in range(0, settings.updates, _CHUNK):
                    agent.train(min(_CHUNK, settings.updates - k), agent.batch_size)

    def _load(self, agent: OffPolicySteering) -> None:
        names, buffer = self._settings.data, agent.buffer
        if not names:
            return
        drives = load(self._problem, names, self._settings.ahead)
        parts = [transitions(self._problem, one) for one in drives]
        columns = {name: np.concatenate([part[name] for part in parts]) for name in parts[0]}
        count, most = len(columns["rewards"]), buffer.buffer_size * buffer.n_envs - self.steps
        if not buffer.n_envs <= count < most:
            raise DataError(
                f"{', '.join(names)}: holds {count} steps; problem.demonstration.warm_start takes "
                f"from {buffer.n_envs}, one for each vehicle, to {most - 1}, as agent.buffer has "
                f"room for {buffer.buffer_size * buffer.n_envs} with {self.steps} driven ones"
            )
        buffer.extend(columns)

    def _clone(self, agent: OffPolicySteering, updates: int) -> None:
        """Fit the actor to all demonstrated actions in the buffer."""
        buffer, net = agent.buffer, agent.actor_net()
        size = buffer.size()
        known = np.isfinite(buffer.demonstrated[:size]).all(axis=2)
        if updates == 0 or not known.any():
            return
        data = Dataset(buffer.observations[:size][known], buffer.demonstrated[:size][known])
        work, rate = make_work(net, agent.batch_size), agent.current_rate()
        fit = LeastSquares(net, make_moments(net.flat.size), work, agent.mirror, agent.turned)
        fit.to(data, updates, lambda _: rate, agent.demo_rng)
        policy: Any = agent.policy
        if hasattr(policy, "actor_target"):
            policy.actor_target.load_state_dict(policy.actor.state_dict())
