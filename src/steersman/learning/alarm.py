"""When going on cannot lead anywhere: what diverged, and what to try."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

from steersman.errors import TrainingDiverged
from steersman.learning.config import TrainConfig

# Training is stopped when this share of the actions sat at a limit for this many validations.
_STUCK_SHARE, _STUCK_ROWS = 0.95, 3


def check(config: TrainConfig, rows: Sequence[Mapping[str, float]], largest_reward: float) -> None:
    """Look at the rows of ``progress.csv`` so far, the last of them new.

    Raises:
        TrainingDiverged: a loss is not finite, the values are beyond anything the reward can add
            up to, or the action sticks to a limit.
    """
    row = rows[-1]
    if row["updates"] < config.agent.first_actor_update:
        return
    if not all(math.isfinite(row[name]) for name in ("actor_loss", "critic_loss", "q_mean")):
        raise TrainingDiverged(
            f"loss is not finite after {row['updates']:.0f} updates; "
            "try a smaller agent.learning_rate"
        )
    # No return can exceed the largest reward forever; a tenfold margin for untrained critics.
    bound = 10.0 * largest_reward / (1.0 - config.agent.gamma)
    if abs(row["q_mean"]) > bound:
        raise TrainingDiverged(
            f"mean Q is {row['q_mean']:.3g}, beyond anything the reward can add up to "
            f"({bound:.3g}); try a smaller agent.learning_rate or agent.gamma"
        )
    stuck = [r["saturated_share"] > _STUCK_SHARE for r in rows[-_STUCK_ROWS:]]
    if len(stuck) == _STUCK_ROWS and all(stuck):
        raise TrainingDiverged(
            f"the action sat at a limit for {100 * _STUCK_SHARE:g} % of the last "
            f"{_STUCK_ROWS * config.validation.interval} steps; try a smaller "
            "agent.learning_rate, or other reward coefficients"
        )
