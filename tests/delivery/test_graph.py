"""Networks read from ONNX files, and what is refused."""

from __future__ import annotations

import ctypes
from collections.abc import Callable
from pathlib import Path as FilePath
from typing import Any

import numpy as np
import onnx
import pytest
import torch
from onnx import helper, numpy_helper
from torch.nn import functional

from steersman.config import build as make
from steersman.delivery.graph import (
    TOLERANCE,
    exact,
    normalised,
    random_features,
    read_network,
    rounding,
)
from steersman.delivery.operations import OPERATORS
from steersman.delivery.translate.policies import network_function
from steersman.delivery.translate.program import Program
from steersman.errors import DataError
from steersman.learning.adopt import Adoption, adopt_policy
from steersman.learning.export import network
from steersman.network_file import PolicyNetwork

from ..loops import random_net
from .building import COMPILER, STRICT, bench, build, needs_compiler, run

SCALE = np.array([0.1, 1.0, 20.0, 5.0])


@pytest.mark.parametrize("operators", [("Relu", "Tanh"), ("Tanh", "Clip"), ("Relu", "Clip")])
def test_it_answers_as_onnx_runtime_but_for_rounding(operators: tuple[str, str]) -> None:
    data = network(random_net(4, hidden=40), SCALE, operators)
    read = read_network(data, "n.onnx")
    seen = random_features(read.scale, 3000)
    run = PolicyNetwork(data, "n.onnx", 4)
    answers = np.array([run(row[None, :])[0] for row in seen])
    away = abs(answers - exact(read, seen)[:, 0])
    assert (away <= TOLERANCE + rounding(read, seen)).all()
    assert away.max() < 1e-4
    assert np.std(answers) > 0.1


def test_the_exact_answer_is_torchs_in_float64() -> None:
    net = random_net(4, hidden=40)
    read = read_network(network(net, SCALE), "n.onnx")
    seen = random_features(read.scale, 500)
    flow = torch.from_numpy(normalised(read, seen)).double()
    for weights, bias in ((net.w1, net.b1), (net.w2, net.b2)):
        flow = torch.relu(functional.linear(flow, *map(double, (weights, bias))))
    flow = torch.tanh(functional.linear(flow, *map(double, (net.w3, net.b3))))
    assert abs(exact(read, seen) - flow.numpy()).max() < 1e-12


def double(values: Any) -> torch.Tensor:
    return torch.from_numpy(values).double()


def test_a_changed_weight_is_more_than_rounding() -> None:
    read = read_network(network(random_net(4, hidden=40), SCALE), "n.onnx")
    net = random_net(4, hidden=40)
    net.w2[:] *= 1.01
    other = read_network(network(net, SCALE), "n.onnx")
    seen = random_features(read.scale, 3000)
    away = abs(exact(read, seen) - exact(other, seen))[:, 0]
    assert (away > TOLERANCE + rounding(read, seen)).any()


def test_random_features_hold_extremes() -> None:
    seen = random_features(SCALE.astype(np.float32), 5000)
    sizes = abs(seen[seen != 0.0])
    assert np.isfinite(seen).all()
    assert sizes.min() < 1e-38  # denormal
    assert sizes.max() > 1e38
    assert (seen == 0.0).all(axis=1).any()
    assert np.array_equal(seen, random_features(SCALE.astype(np.float32), 5000))


def altered(change: Callable[[Any], object]) -> bytes:
    model = onnx.load_from_string(network(random_net(4), SCALE))
    change(model.graph)
    return bytes(model.SerializeToString())


def _set(graph: Any, name: str, value: Any) -> None:
    for each in graph.initializer:
        if each.name == name:
            each.CopyFrom(numpy_helper.from_array(np.asarray(value), name))


OTHERS: dict[str, tuple[Callable[[Any], object], str]] = {
    "another operator": (lambda g: setattr(g.node[3], "op_type", "Gelu"), "operator 'Gelu'"),
    "a branch": (lambda g: setattr(g.node[4], "name", "") or g.node[4].input.__setitem__(0, "x"),
                 "node 4, Gemm, does not continue"),
    "double": (lambda g: _set(g, "w1", np.zeros((8, 4))), "w1 is not finite float32"),
    "not finite": (lambda g: _set(g, "b2", np.full(8, np.nan, np.float32)), "b2 is not finite"),
    "sizes": (lambda g: _set(g, "b2", np.zeros(7, np.float32)), "broadcast"),
    "of a constant": (lambda g: setattr(g.node[0], "op_type", "Div")
                      or g.node[0].input.reverse(), "Div of a constant and the row"),
    "transposed": (lambda g: g.node[2].attribute[0].CopyFrom(helper.make_attribute("transA", 1)),
                   "a Gemm with"),
    "missing weights": (lambda g: g.initializer.pop(3), "not a network of which C can be made"),
}  # fmt: skip


@pytest.mark.parametrize("name", OTHERS)
def test_other_networks_are_refused_in_one_line(name: str) -> None:
    change, message = OTHERS[name]
    with pytest.raises(DataError, match=message) as caught:
        read_network(altered(change), "n.onnx")
    assert "\n" not in str(caught.value)


@needs_compiler
@pytest.mark.parametrize("single", [True, False])
def test_every_operator_in_c(single: bool, tmp_path: FilePath) -> None:
    program, networks = Program(single=single), {}
    calls = []
    for operator in sorted(OPERATORS):
        networks[operator] = read_network(foreign(operator), operator)
        name, head = network_function(program, networks[operator]), f"void call_{operator}"
        head += "(const real *x, real *y)"
        calls.append(f"{head};\n{head}\n{{\n    {name}(x, y);\n}}\n")
    real = "float" if single else "double"
    texts = [each.text for each in program.functions.values()]
    (tmp_path / "made.c").write_text(
        f"#include <math.h>\n#include <stddef.h>\ntypedef {real} real;\n"
        + "\n".join([*program.helpers.values(), program.constants_of(texts), *texts, *calls])
    )
    flags = (*STRICT, "-O1", "-ffp-contract=off", "-shared", "-fPIC")
    run(COMPILER, *flags, "-o", "made.so", "made.c", "-lm", cwd=tmp_path)
    code = ctypes.CDLL(str(tmp_path / "made.so"))
    seen = np.random.default_rng(1).normal(size=(40, 4)).astype(np.float32)
    for operator, each in networks.items():
        given = np.ascontiguousarray(seen, np.float32 if single else np.float64)
        out = np.empty(len(given), given.dtype)
        for i in range(len(given)):
            at = given[i:].ctypes.data, out[i:].ctypes.data
            getattr(code, f"call_{operator}")(*map(ctypes.c_void_p, at))
        away = abs(out - exact(each, seen)[:, 0]).max()
        assert away < (TOLERANCE if single else 1e-12), operator


@needs_compiler
def test_an_adopted_network_leaves_as_c(tmp_path: FilePath) -> None:
    (tmp_path / "theirs.onnx").write_bytes(foreign("Selu"))
    features = ["lateral_error", "heading_error", "v_x", "yaw_rate"]
    wanted = {"encoding": {"kind": "list", "features": features}}
    file = adopt_policy(tmp_path / "theirs.onnx", make(Adoption, wanted), tmp_path / "adopted")
    compiled = build(file, tmp_path / "c")
    known = bench.known(compiled.setting, bench.drawn_rows(compiled.setting, 400))
    found = bench.parity(compiled.setting, compiled.code, known)
    assert found.other_statuses == 0
    assert found.steering <= 1e-12
    assert known.answers[:, 0].std() > 0.01


def test_no_onnx_at_all() -> None:
    with pytest.raises(DataError, match=r"n\.onnx: not a"):
        read_network(b"nothing of the kind", "n.onnx")


def chain(*nodes: Any, **tensors: Any) -> bytes:
    """An ONNX file of nodes from ``x`` (4 features) to ``y``."""
    value = helper.make_tensor_value_info
    known = [numpy_helper.from_array(np.asarray(v, np.float32), k) for k, v in tensors.items()]
    ends = [value(k, onnx.TensorProto.FLOAT, [None, n]) for k, n in (("x", 4), ("y", 1))]
    graph = helper.make_graph(list(nodes), "g", ends[:1], ends[1:], known)
    model = helper.make_model(graph, opset_imports=[helper.make_opsetid("", 17)])
    model.ir_version = 8
    return bytes(model.SerializeToString())


def foreign(operator: str, **attributes: Any) -> bytes:
    """As other tools write networks: MatMul and Add, constants as operators, statistics first."""
    rng = np.random.default_rng(3)
    numbers = numpy_helper.from_array(np.array([0.3, -0.2, 0.5, 0.1], np.float32))
    inputs = {"Clip": ["h2", "low", "high"], "Max": ["h2", "row"], "Min": ["h2", "row"]}
    given = inputs.get(operator, ["row", "h2"] if operator in {"Add", "Mul"} else ["h2"])
    given = ["h2", "row"] if operator in {"Sub", "Div"} else given
    return chain(
        helper.make_node("Constant", [], ["mean"], value=numbers),
        helper.make_node("Sub", ["x", "mean"], ["a"]),
        helper.make_node("Div", ["a", "sd"], ["b"]),
        helper.make_node("MatMul", ["b", "w1"], ["h1"]),
        helper.make_node("Add", ["b1", "h1"], ["h2"]),
        helper.make_node(operator, given, ["h3"], **attributes),
        helper.make_node("Gemm", ["h3", "w2"], ["h4"], alpha=1.0),
        helper.make_node("Tanh", ["h4"], ["y"]),
        sd=[0.5, 2.0, 1.0, 0.1], w1=rng.normal(size=(4, 6)), b1=rng.normal(size=6), low=-0.4,
        w2=0.3 * rng.normal(size=(6, 1)), high=0.9, row=rng.normal(size=(1, 6)) + 3.0,
    )  # fmt: skip


@pytest.mark.parametrize("operator", sorted(OPERATORS))
def test_every_operator_answers_as_onnx_runtime(operator: str) -> None:
    attributes = {"alpha": 0.7} if operator in {"Elu", "LeakyRelu", "HardSigmoid"} else {}
    data = foreign(operator, **attributes)
    read, run = read_network(data, "n.onnx"), PolicyNetwork(data, "n.onnx", 4)
    seen = np.random.default_rng(0).normal(size=(50, 4)).astype(np.float32)
    answers = np.array([run(row[None, :])[0] for row in seen])
    assert abs(answers - exact(read, seen)[:, 0]).max() < 3e-6
    assert np.std(answers) > 0.01
