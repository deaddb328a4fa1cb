"""Which column of a table holds what: by its title and unit, or as the user assigns them.

The user says it with ``NAME=TITLE,NAME=TITLE``: the title as in the file's header, or the number
of the column from 1. A unit that is not the usual one stands behind the name or the title
(``v_x_km_h=wheel``, ``v_x=wheel [km/h]``); a minus before the title, ``*NUMBER`` or ``/NUMBER``
behind it change the numbers.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from typing import NamedTuple

from steersman.errors import ConfigError, shortened, suggestion
from steersman.tables import Sheet

_DEG = 0.017453292519943295
LENGTH = {
    **{"m": 1.0, "km": 1e3, "cm": 1e-2, "mm": 1e-3},
    **{"ft": 0.3048, "inch": 0.0254, "yd": 0.9144},
}
SPEED = {"m_s": 1.0, "km_h": 1.0 / 3.6, "mph": 0.44704, "kn": 1852.0 / 3600.0}
ANGLE = {"rad": 1.0, "deg": _DEG}
_PARTS = (("", "m"), ("kilo", "km"), ("centi", "cm"), ("milli", "mm"))
# Other ways to write the units that are known by their letters, with _ for a division.
_SPELLINGS = {
    **{
        f"{part}{metre}{s}": unit
        for metre in ("meter", "metre")
        for s in ("", "s")
        for part, unit in _PARTS
    },
    **{"feet": "ft", "foot": "ft", "in": "inch", "inches": "inch", "yard": "yd", "yards": "yd"},
    "mps": "m_s",
    "kmh": "km_h",
    "kph": "km_h",
    "kmph": "km_h",
    "knots": "kn",
    "radps": "rad_s",
    "degps": "deg_s",
    "mps2": "m_s2",
    "degree": "deg",
    "degrees": "deg",
    "°": "deg",
    "%": "percent",
    "sec": "s",
    "seconds": "s",
}
_UNIT = re.compile(r"(.*\S)\s*[\[(<]\s*([^\[(<]*?)\s*[\])>]")
_UMLAUTS = str.maketrans({"ä": "ae", "ö": "oe", "ü": "ue", "ß": "ss"})
_NOT_IN_NAMES = re.compile(r"[^a-z0-9]+")
_SCALED = re.compile(r"(.+?)\s*([*/])\s*([0-9.]+(?:[eE][+-]?[0-9]+)?)")
_NEXT_NAME = re.compile(r",\s*(?=\w+\s*=)")
# Of titles in a message: how many, and the letters of each.
_MOST_TITLES, _LONGEST_TITLE = 10, 40


class ExpectedColumn(NamedTuple):
    """A quantity that a column of a table may hold."""

    meaning: str
    units: Mapping[str, float]
    """Unit -> factor to the kept one, which is the first."""
    names: tuple[str, ...] = ()
    """Other names that it goes by, the most certain first."""
    with_unit: tuple[str, ...] = ()
    """Words that also mean something else: they name it only with one of its units behind them."""


class Wanted(NamedTuple):
    """What a user says of a column."""

    title: str
    unit: str | None = None
    """Behind the name; None: that of the title."""


class Found(NamedTuple):
    """A column of a table, and the factor to the unit that its quantity is kept in."""

    place: int
    factor: float


def parse(text: str, columns: Mapping[str, ExpectedColumn]) -> dict[str, Wanted]:
    """The titles of columns that a user names.

    >>> parse("v_x_km_h=wheel speed", {"v_x": ExpectedColumn("speed ahead", SPEED)})
    {'v_x': Wanted(title='wheel speed', unit='km_h')}

    Raises:
        ConfigError: a part is not ``NAME=TITLE``, or a name is unknown or given twice.
    """
    names = {name: (name, None) for name in columns} | {
        f"{name}_{unit}": (name, unit) for name, c in columns.items() for unit in c.units if unit
    }
    out: dict[str, Wanted] = {}
    for part in _NEXT_NAME.split(text.strip()) if text.strip() else []:
        word, _, title = (piece.strip() for piece in part.partition("="))
        if not word or not title:
            like = ",".join(f"{name}=TITLE" for name in list(columns)[:2])
            raise ConfigError(f"{part!r} is not NAME=TITLE; write e.g. {like}")
        if word not in names:
            raise ConfigError(f"no column is called {word!r} here{suggestion(word, columns)}")
        name, unit = names[word]
        if name in out:
            raise ConfigError(f"{name} is given twice, as {out[name].title!r} and {title!r}")
        out[name] = Wanted(title, unit)
    return out


def find(
    sheet: Sheet,
    columns: Mapping[str, ExpectedColumn],
    given: Mapping[str, Wanted] | None = None,
    *,
    single: bool = False,
) -> dict[str, Found]:
    """The columns of a table that are there: those that the user names, the others by their titles.

    Args:
        sheet: the table.
        columns: what may be in it.
        given: what the user says.
        single: whether a second column of the same name is refused; else the first one counts.

    Raises:
        DataError: a column that the user names is not there, or its unit is not known.
    """
    given = given or {}
    out = {}
    for name, column in columns.items():
        if name in given:
            out[name] = _named(sheet, name, column, given[name])
            continue
        ranks = [_rank(title, name, column) for title in sheet.titles if sheet.headed]
        best = min((rank for rank in ranks if rank is not None), default=None)
        places = [place for place, rank in enumerate(ranks) if rank == best is not None]
        if single and len(places) > 1:
            both = " and ".join(sheet.titles[place] for place in places[:2])
            raise sheet.fault(sheet.title_line, f"{both} are the same; keep one of them")
        if places:
            unit = _apart(sheet.titles[places[0]], column)[1]
            out[name] = Found(places[0], _factor(sheet, name, column, unit))
    return out


def _rank(title: str, name: str, column: ExpectedColumn) -> int | None:
    """The rank of a title among the names of a column; None if it is none of them."""
    words = [name, *column.names, *column.with_unit]
    bare, unit = _apart(title, column)
    if bare in column.with_unit and unit not in column.units:
        return None
    found = {_plain(title), bare}
    return next((rank for rank, word in enumerate(words) if word in found), None)


def _named(sheet: Sheet, name: str, column: ExpectedColumn, wanted: Wanted) -> Found:
    """The column that the user names by title or number."""
    exact = wanted.title if wanted.title in sheet.titles else None
    for title, factor in _readings(wanted.title) if exact is None else [(exact, 1.0)]:
        place = _place(sheet, column, title) if exact is None else sheet.titles.index(exact)
        if place is not None:
            own = _apart(sheet.titles[place], column)[1] if sheet.headed else None
            unit = wanted.unit or _apart(title, column)[1] or own
            if abs(factor) != 1.0 and unit not in column.units:
                unit = None  # the user's factor stands for it
            return Found(place, factor * _factor(sheet, name, column, unit))
    near = suggestion(wanted.title, sheet.titles)
    raise sheet.fault(sheet.title_line, f"no column {wanted.title!r} for {name}{near}")


def _readings(text: str) -> Iterator[tuple[str, float]]:
    """Titles and factors that the words of a user may mean, the plainest first."""
    bare, sign = text.removeprefix("-").lstrip(), -1.0 if text.startswith("-") else 1.0
    yield bare, sign
    scaled = _SCALED.fullmatch(bare)
    if scaled is not None and float(scaled[3]) > 0.0:
        yield scaled[1], sign * float(scaled[3]) ** (1 if scaled[2] == "*" else -1)


def _place(sheet: Sheet, column: ExpectedColumn, title: str) -> int | None:
    """Where a title stands: as it is, or but for its unit; or the column of that number."""
    bare, plain = _apart(title, column)[0], _plain(title)
    for place, other in enumerate(sheet.titles):
        if plain == _plain(other) or _apart(other, column)[0] in {bare, plain}:
            return place
    number = int(bare) if bare.isdecimal() else 0
    return number - 1 if 0 < number <= len(sheet.titles) else None


def _factor(sheet: Sheet, name: str, column: ExpectedColumn, unit: str | None) -> float:
    if unit is None:
        return 1.0
    if unit not in column.units:
        allowed = ", ".join(unit for unit in column.units if unit)
        raise sheet.fault(
            sheet.title_line, f"{name} in {unit!r} is not known; its units: {allowed}"
        )
    return column.units[unit]


def _apart(title: str, column: ExpectedColumn) -> tuple[str, str | None]:
    """The name in a title and the unit behind it: in brackets, or one of the column's after _."""
    match = _UNIT.fullmatch(title.strip())
    if match is not None:
        return _plain(match[1]), _unit(match[2])
    name = _plain(title)
    for unit in (*column.units, *_SPELLINGS):
        if unit and name.endswith(f"_{unit}") and _unit(unit) in column.units:
            return name.removesuffix(f"_{unit}"), _unit(unit)
    return name, None


def _unit(text: str) -> str | None:
    """The unit as it is known: m/s², m/s^2, m*s^-2 and mps2 are one; None: without one."""
    plain = text.lower().replace("²", "2").replace("^", "").replace(" ", "").replace("/", "_")
    return None if plain in {"", "-"} else _SPELLINGS.get(plain, plain)


def _plain(title: str) -> str:
    return _NOT_IN_NAMES.sub("_", title.lower().translate(_UMLAUTS)).strip("_")


def some_titles(titles: Sequence[str]) -> str:
    """Titles for a message, each of them whole; the others are counted.

    >>> some_titles(["Zeit [ms]", "Breite [deg]", *"abcdefghijklmnopqrst"])
    'Zeit [ms], Breite [deg], a, b, c, d, e, f, g, h and 12 more'
    """
    shown = titles[:_MOST_TITLES]
    more = len(titles) - len(shown)
    return ", ".join(shortened(title, _LONGEST_TITLE) for title in shown) + (
        f" and {more} more" if more else ""
    )
