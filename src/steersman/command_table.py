"""The commands that are configured by words, and what to write instead of a wrong word."""

from __future__ import annotations

import importlib
from collections.abc import Mapping
from pathlib import Path as FilePath
from typing import Any, NamedTuple

from pydantic import BaseModel

from steersman.config import Of, build, components, merge, resolve
from steersman.errors import ConfigError, DataError
from steersman.ranges import seed_list
from steersman.words import by_suffix

# A part and a field of it.
_PAIR = 2
_POLICY = "its policy drives with controller=policy controller.file={inside}policy.onnx"


class CommandWords(NamedTuple):
    """A command that is configured by words."""

    config: str
    """``module:class`` of its configuration."""
    own: str | None
    """A field that no other command's configuration has."""
    elsewhere: str
    """What to do with such a configuration where another command's is expected."""
    presets: bool = False
    """Whether its first word may be a preset of training."""
    seeds: str = "it has one seed"
    """What to write for several seeds."""


COMMANDS = {
    "drive": CommandWords(
        "steersman.rollout:RunConfig",
        None,
        "",
        seeds="a drive has one seed; 'steersman bench' and 'compare' take --seeds {given}",
    ),
    "train": CommandWords(
        "steersman.learning.config:TrainConfig",
        "agent",
        _POLICY,
        presets=True,
        seeds="a training has one seed; seeds={given} trains with each",
    ),
    "imitate": CommandWords(
        "steersman.learning.imitation.config:ImitationConfig", "fit", _POLICY, presets=True
    ),
    "tune": CommandWords(
        "steersman.studies.tune:TuneConfig", "smoothness", "what it found is {inside}tuned.yaml"
    ),
    "falsify": CommandWords(
        "steersman.studies.falsify:FalsifyConfig", "ranges", "'steersman falsify {file}' takes it"
    ),
    "bench": CommandWords(
        "steersman.bench.suite:Suite",
        "courses",
        "'steersman bench {file}' takes it",
        seeds="write --seeds {given}",
    ),
}


def settings_of(command: str) -> type[BaseModel]:
    """The class of a command's configuration."""
    module, _, name = COMMANDS[command].config.partition(":")
    found: type[BaseModel] = getattr(importlib.import_module(module), name)
    return found


def component_fields(command: str) -> dict[str, str]:
    """The family of each field of a command's configuration that holds one component."""
    fields = settings_of(command).model_fields.items()
    marks = {name: [m for m in field.metadata if isinstance(m, Of)] for name, field in fields}
    return {name: found[0].family for name, found in marks.items() if found}


def build_for(command: str, tree: Mapping[str, Any]) -> Any:
    """The configuration of a command from its fields; an error says what to write instead.

    Raises:
        ConfigError: a field is unknown, or a value is not allowed.
    """
    try:
        return build(settings_of(command), tree)
    except ConfigError as error:
        ways = (_several_seeds, _part_with, _kind_with)
        hint = next(filter(None, (way(error, command, tree) for way in ways)), None)
        raise ConfigError(hint, error.where) if hint else error from None


def _several_seeds(error: ConfigError, command: str, tree: Mapping[str, Any]) -> str | None:
    """The message where several seeds are given for one; None where that is not the fault."""
    if error.where not in {("seed",), ("seeds",)}:
        return None
    given = tree[error.where[0]]
    text = ",".join(map(str, given)) if isinstance(given, list | tuple | range) else str(given)
    try:
        several = len(seed_list(text)) > 1
    except ConfigError:
        return None
    if error.where == ("seed",) and not several:
        return None
    what = error.what.partition(";")[0]
    return f"{what}; {COMMANDS[command].seeds.format(given=text)}"


def _part_with(error: ConfigError, command: str, tree: Mapping[str, Any]) -> str | None:
    """The message about an unknown field that a part of the configuration has; None without one."""
    if len(error.where) != 1 or not error.what.startswith("unknown field;"):
        return None
    name, cls = error.where[0], settings_of(command)
    for field, family in component_fields(command).items():
        default = cls.model_fields[field].get_default(call_default_factory=True)
        value = merge({field: default}, {field: tree[field]})[field] if field in tree else default
        found = resolve(family, value, optional=True)
        if found is not None and name in type(found).model_fields:
            return f"unknown field; did you mean '{field}.{name}'?"
    return None


def _kind_with(error: ConfigError, command: str, tree: Mapping[str, Any]) -> str | None:
    """The message about a field that other components of the family have; None without one."""
    what = error.what.partition(";")[0]
    family = component_fields(command).get(error.where[0]) if len(error.where) == _PAIR else None
    if family is None or not what.startswith("unknown field of"):
        return None
    (field, name), given = error.where, tree[error.where[0]]
    value = str(given[name]) if isinstance(given, Mapping) and name in given else "..."
    if name == "file" and by_suffix(family, FilePath(value).suffix):
        return f"{what}; write {field}={value}"
    kinds = [kind for kind, cls in components(family).items() if name in cls.model_fields]
    if not kinds:
        return None
    more = f" (or {field}={', '.join(kinds[1:])})" if kinds[1:] else ""
    return f"{what}; write {field}={kinds[0]} {field}.{name}={value}{more}"


def check_command(name: str, tree: Mapping[str, Any], command: str) -> None:
    """Refuse the configuration of another command, and say what to do with it."""
    for other, entry in COMMANDS.items():
        if other != command and entry.own is not None and entry.own in tree:
            folder = FilePath(name).parent
            inside = "" if folder == FilePath() else f"{folder}/"
            what = entry.elsewhere.format(inside=inside, file=name)
            if entry.elsewhere is _POLICY and not (folder / "policy.onnx").is_file():
                what = f"it has no policy yet ({inside}policy.onnx)"
            raise DataError(f"{name}: is the configuration of 'steersman {other}'; {what}")
