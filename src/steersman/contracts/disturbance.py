"""What every disturbance has to fulfil; for packages with disturbances of their own, too."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from steersman.disturbances import DisturbanceComponent
from steersman.paths.analytic import Circle
from steersman.rollout import RunConfig, run
from steersman.types import FloatArray


def check(disturbance: DisturbanceComponent) -> list[str]:
    """What a disturbance does otherwise than disturb, the same way every time.

    Returns:
        One sentence for each finding; empty if there are none.
    """
    return list(_findings(disturbance))


def _findings(disturbance: DisturbanceComponent) -> Iterator[str]:
    once, again, other = (_motion(disturbance, seed) for seed in (0, 0, 1))
    if once.shape != again.shape or not np.array_equal(once, again, equal_nan=True):
        yield "the same seed gives another drive"
    for motion in (once, other):
        if not np.isfinite(motion).all():
            yield "the motion is not finite"
    first, second = disturbance.make(2, 0), disturbance.make(2, 0)
    if first is second:
        yield "make returns one object for two fleets, in which their states would mix"
    first.restore(first.snapshot())


def _motion(disturbance: DisturbanceComponent, seed: int) -> FloatArray:
    path, disturbances = Circle(radius=60.0), (disturbance,)
    config = RunConfig(path=path, duration=5.0, seed=seed).model_copy(
        update={"disturbances": disturbances}
    )
    episode = run(config)
    return np.stack([episode[name] for name in ("x", "y", "psi", "v_x", "v_y", "yaw_rate")])
