"""Samples for an imitation: from driving, or from data that were recorded."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Protocol

import numpy as np

from steersman.config import dump
from steersman.learning.datasets.source import load
from steersman.learning.datasets.trajectory import (
    Trajectory,
    Who,
    actions_for,
    features,
    shown,
    steps,
)
from steersman.learning.fleet import FleetDriver
from steersman.learning.imitation.config import ImitationConfig
from steersman.learning.imitation.driving import Drives, Driving, collect
from steersman.learning.least_squares import Dataset
from steersman.learning.problem import Problem
from steersman.learning.validate import Score, Validator
from steersman.plants.mover import Shared

Act = Callable[[Any], Any]


class SampleSource(Protocol):
    """Gives samples, round by round."""

    per_round: int
    """What a round adds to the steps that are counted."""
    shared: Shared | None
    """The plant that the validation has to drive, too; None: one of its own."""

    def judge(self) -> Score | None:
        """Validation of what is imitated; None if it cannot be driven."""

    def announce(self, judged: Score | None) -> str:
        """What is imitated, in a sentence."""

    def round(
        self, k: int, act: Act, seed: np.random.SeedSequence, tick: Callable[[float], None]
    ) -> Drives:
        """New samples of round ``k``; ``act`` is the network, used from the second round on."""

    def note(self) -> dict[str, Any]:
        """What a policy's card says of it."""

    def close(self) -> None:
        """Release the plant, if there is one."""


class Driven:
    """Samples of driving: by the demonstrator, from the second round on by the network."""

    def __init__(self, config: ImitationConfig) -> None:
        """Make the vehicles."""
        self._config = config
        self._driver = FleetDriver(config.problem, config.vehicles)
        self.per_round = config.round_steps * config.vehicles
        self.shared: Shared | None = self._driver.mover.shared

    def judge(self) -> Score:
        """The demonstrator, through the same action as the network."""
        config = self._config
        judge = Validator(config.problem, config.validation, self.shared, demonstrated=True)
        return judge.score_demonstrator()

    def announce(self, judged: Score | None) -> str:
        """How the demonstrator drives."""
        assert judged is not None
        kind = self._config.problem.demonstration.controller.kind
        return f"{kind} itself on the validation drives: {score_text(judged)}"

    def round(
        self, k: int, act: Act, seed: np.random.SeedSequence, tick: Callable[[float], None]
    ) -> Drives:
        """Drive; in the first round there is no network yet."""
        config = self._config
        total, done = self.per_round * config.rounds, k * self.per_round
        sigma = config.noise.value(done, total)
        beta = 1.0 if config.method == "bc" else config.beta.value(done, total)
        driving = Driving(act if k else None, beta, sigma, config.noise_theta)
        seeds = seed.generate_state(3).tolist()
        return collect(self._driver, driving, config.round_steps, seeds, tick)

    def note(self) -> dict[str, Any]:
        """The demonstrator."""
        return {"demonstrator": dump(self._config.problem.demonstration.controller)}

    def close(self) -> None:
        """Release the plant, if there is one."""
        self._driver.close()


class Given:
    """Data that were recorded; all of them are there from the first round on."""

    shared: Shared | None = None

    def __init__(self, config: ImitationConfig) -> None:
        """Read them.

        Raises:
            DataError: they cannot be read, or hold no drive.
            ConfigError: the problem is another one.
        """
        self._config = config
        self._drives = load(config.problem, config.data, config.ahead)
        self._steps = steps(self._drives)
        self.per_round = -(-self._steps // config.rounds)
        parts = [samples(config.problem, one, config.label) for one in self._drives]
        self._data = Dataset(*(np.concatenate(columns) for columns in zip(*parts, strict=True)))

    def judge(self) -> None:
        """The driver of recorded data cannot drive the validation."""

    def announce(self, judged: Score | None) -> str:
        """How much there is, and the shares of its drivers."""
        who = np.concatenate([one.driver for one in self._drives])
        shares = [f"{np.mean(who == w):.0%} by {w.name.lower()}" for w in Who if np.any(who == w)]
        names = ", ".join(self._config.data)
        return f"{self._steps} steps of {len(self._drives)} drives, {', '.join(shares)}: {names}"

    def round(
        self, k: int, act: Act, seed: np.random.SeedSequence, tick: Callable[[float], None]
    ) -> Drives:
        """All samples in the first round, none later."""
        data, ended = self._data, sum(one.terminated for one in self._drives)
        gap = float(np.sqrt(np.mean((act(data.features) - data.actions) ** 2))) if k else np.nan
        errors = np.concatenate([one.places[:-1, 0] for one in self._drives])
        who = np.concatenate([one.driver for one in self._drives])
        return Drives(
            data=data if k == 0 else Dataset.empty(data.features.shape[1], data.actions.shape[1]),
            mean_error=float(np.mean(np.abs(errors))),
            off_track=ended if k == 0 else 0,
            difference=gap,
            demonstrated=float(np.mean(who != Who.OWN)),
        )

    def note(self) -> dict[str, Any]:
        """What was learned from."""
        return {"data": list(self._config.data), "label": self._config.label}

    def close(self) -> None:
        """There is no plant."""


def samples(problem: Problem, one: Trajectory, label: str) -> Dataset:
    """A drive as samples of the problem's policy.

    The label ``demonstrated`` is the demonstrator's action, or where there is none the executed.
    """
    wanted = shown(one) if label == "demonstrated" else one.steer
    actions = actions_for(problem, one.rows, one.steer, wanted)
    seen = features(problem, one.rows, one.steer)[:-1]
    return Dataset(seen, np.clip(actions, -1.0, 1.0).astype(np.float32))


def score_text(score: Score) -> str:
    """A validation in a few words."""
    return (
        f"RMS error {1e3 * score.rms_error:.4g} mm, mean {1e3 * score.mean_error:.4g} mm, "
        f"{score.failures} failed, RMS steering change {score.steer_activity:.4f}"
    )
