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
from steersman.errors import ConfigError
from steersman.kernels import lead as ahead
from steersman.kernels import observe
from steersman.kernels import path as paths
from steersman.kernels import vehicle as car
from steersman.kernels import world as kernel
from steersman.kernels.fleet import Fleet, World, empty_fleet
from steersman.kernels.speed import SpeedTable
from steersman.kernels.step import Lesson
from steersman.lead import LeadStart
from steersman.paths.base import PathComponent
from steersman.paths.segments import stack
from steersman.plants.banking import Banking
from steersman.plants.base import PlantComponent
from steersman.plants.mover import Mover, Shared, make_mover
from steersman.profiles import Profile, write_points, write_profile
from steersman.sensing import WaypointSensor, to_observation
from steersman.types import CarAhead, FloatArray, Observation, Pose
from steersman.vehicles import Vehicle


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
        lead: int = 0,
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
            lead: most breakpoints of the speed of a car ahead; 0: there is none.

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
            lead_times=np.zeros((n, lead)),
            lead_speeds=np.zeros((n, lead)),
        )
        errors, late = any(one.errors for one in self._disturbers), sensor.periods(plant.dt)
        self.fleet: Fleet = empty_fleet(
            n,
            sensor.count,
            errors=observe.N_MEASURED + 1 if errors else 0,
            shifts=sensor.count if sensor.error_range > 0.0 else 0,
            late=late + 1 if late else 0,
            wishes=sensor.count if wishes else 0,
            lead=ahead.N_LEAD if lead else 0,
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

    def begin(
        self,
        i: int,
        road: int,
        s: float,
        pose: Pose,
        v: float,
        profile: Profile,
        lead: LeadStart | None = None,
    ) -> None:
        """Put vehicle ``i`` at the start of a drive and measure there.

        Args:
            i: the vehicle.
            road: number of its road.
            s: arc length there [m].
            pose: where it is and where its velocity points; it turns steadily with the road's
                curvature at ``s``.
            v: its speed [m/s].
            profile: its demand of speed.
            lead: the car ahead, where the fleet has them; the own one starts no faster.
        """
        world, fleet, rng = self.world, self.fleet, self.rngs[i]
        v = v if lead is None else min(v, float(lead.speeds[0]))
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
        if lead is not None:
            self._begin_lead(i, lead, v)
        self._times[i] = self.dt * -np.arange(self._times.shape[1])
        for one in self._disturbers:
            one.begin(world, fleet, i, rng)

    def _begin_lead(self, i: int, given: LeadStart, v: float) -> None:
        """Put a car ahead of vehicle ``i``, which is at its start with speed ``v`` [m/s]."""
        world, fleet, row = self.world, self.fleet, self.fleet.lead[i]
        write_points(given.times, given.speeds, world.lead_times[i], world.lead_speeds[i])
        row[[ahead.LENGTH, ahead.STANDSTILL]] = given.length, given.standstill
        row[ahead.HEADWAY], row[ahead.SURGE] = given.headway, fleet.state[i, car.AX]
        row[ahead.GAP] = ahead.wished_gap(row, v) if given.gap is None else given.gap
        place = fleet.tracking[i, observe.S] + row[ahead.GAP] + given.length
        row[ahead.SPEED] = ahead.lead_speed(world, i, int(fleet.path[i]), 0.0, place)

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
        return self.told(i, to_observation(row, time, self.sensor.spacing))

    def told(self, i: int, seen: Observation) -> Observation:
        """An observation of vehicle ``i`` with what no sensor errs in: wishes, the car ahead."""
        wished, lead = self.fleet.wishes[i], self.fleet.lead[i]
        if wished.shape[0] and not np.isnan(wished[0]):
            seen = seen._replace(wished=wished.copy())
        if not lead.shape[0]:
            return seen
        v = float(np.hypot(*self.fleet.state[i, [car.VX, car.VY]]))
        gap, speed = float(lead[ahead.GAP]), float(lead[ahead.SPEED])
        return seen._replace(ahead=CarAhead(gap, speed - v, ahead.wished_gap(lead, v)))

    def preview(self, i: int) -> FloatArray:
        """The waypoints of that alone (count, 2), a view that the next measurement changes [m]."""
        return self.fleet.rows[i, observe.O_PREVIEW :].reshape(-1, 2)

    def arrays(self) -> dict[str, Any]:
        """Every array that changes while driving."""
        speed, world = self.world.speed, self.world
        lead = {"lead_times": world.lead_times, "lead_speeds": world.lead_speeds}
        return {
            **self.fleet._asdict(),
            "cars": self.world.vehicles.rows,
            "speed_rows": speed.rows,
            "speed_times": speed.times,
            "speed_speeds": speed.speeds,
            "times": self._times,
            **(lead if world.lead_times.size else {}),
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
