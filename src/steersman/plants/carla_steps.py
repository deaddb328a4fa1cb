"""What a step asks of a CARLA server: commands, and a tick; a server that dies is noticed soon."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any, TypeVar

from steersman.errors import PlantError
from steersman.plants.carla_server import Server

T = TypeVar("T")

# Time after which an answer that has not come makes us look whether the server is still there [s].
# The client itself does not notice that one was killed: it waits for the whole time-out.
_LOOK = 2.0


def insist(server: Server, client: Any, what: str, attempt: Callable[[float], T]) -> T:
    """An answer within the server's time-out, in attempts that last a few seconds each.

    Args:
        server: its address and time-out.
        client: CARLA's client, whose time-out is that of the attempt meanwhile.
        what: is done, for the error.
        attempt: is called with its longest time [s]; a second one is to do no harm.

    Raises:
        PlantError: no answer in time, an error, or nothing listens there any more.
    """
    until = time.monotonic() + server.timeout
    with server.answers(what):
        try:
            while True:
                patience = min(_LOOK, max(until - time.monotonic(), 0.1))
                client.set_timeout(patience)
                try:
                    return attempt(patience)
                except RuntimeError as error:
                    late = "time-out" in str(error)
                    if not late or time.monotonic() > until or not server.alive():
                        raise
        finally:
            client.set_timeout(server.timeout)


def tick(server: Server, client: Any, world: Any) -> Any:
    """One period; the snapshot at its end. A tick that takes long is waited for, not repeated.

    Raises:
        PlantError: the server does not answer, or another client ticks it too.
    """
    before = world.get_snapshot().frame
    asked: list[bool] = []

    def attempt(patience: float) -> int:
        if not asked:
            asked.append(True)
            return int(world.tick(patience))
        if world.get_snapshot().frame == before:
            world.wait_for_tick(patience)
        return int(before) + 1

    frame = insist(server, client, "ticking", attempt)
    snapshot = world.get_snapshot()
    if snapshot.frame != frame:
        raise PlantError(
            f"{server}: frame {snapshot.frame} came instead of {frame}; another "
            "client ticks this server too: stop it, or use a server of your own"
        )
    return snapshot


def send(server: Server, client: Any, commands: list[Any]) -> None:
    """Commands that are executed, in their order, before this returns.

    Setters of the client return before the server has got them; a tick could overtake them, and
    runs would differ. If the answer is late they are sent again, which changes nothing before a
    tick.

    Raises:
        PlantError: one is refused, or there is no answer.
    """

    def attempt(_: float) -> Any:
        return client.apply_batch_sync(commands, False)

    for answer in insist(server, client, "sending commands", attempt):
        if answer.error:
            raise PlantError(f"{server}: {answer.error}")
