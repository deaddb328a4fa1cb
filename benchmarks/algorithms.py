"""Learning algorithms on the problem of the preset ``demo``, the same steps for each.

    python benchmarks/algorithms.py

Every method is told what the preset tells its DDPG, where it has that option (learning rate,
noise, mirror images); PPO keeps its own learning rate, and all else stays at its default: nothing
is tuned. PPO has no extra action, so DDPG is there without it, too. Each seed trains in a process
of its own, in turns, so that the seconds are those of one core; a run that was interrupted goes on.
The best policy of each training then drives the held-out roads of the suite ``core_1``, clean and
disturbed. ``results.json`` has curves, configurations, seeds and commit, ``results.md`` the table.
"""

from __future__ import annotations

import argparse
import csv
import json
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from steersman.bench.drive import measure
from steersman.bench.entrants import entrant
from steersman.bench.first_stage import core_1
from steersman.bench.results import BenchRow
from steersman.bench.suite import CLEAN, Scenario
from steersman.config import dump
from steersman.files import make_folder, write_text
from steersman.learning.config import TrainConfig, load_preset, train_config
from steersman.learning.parallel import TrainingEvent, TrainingJob, train_all
from steersman.provenance import provenance

NEVER = {"kind": "constant", "at": 0.0}
# What differs from the preset: the algorithm, and whether the demonstrator may act.
METHODS: dict[str, tuple[str, bool]] = {
    "DDPG": ("ddpg", True),
    "TD3": ("td3", True),
    "SAC": ("sac", True),
    "DDPG, no extra action": ("ddpg", False),
    "PPO, no extra action": ("ppo", False),
}
# Options of the preset's DDPG that each algorithm has, too.
SHARED = {
    "ddpg": ("learning_rate", "noise", "mirror"),
    "td3": ("learning_rate", "noise", "mirror"),
    "sac": ("learning_rate", "mirror"),
    "ppo": (),
}
HEADS = (
    ("method", "---"),
    ("validation [mm]", "---:"),
    ("failed drives", "---:"),
    ("steps to 100 mm", "---:"),
    ("clean [mm]", "---:"),
    ("disturbed [mm]", "---:"),
    ("off track", "---:"),
    ("CPU s", "---:"),
    ("steps/s", "---:"),
)
REACHED = 100.0
# Figures from here on are shown without decimals.
COARSE = 1000.0


def config(method: str, seed: int, steps: int) -> TrainConfig:
    """The training of a method."""
    kind, acts = METHODS[method]
    tree = load_preset("demo")
    told = {name: tree["agent"][name] for name in SHARED[kind]}
    demonstration = tree["problem"]["demonstration"] | ({} if acts else {"p_action": NEVER})
    problem = tree["problem"] | {"demonstration": demonstration}
    interval = {"interval": max(steps // 20, 1)}
    return train_config(
        {
            **tree,
            "problem": problem,
            "agent": {"kind": kind, **told},
            "validation": interval,
            "steps": steps,
            "seed": seed,
        }
    )


def jobs(seeds: Sequence[int], steps: int, runs: Path) -> list[TrainingJob]:
    """All trainings, seed by seed."""
    return [
        TrainingJob(
            f"{method}, seed {seed}", config(method, seed, steps), runs / slug(method) / str(seed)
        )
        for seed in seeds
        for method in METHODS
    ]


def slug(method: str) -> str:
    """The method's folder."""
    return method.lower().replace(", ", "_").replace(" ", "_")


def scenarios() -> list[Scenario]:
    """The suite's held-out roads."""
    return [s for s in core_1().scenarios((0,)) if s.path.startswith("road_")]


def curve(folder: Path) -> dict[str, list[float]]:
    """``progress.csv`` by columns."""
    with (folder / "progress.csv").open(encoding="utf-8") as stream:
        rows = list(csv.DictReader(stream))
    names = ("steps", "seconds", "validation_error_mm", "validation_failures", "off_track_resets")
    return {name: [float(row[name]) for row in rows] for name in names}


def rms(rows: Sequence[BenchRow]) -> float:
    """Root mean square over the scenarios' charged errors [mm]."""
    return 1e3 * float(np.sqrt(np.mean([row.charged_rms_m**2 for row in rows])))


def judged(job: TrainingJob, plan: Sequence[Scenario]) -> dict[str, Any]:
    """What came out of one training."""
    driver = entrant(f"agent={job.out / 'policy.onnx'}")
    rows = [measure(scenario, driver) for scenario in plan]
    own = curve(job.out)
    best = json.loads((job.out / "policy.json").read_text(encoding="utf-8"))["training"]
    reached = [
        s for s, e in zip(own["steps"], own["validation_error_mm"], strict=True) if e < REACHED
    ]
    return {
        "seed": job.config.seed,
        "best_validation_mm": 1e3 * best["validation"]["mean_error"],
        "best_failures": best["validation"]["failures"],
        "best_at_steps": best["steps"],
        "steps_to_100_mm": reached[0] if reached else None,
        "clean_rms_mm": rms([r for r in rows if r.disturbance == CLEAN]),
        "disturbed_rms_mm": rms([r for r in rows if r.disturbance != CLEAN]),
        "unfinished_drives": sum(r.driven_share < 1.0 for r in rows),
        "drives": len(rows),
        "off_track_resets": own["off_track_resets"][-1],
        "cpu_seconds": own["seconds"][-1],
        "steps_per_s": own["steps"][-1] / own["seconds"][-1],
        "curve": own,
    }


def spread(values: Sequence[float | None]) -> str:
    """Median [least, most] over seeds."""
    known = [value for value in values if value is not None]
    if len(known) < len(values):
        return f"{len(known)} of {len(values)} seeds"
    digits = 1 if max(known) < COARSE else 0
    low, middle, high = (f"{f(known):,.{digits}f}" for f in (min, np.median, max))
    return f"{middle} [{low}, {high}]"


def line(method: str, runs: Sequence[Mapping[str, Any]]) -> str:
    """The table's row of a method."""
    names = (
        *("best_validation_mm", "best_failures", "steps_to_100_mm", "clean_rms_mm"),
        *("disturbed_rms_mm", "off_track_resets", "cpu_seconds", "steps_per_s"),
    )
    cells = [spread([run[name] for run in runs]) for name in names] if runs else [""] * len(names)
    return "| " + " | ".join([method, *cells]) + " |"


def markdown(found: Mapping[str, Sequence[Mapping[str, Any]]], failed: Mapping[str, str]) -> str:
    """The table, and what went wrong."""
    lines = ["| " + " | ".join(column) + " |" for column in zip(*HEADS, strict=True)]
    lines += [line(method, runs) for method, runs in found.items()]
    lines += ["", *(f"- {name}: {why}" for name, why in failed.items())]
    return "\n".join(lines).strip() + "\n"


def main() -> None:
    """Train, drive, and write both files."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--steps", type=int, default=200_000)
    parser.add_argument("--seeds", type=int, nargs="+", default=[0, 1, 2])
    parser.add_argument("--runs", type=Path, default=Path("runs/algorithms"))
    parser.add_argument("--out", type=Path, default=Path("results/algorithms"))
    given = parser.parse_args()

    def tell(event: TrainingEvent) -> None:
        if event.row is not None:
            error = event.row.validation_error_mm
            sys.stderr.write(f"{event.job.name}: {event.steps:.0f} steps, {error:.4g} mm\n")

    todo = jobs(given.seeds, given.steps, given.runs)
    failed = train_all(todo, 1, tell, resume=True)
    plan = scenarios()
    found: dict[str, list[dict[str, Any]]] = {method: [] for method in METHODS}
    for job in todo:
        if job.name not in failed:
            found[job.name.rpartition(",")[0]].append(judged(job, plan))
    out = make_folder(given.out)
    record = {
        "steps": given.steps,
        "seeds": given.seeds,
        "configs": {method: dump(config(method, 0, given.steps)) for method in METHODS},
        "runs": found,
        "failed": failed,
        **provenance(),
    }
    write_text(out / "results.json", json.dumps(record, indent=1) + "\n")
    text = markdown(found, failed)
    write_text(out / "results.md", text)
    sys.stdout.write(text)


if __name__ == "__main__":
    main()
