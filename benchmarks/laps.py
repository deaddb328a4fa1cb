r"""A lap of each circuit against the clock: what steers and drives, and the speed profile's time.

    python benchmarks/laps.py [POLICY.onnx ...] --tracks ../shared/data/racetracks \
        --out results/joint/laps.json

Wished are the fastest speeds that 6 m/s^2 across and 4 m/s^2 along allow (``speed=profile``, at
most 40 m/s). Each lap begins at the profile's speed, in a corridor of 1.5 m to both sides. Beside
policies drive ``tuned/mpc_delay`` as fast as wished, and ``grip_speed`` and ``joint_nmpc``, which
slow down where grip would not suffice; ``found`` is ``grip_speed`` with the friction that it finds.
A lap's time is that of its whole length, by the profile and as driven.
"""

from __future__ import annotations

import argparse
import json
from pathlib import Path
from typing import Any

import numpy as np

from steersman.config import build
from steersman.files import write_text
from steersman.paths.base import PathComponent
from steersman.policy_file import read_policy
from steersman.profiles import road_limits
from steersman.provenance import provenance
from steersman.rollout import RunConfig, attempt

WISHED = {"kind": "profile", "a_lat_max": 6.0, "deceleration": 4.0, "top": 40.0}
PEERS: dict[str, Any] = {
    "mpc_delay": "tuned/mpc_delay",
    "grip_speed": {"kind": "grip_speed", "inner": "tuned/mpc_delay"},
    "found": {"kind": "grip_speed", "inner": "tuned/mpc_delay", "found": True},
    "joint_nmpc": "joint_nmpc",
}
# The goals: time over the profile's, and the largest lateral error [m].
SLOWER, FARTHEST = 1.03, 0.3


def lap(path: Any, controller: Any, waypoints: int) -> RunConfig:
    """One lap from the path's start."""
    words = {"path": path, "laps": 1, "controller": controller, "speed": WISHED}
    return build(RunConfig, {**words, "sensor": {"kind": "waypoints", "count": waypoints}})


def profile_time(run: RunConfig) -> float:
    """Time of a lap at the profile's speeds [s], by the trapezoidal rule on 1/v."""
    path: PathComponent = run.path
    limit, step = road_limits(path, run.speed.profile())
    slow = 1.0 / np.minimum(limit, WISHED["top"])
    return float(np.sum(0.5 * (slow[1:] + slow[:-1])) * step)


def figures(run: RunConfig) -> dict[str, Any]:
    """What a lap came to."""
    episode = attempt(run).of_controller()
    errors, aim = np.abs(episode["lateral_error"]), profile_time(run)
    seconds = len(episode) * episode.dt
    kept = bool(episode.completed)
    return {
        "kept": kept,
        "distance_m": round(episode.distance, 1),
        "profile_s": round(aim, 2),
        "seconds": round(seconds, 2) if kept else None,
        "ratio": round(seconds / aim, 4) if kept else None,
        "largest_m": float(f"{errors.max():.3g}"),
        "rms_m": float(f"{np.sqrt(np.mean(errors**2)):.3g}"),
        "within": kept and seconds <= SLOWER * aim and bool(errors.max() <= FARTHEST),
    }


def main() -> None:
    """Drive, and write the file."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("policies", nargs="*")
    parser.add_argument("--tracks", type=Path, required=True)
    parser.add_argument("--out", type=Path, required=True)
    given = parser.parse_args()
    roads: dict[str, Any] = {"monza": "monza", "training_circuit": "training_circuit"}
    roads |= {
        file.stem: {"kind": "csv", "file": str(file), "loop": True}
        for file in sorted(given.tracks.glob("*.csv"))
    }
    drivers = {name: (controller, 25) for name, controller in PEERS.items()}
    for k, file in enumerate(given.policies):
        count = read_policy(Path(file))[1].waypoints
        drivers[f"joint_{k}" if k else "joint"] = ({"kind": "policy", "file": file}, count)
    rows = [
        {"road": road, "driven_by": name, **figures(lap(path, *driver))}
        for road, path in roads.items()
        for name, driver in drivers.items()
    ]
    found = {"commit": provenance()["commit"], "wished": WISHED, "rows": rows}
    write_text(given.out, json.dumps(found, indent=1, allow_nan=False) + "\n")


if __name__ == "__main__":
    main()
