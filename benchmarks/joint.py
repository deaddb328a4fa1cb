"""Policies that choose their speed, beside controllers that do not and classical peers that do.

    python benchmarks/joint.py runs/joint/policy.onnx --out results/joint/results.json

Drives the suite ``beyond_grip``, stops at the end of paths, the driving cycle on the training
circuit and a lap of Monza with each of:

- ``lateral``: tuned/mpc_delay, which drives as fast as wished;
- ``dry_profile``: the same, at the speeds that a dry road (friction 1) allows, if they are lower;
- ``found``: grip_speed with the friction that mpc_delay finds on the way, and 80 m of road in view;
- ``joint_nmpc``: the MPC of steering and speed, which finds the friction so, too;
- ``oracle``: tuned/mpc_delay and speeds along the path that both know the true friction;
- ``joint``, the policy; ``joint_1`` and so on, further ones.

``rms_over_way_m`` is the lateral error over the way: a mean over time also counts how long a car
stands where it happens to stand.

The last line of a row is what the oracle's time on the same road is to that of the drive: 1 is as
fast. Lost drives have none. Intervals are of 95 %: Wilson's of the drives kept, a bootstrap over
roads of the mean pace.
"""

from __future__ import annotations

import argparse
import itertools
import json
import math
from concurrent.futures import ProcessPoolExecutor
from functools import partial
from multiprocessing import get_context
from pathlib import Path
from typing import Any

import numpy as np

from steersman.bench.beyond import FRICTION, beyond_grip
from steersman.bench.grip import demanded_grip
from steersman.bench.statistics import Clusters
from steersman.bench.suite import Scenario
from steersman.config import build, resolve
from steersman.files import write_text
from steersman.kernels.vehicle import GRAVITY
from steersman.metrics.base import evaluate
from steersman.metrics.stopping import stopping
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
    way = np.abs(v) / np.abs(v).sum()
    return {
        "kept": bool(episode.completed),
        "seconds": round(len(episode) * episode.dt, 3),
        "distance_m": round(episode.distance, 2),
        "rms_m": float(f"{np.sqrt(np.mean(errors**2)):.4g}"),
        "rms_over_way_m": float(f"{np.sqrt(np.sum(way * errors**2)):.4g}"),
        "largest_m": float(f"{np.abs(errors).max():.4g}"),
        "last_speed_m_s": float(f"{v[-1]:.4g}"),
    }


def beyond(names: dict[str, str], every: int, jobs: int) -> list[dict[str, Any]]:
    """A row for each drive of the suite."""
    scenarios = beyond_grip().scenarios()[::every]
    with ProcessPoolExecutor(jobs, get_context("spawn")) as pool:
        return [row for rows in pool.map(partial(on, names), scenarios) for row in rows]


def on(names: dict[str, str], scenario: Scenario) -> list[dict[str, Any]]:
    """A row for each that drives a scenario."""
    share = round(demanded_grip(scenario.run), 3)
    found = {name: figures(run_of(scenario, name, file)) for name, file in names.items()}
    best, rows = found["oracle"]["seconds"], []
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
    return max(round(middle - half, 3), 0.0), min(round(middle + half, 3), 1.0)


def pace_of(rows: list[dict[str, Any]]) -> list[float]:
    """Mean pace with its interval."""
    clusters = Clusters([row["road"] for row in rows])
    found = clusters.interval(lambda mean: mean([row["pace"] for row in rows]))
    return [round(each, 3) for each in found]


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
            "pace": pace_of([r for r in own if r["pace"]]) if paces else None,
            "by_grip": {
                grip: f"{sum(r['kept'] for r in own if r['grip'] == grip)} of "
                f"{sum(r['grip'] == grip for r in own)}"
                for grip in dict.fromkeys(row["grip"] for row in own)
            },
        }
    return out


def controlled(name: str, file: str) -> dict[str, Any]:
    """One of those that drive where grip suffices."""
    if file:
        sensor = {"kind": "waypoints", "count": waypoints(file)}
        return {"controller": {"kind": "policy", "file": file}, "sensor": sensor}
    if name == "found":
        return {"controller": FINDERS[name], "sensor": {"kind": "waypoints", "count": 41}}
    return {"controller": "joint_nmpc" if name == "joint_nmpc" else STEERS}


def stops(names: dict[str, str]) -> dict[str, Any]:
    """Standing at the end of three roads, with three cars and three demands of speed."""
    roads: dict[str, Any] = {
        "clothoid_100": {"kind": "clothoid_road", "seed": 100, "distance": 250.0},
        "double_lane_change": "double_lane_change",
        "straight": {"kind": "straight", "distance": 60.0},
    }
    speeds: dict[str, Any] = {
        "12 m/s": {"kind": "constant_speed", "speed": 12.0, "a_lat_max": 4.0, "end": 0.0},
        "profile": {"kind": "profile", "deceleration": 3.0, "top": 15.0, "end": 0.0},
        "hard": {"kind": "constant_speed", "speed": 9.0, "deceleration": 3.5, "end": 0.0},
    }
    rows = []
    for name, file in names.items():
        for car in ("carla_model3", "bmw_320i", "vw_t7"):
            for (road, path), (speed, wish) in itertools.product(roads.items(), speeds.items()):
                words = {"path": path, "speed": wish, "vehicle": car, "corridor": 3.0}
                run = build(RunConfig, {**words, **controlled(name, file)})
                episode = attempt(run).of_controller()
                left = evaluate(episode, stopping())["stop_error_m"]
                told = {"driven_by": name, "car": car, "road": road, "speed": speed}
                rows.append({**told, "end": episode.end, "stop_error_m": left and round(left, 4)})
    out: dict[str, Any] = {}
    for name in names:
        own = [row["stop_error_m"] for row in rows if row["driven_by"] == name]
        stood = [each for each in own if each is not None]
        out[name] = {"drives": len(own), "stood": len(stood), "largest_m": max(stood, default=None)}
    return {**out, "rows": rows}


def usual(names: dict[str, str]) -> dict[str, Any]:
    """Where grip suffices: the driving cycle, a lap of Monza."""
    wishes: dict[str, dict[str, Any]] = {
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
            run = build(RunConfig, {**wish, **controlled(name, file)})
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
    parser.add_argument("--jobs", type=int, default=1, help="processes")
    given = parser.parse_args()
    learned = {f"joint_{k}" if k else "joint": file for k, file in enumerate(given.policies)}
    classical = ("lateral", "dry_profile", "found", "joint_nmpc", "oracle")
    peers = {**dict.fromkeys(classical, ""), **learned}
    at_ease = {"lateral": "", "found": "", "joint_nmpc": "", **learned}
    rows = beyond(peers, given.every, given.jobs)
    found = {
        "commit": provenance()["commit"],
        "every": given.every,
        "beyond_grip": summary(rows),
        "stops": stops(at_ease),
        "usual": usual(at_ease),
        "rows": rows,
    }
    write_text(Path(given.out), json.dumps(found, indent=1, allow_nan=False) + "\n")


if __name__ == "__main__":
    main()
