"""Policies that choose their speed, beside controllers that do not and classical peers that do.

    python benchmarks/joint.py runs/joint/policy.onnx --out results/joint/results.json

Drives the suite ``beyond_grip``, a stop at the end of a path, the driving cycle on the training
circuit and a lap of Monza with each of:

- ``lateral``: tuned/mpc_delay, which drives as fast as wished;
- ``dry_profile``: the same, at the speeds that a dry road (friction 1) allows, if they are lower;
- ``found``: grip_speed with the friction that mpc_delay finds on the way, and 80 m of road in view;
- ``oracle``: tuned/mpc_delay and speeds along the path that both know the true friction;
- ``joint``, the policy; ``joint_1`` and so on, further ones.

The last line of a row is what the oracle's time on the same road is to that of the drive: 1 is as
fast. Lost drives have none.
"""

from __future__ import annotations

import argparse
import json
import math
from pathlib import Path
from typing import Any

import numpy as np

from steersman.bench.beyond import FRICTION, beyond_grip
from steersman.bench.grip import demanded_grip
from steersman.bench.suite import Scenario
from steersman.config import build, resolve
from steersman.files import write_text
from steersman.kernels.vehicle import GRAVITY
from steersman.policy_file import read_policy
from steersman.provenance import provenance
from steersman.rollout import RunConfig, attempt
from steersman.speed import SpeedProfile

STEERS = "tuned/mpc_delay"
# Those that find the friction by driving.
FINDERS: dict[str, Any] = {
    "found": {"kind": "grip_speed", "inner": STEERS, "found": True},
    "joint_nmpc": {"kind": "joint_nmpc", "found": True},
}
DRY = 1.0
# Shares of the grip that a speed profile uses in bends and for braking.
USED, BRAKING = 0.8, 0.5
# The friction of the patches of ``beyond_grip``.
PATCHES = 0.45


def profile(friction: float, top: float) -> SpeedProfile:
    """The speeds along a path that a friction allows, from standstill on."""
    return SpeedProfile(
        top=top,
        a_lat_max=USED * friction * GRAVITY,
        deceleration=BRAKING * friction * GRAVITY,
        start=0.0,
    )


def run_of(scenario: Scenario, name: str, policy: str) -> RunConfig:
    """The run of a scenario with one of those that drive."""
    run, friction = scenario.run, FRICTION.get(scenario.disturbance.split("_")[0], PATCHES)
    controller: Any = STEERS
    changes: dict[str, Any] = {}
    if name in FINDERS:
        controller = FINDERS[name]
        changes["sensor"] = run.sensor.model_copy(update={"count": 41})
    if name == "dry_profile":
        # As fast as wished or as a dry road allows: the slower of both.
        wished = scenario.applied.used_grip * (scenario.applied.friction or DRY) * GRAVITY
        changes["speed"] = run.speed.model_copy(
            update={"a_lat_max": min(wished, USED * DRY * GRAVITY)}
        )
    if name == "oracle":
        changes |= {"speed": profile(friction, 20.0), "nominal": None}
    if policy:
        controller = {"kind": "policy", "file": policy}
        changes["sensor"] = run.sensor.model_copy(update={"count": waypoints(policy)})
    return run.model_copy(update={**changes, "controller": resolve("controller", controller)})


def waypoints(policy: str) -> int:
    """How many a policy reads."""
    return read_policy(Path(policy))[1].waypoints


def figures(run: RunConfig) -> dict[str, Any]:
    """What a drive came to; speeds in m/s, lengths in m."""
    episode = attempt(run).of_controller()
    errors, v = episode["lateral_error"], episode["v_x"]
    return {
        "kept": bool(episode.completed),
        "seconds": round(len(episode) * episode.dt, 3),
        "distance_m": round(episode.distance, 2),
        "rms_m": float(f"{np.sqrt(np.mean(errors**2)):.4g}"),
        "largest_m": float(f"{np.abs(errors).max():.4g}"),
        "last_speed_m_s": float(f"{v[-1]:.4g}"),
    }


def beyond(names: dict[str, str], every: int) -> list[dict[str, Any]]:
    """A row for each drive of the suite."""
    rows = []
    for scenario in beyond_grip().scenarios()[::every]:
        share = round(demanded_grip(scenario.run), 3)
        found = {name: figures(run_of(scenario, name, file)) for name, file in names.items()}
        best = found["oracle"]["seconds"]
        for name, row in found.items():
            pace = best / row["seconds"] if row["kept"] and found["oracle"]["kept"] else None
            told = {"road": scenario.path, "grip": scenario.disturbance, "share": share}
            rows.append({"driven_by": name, **told, **row, "pace": pace and round(pace, 4)})
    return rows


def interval(kept: int, count: int) -> tuple[float, float]:
    """Wilson's 95 % interval of a share (Wilson, J. Am. Stat. Assoc. 22, 1927)."""
    z, share = 1.96, kept / count
    middle = (share + z * z / (2 * count)) / (1 + z * z / count)
    half = math.sqrt(share * (1 - share) / count + z * z / (4 * count * count))
    half *= z / (1 + z * z / count)
    return round(middle - half, 3), round(middle + half, 3)


def summary(rows: list[dict[str, Any]]) -> dict[str, Any]:
    """Kept drives and pace of each, over all drives whose wish is beyond grip, and by grip."""
    out: dict[str, Any] = {}
    hard = [row for row in rows if row["share"] > 1.0]
    for name in dict.fromkeys(row["driven_by"] for row in hard):
        own = [row for row in hard if row["driven_by"] == name]
        kept, paces = sum(row["kept"] for row in own), [r["pace"] for r in own if r["pace"]]
        out[name] = {
            "drives": len(own),
            "kept": kept,
            "kept_95": interval(kept, len(own)),
            "pace": round(float(np.mean(paces)), 3) if paces else None,
            "by_grip": {
                grip: f"{sum(r['kept'] for r in own if r['grip'] == grip)} of "
                f"{sum(r['grip'] == grip for r in own)}"
                for grip in dict.fromkeys(row["grip"] for row in own)
            },
        }
    return out


def usual(names: dict[str, str]) -> dict[str, Any]:
    """Where grip suffices: a stop, the driving cycle, a lap of Monza."""
    wishes: dict[str, dict[str, Any]] = {
        "stop": {
            "path": {"kind": "clothoid_road", "seed": 100, "distance": 250.0},
            "speed": {"kind": "constant_speed", "speed": 12.0, "a_lat_max": 4.0, "end": 0.0},
        },
        "nedc": {
            "path": "training_circuit",
            "speed": {"kind": "nedc", "a_lat_max": 4.0},
            "duration": 400.0,
        },
        "monza": {
            "path": "monza",
            "laps": 1,
            "speed": {"kind": "profile", "a_lat_max": 6.0, "top": 40.0},
        },
    }
    out: dict[str, Any] = {}
    for task, wish in wishes.items():
        out[task] = {}
        for name, file in names.items():
            controller = {"kind": "policy", "file": file} if file else STEERS
            sensor = {"kind": "waypoints", "count": waypoints(file)} if file else "waypoints"
            run = build(RunConfig, {**wish, "controller": controller, "sensor": sensor})
            out[task][name] = figures(run)
            if task == "nedc":
                out[task][name]["speed_rms_m_s"] = speed_error(run)
    return out


def speed_error(run: RunConfig) -> float:
    """RMS difference of speed and wished speed [m/s]."""
    from steersman.kernels.speed import target_speed
    from steersman.profiles import stack_profiles

    episode, path = attempt(run).of_controller(), run.path
    table = stack_profiles([run.speed.profile()], [path])
    place = zip(episode["time"].tolist(), episode["s"].tolist(), strict=True)
    wished = [target_speed(table, 0, path.table, 0, time, s) for time, s in place]
    v = np.hypot(episode["v_x"], episode["v_y"])
    return float(f"{np.sqrt(np.mean((v - wished) ** 2)):.4g}")


def main() -> None:
    """Drive, and write the file."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("policies", nargs="*")
    parser.add_argument("--out", required=True)
    parser.add_argument("--every", type=int, default=1, help="drive every so many-th scenario")
    given = parser.parse_args()
    learned = {f"joint_{k}" if k else "joint": file for k, file in enumerate(given.policies)}
    peers = {**dict.fromkeys(("lateral", "dry_profile", "found", "oracle"), ""), **learned}
    rows = beyond(peers, given.every)
    found = {
        "commit": provenance()["commit"],
        "every": given.every,
        "beyond_grip": summary(rows),
        "usual": usual({"lateral": "", **learned}),
        "rows": rows,
    }
    write_text(Path(given.out), json.dumps(found, indent=1, allow_nan=False) + "\n")


if __name__ == "__main__":
    main()
