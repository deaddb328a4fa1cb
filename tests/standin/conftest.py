"""The real client, and a server of its own for each process of tests."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import pytest

from .serving import Serving, connect, serving, synchronous


@pytest.fixture(scope="session")
def server() -> Iterator[Serving]:
    with serving() as running:
        yield running


@pytest.fixture
def client(server: Serving) -> Iterator[Any]:
    """A client of the shared server, which it leaves asynchronous and empty."""
    client = connect(server)
    yield client
    client.load_world("StandInStraight")


@pytest.fixture
def world(client: Any) -> Any:
    """Its world in synchronous mode, 0.05 s in substeps of 0.01 s."""
    return synchronous(client.get_world())
