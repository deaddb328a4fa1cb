"""Networks of two hidden layers as arrays: forward, backward, Adam, and the mean of their weights.

All weights of a network are views of one flat array. For a network of torch that array is torch's
own memory, so what compiled code changes, torch sees at once.

Sources: Kingma and Ba, Adam, 2015, alg. 1 (arranged as ``torch.optim.Adam`` does; a test compares
both). Polyak and Juditsky, Acceleration of stochastic approximation by averaging, SIAM J. Control
and Optimization 30, 1992; Izmailov et al., Averaging weights leads to wider optima and better
generalization, UAI 2018.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any, NamedTuple

import numpy as np

from steersman.kernels.compiled import F, compiled
from steersman.learning.snapshot import Tree, fill

_BETA1, _BETA2, _EPS = np.float32(0.9), np.float32(0.999), np.float32(1e-8)
_ONE = np.float32(1.0)
# Sums may be reordered (so that they vectorise); NaN and infinity keep their meaning.
_FAST = {"reassoc", "contract", "nsz", "arcp"}


def fast(function: F) -> F:
    """Compile arithmetic on networks."""
    return compiled(function, fastmath=_FAST)


class Net(NamedTuple):
    """Weights (out, in) and biases of one network, views of ``flat``."""

    w1: Any
    b1: Any
    w2: Any
    b2: Any
    w3: Any
    b3: Any
    flat: Any


class Work(NamedTuple):
    """Scratch of one network for a batch of B samples, float32."""

    x: Any
    """(B, inputs) what it reads."""
    h1: Any
    """(B, hidden) behind the first hidden layer."""
    h2: Any
    """(B, hidden) behind the second."""
    y: Any
    """(B, outputs) its output."""
    d1: Any
    """(B, hidden) gradient at the input of the first hidden layer."""
    d2: Any
    """(B, hidden) gradient at the input of the second."""
    dy: Any
    """(B, outputs) gradient at its output."""
    grad: Net
    """Gradients of its weights."""


class Moments(NamedTuple):
    """Adam's first and second moments, flat, and the number of updates as ``count[0]``."""

    first: Any
    second: Any
    count: Any


def view_net(flat: Any, sizes: tuple[int, int, int, int]) -> Net:
    """Views of a flat array as (input, hidden, hidden, output) layers in torch's order."""
    parts, at = [], 0
    for rows, columns in zip(sizes[1:], sizes[:-1], strict=True):
        parts.append(flat[at : at + rows * columns].reshape(rows, columns))
        at += rows * columns
        parts.append(flat[at : at + rows])
        at += rows
    if at != flat.size:
        raise ValueError(f"{flat.size} parameters do not fill layers of {sizes}, which have {at}")
    w1, b1, w2, b2, w3, b3 = parts
    return Net(w1, b1, w2, b2, w3, b3, flat)


def make_work(net: Net, batch: int) -> Work:
    """Scratch for batches of ``batch`` samples."""
    inputs, h1, h2, outputs = net.w1.shape[1], *(len(bias) for bias in (net.b1, net.b2, net.b3))
    widths = (inputs, h1, h2, outputs, h1, h2, outputs)
    arrays: list[Any] = [np.zeros((batch, width), np.float32) for width in widths]
    gradients = view_net(np.zeros_like(net.flat), (inputs, h1, h2, outputs))
    return Work._make([*arrays, gradients])


# What may stand after hidden layers and after the output, by the names of ONNX operators.
_OPERATORS: dict[str, Callable[[Any], Any]] = {
    "Relu": lambda x: np.maximum(x, np.float32(0.0)),
    "Tanh": np.tanh,
    "Clip": lambda x: np.clip(x, -1.0, 1.0),
    "Hardmax": lambda x: np.eye(x.shape[-1])[x.argmax(axis=-1)],
}


def nearest(actions: Any, levels: Any) -> Any:
    """Places (n, 1) in a list of numbers of those nearest to actions (n, 1)."""
    return abs(np.asarray(actions) - np.asarray(levels)).argmin(axis=1, keepdims=True)


def act(net: Net, features: Any, operators: tuple[str, str] = ("Relu", "Tanh")) -> Any:
    """A policy's actions (n, m) in [-1, 1] for features (n, k).

    ``operators`` stand after the hidden layers and after the output: Relu, Tanh, Clip (to +-1) or
    Hardmax (1 for the first of the largest, else 0).
    """
    hidden, output = (_OPERATORS[name] for name in operators)
    h1 = hidden(features.astype(np.float32) @ net.w1.T + net.b1)
    h2 = hidden(h1 @ net.w2.T + net.b2)
    return output(h2 @ net.w3.T + net.b3).astype(np.float64)


def make_moments(size: int) -> Moments:
    """Adam's state before the first update."""
    return Moments(np.zeros(size, np.float32), np.zeros(size, np.float32), np.zeros(1, np.int64))


@fast
def _bias_relu(h: Any, b: Any) -> None:
    for i in range(h.shape[0]):
        for j in range(h.shape[1]):
            value = h[i, j] + b[j]
            h[i, j] = value if value > 0.0 else np.float32(0.0)


@fast
def forward(net: Net, work: Work) -> None:
    """Fill ``work.y`` with network(``work.x``), keeping the hidden layers for the way back."""
    np.dot(work.x, net.w1.T, work.h1)
    _bias_relu(work.h1, net.b1)
    np.dot(work.h1, net.w2.T, work.h2)
    _bias_relu(work.h2, net.b2)
    for i in range(work.x.shape[0]):
        for o in range(work.y.shape[1]):
            total = net.b3[o]
            for j in range(work.h2.shape[1]):
                total += work.h2[i, j] * net.w3[o, j]
            work.y[i, o] = total


@fast
def back_hidden(net: Net, work: Work) -> None:
    """Gradients at the hidden layers' inputs from the gradient at the output, ``work.dy``."""
    d1, d2, dy = work.d1, work.d2, work.dy
    for i in range(dy.shape[0]):
        for j in range(d2.shape[1]):
            d2[i, j] = dy[i, 0] * net.w3[0, j] if work.h2[i, j] > 0.0 else np.float32(0.0)
        for o in range(1, dy.shape[1]):
            for j in range(d2.shape[1]):
                if work.h2[i, j] > 0.0:
                    d2[i, j] += dy[i, o] * net.w3[o, j]
    np.dot(d2, net.w2, d1)
    for i in range(dy.shape[0]):
        for j in range(d1.shape[1]):
            if work.h1[i, j] <= 0.0:
                d1[i, j] = np.float32(0.0)


@fast
def weight_gradients(work: Work) -> None:
    """Gradients of all weights from those at the layers' inputs; sums over the batch."""
    d1, d2, dy, grad = work.d1, work.d2, work.dy, work.grad
    np.dot(d1.T, work.x, grad.w1)
    np.dot(d2.T, work.h1, grad.w2)
    grad.b1[:] = np.float32(0.0)
    grad.b2[:] = np.float32(0.0)
    grad.w3[:] = np.float32(0.0)
    grad.b3[:] = np.float32(0.0)
    for i in range(dy.shape[0]):
        for j in range(d1.shape[1]):
            grad.b1[j] += d1[i, j]
        for j in range(d2.shape[1]):
            grad.b2[j] += d2[i, j]
        for o in range(dy.shape[1]):
            grad.b3[o] += dy[i, o]
            for j in range(d2.shape[1]):
                grad.w3[o, j] += dy[i, o] * work.h2[i, j]


@fast
def adam(weights: Any, gradient: Any, moments: Moments, rate: float) -> None:
    """One step of Adam in torch's arrangement (bias corrections in double precision)."""
    moments.count[0] += 1
    count = moments.count[0]
    step = np.float32(rate / (1.0 - 0.9**count))
    root = np.float32(1.0 / math.sqrt(1.0 - 0.999**count))
    first, second = moments.first, moments.second
    for i in range(weights.shape[0]):
        g = gradient[i]
        first[i] += (_ONE - _BETA1) * (g - first[i])
        second[i] = _BETA2 * second[i] + (_ONE - _BETA2) * g * g
        weights[i] -= step * first[i] / (np.sqrt(second[i]) * root + _EPS)


@fast
def descend(net: Net, moments: Moments, rate: float, work: Work) -> None:
    """One step of Adam down the gradient at the output, ``work.dy``."""
    back_hidden(net, work)
    weight_gradients(work)
    adam(net.flat, work.grad.flat, moments, rate)


class Draw(NamedTuple):
    """Which samples each update learns from; the first three are (updates, B)."""

    rows: Any
    """Row of the samples (int64)."""
    envs: Any
    """Vehicle (int64)."""
    sides: Any
    """1: the sample itself; -1: its mirror image, left for right (float32)."""
    mirror: Any
    """(features,) factor on each feature that mirrors it (float32)."""
    turned: Any
    """(actions,) likewise for each action."""


@fast
def gather(source: Any, draw: Draw, k: int, out: Any) -> None:
    """Observations of update ``k`` out of (rows, vehicles, features); side -1 mirrored."""
    for i in range(out.shape[0]):
        row, env, mirrored = draw.rows[k, i], draw.envs[k, i], draw.sides[k, i] < 0.0
        for j in range(source.shape[2]):
            value = source[row, env, j]
            out[i, j] = value * draw.mirror[j] if mirrored else value


@fast
def follow(slow: Any, own: Any, tau: float) -> None:
    """Move a target's weights by the share ``tau`` towards a network's own."""
    share = np.float32(tau)
    for i in range(slow.shape[0]):
        slow[i] += share * (own[i] - slow[i])


class WeightAverage:
    """Running mean of one flat array of weights.

    Weights that keep moving around a good place are, on average, nearer to it than any of them.
    The mean weaves less than single policies of one training do.
    """

    def __init__(self, size: int) -> None:
        """Begin without any weights."""
        self._mean = np.zeros(size)
        self._count = np.zeros(1, np.int64)

    def add(self, weights: Any) -> None:
        """Take the present ``weights`` (size,) into the mean."""
        self._count[0] += 1
        self._mean += (weights - self._mean) / self._count[0]

    @contextmanager
    def within(self, weights: Any) -> Iterator[None]:
        """Put the mean in the place of ``weights`` inside the block, if anything was added."""
        if not self._count[0]:
            yield
            return
        own = weights.copy()
        weights[:] = self._mean
        try:
            yield
        finally:
            weights[:] = own

    def arrays(self) -> dict[str, Any]:
        """All that changes."""
        return {"mean": self._mean, "count": self._count}

    def restore(self, saved: Tree) -> None:
        """Go on from what ``arrays`` gave."""
        fill(self.arrays(), saved)
