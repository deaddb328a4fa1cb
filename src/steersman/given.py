"""What Python hands over in place of a word: text, a mapping of fields, or a component."""

from __future__ import annotations

import os
from collections.abc import Mapping
from typing import Any

from pydantic import BaseModel

from steersman.errors import ConfigError, shortened


def as_word(value: Any) -> str | BaseModel | Mapping[str, Any]:
    """A word as it is, a path as text; anything else would be passed over in silence.

    >>> from pathlib import PurePosixPath
    >>> as_word("lqr"), as_word(PurePosixPath("runs/pid"))
    ('lqr', 'runs/pid')

    Raises:
        ConfigError: it is a class, a function, a number or anything else that names nothing.
    """
    if isinstance(value, str | BaseModel | Mapping):
        return value
    if isinstance(value, os.PathLike):
        return str(os.fspath(value))
    if isinstance(value, type):
        name = value.__name__
        raise ConfigError(f"{name} is a class, expected a word or a component; write {name}()")
    if callable(value):
        name = getattr(value, "__name__", type(value).__name__)
        raise ConfigError(
            f"{name} is a function, expected a word or a component; a component is a class with"
            " its fields: class Mine(sm.Controller), handed over as Mine()"
        )
    what = f"{shortened(repr(value))} of type {type(value).__name__}"
    raise ConfigError(f"{what} is neither a word, a mapping of fields nor a component")


def as_text(value: Any) -> str:
    """A word or a path as text, where a component needs a name.

    Raises:
        ConfigError: it is anything else.
    """
    found = as_word(value)
    if isinstance(found, str):
        return found
    name = type(found).__name__
    raise ConfigError(
        f"a {name} was handed over, expected a word: @sm.register('controller', 'mine') makes"
        " 'mine' one, and a YAML file is one, too"
    )
