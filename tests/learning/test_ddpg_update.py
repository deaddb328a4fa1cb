"""DDPG's compiled update against stock Stable-Baselines3, update by update."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
import torch
from gymnasium import Env, spaces
from stable_baselines3 import DDPG
from stable_baselines3.common.logger import Logger

from steersman.learning import ddpg_update, networks
from steersman.learning.ddpg_update import CompiledDDPG
from steersman.learning.replay_buffer import DemonstrationBuffer

NETS = ("actor", "critic", "actor_target", "critic_target")
FEATURES = 7


class Nothing(Env):  # type: ignore[type-arg]
    """Spaces and nothing else."""

    observation_space = spaces.Box(-100.0, 100.0, (FEATURES,), np.float32)

    def __init__(self, actions: int = 1) -> None:
        self.action_space = spaces.Box(-1.0, 1.0, (actions,), np.float32)

    def reset(self, **_: Any) -> Any:
        return np.zeros(FEATURES, np.float32), {}


def agent(
    cls: type[DDPG], hidden: tuple[int, int] = (24, 16), rate: float = 1e-3, actions: int = 1
) -> Any:
    torch.manual_seed(3)
    made = cls(
        "MlpPolicy", Nothing(actions), buffer_size=300, batch_size=32, learning_rate=rate, seed=3,
        policy_kwargs={"net_arch": list(hidden)}, gamma=0.95, device="cpu",
        replay_buffer_class=DemonstrationBuffer,
    )  # fmt: skip
    made.set_logger(Logger(None, []))
    made.turned = made.replay_buffer.turned = np.array([-1.0, 1.0, 1.0], np.float32)[:actions]
    return made


def fill(made: Any, count: int = 200) -> None:
    """Random transitions: ends, time limits, actions on their limits."""
    rng = np.random.default_rng(1)
    for _ in range(count):
        done, cut = rng.random() < 0.2, bool(rng.random() < 0.5)
        made.replay_buffer.add(
            rng.normal(size=(1, FEATURES)).astype(np.float32),
            rng.normal(size=(1, FEATURES)).astype(np.float32),
            np.clip(rng.normal(size=(1, made.action_space.shape[0])), -1.0, 1.0),
            rng.normal(size=1),
            np.array([done]),
            [{"TimeLimit.truncated": cut and done}],
        )


def weights(made: Any) -> dict[str, Any]:
    return {
        name: np.concatenate([p.detach().numpy().ravel() for p in getattr(made, name).parameters()])
        for name in NETS
    }


def train(made: Any, gradient_steps: int) -> None:
    np.random.seed(11)  # noqa: NPY002 - SB3's buffer draws from it
    made.train(gradient_steps, 32)


@pytest.mark.parametrize("steps", [1, 10, 50])
# The buffer of 300 half full, and overwritten.
@pytest.mark.parametrize(("count", "actions"), [(200, 1), (500, 1), (500, 3)])
def test_is_stock_sb3(steps: int, count: int, actions: int) -> None:
    stock, ours = agent(DDPG, actions=actions), agent(CompiledDDPG, actions=actions)
    for made in (stock, ours):
        fill(made, count)
    before = weights(ours)
    assert all(np.array_equal(before[name], weights(stock)[name]) for name in NETS)
    for made in (stock, ours):
        train(made, steps)
    expected, got = weights(stock), weights(ours)
    for name in NETS:
        moved = abs(expected[name] - before[name]).max()
        assert moved > 0.0
        # Single precision; Adam divides by gradients that may be tiny at first.
        assert abs(got[name] - expected[name]).max() < 2e-2 * moved + 1e-6, name
        assert abs(got[name] - expected[name]).mean() < 1e-3 * moved + 1e-7, name
    values = stock.logger.name_to_value
    assert ours.last_losses[0] == pytest.approx(values["train/actor_loss"], rel=1e-4, abs=1e-6)
    assert ours.last_losses[1] == pytest.approx(values["train/critic_loss"], rel=1e-4)
    assert ours._n_updates == stock._n_updates == steps


def test_one_call_of_many_updates_is_many_calls() -> None:
    one, many = agent(CompiledDDPG), agent(CompiledDDPG)
    for made in (one, many):
        fill(made)
    train(one, 6)
    np.random.seed(11)  # noqa: NPY002
    for _ in range(6):
        many.train(1, 32)
    assert all(np.array_equal(weights(one)[name], weights(many)[name]) for name in NETS)


def test_torch_sees_the_trained_weights() -> None:
    """The networks' parameters are the very memory that the compiled update changes."""
    made = agent(CompiledDDPG)
    fill(made)
    train(made, 5)
    features = np.random.default_rng(0).normal(size=(9, FEATURES)).astype(np.float32)
    predicted, _ = made.predict(features, deterministic=True)
    assert made.act(features) == pytest.approx(predicted, abs=1e-6)
    flat = made.weights()
    assert all(np.array_equal(flat[name], weights(made)[name]) for name in NETS)


def test_adam_is_torchs() -> None:
    rng = np.random.default_rng(0)
    ours = rng.normal(size=50).astype(np.float32)
    theirs = torch.nn.Parameter(torch.tensor(ours.copy()))
    moments = networks.make_moments(50)
    optimiser = torch.optim.Adam([theirs], lr=1.0)
    for k in range(60):
        gradient = (rng.normal(size=50) * 10.0 ** rng.integers(-6, 3, 50)).astype(np.float32)
        rate = 1e-3 * 0.97**k
        for group in optimiser.param_groups:
            group["lr"] = rate
        theirs.grad = torch.tensor(gradient)
        optimiser.step()
        networks.adam(ours, gradient, moments, rate)
        assert ours == pytest.approx(theirs.detach().numpy(), abs=2e-6), k
    assert moments.count[0] == 60


def test_nan_stays_nan() -> None:
    """Sums may be reordered, but a loss that is not finite must show."""
    made = agent(CompiledDDPG)
    fill(made)
    made.replay_buffer.rewards[:] = np.nan
    train(made, 1)
    assert np.isnan(made.last_losses[1])


def test_learning_rate_is_set_at_every_update() -> None:
    made = agent(CompiledDDPG)
    asked: list[float] = []

    def rate(step: float) -> float:
        asked.append(step)
        return 0.0

    made.rate, made.num_timesteps = rate, 100
    fill(made)
    before = weights(made)
    train(made, 4)
    assert asked == pytest.approx([99.25, 99.5, 99.75, 100.0])
    assert np.array_equal(weights(made)["actor"], before["actor"])


def test_sizes_that_do_not_fit_are_refused() -> None:
    with pytest.raises(ValueError, match="do not fill"):
        networks.view_net(np.zeros(30, np.float32), (2, 3, 3, 1))


def test_learning_from_mirror_images_is_learning_from_a_mirrored_buffer() -> None:
    factors = np.array([1.0, -1.0, -1.0, 1.0, -1.0, -1.0, -1.0], np.float32)
    plain, mirrored = agent(CompiledDDPG, actions=3), agent(CompiledDDPG, actions=3)
    for made in (plain, mirrored):
        fill(made)
    buffer = plain.replay_buffer
    buffer.observations *= factors
    buffer.next_observations *= factors
    buffer.actions *= mirrored.turned
    rng = np.random.default_rng(4)
    rows, envs = rng.integers(0, 200, (3, 32)), np.zeros((3, 32), np.int64)
    for made, side in ((plain, 1.0), (mirrored, -1.0)):
        nets = made._flat()
        draw = networks.Draw(rows, envs, np.full((3, 32), side, np.float32), factors, made.turned)
        numbers = ddpg_update.UpdateNumbers(
            np.full(3, 1e-3), np.zeros(3), False, made.gamma, made.tau
        )
        ddpg_update.update(made._arrays, draw, numbers, nets, made.moments, made._scratch)
    assert all(np.array_equal(weights(plain)[name], weights(mirrored)[name]) for name in NETS)


COMPILED = (
    *(networks._bias_relu, networks.forward, networks.back_hidden, networks.weight_gradients),
    *(networks.adam, networks.descend, networks.gather, networks.follow),
    *(ddpg_update._targets, ddpg_update._improve_critic, ddpg_update._improve_actor),
    ddpg_update._imitate,
)


def test_as_python_it_computes_the_same(monkeypatch: pytest.MonkeyPatch) -> None:
    """The source itself, which a compiler may not run as it is written."""
    ours, plain = agent(CompiledDDPG), agent(CompiledDDPG)
    for made in (ours, plain):
        fill(made)
    train(ours, 3)
    for function in COMPILED:
        for module in (networks, ddpg_update):
            if hasattr(module, function.__name__):
                monkeypatch.setattr(module, function.__name__, function.py_func)
    monkeypatch.setattr(ddpg_update, "update", ddpg_update.update.py_func)
    train(plain, 3)
    for name in NETS:
        assert weights(plain)[name] == pytest.approx(weights(ours)[name], rel=1e-4, abs=1e-6)
    assert plain.last_losses == pytest.approx(ours.last_losses, rel=1e-5)
