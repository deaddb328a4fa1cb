"""Whether an ONNX file is a network that a policy may be, before ONNX Runtime sees it.

ONNX is a language: it has loops, tensors in other files, and operators that turn a few bytes into
gigabytes. A policy needs layers on one row of features. So what it may hold is listed, and all
else is refused. With these operators a row stays one row, as wide as a tensor of the file, so
time and memory are bounded by the size of the file.

The file is read by the rules of https://protobuf.dev/programming-guides/encoding, its fields are
those of https://github.com/onnx/onnx/blob/main/onnx/onnx.proto.
"""

from __future__ import annotations

import itertools
import math
from collections import defaultdict
from collections.abc import Iterator
from typing import Any, TypeAlias

import numpy as np

from steersman.errors import DataError, one_line, shortened

MOST_BYTES, MOST_NODES = 20_000_000, 100
"""Largest file [bytes], and the most operators in it."""
ROW_BY_ROW = frozenset(
    (
        *(
            "Abs",
            "Add",
            "Clip",
            "Div",
            "Elu",
            "Gelu",
            "Hardmax",
            "HardSigmoid",
            "Identity",
            "Max",
            "Min",
        ),
        *("LayerNormalization", "LeakyRelu", "Mul", "Neg", "Relu", "Selu", "Sigmoid"),
        *("Softplus", "Softsign", "Sub", "Tanh"),
    )
)
"""Operators that leave a row as wide as it is, or as wide as a tensor that is added to it."""
PRODUCTS = frozenset(("Gemm", "MatMul"))
"""Products of a row with a matrix of the file."""
# Fields that may be there, by their numbers.
_MODEL = {*range(1, 9), 14}
_GRAPH = {1, 2, 5, 10, 11, 12, 13, 16}
_NODE = {*range(1, 8), 9}
_ATTRIBUTE = {1, 2, 3, 4, 7, 8, 13, 20}
_TENSOR = {1, 2, 4, 5, 7, 8, 9, 10, 12, 16}
_GRAPH_OF_MODEL, _NODES, _TENSORS = 7, 1, 5
_INPUTS, _OUTPUTS, _OPERATOR, _ATTRIBUTES, _DOMAIN = 1, 2, 4, 5, 7
_ATTRIBUTE_NAME, _ATTRIBUTE_INTEGER, _ATTRIBUTE_TENSOR = 1, 3, 5
_DIMENSIONS, _TENSOR_NAME = 1, 8
# Kinds of fields on the wire.
_VARINT, _EIGHT, _SIZED, _FOUR = 0, 1, 2, 5
_MATRIX = 2
_MOST_VALUES, _MOST_DIMENSIONS = 10_000, 8

Value: TypeAlias = "int | memoryview"
Message: TypeAlias = "dict[int, list[Value]]"


def check_network(data: bytes, name: str) -> None:
    """Refuse a file that holds anything but layers.

    Raises:
        DataError: it does, or is no ONNX file; ``name`` is the file's.
    """
    if len(data) > MOST_BYTES:
        raise DataError(
            f"{name}: is larger than {MOST_BYTES // 1_000_000} MB, the most for a policy"
        )
    try:
        model = _message(memoryview(data), _MODEL, "model")
        graphs = [_message(_bytes(v), _GRAPH, "graph") for v in model[_GRAPH_OF_MODEL]]
        tensors = dict[str, tuple[int, ...]]()
        for each in _inner(graphs, _TENSORS):
            tensor = _message(each, _TENSOR, "tensor")
            shape = _shape(tensor)
            for label in map(_text, tensor[_TENSOR_NAME]):
                if label in tensors:
                    raise ValueError(f"two tensors are called {shortened(label)!r}")
                tensors[label] = shape
        nodes = [_message(each, _NODE, "operator") for each in _inner(graphs, _NODES)]
        _add_constants(nodes, tensors)
        if not nodes or len(nodes) > MOST_NODES:
            raise ValueError(f"{len(nodes)} operators; 1 to {MOST_NODES} are allowed")
        for node in nodes:
            if not _is_constant(node):
                _check(node, tensors)
    except (ValueError, IndexError) as error:
        raise DataError(f"{name}: not a network of layers: {error}") from None


def _shape(tensor: Message) -> tuple[int, ...]:
    return tuple(itertools.islice(_integers(tensor[_DIMENSIONS]), _MOST_DIMENSIONS))


def _is_constant(node: Message) -> bool:
    return [_text(v) for v in node[_OPERATOR]] == ["Constant"]


def _add_constants(nodes: list[Message], tensors: dict[str, tuple[int, ...]]) -> None:
    """Add the shapes of the tensors of the operators Constant, which are as those of the file."""
    for node in filter(_is_constant, nodes):
        shapes: list[tuple[int, ...]] = []
        for value in node[_ATTRIBUTES]:
            attribute = _message(_bytes(value), _ATTRIBUTE | {_ATTRIBUTE_TENSOR}, "attribute")
            given = [_message(_bytes(v), _TENSOR, "tensor") for v in attribute[_ATTRIBUTE_TENSOR]]
            some = [
                itertools.islice(_integers(each[_DIMENSIONS]), _MOST_DIMENSIONS) for each in given
            ]
            shapes += [tuple(each) for each in some] or [()]
        outputs = [_text(v) for v in node[_OUTPUTS]]
        if len(shapes) != 1 or len(outputs) != 1 or node[_INPUTS] or node[_DOMAIN]:
            raise ValueError("a Constant that is not one tensor")
        if outputs[0] in tensors:
            raise ValueError(f"two tensors are called {shortened(outputs[0])!r}")
        tensors[outputs[0]] = shapes[0]


def _check(node: Message, tensors: dict[str, tuple[int, ...]]) -> None:
    """Refuse an operator that could make a row into more than a row."""
    kind, *more = [_text(v) for v in node[_OPERATOR]] or [""]
    domains = {_text(v) for v in node[_DOMAIN]}
    if more or kind not in ROW_BY_ROW | PRODUCTS or domains - {"", "ai.onnx"}:
        raise ValueError(f"operator {shortened(kind)!r} is none that a policy needs")
    attributes = [_message(_bytes(v), _ATTRIBUTE, "attribute") for v in node[_ATTRIBUTES]]
    given = [(name, tensors.get(name)) for name in map(_text, node[_INPUTS])]
    if kind in PRODUCTS:
        shapes = [shape for _, shape in given[:_MATRIX]]
        turned = any(
            "transA" in map(_text, each[_ATTRIBUTE_NAME]) and any(each[_ATTRIBUTE_INTEGER])
            for each in attributes
        )
        if turned or [shape and len(shape) for shape in shapes] != [None, _MATRIX]:
            raise ValueError(f"{kind} is no product of a row with a matrix of the file")
        given = given[_MATRIX:]
    for name, shape in given:
        if shape and math.prod(shape) != shape[-1]:
            raise ValueError(f"{shortened(name)!r} has the shape {shape}, expected one row")


def _inner(messages: list[Message], field: int) -> Iterator[memoryview]:
    return (_bytes(value) for message in messages for value in message[field])


def _message(data: memoryview, allowed: set[int], what: str) -> Message:
    """The values of a message by the numbers of their fields, every one that is there."""
    found: Message = defaultdict(list)
    at = 0
    while at < len(data):
        key, at = _varint(data, at)
        field, wire = key >> 3, key & 7
        if field not in allowed:
            raise ValueError(f"its {what} holds field {field}, which no policy needs")
        value: Value
        if wire == _VARINT:
            value, at = _varint(data, at)
        elif wire in {_EIGHT, _FOUR, _SIZED}:
            size, at = _varint(data, at) if wire == _SIZED else (8 if wire == _EIGHT else 4, at)
            if size > len(data) - at:
                raise ValueError(f"its {what} ends in the middle")
            value, at = data[at : at + size], at + size
        else:
            raise ValueError("not an ONNX file")
        found[field].append(value)
        if len(found[field]) > _MOST_VALUES:
            raise ValueError(f"its {what} holds more than {_MOST_VALUES} values")
    return found


def _varint(data: memoryview, at: int) -> tuple[int, int]:
    """A number in groups of seven bits, and where it ends."""
    value = 0
    for shift in range(0, 70, 7):
        byte = data[at]
        at += 1
        value |= (byte & 0x7F) << shift
        if byte < 0x80:  # noqa: PLR2004 - the last group has no mark
            return value, at
    raise ValueError("not an ONNX file")


def _integers(values: list[Value]) -> Iterator[int]:
    """Numbers of a repeated field, packed or one by one."""
    for value in values:
        if isinstance(value, int):
            yield value
            continue
        at = 0
        while at < len(value):
            number, at = _varint(value, at)
            yield number


def _bytes(value: Value) -> memoryview:
    if isinstance(value, int):
        raise ValueError("not an ONNX file")
    return value


def _text(value: Value) -> str:
    return bytes(_bytes(value)).decode("utf-8", "replace")


class PolicyNetwork:
    """The network in an ONNX file, a function of features (1, n), float32; a copy reads it anew."""

    def __init__(self, data: bytes, name: str, features: int, actions: int = 1) -> None:
        """Read the content of the file ``name``.

        Raises:
            DataError: it holds more than layers, ONNX Runtime cannot read it, or it does not map
                that many features to that many actions.
        """
        import onnxruntime

        check_network(data, name)
        self.made_of = (data, name, features, actions)
        options = onnxruntime.SessionOptions()
        options.intra_op_num_threads = options.inter_op_num_threads = 1
        options.log_severity_level = 3
        given = {"providers": ["CPUExecutionProvider"]}
        try:
            self._session = onnxruntime.InferenceSession(data, options, **given)
        except Exception as error:  # noqa: BLE001 - its exceptions share no base class
            line = one_line(str(error))
            raise DataError(f"{name}: not a network that ONNX reads: {line[:160]}") from None
        self._entry = self._session.get_inputs()[0].name
        try:
            shape = self(np.zeros((1, features), dtype=np.float32)).shape
        except Exception as error:  # noqa: BLE001 - its exceptions share no base class
            line = one_line(str(error))
            raise DataError(
                f"{name}: does not map {features} features to an action: {line[:160]}"
            ) from None

        if shape != (actions,):
            raise DataError(f"{name}: gives actions of shape {shape}, but its card has {actions}")

    def __call__(self, x: Any) -> Any:
        """The actions (m,) for features (1, n), float32."""
        return self._session.run(None, {self._entry: x})[0][0]

    def __reduce__(self) -> tuple[type[PolicyNetwork], tuple[bytes, str, int, int]]:
        return type(self), self.made_of
