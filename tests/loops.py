"""Observations, runs and policies that several test modules use."""

from __future__ import annotations

from collections.abc import Iterable
from itertools import pairwise
from pathlib import Path as FilePath
from typing import Any

import numpy as np

from steersman.controllers.base import ControllerComponent
from steersman.episode import COLUMNS, Episode
from steersman.kernels.path import PathTable
from steersman.learning.config import TrainConfig
from steersman.learning.export import export_policy
from steersman.learning.networks import Net, view_net
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


class Posed(PathComponent):
    """An open road of fixed corners that starts at any pose, mirrored if wanted."""

    x: float = 0.0
    y: float = 0.0
    psi: float = 0.0
    side: float = 1.0

    def build_table(self) -> PathTable:
        parts = [Segment(long, self.side * a, self.side * b) for long, a, b, _ in CORNERS]
        return from_segments(parts, start=Pose(self.x, self.y, self.psi))


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
    """What the default sensor tells of ``path`` to a vehicle close to arc length ``near``."""
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
        out.append(decision)
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


def random_net(features: int, hidden: int = 8, seed: int = 0) -> Net:
    """An actor with random weights."""
    sizes = (features, hidden, hidden, 1)
    count = sum((a + 1) * b for a, b in pairwise(sizes))
    flat = np.random.default_rng(seed).normal(0.0, 0.3, count).astype(np.float32)
    return view_net(flat, sizes)


def odd_net(mirror: FloatArray, hidden: int = 8) -> Net:
    """An actor with random weights that answers a mirrored scene with the negated action.

    g(x) - g(mirror x), with the units of a random network g twice.
    """
    g = random_net(len(mirror), hidden)
    none = np.zeros_like(g.w2)
    return Net(
        w1=np.vstack([g.w1, g.w1 * mirror.astype(np.float32)]),
        b1=np.tile(g.b1, 2),
        w2=np.block([[g.w2, none], [none, g.w2]]),
        b2=np.tile(g.b2, 2),
        w3=np.hstack([g.w3, -g.w3]),
        b3=np.zeros(1, np.float32),
        flat=None,
    )


def random_policy(
    folder: FilePath, config: TrainConfig | None = None, *, odd: bool = False
) -> FilePath:
    """A policy file with random weights, for the problem of ``config``."""
    config = config or TrainConfig()
    layout = config.problem.layout
    if odd:
        return export_policy(odd_net(layout.mirror), config, folder, {})
    return export_policy(random_net(len(layout.scale)), config, folder, {})
