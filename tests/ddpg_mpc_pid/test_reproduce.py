"""The reproduction: its plan, its stages, and a smoke run from end to end."""

from __future__ import annotations

import inspect
import json
import math
import pickle
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path as FilePath
from typing import Any

import numpy as np
import pytest
from typer.testing import CliRunner

import ddpg_mpc_pid as study
import steersman as sm
from ddpg_mpc_pid import drives, section_driving, section_learning, timing, trainings
from ddpg_mpc_pid.learning_curves import learning_curves
from ddpg_mpc_pid.plan import DEPARTURES, METHODS, THRESHOLDS, Plan
from ddpg_mpc_pid.results import (
    CircleResult,
    CostSaving,
    LearningCurves,
    SeedInterval,
    StudyDrive,
    StudyResult,
    StudyTraining,
)
from ddpg_mpc_pid.section_length import effects, length_section
from ddpg_mpc_pid.study import Stage, done, open_journal, plain, stages
from ddpg_mpc_pid.tracks import per_corner
from steersman.cli import app
from steersman.config import dump
from steersman.engine.work import Outcome, packed, perform
from steersman.errors import ConfigError, DataError, SteersmanError
from steersman.learning import progress
from steersman.learning.progress import TrainRow
from steersman.learning.train import train
from steersman.world import Simulation


def silent(*_: Any) -> None:
    pass


# ------------------------------------------------------------------------------------ plan


def test_the_preset_is_the_published_method() -> None:
    config = sm.configure("train", "paper")
    problem, agent = config.problem, config.agent
    assert (problem.action, problem.rate_limit, problem.corridor) == ("rate", 1.5708, 1.5)
    assert problem.task.kind == "paper"
    assert problem.encoding.kind == "waypoints"
    assert (agent.hidden, agent.gamma, agent.tau) == ((400, 300), 0.99, 0.005)
    assert (agent.batch, agent.buffer, agent.learning_starts) == (256, 1_000_000, 100)
    assert (config.steps, agent.vehicles, agent.updates) == (200_000, 1, 1)
    assert agent.learning_rate.kind == "cyclical"
    assert agent.learning_rate.value(0.75 * 2e5, 2e5) < agent.learning_rate.value(0.0, 2e5)


def test_the_full_plan_has_every_method_with_its_seeds() -> None:
    plan = study.full()
    names = [t.name for t in plan.trainings()]
    assert len(names) == len(set(names)) == 6 * 5 + 6 * 3
    assert {t.config.seed for t in plan.trainings()} == set(range(5))
    first = plan.trainings()[: len(plan.methods)]
    assert tuple(t.method for t in first) == plan.methods
    for t in plan.trainings():
        updates = t.config.steps * t.config.agent.updates / t.config.agent.vehicles
        assert updates <= 40_000
    assert 60.0 < study.estimate(plan).minutes < 180.0


def test_methods_differ_in_what_their_names_say() -> None:
    configs = {t.method: t.config.problem for t in study.full().trainings()}
    tasks = {name: problem.task.demonstration for name, problem in configs.items()}
    assert tasks["ddpg"] == tasks["action"] == "none"
    assert tasks["reward"] == tasks["both"] == "fixed"
    assert tasks["adaptive"] == tasks["direct"] == tasks["precise"] == "adaptive"
    shares = {n: p.demonstration.p_action.value(0.0, 1.0) for n, p in configs.items()}
    assert shares["reward"] == 0.0
    assert {shares[n] for n in ("action", "both", "adaptive", "direct")} == {0.2}
    assert not configs["ddpg"].demonstration.enabled
    assert configs["direct"].action == "direct"
    rates = {t.method: t.config.agent.learning_rate.kind for t in study.full().trainings()}
    assert {name for name, kind in rates.items() if kind != "cyclical"} == {"constant_rate"}
    for name, problem in configs.items():
        assert problem.demonstration.controller.scheduled == (name == "scheduled")


def test_methods_of_the_same_reward_have_the_same_task() -> None:
    tasks: dict[str, set[str]] = {}
    for t in (*study.full().trainings(), *study.published().trainings()):
        tasks.setdefault(METHODS[t.method].reward, set()).add(
            json.dumps([dump(t.config.problem.task), t.config.problem.action])
        )
    assert {len(found) for found in tasks.values()} == {1}


def test_the_plan_as_published_changes_nothing_but_the_method() -> None:
    plan = study.published()
    assert set(METHODS) == {*plan.methods, *study.full().methods}
    preset = sm.configure("train", "paper")
    short = {"adaptive_short", "precise_short"}
    for t in plan.trainings():
        assert t.config.agent == preset.agent
        assert t.config.validation == preset.validation
        assert t.config.steps == (40_000 if t.method in short else 200_000)
    assert len(plan.trainings()) == 5 * len(plan.methods) == 70
    tasks = {t.method: t.config.problem for t in plan.trainings()}
    demonstrated = ("ddpg", "reward", "action", "both")
    for name in demonstrated:
        twin = tasks[f"{name}_direct"]
        assert (tasks[name].action, twin.action) == ("rate", "direct")
        assert twin.task == tasks[name].task
        assert twin.demonstration == tasks[name].demonstration
    assert tasks["change"].task.c_change > 0.0
    assert tasks["change"].action == "direct"


def test_a_part_of_a_plan() -> None:
    part = study.only(study.published(), ("ddpg", "direct"), 2)
    names = [t.name for t in part.trainings()]
    assert names == ["ddpg/seed_0", "direct/seed_0", "ddpg/seed_1", "direct/seed_1"]
    assert study.only(study.full(), None, None) == study.full()
    with pytest.raises(ConfigError, match="did you mean 'direct'"):
        study.only(study.published(), ("dirct",), None)


def test_every_departure_has_its_reason() -> None:
    assert all("=" in setting and why for setting, why in DEPARTURES)


def test_plans_differ_by_their_digest() -> None:
    plan = study.quick()
    assert plan.digest() == study.quick().digest()
    assert plan.digest() != study.full().digest()
    assert plan.digest() != plan._replace(words=(*plan.words, "agent.gamma=0.9")).digest()


# ---------------------------------------------------------------------------------- stages


def one(work: Callable[[], Any]) -> dict[str, Stage]:
    return {"one": Stage(work, 1.0)}


def test_a_finished_stage_is_not_done_again(tmp_path: FilePath) -> None:
    calls: list[int] = []

    def work() -> dict[str, Any]:
        calls.append(1)
        return {"x": np.float64(1.23456789), "y": math.inf, "z": [True, None, "a", 3]}

    for said in (["one"], ["one: finished already"]):
        heard: list[str] = []
        (record,) = done(one(work), open_journal(tmp_path, study.quick()), heard.append)
        assert record.result == {"x": 1.23457, "y": None, "z": [True, None, "a", 3]}
        assert heard == said
    assert calls == [1]


def test_a_stage_that_fails_leaves_nothing(tmp_path: FilePath) -> None:
    journal = open_journal(tmp_path, study.quick())
    with pytest.raises(ZeroDivisionError):
        done(one(lambda: 1 / 0), journal, silent)
    assert not open_journal(tmp_path, study.quick()).results


def test_results_of_two_plans_or_versions_are_not_mixed(
    tmp_path: FilePath, monkeypatch: pytest.MonkeyPatch
) -> None:
    plan = study.quick()
    open_journal(tmp_path, plan)
    open_journal(tmp_path, plan)
    with pytest.raises(DataError, match="another plan"):
        open_journal(tmp_path, study.full())
    origin = {"commit": "other", "versions": {}}
    monkeypatch.setattr(sm, "provenance", lambda: origin)
    with pytest.raises(DataError, match=r"begun with commit .*--other-version"):
        open_journal(tmp_path, plan)
    (record,) = done(one(dict), open_journal(tmp_path, plan, other_version=True), silent)
    assert record.commit == "other"


def test_a_damaged_stage_says_so(tmp_path: FilePath) -> None:
    done(one(dict), open_journal(tmp_path, study.quick()), silent)
    (tmp_path / "stages.jsonl").write_text("{\n", encoding="utf-8")
    with pytest.raises(DataError, match="delete the file"):
        open_journal(tmp_path, study.quick())


class Elsewhere(sm.Workers):
    """Every job in a piece of its own, as processes get it: pickled and back."""

    def outcomes(
        self, work: Any, jobs: Any, *, listener: Any = None, **_: Any
    ) -> Iterator[list[Outcome]]:
        for job in jobs:
            yield pickle.loads(pickle.dumps(perform(packed(work, [job]).data, listener)))


def test_stages_find_the_same_in_other_processes(tmp_path: FilePath) -> None:
    plan = study.quick()
    todo = {name: s for name, s in stages(plan, tmp_path / "runs").items() if name != "monza"}
    some = dict(list(todo.items())[::5])
    found = [
        done(some, open_journal(tmp_path / name, plan), silent, workers)
        for name, workers in (("here", None), ("elsewhere", Elsewhere()))
    ]
    assert [r.result for r in found[0]] == [r.result for r in found[1]]
    assert {r.stage for r in found[0]} == set(some)


def test_plain_data_stays() -> None:
    assert plain({"a": (1, 2.0)}) == {"a": [1, 2.0]}


# ------------------------------------------------------------------------------- trainings


def fake(monkeypatch: pytest.MonkeyPatch, failed: dict[str, str]) -> list[list[sm.TrainingJob]]:
    asked: list[list[sm.TrainingJob]] = []

    def train_all(jobs: list[sm.TrainingJob], *_: Any, **__: Any) -> dict[str, str]:
        asked.append(list(jobs))
        return failed

    monkeypatch.setattr(sm, "train_all", train_all)
    return asked


def test_a_diverged_training_is_a_result(
    tmp_path: FilePath, monkeypatch: pytest.MonkeyPatch
) -> None:
    fake(monkeypatch, {"ddpg/seed_0": "mean Q is 1e9; try a smaller agent.learning_rate"})
    plan = study.quick()
    out = trainings.run_trainings(plan, tmp_path / "runs", silent)
    assert "mean Q" in (out["ddpg/seed_0"].diverged or "")
    nothing = {name: [] for name in trainings.KEPT}
    assert out["both/seed_0"] == StudyTraining(diverged=None, policy=False, curve=nothing)


def test_any_other_failure_stops_the_study(
    tmp_path: FilePath, monkeypatch: pytest.MonkeyPatch
) -> None:
    fake(monkeypatch, {"ddpg/seed_0": "killed by SIGKILL"})
    plan = study.quick()
    with pytest.raises(SteersmanError, match=r"ddpg/seed_0: killed by SIGKILL; the same command"):
        trainings.run_trainings(plan, tmp_path / "runs", silent)


def test_every_alarm_is_told_from_a_fault() -> None:
    source = inspect.getsource(progress.check_progress)
    # A reward that is no number is a fault of its terms.
    assert source.count("raise TrainingDiverged") == 1 + source.count("agent.learning_rate") == 4
    assert trainings.DIVERGED == "agent.learning_rate"


# ---------------------------------------------------------------------------------- curves


def record(errors: list[float]) -> StudyTraining:
    count = len(errors)
    columns = {name: [0.5] * count for name in trainings.KEPT}
    columns["steps"] = [100.0 * (k + 1) for k in range(count)]
    columns["seconds"] = [2.0 * (k + 1) for k in range(count)]
    columns["off_track_resets"] = [float(k) for k in range(count)]
    columns["validation_error_mm"] = errors
    return StudyTraining(diverged=None, policy=True, curve=columns)


def small() -> Plan:
    return study.quick()._replace(methods=("ddpg", "both"), seeds=2, repetitions=100)


def test_a_part_without_the_full_method_drives_without_its_agents(tmp_path: FilePath) -> None:
    plan = study.quick()._replace(
        methods=("ddpg",), monza_seconds=1.0, away_seconds=1.0, circle_seconds=1.0, seeds=1
    )
    assert trainings.policies(plan, tmp_path, ["adaptive", "ddpg"]) == {"adaptive": {}, "ddpg": {}}
    for name, stage in stages(plan, tmp_path).items():
        if name.startswith(("monza", "away, circle", "waypoint errors to")):
            assert stage.work() is not None


def test_savings_count_runs_that_never_arrive() -> None:
    trained = {
        "ddpg/seed_0": record([900.0, 400.0, 90.0, 90.0]),
        "ddpg/seed_1": record([900.0, 900.0, 900.0, 900.0]),
        "both/seed_0": record([90.0, 90.0, 40.0, 5.0]),
        "both/seed_1": record([90.0, 80.0]),
    }
    out = learning_curves(small(), trained)
    rows = {(r.threshold_m, r.method): r for r in out.savings}
    assert len(rows) == len(THRESHOLDS)
    row = rows[0.1, "both"]
    assert (row.alone_reached, row.reached, row.seeds) == (1, 2, [2, 2])
    # Alone: 300 steps and never (charged 400); with the demonstration: 100 and 100.
    saved = row.steps.saving
    assert saved is not None
    assert saved.value == pytest.approx(1.0 - 100.0 / 350.0)
    assert (saved.low or 0.0) <= saved.value
    assert row.steps.alone_median is None  # that of a seed that never gets there
    assert rows[0.01, "both"].reached == 1
    method = out.methods["both"]
    assert method.best_mm == [5.0, 80.0]
    assert method.curves["validation_error_mm"].median[0] == 90.0
    assert method.curves["validation_error_mm"].n == (2.0, 2.0, 1.0, 1.0)


def test_spread_is_the_interquartile_range_over_seeds() -> None:
    trained = {f"ddpg/seed_{k}": record([100.0 * k + 50.0]) for k in range(5)}
    trained |= {f"both/seed_{k}": record([10.0]) for k in range(5)}
    (row,) = learning_curves(small()._replace(seeds=5), trained).spread
    assert (row.alone_mm, row.range_mm, row.median_mm) == (200.0, 0.0, 10.0)
    found = row.smaller_by
    assert found.value == 200.0
    assert (found.low or 0.0) <= 200.0 <= (found.high or 0.0)


def test_nobody_reaches_it_nobody_saves() -> None:
    trained = {f"{m}/seed_{s}": record([900.0]) for m in ("ddpg", "both") for s in (0, 1)}
    out = learning_curves(small(), trained)
    assert all(row.steps.saving is None for row in out.savings)


def test_direct_methods_stand_beside_ddpg_with_the_same_action() -> None:
    names = ("ddpg", "both", "ddpg_direct", "both_direct", "direct")
    trained = {f"{m}/seed_{s}": record([900.0, 90.0]) for m in names for s in (0, 1)}
    plan = small()
    out = learning_curves(plan._replace(methods=names), trained)
    beside = {"both": "ddpg", "both_direct": "ddpg_direct", "direct": "ddpg_direct"}
    assert {row.method: row.alone for row in out.savings} == beside
    assert {row.method: row.alone for row in out.spread} == beside
    part = learning_curves(plan._replace(methods=("ddpg", "direct")), trained)
    assert {row.method: row.alone for row in part.savings} == {"direct": "ddpg"}


def test_rewards_and_lengths_are_told_apart() -> None:
    errors = {"adaptive_short": 80.0, "adaptive": 40.0, "precise_short": 8.0, "precise": 2.0}
    factors = [1.0 / 10, 1.0 / 20, 0.5, 0.25, 0.5]
    cells = [[e, 1.1 * e, e / 1.1] for e in errors.values()]
    found = effects(cells)
    assert [one.value for one in found.values()] == pytest.approx(factors)
    for one in list(found.values())[:4]:
        assert (one.low or 0.0) <= (one.value or 0.0) <= (one.high or 0.0) < 1.0
    trained = {f"{m}/seed_{s}": record([900.0, e]) for m, e in errors.items() for s in (0, 1)}
    plan = small()._replace(methods=tuple(errors), seeds=2, ablation_seeds=2)
    section = length_section(learning_curves(plan, trained).methods)
    assert section is not None
    assert len(section.findings) == len(factors)
    assert length_section(learning_curves(small(), trained | alone()).methods) is None


def alone() -> dict[str, StudyTraining]:
    return {f"{m}/seed_{s}": record([900.0]) for m in ("ddpg", "both") for s in (0, 1)}


# ---------------------------------------------------------------------------------- drives


def test_the_least_heading_error_is_the_side_slip_of_a_perfect_drive() -> None:
    for speed in (9.9, 18.7):
        bound = drives.steady_heading_error(speed)
        row = drives.kept(
            drives.drive(
                drives.SCHEDULED,
                path=drives.CIRCLE,
                speed={"kind": "constant_speed", "speed": speed},
                duration=10.0,
            )
        )
        assert row.steady_aoe_deg == pytest.approx(bound, abs=0.1)
        assert (row.course_deg or 0.0) < 0.2
    assert drives.steady_heading_error(40.0) is None


def test_the_worst_seed_is_the_one_that_left_the_road() -> None:
    good, worse = (StudyDrive(ale_mm=error, completed=True) for error in (5.0, 9.0))
    bad = StudyDrive(ale_mm=1.0, end="off_track")
    out = drives.over_seeds([good, worse, bad])
    assert (out.completed, out.worst, out.median.ale_mm) == (2, bad, 5.0)
    assert drives.median_seed({0: bad, 1: good, 2: worse}) == 2
    assert drives.over_seeds([]).seeds == 0


def test_errors_of_corners_are_those_between_their_ends() -> None:
    path: Any = sm.make("path", "monza")
    episode = sm.drive(path=path, duration=3.0)
    rows = per_corner(episode, path)
    assert [row.corner for row in rows] == [c.name for c in path.corners()]
    assert rows[-1].mean_mm is None


def test_recorded_states_are_observed_as_they_were(tmp_path: FilePath) -> None:
    config = sm.configure("drive", path="monza", duration=2.0)
    episode = sm.drive(config)
    seen = sm.observations(episode, config.path, config.sensor, 1000)
    assert len(seen) == len(episode)
    assert [o.v_x for o in seen] == episode["v_x"].tolist()
    assert [o.lateral_error for o in seen] == pytest.approx(episode["lateral_error"].tolist())


def test_without_casadi_the_usual_mpc_is_left_out(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(timing, "find_spec", lambda _: None)
    row = timing.usual_mpc(10, [], sm.RunConfig(), 100)
    assert "not measured" in row.note


def test_the_usual_mpc_plans_what_mpc_pid_plans() -> None:
    pytest.importorskip("casadi")
    config = sm.configure("drive", path="circle", duration=2.0)
    seen = sm.observations(sm.drive(config), config.path, config.sensor, 20)
    row = timing.usual_mpc(10, seen, config, 20)
    assert row.steps == 20
    assert row.failed is None


# --------------------------------------------------------------------------------- at once


def train_here(
    trainings: Sequence[sm.TrainingJob],
    at_once: int | None,
    listener: Callable[[sm.TrainingEvent], None],
    *,
    engine: str | None = None,
    resume: bool = False,
) -> dict[str, str]:
    """``sm.train_all`` one after the other in this process, which has loaded PyTorch once."""
    for job in trainings:

        def tell(row: TrainRow, job: sm.TrainingJob = job) -> None:
            listener(sm.TrainingEvent(job, steps=row.steps, row=row))

        train(job.config, job.out, tell, resume=resume)
    return {}


@pytest.fixture(scope="module")
def smoke(tmp_path_factory: pytest.TempPathFactory) -> tuple[FilePath, StudyResult]:
    root = tmp_path_factory.mktemp("reproduce")
    with pytest.MonkeyPatch.context() as patched:
        patched.setattr(sm, "train_all", train_here)
        found = study.reproduce(study.quick(), root, silent, silent, other_version=True, at_once=1)
    return root, found


def forget(root: FilePath, stage: str) -> None:
    """Cut a stage out of the journal, as if it had never been done."""
    file = root / "stages.jsonl"
    lines = file.read_text(encoding="utf-8").splitlines(keepends=True)
    left = [line for line in lines if json.loads(line)["stage"] != stage]
    assert len(left) == len(lines) - 1
    file.write_text("".join(left), encoding="utf-8")


def test_the_smoke_run_measures_everything(smoke: tuple[FilePath, StudyResult]) -> None:
    root, results = smoke
    kept = json.loads((root / "results.json").read_text())
    assert kept == results.plain()
    assert kept.keys() > {"circle", "robustness", "monza", "away", "timing"}
    assert len(kept["circle"]["tests"]) == 8
    assert kept["learning"]["methods"]["ddpg"]["seeds"] == 1
    coefficients = kept["learning"]["methods"]["adaptive"]["curves"]
    total = np.add(coefficients["c_track"]["median"], coefficients["c_diff"]["median"])
    assert total == pytest.approx(1.0, abs=1e-4)
    names = [row["name"] for row in kept["timing"]["rows"]]
    assert {"policy, ONNX Runtime", "policy, compiled"} < set(names)
    assert (root / "results.json").stat().st_size < 200_000


def test_a_second_call_does_nothing_again(
    smoke: tuple[FilePath, StudyResult], monkeypatch: pytest.MonkeyPatch
) -> None:
    root, results = smoke
    forget(root, "monza")
    asked = fake(monkeypatch, {})
    said: list[str] = []
    again = study.reproduce(study.quick(), root, silent, said.append, other_version=True, at_once=1)
    assert asked == []
    assert said.count("monza") == 1
    assert "circle, throttle 0.4: finished already" in said
    assert again.learning == results.learning


def test_the_compiled_network_is_the_exported_one(
    smoke: tuple[FilePath, StudyResult],
) -> None:
    from steersman.network_file import PolicyNetwork

    file = smoke[0] / "runs" / "adaptive" / "seed_0" / "policy.onnx"
    data = file.read_bytes()
    count = len(json.loads(file.with_suffix(".json").read_text())["scale"])
    one, other = PolicyNetwork(data, "policy", count), timing.compiled(timing.read_weights(data))
    for x in np.random.default_rng(0).normal(size=(20, 1, count)).astype(np.float32):
        assert other(x) == pytest.approx(one(x), abs=1e-5)


# ---------------------------------------------------------------------------------- report


def test_sections_are_made_of_the_numbers(smoke: tuple[FilePath, StudyResult]) -> None:
    made = study.sections(StudyResult.read(smoke[0] / "results.json"))
    assert len(made) == 9
    assert made == study.sections(smoke[1])
    text = json.dumps(made, default=vars)
    assert "NaN" not in text
    assert "None" not in text
    files = [figure.file for section in made for figure in section.figures]
    assert len(files) == len(set(files))
    study.write_page(smoke[1], smoke[0] / "report.html")
    titles = [table.title for section in made for table in section.tables if table.rows]
    tables = list((smoke[0] / "tables").glob("*.md"))
    assert len(tables) == len(set(titles)) == len(titles)
    methods = (smoke[0] / "tables" / "methods.md").read_text(encoding="utf-8").splitlines()
    assert methods[0].startswith("| method | seeds |")
    assert len(methods) == 2 + len(smoke[1].learning.methods)


def test_a_smoke_run_says_so_and_concludes_nothing() -> None:
    file = FilePath(__file__).parents[2] / "results" / "paper" / "results.json"
    full = StudyResult.read(file)
    plan = {**full.plan, "words": ["steps=600"]}
    made = study.sections(full.model_copy(update={"plan": plan}))
    assert "mean nothing" in made[0].warnings[0]
    assert not any(section.findings for section in made)
    shown = {row["setting"]: row["why"] for row in made[0].tables[0].rows}
    assert shown["steps=600"] == "smoke run"
    assert sum(word.startswith("steps=") for word in shown) == 1


def saving(low: float, high: float) -> SeedInterval:
    return SeedInterval(value=0.5 * (low + high), low=low, high=high)


@pytest.mark.parametrize(
    ("found", "known", "words"),
    [
        (saving(0.1, 0.6), True, "accelerates"),
        (saving(-0.6, -0.1), False, "slows"),
        (saving(-0.1, 0.6), None, "holds zero"),
        (None, None, "no seed"),
    ],
)
def test_a_saving_is_claimed_only_apart_from_zero(
    smoke: tuple[FilePath, StudyResult],
    found: SeedInterval | None,
    known: bool | None,
    words: str,
) -> None:
    cost = CostSaving(alone_median=1.0, median=1.0, horizon=1.0, saving=found)
    learning = smoke[1].learning
    row = next(s for s in learning.savings if s.threshold_m == 0.1 and s.method == "both")
    row = row.model_copy(update={"steps": cost, "seconds": cost, "off_track_resets": cost})
    (out,) = section_learning._saving_findings(
        LearningCurves(**{**dict(learning), "savings": [row]})
    )
    assert out.agrees is known
    assert words in out.text


def test_the_circle_is_judged_by_the_numbers() -> None:
    median = {"ale_mm": 2.0, "aoe_deg": 0.95, "steer_std": 0.01, "steady_speed": 9.9}
    median |= {"steady_aoe_deg": 0.94, "course_deg": 0.01, "steady_steer_std": 0.001}
    worst = {"ale_mm": 3.0, "completed": True, "end": "duration", "distance": 600.0}
    agent = {"seeds": 2, "completed": 2, "median": median, "worst": worst, "least_aoe_deg": 0.93}
    paper = {"ale_mm": 2.83, "aoe_deg": 0.922, "steer_std": 0.11}
    label = METHODS["adaptive"].label

    def section(agent: dict[str, Any]) -> Any:
        test = {"test": "9.9 m/s", "paper": paper, "drivers": {label: agent}}
        return section_driving.circle_section(CircleResult.model_validate({"tests": [test]}))

    assert [f.agrees for f in section(agent).findings] == [True, True]
    lost = agent | {"completed": 0, "worst": worst | {"completed": False, "end": "off_track"}}
    bad = section(lost)
    assert [f.agrees for f in bad.findings] == [False]
    assert "off track after 600 m" in bad.findings[0].text


def test_the_command_joins_study_and_report(
    smoke: tuple[FilePath, StudyResult], monkeypatch: pytest.MonkeyPatch
) -> None:
    root, results = smoke
    monkeypatch.setattr(study, "reproduce", lambda *_, **__: results)
    done = CliRunner().invoke(app, ["reproduce", "--quick", "--out", str(root)])
    assert done.exit_code == 0, done.output
    assert (root / "report.html").stat().st_size < 1_000_000
    assert list((root / "plots").glob("*.svg"))


def test_ctrl_c_in_a_drive_ends_the_command_and_leaves_the_stage_to_do(
    smoke: tuple[FilePath, StudyResult], monkeypatch: pytest.MonkeyPatch
) -> None:
    root, _ = smoke
    kept = [root / "stages.jsonl", root / "results.json"]
    before = [file.read_bytes() for file in kept]
    forget(root, "monza")
    (root / "results.json").unlink()
    original, calls = Simulation.step, iter(range(1000))

    def step(self: Any, command: Any) -> Any:
        if next(calls) == 10:
            raise KeyboardInterrupt
        return original(self, command)

    with monkeypatch.context() as patched:
        patched.setattr(Simulation, "step", step)
        done = CliRunner().invoke(
            app, ["reproduce", "--quick", "--other-version", "--jobs", "1", "--out", str(root)]
        )
    assert done.exit_code == 130
    assert "the same command goes on" in done.stderr
    assert not (root / "results.json").exists()
    assert "monza" not in open_journal(root, study.quick(), other_version=True).results
    for file, content in zip(kept, before, strict=True):
        file.write_bytes(content)


def test_an_interrupted_command_says_how_to_go_on(
    tmp_path: FilePath, monkeypatch: pytest.MonkeyPatch
) -> None:
    def stop(*_: Any, **__: Any) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr(study, "reproduce", stop)
    done = CliRunner().invoke(app, ["reproduce", "--out", str(tmp_path)])
    assert done.exit_code == 130
    assert "the same command goes on" in done.stderr
    assert "48 trainings of 40000 updates" in done.stderr


def test_results_of_the_first_version_still_become_sections() -> None:
    file = FilePath(__file__).parents[2] / "results" / "paper" / "results.json"
    made = study.sections(StudyResult.read(file))
    assert len(made) == 9
    assert not made[0].warnings
    assert sum(len(section.findings) for section in made) > 20
