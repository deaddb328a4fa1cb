"""Validation during training: the policy alone, on fixed drives that it never learns from."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from operator import itemgetter
from pathlib import Path as FilePath
from typing import Any, NamedTuple

import numpy as np

from steersman.episode import Episode
from steersman.kernels import observe
from steersman.kernels import world as kernel
from steersman.learning.config import ValidationConfig
from steersman.learning.fleet import FleetDriver
from steersman.learning.problem import Problem
from steersman.learning.running import DRIVE
from steersman.learning.validation_drive import FleetRecord
from steersman.plants.mover import Shared
from steersman.types import FloatArray

# Mean errors below this are taken for it [m].
_FINEST = 1e-5


class Score(NamedTuple):
    """What a validation found."""

    mean_error: float
    """Mean |lateral error| [m]; a vehicle that left the corridor is charged the corridor's half
    width for the rest of its drive."""
    rms_error: float
    """Root mean square of the same [m]."""
    failures: int
    """Drives that left the corridor or rolled over."""
    steer_activity: float
    """RMS change of the steering command per step [-]."""
    total: float
    """What selects the best policy [m], plus the price of steering: either the geometric mean of
    the drives' mean errors, so that a millimetre counts where drives are easy and a decimetre
    where they are hard, times one plus the failures; or the RMS error. By the reward it is minus
    its mean, without unit, with the least that any step earned for what a failed drive did not
    drive."""

    def columns(self) -> dict[str, float]:
        """What ``progress.csv`` has of it."""
        return {
            "validation_error_mm": 1e3 * self.mean_error,
            "validation_rms_mm": 1e3 * self.rms_error,
            "validation_failures": self.failures,
            "validation_score": self.total,
            "steer_activity": self.steer_activity,
        }

    def rounded(self) -> dict[str, float]:
        """What a policy's card has of it."""
        return {name: round(float(value), 6) for name, value in self._asdict().items()}


class _Part(NamedTuple):
    """What some drives left: errors [m] and what counts of them, (steps, drives); sums."""

    errors: FloatArray
    counted: Any
    failures: int
    changes: float
    moves: int
    rewards: FloatArray
    """(steps, drives), NaN where a drive had failed or was over."""
    worst: tuple[float, Episode]
    """The largest mean error of a drive [m], and this drive."""


class Validator:
    """Drives the validation set; every call drives exactly the same."""

    def __init__(
        self,
        problem: Problem,
        config: ValidationConfig,
        shared: Shared | None = None,
        *,
        demonstrated: bool = False,
    ) -> None:
        """Build the drives: the training problem on other roads.

        They are without demonstration, unless it is the demonstrator that is to be judged. With a
        plant, which ``shared`` may be, they are driven one after the other.
        """
        alone = problem.demonstration.model_copy(update={"enabled": demonstrated})
        held_out = problem.model_copy(update={"roads": config.roads, "demonstration": alone})
        at_once = config.vehicles if problem.plant.computed and shared is None else 1
        self._driver = FleetDriver(held_out, at_once, shared)
        self._config = config
        self._steps = round(problem.episode_time / self._driver.dt)
        self._worst: Episode | None = None

    @property
    def source(self) -> str:
        """The plant in words, as results state it."""
        return self._driver.source

    def keep_worst(self, folder: FilePath) -> None:
        """Keep the drive with the largest mean error of the last score in a training's folder."""
        if self._worst is not None:
            self._worst.save(folder / DRIVE)

    def attenuate(self, share: float) -> None:
        """From now on drive with this share of the base's steering."""
        self._driver.base_share = share

    def close(self) -> None:
        """Release the plant, for all that share it; may be called twice."""
        self._driver.close()

    def score_demonstrator(self) -> Score:
        """How the demonstrator drives; only with ``demonstrated``."""
        return self.score(lambda _: self._driver.demonstrated_actions())

    def score(self, act: Callable[[Any], Any]) -> Score:
        """Drive with ``act``, which maps features (n, k) to actions (n, m)."""
        seeds = np.random.SeedSequence(self._config.seed).spawn(self._config.vehicles)
        n = self._driver.n
        parts = [self._drive(act, seeds[i : i + n]) for i in range(0, len(seeds), n)]
        self._worst = max((part.worst for part in parts), key=itemgetter(0))[1]
        errors, counted = (np.concatenate(a, axis=1) for a in list(zip(*parts, strict=True))[:2])
        errors = np.nan_to_num(errors, nan=self._driver.problem.corridor)
        drives = [float(errors[counted[:, i], i].mean()) for i in range(errors.shape[1])]
        typical = float(np.exp(np.log(np.maximum(drives, _FINEST)).mean()))
        errors = errors[counted]
        changes = sum(part.changes for part in parts)
        activity = (changes / max(sum(part.moves for part in parts), 1)) ** 0.5
        failures = sum(part.failures for part in parts)
        rms = float(np.sqrt((errors**2).mean()))
        if self._config.select == "reward":
            base = -_mean_reward(np.concatenate([p.rewards for p in parts], axis=1)[counted])
        else:
            base = rms if self._config.select == "rms" else typical * (1.0 + failures)
        total = base + self._config.steer_weight * activity
        return Score(float(errors.mean()), rms, failures, activity, total)

    def _drive(self, act: Callable[[Any], Any], seeds: Sequence[np.random.SeedSequence]) -> _Part:
        """The drives of these seeds, all at once."""
        driver, fleet = self._driver, self._driver.fleet
        driver.seed_each(seeds)
        for i in range(driver.n):
            driver.reset(i)
        corridor = driver.problem.corridor
        errors = np.full((self._steps, driver.n), corridor)
        alive = np.ones(driver.n, dtype=bool)
        failed = np.zeros(driver.n, dtype=bool)
        counted = np.ones((self._steps, driver.n), dtype=bool)
        rewards = np.full((self._steps, driver.n), np.nan)
        changes, moves = 0.0, 0
        before, record = driver.last_commands().copy(), FleetRecord(driver)
        for k, _ in zip(range(self._steps), self._drive_on(act), strict=False):
            record.stepped(alive)
            ended = fleet.ended != kernel.RUNNING
            lost = np.isin(fleet.ended, kernel.FAILED)
            errors[k, alive] = np.minimum(np.abs(fleet.tracking[alive, observe.D]), corridor)
            # A command that is NaN counts as the largest change there is, lock to lock.
            step = np.nan_to_num(driver.last_commands() - before, nan=2.0)
            before = driver.last_commands().copy()
            changes += float((step[alive] ** 2).sum())
            moves += int(alive.sum())
            rewards[k, alive & ~lost] = fleet.reward[alive & ~lost, 0]
            failed |= alive & lost
            alive &= ~ended
            # A drive that reached the end of its road is over; one that failed goes on costing.
            counted[k + 1 :, ended & ~failed] = False
            if not alive.any():
                break
        each = np.nan_to_num(errors, nan=corridor).mean(axis=0, where=counted)
        worst = int(each.argmax())
        found = float(each[worst]), record.episode(worst)
        return _Part(errors, counted, int(failed.sum()), changes, moves, rewards, found)

    def _drive_on(self, act: Callable[[Any], Any]) -> Iterator[Any]:
        """Drive, with a pause after each control step, until no vehicle is left."""
        fleet = self._driver.fleet
        while (fleet.ended == kernel.RUNNING).any():
            yield from self._driver.steps(np.clip(act(fleet.inputs), -1.0, 1.0))


def _mean_reward(rewards: FloatArray) -> float:
    """Mean of the steps' rewards; one that was not driven (NaN) earns the least of all, at most 0.

    Where driving on costs more than it earns, an early end must not be worth it.
    """
    least = float(np.fmin.reduce(rewards, axis=None, initial=0.0))
    return float(np.where(np.isnan(rewards), least, rewards).mean())
