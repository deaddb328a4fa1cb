"""Train: collect with the demonstrator, update, validate, record, export."""

from __future__ import annotations

import csv
import io
import math
import shutil
import time
from collections.abc import Callable
from importlib.resources import files
from pathlib import Path as FilePath
from typing import Any

import numpy as np

from steersman.config import build, read_yaml, to_yaml
from steersman.errors import ConfigError, DataError, TrainingDiverged, suggestion
from steersman.files import make_folder, replacing, write_text
from steersman.learning.config import TrainConfig

COLUMNS = (
    "steps",
    "updates",
    "seconds",
    "reward_mean",
    "training_error_mm",
    "off_track_resets",
    "validation_error_mm",
    "validation_rms_mm",
    "validation_failures",
    "steer_activity",
    "actor_loss",
    "critic_loss",
    "q_mean",
    "c_track",
    "c_diff",
    "demo_share",
    "saturated_share",
    "learning_rate",
)
# Training is stopped when this share of the actions sat at a limit for this many validations.
_STUCK_SHARE, _STUCK_ROWS = 0.95, 3
# SB3's own log, which is not wanted: its interval in episodes.
_NEVER = 2**62
Reporter = Callable[[dict[str, float]], None]


def presets() -> list[str]:
    """Names of the shipped training presets."""
    folder = files("steersman.presets")
    return sorted(f.name[:-5] for f in folder.iterdir() if f.name.endswith(".yaml"))


def load_preset(name: str) -> dict[str, Any]:
    """A shipped preset as plain data.

    Raises:
        ConfigError: there is no preset of that name.
    """
    known = presets()
    if name not in known:
        raise ConfigError(f"unknown preset {name!r}{suggestion(name, known)}")
    return read_yaml(FilePath(str(files("steersman.presets").joinpath(f"{name}.yaml"))))


def train(
    config: TrainConfig,
    out: FilePath,
    reporter: Reporter | None = None,
    *,
    tick: Callable[[int], None] | None = None,
    overwrite: bool = False,
) -> FilePath:
    """Run a training and return the path of the exported policy.

    Writes ``config.yaml``, ``progress.csv``, TensorBoard events, ``checkpoints/`` and the best
    policy so far (by validation) as ``policy.onnx`` with its card.

    Args:
        config: what to train.
        out: folder, made if need be.
        reporter: called at every validation with the new row of ``progress.csv``.
        tick: called about twice a second with the environment steps done.
        overwrite: replace an earlier training in ``out``.

    Raises:
        DataError: ``out`` holds a training already, or cannot be written.
        TrainingDiverged: losses or values are no longer finite or plausible, or the action
            sticks to its limit.
    """
    import threadpoolctl

    if (out / "progress.csv").exists():
        if not overwrite:
            raise DataError(f"{out}: holds a training already; give another folder or --overwrite")
        for name in ("checkpoints", "tensorboard"):
            shutil.rmtree(out / name, ignore_errors=True)
        for name in ("progress.csv", "policy.onnx", "policy.json"):
            (out / name).unlink(missing_ok=True)
    make_folder(out)
    write_text(out / "config.yaml", to_yaml(config))
    with threadpoolctl.threadpool_limits(config.threads):
        return _Training(config, out, reporter, tick).run()


class _Training:
    """One training run; SB3 calls back after every vector step."""

    def __init__(
        self,
        config: TrainConfig,
        out: FilePath,
        reporter: Reporter | None,
        tick: Callable[[int], None] | None,
    ) -> None:
        import torch

        from steersman.learning.agent import make_agent
        from steersman.learning.validate import Validator
        from steersman.learning.vec_env import PathFollowingVecEnv

        torch.set_num_threads(config.threads)
        torch.set_flush_denormal(True)
        self.config, self.out, self.reporter, self.tick = config, out, reporter, tick
        self.next_tick = 0.0
        self.env = PathFollowingVecEnv(config.problem, config.agent.vehicles)
        self.agent = make_agent(config, self.env)
        self.validator = Validator(config.problem, config.validation)
        self.best = math.inf
        self.rows: list[dict[str, float]] = []
        self.begun = time.perf_counter()
        self.next_validation = config.validation.interval
        self.next_checkpoint = config.checkpoint_interval
        self._marks = {"steps": 0, "error": 0.0, "demo": 0, "saturated": 0, "sampled": 0}
        self._sums = np.zeros(3)
        self._count = 0
        self.writer: Any = None

    def run(self) -> FilePath:
        from stable_baselines3.common.callbacks import BaseCallback
        from torch.utils.tensorboard import SummaryWriter

        after_step = self._after_step

        class Hook(BaseCallback):
            def _on_step(self) -> bool:
                after_step()
                return True

        self.writer = SummaryWriter(str(self.out / "tensorboard"))
        try:
            self.agent.learn(self.config.steps, callback=Hook(), log_interval=_NEVER)
            if not self.rows or self.rows[-1]["steps"] < self.agent.num_timesteps:
                self._validate()
            self._checkpoint()
        finally:
            self.writer.close()
        return self.out / "policy.onnx"

    def _after_step(self) -> None:
        rewards = self.env.driver.fleet.reward
        self._sums += rewards[:, [0, 2, 3]].mean(axis=0)
        self._count += 1
        steps = self.agent.num_timesteps
        if self.tick is not None and time.perf_counter() >= self.next_tick:
            self.next_tick = time.perf_counter() + 0.5
            self.tick(steps)
        if steps >= self.next_validation:
            self.next_validation += self.config.validation.interval
            self._validate()
        if steps >= self.next_checkpoint:
            self.next_checkpoint += self.config.checkpoint_interval
            self._checkpoint()

    def _validate(self) -> None:
        score = self.validator.score(self.agent.act)
        row = self._row(score)
        self.rows.append(row)
        self._write_progress()
        for name, value in row.items():
            if math.isfinite(value):
                self.writer.add_scalar(f"train/{name}", value, self.agent.num_timesteps)
        if self.reporter is not None:
            self.reporter(row)
        self._alarm(row)
        if score.total < self.best:
            self.best = score.total
            self._export(score)

    def _row(self, score: Any) -> dict[str, float]:
        agent, env, marks = self.agent, self.env, self._marks
        sampled = max(agent.sampled_steps - marks["sampled"], 1)
        steps = max(env.steps - marks["steps"], 1)
        actor_loss, critic_loss, q_mean = agent.last_losses
        reward, c_track, c_diff = self._sums / max(self._count, 1)
        row = {
            "steps": agent.num_timesteps,
            "updates": agent._n_updates,
            "seconds": time.perf_counter() - self.begun,
            "reward_mean": reward,
            "training_error_mm": 1e3 * (env.sum_error - marks["error"]) / steps,
            "off_track_resets": env.off_track,
            "validation_error_mm": 1e3 * score.mean_error,
            "validation_rms_mm": 1e3 * score.rms_error,
            "validation_failures": score.failures,
            "steer_activity": score.steer_activity,
            "actor_loss": actor_loss,
            "critic_loss": critic_loss,
            "q_mean": q_mean,
            "c_track": c_track,
            "c_diff": c_diff,
            "demo_share": (agent.demonstrated_steps - marks["demo"]) / sampled,
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
        return {name: float(row[name]) for name in COLUMNS}

    def _alarm(self, row: dict[str, float]) -> None:
        learning = row["updates"] > 0
        losses = (row["actor_loss"], row["critic_loss"], row["q_mean"])
        if learning and not all(math.isfinite(v) for v in losses):
            raise TrainingDiverged(
                f"loss is not finite after {row['updates']:.0f} updates; "
                "try a smaller agent.learning_rate"
            )
        # No return can exceed the largest reward forever; a tenfold margin for untrained critics.
        bound = 10.0 * self._largest_reward() / (1.0 - self.config.agent.gamma)
        if learning and abs(row["q_mean"]) > bound:
            raise TrainingDiverged(
                f"mean Q is {row['q_mean']:.3g}, beyond anything the reward can add up to "
                f"({bound:.3g}); try a smaller agent.learning_rate or agent.gamma"
            )
        stuck = [r["saturated_share"] > _STUCK_SHARE for r in self.rows[-_STUCK_ROWS:]]
        if learning and len(stuck) == _STUCK_ROWS and all(stuck):
            raise TrainingDiverged(
                f"the action sat at a limit for {100 * _STUCK_SHARE:g} % of the last "
                f"{_STUCK_ROWS * self.config.validation.interval} steps; try a smaller "
                "agent.learning_rate, or other reward coefficients"
            )

    def _largest_reward(self) -> float:
        return max(1.0, float(np.abs(self.env.largest_reward)))

    def _export(self, score: Any) -> None:
        from steersman.learning.export import export_policy

        note = {
            "steps": self.agent.num_timesteps,
            "updates": self.agent._n_updates,
            "simulated_seconds": self.agent.num_timesteps * self.env.driver.dt,
            "validation": {k: round(float(v), 6) for k, v in score._asdict().items()},
        }
        export_policy(self.agent.actor_net(), self.config, self.out, note)

    def _checkpoint(self) -> None:
        file = self.out / "checkpoints" / f"step_{self.agent.num_timesteps:09d}.npz"
        with replacing(file) as stream:
            np.savez(stream, **self.agent.weights())

    def _write_progress(self) -> None:
        text = io.StringIO()
        table = csv.DictWriter(text, COLUMNS, lineterminator="\n")
        table.writeheader()
        table.writerows({k: f"{v:.8g}" for k, v in row.items()} for row in self.rows)
        write_text(self.out / "progress.csv", text.getvalue())


def train_config(data: dict[str, Any]) -> TrainConfig:
    """A training configuration from plain data, defaults filled in.

    Raises:
        ConfigError: it names something unknown or holds values that are not allowed.
    """
    return build(TrainConfig, data)
