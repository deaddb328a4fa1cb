"""DQN: every action is one of the list, whoever chose it; the buffer gives their places."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from steersman.errors import ConfigError
from steersman.learning.config import train_config
from steersman.learning.networks import nearest

from .test_agent import half
from .test_algorithms import NEVER, learn


@pytest.mark.parametrize("share", [0.0, 1.0])
def test_executes_and_stores_actions_of_the_list(share: float) -> None:
    agent, env = learn("dqn", problem={"demonstration": half(share)})
    executed = np.array(env.executed)[:, :, 0].astype(np.float32)
    levels = agent.levels.astype(np.float32)
    assert np.isin(executed, levels).all()
    buffer = agent.replay_buffer
    assert np.array_equal(buffer.actions[: buffer.pos, :, 0], executed)
    proposed = np.array(env.proposed).reshape(-1, 1)
    shown = levels[nearest(proposed, agent.levels)].reshape(executed.shape)
    assert (shown == executed).mean() == 1.0 if share else len(np.unique(executed)) == len(levels)


def test_learns_the_places_of_the_actions_it_took() -> None:
    agent, _ = learn("dqn", 40)
    buffer = agent.replay_buffer
    buffer.actions[:] = agent.levels[3]
    assert (buffer.sample(50).actions.numpy() == 3).all()


@pytest.mark.parametrize(
    "changes",
    [
        {"joint": True, "speeds": [{"kind": "constant_speed"}]},
        {"demonstration": {"warm_start": {"steps": 100}}},
        {"demonstration": {"loss": {}}},
    ],
)
def test_refuses_what_a_list_cannot_do(changes: dict[str, Any]) -> None:
    with pytest.raises(ConfigError, match=r"ddpg, (sac, )?td3"):
        train_config({"agent": "dqn", "problem": {"demonstration": NEVER, **changes}})
