"""Errors that are the user's to mend: the command line prints their one line and exits with 2."""

from __future__ import annotations

import difflib
from collections.abc import Iterable
from pathlib import Path as FilePath

# A name is meant if it is so like what was written; what is contained in one has so many letters.
_CLOSE, _WHOLE_WORD = 0.5, 4
# Names are listed whole up to so many and letters; of more, so many are.
_MOST_NAMES, _MOST_LETTERS, _FEW_NAMES = 16, 300, 8


_SHEET = "; save the sheet as CSV"
NMEA = "NMEA becomes GPX first: gpsbabel -i nmea -f FILE -o gpx -F track.gpx"
OTHER_FORMATS = {
    ".xml": "; maps of CommonRoad and SUMO become OpenDRIVE first (docs/your_road.md)",
    ".kml": "; KML becomes GPX first: gpsbabel -i kml -f FILE -o gpx -F track.gpx",
    ".kmz": "; KML becomes GPX first: gpsbabel -i kml -f FILE -o gpx -F track.gpx",
    **dict.fromkeys((".nmea", ".nma"), f"; {NMEA}"),
    **dict.fromkeys((".xlsx", ".xlsm", ".xls", ".ods"), _SHEET),
}
"""What becomes of files of roads that are not read, the end of a message by their ending."""


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
    here, anywhere = (
        f"pip install -c constraints.txt -e '.[{extra}]'",
        f"pip install 'steersman[{extra}]'",
    )
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


def counted(number: int, noun: str) -> str:
    """So many of them.

    >>> counted(1, "road"), counted(2, "road")
    ('1 road', '2 roads')
    """
    return f"{number} {noun}{'' if number == 1 else 's'}"


def no_such_place(word: str, names: Iterable[str]) -> str:
    """The end of a message about a word with a folder before it; empty if it is rather a name.

    >>> no_such_place("runs/nosuch", ["pid", "tuned/lqr"]), no_such_place("tuned/pi", ["tuned/lqr"])
    ('; no such file or folder', '')
    """
    first, slash, rest = word.partition("/")
    known = any(name.startswith(f"{first}/") for name in names)
    return "; no such file or folder" if slash and rest and not known else ""


def suggestion(word: str, allowed: Iterable[str]) -> str:
    """The end of a message about an unknown ``word``: the nearest match, or what is allowed.

    Of many names the likest come first, and the others are counted.

    >>> suggestion("MPC-PID", ["mpc_pid", "stanley"])
    "; did you mean 'mpc_pid'?"
    >>> suggestion("x", ["mpc_pid", "stanley"])
    '; allowed: mpc_pid, stanley'
    >>> suggestion("mine", ["their_mine_of_steering", "stanley"])
    "; did you mean 'their_mine_of_steering'?"
    >>> suggestion("zzx", [f"z{k}" for k in range(30)])
    '; allowed: z0, z1, z2, z3, z4, z5, z6, z7 and 22 more'
    """
    names = sorted(allowed)
    nearest = sorted(names, key=lambda name: -_likeness(word, name))
    if not names:
        return "; there are none"
    if _likeness(word, nearest[0]) >= _CLOSE:
        return f"; did you mean {nearest[0]!r}?"
    if len(names) <= _MOST_NAMES and len(text := ", ".join(names)) <= _MOST_LETTERS:
        return f"; allowed: {text}"
    shown = nearest[:_FEW_NAMES]
    return f"; allowed: {', '.join(shown)} and {len(names) - len(shown)} more"


def _likeness(word: str, name: str) -> float:
    """From 0 to 1; a word that the name contains is like it."""
    one, other = _plain(word), _plain(name)
    if len(one) >= _WHOLE_WORD and one in other:
        return 1.0 - _CLOSE * (1.0 - len(one) / len(other))
    return difflib.SequenceMatcher(None, other, one).ratio()


def _plain(word: str) -> str:
    return word.lower().replace("-", "_")


def there(word: str, what: str) -> str:
    """The words for a file or folder that is there and does not hold what is wanted; or nothing."""
    place = FilePath(word)
    try:
        if place.is_file():
            return f"it is a file that holds no {what}"
        inside = "config.yaml" if (place / "config.yaml").is_file() else ""
        told = f"it is a folder that holds no {what}" if place.is_dir() else ""
    except OSError:
        return ""
    return f"{told}; what it was driven with: {place / inside}" if told and inside else told


def near_file(word: str, endings: Iterable[str]) -> str:
    """The words that name what was meant, of that which is in its folder; empty without one.

    Args:
        word: no file, or the stem of one; with a folder before it and no ending, a folder as well.
        endings: of files that would do.
    """
    place = FilePath(word)
    try:
        inside, below = place.parent.iterdir(), len(place.parts) > 1 and not place.suffix
        files = [f for f in inside if (below if f.is_dir() else f.suffix in set(endings))]
    except (OSError, ValueError):
        return ""
    names = {f.name: f for f in sorted(files) if f != place}
    stems = [f.name for f in names.values() if f.stem == place.name]
    close = stems or difflib.get_close_matches(place.name, names, n=1, cutoff=0.8)
    return f"did you mean {str(names[close[0]])!r}?" if close else ""
