"""The one loop: N vehicles on their roads, stepped by one compiled kernel.

:mod:`steersman.rollout` drives one of them with a controller, :mod:`steersman.learning` many with
an agent, a base controller and a demonstrator. Delay line, pedals, sensors, disturbances, faults
and the ends of a drive are here and in :mod:`steersman.kernels.world` alone.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from steersman.disturbances import Disturber
from steersman.episode import COLUMNS
from steersman.errors import ConfigError
from steersman.kernels import observe
from steersman.kernels import path as paths
from steersman.kernels import vehicle as car
from steersman.kernels import world as kernel
from steersman.kernels.fleet import Fleet, World, empty_fleet
from steersman.kernels.speed import SpeedTable
from steersman.kernels.step import Lesson
from steersman.paths.base import PathComponent
from steersman.paths.segments import stack
from steersman.plants.banking import Banking
from steersman.plants.base import PlantComponent
from steersman.plants.mover import Mover, Shared, make_mover
from steersman.profiles import Profile, write_profile
from steersman.sensing import Tracking, WaypointSensor, to_observation
from steersman.types import FloatArray, Observation, Pose
from steersman.vehicles import Vehicle

# Names of what a state row, a tracking row and a step hold, as the columns of an episode have them.
_ROW = (
    *("x", "y", "psi", "v_x", "v_y", "yaw_rate", "load_a_x", "load_a_y"),
    *("steer", "throttle_position", "brake_position", "a_x", "a_y", "wheel_angle"),
    *Tracking._fields,
)
_MORE = (
    *("time", "steer_command", "throttle", "brake"),
    *("control_time", "status", "driver", "reason"),
)
N_MORE = len(_MORE)


def columns_of(rows: FloatArray, more: FloatArray) -> dict[str, FloatArray]:
    """An episode's columns.

    Args:
        rows: state and tracking before each step, (steps, N_STATE + N_TRACKING).
        more: time, command, computing time, status, driver and reason of each, (steps, 8).
    """
    found: dict[str, FloatArray] = {}
    for names, table in ((_ROW, rows), (_MORE, more)):
        found |= zip(names, table.reshape(-1, len(names)).T, strict=True)
    return {name: np.ascontiguousarray(found[name]) for name in COLUMNS}


class Simulation:
    """N vehicles of one kind on one bank of roads.

    Attributes:
        world: constants; rows of vehicles and speeds are per vehicle.
        fleet: everything that changes, a row for each vehicle.
        dt: control period [s].
        rngs: the generators of the vehicles' sensor errors.
    """

    def __init__(  # noqa: PLR0913 - the parts of a closed loop
        self,
        plant: PlantComponent,
        vehicle: Vehicle,
        sensor: WaypointSensor,
        roads: Sequence[PathComponent],
        speeds: SpeedTable,
        n: int = 1,
        *,
        corridor: float,
        disturbances: Sequence[Disturber | None] = (),
        seed: int = 0,
        shared: Shared | None = None,
        fine: bool = False,
        lesson: Lesson | None = None,
        memory: int = 0,
        wishes: bool = False,
    ) -> None:
        """Prepare ``n`` vehicles; :meth:`begin` each before the first step.

        Args:
            plant: what moves them.
            vehicle: the true vehicle.
            sensor: what measures.
            roads: each drive is on one of them.
            speeds: demands by vehicle over the bank of roads; rows are rewritten by ``begin``.
            n: number of vehicles.
            corridor: its half width [m].
            disturbances: beside the sensor's and the plant's own; None is none.
            seed: of the sensor's errors and of disturbances that draw by themselves.
            shared: a plant to drive instead of the plant's own; its maker closes it.
            fine: keep the accelerations of every integration step, in the fleet for one step.
            lesson: features, reward and meaning of the actions; None: actions are steering
                commands.
            memory: width of the learner's memory.
            wishes: observations have the speeds wished ahead.

        Raises:
            ConfigError: the plant drives one vehicle, and more are wanted; the sensor's latency
                is no whole number of control periods; a disturbance is beyond the plant.
            PlantError: it cannot be reached.
        """
        self.n, self.dt, self.sensor, self.lesson = n, plant.dt, sensor, lesson
        banking = Banking.of(roads) if plant.computed else None  # a server has roads of its own
        declared = [sensor.make(n, seed), banking, *plant.disturbances(n, seed), *disturbances]
        self._disturbers = [one for one in declared if one is not None]
        self._acting = [one for one in self._disturbers if type(one).act is not Disturber.act]
        if not plant.computed and any(one.on_vehicle for one in self._disturbers):
            raise ConfigError(
                f"one of them alters the road under the wheels, which plant={plant.kind} cannot",
                ("disturbances",),
            )
        table = vehicle.table
        self.world = World(
            vehicles=table._replace(rows=np.repeat(table.rows, n, axis=0)),
            paths=stack(road.table for road in roads),
            speed=speeds,
            weights=sensor.fit_weights(),
            spacing=sensor.spacing,
            h=plant.h,
            substeps=plant.substeps(),
            dt=plant.dt,
            corridor=corridor,
        )
        errors, late = any(one.errors for one in self._disturbers), sensor.periods(plant.dt)
        self.fleet: Fleet = empty_fleet(
            n,
            sensor.count,
            errors=observe.N_MEASURED + 1 if errors else 0,
            shifts=sensor.count if sensor.error_range > 0.0 else 0,
            late=late + 1 if late else 0,
            wishes=sensor.count if wishes else 0,
            fine=self.world.substeps if fine else 0,
            memory=memory,
            features=0 if lesson is None else len(lesson.scale),
        )
        self.fleet.delay[:] = plant.delay_of(vehicle)
        # Whether something acts between the compiled steps, or measurements are late.
        self._watched = bool(self._disturbers) or late > 0
        self.rngs = [np.random.default_rng(seed) for _ in range(n)]
        self._times = np.zeros((n, late + 1))  # of the measurements on their way, newest first
        self.mover: Mover = make_mover(plant, vehicle, roads, n, shared)

    def begin(self, i: int, road: int, s: float, pose: Pose, v: float, profile: Profile) -> None:
        """Put vehicle ``i`` at the start of a drive and measure there.

        Args:
            i: the vehicle.
            road: number of its road.
            s: arc length there [m].
            pose: where it is and where its velocity points; it turns steadily with the road's
                curvature at ``s``.
            v: its speed [m/s].
            profile: its demand of speed.
        """
        world, fleet, rng = self.world, self.fleet, self.rngs[i]
        fleet.path[i] = road
        write_profile(profile, i, world.speed.rows, world.speed.times, world.speed.speeds)
        kappa = paths.at(world.paths, road, s)[3]
        self.mover.begin(world, fleet, i, pose, v, kappa)
        state, clock = fleet.state[i], fleet.clock[i]
        clock[:] = 0.0
        clock[kernel.CLOCK_INTEGRAL] = state[car.THROTTLE] - state[car.BRAKE]
        clock[kernel.CLOCK_LIMIT] = clock[kernel.CLOCK_GOAL] = np.inf
        observe.track(world.paths, road, state, s, fleet.tracking[i])
        fleet.memory[i], fleet.inputs[i] = 0.0, 0.0
        fleet.sent[i], fleet.speed_limit[i] = 0.0, np.nan
        fleet.ended[i] = kernel.RUNNING
        self._times[i] = self.dt * -np.arange(self._times.shape[1])
        for one in self._disturbers:
            one.begin(world, fleet, i, rng)

    def limit(self, i: int, seconds: float, distance: float) -> None:
        """End the drive of vehicle ``i`` after a time [s] or a distance along its road [m]."""
        clock = self.fleet.clock[i]
        clock[kernel.CLOCK_LIMIT], clock[kernel.CLOCK_GOAL] = seconds, distance

    def look(self, i: int) -> None:
        """Measure vehicle ``i`` where it is."""
        if self._watched:
            self._sense([i], np.array([self.time(i)]))
        kernel.look(self.world, self.fleet, i)

    def measure(self, i: int, step: int, state: FloatArray, tracking: FloatArray) -> None:
        """Measure vehicle ``i`` as if a drive had brought it there; in the order of the steps.

        Args:
            i: the vehicle, after :meth:`begin`.
            step: control steps driven.
            state: its row (N_STATE,).
            tracking: its place on the road (N_TRACKING,).
        """
        fleet = self.fleet
        fleet.state[i], fleet.tracking[i] = state, tracking
        fleet.clock[i, kernel.CLOCK_STEPS] = step
        self.look(i)

    def step(self, actions: FloatArray) -> None:
        """One control step of all vehicles; the caller begins anew those whose drive ended.

        Raises:
            PlantError: the plant failed.
        """
        fleet, rows = self.fleet, self.world.vehicles.rows
        if self._watched:
            fleet.bounds[:] = -1.0, 1.0
            rows[:, [car.GRIP_LEFT, car.GRIP_RIGHT]] = 1.0
            rows[:, [car.SIDE_FORCE, car.YAW_MOMENT]] = 0.0
            steps = fleet.clock[:, kernel.CLOCK_STEPS]
            for one in self._acting:
                for i, time in enumerate((steps * self.dt).tolist()):
                    one.act(self.world, fleet, i, time)
            self._sense(range(self.n), (steps + 1.0) * self.dt)
        self.mover.step(self.world, self.fleet, self.lesson, actions)

    def _sense(self, chosen: Sequence[int], times: FloatArray) -> None:
        fleet, late = self.fleet, self._times
        if fleet.errors.shape[1]:
            fleet.errors[chosen] = 0.0
        fleet.arrives[chosen] = kernel.MEASURED
        for one in self._disturbers:
            one.sense_each(self.world, fleet, chosen, times, self.rngs)
        if late.shape[1] > 1:
            moved = np.array(chosen)[times > 0.0]
            late[moved, 1:] = late[moved, :-1]
        came = fleet.arrives[chosen] != kernel.DROPPED
        late[np.array(chosen)[came], 0] = times[came]

    def time(self, i: int) -> float:
        """Time since the drive of vehicle ``i`` began [s]."""
        return float(self.fleet.clock[i, kernel.CLOCK_STEPS] * self.dt)

    def observation(self, i: int) -> Observation:
        """What a controller of vehicle ``i`` gets now."""
        row = self.fleet.rows[i].copy()  # controllers may keep it
        time = float(self._times[i, -1]) if self._watched else self.time(i)
        wished = self.fleet.wishes[i]
        if wished.shape[0] == 0 or np.isnan(wished[0]):
            return to_observation(row, time, self.sensor.spacing)
        return to_observation(row, time, self.sensor.spacing)._replace(wished=wished.copy())

    def preview(self, i: int) -> FloatArray:
        """The waypoints of that alone (count, 2), a view that the next measurement changes [m]."""
        return self.fleet.rows[i, observe.O_PREVIEW :].reshape(-1, 2)

    def arrays(self) -> dict[str, Any]:
        """Every array that changes while driving."""
        speed = self.world.speed
        return {
            **self.fleet._asdict(),
            "cars": self.world.vehicles.rows,
            "speed_rows": speed.rows,
            "speed_times": speed.times,
            "speed_speeds": speed.speeds,
            "times": self._times,
        }

    def snapshot(self) -> dict[str, Any]:
        """What changes while driving beside the arrays."""
        return {
            "generators": [rng.bit_generator.state for rng in self.rngs],
            "disturbers": {str(k): one.snapshot() for k, one in enumerate(self._disturbers)},
        }

    def restore(self, saved: Mapping[str, Any]) -> None:
        """Go on from a snapshot, once the arrays are restored."""
        for rng, state in zip(self.rngs, saved["generators"], strict=True):
            rng.bit_generator.state = state
        for k, one in enumerate(self._disturbers):
            one.restore(saved["disturbers"][str(k)])
        self.mover.lose()

    def close(self) -> None:
        """Release the plant, if there is one; may be called twice."""
        self.mover.close()
