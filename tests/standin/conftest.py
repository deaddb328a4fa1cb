"""The real client, and a server of its own for each process of tests."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import pytest

from .serving import Serving, another_world, connect, serving, synchronous


@pytest.fixture(scope="session")
def server() -> Iterator[Serving]:
    with serving() as running:
        yield running


@pytest.fixture
def client(server: Serving) -> Iterator[Any]:
    """A client of the shared server, which it leaves asynchronous and empty.

    Another episode would do that at once, but the client dies of one now and then: it ends the old
    one's threads while they run.
    """
    client = connect(server)
    yield client
    world = synchronous(client.get_world())
    world.tick()  # so that what was spawned last is listed
    for actor in world.get_actors():
        if actor.type_id != "spectator":
            actor.destroy()
    settings = world.get_settings()
    settings.synchronous_mode = False
    world.apply_settings(settings)
    if not world.get_map().name.endswith("StandInStraight"):
        another_world(server)


@pytest.fixture
def world(client: Any) -> Any:
    """Its world in synchronous mode, 0.05 s in substeps of 0.01 s."""
    return synchronous(client.get_world())
