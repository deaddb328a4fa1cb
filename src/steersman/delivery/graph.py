"""The network in an ONNX file as plain arrays, and how close a copy of it has to be."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from steersman.errors import DataError, one_line
from steersman.types import FloatArray

Single = NDArray[np.float32]
RELU, TANH, CLIP, NONE = "Relu", "Tanh", "Clip", "none"
# Largest difference of an action that float64 and a careful float32 may have.
TOLERANCE = 1e-6
# Sizes of scaled features; a car at speed has about 0.1 to 1, 100 is where they are clipped.
SIZES = (0.0, 1e-42, 1e-30, 1e-10, 1e-4, 0.01, 0.1, 1.0, 10.0, 100.0, 1e4, 1e12, 1e30)
_GEMM = {"alpha": 1.0, "beta": 1.0, "transA": 0, "transB": 0}


class Layer(NamedTuple):
    """One fully connected layer."""

    weights: Single
    """(outputs, inputs)"""
    bias: Single
    """(outputs,)"""
    activation: str
    """RELU, TANH, CLIP to +-1, or NONE."""


class Network(NamedTuple):
    """clip(features x scale, -limit, limit) -> layers -> action."""

    scale: Single
    limit: float
    layers: tuple[Layer, ...]


def read_network(data: bytes, name: str) -> Network:
    """The network that ``steersman train`` and ``imitate`` write.

    Raises:
        DataError: the file is no ONNX, or another kind of network.
    """
    import onnx
    from onnx import numpy_helper

    try:
        graph = onnx.load_from_string(data).graph
        values = {each.name: numpy_helper.to_array(each) for each in graph.initializer}
    except Exception as error:  # noqa: BLE001 - the parser's exceptions share no base class
        raise DataError(f"{name}: not an ONNX file: {one_line(str(error))[:160]}") from None
    try:
        return _Reader(list(graph.node), values).read(graph.input[0].name, graph.output[0].name)
    except (KeyError, IndexError, ValueError) as error:
        raise DataError(f"{name}: not a network of steersman's own: {error}") from None


class _Reader:
    """Goes along the chain of nodes."""

    def __init__(self, nodes: list[Any], values: dict[str, Any]) -> None:
        self.nodes, self.values, self.at = nodes, values, 0

    def read(self, start: str, end: str) -> Network:
        flow = start
        scaled, flow = self._take("Mul", flow)
        scale = self._single(scaled.input[1])
        clip, flow = self._take("Clip", flow)
        low, high = (float(self._single(each)) for each in clip.input[1:3])
        if not -low == high > 0.0:
            raise ValueError(f"clips its input to [{low:g}, {high:g}]")
        layers = []
        while self.at < len(self.nodes):
            layer, flow = self._layer(flow)
            layers.append(layer)
        if flow != end or not layers:
            raise ValueError("its nodes are no chain")
        network = Network(scale, high, tuple(layers))
        _check_sizes(network)
        return network

    def _layer(self, flow: str) -> tuple[Layer, str]:
        node, flow = self._take("Gemm", flow)
        given = {a.name: a.f if a.name in {"alpha", "beta"} else a.i for a in node.attribute}
        if {**_GEMM, **given} != {**_GEMM, "transB": 1}:
            raise ValueError(f"a Gemm with {given}")
        weights, bias = self._single(node.input[1]), self._single(node.input[2])
        activation = NONE
        if self.at < len(self.nodes) and self.nodes[self.at].op_type in {RELU, TANH, CLIP}:
            activation = self.nodes[self.at].op_type
            then, flow = self._take(activation, flow)
            bounds = [float(self._single(each)) for each in then.input[1:]]
            if activation == CLIP and bounds != [-1.0, 1.0]:
                raise ValueError(f"clips its output to {bounds}")
        return Layer(weights, bias, activation), flow

    def _take(self, kind: str, flow: str) -> tuple[Any, str]:
        node = self.nodes[self.at]
        if node.op_type != kind or node.input[0] != flow:
            raise ValueError(f"node {self.at} is {node.op_type}, where {kind} is expected")
        self.at += 1
        return node, node.output[0]

    def _single(self, name: str) -> Single:
        value = np.asarray(self.values[name])
        if value.dtype != np.float32 or not np.isfinite(value).all():
            raise ValueError(f"{name} is not finite float32")
        return value


def _check_sizes(network: Network) -> None:
    size = network.scale.size
    if network.scale.shape != (size,):
        raise ValueError(f"a scale of shape {network.scale.shape}")
    for i, layer in enumerate(network.layers):
        if layer.weights.shape != (layer.bias.size, size) or layer.bias.ndim != 1:
            raise ValueError(f"layer {i + 1}: weights {layer.weights.shape} on {size} values")
        size = layer.bias.size


def normalised(network: Network, features: Single) -> Single:
    """What the first layer sees (rows, n) of raw features, in the file's own float32."""
    limit = np.float32(network.limit)
    with np.errstate(over="ignore"):
        clipped: Single = np.clip(features * network.scale, -limit, limit)
    return clipped


def exact(network: Network, features: Single) -> FloatArray:
    """Actions (rows, m) without the rounding of float32 behind the scaled features."""
    flow = normalised(network, features).astype(np.float64)
    for layer in network.layers:
        flow = flow @ layer.weights.T.astype(np.float64) + layer.bias
        flow = activated(layer.activation, flow)
    return flow


class ExactNetwork:
    """A network in float64 behind the scaled features, as a function of features (1, n)."""

    def __init__(self, network: Network) -> None:
        """Keep it."""
        self.network = network

    def __call__(self, features: Single) -> FloatArray:
        """The actions (m,)."""
        answer: FloatArray = exact(self.network, features)[0]
        return answer


def activated(activation: str, values: Any) -> Any:
    """``values`` behind an activation."""
    if activation == RELU:
        return np.maximum(values, 0.0)
    if activation == TANH:
        return np.tanh(values)
    return np.clip(values, -1.0, 1.0) if activation == CLIP else values


def random_features(scale: Single, count: int, seed: int = 0) -> Single:
    """Raw features (count, n), extremes included: every size, all sizes mixed, signed bounds."""
    rng = np.random.default_rng(seed)
    sizes = np.resize(np.array(SIZES), count)[:, None] * np.ones(scale.size)
    mixed = np.arange(count) % 4 == 3  # noqa: PLR2004 - every fourth row
    sizes[mixed] = 10.0 ** rng.uniform(-8.0, 4.0, (int(mixed.sum()), scale.size))
    rows = rng.normal(size=(count, scale.size)) * sizes / scale
    largest = np.arange(count) % 101 == 100  # noqa: PLR2004 - now and then, out of step
    limit = float(np.finfo(np.float32).max)
    rows[largest] = rng.choice([-limit, 0.0, limit], (int(largest.sum()), scale.size))
    return np.clip(rows, -limit, limit).astype(np.float32)


def rounding(network: Network, features: Single) -> FloatArray:
    """How far any float32 evaluation of a row may be from the exact action, to first order.

    The classical bound: a sum of n products errs by at most n u sum |w x|, and errors before are
    carried on by |w| (Higham, "Accuracy and Stability of Numerical Algorithms", 2002, sec. 3.1).
    """
    unit = float(np.finfo(np.float32).eps) / 2.0
    flow = normalised(network, features).astype(np.float64)
    error = np.zeros_like(flow)
    for layer in network.layers:
        weights = abs(layer.weights).T.astype(np.float64)
        size = abs(flow) @ weights + abs(layer.bias)
        error = error @ weights + (len(weights) + 1) * unit * size
        flow = flow @ layer.weights.T.astype(np.float64) + layer.bias
        flow = activated(layer.activation, flow)
        error = error + 4.0 * unit * abs(flow)
    bound: FloatArray = error.max(axis=1)
    return bound
