"""Networks read from ONNX files, and what is refused."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import onnx
import pytest
import torch
from onnx import helper, numpy_helper
from torch.nn import functional

from steersman.delivery.graph import (
    TOLERANCE,
    exact,
    normalised,
    random_features,
    read_network,
    rounding,
)
from steersman.errors import DataError
from steersman.learning.export import network
from steersman.network_file import PolicyNetwork

from ..loops import random_net

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
    "another operator": (lambda g: setattr(g.node[3], "op_type", "Elu"), "node 3 is Elu"),
    "a branch": (lambda g: setattr(g.node[4], "name", "") or g.node[4].input.__setitem__(0, "x"),
                 "node 4 is Gemm"),
    "double": (lambda g: _set(g, "w1", np.zeros((8, 4))), "w1 is not finite float32"),
    "not finite": (lambda g: _set(g, "b2", np.full(8, np.nan, np.float32)), "b2 is not finite"),
    "sizes": (lambda g: _set(g, "b2", np.zeros(7, np.float32)), "layer 2: weights"),
    "lopsided": (lambda g: _set(g, "low", np.float32(-1.0)), r"clips its input to \[-1, 100\]"),
    "transposed": (lambda g: g.node[2].attribute[0].CopyFrom(helper.make_attribute("transB", 0)),
                   "a Gemm with"),
    "unfinished": (lambda g: g.node.pop(0), "node 0 is Clip, where Mul is expected"),
    "missing weights": (lambda g: g.initializer.pop(2), "not a network of steersman's own"),
}  # fmt: skip


@pytest.mark.parametrize("name", OTHERS)
def test_other_networks_are_refused_in_one_line(name: str) -> None:
    change, message = OTHERS[name]
    with pytest.raises(DataError, match=message) as caught:
        read_network(altered(change), "n.onnx")
    assert "\n" not in str(caught.value)


def test_no_onnx_at_all() -> None:
    with pytest.raises(DataError, match=r"n\.onnx: not a"):
        read_network(b"nothing of the kind", "n.onnx")
