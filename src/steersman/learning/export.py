"""Write a trained actor as ONNX with a JSON card."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path as FilePath
from typing import Any

import numpy as np

from steersman.config import dump
from steersman.encoding import Layout
from steersman.files import replacing, write_text
from steersman.kernels.encode import FEATURE_LIMIT
from steersman.learning.imitation.config import LearningConfig
from steersman.learning.networks import Net
from steersman.policy_file import SIGNS, UNITS, PolicyCard, sha256
from steersman.provenance import provenance
from steersman.types import FloatArray

_CLIP = "Clip"


def network(
    net: Net,
    scale: Any,
    operators: tuple[str, str] = ("Relu", "Tanh"),
    levels: Sequence[float] = (),
) -> bytes:
    """ONNX bytes of clip(features x scale) -> hidden layers -> action in [-1, 1].

    ``operators`` stand after the hidden layers and after the output (Tanh, Clip to +-1, or
    Hardmax, after which the action is that of ``levels`` with the largest value).
    """
    hidden, output = operators
    layers = [(net.w1, net.b1, hidden), (net.w2, net.b2, hidden), (net.w3, net.b3, output)]
    chosen = [(np.array([levels]), np.zeros(1), None)] if levels else []
    return layered([*layers, *chosen], scale)


def layered(layers: Sequence[tuple[Any, Any, str | None]], scale: Any) -> bytes:
    """ONNX bytes of clip(features x scale) -> layers; opset 17.

    Features (batch, n) are raw, as ``encoding`` makes them; the fixed scale is part of the
    network.

    Args:
        layers: weights (outputs, inputs), bias (outputs,) and ONNX operator of each (Clip: to
            +-1; None: no operator).
        scale: factor on each feature, shape (n,).
    """
    from onnx import TensorProto, checker, helper, numpy_helper

    def constant(name: str, value: Any) -> Any:
        return numpy_helper.from_array(np.asarray(value, np.float32, order="C"), name)

    bounds = {"least": -1.0, "most": 1.0} if any(op == _CLIP for *_, op in layers) else {}
    weights = [
        *(constant(name, value) for name, value in bounds.items()),
        constant("scale", scale),
        constant("low", -FEATURE_LIMIT),
        constant("high", FEATURE_LIMIT),
        *(constant(f"w{i + 1}", w) for i, (w, _, _) in enumerate(layers)),
        *(constant(f"b{i + 1}", b) for i, (_, b, _) in enumerate(layers)),
    ]
    nodes = [
        helper.make_node("Mul", ["features", "scale"], ["scaled"]),
        helper.make_node("Clip", ["scaled", "low", "high"], ["x"]),
    ]
    flow = "x"
    for i, (_, _, operator) in enumerate(layers, 1):
        end = "action" if i == len(layers) else f"h{i}"
        z = end if operator is None else f"z{i}"
        nodes.append(helper.make_node("Gemm", [flow, f"w{i}", f"b{i}"], [z], transB=1))
        if operator is not None:
            more = bounds if operator == _CLIP else ()
            nodes.append(helper.make_node(operator, [z, *more], [end]))
        flow = end
    count, actions = len(scale), len(layers[-1][1])
    graph = helper.make_graph(
        nodes,
        "policy",
        [helper.make_tensor_value_info("features", TensorProto.FLOAT, ["batch", count])],
        [helper.make_tensor_value_info("action", TensorProto.FLOAT, ["batch", actions])],
        weights,
    )
    model = helper.make_model(
        graph, opset_imports=[helper.make_opsetid("", 17)], producer_name="steersman"
    )
    model.ir_version = 8
    checker.check_model(model)
    return bytes(model.SerializeToString())


def export_policy(
    net: Net,
    config: LearningConfig,
    folder: FilePath,
    note: dict[str, Any],
    operators: tuple[str, str] = ("Relu", "Tanh"),
    base_share: float = 1.0,
    levels: Sequence[float] = (),
) -> FilePath:
    """Write ``policy.onnx`` and ``policy.json`` into ``folder``.

    ``note`` goes into the card, and so does the share of the base's steering that is corrected.
    """
    problem = config.problem
    scale = problem.layout.scale
    data = network(net, scale, operators, levels)
    file = folder / "policy.onnx"
    card = new_card(
        file.name,
        data,
        problem.layout,
        scale,
        action=problem.action,
        joint=problem.joint,
        rate_limit=problem.rate_limit if problem.indirect else None,
        base=dump(problem.base),
        authority=None if problem.corrected is None else problem.authority,
        base_share=base_share,
        parameters={k: v if isinstance(v, str) else list(v) for k, v in problem.parameters.items()}
        or None,
        period=problem.period,
        dt=problem.plant.dt,
        waypoints=problem.sensor.count,
        spacing=problem.sensor.spacing,
        trim=config.trim,
        encoding=dump(problem.encoding) or {},
        seed=config.seed,
        training={**note, "config": dump(config)},
    )
    return write_policy(file, data, card)


def new_card(
    name: str, data: bytes, layout: Layout, scale: FloatArray, **particulars: Any
) -> PolicyCard:
    """The card of a network in a file ``name``: what is in it, what it reads, where it was made.

    Args:
        name: of the file beside the card.
        data: its content.
        layout: the features that the network reads, in their order.
        scale: factor on each of them, shape (n,).
        particulars: the card's other fields; ``limits`` go over those of every policy.
    """
    origin = provenance()
    limits = {
        "action": [-1.0, 1.0],
        "steer": [-1.0, 1.0],
        "scaled feature": [-FEATURE_LIMIT, FEATURE_LIMIT],
    }
    return PolicyCard(
        files={name: sha256(data)},
        observation=layout.names,
        scale=scale.tolist(),
        units=UNITS,
        signs=SIGNS,
        limits=limits | particulars.pop("limits", {}),
        versions=origin["versions"],
        commit=origin["commit"],
        **particulars,
    )


def write_policy(file: FilePath, data: bytes, card: PolicyCard) -> FilePath:
    """Write a network and, beside it, its card; the network's file.

    Raises:
        DataError: they cannot be written.
    """
    with replacing(file) as stream:
        stream.write(data)
    write_text(file.with_suffix(".json"), card.model_dump_json(indent=1) + "\n")
    return file
