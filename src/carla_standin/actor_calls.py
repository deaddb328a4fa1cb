"""Calls about actors: spawning, moving, controlling, and batches of these."""

from __future__ import annotations

from typing import Any

from carla_standin import physics
from carla_standin.actors import Actor
from carla_standin.blueprints import definitions
from carla_standin.bystanders import WalkerControl
from carla_standin.calls import Dispatcher, answers, tick_cue, told
from carla_standin.wire import Refused, Reply, read_transform, read_vector, warn_once

# Commands of a batch by number, and the calls that do the same.
_SPAWN = 0
_COMMANDS = {
    1: "destroy_actor",
    2: "apply_control_to_vehicle",
    3: "apply_ackermann_control_to_vehicle",
    4: "apply_control_to_walker",
    5: "apply_physics_control",
    6: "set_actor_transform",
    8: "set_actor_target_velocity",
    9: "set_actor_target_angular_velocity",
    10: "add_actor_impulse",
    11: "add_actor_force",
    14: "set_actor_simulate_physics",
    15: "set_actor_enable_gravity",
    16: "set_actor_autopilot",
    18: "set_vehicle_light_state",
    19: "set_actor_location",
}
# A command about what is not here: debug telemetry.
_WITHOUT_EFFECT = {17}


@answers(Reply.VALUE)
def get_actor_definitions(calls: Dispatcher) -> list[Any]:
    """The blueprint library."""
    return definitions(calls.world.vehicles)


@answers(Reply.VALUE)
def get_spectator(calls: Dispatcher) -> list[Any]:
    """The actor that stands for the spectator's camera; there is no picture."""
    return calls.world.spectator.wire()


@answers(Reply.VALUE)
def spawn_actor(calls: Dispatcher, description: Any, transform: Any) -> list[Any]:
    """A new vehicle."""
    return _spawned(calls, description, transform, None).wire()


@answers(Reply.VALUE)
def spawn_actor_with_parent(
    calls: Dispatcher, description: Any, transform: Any, parent: int, *_: Any
) -> list[Any]:
    """A new sensor on a vehicle; any attachment is a rigid one."""
    return _spawned(calls, description, transform, parent).wire()


def _spawned(calls: Dispatcher, description: Any, transform: Any, parent: Any) -> Actor:
    actor = calls.world.spawn(description, transform, parent)
    if actor.sensor is not None:
        actor.token = calls.token(actor.sensor.stream)
    return actor


@answers(Reply.VALUE)
def destroy_actor(calls: Dispatcher, number: int) -> bool:
    """Remove an actor; whether there was one."""
    return calls.world.destroy(number)


@answers(Reply.VALUE)
def get_actors_by_id(calls: Dispatcher, numbers: list[int]) -> list[Any]:
    """Those of the actors that exist."""
    actors = calls.world.actors
    return [actors[number].wire() for number in numbers if number in actors]


@answers(Reply.VALUE)
def get_actor_bounding_box(calls: Dispatcher, number: int) -> list[Any]:
    """Its box, relative to its origin."""
    return calls.world.seen(number).box()


@answers(Reply.NOTHING)
def set_actor_transform(calls: Dispatcher, number: int, transform: Any) -> None:
    """Teleport; a vehicle keeps its velocity over ground, its height is that of the ground."""
    calls.world.actor(number).place(read_transform(transform))


@answers(Reply.NOTHING)
def set_actor_location(calls: Dispatcher, number: int, location: Any) -> None:
    """Teleport without turning."""
    actor = calls.world.actor(number)
    x, y, z = read_vector(location)
    where = actor.pose if actor.parent is not None else actor.transform
    actor.place(where._replace(x=x, y=y, z=z))


@answers(Reply.NOTHING)
def set_actor_target_velocity(calls: Dispatcher, number: int, velocity: Any) -> None:
    """Set the velocity of the centre of mass, in the world [m/s]."""
    x, y, _ = read_vector(velocity)
    calls.world.car(number)[1].velocity = (x, y)


@answers(Reply.NOTHING)
def set_actor_target_angular_velocity(calls: Dispatcher, number: int, velocity: Any) -> None:
    """Set the yaw rate [deg/s]; roll and pitch rates are none."""
    calls.world.car(number)[1].yaw_rate = read_vector(velocity)[2]


@answers(Reply.NOTHING)
def add_actor_impulse(calls: Dispatcher, number: int, impulse: Any) -> None:
    """Change a vehicle's velocity by impulse over mass, in the world [N s]."""
    calls.world.car(number)[1].push(read_vector(impulse))


@answers(Reply.NOTHING)
def add_actor_force(calls: Dispatcher, number: int, force: Any) -> None:
    """A force on a vehicle's centre of mass over the next tick, in the world [N]."""
    calls.world.car(number)[1].pull(read_vector(force))


@answers(Reply.NOTHING)
def enable_actor_constant_velocity(calls: Dispatcher, number: int, velocity: Any) -> None:
    """Hold a vehicle's velocity, in its own axes [m/s]; it steers and turns as ever."""
    x, y, _ = read_vector(velocity)
    calls.world.car(number)[1].held = x, -y


@answers(Reply.NOTHING)
def disable_actor_constant_velocity(calls: Dispatcher, number: int) -> None:
    """Let a vehicle's velocity go again."""
    calls.world.car(number)[1].held = None


@answers(Reply.NOTHING)
def set_actor_simulate_physics(calls: Dispatcher, number: int, enabled: bool) -> None:
    """Let a vehicle move, or stand where it is put."""
    calls.world.car(number)[1].freeze(not enabled)


@answers(Reply.NOTHING)
def set_actor_enable_gravity(calls: Dispatcher, number: int, enabled: bool) -> None:
    """Let a vehicle press on the ground, or go on as it goes; other actors stay at their height."""
    actor = calls.world.actor(number)
    if actor.car is not None:
        actor.car.weighs = bool(enabled)


@answers(Reply.NOTHING)
def apply_control_to_vehicle(calls: Dispatcher, number: int, values: Any) -> None:
    """Hold this control from the next tick on."""
    actor, car = calls.world.car(number)
    car.command = actor.driver.direct(values)


@answers(Reply.NOTHING)
def apply_control_to_walker(calls: Dispatcher, number: int, values: Any) -> None:
    """Let a pedestrian walk so from the next tick on."""
    actor = calls.world.actor(number)
    if actor.walk is None:
        raise Refused(f"actor {actor.number} ({actor.kind}) is no walker")
    actor.walk = WalkerControl.read(values)


@answers(Reply.NOTHING)
def apply_ackermann_control_to_vehicle(calls: Dispatcher, number: int, values: Any) -> None:
    """Follow this Ackermann control from the next tick on."""
    calls.world.car(number)[0].driver.ackermann(values)


@answers(Reply.VALUE)
def get_ackermann_controller_settings(calls: Dispatcher, number: int) -> list[float]:
    """The gains of a vehicle's Ackermann controller."""
    return list(calls.world.car(number)[0].driver.gains)


@answers(Reply.NOTHING)
def apply_ackermann_controller_settings(calls: Dispatcher, number: int, values: Any) -> None:
    """Set those gains."""
    calls.world.car(number)[0].driver.set_gains(values)


@answers(Reply.VALUE)
def get_physics_control(calls: Dispatcher, number: int) -> list[Any]:
    """A vehicle's parameters in CARLA's terms."""
    return physics.read_out(calls.world.car(number)[0])


@answers(Reply.NOTHING)
def apply_physics_control(calls: Dispatcher, number: int, values: Any) -> None:
    """Change a vehicle's parameters."""
    idle = physics.apply(calls.world.car(number)[0], values)
    if idle:
        warn_once(f"stand-in: physics control: no effect of {', '.join(idle)}")


@answers(Reply.VALUE)
def get_wheel_steer_angle(calls: Dispatcher, number: int, wheel: int) -> float:
    """Angle of a wheel, right-positive [deg]."""
    return calls.world.car(number)[1].wheel_angle(wheel)


@answers(Reply.BARE)
def apply_batch(calls: Dispatcher, commands: list[Any], tick: bool = False) -> list[Any]:
    """Execute commands in turn, then tick if ``tick``; an actor or an error for each."""
    done = [_execute(calls, command, None) for command in commands]
    if tick:
        tick_cue(calls)
    return done


def _execute(calls: Dispatcher, command: Any, subject: int | None) -> list[Any]:
    """One command of a batch; ``subject`` is the new actor that it is about, if it follows one."""
    match command:
        case [[int() as kind, [description, transform, parent, *rest]]] if kind == _SPAWN:
            return _spawn_in_batch(calls, description, transform, parent, rest)
        case [[int() as kind, [actor, *rest]]] if kind in _COMMANDS:
            number = actor if subject is None else subject
            fault = calls.execute(_COMMANDS[kind], [number, *rest])
            return [[0, [fault]]] if fault else [[1, number]]
        case [[int() as kind, [actor, *_]]] if kind in _WITHOUT_EFFECT:
            return [[1, actor if subject is None else subject]]
        case [[int() as kind, _]]:
            what = f"command {kind} of a batch"
            return [[0, [calls.left_out(what, answered=subject is None)]]]
    return [[0, ["stand-in: not a command of a batch"]]]


def _spawn_in_batch(
    calls: Dispatcher, description: Any, transform: Any, parent: Any, rest: list[Any]
) -> list[Any]:
    try:
        owner = parent[1] if parent[0] else None
        number = _spawned(calls, description, transform, owner).number
    except (Refused, TypeError, IndexError, ValueError) as error:
        return [[0, [told("spawn_actor", str(error))]]]
    following = rest[-1] if rest and isinstance(rest[-1], list) else []
    for command in following:
        _execute(calls, command, number)
    return [[1, number]]
