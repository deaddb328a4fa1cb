"""The actor in a model file of Stable-Baselines3 (``model.save``), read without unpickling it.

The file is a zip. ``policy.pth`` holds the networks' tensors, which are read with PyTorch's
``weights_only``; ``data`` describes the model as JSON: pickles in base64, which are left alone, and
beside them the same as text. The actor's layers follow from the names and shapes of the tensors
(Stable-Baselines3 2.x, ``common/policies.py``, ``td3/policies.py``, ``sac/policies.py``).
"""

from __future__ import annotations

import io
import re
import zipfile
from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np

from steersman.bounds import MOST_JSON, from_json
from steersman.errors import DataError, one_line, shortened

Layers = list[tuple[Any, Any, str | None]]
# What the members that are read may take together [bytes], and layers.
_MOST, _MOST_LAYERS = 100_000_000, 20
_SETTINGS, _WEIGHTS, _VERSION = "data", "policy.pth", "_stable_baselines3_version"
# Activations by the ends of their classes' names, as ONNX operators with the same constants.
_ACTIVATIONS = {
    "ReLU": "Relu", "Tanh": "Tanh", "ELU": "Elu", "LeakyReLU": "LeakyRelu", "Sigmoid": "Sigmoid",
}  # fmt: skip
_CLASS = re.compile(r"<class '[\w.]*?(\w+)'>")
_LAYER = re.compile(r"(\d+)\.(weight|bias)")


class ForeignActor(NamedTuple):
    """A plain network from observations to actions in [-1, 1], the bounds of the action space."""

    layers: Layers
    """Weights (outputs, inputs), bias (outputs,) and ONNX operator of each layer."""
    family: str
    """The module of its policy class, as ``td3``."""
    version: str
    """That of Stable-Baselines3."""


def read_actor(data: bytes, name: str) -> ForeignActor:
    """The actor of a DDPG, TD3, SAC, PPO or A2C model with an ``MlpPolicy``.

    Args:
        data: the zip file.
        name: the file's, for messages.

    Raises:
        DataError: it is damaged, too large, or another kind of model; the line says which.
    """
    try:
        members = _members(data, (_SETTINGS, _WEIGHTS, _VERSION))
        about = from_json(members[_SETTINGS])
        if not isinstance(about, dict):
            raise ValueError("its description is no object")
        family = _family(about)
        low, high = _space(about, "action_space")
        tensors = _tensors(members[_WEIGHTS])
        layers = _layers(tensors, _activation(about), low, high)
    except ValueError as error:
        raise DataError(f"{name}: not a model that can be adopted: {error}") from None
    version = members[_VERSION].decode("ascii", "replace").strip()
    return ForeignActor(layers, family, shortened(version))


def described(data: bytes, name: str) -> dict[str, Any]:
    """What a model's file says of its observations, see :mod:`steersman.learning.observed`.

    Empty if it was trained elsewhere.

    Raises:
        DataError: the file is damaged, or too large.
    """
    try:
        about = from_json(_members(data, (_SETTINGS,))[_SETTINGS])
    except ValueError as error:
        raise DataError(f"{name}: not a model that can be adopted: {error}") from None
    space = about.get("observation_space") if isinstance(about, dict) else None
    found = space.get("steersman") if isinstance(space, dict) else None
    return found if isinstance(found, dict) else {}


def _members(data: bytes, names: tuple[str, ...]) -> dict[str, bytes]:
    """The content of members of an archive; no more is unpacked than its directory says."""
    try:
        with zipfile.ZipFile(io.BytesIO(data)) as archive:
            known = {info.filename: info.file_size for info in archive.infolist()}
            missing = [name for name in names if name not in known]
            if missing:
                raise ValueError(f"holds no {missing[0]!r}, which Stable-Baselines3 writes")
            size = sum(known[name] for name in names)
            if size > _MOST or known[names[0]] > MOST_JSON:
                raise ValueError(f"unpacks to {size / 1e6:.0f} MB, the most is {_MOST / 1e6:.0f}")
            return {name: archive.read(name) for name in names}
    except ValueError:
        raise
    except Exception as error:  # noqa: BLE001 - for damaged bytes zipfile and zlib raise many
        raise ValueError(shortened(one_line(str(error)) or type(error).__name__, 120)) from None


def _tensors(data: bytes) -> dict[str, Any]:
    """The float tensors of a ``.pth`` file as arrays, by their names."""
    import torch

    try:
        with zipfile.ZipFile(io.BytesIO(data)) as archive:
            if sum(info.file_size for info in archive.infolist()) > len(data):
                raise ValueError("is compressed")  # PyTorch stores them as they are
        found = torch.load(io.BytesIO(data), map_location="cpu", weights_only=True)
    except Exception as error:  # noqa: BLE001 - for damaged bytes errors of any class
        line = shortened(one_line(str(error)), 120)
        raise ValueError(f"{_WEIGHTS}: {line or type(error).__name__}") from None
    if not isinstance(found, Mapping):
        raise ValueError(f"{_WEIGHTS}: no tensors by name")
    out = {}
    for key, value in found.items():
        plain = isinstance(key, str) and type(value) is torch.Tensor
        plain = plain and value.layout == torch.strided and value.is_floating_point()
        # A tensor may claim more than its storage, with a stride of zero.
        if plain and value.numel() * value.element_size() <= len(data):
            out[key] = value.detach().to(torch.float32).numpy()
    return out


def _family(about: Mapping[str, Any]) -> str:
    """The module of the policy class, one of Stable-Baselines3's own."""
    policy = about.get("policy_class")
    module = policy.get("__module__") if isinstance(policy, dict) else None
    package, _, inner = str(module).partition(".")
    if package != "stable_baselines3" or not inner.endswith("policies"):
        raise ValueError(
            f"its policy class is of {shortened(str(module))}, not Stable-Baselines3's MlpPolicy"
        )
    if about.get("use_sde"):
        raise ValueError("it was trained with gSDE (use_sde), whose actor is another")
    observed = about.get("observation_space")
    if not (isinstance(observed, dict) and ".Box'" in str(observed.get(":type:"))):
        raise ValueError("its observation is no Box of numbers")
    return inner.split(".")[0]


def _space(about: Mapping[str, Any], which: str) -> tuple[Any, Any]:
    """The bounds of a Box with one row of numbers, from what its text says."""
    space = about.get(which)
    if not (isinstance(space, dict) and ".Box'" in str(space.get(":type:"))):
        raise ValueError(f"its {which} is no Box: a steering is one number")
    try:
        low, high = (
            np.array([float(word) for word in str(space[end]).strip("[] \n").split()])
            for end in ("low", "high")
        )
    except (KeyError, ValueError):
        raise ValueError(f"its {which} has no bounds that can be read") from None
    if low.shape != high.shape or not low.size or not (low < high).all():
        raise ValueError(f"its {which} has the bounds {low} and {high}")
    return low, high


def _activation(about: Mapping[str, Any]) -> str | None:
    """The operator of the hidden layers; None: that of the algorithm's default."""
    given = about.get("policy_kwargs")
    given = given if isinstance(given, dict) else {}
    extractor = str(given.get("features_extractor_class", "FlattenExtractor"))
    if "FlattenExtractor" not in extractor:
        raise ValueError(f"it reads through {shortened(extractor)}, not a plain row")
    if "activation_fn" not in given:
        return None
    word = _CLASS.fullmatch(str(given["activation_fn"]))
    if word is None or word[1] not in _ACTIVATIONS:
        what, allowed = shortened(str(given["activation_fn"])), ", ".join(_ACTIVATIONS)
        raise ValueError(f"its activation is {what}; {allowed} can be adopted")
    return _ACTIVATIONS[word[1]]


def _layers(tensors: Mapping[str, Any], chosen: str | None, low: Any, high: Any) -> Layers:
    """The actor's layers from the names of its tensors; actions in [-1, 1]."""
    if "actor.mu.weight" in tensors:  # SAC
        rows = [*_stack(tensors, "actor.latent_pi."), _pair(tensors, "actor.mu")]
        hidden, output = chosen or "Relu", "Tanh"
    elif "actor.mu.0.weight" in tensors:  # TD3, DDPG
        rows = _stack(tensors, "actor.mu.")
        hidden, output = chosen or "Relu", "Tanh"
    elif "action_net.weight" in tensors:  # PPO, A2C
        rows = [*_stack(tensors, "mlp_extractor.policy_net."), _pair(tensors, "action_net")]
        hidden, output = chosen or "Tanh", "Clip"
    else:
        raise ValueError(
            "its tensors are not those of an MlpPolicy of DDPG, TD3, SAC, PPO or A2C "
            f"({shortened(', '.join(map(str, tensors)), 80)})"
        )
    if output == "Clip":  # a mean in the units of the action space, clipped to its bounds
        if not np.isfinite([low, high]).all():
            raise ValueError("its action space has no finite bounds")
        weights, bias = rows[-1]
        if bias.shape == low.shape:
            half = 0.5 * (high - low)
            rows[-1] = weights / half[:, None], (bias - 0.5 * (low + high)) / half
    _check(rows, low.size)
    return [*((w, b, hidden) for w, b in rows[:-1]), (*rows[-1], output)]


def _stack(tensors: Mapping[str, Any], prefix: str) -> list[tuple[Any, Any]]:
    """The fully connected layers of a ``Sequential``, in order."""
    names = [key.removeprefix(prefix) for key in tensors if key.startswith(prefix)]
    odd = [name for name in names if not _LAYER.fullmatch(name)]
    if odd:
        raise ValueError(f"its actor has {shortened(prefix + odd[0])}, which no plain layer has")
    numbers = sorted({int(name.partition(".")[0]) for name in names})
    return [_pair(tensors, f"{prefix}{number}") for number in numbers]


def _pair(tensors: Mapping[str, Any], name: str) -> tuple[Any, Any]:
    try:
        return tensors[f"{name}.weight"], tensors[f"{name}.bias"]
    except KeyError as error:
        raise ValueError(f"holds no tensor {shortened(error.args[0])!r}") from None


def _check(rows: list[tuple[Any, Any]], actions: int) -> None:
    if len(rows) > _MOST_LAYERS:
        raise ValueError(f"{len(rows)} layers; the most is {_MOST_LAYERS}")
    size = rows[0][0].shape[-1] if rows[0][0].ndim else 0
    for number, (weights, bias) in enumerate(rows, 1):
        if weights.shape != (*bias.shape, size) or bias.ndim != 1 or not size:
            raise ValueError(
                f"layer {number}: weights {weights.shape}, bias {bias.shape} on {size} numbers"
            )
        if not (np.isfinite(weights).all() and np.isfinite(bias).all()):
            raise ValueError(f"layer {number}: a weight is not finite")
        size = bias.size
    if size != actions:
        raise ValueError(f"{size} outputs for an action space of {actions}")
