"""Drives that are recorded already, seen as the problem's policy would have seen them."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Any, NamedTuple

import numpy as np

from steersman.episode import Episode
from steersman.errors import DataError
from steersman.kernels import observe
from steersman.kernels import vehicle as car
from steersman.learning.datasets.trajectory import Trajectory, Who, actions_for
from steersman.learning.problem import Problem
from steersman.logs import MotionLog
from steersman.paths.base import PathComponent
from steersman.policy_file import LEARNED
from steersman.sensing import NO_SHIFT
from steersman.types import FloatArray

# A longer gap between two messages begins a new drive [s].
_GAP = 0.5
_LEAST_STEPS = 2
_MOTION = ("x", "y", "yaw", "v_x", "v_y", "yaw_rate")


class Drive(NamedTuple):
    """A recorded drive at the control period: n states, and the command after each."""

    states: FloatArray
    """(n, kernels.vehicle.N_STATE) what sensing needs of each state."""
    steer: FloatArray
    """(n,) normalised steering commanded at each state; the last one led nowhere."""
    who: Who


def of_episode(problem: Problem, episode: Episode, path: PathComponent) -> Trajectory:
    """An episode as data: its controller is the demonstrator, or the own policy if it is one.

    Raises:
        DataError: it is too short, or was driven at another control period.
    """
    if not math.isclose(episode.dt, problem.plant.dt):
        raise DataError(
            f"was driven at a control period of {episode.dt:g} s, not {problem.plant.dt:g} s"
        )
    names = ("x", "y", "psi", "v_x", "v_y", "yaw_rate")
    states = _states(*(episode[name] for name in names), episode["steer"])
    config: Any = episode.meta.get("config", {})
    policy = config.get("controller", {}).get("kind") in LEARNED
    who = Who.OWN if policy else Who.DEMONSTRATOR
    return along(problem, Drive(states, episode["steer_command"], who), path)


def of_log(problem: Problem, log: MotionLog, path: PathComponent) -> list[Trajectory]:
    """A recording as data: one trajectory for each stretch without a gap.

    States are interpolated at the problem's control period, commands held. Steering is normalised
    by the problem's vehicle, unless the recording has it normalised.

    Raises:
        DataError: it holds no steering command, or less than two steps.
    """
    if "angle_command" not in log and "steer_command" not in log:
        raise DataError("holds no steering command (autoware_control_msgs/msg/Lateral or Control)")
    found = [along(problem, drive, path) for drive in _drives(problem, log)]
    if not found:
        raise DataError(f"holds less than {_LEAST_STEPS} steps with a steering command")
    return found


def _drives(problem: Problem, log: MotionLog) -> Iterator[Drive]:
    command, actual = _steering(problem, log)
    time = log["time"]
    known = np.flatnonzero(np.isfinite(command) & np.isfinite(actual))
    breaks = np.flatnonzero((np.diff(time[known]) > _GAP) | (np.diff(known) > 1)) + 1
    for rows in np.split(known, breaks):
        if not rows.size:
            continue
        own = time[rows]
        count = int((own[-1] - own[0]) / problem.plant.dt + 1e-6) + 1
        if count <= _LEAST_STEPS:
            continue
        at = own[0] + problem.plant.dt * np.arange(count)
        columns = [np.interp(at, own, log[name][rows]) for name in _MOTION]
        # The nearest message within a nanosecond counts as being there.
        held = np.maximum(np.searchsorted(own, at + 1e-8, side="right") - 1, 0)
        states = _states(*columns, np.interp(at, own, actual[rows]))
        yield Drive(states, command[rows][held], Who.RECORDED)


def _steering(problem: Problem, log: MotionLog) -> tuple[FloatArray, FloatArray]:
    """Normalised steering commanded, and measured (without it: the command before)."""
    if "steer_command" in log:
        command = log["steer_command"]
    else:
        command = _normalised(problem, log, "angle_command")
    if "steer" in log:
        return command, log["steer"]
    if "angle" in log:
        return command, _normalised(problem, log, "angle")
    before = np.concatenate((command[:1], command[:-1]))
    return command, np.where(np.isfinite(before), before, command)


def _normalised(problem: Problem, log: MotionLog, name: str) -> FloatArray:
    bias = problem.vehicle.row()[car.STEER_BIAS]
    pairs = zip(log[name].tolist(), log["v_x"].tolist(), strict=True)
    steer = [problem.vehicle.steer_for_wheel_angle(u, abs(v)) + bias for u, v in pairs]
    out: FloatArray = np.clip(np.array(steer), -1.0, 1.0)
    return out


def _states(*columns: FloatArray) -> FloatArray:
    """State rows from x, y, yaw, v_x, v_y, yaw rate and steering."""
    states = np.zeros((len(columns[0]), car.N_STATE))
    places = (car.X, car.Y, car.PSI, car.VX, car.VY, car.YAW_RATE, car.STEER)
    for place, column in zip(places, columns, strict=True):
        states[:, place] = column
    return states


def along(problem: Problem, drive: Drive, path: PathComponent) -> Trajectory:
    """The drive along a path as data of the problem.

    Raises:
        DataError: it is too short.
    """
    steer = drive.steer[:-1]
    if len(steer) < _LEAST_STEPS:
        raise DataError(f"holds less than {_LEAST_STEPS} steps")
    rows, tracking = _observed(problem, drive.states, path)
    actions = actions_for(problem, rows, steer, steer)
    unknown = np.full(len(steer), np.nan)
    none = np.full(actions.shape, np.nan)
    shown = drive.who == Who.DEMONSTRATOR
    speed = np.hypot(drive.states[:, car.VX], drive.states[:, car.VY])
    columns = [tracking[:, j] for j in (observe.D, observe.HEADING, observe.S)]
    return Trajectory(
        rows=rows,
        places=np.stack([*columns, speed], axis=1),
        actions=actions,
        own=actions if drive.who == Who.OWN else none,
        demonstrated=actions if shown else none,
        steer=steer,
        demonstrated_steer=steer if shown else unknown,
        driver=np.full(len(steer), drive.who, dtype=np.int8),
        rewards=problem.task.rewards(drive.states, tracking, steer, steer, problem.plant.dt),
        terminated=bool(abs(tracking[-1, observe.D]) > problem.corridor),
    )


def _observed(
    problem: Problem, states: FloatArray, path: PathComponent
) -> tuple[FloatArray, FloatArray]:
    """Observation and tracking row of each state; the sensor without its errors."""
    sensor, dt = problem.sensor, problem.plant.dt
    rows = np.zeros((len(states), observe.O_PREVIEW + 2 * sensor.count))
    tracking = np.zeros((len(states), observe.N_TRACKING))
    near, _ = path.project(float(states[0, car.X]), float(states[0, car.Y]))
    for k, state in enumerate(states):
        observe.track(path.table, 0, state, near, tracking[k])
        near = tracking[k, observe.S] + math.hypot(state[car.VX], state[car.VY]) * dt
        observe.sense(
            path.table,
            0,
            state,
            tracking[k],
            sensor.spacing,
            sensor.count,
            NO_SHIFT,
            NO_SHIFT,
            rows[k],
        )
    return rows, tracking
