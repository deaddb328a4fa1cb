"""Spawning, placing, asking and removing actors through the real client."""

from __future__ import annotations

import math
import random
from typing import Any

import pytest

import steersman as sm

from .serving import MODEL3, at, spawn

carla = pytest.importorskip("carla", reason="the wheel 'carla' is not installed")


def library(world: Any) -> Any:
    return world.get_blueprint_library()


def test_patterns_find_what_carlas_would(world: Any) -> None:
    """The client compares a pattern with the name and with each of its words."""
    names = {blueprint.id for blueprint in library(world)}
    for pattern, least, beginning in (
        ("vehicle.*", 30, "vehicle."),
        ("vehicle.tesla.*", 2, "vehicle.tesla."),
        ("model3", 1, MODEL3),
        ("*mkz*", 2, "vehicle.lincoln.mkz"),
        ("sensor.camera.*", 7, "sensor.camera."),
        ("sensor.lidar.ray_cast", 1, "sensor.lidar.ray_cast"),
    ):
        found = [blueprint.id for blueprint in library(world).filter(pattern)]
        assert len(found) >= least
        assert all(name.startswith(beginning) for name in found), pattern
    assert {n for n in names if n.startswith("vehicle.")} == {
        blueprint.id
        for wheels in ("2", "4")
        for blueprint in library(world).filter_by_attribute("number_of_wheels", wheels)
    }
    blueprint = library(world).filter("vehicle.tesla.model3")[0]
    blueprint.set_attribute("role_name", "hero")
    blueprint.set_attribute("color", "255,0,0")
    car = world.spawn_actor(blueprint, at(5.0))
    world.tick()
    assert world.get_actor(car.id).attributes["role_name"] == "hero"


@pytest.mark.parametrize(
    ("name", "base", "drives"),
    [
        ("vehicle.audi.tt", "car", "bmw_320i"),
        ("vehicle.audi.etron", "car", "carla_model3"),
        ("vehicle.dodge.charger_2020", "car", "carla_mkz2020"),
        ("vehicle.mercedes.sprinter", "van", "vw_t7"),
    ],
)
def test_other_names_are_driven_by_the_nearest_car(
    world: Any, name: str, base: str, drives: str
) -> None:
    car = world.spawn_actor(library(world).find(name), at(30.0))
    assert (car.type_id, car.attributes["base_type"]) == (name, base)
    assert car.attributes["stand_in"] == drives
    ours = sm.make("vehicle", drives)
    assert car.get_physics_control().mass == pytest.approx(ours.mass)
    car.set_target_velocity(carla.Vector3D(x=10.0))
    car.apply_control(carla.VehicleControl(throttle=0.5, steer=0.1))
    for _ in range(30):
        world.tick()
    # It turns about a point beside its rear axle, about as sharply as its wheels are turned.
    wheel = math.radians(car.get_wheel_steer_angle(carla.VehicleWheelLocation.FL_Wheel))
    rate = math.radians(car.get_angular_velocity().z)
    speed = math.hypot(car.get_velocity().x, car.get_velocity().y)
    assert rate * ours.wheelbase == pytest.approx(speed * math.tan(wheel), rel=0.2)


def test_attributes_are_those_of_the_catalogue(world: Any) -> None:
    for name, generation, special, fittings in (
        (MODEL3, 1, "electric", False),
        ("vehicle.lincoln.mkz_2020", 2, "", True),
    ):
        blueprint = library(world).find(name)
        assert blueprint.get_attribute("generation").as_int() == generation
        assert blueprint.get_attribute("base_type").as_str() == "car"
        assert blueprint.get_attribute("special_type").as_str() == special
        assert blueprint.get_attribute("object_type").as_str() == ""
        assert blueprint.get_attribute("has_lights").as_bool() is fittings
        assert blueprint.get_attribute("has_dynamic_doors").as_bool() is fittings
        assert blueprint.get_attribute("terramechanics").as_bool() is False
        assert not blueprint.has_attribute("driver_id")


def test_what_can_be_set_has_recommended_values(world: Any) -> None:
    for blueprint in library(world):
        for attribute in blueprint:
            assert bool(attribute.recommended_values) == attribute.is_modifiable
            if attribute.is_modifiable:
                blueprint.set_attribute(attribute.id, random.choice(attribute.recommended_values))
    blueprint = library(world).find(MODEL3)
    roles = blueprint.get_attribute("role_name")
    assert roles.recommended_values == ["autopilot", "scenario", "ego_vehicle"]
    assert roles.as_str() == "autopilot"
    color = random.choice(blueprint.get_attribute("color").recommended_values)
    blueprint.set_attribute("color", color)
    car = world.spawn_actor(blueprint, at(5.0))
    assert car.attributes["color"] == color
    assert car.attributes["special_type"] == "electric"


def test_a_spawned_car_stands_where_it_was_put(world: Any) -> None:
    car = spawn(world, 12.0, -7.0, 135.0)
    world.tick()
    where = car.get_transform()
    assert (where.location.x, where.location.y, where.location.z) == pytest.approx(
        (12.0, -7.0, 0.0), abs=1e-5
    )
    assert where.rotation.yaw == pytest.approx(135.0, abs=1e-4)
    assert math.hypot(car.get_velocity().x, car.get_velocity().y) < 1e-3
    box = car.bounding_box
    assert (2 * box.extent.x, 2 * box.extent.y) == pytest.approx((4.79, 2.16))
    assert [a.type_id for a in world.get_actors().filter("vehicle.*")] == [MODEL3]


def test_two_cars_do_not_fit_in_one_place(world: Any) -> None:
    blueprint = library(world).find(MODEL3)
    first = world.spawn_actor(blueprint, at(0.0))
    with pytest.raises(RuntimeError, match=rf"stand-in.*collision with actor {first.id}"):
        world.spawn_actor(blueprint, at(4.7))
    assert world.try_spawn_actor(blueprint, at(2.0, 2.0, 45.0)) is None
    assert world.try_spawn_actor(blueprint, at(4.9)) is not None
    assert world.try_spawn_actor(blueprint, at(0.0, 2.3)) is not None
    world.tick()
    assert first.destroy()
    assert world.try_spawn_actor(blueprint, at(0.0)) is not None


def test_a_destroyed_actor_is_gone(world: Any) -> None:
    car = spawn(world)
    world.tick()
    assert world.get_snapshot().has_actor(car.id)
    other = world.get_actor(car.id)
    assert car.destroy()
    world.tick()
    assert not world.get_snapshot().has_actor(car.id)
    assert not other.destroy()
    with pytest.raises(RuntimeError, match=r"stand-in.*no actor"):
        other.get_physics_control()


def test_a_teleport_keeps_the_velocity_over_ground(world: Any) -> None:
    car = spawn(world)
    car.set_target_velocity(carla.Vector3D(x=3.0, y=-4.0))
    car.set_target_angular_velocity(carla.Vector3D(z=20.0))
    car.set_transform(at(50.0, 60.0, -90.0))
    car.set_simulate_physics(False)
    world.tick()
    assert car.get_transform().location.x == pytest.approx(50.0)
    assert car.get_transform().rotation.yaw == pytest.approx(-90.0)
    assert car.get_velocity().x == 0.0
    car.set_simulate_physics(True)
    car.set_target_velocity(carla.Vector3D(x=0.0, y=-15.0))
    car.set_target_angular_velocity(carla.Vector3D(z=20.0))
    world.tick()
    # It faces -90 deg, CARLA's -y: forward. It turns right at 20 deg/s, for 0.05 s, less the tyres.
    assert car.get_velocity().y == pytest.approx(-15.0, abs=0.4)
    assert -90.0 < car.get_transform().rotation.yaw < -89.0
    car.set_location(carla.Location(x=1.0, y=2.0))
    car.set_transform(carla.Transform(carla.Location(x=1.0, y=2.0), carla.Rotation(yaw=90.0)))
    world.tick()
    assert car.get_velocity().y == pytest.approx(-15.0, abs=1.5)


def test_the_spectator_can_be_put_somewhere(world: Any) -> None:
    spectator = world.get_spectator()
    spectator.set_transform(carla.Transform(carla.Location(1, 2, 30), carla.Rotation(pitch=-90)))
    world.tick()
    assert spectator.get_transform().location.z == 30.0
    assert spectator.get_transform().rotation.pitch == -90.0
    assert not spectator.destroy()


def test_physics_control_tells_the_vehicle(world: Any) -> None:
    car = spawn(world, 3.0, 4.0, 90.0)
    physics = car.get_physics_control()
    assert physics.mass == 1845.0
    assert physics.drag_coefficient == pytest.approx(0.15)
    assert physics.center_of_mass.x == pytest.approx(0.45)
    assert [(p.x, p.y) for p in physics.steering_curve] == [
        pytest.approx(p) for p in ((0.0, 1.0), (20.0, 0.9), (60.0, 0.8), (120.0, 0.7))
    ]
    assert [w.max_steer_angle for w in physics.wheels] == [pytest.approx(v) for v in (70, 70, 0, 0)]
    assert [w.max_brake_torque for w in physics.wheels] == [pytest.approx(700.0, rel=1e-3)] * 4
    # Yaw 90: forward is +y, right is -x. Lengths in cm.
    left, right, *_, back = physics.wheels
    assert (left.position.x, left.position.y) == pytest.approx((383.35, 561.8), abs=0.01)
    assert right.position.x == pytest.approx(216.65, abs=0.01)
    assert back.position.y == pytest.approx(400.0 - 138.6, abs=0.01)


def test_physics_control_can_be_changed(world: Any) -> None:
    def plateau(change: Any) -> tuple[float, float]:
        car = spawn(world)
        physics = car.get_physics_control()
        change(physics)
        car.apply_physics_control(physics)
        world.tick()
        assert car.get_physics_control() == physics or change is move
        car.apply_control(carla.VehicleControl(throttle=0.6, steer=0.2))
        for _ in range(60):
            world.tick()
        found = math.hypot(car.get_velocity().x, car.get_velocity().y), car.get_angular_velocity().z
        car.destroy()
        return found

    def move(physics: Any) -> None:
        physics.center_of_mass = carla.Vector3D(x=0.2, y=0.0, z=-0.3)

    def heavier(physics: Any) -> None:
        physics.mass *= 1.5

    def less_lock(physics: Any) -> None:
        wheels = physics.wheels
        for wheel in wheels[:2]:
            wheel.max_steer_angle = 35.0
        physics.wheels = wheels

    same = plateau(lambda _: None)
    assert plateau(lambda _: None) == same
    assert plateau(heavier)[0] < 0.9 * same[0]
    assert plateau(less_lock)[1] < 0.7 * same[1]
    assert plateau(move) != same


@pytest.mark.parametrize(
    ("field", "value"), [("mass", -1.0), ("mass", math.nan), ("steering_curve", []), ("wheels", [])]
)
def test_an_impossible_physics_control_changes_nothing(world: Any, field: str, value: Any) -> None:
    car = spawn(world)
    before = car.get_physics_control()
    physics = car.get_physics_control()
    setattr(physics, field, value)
    car.apply_physics_control(physics)
    assert car.get_physics_control() == before


def test_one_impossible_value_costs_no_other(world: Any) -> None:
    car = spawn(world)
    before, physics = car.get_physics_control(), car.get_physics_control()
    physics.mass, physics.drag_coefficient, physics.steering_curve = 2000.0, -1.0, []
    wheels = physics.wheels
    for wheel in wheels:
        wheel.tire_friction, wheel.max_steer_angle, wheel.lat_stiff_value = 0.0, -5.0, 10.0
    physics.wheels = wheels
    car.apply_physics_control(physics)
    after = car.get_physics_control()
    assert after.mass == 2000.0
    assert after.drag_coefficient == pytest.approx(before.drag_coefficient)
    assert len(after.steering_curve) == len(before.steering_curve)
    assert [w.tire_friction for w in after.wheels] == [0.0] * 4
    assert [w.lat_stiff_value for w in after.wheels] == [10.0] * 4
    assert after.wheels[0].max_steer_angle == pytest.approx(before.wheels[0].max_steer_angle)


def test_a_batch_answers_for_each_command(client: Any, world: Any) -> None:
    blueprint = library(world).find(MODEL3)
    go = carla.command
    first, taken, second = client.apply_batch_sync(
        [
            go.SpawnActor(blueprint, at(0.0)),
            go.SpawnActor(blueprint, at(1.0)),
            go.SpawnActor(blueprint, at(20.0)).then(
                go.ApplyVehicleControl(go.FutureActor, carla.VehicleControl(throttle=1.0))
            ),
        ],
        True,
    )
    assert not first.error
    assert "collision" in taken.error
    client.apply_batch(
        [
            go.ApplyTransform(first.actor_id, at(0.0, 30.0, 180.0)),
            go.ApplyTargetVelocity(first.actor_id, carla.Vector3D(x=-5.0)),
        ]
    )
    for _ in range(10):
        world.tick()
    cars = {car.id: car for car in world.get_actors([first.actor_id, second.actor_id])}
    assert cars[second.actor_id].get_velocity().x > 1.0
    assert cars[first.actor_id].get_transform().location.y == pytest.approx(30.0, abs=1e-3)
    assert cars[first.actor_id].get_velocity().x < -3.0
    answers = client.apply_batch_sync(
        [
            go.DestroyActor(first.actor_id),
            go.ApplyVehicleControl(first.actor_id, carla.VehicleControl()),
            go.DestroyActor(second.actor_id),
        ]
    )
    assert "no actor" in answers[1].error
    assert not answers[0].error
    assert not answers[2].error
    world.tick()
    assert not list(world.get_actors().filter("vehicle.*"))


def test_what_is_not_implemented_says_so(client: Any, world: Any) -> None:
    car = spawn(world)
    for call in (
        car.get_telemetry_data,
        lambda: client.start_recorder("log"),
        lambda: world.cast_ray(carla.Location(), carla.Location(x=1.0)),
        lambda: client.load_world("Town99"),
        lambda: world.unload_map_layer(carla.MapLayer.Buildings),
    ):
        with pytest.raises(RuntimeError, match=r"stand-in: .*(not implemented|no map)"):
            call()


def test_impulses_and_forces_change_the_velocity(world: Any) -> None:
    car = spawn(world)
    mass = car.get_physics_control().mass
    car.add_impulse(carla.Vector3D(x=4.0 * mass))
    world.tick()
    after = car.get_velocity().x
    assert after == pytest.approx(4.0, abs=0.2)  # it rolls to a stop
    car.add_force(carla.Vector3D(x=20.0 * mass))  # over one tick of 0.05 s
    world.tick()
    pulled = car.get_velocity().x
    assert pulled - after == pytest.approx(1.0, abs=0.2)
    world.tick()
    assert pulled - 0.2 < car.get_velocity().x < pulled


def test_without_gravity_it_goes_on_as_it_goes(world: Any) -> None:
    """Nothing holds it: it keeps its velocity over ground, though it turns, until it is back."""
    car = spawn(world)
    car.set_enable_gravity(False)
    car.set_target_velocity(carla.Vector3D(x=8.0, y=-3.0))
    car.set_target_angular_velocity(carla.Vector3D(z=30.0))
    car.apply_control(carla.VehicleControl(brake=1.0, steer=0.5))
    for _ in range(41):
        world.tick()
    where, velocity = car.get_transform(), car.get_velocity()
    assert (velocity.x, velocity.y) == pytest.approx((8.0, -3.0), abs=1e-4)
    assert where.rotation.yaw == pytest.approx(30.0 * 2.05, abs=1e-2)
    # The centre of mass goes straight on, and the origin swings round behind it.
    turned = math.radians(30.0 * 2.05)
    x, y = 10.0 + 0.45 + 8.0 * 2.05, -20.0 - 3.0 * 2.05
    assert (where.location.x, where.location.y) == pytest.approx(
        (x - 0.45 * math.cos(turned), y - 0.45 * math.sin(turned)), abs=1e-3
    )
    car.set_enable_gravity(True)
    for _ in range(60):
        world.tick()
    assert math.hypot(car.get_velocity().x, car.get_velocity().y) < 1.0


def test_a_constant_velocity_is_held_until_it_is_let_go(world: Any) -> None:
    car = spawn(world)
    car.enable_constant_velocity(carla.Vector3D(x=7.0))
    car.apply_control(carla.VehicleControl(brake=1.0))
    for _ in range(20):
        world.tick()
    assert car.get_velocity().x == pytest.approx(7.0, abs=1e-3)
    car.disable_constant_velocity()
    for _ in range(40):
        world.tick()
    assert car.get_velocity().x < 1.0


def test_a_call_that_waits_for_no_answer_is_answered_at_the_next(world: Any) -> None:
    car = spawn(world)
    car.open_door(carla.VehicleDoor.All)  # there are no doors to open
    frame = world.tick()
    car.add_torque(carla.Vector3D(z=100.0))
    with pytest.raises(RuntimeError, match=r"stand-in: 'add_actor_\w+' is not implemented"):
        world.tick()
    assert world.tick() == frame + 1


def test_what_no_answer_has_of_a_batch_is_answered_at_the_next(client: Any, world: Any) -> None:
    """Commands of a batch without an answer, and those that follow the spawning of an actor."""
    car, model = spawn(world), library(world).filter("model3")[0]
    torque, other = carla.command.ApplyTorque, at(60.0)
    client.apply_batch([torque(car.id, carla.Vector3D(z=100.0))])
    with pytest.raises(RuntimeError, match=r"stand-in: command 13 of a batch is not implemented"):
        world.tick()
    [answer] = client.apply_batch_sync([torque(car.id, carla.Vector3D(z=100.0))])
    assert "command 13 of a batch is not implemented" in answer.error
    world.tick()  # which has been told
    later = torque(carla.command.FutureActor, carla.Vector3D(z=100.0))
    [answer] = client.apply_batch_sync([carla.command.SpawnActor(model, other).then(later)])
    assert not answer.error
    with pytest.raises(RuntimeError, match=r"stand-in: command 13 of a batch is not implemented"):
        world.tick()
    world.tick()


def test_behind_a_two_wheeler_a_narrow_car_drives(world: Any) -> None:
    ridden = [
        each
        for each in library(world).filter("vehicle.*")
        if int(each.get_attribute("number_of_wheels")) == 2
    ]
    assert {each.get_attribute("base_type").as_str() for each in ridden} == {
        "bicycle",
        "motorcycle",
    }
    rider = world.spawn_actor(library(world).find("vehicle.bh.crossbike"), at(0.0, -20.0))
    beside = spawn(world, 0.0, -18.0)  # no car would have room there
    for _ in range(20):
        rider.apply_control(carla.VehicleControl(throttle=0.5))
        world.tick()
    assert rider.bounding_box.extent.y == pytest.approx(0.35)
    assert rider.attributes["stand_in"] == "bmw_320i"
    assert rider.get_velocity().x > 1.0 > beside.get_velocity().x


def test_lights_are_told_as_they_were_switched(client: Any, world: Any) -> None:
    one, other = spawn(world), spawn(world, 30.0)
    lights = carla.VehicleLightState
    assert one.get_light_state() == lights.NONE
    one.set_light_state(lights(lights.Brake | lights.LowBeam))
    set_both = carla.command.SetVehicleLightState
    client.apply_batch_sync([set_both(other.id, lights(lights.Fog))])
    world.tick()
    assert one.get_light_state() == lights.Brake | lights.LowBeam
    assert world.get_vehicles_light_states() == {
        one.id: lights.Brake | lights.LowBeam,
        other.id: lights.Fog,
    }


def test_there_are_not_endlessly_many_actors(world: Any) -> None:
    blueprint = library(world).find("sensor.other.collision")
    car = spawn(world)
    with pytest.raises(RuntimeError, match=r"stand-in: .*has to be attached"):
        world.spawn_actor(blueprint, at(0.0))
    while world.try_spawn_actor(blueprint, at(0.0), attach_to=car) is not None:
        pass
    with pytest.raises(RuntimeError, match=r"stand-in: .*1000 actors are enough"):
        world.spawn_actor(blueprint, at(0.0), attach_to=car)
