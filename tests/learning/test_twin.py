"""TD3's compiled update against stock Stable-Baselines3, update by update."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
import torch
from stable_baselines3 import TD3
from stable_baselines3.common.logger import Logger

from steersman.learning.td3 import DemonstratedTD3

from .test_updates import FEATURES, Nothing, fill, train, weights

NETS = ("actor", "critic", "actor_target", "critic_target")


def agent(cls: type[TD3], delay: int = 2, noise: float = 0.2) -> Any:
    torch.manual_seed(3)
    made = cls(
        "MlpPolicy", Nothing(), buffer_size=300, batch_size=32, learning_rate=1e-3, seed=3,
        policy_kwargs={"net_arch": [24, 16]}, gamma=0.95, device="cpu", policy_delay=delay,
        target_policy_noise=noise, target_noise_clip=0.3,
    )  # fmt: skip
    made.set_logger(Logger(None, []))
    return made


def learn(made: Any, steps: int) -> None:
    torch.manual_seed(5)  # of the noise on the targets' actions
    train(made, steps)


@pytest.mark.parametrize("steps", [1, 2, 10, 50])
@pytest.mark.parametrize(("delay", "noise"), [(2, 0.2), (1, 0.0), (3, 5.0)])
def test_is_stock_sb3(steps: int, delay: int, noise: float) -> None:
    stock, ours = agent(TD3, delay, noise), agent(DemonstratedTD3, delay, noise)
    for made in (stock, ours):
        fill(made, 500)
    before = weights(ours)
    assert all(np.array_equal(before[name], weights(stock)[name]) for name in NETS)
    for made in (stock, ours):
        learn(made, steps)
    expected, got = weights(stock), weights(ours)
    for name in NETS:
        moved = abs(expected[name] - before[name]).max()
        assert (moved > 0.0) == (name == "critic" or steps >= delay)
        # Single precision; Adam divides by gradients that may be tiny at first.
        assert abs(got[name] - expected[name]).max() <= 2e-2 * moved + 1e-6, name
        assert abs(got[name] - expected[name]).mean() <= 1e-3 * moved + 1e-7, name
    said = stock.logger.name_to_value
    if steps >= delay:
        assert ours.last_losses[0] == pytest.approx(said["train/actor_loss"], rel=1e-4, abs=1e-6)
    else:
        assert np.isnan(ours.last_losses[0])
    assert ours.last_losses[1] == pytest.approx(said["train/critic_loss"], rel=1e-4)
    assert ours._n_updates == stock._n_updates == steps


def test_one_call_of_many_updates_is_many_calls() -> None:
    """The delay counts over calls, and the actor's loss stands between its updates."""
    one, many = agent(DemonstratedTD3), agent(DemonstratedTD3)
    for made in (one, many):
        fill(made)
    learn(one, 7)
    torch.manual_seed(5)
    np.random.seed(11)  # noqa: NPY002
    for _ in range(7):
        many.train(1, 32)
    assert all(np.array_equal(weights(one)[name], weights(many)[name]) for name in NETS)
    assert np.isfinite(many.last_losses).all()


def test_torch_sees_the_trained_weights() -> None:
    made = agent(DemonstratedTD3)
    fill(made)
    learn(made, 5)
    features = np.random.default_rng(0).normal(size=(9, FEATURES)).astype(np.float32)
    predicted, _ = made.predict(features, deterministic=True)
    assert made.act(features) == pytest.approx(predicted[:, 0], abs=1e-6)
    flat = made.weights()
    assert all(np.array_equal(flat[name], weights(made)[name]) for name in NETS)


def test_nan_stays_nan() -> None:
    made = agent(DemonstratedTD3)
    fill(made)
    made.replay_buffer.rewards[:] = np.nan
    learn(made, 2)
    assert np.isnan(made.last_losses[1])
