"""How much of the best classical controller's error is ignorance: told the truth, what remains?

    python benchmarks/bound.py --out results/bench/bound.json

``mpc_delay`` as tuned drives the disturbed scenarios of a suite three times: as in the benchmark;
told the true car and the true steering delay; and in addition with exact waypoints. What is left
in the second is the price of the waypoint errors, in the third that of the delay itself and of the
car's limits. It is what this controller does with this filter of the road, and no bound for others.
"""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np

from steersman.bench.drive import charged_rms, driven_share
from steersman.bench.entrants import entrant
from steersman.bench.suite import CLEAN, Scenario
from steersman.bench.suites import suite
from steersman.controllers.mpc_delay import MpcDelay
from steersman.files import make_folder, write_text
from steersman.provenance import provenance
from steersman.rollout import RunConfig, attempt


def as_it_is(run: RunConfig, controller: MpcDelay) -> RunConfig:
    """As in the benchmark."""
    return run.model_copy(update={"controller": controller})


def told(run: RunConfig, controller: MpcDelay) -> RunConfig:
    """The controller knows the true car and the true delay."""
    knowing = controller.model_copy(update={"delay": run.plant.steering_delay})
    return run.model_copy(update={"controller": knowing, "nominal": None})


def told_and_exact(run: RunConfig, controller: MpcDelay) -> RunConfig:
    """And the waypoints have no errors."""
    exact = run.sensor.model_copy(update={"error_range": 0.0})
    return told(run, controller).model_copy(update={"sensor": exact})


VARIANTS: dict[str, Callable[[RunConfig, MpcDelay], RunConfig]] = {
    "as in the benchmark": as_it_is,
    "told car and delay": told,
    "told, exact waypoints": told_and_exact,
}


def error(config: RunConfig) -> float:
    """RMS lateral error [m], charged if it ends early."""
    episode = attempt(config).of_controller()
    share = driven_share(config, episode)
    return charged_rms(episode["lateral_error"], share, config.corridor)


def root_mean_square(values: list[float]) -> float:
    """In mm, of errors in m."""
    return round(1e3 * float(np.sqrt(np.square(values).mean())), 3)


def main() -> None:
    """Drive everything and write the file."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--suite", default="core_1")
    parser.add_argument("--out", default="results/bench/bound.json")
    given = parser.parse_args()
    controller = entrant("tuned/mpc_delay").controller
    assert isinstance(controller, MpcDelay)
    disturbed: list[Scenario] = [
        s for s in suite(given.suite).scenarios((0,)) if s.disturbance != CLEAN
    ]
    out = {}
    for name, change in VARIANTS.items():
        by: dict[str, list[float]] = {}
        for scenario in disturbed:
            found = error(change(scenario.run, controller))
            by.setdefault(scenario.disturbance, []).append(found)
        out[name] = {
            "rms_mm": root_mean_square([e for errors in by.values() for e in errors]),
            "by_disturbance_mm": {d: root_mean_square(errors) for d, errors in by.items()},
        }
        sys.stdout.write(f"{name}: {out[name]['rms_mm']} mm\n")
    make_folder(Path(given.out).parent)
    record = {"suite": given.suite, "scenarios": len(disturbed), "variants": out, **provenance()}
    write_text(Path(given.out), json.dumps(record, indent=1, allow_nan=False) + "\n")


if __name__ == "__main__":
    main()
