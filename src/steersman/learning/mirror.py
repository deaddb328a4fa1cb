"""Mirror images in Stable-Baselines3's replay buffer, for updates that are not compiled."""

from __future__ import annotations

from typing import Any

import numpy as np
from stable_baselines3.common.buffers import ReplayBuffer
from stable_baselines3.common.type_aliases import ReplayBufferSamples
from stable_baselines3.common.vec_env import VecNormalize


class MirrorBuffer(ReplayBuffer):
    """A replay buffer whose samples are mirrored, left for right, with probability one half."""

    def __init__(self, *given: Any, factors: Any, **named: Any) -> None:
        """``factors`` (features,) mirror an observation."""
        super().__init__(*given, **named)
        self._factors = factors

    def _get_samples(self, batch_inds: Any, env: VecNormalize | None = None) -> ReplayBufferSamples:
        """Transitions of the rows ``batch_inds``."""
        got = super()._get_samples(batch_inds, env)
        coins = np.random.randint(0, 2, size=len(batch_inds))  # noqa: NPY002 - SB3's generator
        mirrored = self.to_torch((coins == 0)[:, None])
        factors = mirrored * self.to_torch(self._factors) + ~mirrored
        sides = 1.0 - 2.0 * mirrored
        return got._replace(
            observations=got.observations * factors,
            next_observations=got.next_observations * factors,
            actions=got.actions * sides,
        )
