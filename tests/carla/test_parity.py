"""The same run on the server and in the embedded simulator; CARLA's own lateral PID as a client."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest

from steersman.controllers.bearing_pid import BearingPid
from steersman.episode import Episode
from steersman.paths.analytic import Circle, Straight
from steersman.paths.tracks import Monza
from steersman.plants.carla import CarlaConfig
from steersman.plants.carla_world import world_of
from steersman.plants.simulator import SimulatorConfig
from steersman.protocols import Plant
from steersman.rollout import run
from steersman.types import Command, Pose, VehicleState
from steersman.vehicles import CarlaMkz2020, CarlaModel3

from .conftest import running

SECONDS, DT = 20.0, 0.05
# What single precision leaves of a position some hundred metres away, of an angle in degrees and
# of what follows from them [m, rad, m/s, rad/s, m/s^2]; of accelerations after the run-up.
ROUNDING = {"x": 1e-4, "y": 1e-4, "psi": 1e-5, "v_x": 1e-4, "v_y": 1e-4, "yaw_rate": 1e-4}
ROUNDING |= {"a_x": 1e-3, "a_y": 5e-3, "steer": 1e-6, "wheel_angle": 1e-6, "throttle": 1e-6}


def script() -> list[Command]:
    """Waves and jumps of the steering, with throttle and brake, as single precision holds them."""
    rng = np.random.default_rng(2)
    commands = []
    for k in range(round(SECONDS / DT)):
        wave = 0.03 * math.sin(0.7 * k * DT) + 0.02 * float(rng.uniform(-1.0, 1.0))
        brake = 0.3 if 200 <= k < 230 else 0.0
        throttle = 0.0 if brake else 0.45
        commands.append(Command(*np.float32([wave, throttle, brake]).tolist()))
    return commands


def drive(plant: Plant, start: Pose) -> list[VehicleState]:
    try:
        plant.enter(Circle())
        return [plant.reset(start, 8.0, 0.02), *(plant.step(command) for command in script())]
    finally:
        plant.close()


@pytest.mark.parametrize("delay", [0.0, 0.1])
def test_open_loop_is_the_simulators_to_rounding(carla: CarlaConfig, delay: float) -> None:
    server = carla.model_copy(update={"steering_delay": delay})
    found = drive(server.make(CarlaModel3()), Pose(0.0, 0.0, 3.0))
    expected = drive(SimulatorConfig(steering_delay=delay).make(CarlaModel3()), Pose(0.0, 0.0, 3.0))
    assert max(abs(state.psi) for state in found) > math.pi  # angles were unwrapped
    assert [s.time for s in found] == pytest.approx([s.time for s in expected])
    pairs = list(zip(found, expected, strict=True))
    for name, tolerance in ROUNDING.items():
        apart = [abs(getattr(a, name) - getattr(b, name)) for a, b in pairs]
        assert max(apart) < tolerance, name


def both(carla: CarlaConfig, **words: Any) -> tuple[Episode, Episode]:
    return run(running(plant=carla, **words)), run(running(**words))


RUNS: dict[str, dict[str, Any]] = {
    "mpc_pid": {"controller": "mpc_pid", "speed": {"kind": "constant_throttle"}},
    "policy-noise": {
        "controller": "policy",
        "path": "figure_eight",
        "speed": {"kind": "constant_speed", "speed": 11.0},
        "sensor": {"kind": "waypoints", "error_range": 0.05},
    },
    "bearing_pid": {
        "controller": "bearing_pid",
        "path": "lemniscate",
        "speed": {"kind": "constant_speed", "speed": 8.0},
        "seed": 3,
    },
}


@pytest.mark.parametrize("name", RUNS)
def test_closed_loop_stays_within_a_millimetre_for_a_minute(carla: CarlaConfig, name: str) -> None:
    found, expected = both(carla, duration=60.0, **RUNS[name])
    assert found.end == expected.end == "duration"
    apart = np.hypot(found["x"] - expected["x"], found["y"] - expected["y"])
    assert apart.max() < 1e-3
    assert np.abs(found["steer_command"] - expected["steer_command"]).max() < 1e-3
    assert (found.meta["plant"], expected.meta["plant"]) == (
        "stand-in for CARLA 0.9.16",
        "embedded simulator",
    )


def test_a_model_that_the_server_tells_reaches_the_controller(carla: CarlaConfig) -> None:
    """The car that is driven is the server's, whatever we call it, and so is what is told of it."""
    words = {"controller": "mpc_pid", "duration": 5.0, "speed": {"kind": "constant_speed"}}
    wrong = {"kind": "carla_model3", "mass": 2500.0, "l_f": 1.5}
    as_told = run(running(plant=carla, vehicle=wrong, **words))
    right = run(running(**words))
    assert np.abs(as_told["y"] - right["y"]).max() < 1e-3
    deaf = carla.model_copy(update={"read_physics": False})
    plant = deaf.make(CarlaModel3(mass=2500.0))
    try:
        plant.enter(Circle())
        plant.reset(Pose(0.0, 0.0, 0.0), 5.0, 0.0)
        assert plant.vehicle.mass == 2500.0
    finally:
        plant.close()


def test_the_server_tells_of_a_roll_over(carla: CarlaConfig) -> None:
    steps = []
    other = carla.model_copy(update={"vehicle": "vehicle.lincoln.mkz_2020"})
    for plant in (other.make(CarlaMkz2020()), SimulatorConfig().make(CarlaMkz2020())):
        try:
            plant.enter(Straight())
            plant.reset(Pose(0.0, 0.0, 0.0), 25.0, 0.0)
            count = 0
            while not plant.rolled_over() and count < 60:
                plant.step(Command(0.3, 0.6, 0.0))
                count += 1
            steps.append(count)
        finally:
            plant.close()
    assert steps[0] == steps[1] < 60


# ---------------------------------------------------------------------------- the road, offline


@pytest.mark.parametrize("kind", ["straight", "figure_eight", "iso_3888_1"])
def test_the_road_goes_on_before_and_behind(lib: Any, kind: str) -> None:
    from steersman.config import resolve

    fields = {"iso_3888_1": {"kind": "double_lane_change"}}.get(kind, {"kind": kind})
    path: Any = resolve("path", fields)
    world = lib.Map("road", world_of(path, 6.0))
    ends = [] if path.closed else [-20.0, path.length + 50.0]
    for s in (*ends, *np.linspace(0.5, path.length - 0.5, 40)):
        inside = min(max(float(s), 0.0), path.length)
        at = path.at(inside)
        x = at.x + (s - inside) * math.cos(at.psi)
        y = at.y + (s - inside) * math.sin(at.psi)
        here = lib.Location(x, -y, 0.0)
        lane = world.get_waypoint(here, project_to_road=True)
        # Across the lane, that is; along it CARLA's search is rougher.
        aside = lane.transform.location - here
        across = -math.sin(-at.psi) * aside.x + math.cos(at.psi) * aside.y
        assert abs(across) < 2e-3
        assert lane.lane_width == pytest.approx(6.0)


# ------------------------------------------------------- CARLA's PID, as its client has it


class AgentPid:
    """Steering as CARLA's example agents compute it, right-positive; gains are their published."""

    def __init__(self) -> None:
        self.errors: list[float] = []
        self.last = 0.0

    def steer(self, transform: Any, target: Any) -> float:
        """Command from the vehicle's transform to a point ahead."""
        yaw = math.radians(transform.rotation.yaw)
        x = target.x - transform.location.x
        y = target.y - transform.location.y
        error = math.remainder(math.atan2(y, x) - yaw, math.tau)
        self.errors = [*self.errors, error][-10:]
        wanted = 1.95 * error
        if len(self.errors) > 1:
            wanted += 0.2 * (error - self.errors[-2]) / DT + 0.05 * sum(self.errors) * DT
        wanted = min(max(wanted, -1.0), 1.0)
        wanted = min(max(wanted, self.last - 0.1), self.last + 0.1)
        self.last = min(max(wanted, -0.8), 0.8)
        return self.last


def test_carlas_pid_drives_as_a_client_of_its_own(carla: CarlaConfig, lib: Any) -> None:
    """Nothing of ours steers: carla.Map's waypoints, the vehicle's transform, apply_control."""
    path = Monza()
    words = {"path": "monza", "start": 900.0, "duration": 20.0}
    throttle = {"kind": "constant_throttle", "throttle": 0.4, "initial": 8.0}
    ours = run(running(plant=carla, controller=BearingPid(), speed=throttle, **words))
    plant = carla.make(CarlaModel3())
    try:
        plant.enter(path)
        at = path.at(900.0)
        plant.reset(Pose(at.x, at.y, at.psi), 8.0, at.curvature)
        world, car = plant.session.world, plant._actor
        roads, agent, line = world.get_map(), AgentPid(), []
        agent.last = -plant.held_steer
        for _ in range(400):
            transform, velocity = car.get_transform(), car.get_velocity()
            placed = transform.location, transform.rotation
            pose = plant._frame.pose(placed[0].x, placed[0].y, placed[1].yaw)
            line.append((pose.x, pose.y))
            ahead = 0.5 * math.hypot(velocity.x, velocity.y) + 3.0
            point = roads.get_waypoint(transform.location).next(ahead)[0].transform.location
            steer = agent.steer(transform, point)
            car.apply_control(lib.VehicleControl(throttle=0.4, steer=steer))
            world.tick(20.0)
    finally:
        plant.close()
    offsets = np.array([path.project(x, y)[1] for x, y in line])
    assert np.abs(offsets).max() < 1.3
    # Ours takes its point at a distance from the car, that one along the road from beside it.
    apart = np.abs(offsets - ours["lateral_error"])
    assert apart.max() < 0.1
    assert apart.mean() < 0.03
