"""Calls about lights of vehicles: they are switched and told, and none is seen."""

from __future__ import annotations

from typing import Any

from carla_standin.calls import Dispatcher, answers
from carla_standin.wire import Refused, Reply

_FLAGS = 2**32


@answers(Reply.NOTHING)
def set_vehicle_light_state(calls: Dispatcher, number: int, state: Any) -> None:
    """Switch lights on and off; a call wraps the flags, a batch does not."""
    match state:
        case [int() as flags] | (int() as flags) if 0 <= flags < _FLAGS:
            calls.world.car(number)[0].lights = int(flags)
        case _:
            raise Refused(f"not a state of lights: {state!r:.40}")


@answers(Reply.VALUE)
def get_vehicle_light_state(calls: Dispatcher, number: int) -> list[int]:
    """Lights of a vehicle."""
    return [calls.world.car(number)[0].lights]


@answers(Reply.VALUE)
def get_vehicle_light_states(calls: Dispatcher) -> list[list[int]]:
    """Lights of all vehicles, each with its number."""
    return [[a.number, a.lights] for a in calls.world.actors.values() if a.car is not None]
