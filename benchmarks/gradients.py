"""A stretch of driving and the way back through it: 256 cars, 40 steps, one core.

    python benchmarks/gradients.py --out results/benchmarks/gradients.json

The two are timed in turns in one process, in processor time; the policy's network is left out.
"""

from __future__ import annotations

import argparse
import json
import sys
import time
from pathlib import Path

import numpy as np

from steersman.files import write_text
from steersman.learning.arithmetic import arithmetic
from steersman.learning.config import load_preset, train_config
from steersman.learning.fleet import FleetDriver
from steersman.learning.tape import Recorded
from steersman.provenance import provenance

CARS, STEPS, TURNS = 256, 40, 20


def measure() -> dict[str, float]:
    """Medians [ms] for the preset's problem with exact sensors, and the ratio of the two."""
    tree = load_preset("apg")
    tree["problem"]["sensor"] = {"kind": "waypoints"}
    driver = FleetDriver(train_config(tree).problem, CARS)
    recorded = Recorded(driver, STEPS)
    driver.seed(0)
    nothing = np.zeros((CARS, recorded.inputs.shape[2]))
    times: dict[str, list[float]] = {"drive": [], "back": []}
    for _ in range(TURNS + 1):
        for i in range(CARS):
            driver.reset(i)
        begun = time.process_time()
        for t in range(STEPS):
            recorded.before(t)
            driver.step(np.zeros(CARS))
            recorded.after(t, np.zeros(CARS))
        times["drive"].append(time.process_time() - begun)
        begun = time.process_time()
        ends = np.zeros_like(recorded.inputs)
        recorded.pull(np.ones((STEPS, CARS)), ends, lambda t, by: nothing + by[:, None])
        times["back"].append(time.process_time() - begun)
    drive, back = (1e3 * float(np.median(times[name][1:])) for name in ("drive", "back"))
    return {"drive_ms": drive, "back_ms": back, "back_over_drive": back / drive}


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
