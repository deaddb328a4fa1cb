"""What a live page lets one choose, from the declarations, and the configuration that results."""

from __future__ import annotations

import math
import shlex
from collections.abc import Iterable, Mapping
from typing import Any

from pydantic import BaseModel

from steersman import words
from steersman.commands import configuration
from steersman.config import Component, dump, lay_over, resolve
from steersman.errors import SteersmanError
from steersman.fields import Field as DeclaredField
from steersman.fields import fields_of
from steersman.naming import called
from steersman.rollout import RunConfig

FAMILIES = ("controller", "path", "speed", "vehicle", "sensor", "plant")
"""Families of which one component is chosen."""
_NUMBERS = ("number", "whole number")
# Further settings of a drive that the page has.
_SETTINGS = ("duration", "corridor", "seed")
# A range without bounds ends at so many times the default.
_WIDER = 4.0


class ChosenPart(BaseModel):
    """A component by its word, with the fields that differ from what the word stands for.

    Fields of groups are written ``group.field``.
    """

    word: str
    fields: dict[str, Any] = {}


class Choices(BaseModel):
    """What is chosen on a page."""

    parts: dict[str, ChosenPart] = {}
    """By family."""
    disturbances: list[ChosenPart] = []
    settings: dict[str, Any] = {}
    """``duration`` [s], ``corridor`` [m], ``seed``."""

    def config(self, base: RunConfig) -> RunConfig:
        """The drive: ``base`` with what is chosen in the place of its parts.

        Raises:
            ConfigError: a word or a value is unknown or not allowed.
            DataError: a file is missing or malformed.
        """
        found: dict[str, Any] = {name: _tree(part) for name, part in self.parts.items()}
        found["disturbances"] = [_tree(part) for part in self.disturbances]
        config = configuration("drive", [base], {**found, **self.settings})
        assert isinstance(config, RunConfig)
        return config

    def command(self) -> str:
        """The command line that drives this."""
        given = [
            f"{name}={part.word}" if not field else f"{name}.{field}={value}"
            for name, part in self.parts.items()
            for field, value in [("", ""), *part.fields.items()]
        ]
        if self.disturbances:
            inner = [
                ", ".join(f"{k}: {v}" for k, v in _tree(part).items()) for part in self.disturbances
            ]
            given.append(f"disturbances=[{', '.join(f'{{{one}}}' for one in inner)}]")
        given += [f"{name}={value}" for name, value in self.settings.items()]
        return shlex.join(["steersman", "drive", *given])


def _tree(part: ChosenPart) -> dict[str, Any]:
    tree: dict[str, Any] = {}
    for name, value in part.fields.items():
        tree = lay_over(tree, name, value)
    return {"kind": part.word, **tree}


def chosen(config: RunConfig) -> Choices:
    """The choices that a configuration is."""
    return Choices(
        parts={name: _part(getattr(config, name)) for name in FAMILIES},
        disturbances=[_part(one) for one in config.disturbances],
        settings={
            name: value
            for name in _SETTINGS
            if (value := getattr(config, name)) != RunConfig.model_fields[name].default
        },
    )


def _part(component: Component) -> ChosenPart:
    """By the word with the fewest fields that differ: the user's file, gains by their name."""
    given = _flat(dump(component) or {})
    found = []
    file = str(given["file"]) if isinstance(given.get("file"), str) else component.kind
    for word in [component.given_as, file, component.kind, *words.known(component.family)]:
        plain = _flat(_default(component.family, word))
        if word == component.kind or plain.get("kind") == component.kind:
            differ = {k: v for k, v in given.items() if k != "kind" and plain.get(k) != v}
            found.append(ChosenPart(word=word, fields=differ))
    return min(found, key=lambda part: len(part.fields))


def _flat(tree: Mapping[str, Any], before: str = "") -> dict[str, Any]:
    """Fields of groups as ``group.field``; components stay whole."""
    out: dict[str, Any] = {}
    for name, value in tree.items():
        group = isinstance(value, Mapping) and "kind" not in value
        out |= _flat(value, f"{before}{name}.") if group else {f"{before}{name}": value}
    return out


def _default(family: str, word: str) -> dict[str, Any]:
    try:
        return dump(resolve(family, word)) or {}
    except SteersmanError:  # a required field has no default
        return {}


def form(base: RunConfig | None = None) -> dict[str, Any]:
    """Plain data of everything that can be chosen: words, and their fields with ranges.

    Args:
        base: whose parts are offered too, under the words that they were given by.
    """
    one = {name: _words(name, words.known(name)) for name in FAMILIES}
    labels = {}
    for name, part in ({} if base is None else chosen(base).parts).items():
        component = getattr(base, name)
        if part.word not in one[name]:
            own = _words(name, [part.word]) or {part.word: _fields(component)}
            one[name] = {**own, **one[name]}
        labels[name] = getattr(component, "title", called(component))
    drive = [one for one in fields_of(RunConfig) if one.name in _SETTINGS]
    return {
        "families": one,
        "labels": labels,
        "disturbances": _words("disturbance", words.known("disturbance")),
        "settings": [_shown(field, {}) for field in drive],
    }


def _words(family: str, names: Iterable[str]) -> dict[str, list[dict[str, Any]]]:
    """The fields behind each word that stands for a component without further fields."""
    out = {}
    for name in names:
        try:
            component = resolve(family, name)
        except SteersmanError:  # it needs a file
            continue
        if component is not None and getattr(component, "computed", True):  # else it has a server
            out[name] = _fields(component)
    return out


def _fields(component: Component) -> list[dict[str, Any]]:
    search: Mapping[str, tuple[float, float, bool]] = getattr(component, "search", {})
    fields = fields_of(type(component), component)
    return [_shown(field, search) for field in fields if _is_shown(field)]


def _is_shown(field: DeclaredField) -> bool:
    plain = field.type.removesuffix(" or null")
    return plain in (*_NUMBERS, "true or false", "text", "file") or bool(field.choices)


def _shown(field: DeclaredField, search: Mapping[str, tuple[float, float, bool]]) -> dict[str, Any]:
    """A field, of a number with the range of its slider."""
    out = {name: getattr(field, name) for name in ("name", "default", "unit", "choices", "meaning")}
    kind = field.type.removesuffix(" or null")
    out["type"] = "choice" if field.choices else kind
    if kind in _NUMBERS and not field.choices:
        low, high, log = search.get(field.name, (*_range(field), False))
        out |= {"low": low, "high": high, "log": log}
    return out


def _range(field: DeclaredField) -> tuple[float, float]:
    """Bounds where there are some, else about the default."""
    at = float(field.default or 0.0)
    low = field.bounds.get("ge", field.bounds.get("gt", min(0.0, _WIDER * at)))
    high = field.bounds.get("le", field.bounds.get("lt"))
    if high is None or not math.isfinite(high):
        high = max(_WIDER * at, low + 1.0)
    return float(low), float(high)
