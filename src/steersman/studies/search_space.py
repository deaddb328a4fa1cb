"""What a search of hyper-parameters may change, and the words for it.

``key=LOW..HIGH``, ``key=LOW..HIGH:log``, ``key=A|B``.
"""

from __future__ import annotations

import math
import re
from typing import Any, NamedTuple

from pydantic import field_validator, model_validator

from steersman.config import Settings, build, dump, override, param
from steersman.errors import ConfigError
from steersman.learning.config import TrainConfig

_NUMBER = r"[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?"
_RANGE = re.compile(rf"\s*(?P<low>{_NUMBER})\.\.(?P<high>{_NUMBER})(?P<log>:log)?\s*")
_WHOLE = re.compile(r"[-+]?\d+")


class SettingRange(NamedTuple):
    """The values that a search may give to a setting."""

    low: float = 0.0
    high: float = 0.0
    log: bool = False
    """Whether it is searched on a logarithmic scale."""
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


def has_setting(tree: Any, name: str) -> bool:
    """Whether a configuration has the setting ``name``, its parts joined by dots."""
    for part in name.split("."):
        if not isinstance(tree, dict) or part not in tree:
            return False
        tree = tree[part]
    return True


def applied(tree: dict[str, Any], values: dict[str, str]) -> dict[str, Any]:
    """The configuration with these settings."""
    return override(tree, [f"{name}={value}" for name, value in values.items()])


class SearchConfig(Settings):
    """A search for the hyper-parameters of a training."""

    training: TrainConfig = param(TrainConfig(), "-", "The training; what is not searched stays.")
    ranges: dict[str, str] = param(
        {},
        "-",
        "Setting of the training -> LOW..HIGH, LOW..HIGH:log or A|B; empty: the agent's own.",
    )
    trials: int = param(20, "-", "Trials in all, those of earlier sessions included.", ge=1)
    seeds: tuple[int, ...] = param((0, 1), "-", "Seeds with each of which a trial trains.")
    together: int = param(
        4, "-", "Trials proposed together, so that they can train at the same time.", ge=1
    )
    reduction: int = param(3, "-", "One in so many trials goes on at each rung.", ge=2)
    first: float = param(
        1.0 / 9.0, "-", "Share of the training's steps at the first rung; 1: no early stop.", gt=0,
        le=1,
    )  # fmt: skip
    seed: int = param(0, "-", "Seed of the proposals.", ge=0)

    @field_validator("seeds")
    @classmethod
    def _distinct(cls, value: tuple[int, ...]) -> tuple[int, ...]:
        if not value or len(set(value)) < len(value) or min(value) < 0:
            raise ValueError("needs at least one seed, each of them once, and none below 0")
        return value

    @model_validator(mode="after")
    def _trainable(self) -> SearchConfig:
        found = self.searched()
        if not found:
            raise ConfigError(
                f"agent {self.training.agent.kind} declares nothing to search; give a range, "
                "key=LOW..HIGH",
                ("ranges",),
            )
        tree = dump(self.training) or {}
        for name, span in found.items():
            for value in span.choices or (repr(span.low), repr(span.high)):
                whole = repr(int(float(value))) if span.whole else value
                build(TrainConfig, applied(tree, {name: whole}))
        return self

    def searched(self) -> dict[str, SettingRange]:
        """The settings that are searched, and their ranges.

        Raises:
            ConfigError: a range cannot be read.
        """
        if self.ranges:
            return {name: search_range(name, text) for name, text in self.ranges.items()}
        tree, agent = dump(self.training) or {}, self.training.agent
        declared = {f"agent.{name}": text for name, text in agent.search.items()}
        return {n: search_range(n, text) for n, text in declared.items() if has_setting(tree, n)}

    def rungs(self) -> list[int]:
        """Environment steps after which trials are compared, the last those of the training."""
        steps = float(self.training.steps)
        out: list[int] = []
        least = max(self.first * steps, self.training.validation.interval)
        while steps >= least or not out:
            out.append(round(steps))
            steps /= self.reduction
        return out[::-1]
