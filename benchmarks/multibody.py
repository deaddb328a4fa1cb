"""Speed of the multi-body plant, beside the package whose equations it has.

    python benchmarks/multibody.py [--out results/benchmarks/multibody.json]

Both evaluate the same derivative in turns in one process, and the plant drives control steps of
0.05 s at 15 m/s with a wave of steering, so that ratios stand whatever else the machine does.
The package's control steps are counted from its derivatives: as many as the plant evaluates in a
control step. Times are those of the processor.
"""

from __future__ import annotations

import argparse
import json
import math
import platform
import statistics
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from vehiclemodels.init_mb import init_mb
from vehiclemodels.parameters_vehicle2 import parameters_vehicle2
from vehiclemodels.vehicle_dynamics_mb import vehicle_dynamics_mb

from steersman.files import write_text
from steersman.kernels.compiled import kernel
from steersman.kernels.multibody import derivative_of
from steersman.kernels.multibody_figures import Body
from steersman.kernels.vehicle import VehicleTable
from steersman.plants.multibody import MultiBody
from steersman.provenance import provenance
from steersman.types import Command, FloatArray, Pose
from steersman.vehicles import Bmw320i

ROUNDS, STEPS, CALLS = 11, 400, 400
# Derivatives in a control step at 15 m/s: five steps of 0.01 s, four parts each, two stages.
EVALUATIONS = 40


@kernel
def _many(
    table: VehicleTable, body: Body, q: FloatArray, inputs: FloatArray, out: FloatArray, n: int
) -> None:
    for _ in range(n):
        derivative_of(table, 0, body, q, inputs, out)


def rate(work: Callable[[], Any], count: int) -> float:
    """Units of work per second of processor time."""
    begun = time.process_time()
    work()
    return count / (time.process_time() - begun)


def measure() -> dict[str, float]:
    """Medians over the rounds."""
    plant, table = MultiBody().make(Bmw320i()), Bmw320i().table
    body, figures = MultiBody().body(Bmw320i()), parameters_vehicle2()
    theirs = init_mb([0.0, 0.0, 0.02, 15.0, 0.0, 0.1, 0.0], figures)
    ours, inputs, out = np.zeros(29), np.zeros(3), np.zeros(29)
    ours[3:6] = 15.0, 0.0, 0.1

    def drive() -> None:
        plant.reset(Pose(0.0, 0.0, 0.0), 15.0, 0.0)
        for k in range(STEPS):
            plant.step(Command(0.02 * math.sin(0.2 * k), 0.4, 0.0))

    def package() -> None:
        for _ in range(CALLS):
            vehicle_dynamics_mb(list(theirs), [0.0, 1.0], figures)

    def kernel_alone() -> None:
        _many(table, body, ours, inputs, out, 50 * CALLS)

    for work in (drive, package, kernel_alone):
        work()
    found: dict[str, list[float]] = {"steps": [], "package": [], "kernel": []}
    for _ in range(ROUNDS):
        found["steps"].append(rate(drive, STEPS))
        found["package"].append(rate(package, CALLS))
        found["kernel"].append(rate(kernel_alone, 50 * CALLS))
    median = {name: statistics.median(values) for name, values in found.items()}
    return {
        "control_steps_per_s": median["steps"],
        "derivatives_per_s": median["kernel"],
        "package_derivatives_per_s": median["package"],
        "package_control_steps_per_s": median["package"] / EVALUATIONS,
        "ratio_of_derivatives": median["kernel"] / median["package"],
        "ratio_of_control_steps": median["steps"] / (median["package"] / EVALUATIONS),
    }


def main() -> None:
    """Measure, print, and write if asked to."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--out", type=Path, help="JSON file to write")
    arguments = parser.parse_args()
    found = {name: round(value, 1) for name, value in measure().items()}
    print(json.dumps(found, indent=2))  # noqa: T201 - what it is for
    if arguments.out is not None:
        machine = {"processor": platform.processor(), "python": platform.python_version()}
        text = json.dumps({**found, **machine, **provenance()}, indent=2)
        write_text(arguments.out, text + "\n")


if __name__ == "__main__":
    main()
