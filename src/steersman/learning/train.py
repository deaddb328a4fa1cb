"""Train: collect with the demonstrator, update, validate, record, export."""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from pathlib import Path as FilePath
from typing import Any

import numpy as np

from steersman.errors import TrainingStopped
from steersman.files import alone
from steersman.learning import checkpoint, running
from steersman.learning.arithmetic import arithmetic
from steersman.learning.config import TrainConfig
from steersman.learning.networks import WeightAverage
from steersman.learning.progress import (
    Record,
    TrainResult,
    TrainRow,
    alarms,
    check_progress,
    chosen_words,
    learned,
)
from steersman.learning.running import RunningTraining
from steersman.learning.snapshot import Tree

# What the loop itself counts, beside agent and environments.
_COUNTERS = ("best", "next_validation", "next_checkpoint", "_marks", "_count")
Reporter = Callable[[TrainRow], None]


@alone("out")
def train(
    config: TrainConfig,
    out: FilePath,
    reporter: Reporter | None = None,
    *,
    tick: Callable[[int], None] | None = None,
    notify: Callable[[str], None] | None = None,
    overwrite: bool = False,
    resume: bool = False,
    until: int | None = None,
) -> TrainResult:
    """Run a training and return what it left; ``result.policy`` is the exported policy.

    Writes ``config.yaml``, ``progress.csv``, TensorBoard events, ``checkpoints/`` and the best
    policy so far (by validation) as ``policy.onnx`` with its card; ``resume/`` while it runs.

    Args:
        config: what to train.
        out: folder, made if need be.
        reporter: called at every validation with the new row of ``progress.csv``.
        tick: called about twice a second with the environment steps done.
        notify: called with a sentence: where it resumes, or why not, and which policy is exported.
        overwrite: replace an earlier training in ``out``.
        resume: go on from the last checkpoint in ``out``, or begin if there is none.
        until: stop with a checkpoint after so many environment steps, from which ``resume`` goes
            on; at least one validation has to come before. None: to the end.

    Raises:
        DataError: ``out`` holds a training already, or cannot be written.
        ConfigError: the training to be resumed has another configuration.
        TrainingDiverged: losses or values are no longer finite or plausible, or the action
            sticks to its limit.
        TrainingStopped: it was asked to, by the file ``request`` in ``out``.
    """
    say = notify or (lambda _: None)
    finished, saved = checkpoint.begin(config, out, say, overwrite=overwrite, resume=resume)
    if finished:
        return learned(out, config, TrainRow)
    with arithmetic(config.threads):
        done = None if saved is None else int(saved["agent"]["counters"]["num_timesteps"])
        if done is not None:
            say(f"{out}: going on after {done} steps")
        if until is None or done is None or done < until:
            with running.told(out, done or 0, config.steps, tick) as state:
                _Training(config, out, reporter or (lambda _: None), state, done, until).run(saved)
    result = learned(out, config, TrainRow)
    if until is None:
        say(chosen_words(result))
    return result


class _Paused(Exception):
    """Ends a training that is to go on later."""


class _Training:
    """One training run; SB3 calls back after every vector step."""

    def __init__(
        self,
        config: TrainConfig,
        out: FilePath,
        reporter: Reporter,
        state: RunningTraining,
        resumed_at: int | None = None,
        until: int | None = None,
    ) -> None:
        from steersman.learning.datasets.recorder import Keeper
        from steersman.learning.validate import Validator
        from steersman.learning.vec_env import PathFollowingVecEnv

        self.config, self.out, self.reporter, self.state = config, out, reporter, state
        self.until = until
        self.env = PathFollowingVecEnv(config.problem, config.agent.vehicles)
        self.agent = config.agent.make(config, self.env)
        self.keeper = Keeper(self.env, out) if config.keep else None
        self.validator = Validator(config.problem, config.validation, self.env.driver.mover.shared)
        self.best = math.inf
        self.env.driver.base_share = self._base_share()
        self.record = Record(out, resumed_at, TrainRow)
        # Computing time, not the clock: what else the machine does is no part of the training.
        self.begun = time.process_time()
        self.next_validation = config.validation.interval
        self.next_checkpoint = config.checkpoint_interval
        self._marks = {"steps": 0, "error": 0.0, "demo": 0, "saturated": 0, "sampled": 0}
        self._sums = np.zeros(3)
        self._count = 0
        self.agent.weights()  # laid flat now, so that every run computes on the same memory
        self.average = WeightAverage(self.agent.actor_net().flat.size)

    def run(self, saved: Tree | None = None) -> None:
        """Train to the end, from the beginning or from a checkpoint."""
        from stable_baselines3.common.callbacks import BaseCallback

        training = self

        class Hook(BaseCallback):
            def _on_training_start(self) -> None:
                if saved is not None:  # now, as SB3 has just reset noise and environments
                    training.restore(saved)
                elif training.config.problem.base is not None:
                    training._validate()  # before any update: the base alone

            def _on_rollout_start(self) -> None:
                training._between_steps()

            def _on_step(self) -> bool:
                training._after_step()
                return True

        agent = self.agent
        if saved is not None:  # SB3 counts from here
            agent.num_timesteps = saved["agent"]["counters"]["num_timesteps"]
        try:
            agent.learn(
                self.config.steps - agent.num_timesteps,
                callback=Hook(),
                log_interval=2**62,  # SB3's own log, which is not wanted
                reset_num_timesteps=False,
            )
            agent.open()
            if not self.record.rows or self.record.rows[-1].steps < agent.num_timesteps:
                self._validate()
            if self.keeper is not None:
                self.keeper.finish(self.config.problem, f"training by {self.config.agent.kind}")
            checkpoint.save_weights(self.out, self.agent.num_timesteps, self.agent.weights())
            checkpoint.finish(self.out)
        except _Paused:
            pass
        finally:
            self.record.close()
            self.env.close()

    def snapshot(self) -> dict[str, Any]:
        """All that the rest of the training depends on."""
        return {
            "agent": self.agent.snapshot(),
            "env": self.env.snapshot(),
            "rows": self.record.snapshot(),
            "kept": None if self.keeper is None else self.keeper.snapshot(),
            "sums": self._sums,
            "average": self.average.arrays(),
            "counters": {name: getattr(self, name) for name in _COUNTERS},
            "seconds": time.process_time() - self.begun,
        }

    def restore(self, saved: Tree) -> None:
        """Go on from a checkpoint; what was recorded after it is forgotten."""
        self.agent.restore(saved["agent"])
        self.env.restore(saved["env"])
        if self.keeper is not None:
            self.keeper.restore(saved["kept"], self.agent.num_timesteps)
        self.record.restore(saved["rows"])
        self._sums[:] = saved["sums"]
        self.average.restore(saved["average"])
        for name in _COUNTERS:
            setattr(self, name, saved["counters"][name])
        self.begun = time.process_time() - saved["seconds"]
        checkpoint.restore_random(saved)

    def _between_steps(self) -> None:
        """Before a step: the last one is stored and learned from, so the state is whole."""
        self.agent.open()
        self._validate_if_due()
        steps, self.env.driver.base_share = self.agent.num_timesteps, self._base_share()
        due, stops = steps >= self.next_checkpoint, self.state.stops(steps)
        paused = self.until is not None and steps >= self.until
        self.next_checkpoint += due * self.config.checkpoint_interval
        if due or paused or stops:
            self.record.flush()
            checkpoint.save_weights(self.out, steps, self.agent.weights())
            if self.keeper is not None:
                self.keeper.flush(steps)
            checkpoint.save(self.out, steps, self.snapshot())
            self.env.driver.mover.lose()  # so that it goes on as a resumed training would
        if stops or paused:
            words = f"{self.out}: stopped after {steps} steps; --resume goes on"
            raise TrainingStopped(words) if stops else _Paused

    def _base_share(self) -> float:
        return self.config.base_share(self.agent.num_timesteps)

    def _after_step(self) -> None:
        self._sums += self.env.driver.fleet.reward[:, [0, 2, 3]].mean(axis=0)
        self._count += 1
        steps = self.agent.num_timesteps
        self.state.look(steps)
        share = self.config.average
        if share is not None and steps > share * self.config.steps:
            self.average.add(self.agent.actor_net().flat)
        if not self.agent.opens():  # else after what the warm start has due
            self._validate_if_due()

    def _validate_if_due(self) -> None:
        if self.agent.num_timesteps >= self.next_validation:
            self.next_validation += self.config.validation.interval
            self._validate()

    def _validate(self) -> None:
        with self.average.within(self.agent.actor_net().flat):
            self._judge()

    def _judge(self) -> None:
        self.validator.attenuate(self._base_share())
        score = self.validator.score(self.agent.act)
        row = self._row(score)
        self.record.add(row)
        self.reporter(row)
        self.validator.keep_worst(self.out)
        self.state.alarms = alarms(self.config, self.record.rows, self.env.largest_reward)
        check_progress(self.config, self.record.rows, self.env.largest_reward)
        if score.total < self.best:
            self.best = score.total
            self._export(score)

    def _row(self, score: Any) -> TrainRow:
        agent, env, marks = self.agent, self.env, self._marks
        # NaN where there is no number: PPO's demonstrator never acts, for example.
        sampled = agent.sampled_steps - marks["sampled"] or math.nan
        demonstrated = agent.demonstrated_steps if agent.demonstrable else math.nan
        steps = max(env.steps - marks["steps"], 1)
        actor_loss, critic_loss, q_mean = agent.last_losses
        reward, c_track, c_diff = self._sums / max(self._count, 1)
        row = {
            "steps": agent.num_timesteps,
            "updates": agent._n_updates,
            "seconds": time.process_time() - self.begun,
            "reward_mean": reward,
            "training_error_mm": 1e3 * (env.sum_error - marks["error"]) / steps,
            "off_track_resets": env.off_track,
            **score.columns(),
            "actor_loss": actor_loss,
            "critic_loss": critic_loss,
            "q_mean": q_mean,
            "c_track": c_track,
            "c_diff": c_diff,
            "demo_share": (demonstrated - marks["demo"]) / sampled,
            "saturated_share": (agent.saturated_steps - marks["saturated"]) / sampled,
            "learning_rate": agent.current_rate(),
        }
        self._marks = {
            "steps": env.steps,
            "error": env.sum_error,
            "demo": agent.demonstrated_steps,
            "saturated": agent.saturated_steps,
            "sampled": agent.sampled_steps,
        }
        self._sums[:], self._count = 0.0, 0
        return TrainRow(**{name: float(value) for name, value in row.items()})

    def _export(self, score: Any) -> None:
        from steersman.learning.export import export_policy

        steps, driver = self.agent.num_timesteps, self.env.driver
        note = {
            "steps": steps,
            "updates": self.agent._n_updates,
            "simulated_seconds": steps * self.config.problem.period * driver.dt,
            "plant": driver.source,
            "validation": score.rounded(),
        }
        net, of = self.agent.actor_net(), self.config.agent
        share = self._base_share()
        export_policy(net, self.config, self.out, note, of.operators, share, of.levels)
