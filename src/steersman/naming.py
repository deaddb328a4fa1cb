"""What a component is called in lines and on pages: by the word that the user gave it by.

A controller of the package keeps its word (``tuned/lqr``), a file or a folder has its own short
name (``van.yaml``: ``van``, ``runs/tune_lqr``: ``tune_lqr``), everything else its kind.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path as FilePath
from typing import TYPE_CHECKING, Any

from steersman import words
from steersman.registry import components

if TYPE_CHECKING:
    from steersman.config import Component

NAMED = ("controller", "path", "speed", "vehicle")
"""Families whose components a record has the names of, under ``names``."""


def called(component: Component) -> str:
    """What a component is called."""
    word, kind = component.given_as, component.kind
    if word != kind:
        return _of_word(component.family, word)
    file = getattr(component, "file", None)
    if isinstance(file, str | FilePath):
        return words.short(str(file))
    inner: Any = getattr(component, words.wrapped().get(kind, "kind"), None)
    return f"{words.PARTS.get(kind, kind)}/{called(inner)}" if hasattr(inner, "given_as") else kind


def _of_word(family: str, word: str) -> str:
    around, inner = words.around(word) if family == "controller" else ("", word)
    if around:
        return f"{around}/{_of_word(family, inner)}"
    return word if word in words.known(family) else words.short(word)


def names_of(config: Any) -> dict[str, str]:
    """The names of a configuration's parts, by family."""
    return {family: called(getattr(config, family)) for family in NAMED}


def recorded_name(record: Mapping[str, Any], family: str) -> str:
    """What a part is called in a record, or in a configuration as plain data; nothing if unknown.

    Args:
        record: with ``names``, or of before they were kept, perhaps with the configuration under
            ``config``.
        family: of the part.
    """
    names, inner = record.get("names"), record.get("config")
    if isinstance(names, Mapping) and family in names:
        return str(names[family])
    given = record.get(family, inner.get(family) if isinstance(inner, Mapping) else None)
    return plain_name(given)


def shown_name(record: Mapping[str, Any], family: str) -> str:
    """The recorded name as pages have it: a kind in words, what is the user's own as it is."""
    return _in_words(family, recorded_name(record, family))


def titled(component: Component) -> str:
    """The name of a component as pages have it."""
    return _in_words(component.family, called(component))


def _in_words(family: str, name: str) -> str:
    return name.replace("_", " ") if name in components(family) else name


def plain_name(given: Any) -> str:
    """What a component as plain data is called: its file, what it is around, or its kind."""
    if not isinstance(given, Mapping):
        return "" if given is None else str(given)
    kind, file = str(given.get("kind") or ""), given.get("file")
    if kind and isinstance(file, str):
        return words.short(file)
    inner = given.get(words.wrapped().get(kind, ""))
    return (
        f"{words.PARTS.get(kind, kind)}/{plain_name(inner)}" if isinstance(inner, Mapping) else kind
    )
