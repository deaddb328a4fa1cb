"""Agents that learn from a replay buffer: which action is executed, and which is stored.

One class stands before every off-policy algorithm of Stable-Baselines3. ``_sample_action`` chooses
the executed and the stored action; ``train`` runs Stable-Baselines3's updates one by one, each with
its own learning rate. docs/decisions/0004-sb3-seam.md
"""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any, cast

import numpy as np
from stable_baselines3.common.noise import ActionNoise
from stable_baselines3.common.off_policy_algorithm import OffPolicyAlgorithm
from stable_baselines3.common.utils import update_learning_rate

from steersman.errors import DataError
from steersman.kernels import observe
from steersman.kernels import vehicle as car
from steersman.kernels import world as kernel
from steersman.learning.demonstration import Demonstration
from steersman.learning.imitation_loss import imitate
from steersman.learning.noise import OrnsteinUhlenbeck
from steersman.learning.replay_buffer import BUFFER_ARRAYS, STEERING, DemonstrationBuffer
from steersman.learning.sb3 import AT_LIMIT, SteeringAgent
from steersman.learning.snapshot import Tree, fill
from steersman.learning.warm_start import Opening

if TYPE_CHECKING:
    from steersman.learning.vec_env import PathFollowingVecEnv

_BUFFER_NUMBERS = ("pos", "full", "kept", "share")


class OffPolicySteering(SteeringAgent, OffPolicyAlgorithm):
    """An off-policy algorithm that learns beside a demonstrator.

    Attributes:
        p_action: gives the present probability of the demonstrator's action.
        mirror: (features,) factor on each feature that mirrors it, float32; None: no mirror images.
        turned: (actions,) factor on each action that mirrors it, float32.
        demonstration: what is done with the demonstrator's actions.
        total: environment steps of the training.
        opening: the warm start; None: none.
        opened: stages of the warm start that are done.
        taken: (vehicles,) where the demonstrator steers since the car was unsafe.
    """

    p_action: Callable[[], float] = staticmethod(lambda: 0.0)
    demonstration = Demonstration(enabled=False)
    total = 1
    mirror: Any = None
    turned: Any = STEERING
    buffer_class = DemonstrationBuffer
    demonstrable = True
    opening: Opening | None = None
    opened = 0
    counters = (*SteeringAgent.counters, "_episode_num", "demonstrated_steps", "opened")
    _turn = (0, 1)
    critic: Any
    _values: Any = None

    def prepare_demonstration(
        self, demonstration: Demonstration, opening: Opening | None, total: int, seed: int
    ) -> None:
        """Set what the demonstrator does; to be called before learning."""
        self.demonstration, self.opening, self.total = demonstration, opening, total
        if demonstration.enabled:
            self.p_action = lambda: demonstration.p_action.value(self.num_timesteps, total)
        self.demo_rng = np.random.default_rng(seed)
        self.taken = np.zeros(self.n_envs, dtype=bool)

    @property
    def buffer(self) -> DemonstrationBuffer:
        """The replay buffer."""
        return cast(DemonstrationBuffer, self.replay_buffer)

    def opens(self) -> bool:
        """Whether a stage of the warm start is due before the next step."""
        return self.opening is not None and self.opening.due(self)

    def open(self) -> None:
        """Do what the warm start has due."""
        if self.opening is not None:
            self.opening.advance(self)

    def _sample_action(
        self, learning_starts: int, action_noise: ActionNoise | None = None, n_envs: int = 1
    ) -> tuple[Any, Any]:
        """Executed and stored actions (n_envs, m), the agent's or the demonstrator's."""
        shows = False
        if self.opening is not None:
            self.open()
            shows, learning_starts = self.opening.demonstrates(self.num_timesteps), 0
        own = self._own_action(learning_starts, action_noise, n_envs)
        self.sampled_steps += n_envs
        env, given = cast("PathFollowingVecEnv", self.env), self.demonstration
        shown = np.full(own.shape, np.nan)
        if given.enabled:
            shown = self.allowed(env.demonstrated_actions())
        takes = (self._takes(env, abs(shown - own).max(1)) | shows) & np.isfinite(shown).all(axis=1)
        env.choice = own, takes
        everywhere = given.loss is None or given.loss.states == "all"
        opens = self.opening is not None and self.num_timesteps < self.opening.steps
        told = takes | (everywhere or opens)
        self.buffer.label = np.where(told[:, None], shown, np.nan)
        if not takes.any():
            return own, own
        executed = own.copy()
        executed[takes] = shown[takes]
        if shows:
            assert given.warm_start is not None
            noise = given.warm_start.noise * self.demo_rng.standard_normal(own.shape)
            executed = np.clip(executed + noise, -1.0, 1.0).astype(np.float32)
        self.demonstrated_steps += int(takes.sum())
        return executed, own if given.store == "agent" and not shows else executed

    def allowed(self, actions: Any) -> Any:
        """What of actions (n, m) in [-1, 1] this agent can execute and store."""
        return actions

    def _takes(self, env: PathFollowingVecEnv, gap: Any) -> Any:
        """Where the demonstrator acts, (n,): by chance, or since the car is unsafe."""
        takes = self.demo_rng.random(len(gap)) < self.p_action()
        if self.demonstration.takeover is not None:
            fleet = env.driver.fleet
            slip = np.arctan2(fleet.state[:, car.VY], fleet.state[:, car.VX])
            self.taken &= fleet.clock[:, kernel.CLOCK_STEPS] > 0.0
            lateral = fleet.tracking[:, observe.D]
            self.taken = self.demonstration.takeover.judged(self.taken, lateral, slip, gap)
            takes |= self.taken
        return takes

    def _own_action(
        self, learning_starts: int, action_noise: ActionNoise | None, n_envs: int
    ) -> Any:
        """The agent's action with exploration, (n_envs, m); random before learning.

        As SB3's; a deterministic policy's without the detour through torch at every step.
        """
        if self.num_timesteps >= learning_starts:
            mean = self.act(self._last_obs)
            # Before the noise, which takes every other action off the limit again.
            self.saturated_steps += int((np.abs(mean) >= AT_LIMIT).any(axis=1).sum())
            if action_noise is not None:
                return np.clip(mean + action_noise(), -1.0, 1.0).astype(np.float32)
        return super()._sample_action(learning_starts, action_noise, n_envs)[1]

    def step_at(self, k: int, gradient_steps: int) -> float:
        """Environment steps at update ``k``; updates are spread evenly over those collected."""
        since = self.n_envs * (1.0 - (k + 1) / gradient_steps)
        return max(self.num_timesteps - since, 0.0)

    def rate_at(self, k: int, gradient_steps: int) -> float:
        """Learning rate of update ``k``."""
        return self._rate(self.step_at(k, gradient_steps))

    def loss_weight_at(self, k: int, gradient_steps: int) -> float:
        """Weight of the imitation loss in update ``k``."""
        loss = self.demonstration.loss
        return (
            0.0 if loss is None else loss.weight.value(self.step_at(k, gradient_steps), self.total)
        )

    def _update_learning_rate(self, optimizers: Any) -> None:
        """SB3 calls this once before each update."""
        rate = self.rate_at(*self._turn)
        for optimiser in optimizers if isinstance(optimizers, list) else [optimizers]:
            update_learning_rate(optimiser, rate)

    def train(self, gradient_steps: int, batch_size: int = 100) -> None:
        """SB3's updates, one by one."""
        if self._values is None:
            self.critic.register_forward_hook(self._watch)
            if self.demonstration.loss is not None:
                cast(Any, self.policy.actor).optimizer.register_step_pre_hook(self._imitate)
        for k in range(gradient_steps):
            self._turn = k, gradient_steps
            super().train(1, batch_size)
        self.last_losses = self._losses(self.logger.name_to_value)

    def _losses(self, said: dict[str, Any]) -> tuple[float, float, float]:
        """Actor's loss, critic's loss and mean value, of what SB3 logged at the last update."""
        before = self.last_losses
        return (
            # Between two updates of TD3's actor the last loss stands.
            float(said.get("train/actor_loss", before[0])),
            float(said.get("train/critic_loss", before[1])),
            float(self._values.mean()),
        )

    def _watch(self, module: Any, given: Any, values: Any) -> None:
        """Keep the first critic's values of the last batch."""
        self._values = values[0].detach()

    def _imitate(self, *_: Any) -> None:
        """Add the imitation loss to the gradient of the actor's own loss, before its step."""
        loss = self.demonstration.loss
        assert loss is not None
        weight = self.loss_weight_at(*self._turn)
        imitate(self.policy, self.critic, self.buffer.last, weight, q_filter=loss.q_filter)

    def _stored(self, size: int) -> dict[str, Any]:
        """The filled part of the replay buffer."""
        return {name: getattr(self.buffer, name)[:size] for name in BUFFER_ARRAYS}

    def _generators(self) -> dict[str, Any]:
        """Generators of noise, of the demonstrator's turns and of random actions."""
        out = {
            "demonstrator": self.demo_rng.bit_generator,
            "actions": self.action_space.np_random.bit_generator,
        }
        if self.action_noise is not None:
            out["noise"] = cast(OrnsteinUhlenbeck, self.action_noise).rng.bit_generator
        return out

    def snapshot(self) -> dict[str, Any]:
        """All that changes from step to step, the environment apart; taken between two steps."""
        buffer, noise = self.buffer, cast(OrnsteinUhlenbeck | None, self.action_noise)
        size = buffer.size()
        return {
            **super().snapshot(),
            "buffer": {name: getattr(buffer, name) for name in _BUFFER_NUMBERS}
            | {"size": size, **self._stored(size)},
            "taken": self.taken,
            "noise": None if noise is None else noise.state,
            "generators": {name: bits.state for name, bits in self._generators().items()},
        }

    def restore(self, saved: Tree) -> None:
        """Go on from a snapshot.

        Raises:
            DataError: it is of another network or of a larger buffer.
        """
        buffer, kept = self.buffer, saved["buffer"]
        if not 0 <= kept["size"] <= buffer.buffer_size:
            raise DataError(f"the replay buffer holds {buffer.buffer_size} rows")
        super().restore(saved)
        fill(self._stored(kept["size"]), kept)
        for name in _BUFFER_NUMBERS:
            setattr(buffer, name, kept[name])
        self.taken = saved["taken"]
        if self.action_noise is not None:
            cast(OrnsteinUhlenbeck, self.action_noise).state = saved["noise"]
        for name, bits in self._generators().items():
            bits.state = saved["generators"][name]
