"""The replay buffer: mirror images, demonstrated actions, and demonstrations that stay."""

from __future__ import annotations

from typing import Any

import numpy as np
from stable_baselines3.common.buffers import ReplayBuffer
from stable_baselines3.common.type_aliases import ReplayBufferSamples

from steersman.learning.networks import Draw

# One action, that of the mirrored scene is its negative.
STEERING = np.full(1, -1.0, np.float32)
BUFFER_ARRAYS = (
    *("observations", "next_observations", "actions", "rewards", "dones", "timeouts"),
    "demonstrated",
)


class DemonstrationBuffer(ReplayBuffer):
    """A replay buffer that holds the demonstrator's action beside each transition.

    Attributes:
        mirror: (features,) factor on each feature that mirrors it; None: no mirror images.
        turned: (actions,) factor on each action that mirrors it.
        demonstrated: (rows, vehicles, actions) the demonstrated action in each state, NaN where
            there is none.
        label: (vehicles, actions) the same of the next transition to be added.
        kept: the first rows, which are demonstrations and are never overwritten.
        share: share of each batch that is drawn from them.
        last: observations and demonstrated actions (NaN: none) of the last batch, as tensors.
    """

    mirror: Any = None
    turned: Any = STEERING
    kept = 0
    share = 0.0
    last: tuple[Any, Any]

    def __init__(self, *given: Any, **named: Any) -> None:
        """As Stable-Baselines3's; no action is demonstrated yet."""
        super().__init__(*given, **named)
        self.demonstrated = np.full(self.actions.shape, np.nan, np.float32)
        self.label: Any = np.nan

    def add(self, *given: Any, **named: Any) -> None:
        """Add a transition of each vehicle, with ``label`` as its demonstrated action."""
        self.demonstrated[self.pos] = self.label
        super().add(*given, **named)
        if self.full and self.pos == 0:
            self.pos = self.kept

    def keep(self, share: float) -> None:
        """All that is here now are demonstrations: give each batch this share of them."""
        self.kept, self.share = self.pos, share

    def extend(self, columns: dict[str, Any]) -> None:
        """Add transitions (count, ...) by the names of the buffer's arrays; the rest is zero.

        They are laid into rows; what does not fill a row is left out.
        """
        rows = len(columns["rewards"]) // self.n_envs
        for name, values in columns.items():
            array = getattr(self, name)[self.pos : self.pos + rows]
            array[...] = values[: rows * self.n_envs].reshape(array.shape)
        self.pos += rows

    def draw(self, count: int, batch: int) -> Draw:
        """Transitions for ``count`` updates, drawn as Stable-Baselines3's buffer draws them.

        So the same seed trains on the same batches; which half of them is mirrored is drawn after
        them, from the same generator.
        """
        size = self.buffer_size if self.full else self.pos
        shown = round(self.share * batch) if self.kept else 0
        rows = np.empty((count, batch), np.int64)
        envs = np.empty((count, batch), np.int64)
        for k in range(count):
            rows[k] = np.random.randint(0, size, size=batch)  # noqa: NPY002 - SB3's generator
            envs[k] = np.random.randint(0, high=self.n_envs, size=(batch,))  # noqa: NPY002
            if shown:
                rows[k, :shown] = np.random.randint(0, self.kept, size=shown)  # noqa: NPY002
        sides = np.ones(rows.shape, np.float32)
        if self.mirror is None:
            return Draw(rows, envs, sides, np.ones(self.obs_shape, np.float32), self.turned)
        coins = np.random.randint(0, 2, size=rows.shape)  # noqa: NPY002 - SB3's generator
        sides[coins == 0] = -1.0
        return Draw(rows, envs, sides, self.mirror, self.turned)

    def sample(self, batch_size: int, env: Any = None) -> ReplayBufferSamples:
        """A batch."""
        draw = self.draw(1, batch_size)
        at, sides = (draw.rows[0], draw.envs[0]), draw.sides[0][:, None]
        factors, turned = (
            np.where(sides < 0.0, each, np.float32(1.0)) for each in (draw.mirror, draw.turned)
        )
        data = ReplayBufferSamples(
            *(
                self.to_torch(values)
                for values in (
                    self.observations[at] * factors,
                    self.actions[at] * turned,
                    self.next_observations[at] * factors,
                    (self.dones[at] * (1 - self.timeouts[at]))[:, None],
                    self.rewards[at][:, None],
                )
            )
        )
        labels = self.to_torch(self.demonstrated[at] * turned)
        self.last = data.observations, labels
        return data
