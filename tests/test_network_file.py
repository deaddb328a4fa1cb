"""What an ONNX file may hold to be run: layers on one row, and nothing else."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from steersman.errors import DataError
from steersman.network_file import MOST_NODES, PolicyNetwork, check_network
from steersman.policy_file import locate

onnx = pytest.importorskip("onnx")
helper: Any = pytest.importorskip("onnx.helper")


def _tensor(name: str, *shape: int) -> Any:
    values = np.linspace(-1.0, 1.0, int(np.prod(shape))).reshape(shape)
    return onnx.numpy_helper.from_array(values.astype(np.float32), name)


def _model(nodes: list[Any], *tensors: Any, **more: Any) -> Any:
    value = helper.make_tensor_value_info
    graph = helper.make_graph(
        nodes,
        "g",
        [value("x", onnx.TensorProto.FLOAT, [None, 3])],
        [value("y", onnx.TensorProto.FLOAT, [None, 1])],
        list(tensors),
    )
    model = helper.make_model(graph, opset_imports=[helper.make_opsetid("", 17)], **more)
    model.ir_version = 8
    return model


def _node(kind: str, *names: str, **attributes: Any) -> Any:
    return helper.make_node(kind, list(names[:-1]), [names[-1]], **attributes)


def _loop() -> Any:
    body = helper.make_graph([_node("Identity", "c", "d")], "b", [], [])
    return _model([_node("Loop", "x", "", "x", "y", body=body)])


def _elsewhere() -> Any:
    weights = _tensor("w", 3, 1)
    model = _model([_node("MatMul", "x", "w", "y")], weights)
    onnx.external_data_helper.set_external_data(model.graph.initializer[0], "secret.bin")
    return model


def _attribute(kind: str, **attributes: Any) -> Any:
    return _model([_node(kind, "x", "y", **attributes)])


REFUSED = {
    "loop": (_loop, "'Loop' is none"),
    "external": (_elsewhere, "holds field 1[34]"),
    "expand": (lambda: _model([_node("Expand", "x", "s", "y")], _tensor("s", 2)), "'Expand'"),
    "constant": (
        lambda: _model([_node("Constant", "x", "y", value=_tensor("v", 3))]),
        "is not one tensor",
    ),
    "constant matrix": (
        lambda: _model(
            [_node("Constant", "c", value=_tensor("v", 3, 3)), _node("Add", "x", "c", "y")]
        ),
        "expected one row",
    ),
    "function": (
        lambda: _model(
            [_node("Relu", "x", "y")],
            functions=[
                helper.make_function(
                    "d", "F", ["a"], ["b"], [_node("Relu", "a", "b")], [helper.make_opsetid("", 17)]
                )
            ],
        ),
        "field 25",
    ),
    "foreign": (lambda: _attribute("Relu", domain="com.microsoft"), "'Relu' is none"),
    "graph in an attribute": (
        lambda: _attribute("Relu", g=helper.make_graph([], "g", [], [])),
        "attribute holds field 6",
    ),
    "outer": (lambda: _model([_node("Mul", "x", "c", "y")], _tensor("c", 5, 1)), r"shape \(5, 1\)"),
    "turned": (
        lambda: _model([_node("Gemm", "x", "w", "y", transA=1)], _tensor("w", 1, 9)),
        "no product of a row",
    ),
    "product of rows": (lambda: _model([_node("MatMul", "x", "x", "y")]), "no product of a row"),
    "turned around": (
        lambda: _model([_node("MatMul", "w", "x", "y")], _tensor("w", 9, 1)),
        "no product of a row",
    ),
    "without inputs": (lambda: _model([_node("Gemm", "y")]), "no product of a row"),
    "many": (
        lambda: _model([_node("Relu", "x", "y") for _ in range(MOST_NODES + 1)]),
        "1 to 100 are allowed",
    ),
    "two of a name": (
        lambda: _model([_node("MatMul", "x", "w", "y")], _tensor("w", 3, 1), _tensor("w", 3, 9)),
        "two tensors",
    ),
}


@pytest.mark.parametrize("name", REFUSED)
def test_more_than_layers_is_refused(name: str) -> None:
    make, said = REFUSED[name]
    with pytest.raises(DataError, match=said) as caught:
        PolicyNetwork(make().SerializeToString(), "n.onnx", 3)
    assert "\n" not in str(caught.value)


def test_ordinary_networks_run() -> None:
    nodes = [
        _node("Gemm", "x", "w", "b", "h", transB=1),
        _node("Elu", "h", "e"),
        _node("Add", "e", "h", "r"),
        _node("MatMul", "r", "v", "y"),
    ]
    model = _model(nodes, _tensor("w", 4, 3), _tensor("b", 4), _tensor("v", 4, 1))
    run = PolicyNetwork(model.SerializeToString(), "n.onnx", 3)
    assert np.isfinite(run(np.ones((1, 3), np.float32)))


def test_damaged_bytes_are_refused_or_read() -> None:
    """Whatever byte is wrong: an answer or one line, from the check alone."""
    data = locate("precision").read_bytes()
    check_network(data, "precision")
    rng = np.random.default_rng(0)
    for _ in range(300):
        broken = bytearray(data[:4000])
        broken[int(rng.integers(len(broken)))] = int(rng.integers(256))
        with pytest.raises(DataError):  # it ends in the middle, at least
            check_network(bytes(broken), "n.onnx")
