"""The observation space of a problem, which says what a policy that is trained on it reads."""

from __future__ import annotations

import numpy as np
from gymnasium import spaces

from steersman.config import dump
from steersman.kernels.encode import FEATURE_LIMIT
from steersman.learning.problem import Problem


def observation_space(problem: Problem) -> spaces.Box[np.float32]:
    """The space of a problem's scaled features, with a description of them.

    Its attribute ``steersman`` holds the fields of
    :class:`~steersman.learning.adopt.Adoption` as plain data. ``model.save`` of Stable-Baselines3
    writes such attributes of a space as text, so that a model's file needs no further words.
    """
    layout = problem.layout
    space = spaces.Box(-FEATURE_LIMIT, FEATURE_LIMIT, (len(layout.names),), np.float32)
    space.steersman = {  # type: ignore[attr-defined]
        "encoding": dump(problem.encoding),
        "scale": layout.scale.tolist(),
        "action": problem.action,
        "rate_limit": problem.rate_limit,
        "dt": problem.plant.dt,
        "spacing": problem.sensor.spacing,
        **({"joint": True} if problem.joint else {}),  # so that it is refused by that name
    }
    return space
