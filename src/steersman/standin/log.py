"""What the server tells whoever runs it, through ``logging``; nothing is said twice."""

from __future__ import annotations

import logging

log = logging.getLogger("steersman.standin")
# A client that repeats a mistake at every tick must fill neither the terminal nor the memory.
_MOST = 1000
_said: set[str] = set()


def warn_once(text: str) -> None:
    """Log a line, unless it was logged before or there have been too many."""
    if text not in _said and len(_said) < _MOST:
        _said.add(text)
        log.warning("%.300s", text)
