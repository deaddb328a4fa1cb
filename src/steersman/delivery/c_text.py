"""Names, numbers and comments as C99 takes them, whatever they were made from."""

from __future__ import annotations

import hashlib
import math
import re
from collections.abc import Sequence
from importlib.resources import files
from string import Template
from typing import Any

import numpy as np

from steersman.errors import DataError

# C99 promises 31 significant characters of an external name; linkers take far more.
_LONGEST = 40
# Printable, and neither the end of a comment nor a trigraph nor a line's continuation.
_NOT_IN_COMMENTS = re.compile(r"[^A-Za-z0-9 _.,:;=+()\[\]<>^'/-]")


def identifier(name: str) -> str:
    """A part of a C name, lower case; names that would leave nothing get a digest.

    >>> identifier("My policy, 2nd")
    'my_policy_2nd'
    """
    plain = re.sub(r"[^a-z0-9]+", "_", name.lower()).strip("_")[:_LONGEST].strip("_")
    return plain or f"policy_{hashlib.sha256(name.encode()).hexdigest()[:8]}"


def comment(text: str) -> str:
    """``text`` on one line, so that no comment ends in it.

    >>> comment('a */ b??/')
    'a _/ b__/'
    """
    return _NOT_IN_COMMENTS.sub("_", text)[:200]


def decimal(value: Any, what: str = "a value") -> str:
    """A float literal: the shortest decimals that give ``value`` rounded to float32.

    Raises:
        DataError: it is not finite, or float32 has no room for it.

    >>> decimal(0.05)
    '0.05f'
    """
    return f"{np.float32(_fitting(value, what))!s}f"


def _fitting(value: Any, what: str) -> float:
    with np.errstate(over="ignore"):
        single = float(np.float32(value))
    if not math.isfinite(single) or (single == 0.0 and value != 0.0):
        raise DataError(f"{what}: {value} does not fit into float32")
    return single


def braces(values: Sequence[str]) -> str:
    """An initialiser."""
    return "{" + ", ".join(values) + "}"


def fill(template: str, words: dict[str, Any]) -> str:
    """A template of this package with its words filled in."""
    text = files("steersman.delivery.templates").joinpath(template).read_text(encoding="utf-8")
    return Template(text).substitute(words)
