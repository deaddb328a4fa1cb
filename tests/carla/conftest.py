"""The real client, a stand-in of its own for each worker, and runs on both plants."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import pytest

from steersman.config import build
from steersman.plants.carla import CarlaConfig
from steersman.rollout import RunConfig

from .. import carla_wheel
from ..standin.serving import Serving, serving


@pytest.fixture(scope="session")
def lib() -> Any:
    """The module ``carla``; tests that need it are skipped where there is no wheel."""
    return carla_wheel.load()


@pytest.fixture(scope="session")
def server(lib: Any) -> Iterator[Serving]:
    with serving() as running:
        yield running


@pytest.fixture
def carla(server: Serving) -> CarlaConfig:
    """The plant on that server, quick to start; after each test it must be as it was found."""
    return config(server.port)


def config(port: int, **words: Any) -> CarlaConfig:
    return build(
        CarlaConfig,
        {"port": port, "timeout": 20.0, "warm_up": 0.1, "attempts": 1, **words},
    )


@pytest.fixture
def raw(lib: Any, server: Serving) -> Any:
    """A client beside ours."""
    client = lib.Client("127.0.0.1", server.port)
    client.set_timeout(20.0)
    return client


def synchronous(client: Any) -> bool:
    """Whether the server waits for its client."""
    return bool(client.get_world().get_settings().synchronous_mode)


def left_behind(client: Any) -> tuple[bool, int]:
    """Whether the server is synchronous, and how many vehicles stand on one that is not."""
    if synchronous(client):
        return True, -1
    world = client.get_world()
    world.wait_for_tick(20.0)  # so that the list of actors is today's
    return False, len(world.get_actors().filter("vehicle.*"))


def running(**words: Any) -> RunConfig:
    return build(RunConfig, words)
