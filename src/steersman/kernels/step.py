"""One control step of N vehicles that learn: the world's step, features and reward around it."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from steersman.kernels import encode as enc
from steersman.kernels import lead as ahead
from steersman.kernels import observe as obs
from steersman.kernels import reward as rew
from steersman.kernels import vehicle as car
from steersman.kernels.compiled import kernel
from steersman.kernels.encode import EncodingTable
from steersman.kernels.fleet import Fleet, World
from steersman.kernels.reward import RewardTable
from steersman.kernels.world import RUNNING, advance
from steersman.types import FloatArray


class Lesson(NamedTuple):
    """What is learned: features, reward, and what an action means."""

    encoding: EncodingTable
    scale: FloatArray
    reward: RewardTable
    rate_limit: float
    """Largest steering rate of the indirect action [1/s]; 0: the action is the steering."""
    authority: float = 0.0
    """Largest correction of the base's command [-]; 0: there is no base."""
    period: int = 1
    """Control steps for which an action holds."""


@kernel
def encode(lesson: Lesson, fleet: Fleet, n: int) -> None:
    """Features of vehicle ``n`` from its observation; without one they stay what they were."""
    if np.isnan(fleet.rows[n, obs.O_D]):
        return
    if fleet.wishes.shape[1] > 0:
        enc.see_wishes(fleet.wishes[n], lesson.encoding.spacing, fleet.memory[n])
    if fleet.lead.shape[1] > 0:
        lead, v = fleet.lead[n], np.hypot(fleet.state[n, car.VX], fleet.state[n, car.VY])
        gap, wished = lead[ahead.GAP], ahead.wished_gap(lead, v)
        enc.see_lead(gap, lead[ahead.SPEED] - v, wished, fleet.memory[n])
    enc.encode(lesson.encoding, fleet.rows[n], fleet.memory[n], fleet.inputs[n])
    enc.normalise(fleet.inputs[n], lesson.scale)


@kernel
def command(lesson: Lesson, fleet: Fleet, n: int, action: float, dt: float) -> tuple[float, float]:
    """Steering command of vehicle ``n`` for an action in [-1, 1], and the one before; remembers."""
    memory = fleet.memory[n]
    previous = memory[enc.LAST_COMMAND]
    steer = action
    if lesson.rate_limit > 0.0:
        steer = previous + action * lesson.rate_limit * dt
    elif lesson.authority > 0.0:
        steer = fleet.base[n] + lesson.authority * action
    steer = min(max(steer, -1.0), 1.0)
    if np.isnan(fleet.rows[n, obs.O_D]):
        memory[enc.LAST_COMMAND] = steer
    else:
        enc.remember(lesson.encoding, fleet.rows[n], memory, steer)
    fleet.executed[n] = steer
    return steer, previous


@kernel
def judge(lesson: Lesson, fleet: Fleet, n: int, steer: float, previous: float) -> None:
    """Fill reward and features of vehicle ``n`` after its step."""
    state, tracking, dt = fleet.state[n], fleet.tracking[n], lesson.encoding.dt
    wished = fleet.wishes[n, 0] if fleet.wishes.shape[1] > 0 else np.nan
    rew.describe(state, tracking, steer, previous, fleet.demo[n], dt, wished, fleet.judged)
    if fleet.lead.shape[1] > 0:
        ahead.describe_lead(fleet.lead[n], fleet.judged)
    rew.judge(lesson.reward, fleet.judged, fleet.reward[n])
    encode(lesson, fleet, n)


@kernel
def step(world: World, fleet: Fleet, lesson: Lesson, actions: FloatArray) -> None:
    """Move every vehicle by one control period under ``actions`` (N,) in [-1, 1].

    ``fleet.demo`` and ``fleet.base`` must hold the demonstrator's and the base's steering for the
    state before the step. Where an action holds for several steps, a vehicle whose drive has ended
    waits for the next action.
    """
    for n in range(actions.shape[0]):
        if lesson.period > 1 and fleet.ended[n] != RUNNING:
            continue
        steer, previous = command(lesson, fleet, n, actions[n], world.dt)
        advance(world, fleet, n, steer)
        judge(lesson, fleet, n, steer, previous)
