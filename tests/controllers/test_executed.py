"""Controllers that remember their commands, where somebody else's were executed."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest

from steersman.config import resolve
from steersman.controllers.base import ControllerComponent
from steersman.controllers.mpc_delay import MpcDelay
from steersman.kernels.mpc_delay import wheel_angle
from steersman.paths.analytic import Straight
from steersman.plants.simulator import SimulatorConfig
from steersman.sensing import WaypointSensor, track
from steersman.types import Command, Pose

from ..loops import CAR, DT, beside, observe, random_policy

PATH = Straight(distance=2000.0)
SPEED = 8.0


def ridden(controller: ControllerComponent, *, delay: float, told: bool) -> Any:
    """The state of a controller in a car that somebody else steers to and fro, 10 s at 12 m/s."""
    plant = SimulatorConfig(steering_delay=delay).make(CAR)
    vehicle = plant.reset(Pose(0.0, 0.0, 0.0), 12.0, 0.0)
    state, near, rng = controller.init(CAR, DT), 0.0, np.random.default_rng(0)
    for k in range(200):
        place = track(vehicle, PATH, near)
        observation = WaypointSensor().observe(None, vehicle, place, PATH, rng)
        _, state = controller.step(state, observation)
        steer = 0.03 * math.sin(0.3 * k) + 0.02 * math.sin(0.71 * k)
        if told:
            state = controller.executed(state, steer)
        near = place.s + 0.6
        vehicle = plant.step(Command(steer, 0.3, 0.0))
    return state


@pytest.mark.parametrize("delay", [0.0, 0.15])
def test_mpc_delay_predicts_what_was_executed(delay: float) -> None:
    """What its model lacks is little, as long as it knows what was commanded."""
    lacks = {
        told: ridden(MpcDelay(delay=delay), delay=delay, told=told).motion.disturbance
        for told in (True, False)
    }
    assert abs(lacks[True][1]) < 0.02
    assert abs(lacks[False][1]) > 0.2


def test_mpc_delay_finds_the_delay_of_what_was_executed() -> None:
    found = {told: ridden(MpcDelay(), delay=0.15, told=told).motion.delay for told in (True, False)}
    assert found[True] == pytest.approx(0.15, abs=0.03)
    assert found[False] != pytest.approx(0.15, abs=0.03)


def test_mpc_delay_keeps_its_line_of_commands() -> None:
    state = ridden(MpcDelay(), delay=0.0, told=True)
    expected = [0.03 * math.sin(0.3 * k) + 0.02 * math.sin(0.71 * k) for k in range(199, 189, -1)]
    assert state.motion.commands[:10] == pytest.approx(expected, abs=0.0)
    assert CAR.steer_for_wheel_angle(state.angle, 12.0) == pytest.approx(expected[0], rel=0.1)


def after(controller: ControllerComponent, told: float) -> float:
    """What a controller that wants to go far to the right commands after what it is told."""
    left = beside(PATH, 30.0, d=1.4, heading=0.4, velocity=(SPEED, 0.0), steer=told)
    observation = observe(PATH, left, 30.0)
    _, state = controller.step(controller.init(CAR, DT), observation)
    decision, _ = controller.step(controller.executed(state, told), observation)
    return decision.steer


NO_PID = {"k_p": 0.0, "k_i": 0.0, "k_d": 0.0}
LIMITED: dict[str, dict[str, Any]] = {
    "mpc": {"kind": "mpc", "rate_limit": True},
    "mpc_pid": {"kind": "mpc_pid", "rate_limit": True, "c_mpc": 1.0, "gains": NO_PID},
    "mpc_pid twice": {"kind": "mpc_pid", "rate_limit": True, "c_mpc": 2.0, "gains": NO_PID},
}


def make(fields: Any) -> ControllerComponent:
    controller = resolve("controller", fields)
    assert isinstance(controller, ControllerComponent)
    return controller


@pytest.mark.parametrize("told", [0.3, 0.0, -0.2])
@pytest.mark.parametrize("name", LIMITED)
def test_the_rate_limit_counts_from_what_was_executed(name: str, told: float) -> None:
    """What is limited is the turn of the wheels; the plan starts from c_mpc's share of it."""
    share = LIMITED[name].get("c_mpc", 1.0)
    angles = [
        wheel_angle(CAR.table, steer / share, SPEED)
        for steer in (told, after(make(LIMITED[name]), told))
    ]
    step = CAR.steer_rate_up * CAR.max_wheel_angle * DT
    assert angles[0] - angles[1] == pytest.approx(step, rel=1e-3)


@pytest.mark.parametrize("told", [0.3, 0.0, -0.2])
def test_bearing_pid_goes_on_from_what_was_executed(told: float) -> None:
    controller = make({"kind": "bearing_pid", "max_change": 0.05})
    assert after(controller, told) == pytest.approx(told - 0.05)


def test_a_policy_of_the_rate_goes_on_from_what_was_executed(tmp_path: Any) -> None:
    controller = make({"kind": "policy", "file": str(random_policy(tmp_path))})
    for told in (0.4, -0.4):
        assert abs(after(controller, told) - told) <= 1.5708 * DT + 1e-12
