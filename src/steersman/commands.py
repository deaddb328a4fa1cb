"""From words to the configuration of a command, for the command line and for Python alike.

``steersman drive tuned/lqr path=circle path.radius=50`` and
``sm.drive("tuned/lqr", "path.radius=50", path="circle")`` both end here.
"""

from __future__ import annotations

import difflib
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path as FilePath
from typing import Any, TypeAlias

from pydantic import BaseModel

from steersman import core_yaml, presets, tuned
from steersman import words as words_
from steersman.command_table import (
    COMMANDS,
    build_for,
    check_command,
    component_fields,
    settings_of,
)
from steersman.config import Component, lay_over, override, read_yaml
from steersman.errors import ConfigError, DataError, near_file, suggestion
from steersman.given import as_word

Word: TypeAlias = str | BaseModel | Mapping[str, Any]
Notify: TypeAlias = Callable[[str], None]

# What an imitation takes from the configuration of a training.
_SHARED = ("problem", "validation", "seed", "trim", "threads")


def configuration(
    command: str,
    words: Sequence[Word] = (),
    settings: Mapping[str, Any] | None = None,
    notify: Notify | None = None,
) -> Any:
    """The configuration of a command.

    Args:
        command: ``drive``, ``train``, ``imitate``, ``tune`` or ``falsify``.
        words: the name of a YAML file, a preset or a component; assignments ``key.field=value``;
            mappings of fields; components, as objects or as mappings with ``kind``, each of which
            goes to the field of its family.
        settings: fields, laid over what the names give and under the assignments.
        notify: called with a sentence if something was changed to fit a plant with one car.

    Raises:
        ConfigError: a word or a value is unknown or not allowed; the words contradict each other.
        DataError: a file is missing or no YAML, or is another command's configuration.
    """
    cls = settings_of(command)
    words = [as_word(word) for word in words]
    if len(words) == 1 and isinstance(words[0], cls) and not settings:
        return words[0]
    names = [w for w in words if isinstance(w, str) and "=" not in w]
    assignments = [w for w in words if isinstance(w, str) and "=" in w]
    check_order(assignments)
    more = {**(settings or {})}
    if COMMANDS[command].presets:
        assignments = [_of_problem(word) for word in assignments]
        more = {_of_problem(key): value for key, value in more.items()}
    tree = _named(command, names)
    for word in words:
        if isinstance(word, Component):
            tree = lay_over(tree, word.family, word)
        elif isinstance(word, Mapping) and "kind" in word:
            tree = lay_over(tree, _field_for(command, str(word["kind"])), word)
        elif isinstance(word, BaseModel):
            tree = {name: getattr(word, name) for name in type(word).model_fields}
        elif isinstance(word, Mapping):
            for key, value in word.items():
                tree = lay_over(tree, key, value)
    for key, value in more.items():
        tree = lay_over(tree, key, value)
    tree = _for_one_car(command, override(tree, assignments), [*assignments, *more], notify)
    return build_for(command, tree)


def _of_problem(word: str) -> str:
    """``plant=...`` is short for ``problem.plant=...`` in what learns."""
    return f"problem.{word}" if key(word).split(".")[0] == "plant" else word


def split(words: Sequence[str]) -> tuple[str | None, list[str]]:
    """The one word without "=", if there is one, and the assignments.

    Raises:
        ConfigError: there is a second word without "=", or an assignment undoes another.
    """
    names = [word for word in words if "=" not in word]
    if len(names) > 1:
        raise ConfigError(
            f"{names[1]!r} is neither key=value nor the first name ({names[0]!r} is);"
            " write key=value"
        )
    assignments = [word for word in words if "=" in word]
    check_order(assignments)
    return (names[0] if names else None), assignments


def check_order(assignments: Sequence[str]) -> None:
    """Refuse an assignment that would undo one before it.

    Raises:
        ConfigError: there is one.
    """
    seen: dict[str, str] = {}
    for text in assignments:
        name = key(text)
        if name in seen:
            raise ConfigError(f"given twice: {seen[name]} and {text}", (name,))
        inner = next((other for other in seen if other.startswith(f"{name}.")), None)
        if inner is not None:
            raise ConfigError(f"{text} would undo {seen[inner]}; put {text} first", (name,))
        seen[name] = text


def key(word: str) -> str:
    """The left side of an assignment, or the word itself."""
    return word.partition("=")[0].strip()


def suite_settings(
    words: Sequence[str], also: set[str] | frozenset[str] = frozenset()
) -> tuple[list[str], dict[str, str]]:
    """The words that name something to drive, and by their key those that are settings.

    >>> suite_settings(["pid", "mine=tuned/lqr", "corridor=1", "radius=3"])
    (['pid', 'mine=tuned/lqr'], {'corridor': 'corridor=1', 'radius': 'radius=3'})

    Args:
        words: words of ``bench`` or ``compare``.
        also: names of settings beside those of a suite.

    Raises:
        ConfigError: a setting undoes another.
    """
    from steersman.bench.suite import Suite

    known = {"suite", "seed", "seeds", *Suite.model_fields, *also}

    def sets(word: str) -> bool:
        """Whether it names a field, or gives what cannot name a controller: radius=3."""
        given = core_yaml.value(word.partition("=")[2].strip())
        return key(word).partition(".")[0] in known or not isinstance(given, str | None)

    found = [word for word in words if "=" in word and sets(word)]
    check_order(found)
    named = [word for word in words if word not in found]
    return named, {key(word): word for word in found}


def _named(command: str, names: Sequence[str]) -> dict[str, Any]:
    """The fields that the words without "=" give: the first may be a whole configuration."""
    tree: dict[str, Any] = {}
    taken: dict[str, str] = {}
    for place, name in enumerate(names):
        found = _whole(command, name) if place == 0 else None
        if found is not None:
            tree = found
            continue
        field = _field_for(command, name)
        if field in taken:
            raise ConfigError(f"{taken[field]!r} and {name!r} are both a {field}; give one of them")
        taken[field] = name
        tree = lay_over(tree, field, name)
    return tree


def _whole(command: str, name: str) -> dict[str, Any] | None:
    """The configuration that a preset, a file or a command's folder holds; None if it is none."""
    place = FilePath(name)
    if COMMANDS[command].presets and not _is_file(name):
        file = presets.locate(name)
        if file is None:
            raise ConfigError(f"unknown preset {name!r}{suggestion(name, presets.names())}")
    elif place.is_dir():
        file = place / "config.yaml"
        results = not COMMANDS[command].presets and words_.means("controller", name)
        if results or not file.is_file():
            return None
    elif place.suffix in words_.YAML and not name.startswith("tuned/"):
        file = existing(name)
    else:
        return None
    tree = read_yaml(file)
    if "like" in tree and COMMANDS[command].presets:
        from steersman.learning.config import read_preset

        tree = read_preset(FilePath(file))
    whole = "kind" not in tree and set(tree) & set(settings_of(command).model_fields)
    if not whole and _families_of(command, name):  # a component alone
        return None
    if command == "imitate" and "agent" in tree:
        return {name: tree[name] for name in _SHARED if name in tree}
    check_command(str(file), tree, command)
    return tree


def _is_file(name: str) -> bool:
    file = FilePath(name)
    a_place = file.is_file() or (file.is_dir() and name not in presets.names())
    return file.suffix in words_.YAML or file.name != name or a_place


def _families_of(command: str, name: str) -> list[str]:
    """The fields that a word may be for: the first of each family that has it."""
    first = {family: field for field, family in reversed(component_fields(command).items())}
    return [field for family, field in first.items() if words_.means(family, name)]


def _field_for(command: str, name: str) -> str:
    """The field that a word without "=" is for, by the families that have the word."""
    found, fields = _families_of(command, name), component_fields(command)
    if len(found) == 1:
        return found[0]
    if found:
        ways = " or ".join(f"{field}={name}" for field in sorted(found))
        raise ConfigError(f"{name!r} may be a {' or a '.join(sorted(found))}; write {ways}")
    if FilePath(name).is_dir():
        raise DataError(f"{name}: is a folder without config.yaml, policy.onnx or tuned.yaml")
    if FilePath(name).is_file():
        raise DataError(f"{name}: is a file of no kind that {command} takes{_own(name)}")
    every = [word for family in set(fields.values()) for word in words_.known(family)]
    near = suggestion(name, every)
    near = near if near.startswith("; did you") else ""
    if field := difflib.get_close_matches(name, fields, n=1, cutoff=0.8):
        near = f"; write {field[0]}=NAME"
    what = f"{name!r} is neither a file nor the name of a component"
    raise ConfigError(f"{what}{near or '; settings are written key=value'}")


def _own(file: str) -> str:
    """The end of a message about a program that is to be driven."""
    cure = (
        "; a controller in Python is driven from Python: sm.drive(MyController(), ...), or"
        f" controller=process controller.command='[python3, {file}]' (docs/plugins.md)"
    )
    return cure if FilePath(file).suffix == ".py" else ""


def existing(name: str) -> FilePath:
    """A file that is there, or ``tuned/NAME`` of the package.

    Raises:
        DataError: it is not.
    """
    file = FilePath(name)
    shipped = tuned.locate(name)
    if shipped is not None and not file.exists():
        return shipped
    if file.is_dir():
        raise DataError(f"{name}: is a folder, expected a file")
    if not file.exists():
        near = near_file(name, words_.YAML)
        near = (
            suggestion(name, tuned.names()) if name.startswith("tuned/") else near and f"; {near}"
        )
        raise DataError(f"{name}: no such file{near}")
    return file


def _for_one_car(
    command: str, tree: dict[str, Any], given: Sequence[str], notify: Notify | None
) -> dict[str, Any]:
    """The tree made fit for a plant that has one car: what the user gave stays."""
    where = tree.get("problem", {}) if COMMANDS[command].presets else tree
    plant = where.get("plant") if isinstance(where, Mapping) else None
    if plant is None or (isinstance(plant, Mapping) and "kind" not in plant):
        return tree  # the embedded simulator, perhaps with fields of it
    own = {key(word) for word in given}
    changes = [change for change in _changes(command, tree, plant) if key(change) not in own]
    if changes and notify is not None:
        kind = plant.get("kind") if isinstance(plant, Mapping) else plant
        kind = kind.kind if isinstance(kind, Component) else kind
        notify(f"plant={kind} drives one car: {' '.join(changes)}")
    return override(tree, changes)


def _changes(command: str, tree: Mapping[str, Any], plant: Any) -> list[str]:
    """Assignments that make the configuration one of a single car."""
    if COMMANDS[command].presets:
        from steersman.learning.config import for_one_car

        kind: Any = settings_of(command)
        return for_one_car(kind, tree, plant)
    if command == "falsify":
        from steersman.studies.falsify import for_one_car as search_for_one_car

        return search_for_one_car(plant)
    return []
