"""Completion in shells: components, fields and their values, after what stands in the line."""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from typing import Any, get_args

from pydantic import BaseModel
from pydantic.fields import FieldInfo

from steersman import presets
from steersman.command_table import COMMANDS, settings_of
from steersman.config import Of, components, families, resolve
from steersman.errors import SteersmanError
from steersman.words import known

_SIGN = re.compile(r"\s+=\s*")


def completed(command: str, before: Sequence[str], begun: str) -> list[str]:
    """What a word that was begun may become.

    Bash takes ``path=cir`` for three words, of which it completes the last; other shells for one.

    Args:
        command: whose settings the words are.
        before: the words before it.
        begun: the word so far.
    """
    words = _SIGN.sub("=", " ".join(before)).split()
    last = words.pop().removesuffix("=") if words else ""
    # Right behind the sign the word is empty, as click gives it.
    if last and (before[-1] == "=" or (not begun and "=" not in last)):
        values = list(_values(command, words, last))
        if values:
            return _matching(values, begun)
    words.append(last)
    key, sign, _ = begun.partition("=")
    if sign:
        return _matching((f"{key}={text}" for text in _values(command, words, key)), begun)
    return _matching(_names(command, words, key), begun)


def word_of(family: str, begun: str) -> list[str]:
    """The families, or the words for components of one, that begin so."""
    return _matching(known(family) if family in families() else families(), begun)


def _matching(found: Iterator[str] | Sequence[str], begun: str) -> list[str]:
    return sorted({text for text in found if text.startswith(begun)})


def _names(command: str, words: Sequence[str], key: str) -> Iterator[str]:
    """Fields with what they hold; without a dot also what the first word of a command may be."""
    front, dot, _ = key.rpartition(".")
    owner = _owner(command, words, front.split(".") if dot else [])
    for name, info in owner.model_fields.items() if owner is not None else ():
        value = info.get_default(call_default_factory=True)
        family, path = _family(info), f"{front}{dot}{name}"
        parts = family is not None or isinstance(value, BaseModel)
        # Two ways to go on keep the shell from ending the word with a blank.
        yield from (f"{path}=", f"{path}.") if parts else (f"{path}={_text(value)}",)
        if family is not None and not dot and not COMMANDS[command].presets:
            yield from known(family)
    if COMMANDS[command].presets and not dot:
        yield from presets.names()


def _values(command: str, words: Sequence[str], key: str) -> Iterator[str]:
    """What a field may be: components, choices, or what it is without being set."""
    *front, name = key.split(".")
    owner = _owner(command, words, front)
    info = None if owner is None else owner.model_fields.get(name)
    if info is None:
        return
    family, choices = _family(info), list(_choices(info.annotation))
    if family is not None:
        yield from known(family)
    elif choices:
        yield from choices
    else:
        yield _text(info.get_default(call_default_factory=True))


def _choices(annotation: Any) -> Iterator[str]:
    """The texts, and the truth values, that a type allows."""
    if annotation is bool:
        yield from ("true", "false")
    elif isinstance(annotation, str):
        yield annotation
    else:
        for inner in get_args(annotation):
            yield from _choices(inner)


def _text(value: Any) -> str:
    if value is None or isinstance(value, bool):
        return {None: "null", True: "true", False: "false"}[value]
    return str(value) if isinstance(value, str | int | float) else ""


def _owner(command: str, words: Sequence[str], parts: Sequence[str]) -> type[BaseModel] | None:
    """The class of the settings, or of the component in them, whose fields are wanted."""
    given = dict(word.split("=", 1) for word in words if "=" in word)
    owner: type[BaseModel] = settings_of(command)
    for depth, part in enumerate(parts, 1):
        info = owner.model_fields.get(part)
        if info is None:
            return None
        value = info.get_default(call_default_factory=True)
        family, word = _family(info), given.get(".".join(parts[:depth]))
        if family is not None:
            value = word or value
            value = _component(family, value) if isinstance(value, str) else value
        found = value if isinstance(value, type) else type(value)
        if not issubclass(found, BaseModel):
            return None
        owner = found
    return owner


def _component(family: str, word: str) -> Any:
    """The class of a component, or the component that a word of another kind stands for."""
    try:
        return components(family).get(word) or resolve(family, word)
    except SteersmanError:
        return None


def _family(info: FieldInfo) -> str | None:
    return next((mark.family for mark in info.metadata if isinstance(mark, Of)), None)
