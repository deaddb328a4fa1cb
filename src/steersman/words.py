"""From a word to a component: the one resolver, for every command, every file and Python alike.

A word for a component of a family is

- a registered kind: ``lqr``, ``circle``, ``carla_model3``;
- a controller of the package: ``tuned/lqr``, or a policy by its name: ``precision``;
- a file: a YAML file with the component (whole, or under the family's name, as in ``tuned.yaml``
  of ``steersman tune``), or one that a kind of the family reads: ``policy.onnx``, ``track.csv``,
  ``road.xodr``, ``my_car.yaml``;
- the folder of a training or tuning: its policy, or the controller that it found;
- ``supervised/``, ``estimated/`` or ``predicted/`` and a word for a controller: that controller
  under a supervisor, behind a state estimator, behind a predictor.

Where a controller gets a name of its own (bench, compare), a word may be ``name=word``.
"""

from __future__ import annotations

import difflib
import re
from collections.abc import Iterable
from pathlib import Path as FilePath
from typing import Any

from steersman import errors, policies, tuned
from steersman.core_yaml import read_yaml
from steersman.errors import ConfigError, DataError, near_file, shortened, suggestion
from steersman.messages import field_unit
from steersman.registry import components, families

YAML = (".yaml", ".yml")
_CONTROLLER, _POLICY = "controller", "policy"
# What a word for a controller may begin with: the controller around it, by its fields.
_AROUND: dict[str, tuple[str, dict[str, Any]]] = {
    "supervised": ("inner", {"kind": "supervisor"}),
    "estimated": ("controller", {"kind": "estimated"}),
    "predicted": (
        "controller",
        {"kind": "estimated", "estimator": None, "predictor": "single_track"},
    ),
}
# The same by the part that each adds, the outermost first.
PARTS = {"supervisor": "supervised", "estimator": "estimated", "predictor": "predicted"}
# What the folder of a training or tuning holds for a controller.
RESULTS = ("policy.onnx", "tuned.yaml")
_NUMBER = re.compile(r"-?\d+(\.\d+)?")
# Names of files that every tuning, training or drive writes: the folder's name says more.
_COMMON = ("tuned", "policy", "config", "episode")


def known(family: str) -> list[str]:
    """Every word for a component of the family that is not the name of a file."""
    more = [*tuned.names(), *policies.names()] if family == _CONTROLLER else []
    return [*components(family), *more]


def unknown(family: str, word: str) -> ConfigError:
    """The error about a word that is none of the family's; it names the nearest match."""
    if family == _CONTROLLER and word.strip("/") == "tuned":
        return ConfigError(f"unknown {family} {word!r}; write one of {', '.join(tuned.names())}")
    file = errors.there(word, family) or near_file(word, _endings(family))
    near = f"; {file}" if file else for_number(family, word)
    near = near or errors.no_such_place(word, known(family)) or suggestion(word, known(family))
    if near.endswith(" more"):
        near += f" in 'steersman list {family}'"
    return ConfigError(f"unknown {family} {shortened(word)!r}{near}")


def means(family: str, word: str) -> bool:
    """Whether a word stands for a component of the family, be it a faulty one."""
    if family == _CONTROLLER and (around(word)[0] or word.startswith("tuned/")):
        return True
    if word in known(family):
        return True
    suffix, place = FilePath(word).suffix, FilePath(word)
    if suffix in YAML:
        try:
            return place.is_file() and _in_yaml(family, word)
        except RecursionError:  # it leads back to itself: a faulty one
            return True
    return by_suffix(family, suffix) is not None or (family == _CONTROLLER and _results(place))


def family_of(word: str) -> tuple[str, str]:
    """The family of a component, and its word in it: ``family.word``, or a word of one family.

    Raises:
        ConfigError: there is none, or one in several families.
    """
    first, _, rest = word.partition(".")
    if rest and first in families() and means(first, rest):
        return first, rest
    found = [family for family in families() if means(family, word)]
    if len(found) == 1:
        return found[0], word
    if ways := " or ".join(f"{family}.{word}" for family in found):
        raise ConfigError(f"{word!r} is in several families; write {ways}")
    near = [name for f in families() for kind in components(f) for name in (f, kind, f"{f}.{kind}")]
    found = difflib.get_close_matches(word, near, n=1)
    raise ConfigError(f"unknown component {word!r}{suggestion(word, found or families())}")


def fields_of(family: str, word: str) -> dict[str, Any]:
    """The component that a word stands for, as plain fields with its registered ``kind``.

    Raises:
        ConfigError: there is no such component; the message names the nearest match.
        DataError: a file is missing, malformed, or holds no component of the family.
    """
    if word in components(family):
        return {"kind": word}
    try:
        return _found(family, word, FilePath(word))
    except OSError:  # too long for a file's name, or in a folder that may not be looked into
        raise unknown(family, word) from None
    except RecursionError:
        raise ConfigError(
            f"{shortened(word)!r} leads back to itself, or on without an end"
        ) from None


def _found(family: str, word: str, file: FilePath) -> dict[str, Any]:
    """What is no registered name: of the package, or a file."""
    found = _controller(word, file) if family == _CONTROLLER else None
    if found is not None:
        return found
    if file.suffix in YAML:
        return _from_yaml(family, word)
    kind = by_suffix(family, file.suffix)
    if kind is not None:
        return {"kind": kind, "file": word}
    if file.is_file():
        other = errors.OTHER_FORMATS.get(file.suffix.lower(), "") if family == "path" else ""
        raise DataError(
            f"{word}: expected a file that ends in {', '.join(_endings(family))}{other}"
        )
    raise unknown(family, word)


def _controller(word: str, file: FilePath) -> dict[str, Any] | None:
    """What only controllers have: others around them, those of the package, commands' results."""
    outer, inner = around(word)
    if outer:
        field, fields = _AROUND[outer]
        return {**fields, field: fields_of(_CONTROLLER, inner)}
    if word in policies.names():
        return {"kind": _POLICY, "file": word}
    shipped = tuned.locate(word)
    if shipped is not None and not file.exists():
        return _from_yaml(_CONTROLLER, str(shipped))
    if _results(file):
        inside = next(name for name in RESULTS if (file / name).is_file())
        return fields_of(_CONTROLLER, str(file / inside))
    return None


def around(word: str) -> tuple[str, str]:
    """What a word puts around a controller, and the rest; nothing and the word, if it does not."""
    outer, slash, inner = word.partition("/")
    return (outer, inner) if slash and outer in _AROUND else ("", word)


def with_parts(word: str, parts: str) -> str:
    """The word for a controller with parts around it, named in any order.

    >>> with_parts("tuned/lqr", "predictor, supervisor")
    'supervised/predicted/tuned/lqr'

    Raises:
        ConfigError: there is no such part.
    """
    wanted = [each.strip() for each in parts.split(",") if each.strip()]
    for each in wanted:
        if each not in PARTS:
            raise ConfigError(f"unknown part {each!r}{suggestion(each, PARTS)}")
    return "/".join([*(outer for part, outer in PARTS.items() if part in wanted), word])


def bare(word: str) -> str:
    """The word for the controller itself, without what is put around it.

    >>> bare("estimated/predicted/tuned/lqr")
    'tuned/lqr'
    """
    outer, inner = around(word)
    return bare(inner) if outer else word


def wrapped() -> dict[str, str]:
    """Of each kind that a word puts around a controller, the field with that controller."""
    return {fields["kind"]: field for field, fields in _AROUND.values()}


def _endings(family: str) -> list[str]:
    """Of files that stand for a component of the family."""
    found = (ending for cls in components(family).values() for ending in cls.suffixes)
    return list(dict.fromkeys([*YAML, *found]))


def for_number(family: str, given: Any) -> str:
    """The end of a message where a number stands for a component: that with a field so called."""
    number = _NUMBER.match(str(given))
    fields = {kind: cls.model_fields.get(family) for kind, cls in components(family).items()}
    found = [
        (k, field_unit(f)) for k, f in fields.items() if f is not None and f.annotation is float
    ]
    if number is None or not found:
        return ""
    kind, unit = found[0]
    value = number[0] if number[0] == str(given) else f"NUMBER, in {unit}"
    return f"; write {family}={kind} {family}.{family}={value}"


def by_suffix(family: str, suffix: str) -> str | None:
    """The kind of the family that reads files with this ending."""
    return next((k for k, c in components(family).items() if suffix and suffix in c.suffixes), None)


def _results(folder: FilePath) -> bool:
    return folder.is_dir() and any((folder / name).is_file() for name in RESULTS)


def _in_yaml(family: str, word: str) -> bool:
    """Whether a YAML file holds a component of the family: whole, or with its fields alone."""
    tree = read_yaml(word)
    if "kind" in tree or family in tree:
        return family in tree or means(family, str(tree["kind"]))
    kind = by_suffix(family, FilePath(word).suffix)
    return kind is not None and bool(set(tree) & {*components(family)[kind].model_fields, "base"})


def _from_yaml(family: str, word: str) -> dict[str, Any]:
    tree = read_yaml(word)
    kind = by_suffix(family, FilePath(word).suffix)
    if not {"kind", family} & set(tree) and kind is not None:
        return {"kind": kind, "file": word}
    found: Any = tree if "kind" in tree else tree.get(family)
    if isinstance(found, str):
        return fields_of(family, found)
    if not isinstance(found, dict) or "kind" not in found:
        raise DataError(f"{word}: holds no {family}; expected {family}: {{kind: ...}}")
    kind = str(found["kind"])
    others = [] if means(family, kind) else [each for each in families() if means(each, kind)]
    if others:
        raise DataError(f"{word}: holds a {others[0]}, kind: {kind}; expected a {family}")
    inner = fields_of(family, kind)
    return {**inner, **{key: value for key, value in found.items() if key != "kind"}}


def named(word: str) -> tuple[str, str]:
    """The name and the rest of ``[name=]word``; without a name, the word's own short one.

    >>> named("mine=runs/pid/tuned.yaml"), named("tuned/lqr"), named("runs/pid/tuned.yaml")
    (('mine', 'runs/pid/tuned.yaml'), ('lqr', 'tuned/lqr'), ('pid', 'runs/pid/tuned.yaml'))

    Raises:
        ConfigError: there is nothing after the sign.
    """
    name, sign, rest = word.partition("=")
    if not sign:
        name, rest = "", word
    name, rest = name.strip(), rest.strip()
    if not rest:
        raise ConfigError(
            f"{word!r} names no controller; write a kind, a file, or name=one of them"
        )
    return name or short(rest), rest


def short(word: str) -> str:
    """A short name for what a word stands for.

    >>> short("supervised/tuned/lqr"), short("runs/agent/policy.onnx"), short("my_pid.yaml")
    ('supervised/lqr', 'agent', 'my_pid')
    """
    outer, inner = around(word)
    if outer:
        return f"{outer}/{short(inner)}"
    file = FilePath(word)
    if not file.suffix:
        return file.name or file.resolve().name
    folder = file.resolve().parent.name
    return folder if file.stem in _COMMON and folder else file.stem


def distinct(found: Iterable[tuple[str, str]]) -> None:
    """Refuse two words that have the same name.

    Raises:
        ConfigError: there are two.
    """
    seen: dict[str, str] = {}
    for name, word in found:
        if name in seen:
            raise ConfigError(
                f"{seen[name]!r} and {word!r} are both called {name!r}; write name={word}"
            )
        seen[name] = word
