"""One vehicle on a CARLA server, stepped in synchronous mode.

What a :class:`~steersman.types.VehicleState` holds, and where it comes from:

- pose: the actor's transform in the snapshot, moved to the centre of mass of its physics control;
- velocity: the snapshot's, which is the centre of mass's, turned into the vehicle's frame;
- yaw rate: the snapshot's angular velocity about z;
- accelerations: the snapshot's, turned likewise. A real server takes differences over a tick, so
  that they are half a tick old; they do not hold gravity;
- steering and wheel angle: the angle of the left front wheel, asked for after every tick, through
  the inverse of the steering law of ``vehicle``;
- throttle and brake: CARLA gives the commands only. These are the commands through the pedals'
  rates of ``vehicle``.
"""

from __future__ import annotations

import math
from collections import deque
from typing import TYPE_CHECKING, Any

import numpy as np

from steersman.errors import PlantError
from steersman.kernels import vehicle as car
from steersman.kernels.actuator import slew
from steersman.kernels.fleet import DELAY_LINE
from steersman.plants.carla_frame import CarlaFrame, Placement, a_step_before, unwrapped
from steersman.plants.carla_physics import offset_of, steering, vehicle_of
from steersman.plants.carla_server import whose
from steersman.plants.carla_session import Session
from steersman.plants.carla_world import check_road, world_of
from steersman.plants.simulator import place
from steersman.protocols import Path
from steersman.sensing import to_state
from steersman.types import Command, FloatArray, Pose, VehicleState
from steersman.vehicles import Vehicle

if TYPE_CHECKING:
    from steersman.plants.carla import CarlaConfig

# Above the ground, so that no wheel spawns within it [m].
_DROP = 0.5
# A car that leans farther lies on its side or roof [deg].
_ON_ITS_SIDE = 60.0


class CarlaPlant:
    """A plant with one vehicle; see :class:`steersman.protocols.Plant`."""

    def __init__(self, config: CarlaConfig, vehicle: Vehicle, session: Session) -> None:
        """Around an open session; the vehicle is spawned by the first ``reset``."""
        self.vehicle = vehicle
        """Parameters of the vehicle: after ``reset``, with CARLA's figures."""
        self.reported = vehicle
        """The same with CARLA's figures, whether or not ``read_physics`` takes them."""
        self.session = session
        self.source = whose(session.version)
        self._given = vehicle
        self._config = config
        self._lib = session.lib
        self._path: Path | None = None
        self._actor: Any = None
        self._frame = CarlaFrame()
        self._ride = 0.0
        self.delay = config.delay_substeps()
        self._delayed: deque[float] = deque([0.0])
        self._last: Any = None
        self._held = 0.0
        self._pedals = (0.0, 0.0)
        self._steps = 0
        self._psi = 0.0

    @property
    def dt(self) -> float:
        """Control period [s]."""
        return self._config.dt

    @property
    def ahead(self) -> float:
        """Centre of mass ahead of the actor's origin [m]."""
        return self._frame.ahead

    @property
    def held_steer(self) -> float:
        """Normalised steering command that acted in the last tick."""
        return self._held

    def enter(self, path: Path) -> None:
        """Have the road on the server: the map of that name, or the path as an OpenDRIVE world.

        Raises:
            PlantError: there is no such map, or it is not ready in time.
        """
        if path is self._path:
            return
        before = self.session.world.id
        if self._config.map is not None:
            self.session.load(self._config.map)
            roads = self.session.world.get_map()
            check_road(path, roads, self._lib, f"{self.session.server}, {self._config.map}")
        else:
            self.session.generate(world_of(path, self._config.lane_width))
        if self.session.world.id != before:
            self._actor = None
        self._path = path

    def reset(self, pose: Pose, speed: float, curvature: float) -> VehicleState:
        """Put the vehicle on ``pose`` in the steady turn; its velocity points along ``pose.psi``.

        For a while it is held where it was a tick before, at that velocity and with the steering
        and throttle of the steady turn: until actuators, wheels and suspension are in it too. Then
        it is let go for one tick. What it does in that tick is measured and returned.

        Raises:
            PlantError: the server fails, or the vehicle cannot be spawned.
        """
        if self._actor is None or not self._alive():
            self._spawn(pose)
        row = np.zeros(car.N_STATE)
        place(self.vehicle.table, 0, row, np.zeros(DELAY_LINE), pose, speed, curvature)
        self._put(to_state(row, 0.0))
        return self._read(self._last)

    def resume(self, state: VehicleState) -> None:
        """Put a new vehicle where it was, likewise: no client can set all of the old one's motion.

        Raises:
            PlantError: the server fails, or the vehicle cannot be spawned.
        """
        self._spawn(Pose(state.x, state.y, state.psi))
        self._put(state)

    def _put(self, state: VehicleState) -> None:
        pose = Pose(state.x, state.y, state.psi)
        speed = math.hypot(state.v_x, state.v_y)
        course = state.psi + (math.atan2(state.v_y, state.v_x) if speed > 0.0 else 0.0)
        before = a_step_before(pose, course, speed, state.yaw_rate, self.dt)
        held = state._replace(x=before.x, y=before.y, psi=before.psi)
        still = Command(state.steer, state.throttle, state.brake)
        for _ in range(1 + round(self._config.run_up / self.dt)):
            self.session.send([self._control(still), *self._placed(held)])
            self._last = self.session.tick()
        self._pedals = (still.throttle, still.brake)
        self._delayed = deque([still.steer] * (self.delay + 1), maxlen=self.delay + 1)
        self._steps, self._psi = 0, state.psi

    def _placed(self, state: VehicleState) -> list[Any]:
        """Commands that put it there, with the velocity and yaw rate of ``state``."""
        lib, number = self._lib, self._actor.id
        pose = Pose(state.x, state.y, state.psi)
        x, y = CarlaFrame.world_vector(state.psi, state.v_x, state.v_y)
        turning = lib.Vector3D(0.0, 0.0, CarlaFrame.degrees_right(state.yaw_rate))
        return [
            lib.command.ApplyTransform(number, self._transform(pose, self._ride)),
            lib.command.ApplyTargetVelocity(number, lib.Vector3D(x, y, 0.0)),
            lib.command.ApplyTargetAngularVelocity(number, turning),
        ]

    def _transform(self, pose: Pose, above: float) -> Any:
        """The actor's transform that far above the ground [m], level with the road."""
        lib = self._lib
        at = self._frame.placement(pose)
        z, pitch, roll = 0.0, 0.0, 0.0
        if self._config.map is not None:
            here = self.session.world.get_map().get_waypoint(lib.Location(at.x, at.y, 0.0))
            if here is not None:
                road = here.transform
                z, pitch, roll = road.location.z, road.rotation.pitch, road.rotation.roll
        return lib.Transform(lib.Location(at.x, at.y, z + above), lib.Rotation(pitch, at.yaw, roll))

    def _spawn(self, pose: Pose) -> None:
        """Spawn, read the physics, and get over the launch delay.

        A fresh vehicle does not react to the throttle for about two seconds; first gear by hand
        for a tick shortens it (CARLA's issues #1640, #3256, #6477).
        """
        if self._actor is not None:
            self.session.forget(self._actor.id)
        self._frame = CarlaFrame()
        self._actor = self.session.spawn(self._config.vehicle, self._transform(pose, _DROP))
        with self.session.server.answers("reading the physics control"):
            physics = self._actor.get_physics_control()
            extent = self._actor.bounding_box.extent
            at = Placement.of(self._actor.get_transform())
        self._frame = offset_of(physics)
        self.reported = vehicle_of(physics, self._given, at, (2.0 * extent.x, 2.0 * extent.y))
        if self._config.read_physics:
            self.vehicle = self.reported
        first = self._lib.VehicleControl(manual_gear_shift=True, gear=1, brake=1.0)
        self.session.send([self._lib.command.ApplyVehicleControl(self._actor.id, first)])
        self.session.tick()
        self.session.send([self._control(Command(0.0, 0.0, 1.0))])
        for _ in range(round(self._config.warm_up / self.dt)):
            self.session.tick()
        self._ride = self._actor.get_transform().location.z - self._transform(pose, 0.0).location.z

    def _alive(self) -> bool:
        """Whether the vehicle is still there; another client may have destroyed it."""
        return self.session.tick().find(self._actor.id) is not None

    def step(self, command: Command) -> VehicleState:
        """Hold ``command`` for one control period.

        Raises:
            PlantError: the server fails, or the vehicle is gone.
        """
        if self._actor is None:
            raise PlantError("plant=carla: reset comes before the first step")
        self._delayed.append(command.steer)
        try:
            self.session.send([self._control(command._replace(steer=self._delayed[0]))])
        except PlantError:
            if self.session.server.alive():  # the vehicle may be gone, which says more
                self._found(self.session.tick())
            raise
        row, dt = self.vehicle.table.rows[0], self.dt
        up, down = float(row[car.PEDAL_UP]), float(row[car.PEDAL_DOWN])
        self._pedals = (
            slew(self._pedals[0], command.throttle, up, down, dt),
            slew(self._pedals[1], command.brake, up, down, dt),
        )
        self._steps += 1
        return self._read(self.session.tick())

    def _control(self, command: Command) -> Any:
        """A vehicle control; CARLA does not limit what it is given."""
        steer = min(max(command.steer, -1.0), 1.0)
        self._held = steer
        control = self._lib.VehicleControl(
            throttle=min(max(command.throttle, 0.0), 1.0),
            steer=0.0 - steer,
            brake=min(max(command.brake, 0.0), 1.0),
        )
        return self._lib.command.ApplyVehicleControl(self._actor.id, control)

    def _read(self, snapshot: Any) -> VehicleState:
        """The vehicle's state in a snapshot.

        Raises:
            PlantError: it is not there.
        """
        found = self._found(snapshot)
        pose = self._frame.pose(*Placement.of(found.get_transform()))
        velocity, acceleration = found.get_velocity(), found.get_acceleration()
        v_x, v_y = CarlaFrame.body_vector(pose.psi, velocity.x, velocity.y)
        a_x, a_y = CarlaFrame.body_vector(pose.psi, acceleration.x, acceleration.y)
        self._psi = unwrapped(pose.psi, self._psi)
        try:
            angle = self._left_wheel()
        except PlantError:
            if self.session.server.alive():  # it may be gone since, which says more
                self._found(self.session.tick())
            raise
        steer, wheel = steering(self.vehicle, angle, v_x)
        rate = CarlaFrame.radians_left(found.get_angular_velocity().z)
        time, (x, y, _) = self._steps * self.dt, pose
        motion = (x, y, self._psi, v_x, v_y, rate, a_x, a_y)
        return VehicleState(time, *motion, steer, wheel, *self._pedals)

    def _found(self, snapshot: Any) -> Any:
        """The vehicle in a snapshot.

        Raises:
            PlantError: it is not there.
        """
        number = self._actor.id
        found = snapshot.find(number)
        if found is None:
            self.session.forget(number)
            self._actor = None
            raise PlantError(
                f"{self.session.server}: vehicle {number} was destroyed by another client"
            )
        return found

    def _left_wheel(self) -> float:
        """Angle of the left front wheel [rad]."""
        with self.session.server.answers("reading the wheel"):
            angle = self._actor.get_wheel_steer_angle(self._lib.VehicleWheelLocation.FL_Wheel)
        return CarlaFrame.radians_left(angle)

    def rolled_over(self) -> bool:
        """Whether the server says so, or the vehicle lies on its side."""
        if self._actor is None:
            return False
        with self.session.server.answers("reading the vehicle"):
            failure = self._actor.get_failure_state()
            roll = self._actor.get_transform().rotation.roll
        rolled = failure == self._lib.VehicleFailureState.Rollover
        return rolled or abs(math.remainder(roll, 360.0)) > _ON_ITS_SIDE

    def accelerations(self) -> FloatArray:
        """CARLA gives them at ticks only: none."""
        return np.zeros((0, 2))

    def close(self) -> None:
        """Destroy the vehicle and give the server its clock back; may be called twice."""
        self._actor = None
        self.session.close()
