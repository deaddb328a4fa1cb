"""Errors that are the user's to mend: the command line prints their one line and exits with 2."""

from __future__ import annotations

import difflib
from collections.abc import Iterable


class SteersmanError(Exception):
    """Base of every error whose message is meant for the user."""

    def __str__(self) -> str:
        """What is wrong, on one line, whatever it quotes."""
        return one_line(super().__str__())


class ConfigError(SteersmanError, ValueError):
    """A configuration names something unknown or holds a value that is not allowed.

    ``where`` is the path of fields to the fault; the caller one level up puts the name of its
    own field in front.

    >>> print(ConfigError("-3 is not allowed; must be greater than 0 [m]", ("path", "radius")))
    path.radius: -3 is not allowed; must be greater than 0 [m]
    """

    def __init__(self, what: str, where: tuple[str, ...] = ()) -> None:
        """``what`` is wrong, ``where`` if it concerns a field."""
        super().__init__(what, where)  # both are args, so that the error survives pickling
        self.what = what
        self.where = where

    def __str__(self) -> str:
        """Where, then what, on one line."""
        place = ".".join(self.where)
        return one_line(f"{place}: {self.what}" if place else self.what)


class DataError(SteersmanError, ValueError):
    """A file that was read is missing, malformed or corrupt."""


class ControllerError(SteersmanError, RuntimeError):
    """A controller returned something that no actuator can take."""


class PlantError(SteersmanError, RuntimeError):
    """A plant cannot be reached, or failed while it was driven."""


class TrainingDiverged(SteersmanError, RuntimeError):
    """Training was stopped because going on cannot lead anywhere."""


class TrainingStopped(SteersmanError, RuntimeError):
    """Training was stopped on request; it can go on."""


def how_to_install(extra: str) -> str:
    """The words that name an extra of this package and what installs it.

    The package is on no index: the first command works in the folder of its source, the second
    where it is installed already, however that was done.
    """
    here, anywhere = f"pip install '.[{extra}]'", f"pip install 'steersman[{extra}]'"
    return f"the extra {extra!r}: {here} in a source checkout, else {anywhere}"


def one_line(text: str) -> str:
    """``text`` without its line breaks, and without the indentation after them."""
    return " ".join(line.strip() for line in text.splitlines() if line.strip())


def shortened(text: str, most: int = 60) -> str:
    """``text``, or its beginning with dots after it if it has more than ``most`` characters."""
    return text if len(text) <= most else f"{text[: most - 3]}..."


def three_digits(value: float) -> str:
    """A number with three digits, and never as a power of ten where it is large.

    >>> three_digits(27.84), three_digits(1424.9)
    ('27.8', '1425')
    """
    text = f"{value:.3g}"
    return f"{value:.0f}" if "e+" in text else text


def suggestion(word: str, allowed: Iterable[str]) -> str:
    """The end of a message about an unknown ``word``: the nearest match, or all that is allowed.

    >>> suggestion("MPC-PID", ["mpc_pid", "stanley"])
    "; did you mean 'mpc_pid'?"
    >>> suggestion("x", ["mpc_pid", "stanley"])
    '; allowed: mpc_pid, stanley'
    """
    names = {_plain(name): name for name in sorted(allowed)}
    close = difflib.get_close_matches(_plain(word), names, n=1, cutoff=0.5)
    if close:
        return f"; did you mean {names[close[0]]!r}?"
    return f"; allowed: {', '.join(names.values())}" if names else "; there are none"


def _plain(word: str) -> str:
    return word.lower().replace("-", "_")
