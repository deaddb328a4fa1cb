"""What contracts drive with: a road, observations along it, and short runs."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import numpy as np

from steersman.controllers.base import ControllerComponent, check_status
from steersman.episode import COLUMNS, Episode
from steersman.kernels.path import PathTable
from steersman.paths.base import PathComponent
from steersman.paths.segments import Segment, from_segments
from steersman.plants.simulator import SimulatorConfig
from steersman.rollout import RunConfig, run
from steersman.sensing import WaypointSensor, track
from steersman.speed import ConstantSpeed, SpeedComponent
from steersman.types import Decision, FloatArray, Observation, Pose, VehicleState
from steersman.vehicles import CarlaModel3, Vehicle

DT = 0.05
CAR = CarlaModel3()
CORNERS = (
    Segment(20.0, 0.0, 0.0),
    Segment(15.0, 0.0, 0.03),
    Segment(20.0, 0.03, 0.03),
    Segment(25.0, 0.03, -0.02),
    Segment(40.0, -0.02, -0.02),
    Segment(20.0, -0.02, 0.0),
    Segment(60.0, 0.0, 0.0),
)


class PosedRoad(PathComponent):
    """An open road of fixed corners that starts at any pose, mirrored if wanted."""

    x: float = 0.0
    y: float = 0.0
    psi: float = 0.0
    side: float = 1.0

    def build_table(self) -> PathTable:
        """The corners from the pose on."""
        parts = [Segment(long, self.side * a, self.side * b) for long, a, b, _ in CORNERS]
        return from_segments(parts, start=Pose(self.x, self.y, self.psi))

    def speeds(self) -> tuple[FloatArray, FloatArray]:
        """8 m/s everywhere, for sources of speed that drive the path's own."""
        return np.array([0.0, self.length]), np.full(2, 8.0)


def beside(
    path: PathComponent,
    s: float,
    *,
    d: float = 0.0,
    heading: float = 0.0,
    velocity: tuple[float, float] = (10.0, 0.0),
    yaw_rate: float = 0.0,
    steer: float = 0.0,
    time: float = 0.0,
) -> VehicleState:
    """A vehicle at offset ``d`` [m] beside arc length ``s``, turned by ``heading`` [rad]."""
    at = path.at(s)
    x, y = at.x - d * np.sin(at.psi), at.y + d * np.cos(at.psi)
    v_x, v_y = velocity
    zeros = dict.fromkeys(("a_x", "a_y", "wheel_angle", "throttle", "brake"), 0.0)
    return VehicleState(
        time, x, y, at.psi + heading, v_x, v_y, yaw_rate=yaw_rate, steer=steer, **zeros
    )


def observe(path: PathComponent, state: VehicleState, near: float) -> Observation:
    """What the default sensor measures of ``path`` in a vehicle close to arc length ``near``."""
    rng = np.random.default_rng(0)
    return WaypointSensor().observe(None, state, track(state, path, near), path, rng)


def scenes(path: PathComponent, side: float = 1.0, count: int = 25) -> list[Observation]:
    """Observations along ``path`` of a car that wanders about; ``side`` = -1 mirrors the car."""
    rng = np.random.default_rng(3)
    out = []
    for i in range(count):
        d, heading, v_y, rate, steer = side * rng.uniform(-0.3, 0.3, 5)
        s, v = 4.0 * i + 1.0, rng.uniform(4.0, 25.0)
        state = beside(
            path, s, d=d, heading=heading, velocity=(v, v_y), yaw_rate=rate, steer=steer,
            time=i * DT,
        )  # fmt: skip
        out.append(observe(path, state, s))
    return out


def answers(
    controller: ControllerComponent, observations: Iterable[Observation], state: Any = None
) -> list[Decision]:
    """Decisions on a row of observations, from the state before the first step."""
    state = controller.init(CAR, DT) if state is None else state
    out = []
    for observation in observations:
        decision, state = controller.step(state, observation)
        check_status(controller, decision)
        out.append(decision)
    return out


def plain() -> Observation:
    """An ordinary observation."""
    path = PosedRoad()
    return observe(path, beside(path, 30.0, d=0.1, heading=0.02, steer=0.25), 30.0)


def steering(controller: ControllerComponent, observations: list[Observation]) -> list[float]:
    """The commands to a row of observations."""
    return [decision.steer for decision in answers(controller, observations)]


def commands(seed: int = 0) -> list[float]:
    """Commands of another controller, which were executed in place of its own."""
    return [float(u) for u in np.random.default_rng(seed).uniform(-0.3, 0.3, 25)]


def after_executed(
    controller: ControllerComponent, observations: list[Observation], *others: list[float]
) -> list[float]:
    """Steering, where ``executed`` was called with each of ``others`` after every step."""
    state, out = controller.init(CAR, DT), []
    for observation, *steers in zip(observations, *others, strict=True):
        decision, state = controller.step(state, observation)
        for steer in steers:
            state = controller.executed(state, steer)
        out.append(decision.steer)
    return out


def drive(
    controller: ControllerComponent,
    path: PathComponent,
    *,
    speed: SpeedComponent | None = None,
    vehicle: Vehicle = CAR,
    sensor: WaypointSensor | None = None,
    plant: SimulatorConfig | None = None,
    **options: Any,
) -> Episode:
    """A run with the usual parts, which need not be registered."""
    parts = {
        "plant": plant or SimulatorConfig(),
        "controller": controller,
        "path": path,
        "speed": speed or ConstantSpeed(speed=8.0),
        "sensor": sensor or WaypointSensor(),
        "vehicle": vehicle,
    }
    return run(RunConfig().model_copy(update=parts | options))


def same(a: Episode, b: Episode) -> bool:
    """Whether two episodes agree to the bit, but for the time that controllers took."""
    timed = {"control_time"}
    return (a.end, a.distance, len(a)) == (b.end, b.distance, len(b)) and all(
        np.array_equal(a[name], b[name]) for name in COLUMNS if name not in timed
    )
