"""The exported network in other implementations."""

from __future__ import annotations

import math
from collections.abc import Callable
from itertools import pairwise
from typing import Any

import numpy as np

from steersman.learning.config import TrainConfig
from steersman.learning.networks import forward, view_net


def compiled(data: bytes) -> Callable[[Any], float]:
    """The ONNX network as the compiled function that training uses; maps (1, n) to an action."""
    import onnx

    weights = {
        w.name: onnx.numpy_helper.to_array(w) for w in onnx.load_from_string(data).graph.initializer
    }
    layers = [weights[f"w{i}"] for i in (1, 2, 3)]
    sizes = (layers[0].shape[1], *(w.shape[0] for w in layers))
    parts = [a.ravel() for i in (1, 2, 3) for a in (weights[f"w{i}"], weights[f"b{i}"])]
    flat = np.concatenate(parts).astype(np.float32)
    assert flat.size == sum((a + 1) * b for a, b in pairwise(sizes))
    net = view_net(flat, sizes)
    low, high, scale = weights["low"], weights["high"], weights["scale"]
    h1, h2, y = (np.zeros((1, n), np.float32) for n in sizes[1:])

    def run(x: Any) -> float:
        forward(net, np.clip(x * scale, low, high), h1, h2, y)
        return math.tanh(float(y[0, 0]))

    return run


def sb3_predict(config: TrainConfig) -> Callable[[Any], Any]:
    """``predict`` of Stable-Baselines3 for a network of the same sizes, one observation."""
    import torch

    from steersman.learning.vec_env import PathFollowingVecEnv

    torch.set_num_threads(1)
    small = config.agent.model_copy(update={"buffer": 100, "vehicles": 1})
    config = config.model_copy(update={"agent": small})
    agent = small.make(config, PathFollowingVecEnv(config.problem, 1))

    def predict(x: Any) -> Any:
        return agent.predict(x, deterministic=True)[0]

    return predict
