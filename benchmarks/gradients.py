"""A stretch of driving and the way back through it: 256 cars, 40 steps, one core.

    python benchmarks/gradients.py --out results/benchmarks/gradients.json

Timed in turns in one process, in processor time, beside the same drive without derivatives; the
policy's network is left out.
"""

from __future__ import annotations

import argparse
import json
import sys
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np

from steersman.files import write_text
from steersman.learning.arithmetic import arithmetic
from steersman.learning.config import load_preset, train_config
from steersman.learning.fleet import FleetDriver
from steersman.learning.tape import Recorded
from steersman.provenance import provenance

CARS, STEPS, TURNS = 256, 40, 20


def fleet() -> FleetDriver:
    """The cars of the preset ``apg``, with exact sensors."""
    tree = load_preset("apg")
    tree["problem"]["sensor"] = {"kind": "waypoints"}
    driver = FleetDriver(train_config(tree).problem, CARS)
    driver.seed(0)
    return driver


def drive(driver: FleetDriver, recorded: Recorded | None) -> None:
    """A stretch, straight on."""
    straight = np.zeros(CARS)
    for t in range(STEPS):
        if recorded is not None:
            recorded.before(t)
        driver.step(straight)
        if recorded is not None:
            recorded.after(t, straight)


def measure() -> dict[str, float]:
    """Medians [ms]: a plain drive, one with derivatives, the way back; and ratios to the plain."""
    plain, driver = fleet(), fleet()
    recorded = Recorded(driver, STEPS)
    nothing = np.zeros((CARS, recorded.inputs.shape[2]))

    def back() -> None:
        ends = np.zeros_like(recorded.inputs)
        recorded.pull(np.ones((STEPS, CARS)), ends, lambda t, by: nothing + by[:, None])

    jobs: dict[str, Callable[[], None]] = {
        "plain": lambda: drive(plain, None),
        "drive": lambda: drive(driver, recorded),
        "back": back,
    }
    times: dict[str, list[float]] = {name: [] for name in jobs}
    for _ in range(TURNS + 1):
        for each in (plain, driver):
            for i in range(CARS):
                each.reset(i)
        for name, job in jobs.items():
            begun = time.process_time()
            job()
            times[name].append(time.process_time() - begun)
    found = {name: 1e3 * float(np.median(taken[1:])) for name, taken in times.items()}
    whole = found["drive"] + found["back"]
    return {
        **{f"{name}_ms": value for name, value in found.items()},
        "whole_ms": whole,
        "whole_over_plain": whole / found["plain"],
    }


def main() -> None:
    """Measure, print, and write if asked."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--out", type=Path)
    out = parser.parse_args().out
    with arithmetic(1):
        figures = measure()
    sys.stdout.write(" ".join(f"{k} {v:.2f}" for k, v in figures.items()) + "\n")
    if out is not None:
        figures = {"cars": CARS, "steps": STEPS, **figures}
        write_text(out, json.dumps({"gradients": figures, **provenance()}, indent=1) + "\n")


if __name__ == "__main__":
    main()
