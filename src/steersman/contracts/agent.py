"""What every learning algorithm has to fulfil; for packages with algorithms of their own, too."""

from __future__ import annotations

import io
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from steersman.config import build
from steersman.contracts import Contract
from steersman.learning.algorithms.base import AgentComponent
from steersman.learning.config import TrainConfig

_NEVER = {"kind": "constant", "at": 0.0}
_PROBLEM = {
    "roads": [{"kind": "circle", "radius": 40.0}],
    "speeds": [{"kind": "constant_speed", "speed": 8.0}],
    "episode_time": 2.0,
    # An algorithm may refuse actions of the demonstrator; its reward is no concern of an agent.
    "demonstration": {"p_action": _NEVER},
}
_SMALL: dict[str, Any] = {
    "hidden": (16, 16),
    "batch": 32,
    "vehicles": 2,
    "buffer": 2000,
    "updates": 1,
}
_SMALL |= {"learning_starts": 64, "n_steps": 32, "horizon": 16}
# Environment steps after which every algorithm has learned several times.
_STEPS = 128


def training(agent: type[AgentComponent], seed: int = 0) -> TrainConfig:
    """A training of a few hundred steps; options that the algorithm does not have are left out."""
    own = {name: value for name, value in _SMALL.items() if name in agent.model_fields}
    tree = {"problem": _PROBLEM, "agent": agent(**own), "steps": 2 * _STEPS, "seed": seed}
    return build(TrainConfig, {**tree, "validation": {"vehicles": 1, "interval": _STEPS}})


def _made(config: TrainConfig) -> Any:
    from steersman.learning.vec_env import PathFollowingVecEnv

    return config.agent.make(config, PathFollowingVecEnv(config.problem, config.agent.vehicles))


def _learned(config: TrainConfig) -> Any:
    """An agent after some steps; made just before, since agents share generators."""
    made = _made(config)
    made.learn(_STEPS)
    return made


def it_learns(agent: type[AgentComponent]) -> Iterator[str]:
    """Some hundred steps change its weights, the same way with the same seed."""
    from steersman.learning.arithmetic import arithmetic

    with arithmetic(1):
        yield from _trained(agent)


def a_resumed_training_exports_the_same_policy(agent: type[AgentComponent]) -> Iterator[str]:
    """To the bit."""
    from steersman.learning.arithmetic import arithmetic

    with arithmetic(1), tempfile.TemporaryDirectory() as folder:
        yield from _exported(agent, Path(folder))


check: Contract[type[AgentComponent]] = Contract(
    it_learns, a_resumed_training_exports_the_same_policy, of_classes=True
)
"""Trains some hundred steps several times, which takes some seconds."""


def _trained(agent: type[AgentComponent]) -> Iterator[str]:
    fresh = _made(training(agent)).actor_net().flat.copy()
    made, again, other = (_learned(training(agent, seed)) for seed in (0, 0, 1))
    width = made.observation_space.shape[0]
    features = np.random.default_rng(0).normal(size=(50, width)).astype(np.float32)
    actions = made.act(features)
    if actions.shape != (50, 1) or not np.all(np.abs(actions) <= 1.0):
        yield "act gives no actions (n, m) in [-1, 1]"
    if not np.allclose(actions, made.predict(features, deterministic=True)[0], atol=1e-5):
        yield "act and predict(deterministic=True) differ"
    if made._n_updates <= 0 or np.array_equal(fresh, made.actor_net().flat):
        yield f"{_STEPS} steps change no weight of the policy"
    if not np.array_equal(made.actor_net().flat, again.actor_net().flat):
        yield "the same seed gives other weights"
    if np.array_equal(made.actor_net().flat, other.actor_net().flat):
        yield "another seed gives the same weights"
    yield from _restored(agent, made)


def _restored(agent: type[AgentComponent], made: Any) -> Iterator[str]:
    """Weights and counters after a snapshot's way through a file; resume is trained below."""
    from steersman.learning import snapshot

    stream = io.BytesIO()
    snapshot.write(made.snapshot(), stream)
    other = _made(training(agent, 1))
    other.restore(snapshot.read(stream))
    if other.num_timesteps != made.num_timesteps:
        yield "restore does not bring back num_timesteps"
    for name, values in made.weights().items():
        if not np.array_equal(values, other.weights()[name], equal_nan=True):
            yield f"restore does not bring back {name}"


def _exported(agent: type[AgentComponent], folder: Path) -> Iterator[str]:
    """Two trainings, one of them stopped and resumed, export the same file."""
    from steersman.learning.train import train

    config = training(agent).model_copy(update={"checkpoint_interval": 64})
    whole = train(config, folder / "whole")

    def stop(_: Any) -> None:
        raise KeyboardInterrupt

    try:
        train(config, folder / "resumed", stop)
    except KeyboardInterrupt:
        resumed = train(config, folder / "resumed", resume=True)
        if resumed.policy.read_bytes() != whole.policy.read_bytes():
            yield "a training that was stopped and resumed exports another policy"
