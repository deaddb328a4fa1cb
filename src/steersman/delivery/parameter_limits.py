"""The limits of a setting, as numbers and as text."""

from __future__ import annotations

import math
from typing import Any


def limits(field: Any) -> tuple[float, float]:
    """The least and the largest number that a field allows."""
    low, high = -math.inf, math.inf
    for bound in field.metadata:
        low = getattr(bound, "ge", low)
        high = getattr(bound, "le", high)
        low = math.nextafter(bound.gt, math.inf) if hasattr(bound, "gt") else low
        high = math.nextafter(bound.lt, -math.inf) if hasattr(bound, "lt") else high
    return low, high


def limit_texts(field: Any) -> tuple[str, str]:
    """The same as text: ``0`` where the limit itself is allowed, ``>0`` or ``<1`` where not.

    >>> from pydantic import BaseModel, Field
    >>> class Gains(BaseModel):
    ...     k: float = Field(gt=0, le=2)
    >>> limit_texts(Gains.model_fields["k"])
    ('>0.0', '2.0')
    """
    low = high = ""
    for bound in field.metadata:
        for name, sign in (("ge", ""), ("gt", ">")):
            low = f"{sign}{float(getattr(bound, name))!r}" if hasattr(bound, name) else low
        for name, sign in (("le", ""), ("lt", "<")):
            high = f"{sign}{float(getattr(bound, name))!r}" if hasattr(bound, name) else high
    return low, high
