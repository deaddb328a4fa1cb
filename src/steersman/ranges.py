"""Ranges of a setting in words: LOW..HIGH, LOW..HIGH:log, A|B; seeds: LOW..HIGH, A,B."""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Sequence
from typing import Any, NamedTuple

from steersman.errors import ConfigError

_NUMBER = r"[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?"
_RANGE = re.compile(rf"\s*(?P<low>{_NUMBER})\.\.(?P<high>{_NUMBER})(?P<log>:log)?\s*")
_MOST_SEEDS = 10_000
_WHOLE = re.compile(r"[-+]?\d+")


class SettingRange(NamedTuple):
    """The values that a setting may get."""

    low: float = 0.0
    high: float = 0.0
    log: bool = False
    """Whether its scale is logarithmic."""
    whole: bool = False
    """Whether only whole numbers are meant."""
    choices: tuple[str, ...] = ()
    """Values to choose from instead, as they are written in an assignment."""

    def __str__(self) -> str:
        """As it is written in a word."""
        if self.choices:
            return "|".join(self.choices)
        low, high = (f"{end:g}" for end in (self.low, self.high))
        return f"{low}..{high}{':log' if self.log else ''}"

    def suggest(self, name: str, trial: Any) -> str:
        """A trial's value of the setting ``name``, as it is written in an assignment."""
        if self.choices:
            return str(trial.suggest_categorical(name, list(self.choices)))
        if self.whole:
            value = trial.suggest_int(name, int(self.low), int(self.high), log=self.log)
        else:
            value = trial.suggest_float(name, self.low, self.high, log=self.log)
        return repr(value)


def is_range(text: str) -> bool:
    """Whether the right side of an assignment gives a range or choices.

    >>> [is_range(text) for text in ("0.9..0.99", "1e-4..1e-3:log", "ddpg|td3", "0.9", "a..b")]
    [True, True, True, False, False]
    """
    return "|" in text or _RANGE.fullmatch(text) is not None


def search_range(name: str, text: str) -> SettingRange:
    """The range that ``text`` describes.

    >>> search_range("agent.gamma", "0.9..0.99")
    SettingRange(low=0.9, high=0.99, log=False, whole=False, choices=())
    >>> search_range("agent", "ddpg|td3").choices
    ('ddpg', 'td3')

    Raises:
        ConfigError: it is none.
    """
    if "|" in text:
        choices = tuple(part.strip() for part in text.split("|"))
        if len(set(choices)) < len(choices) or "" in choices:
            raise ConfigError(f"{text!r} has an empty or a repeated choice", (name,))
        return SettingRange(choices=choices)
    match = _RANGE.fullmatch(text)
    if match is None:
        form = "LOW..HIGH, LOW..HIGH:log or A|B"
        raise ConfigError(f"{text!r} is no range; write it as {form}", (name,))
    low, high, log = float(match["low"]), float(match["high"]), match["log"] is not None
    if not (math.isfinite(low) and math.isfinite(high) and low < high):
        raise ConfigError(f"{text!r}: the first number must be less than the second", (name,))
    if log and low <= 0.0:
        raise ConfigError(f"{text!r}: a logarithmic range must begin above 0", (name,))
    whole = all(_WHOLE.fullmatch(match[end]) for end in ("low", "high"))
    return SettingRange(low, high, log, whole)


def seed_list(given: str | Iterable[int]) -> list[int]:
    """Seeds from a list, or from a text with numbers and ranges.

    >>> seed_list("0..2,7")
    [0, 1, 2, 7]

    Raises:
        ConfigError: the text is neither, or names a seed twice.
    """
    if not isinstance(given, str):
        return list(given)
    seeds: list[int] = []
    for part in given.strip().strip("[]").split(","):
        first, dots, last = (piece.strip() for piece in part.partition(".."))
        ends = (first, last) if dots else (first, first)
        if not all(end.isascii() and end.isdecimal() for end in ends):
            raise ConfigError(f"{given!r} is not a list of seeds; write 0..4 or 0,3,7", ("seeds",))
        low, high = int(ends[0]), int(ends[1])
        if not low <= high < low + _MOST_SEEDS:
            raise ConfigError(f"{part.strip()} is not a range of seeds", ("seeds",))
        seeds += range(low, high + 1)
    if len(set(seeds)) < len(seeds):
        raise ConfigError(f"{given!r} names a seed twice", ("seeds",))
    return seeds


def split_seeds(words: Sequence[Any]) -> tuple[list[int] | None, list[Any]]:
    """The seeds that ``seeds=...`` names, None without it, and all other words.

    >>> split_seeds(["demo", "seeds=0..2,7", "steps=1e4"])
    ([0, 1, 2, 7], ['demo', 'steps=1e4'])

    Raises:
        ConfigError: they cannot be read, or come twice.
    """
    keys = [word.partition("=")[0].strip() if isinstance(word, str) else "" for word in words]
    given = [word for word, key in zip(words, keys, strict=True) if key == "seeds"]
    others = [word for word in words if word not in given]
    if not given:
        return None, others
    if len(given) > 1:
        raise ConfigError(f"given twice: {given[0]} and {given[1]}", ("seeds",))
    if "seed" in keys:
        rival = words[keys.index("seed")]
        raise ConfigError(f"{given[0]} and {rival} contradict each other; give one of them")
    return seed_list(given[0].partition("=")[2]), others
