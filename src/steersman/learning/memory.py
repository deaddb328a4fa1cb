"""Memory of torch and of Stable-Baselines3 as arrays: what compiled updates work on."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import numpy as np
import torch

from steersman.learning import soft, twin, updates


def flatten(parameters: Iterable[Any]) -> Any:
    """Make parameters views of one flat array, and return that array."""
    parameters = list(parameters)
    flat = torch.cat([p.data.reshape(-1) for p in parameters])
    at = 0
    for p in parameters:
        p.data = flat[at : at + p.numel()].view(p.shape)
        at += p.numel()
    return flat.numpy()


def as_net(flat: Any, weights: Iterable[Any]) -> updates.Net:
    """A flat array as the network of which it holds all; ``weights`` are the layers' matrices."""
    shapes = [tuple(w.shape) for w in weights]
    return updates.view_net(flat, (shapes[0][1], *(rows for rows, _ in shapes)))


def flat_net(module: Any) -> updates.Net:
    """A network of two hidden layers, its parameters laid flat."""
    parameters = list(module.parameters())
    return as_net(flatten(parameters), parameters[::2])


def buffer_arrays(buffer: Any) -> updates.Batch:
    """The arrays of a replay buffer."""
    return updates.Batch(*(getattr(buffer, name) for name in updates.Batch._fields))


def draw(buffer: Any, count: int, batch: int, mirror: Any) -> updates.Draw:
    """Transitions for ``count`` updates, drawn as SB3's buffer draws them.

    So the same seed trains on the same batches. ``mirror`` are the factors on each feature, None
    for no mirror images.
    """
    size = buffer.buffer_size if buffer.full else buffer.pos
    rows = np.empty((count, batch), np.int64)
    envs = np.empty((count, batch), np.int64)
    for k in range(count):
        rows[k] = np.random.randint(0, size, size=batch)  # noqa: NPY002 - SB3's generator
        envs[k] = np.random.randint(0, high=buffer.n_envs, size=(batch,))  # noqa: NPY002
    sides = np.ones(rows.shape, np.float32)
    if mirror is None:
        return updates.Draw(rows, envs, sides, np.ones(buffer.obs_shape, np.float32))
    coins = np.random.randint(0, 2, size=rows.shape)  # noqa: NPY002 - SB3's generator
    sides[coins == 0] = -1.0
    return updates.Draw(rows, envs, sides, mirror)


def flat_critics(module: Any) -> twin.Critics:
    """SB3's two critics, their parameters laid flat."""
    parameters = list(module.parameters())
    return critics_of(flatten(parameters), parameters[: len(parameters) // 2 : 2])


def critics_of(flat: Any, weights: Iterable[Any]) -> twin.Critics:
    """A flat array as two critics of the same sizes; ``weights`` are the matrices of one."""
    half, weights = flat.size // 2, list(weights)
    return twin.Critics(as_net(flat[:half], weights), as_net(flat[half:], weights), flat)


def flat_policy(module: Any) -> soft.Policy:
    """SB3's squashed Gaussian, its parameters laid flat: the mean's first, as SB3 has them."""
    *mean, _, _ = parameters = list(module.parameters())
    return policy_of(flatten(parameters), mean[::2])


def policy_of(flat: Any, weights: Iterable[Any]) -> soft.Policy:
    """A flat array as a squashed Gaussian; ``weights`` are the matrices of its mean."""
    weights = list(weights)
    shapes = [tuple(w.shape) for w in weights]
    end = sum((columns + 1) * rows for rows, columns in shapes)
    last = shapes[-1][1]
    return soft.Policy(
        as_net(flat[:end], weights),
        flat[end : end + last].reshape(1, last),
        flat[end + last :],
        flat,
    )


def torch_arrays(named: Iterable[tuple[str, Any]], optimiser: Any = None) -> dict[str, Any]:
    """Parameters, and Adam's state for each, as arrays that are torch's memory.

    Adam makes its state at its first step; here it is made before, as Adam would.
    """
    out = {}
    for name, parameter in named:
        out[name] = parameter.data.numpy()
        if optimiser is None:
            continue
        state = optimiser.state[parameter]
        if not state:
            state["step"] = torch.tensor(0.0, dtype=torch.float32)
            state["exp_avg"] = torch.zeros_like(parameter)
            state["exp_avg_sq"] = torch.zeros_like(parameter)
        out |= {f"{name}.{part}": value.numpy() for part, value in state.items()}
    return out
