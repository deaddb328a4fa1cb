"""Ticks per second of the stand-in for a CARLA server, through the real client.

    python benchmarks/standin.py [--out results/benchmarks/standin.json]

Server and client are two processes on one machine; the client waits for each tick busily. Rounds of
bare ticks (an empty world), of ticks with one vehicle that is controlled and read at each, and of
version queries (a call that does nothing) take turns, so that the ratios stand whatever else the
machine does. Figures are medians and the best of the rounds.
"""

from __future__ import annotations

import argparse
import json
import os
import platform
import re
import statistics
import subprocess
import sys
import time
from collections.abc import Callable
from importlib.metadata import version
from pathlib import Path
from typing import Any

import carla

from steersman.files import write_text
from steersman.provenance import provenance

ROUNDS = 15
COUNT = 4000
COMMAND = (sys.executable, "-c", "from steersman.cli import main; main()", "carla", "serve")


def rate(work: Callable[[int], None]) -> float:
    """Calls per second."""
    begun = time.perf_counter()
    for i in range(COUNT):
        work(i)
    return COUNT / (time.perf_counter() - begun)


def ready(client: Any) -> Any:
    """An empty world in synchronous mode, 0.05 s in five substeps."""
    world = client.load_world("StandInStraight")
    settings = world.get_settings()
    settings.synchronous_mode, settings.fixed_delta_seconds = True, 0.05
    settings.max_substep_delta_time, settings.max_substeps = 0.01, 10
    world.apply_settings(settings)
    return world


def rounds(client: Any) -> dict[str, list[float]]:
    """Rates of each kind, a value for each round."""
    found: dict[str, list[float]] = {"bare": [], "driven": [], "calls": []}
    for _ in range(ROUNDS):
        world = ready(client)
        found["calls"].append(rate(lambda _: client.get_server_version()))
        found["bare"].append(rate(lambda _, world=world: world.tick()))
        model = world.get_blueprint_library().find("vehicle.tesla.model3")
        car = world.spawn_actor(model, world.get_map().get_spawn_points()[0])
        world.tick()

        def drive(i: int, world: Any = world, car: Any = car) -> None:
            # A control like the last one would not be sent.
            steer = 0.01 * (i % 3 - 1)
            car.apply_control(carla.VehicleControl(throttle=0.4, steer=steer))
            world.tick()
            seen = world.get_snapshot().find(car.id)
            seen.get_transform()
            seen.get_velocity()

        found["driven"].append(rate(drive))
        assert car.get_velocity().x > 1.0
    return found


def measure() -> dict[str, float]:
    """Start a server, measure, and stop it."""
    server = subprocess.Popen([*COMMAND, "--port", "0"], stdout=subprocess.PIPE, text=True)
    try:
        assert server.stdout is not None
        port = re.search(r":(\d+),", server.stdout.readline())
        assert port is not None
        client = carla.Client("127.0.0.1", int(port[1]))
        client.set_timeout(60.0)
        found = rounds(client)
    finally:
        server.terminate()
        server.wait(30)
    middle = {name: statistics.median(values) for name, values in found.items()}
    shares = [d / b for d, b in zip(found["driven"], found["bare"], strict=True)]
    return {
        "ticks_with_one_vehicle_per_s": middle["driven"],
        "best_round_of_these": max(found["driven"]),
        "bare_ticks_per_s": middle["bare"],
        "best_round_of_bare_ticks": max(found["bare"]),
        "calls_that_do_nothing_per_s": middle["calls"],
        "ratio_to_bare_ticks": statistics.median(shares),
        "load_average": os.getloadavg()[0],
        "processors": float(os.cpu_count() or 0),
    }


def main() -> None:
    """Measure, print, and write if asked."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--out", type=Path)
    out = parser.parse_args().out
    figures = measure()
    for name, value in figures.items():
        print(f"{name:32s} {value:14,.2f}")  # noqa: T201 - its output
    if out is not None:
        record: dict[str, Any] = {
            "figures": figures,
            "processor": platform.processor(),
            **provenance(),
        }
        record["versions"]["carla"] = version("carla")
        write_text(out, json.dumps(record, indent=1) + "\n")


if __name__ == "__main__":
    main()
