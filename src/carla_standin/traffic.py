"""Calls of CARLA's traffic manager, which runs inside a client: its address, and its vehicles."""

from __future__ import annotations

from typing import Any

from carla_standin.calls import Dispatcher, answers
from carla_standin.wire import MAX_NAME, Refused, Reply, shaped

_PORTS = 2**16
# Traffic managers at once.
MAX_MANAGERS = 64


def _port(value: Any) -> int:
    port: int = shaped(value, 0)
    if not 0 <= port < _PORTS:
        raise Refused(f"{port} is no port")
    return port


@answers(Reply.VALUE)
def is_traffic_manager_running(calls: Dispatcher, port: int) -> bool:
    """Whether a client has said that its traffic manager listens there."""
    return _port(port) in calls.world.managers


@answers(Reply.VALUE)
def get_traffic_manager_running(calls: Dispatcher, port: int) -> list[Any]:
    """Address and port of that traffic manager."""
    port = _port(port)
    return [calls.world.managers.get(port, ""), port if port in calls.world.managers else 0]


@answers(Reply.VALUE)
def add_traffic_manager_running(calls: Dispatcher, where: list[Any]) -> bool:
    """Remember where a client's traffic manager listens; False: there is one on this port."""
    host, port = shaped(where, ("", 0))
    managers = calls.world.managers
    if _port(port) in managers:
        return False
    if len(managers) >= MAX_MANAGERS or len(host) > MAX_NAME:
        raise Refused(f"{MAX_MANAGERS} traffic managers are enough; shut some down first")
    managers[port] = host
    return True


@answers(Reply.VALUE)
def destroy_traffic_manager(calls: Dispatcher, port: int) -> bool:
    """Forget a traffic manager; whether there was one."""
    return calls.world.managers.pop(_port(port), None) is not None


@answers(Reply.NOTHING)
def set_actor_autopilot(calls: Dispatcher, number: int, *_: Any) -> None:
    """A client's traffic manager takes or leaves a vehicle: its commands come as anybody's do."""
    calls.world.car(number)
