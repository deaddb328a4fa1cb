"""The controllers of a benchmark, by kind, by YAML file, by a policy's ONNX file."""

from __future__ import annotations

import hashlib
import json
import os
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path as FilePath
from typing import Any, NamedTuple

from steersman import policies as policies_of_package
from steersman import tuned
from steersman.config import dump, resolve
from steersman.controllers.base import ControllerComponent
from steersman.errors import ConfigError, DataError
from steersman.policy_file import LEARNED, PolicyCard, locate, read_policy
from steersman.seed_folders import seeds_in
from steersman.words import RESULTS, distinct, named

_ONNX = ".onnx"
# What a training leaves beside its policy.
_RECORD = "progress.csv"


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
    replicate: str = ""
    """Which of several of the same name: ``seed 0`` of a tuning or training with several."""

    @property
    def label(self) -> str:
        """The name, and which of several."""
        return f"{self.name}, {self.replicate}" if self.replicate else self.name


def entrants(words: Sequence[str]) -> list[Entrant]:
    """Controllers from their specifications ``[name=]spec``; of none given, those of the package.

    A ``spec`` is any word of :mod:`steersman.words` for a controller, or the folder of a tuning or
    training with several seeds, which all take part under one name.

    Raises:
        ConfigError: a kind is unknown, or two have the same name.
        DataError: a file is missing or malformed.
    """
    words = words or [*tuned.names(), *policies_of_package.names()]
    distinct((named(word)[0], word) for word in words)
    return [one for word in words for one in _replicated(word)]


def _replicated(word: str) -> list[Entrant]:
    name, spec = named(word)
    return [one._replace(name=name) for one in replicates(FilePath(spec))] or [entrant(word)]


def replicates(folder: FilePath) -> list[Entrant]:
    """What a tuning or training with several seeds has left in ``seed_N``; none without any.

    Raises:
        DataError: some of the seeds are not done, or there is a training beside them.
    """
    seeds = list(seeds_in(folder).values())
    kept = next((n for n in RESULTS if any((one / n).is_file() for one in seeds)), None)
    if kept is None:
        return []
    if (folder / _RECORD).is_file():
        names = ", ".join(one.name for one in seeds)
        raise DataError(f"{folder}: holds one training, and {names} beside it; name one of them")
    missing = next((one for one in seeds if not (one / kept).is_file()), None)
    if missing is not None:
        raise DataError(f"{missing}: has no {kept} yet; wait until all seeds are done")
    every = ((one.name.replace("_", " "), entrant(str(one / kept))) for one in seeds)
    return [found._replace(name=seed, replicate=seed) for seed, found in every]


def entrant(word: str) -> Entrant:
    """One controller from ``[name=]spec``.

    Raises:
        ConfigError: the kind is unknown.
        DataError: a file is missing or malformed.
    """
    name, spec = named(word)
    try:
        controller = _component(spec)
    except ConfigError as error:
        raise ConfigError(f"{spec}: {error}") from None
    shown = dump(controller) or {}
    cards = [read_policy(locate(file))[1] for file in policies(shown)]
    plain = _with_policies(shown, lambda _: "policy")  # where a policy lies does not matter
    content = json.dumps([plain, [card.model_dump(mode="json") for card in cards]], sort_keys=True)
    return Entrant(
        name,
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


def _component(data: Any) -> ControllerComponent:
    found = resolve("controller", data)
    assert isinstance(found, ControllerComponent)
    return found


def policies(data: Any) -> Iterator[str]:
    """The file of every policy in a dumped controller, however deep."""
    if isinstance(data, Mapping):
        if data.get("kind") in LEARNED:
            yield str(data["file"])
        for value in data.values():
            yield from policies(value)


def _with_policies(data: Any, change: Callable[[str], str]) -> Any:
    """The same with other names of policies' files."""
    if not isinstance(data, Mapping):
        return data
    out = {key: _with_policies(value, change) for key, value in data.items()}
    return {**out, "file": change(str(data["file"]))} if data.get("kind") in LEARNED else out


def _absolute(file: str) -> str:
    """A file's name for any folder; a policy of the package keeps its own."""
    return os.path.abspath(file) if file.endswith(_ONNX) else file
