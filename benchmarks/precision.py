"""What the preset ``precision`` reaches: its goals on the circle and on Monza, over seeds.

    steersman train precision seeds=0..4 --out runs/precision
    python benchmarks/precision.py runs/precision/seed_*/policy.onnx --out results/precision

Every policy drives the paper's tests (circle of radius 50 m, a lap of Monza) and the same with
waypoint errors of up to 0.1 m; beside it drive classical controllers. ``goals.json`` has every
drive, ``goals.md`` the medians beside the goals. The comparison under disturbances is
``steersman bench``.
"""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from steersman.bench.entrants import entrant
from steersman.config import build, dump
from steersman.files import make_folder, write_text
from steersman.metrics.base import summarise
from steersman.provenance import provenance
from steersman.rollout import RunConfig, attempt
from steersman.studies.demo import tests

# Mean |d| at most [mm]: a tenth of the paper's; steering SD at most; Monza's mean and max [mm];
# max |d| with waypoint errors of 0.1 m [mm].
GOALS: dict[str, dict[str, float]] = {
    "R50, throttle 0.4": {"mean_mm": 0.28, "steer_std": 0.01},
    "R50, throttle 0.6": {"mean_mm": 4.7, "steer_std": 0.01},
    "R50, throttle 0.8": {"mean_mm": 8.5, "steer_std": 0.01},
    "R50, throttle 1.0": {"mean_mm": 10.4, "steer_std": 0.01},
    "R50, 9.9 m/s": {"mean_mm": 0.28, "steer_std": 0.01},
    "R50, 18.7 m/s": {"mean_mm": 4.7, "steer_std": 0.01},
    "R50, 22.2 m/s": {"mean_mm": 8.5, "steer_std": 0.01},
    "R50, 24.2 m/s": {"mean_mm": 10.4, "steer_std": 0.01},
    "Monza, throttle 0.4": {"mean_mm": 20.0, "max_mm": 300.0},
    "R50, throttle 0.5, waypoint errors 0.1 m": {"max_mm": 200.0},
    "Monza, throttle 0.4, waypoint errors 0.1 m": {"max_mm": 200.0},
}
NOISE = {"kind": "waypoints", "error_range": 0.1}
# The paper's demonstrator as it is, the same tuned for disturbed roads, the most precise one.
BESIDE = ("mpc_pid", "tuned/mpc_pid_scheduled", "estimated/tuned/mpc_delay")
MEASURES = {"mean_mm": "mean |d| [mm]", "max_mm": "max |d| [mm]", "steer_std": "SD of steering"}


def configs() -> dict[str, dict[str, Any]]:
    """The drives, without their controllers."""
    out = {test.name: test.config for test in tests()}
    monza = out["Monza, throttle 0.4"]
    circle = out["R50, throttle 0.4"]
    half = {"kind": "constant_throttle", "throttle": 0.5}
    out["R50, throttle 0.5, waypoint errors 0.1 m"] = circle | {"speed": half, "sensor": NOISE}
    out["Monza, throttle 0.4, waypoint errors 0.1 m"] = monza | {"sensor": NOISE}
    return out


def driven(controller: Mapping[str, Any], words: Mapping[str, Any]) -> dict[str, Any]:
    """One drive in figures."""
    found = summarise(
        attempt(build(RunConfig, {**words, "controller": controller})).of_controller()
    )
    steady = found["steady"]["mean_abs_lateral_error_m"]
    return {
        "mean_mm": 1e3 * found["mean_abs_lateral_error_m"],
        "steady_mm": 1e3 * steady,
        "max_mm": 1e3 * found["max_abs_lateral_error_m"],
        "steer_std": found["steer_std"],
        "speed": found["mean_speed_m_s"],
        "end": found["end"],
        "completed": found["completed"],
    }


def line(name: str, measure: str, rows: Mapping[str, Sequence[Mapping[str, Any]]]) -> str:
    """A line of the table: the goal, the agent's median and worst, the teachers."""
    goal = GOALS[name][measure]
    agents = [row[measure] for row in rows["agent"]]
    left = sum(not row["completed"] for row in rows["agent"])
    median, worst = float(np.median(agents)), max(agents)
    met = "yes" if median <= goal and not left else "no"
    cells = [name, MEASURES[measure], f"{goal:g}", f"{median:.3g}", f"{worst:.3g}", met]
    for row in (several[0] for who, several in rows.items() if who != "agent"):
        cells.append(f"{row[measure]:.3g}" + ("" if row["completed"] else f" ({row['end']})"))
    cells.append(f"{left} of {len(agents)}" if left else "")
    return "| " + " | ".join(str(c).replace("|", r"\|") for c in cells) + " |"


def main() -> None:
    """Drive everything and write both files."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("policies", nargs="+", help="ONNX files, one for each seed")
    parser.add_argument("--beside", nargs="*", default=BESIDE, help="controllers, as for bench")
    parser.add_argument("--out", default="results/precision")
    given = parser.parse_args()
    drivers: dict[str, list[dict[str, Any]]] = {
        "agent": [{"kind": "policy", "file": file} for file in given.policies],
        **{word: [dump(entrant(word).controller)] for word in given.beside},
    }
    found = {
        name: {who: [driven(c, words) for c in several] for who, several in drivers.items()}
        for name, words in configs().items()
    }
    beside = [f"`{word}`" for word in given.beside]
    heads = ["test", "measure", "goal", "median", "worst", "met", *beside, "not finished"]
    lines = ["| " + " | ".join(heads) + " |", "|---|---|" + "---:|" * (len(heads) - 2)]
    lines += [line(name, m, found[name]) for name, goals in GOALS.items() for m in goals]
    out = make_folder(Path(given.out))
    record = {"goals": GOALS, "drives": found, **provenance()}
    write_text(out / "goals.json", json.dumps(record, indent=1, allow_nan=False) + "\n")
    write_text(out / "goals.md", "\n".join(lines) + "\n")
    sys.stdout.write("\n".join(lines) + "\n")


if __name__ == "__main__":
    main()
