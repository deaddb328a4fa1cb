"""The seam before Stable-Baselines3's TD3 and SAC: their own updates, one by one."""

from __future__ import annotations

import sys
from typing import Any

import numpy as np
import pytest
import torch
from stable_baselines3 import SAC, TD3
from stable_baselines3.common.logger import Logger
from stable_baselines3.common.off_policy_algorithm import OffPolicyAlgorithm

from steersman.learning.make_off_policy import steering
from steersman.learning.off_policy import OffPolicySteering
from steersman.learning.replay_buffer import DemonstrationBuffer

from .test_ddpg_update import FEATURES, Nothing, fill

ALGORITHMS = [TD3, SAC]
FACTORS = np.array([1.0, -1.0, -1.0, 1.0, -1.0, -1.0, -1.0], np.float32)


def agent(cls: type[OffPolicyAlgorithm], **own: Any) -> Any:
    made = cls(
        "MlpPolicy", Nothing(), buffer_size=300, batch_size=32, learning_rate=1e-3, seed=3,
        replay_buffer_class=DemonstrationBuffer, policy_kwargs={"net_arch": [24, 16]},
        gamma=0.95, device="cpu", **own,
    )  # fmt: skip
    made.set_logger(Logger(None, []))
    fill(made, 500)
    return made


def learn(made: Any, steps: int) -> None:
    torch.manual_seed(5)
    np.random.seed(11)  # noqa: NPY002 - SB3's buffer draws from it
    made.train(steps, 32)


def parameters(made: Any) -> dict[str, Any]:
    return {name: p.detach().numpy().copy() for name, p in made.policy.named_parameters()}


@pytest.mark.parametrize("algorithm", ALGORITHMS)
@pytest.mark.parametrize("steps", [1, 4, 20])
def test_is_stock_sb3_to_the_bit(algorithm: Any, steps: int) -> None:
    stock, ours = agent(algorithm), agent(steering(algorithm))
    ours.weights()  # laid flat before learning, as in a training
    for made in (stock, ours):
        learn(made, steps)
    expected, got = parameters(stock), parameters(ours)
    assert all(np.array_equal(expected[name], got[name]) for name in expected)
    assert ours._n_updates == stock._n_updates == steps
    assert np.isnan(ours.last_losses[0]) == (algorithm is TD3 and steps < 2)
    assert np.isfinite(ours.last_losses[1:]).all()


@pytest.mark.parametrize("algorithm", ALGORITHMS)
def test_learning_rate_is_set_at_every_update(algorithm: Any) -> None:
    made = agent(steering(algorithm))
    asked: list[float] = []

    def rate(step: float) -> float:
        asked.append(step)
        return 0.0

    made.rate, made.num_timesteps = rate, 100
    before = parameters(made)
    learn(made, 4)
    assert asked == pytest.approx([99.25, 99.5, 99.75, 100.0])
    after = parameters(made)
    assert all(np.array_equal(before[n], after[n]) for n in before if "target" not in n)


@pytest.mark.parametrize("algorithm", ALGORITHMS)
def test_weights_are_torchs_memory(algorithm: Any) -> None:
    made = agent(steering(algorithm))
    kept = made.weights()
    learn(made, 6)
    assert all(np.array_equal(kept[n], value) for n, value in parameters(made).items())
    features = np.random.default_rng(0).normal(size=(9, FEATURES)).astype(np.float32)
    predicted, _ = made.predict(features, deterministic=True)
    assert made.act(features) == pytest.approx(predicted, abs=1e-6)
    assert {f"{part}.step" for part in kept} & set(kept)
    moments = [value for name, value in kept.items() if name.endswith("exp_avg_sq")]
    assert all((value >= 0.0).all() and value.any() for value in moments)
    assert ("log_ent_coef" in kept) == (algorithm is SAC)


@pytest.mark.parametrize("algorithm", ALGORITHMS)
def test_mirror_images_learn_as_if_they_had_been_driven(
    algorithm: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    """With coins that mirror every transition, against a buffer that is mirrored itself."""
    plain, mirrored = agent(steering(algorithm)), agent(steering(algorithm))
    buffer = plain.replay_buffer
    buffer.observations *= FACTORS
    buffer.next_observations *= FACTORS
    buffer.actions *= -1.0
    mirrored.replay_buffer.mirror = FACTORS
    draws = np.random.randint

    def tails(low: int, high: Any = None, size: Any = None) -> Any:
        return np.zeros(size, np.int64) if size == (1, 32) else draws(low, high, size=size)

    monkeypatch.setattr(np.random, "randint", tails)
    for made in (plain, mirrored):
        learn(made, 3)
    first, second = parameters(plain), parameters(mirrored)
    assert all(np.array_equal(first[name], second[name]) for name in first)


@pytest.mark.parametrize("algorithm", ALGORITHMS)
def test_nan_stays_nan(algorithm: Any) -> None:
    made = agent(steering(algorithm))
    made.replay_buffer.rewards[:] = np.nan
    learn(made, 1)
    assert np.isnan(made.last_losses[1])


def test_the_loss_of_td3s_actor_stands_between_its_updates() -> None:
    made = agent(steering(TD3), policy_delay=3)
    made.last_losses = (0.25, 0.0, 0.0)
    learn(made, 2)
    assert made.last_losses[0] == 0.25
    learn(made, 1)
    assert made.last_losses[0] != 0.25


def test_the_seam_is_put_before_an_algorithm_once() -> None:
    assert steering(TD3) is steering(TD3)
    assert steering(steering(TD3)) is steering(TD3)
    assert issubclass(steering(SAC), OffPolicySteering)


def test_an_optimiser_is_made_without_torchs_compiler(monkeypatch: pytest.MonkeyPatch) -> None:
    """Its import takes seconds of every DDPG training, which updates without torch."""
    monkeypatch.setitem(sys.modules, "torch._dynamo", None)  # an import raises
    made = torch.optim.Adam([torch.zeros(2, requires_grad=True)])
    made.zero_grad()
    before = made.state_dict()
    made.load_state_dict(before)
    assert made.state_dict() == before
    assert sys.modules["torch._dynamo"] is None  # still blocked: nothing imported it
