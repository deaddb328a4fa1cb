"""The mean of a policy's weights: what it is, when it is there; learning goes on without it."""

from __future__ import annotations

from pathlib import Path as FilePath
from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from steersman.config import override
from steersman.errors import ConfigError
from steersman.learning.config import TrainConfig, train_config
from steersman.learning.networks import WeightAverage
from steersman.learning.running import RunningTraining
from steersman.learning.train import _Training
from steersman.policy_file import read_policy

from .problems import tiny


def test_it_is_the_mean() -> None:
    draws = np.random.default_rng(0).normal(size=(50, 7)).astype(np.float32)
    average, weights = WeightAverage(7), draws[-1].copy()
    for draw in draws:
        average.add(draw)
    with average.within(weights):
        assert_allclose(weights, draws.mean(axis=0), rtol=1e-5, atol=1e-6)
    assert_array_equal(weights, draws[-1])


def test_own_weights_come_back_whatever_happens() -> None:
    average, weights = WeightAverage(3), np.ones(3, np.float32)
    with average.within(weights):
        assert_array_equal(weights, 1.0)  # nothing to put in their place yet
    average.add(np.zeros(3))
    with pytest.raises(RuntimeError, match="inside"), average.within(weights):
        raise RuntimeError("inside")
    assert_array_equal(weights, 1.0)


def trained(config: TrainConfig, out: FilePath) -> list[Any]:
    """The policy's weights after every step of all vehicles."""
    seen: list[Any] = []
    training = _Training(config, out, lambda _: None, RunningTraining(out, 0, config.steps, None))
    step = training._after_step

    def spy() -> None:
        step()
        seen.append((training.agent.num_timesteps, training.agent.actor_net().flat.copy()))

    training._after_step = spy  # type: ignore[method-assign]
    training.run()
    return seen


def test_the_exported_policy_is_the_mean_and_learning_does_not_notice(tmp_path: FilePath) -> None:
    onnx = pytest.importorskip("onnx")
    changes: dict[str, Any] = {"steps": 2000, "validation": {"interval": 2000}}
    plain = trained(tiny(**changes), tmp_path / "plain")
    seen = trained(tiny(**changes, average=0.5), tmp_path / "mean")
    for (_, one), (_, other) in zip(plain, seen, strict=True):
        assert_array_equal(one, other)
    mean = np.mean([flat for steps, flat in seen if steps > 1000], axis=0)
    model = onnx.load_from_string(read_policy(tmp_path / "mean" / "policy.onnx")[0])
    w1 = next(w for w in model.graph.initializer if w.name == "w1")
    first = onnx.numpy_helper.to_array(w1)
    assert_allclose(first.ravel(), mean[: first.size], rtol=1e-4, atol=1e-6)
    assert np.abs(first.ravel() - seen[-1][1][: first.size]).max() > 1e-4


@pytest.mark.parametrize("share", [-0.1, 1.0])
def test_a_share_that_is_none(share: float) -> None:
    with pytest.raises(ConfigError, match="average"):
        train_config(override({}, [f"average={share}"]))
