"""A vector environment for Stable-Baselines3: all vehicles advance in one kernel call."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from gymnasium import spaces
from stable_baselines3.common.vec_env import VecEnv

from steersman.kernels import observe
from steersman.kernels import world as kernel
from steersman.learning.fleet import FleetDriver
from steersman.learning.observed import observation_space
from steersman.learning.problem import Problem
from steersman.learning.snapshot import Tree, fill
from steersman.outcome import end_of
from steersman.types import FloatArray

if TYPE_CHECKING:
    from steersman.learning.datasets.recorder import Recorder

_COUNTERS = ("off_track", "sum_error", "steps", "largest_reward")


class PathFollowingVecEnv(VecEnv):
    """N vehicles of a :class:`Problem`.

    Observation: (n, features) float32, about unit size. Action: (n, m) in [-1, 1].
    Leaving the corridor and rolling over terminate; time and the end of a road truncate.
    """

    def __init__(self, problem: Problem, n: int) -> None:
        """Make ``n`` vehicles."""
        self.driver = FleetDriver(problem, n)
        self.mirror, self.turned = problem.layout.mirror, problem.turned
        action_space = spaces.Box(-1.0, 1.0, self.turned.shape, np.float32)
        super().__init__(n, observation_space(problem), action_space)
        self._actions = np.zeros((n, len(self.turned)))
        self._infos: list[dict[str, Any]] = [{} for _ in range(n)]
        self._pending: int | None = 0
        self.off_track = 0
        """Episodes ended by leaving the corridor or rolling over."""
        self._sums = np.zeros(n)
        self._lengths = np.zeros(n, dtype=np.int64)
        self.sum_error = 0.0
        """Sum of |lateral error| over all steps of all vehicles [m]."""
        self.steps = 0
        self.largest_reward = 0.0
        """Largest |reward| of a step so far."""
        self.recorder: Recorder | None = None
        """Keeps every step; None: nothing is kept."""
        self.watch: Callable[[], None] | None = None
        """Called after each step, before drives that ended begin anew."""
        self.choice: tuple[Any, Any] | None = None
        """The agent's own actions (n, m) and where the demonstrator takes the wheel (n,), if the
        agent tells; for the recorder alone."""

    def seed(self, seed: int | None = None) -> Sequence[int | None]:
        """Seed of all vehicles' generators; takes effect at the next reset, and only there."""
        self._pending = 0 if seed is None else seed
        return [self._pending] * self.num_envs

    def reset(self) -> Any:
        """Begin new episodes everywhere."""
        if self._pending is not None:
            self.driver.seed(self._pending)
            self._pending = None
        for i in range(self.num_envs):
            self.driver.reset(i)
        self._sums[:], self._lengths[:] = 0.0, 0
        return self.driver.fleet.inputs.astype(np.float32)

    def step_async(self, actions: Any) -> None:
        """Keep the actions for :meth:`step_wait`."""
        self._actions = np.asarray(actions, dtype=np.float64).reshape(self._actions.shape)

    def step_wait(self) -> Any:
        """Advance all vehicles; finished ones begin anew, as SB3 expects."""
        driver = self.driver
        if self.recorder is not None:
            own, takes = self.choice or (self._actions, np.zeros(self.num_envs))
            self.recorder.choose(self._actions, own, takes)  # the demonstrator's number is one
        driver.step(self._actions)
        if self.recorder is not None:
            self.recorder.stepped()
        if self.watch is not None:
            self.watch()
        fleet = driver.fleet
        reward = fleet.reward[:, 0].astype(np.float32)
        self._sums += fleet.reward[:, 0]
        self._lengths += 1
        self.steps += self.num_envs
        self.sum_error += float(np.abs(fleet.tracking[:, observe.D]).sum())
        # np.maximum keeps NaN; what a policy earns whose action is NaN tells nothing of the terms.
        acted = np.isfinite(self._actions).reshape(self.num_envs, -1).all(axis=1)
        largest = np.abs(reward[acted]).max(initial=0.0)
        self.largest_reward = float(np.maximum(self.largest_reward, largest))
        done = fleet.ended != kernel.RUNNING
        infos: list[dict[str, Any]] = self._infos
        out = fleet.inputs.astype(np.float32)
        if done.any():
            infos = [{} for _ in range(self.num_envs)]
            for i in np.flatnonzero(done).tolist():
                infos[i] = self._finish(i, out[i].copy())
                out[i] = fleet.inputs[i]
        return out, reward, done, infos

    def _finish(self, i: int, last: Any) -> dict[str, Any]:
        reason = int(self.driver.fleet.ended[i])
        failed = reason in kernel.FAILED
        self.off_track += failed
        info = {
            "terminal_observation": last,
            "TimeLimit.truncated": not failed,
            "episode": {"r": float(self._sums[i]), "l": int(self._lengths[i]), "t": 0.0},
            "off_track": failed,
            "end": end_of(reason),
        }
        self._sums[i], self._lengths[i] = 0.0, 0
        self.driver.reset(i)
        return info

    def demonstrated_actions(self) -> FloatArray:
        """The demonstrator's action for the present observations, (n, m) in [-1, 1]."""
        return self.driver.demonstrated_actions()

    def snapshot(self) -> dict[str, Any]:
        """All that changes from step to step."""
        return {
            "driver": self.driver.snapshot(),
            "arrays": {"sums": self._sums, "lengths": self._lengths},
            "counters": {name: getattr(self, name) for name in _COUNTERS},
        }

    def restore(self, saved: Tree) -> None:
        """Go on from a snapshot; to be called between two steps."""
        self._pending = None
        self.driver.restore(saved["driver"])
        fill({"sums": self._sums, "lengths": self._lengths}, saved["arrays"])
        for name in _COUNTERS:
            setattr(self, name, saved["counters"][name])

    def close(self) -> None:
        """Release the plant, if there is one."""
        self.driver.close()

    def get_attr(self, attr_name: str, indices: Any = None) -> list[Any]:
        """The same attribute for every vehicle."""
        return [getattr(self, attr_name, None) for _ in self._get_indices(indices)]

    def set_attr(self, attr_name: str, value: Any, indices: Any = None) -> None:
        """Attributes belong to all vehicles together."""
        setattr(self, attr_name, value)

    def env_method(self, method_name: str, *args: Any, indices: Any = None, **kw: Any) -> list[Any]:
        """Call a method once for all vehicles."""
        result = getattr(self, method_name)(*args, **kw)
        return [result for _ in self._get_indices(indices)]

    def env_is_wrapped(self, wrapper_class: Any, indices: Any = None) -> list[bool]:
        """Never wrapped."""
        return [False for _ in self._get_indices(indices)]
