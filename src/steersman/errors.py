"""Errors that are the user's to mend: the command line prints their one line and exits with 2."""

from __future__ import annotations

import difflib
from collections.abc import Iterable


class SteersmanError(Exception):
    """Base of every error whose message is meant for the user."""


class ConfigError(SteersmanError, ValueError):
    """A configuration names something unknown or holds a value that is not allowed."""


class DataError(SteersmanError, ValueError):
    """A file that was read is missing, malformed or corrupt."""


class ControllerError(SteersmanError, RuntimeError):
    """A controller returned something that no actuator can take."""


class TrainingDiverged(SteersmanError, RuntimeError):
    """Training was stopped because going on cannot lead anywhere."""


def suggestion(word: str, allowed: Iterable[str]) -> str:
    """``; did you mean 'x'?``, or the list of what is allowed when nothing is close."""
    names = sorted(allowed)
    close = difflib.get_close_matches(word, names, n=1, cutoff=0.5)
    return f"; did you mean {close[0]!r}?" if close else f"; allowed: {', '.join(names)}"
