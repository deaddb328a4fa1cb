"""Write a trained actor as ONNX with a JSON card."""

from __future__ import annotations

from pathlib import Path as FilePath
from typing import Any

import numpy as np

from steersman.config import dump
from steersman.files import replacing, write_text
from steersman.kernels.encode import FEATURE_LIMIT
from steersman.learning.imitation.config import LearningConfig
from steersman.learning.networks import Net
from steersman.policy_file import SIGNS, UNITS, PolicyCard, sha256
from steersman.provenance import provenance


def network(net: Net, scale: Any, operators: tuple[str, str] = ("Relu", "Tanh")) -> bytes:
    """ONNX bytes of clip(features x scale) -> hidden layers -> action in [-1, 1].

    Features (batch, n) are raw, as ``encoding`` makes them; the fixed scale is part of the
    network. ``operators`` stand after the hidden layers and after the output (Tanh, or Clip to
    +-1). Opset 17.
    """
    from onnx import TensorProto, checker, helper, numpy_helper

    def constant(name: str, value: Any) -> Any:
        return numpy_helper.from_array(np.asarray(value, np.float32, order="C"), name)

    hidden, output = operators
    bounds = {"least": -1.0, "most": 1.0} if output == "Clip" else {}
    weights = [
        *(constant(name, value) for name, value in bounds.items()),
        constant("scale", scale),
        constant("low", -FEATURE_LIMIT),
        constant("high", FEATURE_LIMIT),
        *(constant(f"w{i + 1}", w) for i, w in enumerate((net.w1, net.w2, net.w3))),
        *(constant(f"b{i + 1}", b) for i, b in enumerate((net.b1, net.b2, net.b3))),
    ]
    nodes = [
        helper.make_node("Mul", ["features", "scale"], ["scaled"]),
        helper.make_node("Clip", ["scaled", "low", "high"], ["x"]),
        helper.make_node("Gemm", ["x", "w1", "b1"], ["z1"], transB=1),
        helper.make_node(hidden, ["z1"], ["h1"]),
        helper.make_node("Gemm", ["h1", "w2", "b2"], ["z2"], transB=1),
        helper.make_node(hidden, ["z2"], ["h2"]),
        helper.make_node("Gemm", ["h2", "w3", "b3"], ["z3"], transB=1),
        helper.make_node(output, ["z3", *bounds], ["action"]),
    ]
    count = len(scale)
    graph = helper.make_graph(
        nodes,
        "policy",
        [helper.make_tensor_value_info("features", TensorProto.FLOAT, ["batch", count])],
        [helper.make_tensor_value_info("action", TensorProto.FLOAT, ["batch", len(net.b3)])],
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
) -> FilePath:
    """Write ``policy.onnx`` and ``policy.json`` into ``folder``.

    ``note`` goes into the card, and so does the share of the base's steering that is corrected.
    """
    problem = config.problem
    layout = problem.layout
    scale = layout.scale
    data = network(net, scale, operators)
    origin = provenance()
    file = folder / "policy.onnx"
    card = PolicyCard(
        files={file.name: sha256(data)},
        action=problem.action,
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
        observation=layout.names,
        scale=scale.tolist(),
        units=UNITS,
        signs=SIGNS,
        limits={
            "action": [-1.0, 1.0],
            "steer": [-1.0, 1.0],
            "scaled feature": [-FEATURE_LIMIT, FEATURE_LIMIT],
        },
        seed=config.seed,
        training={**note, "config": dump(config)},
        versions=origin["versions"],
        commit=origin["commit"],
    )
    with replacing(file) as stream:
        stream.write(data)
    write_text(file.with_suffix(".json"), card.model_dump_json(indent=1) + "\n")
    return file
