"""What a search of hyper-parameters may change, and the words for it.

``key=LOW..HIGH``, ``key=LOW..HIGH:log``, ``key=A|B``.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any

from pydantic import field_validator, model_validator

from steersman.config import Settings, build, dump, override, param
from steersman.errors import ConfigError
from steersman.learning.config import TrainConfig
from steersman.ranges import SettingRange, search_range


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


def tied(trials: Iterable[tuple[int, int, float | None, Mapping[str, str]]]) -> list[str]:
    """Sentences about trials with other settings and the very same score: nothing was learned.

    >>> found = tied([(0, 500, 0.1, {"a": "1"}), (1, 500, 0.2, {}), (2, 500, 0.1, {"a": "2"})])
    >>> found[0].partition(":")[0]
    'trials 0, 2 have the same score to the last digit'

    Args:
        trials: number, steps, score and settings of each.
    """
    found: dict[tuple[int, float], dict[int, Mapping[str, str]]] = {}
    for number, steps, score, settings in trials:
        if score is not None:
            found.setdefault((steps, score), {})[number] = settings
    return [
        f"trials {', '.join(map(str, same))} have the same score to the last digit: nothing was"
        f" learned yet after {steps} steps; agent.learning_starts is to be less than"
        " validation.interval"
        for (steps, _), same in found.items()
        if len({tuple(sorted(settings.items())) for settings in same.values()}) > 1
    ]
