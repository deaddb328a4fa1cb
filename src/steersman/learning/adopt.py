"""A network trained elsewhere as a policy: ONNX with a card, or Stable-Baselines3's model."""

from __future__ import annotations

from collections.abc import Mapping
from os import PathLike
from pathlib import Path as FilePath
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import model_validator

from steersman.config import Of, Settings, build, dump, merge, param, required
from steersman.encoding import EncodingComponent, Layout
from steersman.errors import ConfigError, DataError
from steersman.files import out_folder, read_bytes
from steersman.learning.export import layered, new_card, write_policy
from steersman.learning.sb3_file import Layers, described, read_actor
from steersman.network_file import PolicyNetwork, check_network
from steersman.policy_file import PolicyCard, sha256
from steersman.types import FloatArray

_MOST = 100_000_000
# Actions that mean something only beside a base or a source of speed.
_NOT_ALONE = ("joint", "residual", "parameters")
_CURE = "give a model of Stable-Baselines3 (*.zip) or a network (*.onnx)"
_SHOWN = 4


class Adoption(Settings):
    """What a network of unknown origin does not say about itself."""

    encoding: Annotated[EncodingComponent, Of("encoding")] = required(
        "-",
        "What the network reads, in its order (steersman list encoding, feature); a model that was "
        "trained in steersman/PathFollowing-v0 says it.",
    )
    scale: tuple[float, ...] | None = param(
        None, "-", "Factor on each feature, from its unit to the network's; null: all 1."
    )
    action: Literal["direct", "rate"] = param(
        "direct", "-", "Whether the action is a steering, or its rate over rate_limit."
    )
    rate_limit: float = param(1.5708, "1/s", "Largest rate of steering of the action 'rate'.", gt=0)
    limits: tuple[float, float] = param(
        (-1.0, 1.0),
        "-",
        "Action in [-1, 1] (1: full lock to the left) at the lower and at the upper bound of the "
        "network's action; [1, -1]: its positive side is right.",
    )
    output: int | None = param(
        None, "-", "Number of the output that steers, from 0; null: there is one.", ge=0
    )
    dt: float = param(0.05, "s", "Control period that it was trained with.", gt=0)
    spacing: float = param(2.0, "m", "Distance of waypoints, if the features have any.", gt=0)

    @model_validator(mode="after")
    def _sound(self) -> Adoption:
        low, high = self.limits
        if low == high or max(abs(low), abs(high)) > 1.0:
            raise ValueError("limits: expected two different numbers in [-1, 1]")
        return self

    @property
    def layout(self) -> Layout:
        """The features that the network reads."""
        return self.encoding.layout(self.spacing, self.dt, self.action)


def adoption(source: FilePath, given: Mapping[str, Any]) -> Adoption:
    """What a model's file says of itself, with what is given laid over it.

    Raises:
        DataError: the file cannot be read.
        ConfigError: a setting is unknown, not allowed, or neither said nor given.
    """
    if source.suffix not in {".zip", ".onnx"}:
        raise DataError(f"{source}: is neither; {_CURE}")
    if source.suffix == ".onnx" and source.with_suffix(".json").is_file():
        raise DataError(
            f"{source}: is a controller of Steersman, with its card beside it; drive it"
        )
    said = told_by(source)
    own = "joint" if said.get("joint") else said.get("action")
    if own in _NOT_ALONE:
        raise DataError(
            f"{source}: was trained in steersman/PathFollowing-v0 with {own} actions, which no"
            " policy alone drives; direct and rate can be adopted, 'steersman train' has the others"
        )
    if "encoding" in given:  # the factors are those of the features that it says
        said.pop("scale", None)
    return build(Adoption, merge(said, given))


def told_by(source: FilePath) -> dict[str, Any]:
    """What a model's file says of itself; nothing, if it was trained elsewhere.

    Raises:
        DataError: the file cannot be read.
    """
    if source.suffix != ".zip":
        return {}
    return described(read_bytes(source, _CURE, _MOST), str(source))


def adopt_policy(source: FilePath, wanted: Adoption, out: str | PathLike[str]) -> FilePath:
    """Write ``policy.onnx`` and its card ``policy.json`` into folder ``out``; the first of them.

    Nothing is unpickled, nothing of an ONNX file is run that is no layer, and no folder is made for
    a network that is refused.

    Raises:
        DataError: the file cannot be read, or is no network that a policy can be.
        ConfigError: the settings do not fit the network.
    """
    data = read_bytes(source, _CURE, _MOST)
    layout = wanted.layout
    note = {"adopted": source.name, "sha256": sha256(data)}
    scale = np.ones(len(layout.names)) if wanted.scale is None else np.array(wanted.scale)
    if len(scale) != len(layout.names):
        raise ConfigError(f"{len(scale)} factors for {len(layout.names)} features", ("scale",))
    if source.suffix == ".onnx":
        check_network(data, str(source))
        changed = [n for n in ("scale", "limits", "output") if n in wanted.model_fields_set]
        if changed:
            raise ConfigError("an ONNX file is taken as it is; this is for a *.zip", (changed[0],))
        network = data
    elif source.suffix == ".zip":
        actor = read_actor(data, str(source))
        note |= {"policy": actor.family, "stable-baselines3": actor.version}
        network = layered(_fitted(actor.layers, wanted, layout, str(source)), scale)
    else:
        raise DataError(f"{source}: is neither; {_CURE}")
    PolicyNetwork(network, str(source), len(scale))
    file = out_folder(str(out)) / "policy.onnx"
    return write_policy(file, network, _card(file.name, network, wanted, scale, note))


def _fitted(layers: Layers, wanted: Adoption, layout: Layout, name: str) -> Layers:
    """The layers with the one output that steers, between the limits."""
    reads = layers[0][0].shape[1]
    if reads != len(layout.names):
        some = ", ".join(layout.names[:_SHOWN])
        raise ConfigError(
            f"{name} reads {reads} numbers, but {wanted.encoding.kind} gives "
            f"{len(layout.names)} ({some}{', ...' if len(layout.names) > _SHOWN else ''})",
            ("encoding",),
        )
    weights, bias, operator = layers[-1]
    if wanted.output is None and bias.size > 1:
        raise ConfigError(
            f"{name} gives {bias.size} actions; the number (from 0) of the one that steers is "
            "needed",
            ("output",),
        )
    row = wanted.output or 0
    if row >= bias.size:
        raise ConfigError(f"{row} is not allowed; {name} has {bias.size}", ("output",))
    fitted = [*layers[:-1], (weights[row : row + 1], bias[row : row + 1], operator)]
    low, high = wanted.limits
    if (low, high) != (-1.0, 1.0):
        gain, middle = np.array([[0.5 * (high - low)]]), np.array([0.5 * (high + low)])
        fitted.append((gain, middle, "Clip"))
    return fitted


def _card(
    name: str, network: bytes, wanted: Adoption, scale: FloatArray, note: dict[str, Any]
) -> PolicyCard:
    return new_card(
        name,
        network,
        wanted.layout,
        scale,
        action=wanted.action,
        rate_limit=wanted.rate_limit if wanted.action == "rate" else None,
        dt=wanted.dt,
        waypoints=wanted.layout.reads,
        spacing=wanted.spacing,
        encoding=dump(wanted.encoding) or {},
        limits={"action": sorted(wanted.limits)},
        seed=0,
        training=note,
    )
