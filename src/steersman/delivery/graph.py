"""The network in an ONNX file as plain arrays, and how close a copy of it has to be."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from steersman.delivery.operations import COMMUTATIVE, OPERATORS, Operation, Single
from steersman.errors import DataError, one_line
from steersman.types import FloatArray

# Largest difference of an action that float64 and a careful float32 may have.
TOLERANCE = 1e-6
# Sizes of scaled features; a car at speed has about 0.1 to 1, 100 is where they are clipped.
SIZES = (0.0, 1e-42, 1e-30, 1e-10, 1e-4, 0.01, 0.1, 1.0, 10.0, 100.0, 1e4, 1e12, 1e30)
_GEMM = {"alpha": 1.0, "beta": 1.0, "transA": 0, "transB": 0}
_PRODUCTS = ("Gemm", "MatMul")


class Layer(NamedTuple):
    """One fully connected layer."""

    weights: Single
    """(outputs, inputs)"""
    bias: Single
    """(outputs,)"""
    after: tuple[Operation, ...]
    """What is done with its sums, one after the other."""


class Network(NamedTuple):
    """features -> head, number by number in float32 -> layers -> action."""

    features: int
    head: tuple[Operation, ...]
    layers: tuple[Layer, ...]

    @property
    def scale(self) -> Single:
        """The factor on each feature (n,), by the first operator."""
        first = self.head[0] if self.head else Operation("Identity")
        known = first.numbers[0] if first.name == "Mul" else np.ones(1, np.float32)
        return np.broadcast_to(known, self.features)

    @property
    def actions(self) -> int:
        """How many actions it gives."""
        return len(self.layers[-1].bias)


def read_network(data: bytes, name: str) -> Network:
    """The network in an ONNX file: a chain of layers, with operators before and between them.

    Raises:
        DataError: the file is no ONNX, or another kind of network.
    """
    import onnx
    from onnx import numpy_helper

    try:
        graph = onnx.load_from_string(data).graph
        values = {each.name: numpy_helper.to_array(each) for each in graph.initializer}
        for node in graph.node:
            if node.op_type == "Constant":
                value = onnx.helper.get_attribute_value(node.attribute[0])
                tensor = isinstance(value, onnx.TensorProto)
                known = numpy_helper.to_array(value) if tensor else np.asarray(value, np.float32)
                values[node.output[0]] = known
    except Exception as error:  # noqa: BLE001 - the parser's exceptions share no base class
        raise DataError(f"{name}: not an ONNX file: {one_line(str(error))[:160]}") from None
    try:
        nodes = [each for each in graph.node if each.op_type != "Constant"]
        return _Reader(nodes, values).read(graph.input[0].name, graph.output[0].name)
    except (KeyError, IndexError, ValueError) as error:
        raise DataError(f"{name}: not a network of which C can be made: {error}") from None


class _Reader:
    """Goes along the chain of nodes."""

    def __init__(self, nodes: list[Any], values: dict[str, Any]) -> None:
        self.nodes, self.values = nodes, values
        self.head: list[Operation] = []
        self.layers: list[Layer] = []

    def read(self, start: str, end: str) -> Network:
        flow = start
        for i, node in enumerate(self.nodes):
            if flow not in node.input:
                raise ValueError(f"node {i}, {node.op_type}, does not continue the chain")
            self._take(node, flow)
            flow = node.output[0]
        if flow != end or not self.layers:
            raise ValueError("its nodes are no chain of layers")
        network = Network(self.layers[0].weights.shape[1], tuple(self.head), tuple(self.layers))
        _check_sizes(network)
        return network

    def _take(self, node: Any, flow: str) -> None:
        if node.op_type in _PRODUCTS:
            self.layers.append(self._layer(node, flow))
            return
        operation = self._operation(node, flow)
        if not self.layers:
            self.head.append(operation)
            return
        last = self.layers[-1]
        if operation.name == "Add" and not last.after:  # as MatMul has its bias
            bias = last.bias + operation.numbers[0]
            self.layers[-1] = last._replace(bias=bias.astype(np.float32))
        else:
            self.layers[-1] = last._replace(after=(*last.after, operation))

    def _layer(self, node: Any, flow: str) -> Layer:
        given = {a.name: a.f if a.name in {"alpha", "beta"} else a.i for a in node.attribute}
        if {**_GEMM, **given, "transB": 0} != _GEMM or node.input[0] != flow:
            raise ValueError(f"a {node.op_type} with {given}")
        weights = self._single(node.input[1])
        weights = weights if given.get("transB") else weights.T
        bias = np.zeros(len(weights), np.float32)
        if len(node.input) > 2:  # noqa: PLR2004 - the third is the bias
            bias = bias + self._single(node.input[2]).reshape(-1)
        return Layer(weights, bias, ())

    def _operation(self, node: Any, flow: str) -> Operation:
        name = node.op_type
        if name == "Hardmax":
            raise ValueError("it chooses among actions (Hardmax, as of agent dqn), which C cannot")
        if name not in OPERATORS:
            raise ValueError(f"operator {name!r}")
        attributes = {a.name: a.f for a in node.attribute}
        if OPERATORS[name].attributes:
            known = {**OPERATORS[name].attributes, **attributes}
            numbers = [known[each] for each in OPERATORS[name].attributes]
            return Operation(name, tuple(np.array([x], np.float32) for x in numbers))
        others = list(node.input)
        place = others.index(flow)
        if place > 0 and name not in COMMUTATIVE:
            raise ValueError(f"{name} of a constant and the row")
        del others[place]
        if name == "Clip":
            return Operation(name, self._bounds(others, attributes))
        if any(each not in self.values for each in others):
            raise ValueError(f"{name} of two rows that the network computes")
        return Operation(name, tuple(self._single(each).reshape(-1) for each in others))

    def _bounds(self, names: list[str], attributes: dict[str, float]) -> tuple[Single, Single]:
        most = float(np.finfo(np.float32).max)
        low, high = attributes.get("min", -most), attributes.get("max", most)
        given = [self._single(each).reshape(1) if each else None for each in names]
        bounds = [*given, None, None][:2]
        default = (np.array([x], np.float32) for x in (low, high))
        least, greatest = (x if x is not None else y for x, y in zip(bounds, default, strict=True))
        return least, greatest

    def _single(self, name: str) -> Single:
        value = np.asarray(self.values[name])
        if value.dtype != np.float32 or not np.isfinite(value).all():
            raise ValueError(f"{name} is not finite float32")
        return value


def _check_sizes(network: Network) -> None:
    size = network.features
    for i, layer in enumerate(network.layers):
        if layer.weights.shape != (layer.bias.size, size) or layer.bias.ndim != 1:
            raise ValueError(f"layer {i + 1}: weights {layer.weights.shape} on {size} values")
        size = layer.bias.size
    widths = [(network.features, network.head)]
    widths += [(each.bias.size, each.after) for each in network.layers]
    for size, operations in widths:
        for name, numbers in operations:
            if any(each.size not in {1, size} for each in numbers):
                raise ValueError(f"{name} of {size} values with {[x.size for x in numbers]}")


def normalised(network: Network, features: Single) -> Single:
    """What the first layer sees (rows, n) of raw features, in the file's own float32."""
    flow = features
    for operation in network.head:
        flow = operation(flow)
    return flow


def exact(network: Network, features: Single) -> FloatArray:
    """Actions (rows, m) without the rounding of float32 behind the head."""
    flow = normalised(network, features).astype(np.float64)
    for layer in network.layers:
        flow = flow @ layer.weights.T.astype(np.float64) + layer.bias
        for operation in layer.after:
            flow = operation(flow)
    return flow


class ExactNetwork:
    """A network in float64 behind the head, as a function of features (1, n)."""

    def __init__(self, network: Network) -> None:
        """Keep it."""
        self.network = network

    def __call__(self, features: Single) -> FloatArray:
        """The actions (m,)."""
        answer: FloatArray = exact(self.network, features)[0]
        return answer


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
        for operation in layer.after:
            flow = operation(flow)
            error = error * operation.slope + 4.0 * unit * abs(flow)
    bound: FloatArray = error.max(axis=1)
    return bound
