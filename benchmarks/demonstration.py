"""Ways to use a demonstrator, alone and together, on the same steps: speed, and the end.

    python benchmarks/demonstration.py

Every method is the same training (``base`` in ``results.json``) but for the options in
``methods``; nothing is tuned. At each quarter of the steps the best validation so far and the
processor time are noted; at the end the best policy, by validation, drives scenarios of the suite
``core`` whose oracle is known: its regret, and the drives that it lost. Trainings go through the
engine, each in a process of its own; a run that was interrupted goes on. ``results.json`` has
everything, ``results.md`` the table: medians over seeds [least, most], and the regret at the end
over that without a demonstrator, as the geometric mean over seeds with a 95 % interval (Student's
t, seeds paired).
"""

from __future__ import annotations

import argparse
import csv
import json
import shutil
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from scipy.stats import t as student

from steersman.bench.drive import measure
from steersman.bench.entrants import entrant
from steersman.bench.oracle import OracleCost, known
from steersman.bench.regret import regret
from steersman.bench.suite import Scenario
from steersman.bench.suites import suite
from steersman.config import dump, merge
from steersman.files import make_folder, write_text
from steersman.learning.config import TrainConfig, load_preset, train_config
from steersman.learning.parallel import TrainingEvent, TrainingJob, train_all
from steersman.provenance import provenance

STAGES = 4
BASELINE = "nothing"
# Behind the predictor it holds delays, and it steers calmly: a teacher that a network can follow.
TEACHER = "predicted/tuned/lqr"
NEVER = {"kind": "constant", "at": 0.0}
# Demonstrations take this share of the steps, where there are any before the training.
FIRST = 0.1


def methods(steps: int) -> dict[str, dict[str, Any]]:
    """What each method changes of the options of the demonstration; and of task and base."""
    first = {"steps": round(FIRST * steps), "share": 0.25}
    cloned = {**first, "cloning": 10_000}
    loss = {"weight": {"kind": "constant", "at": 1.0}}
    fading = {"weight": {"kind": "linear", "start": 5.0, "end": 0.0, "until": 0.5}}
    filtered = {**loss, "q_filter": True}
    often = {"kind": "linear", "start": 0.5, "end": 0.0, "until": 0.3}
    takeover = {"lateral_error": 0.5, "side_slip": 0.15}
    return {
        BASELINE: {"enabled": False},
        "reward": {"task": {"demonstration": "fixed", "normalise": True, "c_diff": 0.1}},
        "extra action": {"p_action": often},
        "takeover": {"takeover": takeover},
        "buffer": {"warm_start": first},
        "buffer, updates": {"warm_start": {**first, "updates": 5000}},
        "cloning": {"warm_start": cloned},
        "cloning, updates": {"warm_start": {**cloned, "updates": 5000}},
        "DAgger": {"warm_start": {**cloned, "rounds": 5}},
        "loss": {"loss": loss},
        "fading loss": {"loss": fading},
        "loss, Q-filter": {"loss": filtered},
        "privileged loss": {"loss": loss, "privileged": True},
        "base": {"enabled": False, "base": {"authority": 0.1}},
        "fading base": {
            "enabled": False,
            "base": {"authority": 1.0},
            "attenuation": {"kind": "linear", "start": 1.0, "end": 0.0, "until": 0.5},
        },
        "extra action, loss": {"p_action": often, "loss": loss},
        "buffer, loss, Q-filter": {"warm_start": first, "loss": filtered},
        "DAgger, fading loss": {"warm_start": {**cloned, "rounds": 5}, "loss": fading},
        "all, privileged": {
            "privileged": True,
            "takeover": takeover,
            "warm_start": {**cloned, "rounds": 5, "updates": 5000},
            "loss": {**fading, "q_filter": True},
        },
    }


def config(method: str, agent: str, seed: int, steps: int) -> TrainConfig:
    """The training of a method: cars, roads, sensors and task of preset ``apg``."""
    tree, change = load_preset("apg"), dict(methods(steps)[method])
    base, task = change.pop("base", None), change.pop("task", {})
    attenuation = change.pop("attenuation", None)
    problem = merge(tree["problem"], {"task": {**tree["problem"]["task"], **task}})
    shown = {"enabled": True, "controller": TEACHER, "p_action": NEVER, **change}
    problem = {**problem, "demonstration": shown}
    if base is not None:
        problem |= {"action": "residual", "base": TEACHER, **base}
    settings = {name: load_preset("demo")["agent"][name] for name in ("learning_rate", "mirror")}
    if agent != "sac":
        settings["noise"] = load_preset("demo")["agent"]["noise"]
    return train_config(
        {
            "problem": problem,
            "agent": {"kind": agent, **settings},
            "validation": {**tree["validation"], "interval": max(steps // 20, 1)},
            "attenuation": attenuation,
            "checkpoint_interval": steps,
            "steps": steps,
            "seed": seed,
        }
    )


def slug(method: str) -> str:
    """The method's folder."""
    return method.lower().replace(", ", "_").replace(" ", "_")


def scenarios(every: int) -> list[Scenario]:
    """Scenarios with an oracle, one of so many."""
    plan = suite("core").scenarios((0,))
    costs = known(plan)
    return [each for each in plan if each.name in costs][::every]


def train_to(jobs: Sequence[TrainingJob], at: int, last: bool, workers: int) -> dict[str, str]:
    """Train all to a stage, and put the best policies so far aside; the reasons of failures."""

    def tell(event: TrainingEvent) -> None:
        if event.row is not None:
            error = event.row.validation_error_mm
            sys.stderr.write(f"{event.job.name}: {event.steps:.0f} steps, {error:.4g} mm\n")

    todo = [job for job in jobs if not (stage(job, at) / "policy.json").exists()]
    failed = train_all(todo, workers, tell, resume=True, until=None if last else at)
    for job in todo:
        if job.name not in failed:
            folder = make_folder(stage(job, at))
            for name in ("policy.onnx", "progress.csv", "policy.json"):
                shutil.copy(job.out / name, folder / name)
    return failed


def stage(job: TrainingJob, at: int) -> Path:
    """Where what a training had after so many steps is kept."""
    return job.out / f"at_{at:09d}"


def driven_by(words: str, plan: Sequence[Scenario], oracle: Mapping[str, OracleCost]) -> Any:
    """Regret and lost drives of a controller."""
    rows = [measure(scenario, entrant(words)) for scenario in plan]
    beyond = regret(rows, oracle)
    assert beyond is not None
    mean, median = beyond.mean_m.value, beyond.median_m.value
    assert mean is not None
    assert median is not None
    lost = sum(not row.completed for row in rows)
    return {"regret_mm": 1e3 * mean, "median_regret_mm": 1e3 * median, "lost": lost}


def learned(folder: Path) -> Any:
    """What the training's own record says of a stage: its best policy's validation, and costs."""
    card = json.loads((folder / "policy.json").read_text(encoding="utf-8"))
    with (folder / "progress.csv").open(encoding="utf-8") as stream:
        rows = list(csv.DictReader(stream))
    return {
        "best_at_steps": card["training"]["steps"],
        "base_share": card["base_share"] if card["base"] else None,
        "cpu_seconds": float(rows[-1]["seconds"]),
        "off_track": float(rows[-1]["off_track_resets"]),
        "validation_mm": min(float(row["validation_error_mm"]) for row in rows),
    }


def judged(folder: Path, plan: Sequence[Scenario], oracle: Mapping[str, OracleCost]) -> Any:
    """Regret and lost drives of the policy in a folder; kept there."""
    kept = folder / f"judged_{len(plan)}.json"
    if kept.exists():
        return json.loads(kept.read_text(encoding="utf-8"))
    driven = driven_by(f"agent={folder / 'policy.onnx'}", plan, oracle)
    write_text(kept, json.dumps(driven) + "\n")
    return driven


def spread(values: Sequence[float], digits: int = 0) -> str:
    """Median [least, most] over seeds."""
    low, middle, high = (f"{f(values):,.{digits}f}" for f in (min, np.median, max))
    return f"{middle} [{low}, {high}]"


def ratio(own: Sequence[float], base: Sequence[float]) -> str:
    """Geometric mean of own / base over paired seeds, with its 95 % interval from two seeds on."""
    logs = np.log(np.array(own) / np.array(base))
    middle = float(np.exp(logs.mean()))
    if len(logs) == 1:
        return f"{middle:.2f}"
    half = student.ppf(0.975, len(logs) - 1) * logs.std(ddof=1) / len(logs) ** 0.5
    low, high = np.exp(logs.mean() - half), np.exp(logs.mean() + half)
    return f"{middle:.2f} [{low:.2f}, {high:.2f}]"


def markdown(found: Mapping[str, Mapping[int, Mapping[int, Any]]], at: Sequence[int]) -> str:
    """The table: regrets at the stages, then what there is at the end, without failed seeds."""
    heads = ["method", *(f"validation at {step:,} [mm]" for step in at)]
    heads += [
        "regret, mean [mm]",
        "median [mm]",
        f"over {BASELINE}",
        "lost",
        "off track",
        "CPU s",
        "seeds",
    ]
    lines = ["| " + " | ".join(heads) + " |", "|" + " --- |" + " ---: |" * (len(heads) - 1)]
    for method, seeds in found.items():
        if not seeds:
            continue
        ends = [each[at[-1]] for each in seeds.values()]
        base = found.get(BASELINE, {})
        pairs = [s for s in seeds if s in base]
        errors = [[each[step]["validation_mm"] for each in seeds.values()] for step in at]
        regrets = [end["regret_mm"] for end in ends]
        own, other = ([each[s][at[-1]]["regret_mm"] for s in pairs] for each in (seeds, base))
        typical = [end["median_regret_mm"] for end in ends]
        cells = [method, *map(spread, errors), spread(regrets), spread(typical)]
        cells += [ratio(own, other) if pairs else ""]
        cells += [spread([end[name] for end in ends]) for name in ("lost", "off_track")]
        cells += [spread([end["cpu_seconds"] for end in ends]), str(len(seeds))]
        lines.append("| " + " | ".join(cells) + " |")
    return "\n".join(lines) + "\n"


def main() -> None:
    """Train, drive, and write the results."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--steps", type=int, default=300_000)
    parser.add_argument("--seeds", type=int, nargs="+", default=[0, 1, 2, 3, 4])
    parser.add_argument("--agent", choices=["ddpg", "td3", "sac"], default="ddpg")
    parser.add_argument("--methods", nargs="+", choices=list(methods(1)), default=list(methods(1)))
    parser.add_argument("--every", type=int, default=4, help="one scenario of so many")
    parser.add_argument("--jobs", type=int, default=1, help="trainings at a time")
    parser.add_argument("--runs", type=Path, default=Path("runs/demonstration"))
    parser.add_argument("--out", type=Path, default=Path("results/demonstration"))
    given = parser.parse_args()
    jobs = {
        (method, seed): TrainingJob(
            f"{method}, seed {seed}",
            config(method, given.agent, seed, given.steps),
            given.runs / given.agent / slug(method) / str(seed),
        )
        for seed in given.seeds
        for method in given.methods
    }
    at = [given.steps * k // STAGES for k in range(1, STAGES + 1)]
    failed: dict[str, str] = {}
    for step in at:
        todo = [job for job in jobs.values() if job.name not in failed]
        failed |= train_to(todo, step, step == at[-1], given.jobs)
    plan = scenarios(given.every)
    oracle = known(plan)
    teacher = driven_by(TEACHER, plan, oracle)
    found: dict[str, dict[int, dict[int, Any]]] = {method: {} for method in given.methods}
    for (method, seed), job in jobs.items():
        if job.name not in failed:
            stages = {step: learned(stage(job, step)) for step in at}
            stages[at[-1]] = judged(stage(job, at[-1]), plan, oracle) | stages[at[-1]]
            found[method][seed] = stages
    out = make_folder(given.out)
    record = {
        "agent": given.agent,
        "steps": given.steps,
        "seeds": given.seeds,
        "scenarios": [scenario.name for scenario in plan],
        "teacher": teacher,
        "methods": {name: methods(given.steps)[name] for name in given.methods},
        "base": dump(config(BASELINE, given.agent, given.seeds[0], given.steps)),
        "found": found,
        "failed": failed,
        **provenance(),
    }
    write_text(out / "results.json", json.dumps(record, indent=1) + "\n")
    text = markdown(found, at)
    text += f"\nThe teacher alone ({TEACHER}): regret {teacher['regret_mm']:.0f} mm, median "
    text += f"{teacher['median_regret_mm']:.0f} mm, "
    text += f"{teacher['lost']} of {len(plan)} drives lost.\n"
    text += "".join(f"\n- {name}: {why}" for name, why in failed.items())
    write_text(out / "results.md", text)
    sys.stdout.write(text)


if __name__ == "__main__":
    main()
