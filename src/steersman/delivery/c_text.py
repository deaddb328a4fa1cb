"""Names, numbers and comments as C99 takes them, whatever they were made from."""

from __future__ import annotations

import hashlib
import math
import re
from collections.abc import Iterable, Sequence
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


def number(value: Any, what: str = "a value") -> str:
    """A float literal that is exactly ``value`` rounded to float32.

    Raises:
        DataError: it is not finite, or float32 has no room for it.

    >>> number(0.05)
    '0x1.99999ap-5f'
    """
    return loose(_fitting(value, what))


def decimal(value: Any, what: str = "a value") -> str:
    """The same for readers: the shortest decimals that give the same float32.

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


def loose(value: Any) -> str:
    """A hexadecimal literal of what is a float32 already; may be NaN or infinite."""
    single = float(value)
    if math.isnan(single):
        return "NAN"
    if math.isinf(single):
        return "INFINITY" if single > 0.0 else "-INFINITY"
    return "0.0f" if single == 0.0 else _hex(single)


def _hex(value: float) -> str:
    """Python's hexadecimal notation without the zeros that float32 never fills."""
    digits, _, exponent = value.hex().partition("p")
    digits = digits.rstrip("0").rstrip(".") if "." in digits else digits
    return f"{digits}p{int(exponent)}f"


def array(name: str, values: Iterable[Any]) -> str:
    """The definition of a constant array."""
    written = [number(value, name) for value in values]
    rows = (written[i : i + 6] for i in range(0, len(written), 6))
    body = "".join(f"    {', '.join(row)},\n" for row in rows)
    return f"static const float {name}[{len(written)}] = {{\n{body}}};\n"


def braces(values: Sequence[str]) -> str:
    """An initialiser."""
    return "{" + ", ".join(values) + "}"


def fill(template: str, words: dict[str, Any]) -> str:
    """A template of this package with its words filled in."""
    text = files("steersman.delivery.templates").joinpath(template).read_text(encoding="utf-8")
    return Template(text).substitute(words)
