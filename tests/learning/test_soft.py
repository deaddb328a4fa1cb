"""SAC's compiled update against stock Stable-Baselines3, update by update."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
import torch
from stable_baselines3 import SAC
from stable_baselines3.common.logger import Logger

from steersman.learning import memory, soft
from steersman.learning.sac import DemonstratedSAC

from .test_updates import FEATURES, Nothing, fill, train

NETS = ("actor", "critic", "critic_target")


def agent(cls: type[SAC], ent_coef: Any = "auto") -> Any:
    torch.manual_seed(3)
    made = cls(
        "MlpPolicy", Nothing(), buffer_size=300, batch_size=32, learning_rate=1e-3, seed=3,
        policy_kwargs={"net_arch": [24, 16]}, gamma=0.95, device="cpu", ent_coef=ent_coef,
    )  # fmt: skip
    made.set_logger(Logger(None, []))
    return made


def weights(made: Any) -> dict[str, Any]:
    out = {
        name: np.concatenate([p.detach().numpy().ravel() for p in getattr(made, name).parameters()])
        for name in NETS
    }
    if made.log_ent_coef is not None:
        out["entropy"] = made.log_ent_coef.detach().numpy().copy()
    return out


def learn(made: Any, steps: int) -> None:
    torch.manual_seed(5)  # of the actions
    train(made, steps)


@pytest.mark.parametrize("steps", [1, 10, 50])
@pytest.mark.parametrize("ent_coef", ["auto", "auto_0.1", 0.2])
def test_is_stock_sb3(steps: int, ent_coef: Any) -> None:
    stock, ours = agent(SAC, ent_coef), agent(DemonstratedSAC, ent_coef)
    for made in (stock, ours):
        fill(made, 500)
    before = weights(ours)
    assert all(np.array_equal(before[name], weights(stock)[name]) for name in before)
    for made in (stock, ours):
        learn(made, steps)
    expected, got = weights(stock), weights(ours)
    for name, was in before.items():
        moved = abs(expected[name] - was).max()
        assert moved > 0.0
        # Single precision; Adam divides by gradients that may be tiny at first.
        assert abs(got[name] - expected[name]).max() <= 2e-2 * moved + 1e-6, name
        assert abs(got[name] - expected[name]).mean() <= 1e-3 * moved + 1e-7, name
    said = stock.logger.name_to_value
    assert ours.last_losses[0] == pytest.approx(said["train/actor_loss"], rel=1e-4, abs=1e-5)
    assert ours.last_losses[1] == pytest.approx(said["train/critic_loss"], rel=1e-4)
    assert ours._n_updates == stock._n_updates == steps


@pytest.mark.parametrize("shift", [-30.0, 0.0, 5.0])
def test_the_gradient_is_autograds(shift: float) -> None:
    """Also where the deviation is at its bounds, which no longer learns then."""
    made = agent(DemonstratedSAC, 0.3)
    learner = made._compiled()
    learner.policy.b[0] = shift
    rng = np.random.default_rng(0)
    work, drawn = made._work, made._drawn
    work.x[:] = rng.normal(size=work.x.shape)
    work.z[:, :FEATURES] = work.x
    noise = rng.normal(size=32).astype(np.float32)
    soft._act(learner.policy, noise, work, drawn)
    work.z[:, FEATURES] = drawn.action
    value = soft._slopes(learner.critics, work, drawn)
    soft._policy_gradient(learner.policy, noise, 0.3, learner.policy_gradient, work, drawn)

    seen = torch.from_numpy(work.x.copy())
    mean, log_std, _ = made.actor.get_action_dist_params(seen)
    normal = torch.from_numpy(noise)[:, None]
    action = torch.tanh(mean + log_std.exp() * normal)
    # Not by the distribution: it divides what rounding leaves of a small deviation.
    gaussian = -0.5 * normal**2 - log_std - 0.5 * np.log(2.0 * np.pi)
    log_prob = gaussian - torch.log(1.0 - action**2 + 1e-6)
    q = torch.cat(made.critic(seen, action), dim=1).min(dim=1, keepdim=True)[0]
    made.actor.optimizer.zero_grad()
    (0.3 * log_prob - q).mean().backward()
    assert value == pytest.approx(float(q.detach().mean()), rel=1e-5)
    # Where tanh is 1 but for rounding, its last bit counts.
    assert drawn.log_prob == pytest.approx(log_prob.detach().numpy()[:, 0], abs=0.1)
    expected = np.concatenate([p.grad.numpy().ravel() for p in made.actor.parameters()])
    got = learner.policy_gradient.flat
    assert got == pytest.approx(expected, rel=1e-3, abs=5e-3 * float(abs(expected).max()))
    bounded = shift != 0.0
    assert (not learner.policy_gradient.w.any()) == bounded


def test_one_call_of_many_updates_is_many_calls() -> None:
    one, many = agent(DemonstratedSAC), agent(DemonstratedSAC)
    for made in (one, many):
        fill(made)
    learn(one, 6)
    torch.manual_seed(5)
    np.random.seed(11)  # noqa: NPY002
    for _ in range(6):
        many.train(1, 32)
    first, second = weights(one), weights(many)
    assert all(np.array_equal(first[name], second[name]) for name in first)


def test_torch_sees_the_trained_weights() -> None:
    made = agent(DemonstratedSAC)
    fill(made)
    learn(made, 5)
    features = np.random.default_rng(0).normal(size=(9, FEATURES)).astype(np.float32)
    predicted, _ = made.predict(features, deterministic=True)
    assert made.act(features) == pytest.approx(predicted[:, 0], abs=1e-6)
    flat = made.weights()
    assert all(np.array_equal(flat[name], weights(made)[name]) for name in NETS)
    assert float(made.log_ent_coef.detach()) == flat["log_ent_coef"][0] != 0.0


def test_nan_stays_nan() -> None:
    made = agent(DemonstratedSAC)
    fill(made)
    made.replay_buffer.rewards[:] = np.nan
    learn(made, 1)
    assert np.isnan(made.last_losses[1])


def test_a_mirrored_buffer_is_a_mirrored_draw() -> None:
    """Mirrored observations with the mirrored action learn as if they had been driven."""
    factors = np.array([1.0, -1.0, -1.0, 1.0, -1.0, -1.0, -1.0], np.float32)
    plain, mirrored = agent(DemonstratedSAC), agent(DemonstratedSAC)
    for made in (plain, mirrored):
        fill(made)
    buffer = plain.replay_buffer
    buffer.observations *= factors
    buffer.next_observations *= factors
    buffer.actions *= -1.0
    noise = np.random.default_rng(0).normal(size=(3, 2, 32)).astype(np.float32)
    for made, side in ((plain, 1.0), (mirrored, -1.0)):
        np.random.seed(2)  # noqa: NPY002 - SB3's generator
        draw = memory.draw(made.replay_buffer, 3, 32, None)
        draw.sides[:] = side
        learner = made._compiled()
        batch = memory.buffer_arrays(made.replay_buffer)
        rates = np.full(3, 1e-3)
        draw = draw._replace(mirror=factors)
        soft.update(batch, draw, noise, rates, learner, (0.9, 0.01), made._work, made._drawn)
    first, second = weights(plain), weights(mirrored)
    assert all(np.array_equal(first[name], second[name]) for name in first)
