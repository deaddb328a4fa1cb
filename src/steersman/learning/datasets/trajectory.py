"""A drive as data: observations, executed actions, demonstrated actions, and their origin."""

from __future__ import annotations

from collections.abc import Iterable
from enum import IntEnum
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from steersman.errors import ConfigError
from steersman.kernels import encode as enc
from steersman.kernels import observe
from steersman.kernels import vehicle as car
from steersman.learning.demonstration import (
    Demonstrator,
    demonstrated_action,
    demonstrated_correction,
)
from steersman.learning.problem import Problem
from steersman.sensing import to_observation
from steersman.types import FloatArray


class Who(IntEnum):
    """Origin of the executed action of a step."""

    OWN = 0
    """The policy that is trained or driven."""
    DEMONSTRATOR = 1
    RECORDED = 2
    """The driver of a recording: a person, or a controller that is not known."""


class Trajectory(NamedTuple):
    """One episode of T steps.

    Actions are those of the problem, in [-1, 1]; steering is normalised, left positive. What is not
    known is NaN.
    """

    rows: FloatArray
    """(T + 1, 7 + 2 waypoints) observations before any encoding, the last one after the last step:
    lateral error [m], heading error [rad], v_x, v_y [m/s], yaw rate [rad/s], steering [-],
    curvature [1/m], waypoints x, y ahead [m]."""
    places: FloatArray
    """(T + 1, 4) the truth: lateral error [m], heading error [rad], arc length [m], speed [m/s]."""
    actions: FloatArray
    """(T, m) executed actions."""
    own: FloatArray
    """(T, m) the policy's actions, its exploration noise included."""
    demonstrated: FloatArray
    """(T, m) the demonstrator's actions."""
    steer: FloatArray
    """(T,) executed steering."""
    demonstrated_steer: FloatArray
    """(T,) the demonstrator's steering."""
    driver: NDArray[np.int8]
    """(T,) ``Who`` of the executed action."""
    rewards: FloatArray
    """(T,) of the problem's task."""
    terminated: bool
    """Whether it ended off the road; else it was cut off."""

    @property
    def steps(self) -> int:
        """T."""
        return len(self.steer)


def features(problem: Problem, rows: FloatArray, steer: FloatArray) -> NDArray[np.float32]:
    """What the problem's policy sees of a drive, (n, features), scaled and clipped.

    The same as while driving, memory (integral, history, last command) included.

    Args:
        problem: whose encoding, sensor and base it is.
        rows: (n, 7 + 2 waypoints) observations one control period apart.
        steer: (n - 1,) or more: the steering executed after each of them.
    """
    layout = problem.layout
    table, scale = layout.table, layout.scale
    memory = np.zeros(enc.memory_size(table))
    line = np.zeros(enc.feature_count(table))
    out = np.empty((len(rows), len(line)), np.float32)
    base = None if problem.corrected is None else base_steering(problem, rows, steer)
    for k, row in enumerate(rows):
        enc.encode(table, row, memory, line)
        if base is not None:
            enc.tell_base(table, row, memory, base[k], line)
        enc.normalise(line, scale)
        out[k] = line
        if k + 1 < len(rows):
            enc.remember(table, row, memory, steer[k])
    return out


def base_steering(problem: Problem, rows: FloatArray, steer: FloatArray) -> FloatArray:
    """What the base would have steered at each observation of a drive, (n,)."""
    assert problem.corrected is not None
    base = Demonstrator(problem.corrected, problem.nominal or problem.vehicle, problem.plant.dt)
    base.restart(0)
    out = np.empty(len(rows))
    for k, row in enumerate(rows):
        if k:
            base.executed(0, float(steer[k - 1]))
        time = k * problem.plant.dt
        out[k] = base.propose(0, to_observation(row, time, problem.sensor.spacing)).steer
    return out


def actions_for(
    problem: Problem, rows: FloatArray, steer: FloatArray, wanted: FloatArray
) -> FloatArray:
    """The problem's actions (T, 1) for the steering ``wanted`` (T,) at each step of a drive.

    ``steer`` (T,) was executed; from it a rate goes on.

    Raises:
        ConfigError: the actions are a controller's parameters, which steering does not tell.
    """
    if problem.joint:
        raise ConfigError(
            "true is not allowed; recorded steering has no speed that was wished", ("joint",)
        )
    if problem.parameters:
        raise ConfigError(
            "'parameters' cannot be found in recorded steering; set it to rate, direct or residual",
            ("problem", "action"),
        )
    dt = problem.plant.dt
    if problem.corrected is not None:
        base = base_steering(problem, rows[: len(steer)], steer)
        return demonstrated_correction(wanted, base, problem.authority)[:, None]
    last = np.concatenate((rows[:1, observe.O_STEER], steer[:-1]))
    limit = problem.rate_limit if problem.indirect else 0.0
    return demonstrated_action(wanted, last, limit, dt)[:, None]


def shown(one: Trajectory) -> FloatArray:
    """The demonstrated steering (T,) of a drive; where there is none the executed."""
    return np.where(np.isfinite(one.demonstrated_steer), one.demonstrated_steer, one.steer)


def transitions(problem: Problem, one: Trajectory) -> dict[str, Any]:
    """A drive as the problem's own steps, by the names of a replay buffer's arrays, T rows each.

    The reward is that of the problem's task, for the measured velocities. Steps without an
    observation before or after them are left out.
    """
    seen = features(problem, one.rows, one.steer)
    executed, wanted = (
        np.clip(actions_for(problem, one.rows, one.steer, steer), -1.0, 1.0)
        for steer in (one.steer, shown(one))
    )
    columns: dict[str, Any] = {
        "observations": seen[:-1],
        "next_observations": seen[1:],
        "actions": executed,
        "rewards": problem.task.rewards(*_states(one), one.steer, shown(one), problem.plant.dt),
        "dones": np.append(np.zeros(one.steps - 1), one.terminated),
        "demonstrated": wanted,
    }
    known = np.isfinite(seen[:-1]).all(axis=1) & np.isfinite(seen[1:]).all(axis=1)
    return {name: values[known].astype(np.float32) for name, values in columns.items()}


def _states(one: Trajectory) -> tuple[FloatArray, FloatArray]:
    """State and tracking rows (T + 1) of a drive, as far as a reward reads them."""
    states = np.zeros((len(one.rows), car.N_STATE))
    tracking = np.zeros((len(one.rows), observe.N_TRACKING))
    measured = [observe.O_VX, observe.O_VY, observe.O_RATE, observe.O_STEER]
    states[:, [car.VX, car.VY, car.YAW_RATE, car.STEER]] = one.rows[:, measured]
    tracking[:, [observe.D, observe.HEADING, observe.S]] = one.places[:, :3]
    slip = np.arctan2(states[:, car.VY], states[:, car.VX])
    tracking[:, observe.COURSE] = one.places[:, 1] + slip
    tracking[:, observe.KAPPA] = one.rows[:, observe.O_KAPPA]
    return states, tracking


def steps(trajectories: Iterable[Trajectory]) -> int:
    """Steps of all episodes together."""
    return sum(trajectory.steps for trajectory in trajectories)
