"""The fused kernel against the single pieces that a rollout is made of: identical to the bit."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from tests.loops import PedalWork

from steersman.config import build, lookup
from steersman.kernels import encode, observe
from steersman.kernels import step as lessons
from steersman.kernels import vehicle as car
from steersman.kernels import world as kernel
from steersman.learning.demonstration import Demonstration
from steersman.learning.fleet import FleetDriver, FleetStart
from steersman.learning.problem import Problem, Spread
from steersman.plants.simulator import SimulatorConfig
from steersman.sensing import WaypointSensor, state_row, track
from steersman.speed import ConstantSpeed, ConstantThrottle, Nedc, SpeedComponent
from steersman.types import Command, FloatArray, Pose

ROADS = ("circle", "training_circuit", "lemniscate")
STEPS = 120
CAPPED = ConstantSpeed(speed=14.0, a_lat_max=4.0)


def road(name: str) -> Any:
    return build(lookup("path", name), {})


def problem(
    plant: SimulatorConfig, sensor: WaypointSensor, speed: SpeedComponent, **other: Any
) -> Problem:
    return Problem(
        plant=plant,
        sensor=sensor,
        roads=tuple(road(name) for name in ROADS),
        speeds=(speed,),
        action="direct",
        demonstration=Demonstration(enabled=False),
        corridor=1e6,
        **other,
    )


def steering(i: int, k: int, row: FloatArray) -> float:
    """Feedback on what is observed, so that every bit of the observation matters."""
    wanted = 0.02 * i + 0.05 * math.sin(0.3 * k) - 0.1 * row[observe.O_D] - 0.3 * row[1]
    return min(max(float(wanted), -1.0), 1.0)


def fleet_run(task: Problem, n: int, starts: list[float]) -> list[list[tuple[FloatArray, ...]]]:
    """For each vehicle and step: state, tracking and observation rows."""
    driver = FleetDriver(task, n)
    source = task.speeds[0]
    for i in range(n):
        speed = source.start_speed(task.roads[i % 3], starts[i])
        driver.simulation.rngs[i] = np.random.default_rng(7 + i)
        driver.begin(i, FleetStart(i % 3, starts[i], 0.0, 0.0, source.profile(), speed))
        driver.look(i)
    seen: list[list[tuple[FloatArray, ...]]] = [[] for _ in range(n)]
    fleet = driver.fleet
    for k in range(STEPS):
        for i in range(n):
            seen[i].append((fleet.state[i].copy(), fleet.tracking[i].copy(), fleet.rows[i].copy()))
        driver.step(np.array([steering(i, k, fleet.rows[i]) for i in range(n)]))
    return seen


def single_run(task: Problem, i: int, s: float) -> list[tuple[FloatArray, ...]]:
    """The same with plant, sensor and speed source, as ``rollout`` strings them together."""
    plant, path, source = task.plant.make(task.vehicle), task.roads[i % 3], task.speeds[0]
    rng = np.random.default_rng(7 + i)
    at = path.at(s)
    state = plant.reset(Pose(at.x, at.y, at.psi), source.start_speed(path, s), at.curvature)
    place = track(state, path, s)
    sensor_state = task.sensor.init(rng)
    pedals = PedalWork(source, path, plant.dt, state)
    seen = []
    for k in range(STEPS):
        shown = task.sensor.observe(sensor_state, state, place, path, rng)
        row = np.array([*shown[1:8], *shown.preview.ravel()])
        seen.append((plant._state.copy(), np.array(place), row))
        throttle, brake = pedals(state, place.s)
        before = place.s + float(np.hypot(state.v_x, state.v_y)) * plant.dt
        state = plant.step(Command(steering(i, k, row), throttle, brake))
        place = track(state, path, before)
    return seen


@pytest.mark.parametrize("n", [1, 3])
@pytest.mark.parametrize(
    ("plant", "sensor", "speed"),
    [
        (SimulatorConfig(), WaypointSensor(), ConstantThrottle(throttle=0.5)),
        (SimulatorConfig(steering_delay=0.13), WaypointSensor(error_range=0.1), CAPPED),
        (
            SimulatorConfig(dt=0.07, steering_delay=0.07),
            WaypointSensor(error_range=0.2, redraw=False),
            Nedc(a_lat_max=4.0),
        ),
        (
            SimulatorConfig(dt=0.02, integration_step=0.005, steering_delay=0.03),
            WaypointSensor(count=20, spacing=1.5),
            Nedc(skip_standstill=True),
        ),
    ],
    ids=["plain", "delay-noise-cap", "fixed-noise", "fine"],
)
def test_fleet_equals_single_vehicle(
    plant: SimulatorConfig, sensor: WaypointSensor, speed: SpeedComponent, n: int
) -> None:
    task = problem(plant, sensor, speed, episode_time=1000.0)
    starts = [0.0, 120.0, 30.0][:n]
    together = fleet_run(task, n, starts)
    for i, start in enumerate(starts):
        alone = single_run(task, i, start)
        for k in range(STEPS):
            for one, other in zip(together[i][k], alone[k], strict=True):
                np.testing.assert_array_equal(one, other, err_msg=f"vehicle {i}, step {k}")


def test_step_equals_python() -> None:
    task = problem(SimulatorConfig(steering_delay=0.12), WaypointSensor(), CAPPED)
    drivers = [FleetDriver(task, 2) for _ in range(2)]
    for driver in drivers:
        driver.seed(3)
        for i in range(2):
            driver.reset(i)
    for k in range(20):
        actions = np.array([0.1, -0.2]) * math.sin(0.4 * k)
        for driver, step in zip(drivers, (lessons.step, lessons.step.py_func), strict=True):
            step(driver.world, driver.fleet, driver.lesson, actions)
    for one, other in zip(drivers[0].fleet, drivers[1].fleet, strict=True):
        np.testing.assert_allclose(one, other, rtol=1e-12, atol=1e-12)


def started(**other: Any) -> FleetDriver:
    task = problem(SimulatorConfig(), WaypointSensor(), ConstantThrottle(throttle=0.4), **other)
    driver = FleetDriver(task, 1)
    profile = task.speeds[0].profile()
    driver.begin(0, FleetStart(0, 0.0, 0.0, 0.0, profile, 8.0))
    driver.look(0)
    return driver


def test_actions_are_clipped_and_remembered() -> None:
    driver = started()
    before = driver.fleet.state[0, car.STEER]
    driver.step(np.array([7.0]))
    assert driver.fleet.executed[0] == 1.0
    assert driver.fleet.memory[0, encode.LAST_COMMAND] == 1.0
    most = driver.world.vehicles.rows[0, car.STEER_UP] * driver.dt
    assert driver.fleet.state[0, car.STEER] <= before + most + 1e-12


def test_rate_action_moves_the_last_command() -> None:
    driver = started()
    driver.simulation.lesson = driver.lesson._replace(rate_limit=1.5)
    before = driver.fleet.memory[0, encode.LAST_COMMAND]
    for k in (1, 2):
        driver.step(np.array([-1.0]))
        assert driver.fleet.executed[0] == pytest.approx(before - k * 1.5 * 0.05)


def test_ends() -> None:
    driver = started(episode_time=0.1)
    fleet, world = driver.fleet, driver.world
    driver.step(np.zeros(1))
    assert fleet.ended[0] == kernel.RUNNING
    driver.step(np.zeros(1))
    assert fleet.ended[0] == kernel.TIME_UP
    fleet.tracking[0, observe.D] = -1.6
    narrow = world._replace(corridor=1.5)
    kernel.find_end(narrow, fleet, 0)
    assert fleet.ended[0] == kernel.LEFT_CORRIDOR
    # Nobody knows where a car is whose error is not a number.
    fleet.tracking[0, observe.D] = math.nan
    kernel.find_end(narrow, fleet, 0)
    assert fleet.ended[0] == kernel.LEFT_CORRIDOR
    fleet.tracking[0, observe.D] = 0.0
    fleet.state[0, car.LOAD_AY] = 1.01 * driver.problem.vehicle.roll_over_acceleration
    kernel.find_end(narrow, fleet, 0)
    assert fleet.ended[0] == kernel.ROLLED


def test_end_of_an_open_road() -> None:
    task = problem(SimulatorConfig(), WaypointSensor(), ConstantThrottle(throttle=0.6))
    task = task.model_copy(update={"roads": (road("straight"),)})
    driver = FleetDriver(task, 1)
    driver.begin(0, FleetStart(0, 499.0, 0.0, 0.0, task.speeds[0].profile(), 15.0))
    driver.look(0)
    driver.step(np.zeros(1))
    assert driver.fleet.ended[0] == kernel.RUNNING
    driver.step(np.zeros(1))
    assert driver.fleet.ended[0] == kernel.GOAL_REACHED


def test_delays_that_together_are_too_long() -> None:
    # Each alone fits the delay line; read together they would go past its end.
    with pytest.raises(ValueError, match=r"steering_delay: 0.9 s is too long; at most 0.7 s"):
        problem(
            SimulatorConfig(steering_delay=0.5),
            WaypointSensor(),
            CAPPED,
            spread=Spread(delay=0.4),
        )


def test_state_row_holds_what_sensing_needs() -> None:
    plant = SimulatorConfig().make(problem(SimulatorConfig(), WaypointSensor(), CAPPED).vehicle)
    row = state_row(plant.reset(Pose(1.0, 2.0, 0.3), 9.0, 0.02))
    for column in (car.X, car.Y, car.PSI, car.VX, car.VY, car.YAW_RATE, car.STEER):
        assert row[column] == plant._state[column]
