"""What every disturbance has to fulfil."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from steersman.config import build
from steersman.contracts import Contract
from steersman.contracts.scenes import same
from steersman.disturbances import DisturbanceComponent
from steersman.episode import Episode
from steersman.errors import ConfigError
from steersman.paths.analytic import Circle
from steersman.rollout import RunConfig, run

_MOTION = ("x", "y", "psi", "v_x", "v_y", "yaw_rate")
# What a field that is zero is set to where a disturbance does nothing by default.
_STRENGTH = 0.1


def a_seed_gives_one_drive(disturbance: DisturbanceComponent) -> Iterator[str]:
    """The same, to the bit, and a finite one."""
    if not same(_drive(disturbance), _drive(disturbance)):
        yield "the same seed gives another drive"
    for seed in (0, 1):
        episode = _drive(disturbance, seed=seed)
        if not all(np.isfinite(episode[name]).all() for name in _MOTION):
            yield "the motion is not finite"


def it_disturbs(disturbance: DisturbanceComponent) -> Iterator[str]:
    """As it is, or if all its numbers are zero with 0.1 for each: a drive goes otherwise."""
    if all(same(_drive(each), _drive()) for each in (disturbance, _strong(disturbance))):
        yield "changes nothing in a drive of 5 s on a circle"


def fleets_share_no_state(disturbance: DisturbanceComponent) -> Iterator[str]:
    """Each fleet has a disturber of its own, which is restored from its snapshot."""
    first, second = disturbance.make(2, 0), disturbance.make(2, 0)
    if first is second:
        yield "make returns one object for two fleets, in which their states would mix"
    first.restore(first.snapshot())


check: Contract[DisturbanceComponent] = Contract(
    a_seed_gives_one_drive, it_disturbs, fleets_share_no_state
)


def _strong(disturbance: DisturbanceComponent) -> DisturbanceComponent:
    values = {name: getattr(disturbance, name) for name in type(disturbance).model_fields}
    zeros = [name for name, value in values.items() if value == 0.0 and type(value) is float]
    if any(type(value) is float and value for value in values.values()):
        return disturbance
    try:
        return build(type(disturbance), {**values, **dict.fromkeys(zeros, _STRENGTH)})
    except ConfigError:
        return disturbance


def _drive(*disturbances: DisturbanceComponent, seed: int = 0) -> Episode:
    config = RunConfig(path=Circle(radius=60.0), duration=5.0, seed=seed)
    return run(config.model_copy(update={"disturbances": disturbances}))
