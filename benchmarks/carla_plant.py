"""The plant ``carla`` against the stand-in: control steps per second, and how far runs lie apart.

    python benchmarks/carla_plant.py [--out results/benchmarks/carla_plant.json]

A run of a minute on the stand-in, through the real client, beside the same run on the embedded
simulator: largest distance between the two lines driven [m]. The rates are of the plant's ``step``
alone (control, tick, snapshot, wheel angle), medians and best of several rounds; server and client
share the machine with whatever else it does.
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
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np

from steersman.config import build
from steersman.files import write_text
from steersman.paths.analytic import Circle
from steersman.plants.carla import CarlaConfig
from steersman.provenance import provenance
from steersman.rollout import RunConfig, run
from steersman.types import Command, Pose
from steersman.vehicles import CarlaModel3

ROUNDS = 15
COUNT = 500
SECONDS = 60.0
COMMAND = (sys.executable, "-c", "from steersman.cli import main; main()", "carla", "serve")
RUNS: dict[str, dict[str, Any]] = {
    "circle, MPC-PID, throttle 0.4": {"controller": "mpc_pid"},
    "circle, MPC-PID for each speed, 18.7 m/s": {
        "controller": {"kind": "mpc_pid", "scheduled": True},
        "speed": {"kind": "constant_speed", "speed": 18.7},
    },
    "Monza, policy, throttle 0.4": {"controller": "policy", "path": "monza"},
    "lemniscate, CARLA's PID, 8 m/s": {
        "controller": "bearing_pid",
        "path": "lemniscate",
        "speed": {"kind": "constant_speed", "speed": 8.0},
    },
}


def apart(plant: CarlaConfig, words: dict[str, Any]) -> dict[str, Any]:
    """Largest distance between the lines of both plants [m], and how long they were driven [s]."""
    config = build(RunConfig, {**words, "duration": SECONDS})
    here, there = run(config), run(config.model_copy(update={"plant": plant}))
    n = min(len(here), len(there))
    gap = np.hypot(here["x"][:n] - there["x"][:n], here["y"][:n] - there["y"][:n])
    return {"largest_m": float(gap.max()), "seconds": n * here.dt, "ends": [here.end, there.end]}


def rates(config: CarlaConfig) -> list[float]:
    """Control steps per second, a figure for each round."""
    plant = config.make(CarlaModel3())
    try:
        plant.enter(Circle())
        found = []
        for _ in range(ROUNDS):
            state = plant.reset(Pose(0.0, 0.0, 0.0), 8.0, 0.02)
            begun = time.perf_counter()
            for _ in range(COUNT):
                plant.step(Command(state.steer, 0.4, 0.0))
            found.append(COUNT / (time.perf_counter() - begun))
        return found
    finally:
        plant.close()


def main() -> None:
    """Start a server, measure, and print or write."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--out", type=Path)
    out = parser.parse_args().out
    server = subprocess.Popen([*COMMAND, "--port", "0"], stdout=subprocess.PIPE, text=True)
    try:
        assert server.stdout is not None
        found = re.search(r":(\d+), streams", server.stdout.readline())
        assert found is not None
        plant = CarlaConfig(port=int(found[1]), warm_up=0.1)
        lines = {name: apart(plant, words) for name, words in RUNS.items()}
        steps = rates(plant)
    finally:
        server.terminate()
        server.communicate(timeout=20.0)
    result = {
        **provenance(),
        "carla": version("carla"),
        "cpus": os.cpu_count(),
        "machine": platform.machine(),
        "apart": lines,
        "control_steps_per_second": {"median": statistics.median(steps), "best": max(steps)},
    }
    text = json.dumps(result, indent=1) + "\n"
    if out is None:
        sys.stdout.write(text)
    else:
        write_text(out, text)


if __name__ == "__main__":
    main()
