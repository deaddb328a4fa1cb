"""The agent of a training by an algorithm that learns from a replay buffer."""

from __future__ import annotations

from functools import cache
from typing import TYPE_CHECKING

import numpy as np
from stable_baselines3.common.off_policy_algorithm import OffPolicyAlgorithm

from steersman.learning.noise import OrnsteinUhlenbeck
from steersman.learning.off_policy import OffPolicySteering
from steersman.learning.sb3 import start_at_base
from steersman.learning.warm_start import Opening

if TYPE_CHECKING:
    from steersman.learning.algorithms.base import OffPolicyComponent
    from steersman.learning.config import TrainConfig
    from steersman.learning.vec_env import PathFollowingVecEnv


@cache
def steering(algorithm: type[OffPolicyAlgorithm]) -> type[OffPolicySteering]:
    """An off-policy algorithm of Stable-Baselines3 with the seam before it."""
    if issubclass(algorithm, OffPolicySteering):
        return algorithm
    return type(f"Steering{algorithm.__name__}", (OffPolicySteering, algorithm), {})


def make_off_policy(
    settings: OffPolicyComponent, config: TrainConfig, env: PathFollowingVecEnv
) -> OffPolicySteering:
    """The agent of a training configuration.

    Args:
        settings: the algorithm and its options; ``config.agent``.
        config: the training.
        env: the vehicles that it drives.
    """
    demo, total, own = config.problem.demonstration, config.steps, settings.options()
    opening = None
    if demo.warm_start is not None:
        opening = Opening(demo.warm_start, config.problem, env.num_envs)
    seeds = np.random.SeedSequence(config.seed).generate_state(3)
    agent: OffPolicySteering

    if settings.exploration is not None:
        sigma, theta, dt = settings.exploration
        own["action_noise"] = OrnsteinUhlenbeck(
            (env.num_envs, len(env.turned)),
            theta,
            lambda: sigma.value(agent.num_timesteps, total),
            dt,
            int(seeds[0]),
        )
    algorithm = steering(settings.algorithm())
    agent = algorithm(
        "MlpPolicy",
        env,
        learning_rate=settings.learning_rate.value(0, total),
        buffer_size=settings.buffer,
        replay_buffer_class=algorithm.buffer_class,
        batch_size=settings.batch,
        gamma=settings.gamma,
        tau=settings.tau,
        train_freq=1,
        gradient_steps=settings.updates,
        learning_starts=settings.learning_starts if opening is None else opening.steps,
        policy_kwargs={"net_arch": list(settings.hidden)},
        seed=int(seeds[1] % 2**31),
        device="cpu",
        **own,
    )
    start_at_base(agent.policy, config.problem, settings)
    agent.turned = agent.buffer.turned = env.turned.astype(np.float32)
    if settings.mirror:
        agent.mirror = agent.buffer.mirror = env.mirror.astype(np.float32)
    agent.rate = lambda step: settings.learning_rate.value(step, total)
    agent.operators = settings.operators
    agent.prepare_demonstration(demo, opening, total, int(seeds[2]))
    return agent
