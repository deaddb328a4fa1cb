"""The real client and a server of its own for each module of tests."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import pytest

from .serving import Serving, serving

DT = 0.05
# What the client waits for an answer [s]; generous, since machines are busy.
PATIENCE = 20.0


@pytest.fixture(scope="module")
def server() -> Iterator[Serving]:
    with serving() as running:
        yield running


@pytest.fixture
def client(server: Serving) -> Any:
    """A client of the module's server, which is left asynchronous and empty."""
    carla = pytest.importorskip("carla", reason="the wheel 'carla' is not installed")
    client = carla.Client("127.0.0.1", server.port)
    client.set_timeout(PATIENCE)
    yield client
    world = client.get_world()
    settings = world.get_settings()
    if settings.synchronous_mode:
        world.tick()
    settings.synchronous_mode, settings.fixed_delta_seconds = False, None
    world.apply_settings(settings)
    client.reload_world()


@pytest.fixture
def world(client: Any) -> Any:
    """Its world in synchronous mode, 0.05 s in substeps of 0.01 s."""
    return synchronous(client.get_world())


def synchronous(world: Any, dt: float = DT, substep: float = 0.01, most: int = 10) -> Any:
    """Switch a world to synchronous mode."""
    settings = world.get_settings()
    settings.synchronous_mode = True
    settings.fixed_delta_seconds = dt
    settings.substepping = True
    settings.max_substep_delta_time, settings.max_substeps = substep, most
    world.apply_settings(settings)
    return world
