"""What agents do with a world: plan a route, follow it, keep a speed, stop for what is in the way.

Written from what such agents do (waypoints ahead, a PID for each pedal and wheel, a look along the
lane for obstacles), not from any agent's code.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Any

import pytest

from steersman.paths.analytic import Circle
from steersman.plants.carla_world import world_of

from .serving import MODEL3, synchronous

carla = pytest.importorskip("carla", reason="the wheel 'carla' is not installed")

DT = 0.05
SPEED = 8.0
# Waypoints of a route are so far apart, and one so far ahead is steered to [m].
APART, AHEAD = 2.0, 6.0


class LaneAgent:
    """Follows lanes to a destination, and stops behind what is on its lane."""

    def __init__(self, car: Any, destination: Any) -> None:
        self.car, self.world = car, car.get_world()
        self.map = self.world.get_map()
        self.route = self._plan(destination)
        self._before = 0.0

    def _plan(self, destination: Any) -> list[Any]:
        """Waypoints from where the car is; of several that follow, that nearest to the end."""
        end = self.map.get_waypoint(destination)
        route = [self.map.get_waypoint(self.car.get_location())]
        while route[-1].transform.location.distance(end.transform.location) > APART:
            route.append(
                min(
                    route[-1].next(APART),
                    key=lambda each: each.transform.location.distance(end.transform.location),
                )
            )
            assert len(route) < 500, "the destination is on no way from here"
        return route

    def gap(self) -> float:
        """To the nearest actor ahead on its lane, between the boxes [m]."""
        here, mine = self.car.get_transform(), self.map.get_waypoint(self.car.get_location())
        ahead, nearest = here.get_forward_vector(), math.inf
        actors = self.world.get_actors()
        for other in (*actors.filter("vehicle.*"), *actors.filter("walker.*")):
            where = self.map.get_waypoint(other.get_location())
            if other.id == self.car.id or where.lane_id != mine.lane_id:
                continue
            off = other.get_location() - here.location
            if ahead.x * off.x + ahead.y * off.y > 0.0:
                between = math.hypot(off.x, off.y)
                between -= self.car.bounding_box.extent.x + other.bounding_box.extent.x
                nearest = min(nearest, between)
        return nearest

    def control(self) -> Any:
        """Pedals and steering for the next tick."""
        here = self.car.get_transform()
        while len(self.route) > 1 and self._off(here, self.route[0]) < AHEAD:
            self.route.pop(0)
        aim = self.route[0].transform.location
        turn = math.atan2(aim.y - here.location.y, aim.x - here.location.x)
        error = math.remainder(turn - math.radians(here.rotation.yaw), math.tau)
        steer, self._before = 1.0 * error + 0.1 * (error - self._before) / DT, error
        velocity = self.car.get_velocity()
        speed, gap = math.hypot(velocity.x, velocity.y), self.gap()
        wanted = min(SPEED, max(0.6 * (gap - 4.0), 0.0))
        push = 0.5 * (wanted - speed) + (0.35 if wanted else -0.5)
        return carla.VehicleControl(
            throttle=min(max(push, 0.0), 0.75),
            brake=min(max(-push, 0.0), 1.0),
            steer=min(max(steer, -0.8), 0.8),
        )

    @staticmethod
    def _off(here: Any, waypoint: Any) -> float:
        return float(here.location.distance(waypoint.transform.location))

    @property
    def done(self) -> bool:
        """Whether the end of the route is near."""
        return len(self.route) == 1 and self._off(self.car.get_transform(), self.route[0]) < AHEAD

    def drive(self, ticks: int) -> Iterator[float]:
        """Speeds [m/s], until it is done or after so many ticks."""
        for _ in range(ticks):
            self.car.apply_control(self.control())
            self.world.tick()
            velocity = self.car.get_velocity()
            yield math.hypot(velocity.x, velocity.y)
            if self.done:
                return


def begun(world: Any, point: Any) -> Any:
    """A car on a spawn point."""
    blueprint = world.get_blueprint_library().filter("vehicle.tesla.model3")[0]
    blueprint.set_attribute("role_name", "hero")
    car = world.spawn_actor(blueprint, point)
    world.tick()
    return car


def test_it_follows_a_bend_to_its_destination(client: Any) -> None:
    """In its lane all the way, at its speed, with sensors as such agents carry them."""
    world = synchronous(client.generate_opendrive_world(world_of(Circle(radius=40.0), 4.0)))
    points = world.get_map().get_spawn_points()
    car = begun(world, points[0])
    entered: list[Any] = []
    library = world.get_blueprint_library()
    bump = world.spawn_actor(
        library.find("sensor.other.collision"), carla.Transform(), attach_to=car
    )
    bump.listen(entered.append)
    agent = LaneAgent(car, points[len(points) // 2].location)
    speeds, off = [], 0.0
    for speed in agent.drive(600):
        speeds.append(speed)
        near = world.get_map().get_waypoint(car.get_location())
        off = max(off, near.transform.location.distance(car.get_location()))
        assert not car.is_at_traffic_light()
    assert agent.done
    assert off < 1.0
    assert max(speeds) == pytest.approx(SPEED, abs=1.0)
    assert entered == []
    bump.destroy()


@pytest.mark.parametrize("what", [MODEL3, "walker.pedestrian.0003"])
def test_it_stops_for_what_is_in_its_lane_and_goes_on(world: Any, what: str) -> None:
    points = world.get_map().get_spawn_points()
    lane = [p for p in points if abs(p.rotation.yaw) < 1.0]
    car = begun(world, lane[0])
    blocking = world.spawn_actor(world.get_blueprint_library().find(what), lane[3])
    other_lane = [p for p in points if abs(p.rotation.yaw) > 90.0]
    near = min(other_lane, key=lambda p: p.location.distance(lane[2].location))
    beside = world.spawn_actor(world.get_blueprint_library().find("vehicle.audi.tt"), near)
    world.tick()
    agent = LaneAgent(car, lane[5].location)
    speeds = list(agent.drive(260))
    assert max(speeds) > 6.0
    assert speeds[-1] < 0.1
    assert 2.0 < agent.gap() < 8.0
    blocking.destroy()
    list(agent.drive(400))
    assert agent.done
    assert beside.is_alive
