"""Who takes part in a benchmark: controllers by kind, by YAML file, by a policy's ONNX file."""

from __future__ import annotations

import hashlib
import json
import os
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path as FilePath
from typing import Any, NamedTuple

from steersman import tuned
from steersman.config import components, dump, lookup, read_yaml, resolve
from steersman.controllers.base import ControllerComponent
from steersman.controllers.supervisor import Supervisor
from steersman.errors import ConfigError, DataError, suggestion
from steersman.policy_file import PolicyCard, locate, read_policy, shipped

_SUPERVISED = "supervised/"
_YAML = (".yaml", ".yml")
_ONNX, _POLICY = ".onnx", "policy"
# Names of files that every tuning or training writes: there the folder's name tells more.
_COMMON = ("tuned", "policy", "config")


class Entrant(NamedTuple):
    """A controller that takes part."""

    name: str
    controller: ControllerComponent
    learned: bool
    """Whether a policy is part of it."""
    digest: str
    """Changes with the configuration and with the content of a policy's file."""
    waypoints: int
    """Waypoints that its policy reads; 0 without one."""
    spacing: float
    """Distance between them [m]; 0 without a policy."""
    shown: dict[str, Any]
    """The controller as plain data, with files as they were given."""


def entrants(words: Sequence[str]) -> list[Entrant]:
    """Controllers from their specifications ``[name=]spec``; of none given, those of the package.

    A ``spec`` is a registered kind, a YAML file with a controller (as ``steersman tune`` writes
    it), ``tuned/NAME`` for one of the package, the ONNX file of a policy, or the name of a policy
    of the package; ``supervised/`` before any of them puts it under a supervisor.

    Raises:
        ConfigError: a kind is unknown, or two have the same name.
        DataError: a file is missing or malformed.
    """
    words = words or [*tuned.names(), *shipped()]
    found = [entrant(word) for word in words]
    seen: dict[str, str] = {}
    for one, word in zip(found, words, strict=True):
        if one.name in seen:
            raise ConfigError(
                f"{seen[one.name]!r} and {word!r} are both called {one.name!r}; write name={word}"
            )
        seen[one.name] = word
    return found


def entrant(word: str) -> Entrant:
    """One controller from ``[name=]spec``.

    Raises:
        ConfigError: the kind is unknown.
        DataError: a file is missing or malformed.
    """
    name, sign, spec = word.partition("=")
    if not sign:
        name, spec = "", word
    name, spec = name.strip(), spec.strip()
    if not spec:
        raise ConfigError(
            f"{word!r} names no controller; write a kind, a file, or name=one of them"
        )
    controller = _controller(spec)
    shown = dump(controller) or {}
    cards = [read_policy(locate(file))[1] for file in policies(shown)]
    plain = _with_policies(shown, lambda _: _POLICY)  # where a policy lies does not matter
    content = json.dumps([plain, [card.model_dump(mode="json") for card in cards]], sort_keys=True)
    return Entrant(
        name or _short(spec),
        # Processes elsewhere have other working folders.
        _component(_with_policies(shown, _absolute)) if cards else controller,
        bool(cards),
        hashlib.sha256(content.encode()).hexdigest()[:16],
        max((card.waypoints for card in cards), default=0),
        _spacing(spec, cards),
        shown,
    )


def _spacing(spec: str, cards: Sequence[PolicyCard]) -> float:
    distances = sorted({card.spacing for card in cards})
    if len(distances) > 1:
        raise ConfigError(f"{spec}: its policies read waypoints {distances} m apart, not the same")
    return distances[0] if distances else 0.0


def _controller(spec: str) -> ControllerComponent:
    if spec.startswith(_SUPERVISED):
        return Supervisor(inner=_controller(spec.removeprefix(_SUPERVISED)))
    file = FilePath(spec)
    if file.suffix == _ONNX:
        data: Any = {"kind": _POLICY, "file": spec}
    elif file.suffix in _YAML:
        data = _from_yaml(file)
    elif spec in tuned.names() and not file.exists():
        data = _from_yaml(tuned.locate(spec) or file)
    elif spec in shipped():
        data = {"kind": _POLICY, "file": spec}
    elif file.exists() and spec not in components("controller"):
        raise DataError(f"{spec}: expected a file that ends in .onnx, .yaml or .yml")
    else:
        _known(spec)
        data = spec
    try:
        return _component(data)
    except ConfigError as error:
        raise ConfigError(f"{spec}: {error}") from None


def _component(data: Any) -> ControllerComponent:
    found = resolve("controller", data)
    assert isinstance(found, ControllerComponent)
    return found


def _known(kind: str) -> None:
    """Refuse a kind that is unknown, or that needs more than its name."""
    known = components("controller")
    if kind not in known:
        raise ConfigError(
            f"unknown controller {kind!r}{suggestion(kind, [*known, *tuned.names(), *shipped()])}"
        )
    cls = lookup("controller", kind)
    needed = [name for name, field in cls.model_fields.items() if field.is_required()]
    if needed:
        raise ConfigError(
            f"controller {kind!r} needs {', '.join(needed)}; give a YAML file instead"
        )


def _from_yaml(file: FilePath) -> Mapping[str, Any]:
    """The controller in a file: under ``controller``, as in a run, or the whole of it."""
    tree = read_yaml(file)
    if "kind" in tree:
        return tree
    if "controller" not in tree:
        raise DataError(f"{file}: holds no controller; expected controller: {{kind: ...}}")
    inner = tree["controller"]
    return {"kind": inner} if isinstance(inner, str) else inner


def _short(spec: str) -> str:
    """The name of a specification without one."""
    if spec.startswith(_SUPERVISED):
        return f"{_SUPERVISED}{_short(spec.removeprefix(_SUPERVISED))}"
    file = FilePath(spec)
    if file.suffix not in (*_YAML, _ONNX):
        return file.name
    folder = file.resolve().parent.name
    return folder if file.stem in _COMMON and folder else file.stem


def policies(data: Any) -> Iterator[str]:
    """The file of every policy in a dumped controller, however deep."""
    if isinstance(data, Mapping):
        if data.get("kind") == _POLICY:
            yield str(data["file"])
        for value in data.values():
            yield from policies(value)


def _with_policies(data: Any, change: Callable[[str], str]) -> Any:
    """The same with other names of policies' files."""
    if not isinstance(data, Mapping):
        return data
    out = {key: _with_policies(value, change) for key, value in data.items()}
    return {**out, "file": change(str(data["file"]))} if data.get("kind") == _POLICY else out


def _absolute(file: str) -> str:
    """A file's name for any folder; a policy of the package keeps its own."""
    return os.path.abspath(file) if file.endswith(_ONNX) else file
