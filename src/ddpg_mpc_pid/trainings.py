"""All trainings of the plan, two at a time, each in a process of its own; what became of them."""

from __future__ import annotations

import csv
from collections.abc import Callable, Sequence
from pathlib import Path as FilePath

import steersman as sm
from ddpg_mpc_pid.plan import Plan
from ddpg_mpc_pid.results import StudyTraining

AT_ONCE = 2
# Every message about a training that diverged ends with this advice: that is a result, not a
# fault of the study.
DIVERGED = "agent.learning_rate"
# Called with: trainings done, trainings in all, share of all steps done, what happened.
Progress = Callable[[int, int, float, str], None]
KEPT = (
    "steps",
    "seconds",
    "validation_error_mm",
    "validation_failures",
    "off_track_resets",
    "steer_activity",
    "actor_loss",
    "critic_loss",
    "c_track",
    "c_diff",
    "demo_share",
)


def jobs(plan: Plan, runs: FilePath) -> list[sm.TrainingJob]:
    """A job for each training."""
    return [sm.TrainingJob(t.name, t.config, runs / t.name) for t in plan.trainings()]


def run_trainings(
    plan: Plan,
    runs: FilePath,
    progress: Progress,
    engine: str | None = None,
    at_once: int | None = None,
) -> dict[str, StudyTraining]:
    """Train what is not trained yet, ``at_once`` at a time; the record of each training by name.

    Raises:
        SteersmanError: a training failed for another reason than that it diverged.
    """
    every = jobs(plan, runs)
    steps = dict.fromkeys((job.name for job in every), 0.0)
    total = sum(float(job.config.steps) for job in every)

    def report(event: sm.TrainingEvent) -> None:
        if event.steps is not None:
            steps[event.job.name] = event.steps
        done = sum(steps[job.name] >= job.config.steps for job in every)
        if event.row is not None:
            error = event.row.validation_error_mm
            text = f"{event.job.name}: {event.steps:.0f} steps, error {error:.3g} mm"
            progress(done, len(every), sum(steps.values()) / total, text)

    failed = sm.train_all(every, at_once or AT_ONCE, report, engine=engine, resume=True)
    faults = {name: text for name, text in failed.items() if DIVERGED not in text}
    if faults:
        name, text = next(iter(faults.items()))
        raise sm.SteersmanError(f"training {name}: {text}; the same command goes on")
    return {job.name: _record(job.out, failed.get(job.name)) for job in every}


def _record(out: FilePath, diverged: str | None) -> StudyTraining:
    file = out / "progress.csv"
    rows: list[dict[str, str]] = []
    if file.exists():
        with file.open(encoding="utf-8", newline="") as stream:
            rows = list(csv.DictReader(stream))
    return StudyTraining(
        diverged=diverged,
        policy=(out / "policy.onnx").exists(),
        curve={name: [float(row[name]) for row in rows] for name in KEPT},
    )


def policies(plan: Plan, runs: FilePath, methods: Sequence[str]) -> dict[str, dict[int, FilePath]]:
    """The exported policies of some methods, by seed; what was never exported is left out.

    A method that the plan does not train has none.
    """
    out: dict[str, dict[int, FilePath]] = {name: {} for name in methods}
    for training in plan.trainings():
        file = runs / training.name / "policy.onnx"
        if training.method in out and file.exists():
            out[training.method][training.seed] = file
    return out
