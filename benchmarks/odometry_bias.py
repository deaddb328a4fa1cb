"""Controllers on a circle while their odometry is biased: how far does each end up beside the road?

    python benchmarks/odometry_bias.py --out results/benchmarks/odometry_bias.json

The circle of radius 50 m at 18.7 m/s for 60 s, waypoints and errors exact. What a controller sees
of v_x, v_y and yaw rate is wrong by a constant; speed control, record and judgement go by the
truth.
"""

from __future__ import annotations

import argparse
import json
from pathlib import Path
from typing import Annotated, Any, ClassVar

import numpy as np

from steersman.bench.entrants import entrant
from steersman.config import Of, build, param, required
from steersman.controllers.base import ControllerComponent, Wrapper
from steersman.files import write_text
from steersman.provenance import provenance
from steersman.rollout import RunConfig, attempt
from steersman.types import Decision, Observation
from steersman.vehicles import Vehicle

DRIVE = {
    "path": {"kind": "circle", "radius": 50.0},
    "speed": {"kind": "constant_speed", "speed": 18.7},
    "duration": 60.0,
}
BIASES: dict[str, dict[str, float]] = {
    "none": {},
    "v_y +0.035 m/s": {"v_y": 0.035},
    "v_y +0.1 m/s": {"v_y": 0.1},
    "v_x 5 % high": {"v_x_factor": 1.05},
    "yaw rate +0.01 rad/s": {"yaw_rate": 0.01},
}


class Biased(Wrapper):
    """A controller that sees its own motion with constant errors."""

    family: ClassVar[str] = "controller"
    kind: ClassVar[str] = "biased"

    inner: Annotated[ControllerComponent, Of("controller")] = required("-", "Who drives.")
    v_x_factor: float = param(1.0, "-", "v_x as it is seen over v_x.")
    v_y: float = param(0.0, "m/s", "Added to v_y.")
    yaw_rate: float = param(0.0, "rad/s", "Added to the yaw rate.")

    def init(self, vehicle: Vehicle, dt: float) -> Any:
        """The controller's own state."""
        return self.inner.init(vehicle, dt)

    def step(self, state: Any, observation: Observation) -> tuple[Decision, Any]:
        """The controller's decision on what is wrong."""
        seen = observation._replace(
            v_x=observation.v_x * self.v_x_factor,
            v_y=observation.v_y + self.v_y,
            yaw_rate=observation.yaw_rate + self.yaw_rate,
        )
        return self.inner.step(state, seen)

    def executed(self, state: Any, steer: float) -> Any:
        """The controller is told."""
        return self.inner.executed(state, steer)


def controllers() -> dict[str, ControllerComponent]:
    """``mpc_delay`` alone and behind the estimator, and the shipped policy."""
    return {
        "mpc_delay": entrant("tuned/mpc_delay").controller,
        "estimated mpc_delay": entrant("estimated/tuned/mpc_delay").controller,
        "policy": entrant("precision").controller,
    }


def figures(controller: ControllerComponent, bias: dict[str, float]) -> dict[str, Any]:
    """Largest and last lateral error of the drive, and when and how it ended."""
    biased = Biased(inner=controller, **bias)
    config = build(RunConfig, DRIVE).model_copy(update={"controller": biased})
    episode = attempt(config).episode
    error = episode["lateral_error"]
    return {
        "largest_mm": round(1e3 * float(np.abs(error).max()), 1),
        "last_mm": round(1e3 * float(error[-1]), 1),
        "end": episode.end,
        "seconds": round(len(episode) * episode.dt, 2),
    }


def main() -> None:
    """Drive everything and write the file."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--out", required=True)
    given = parser.parse_args()
    found = {
        name: {words: figures(controller, bias) for words, bias in BIASES.items()}
        for name, controller in controllers().items()
    }
    record = {"drive": DRIVE, "controllers": found, **provenance()}
    write_text(Path(given.out), json.dumps(record, indent=1, allow_nan=False) + "\n")


if __name__ == "__main__":
    main()
