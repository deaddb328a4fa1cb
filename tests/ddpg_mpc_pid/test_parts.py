"""Finished parts of a plan as one study."""

from __future__ import annotations

from pathlib import Path as FilePath
from typing import Any

import pytest
from typer.testing import CliRunner

import ddpg_mpc_pid as study
from ddpg_mpc_pid.parts import join, joined
from ddpg_mpc_pid.plan import METHODS
from ddpg_mpc_pid.results import CircleResult, LearningCurves, StudyResult
from ddpg_mpc_pid.savings import compared
from ddpg_mpc_pid.study import CURVE_DIGITS, plain, write_results
from steersman.cli import app
from steersman.errors import ConfigError, DataError

RECORD = FilePath(__file__).parents[2] / "results" / "paper" / "results.json"
CUTS = [
    (("ddpg", "reward"), ("adaptive", "both", "direct")),
    (("adaptive",), ("direct", "ddpg"), ("precise",)),
]


def part(whole: StudyResult, methods: tuple[str, ...], **other: Any) -> StudyResult:
    """What a study of some of the methods alone would have found."""
    labels = {METHODS[name].label for name in METHODS if name not in methods}
    tests = [
        test.model_copy(
            update={"drivers": {k: v for k, v in test.drivers.items() if k not in labels}}
        )
        for test in whole.circle.tests
    ]
    chosen = {name: whole.learning.methods[name] for name in METHODS if name in methods}
    learning = compared(chosen, whole.learning.steps, whole.plan["repetitions"])
    plan = {
        **whole.plan,
        "methods": list(chosen),
        "training_methods": {name: METHODS[name]._asdict() for name in chosen},
        "trainings": [n for n in whole.plan["trainings"] if n.partition("/")[0] in chosen],
        **other,
    }
    update = {"plan": plan, "circle": CircleResult(tests=tests), "learning": learning}
    return whole.model_copy(update=update)


@pytest.mark.parametrize("cut", CUTS)
def test_a_study_cut_into_parts_and_joined_is_that_study(cut: tuple[tuple[str, ...], ...]) -> None:
    record = StudyResult.read(RECORD)
    whole = part(record, tuple(name for methods in cut for name in methods))
    parts = {f"part {k}": part(whole, methods) for k, methods in enumerate(cut)}
    assert any(row.method != row.alone for row in whole.learning.savings)
    again = joined(parts)
    assert again.learning == LearningCurves(**plain(whole.learning, CURVE_DIGITS))
    assert list(again.learning.methods) == list(whole.learning.methods)
    assert again.circle == whole.circle
    assert [list(test.drivers) for test in again.circle.tests] == [
        list(test.drivers) for test in whole.circle.tests
    ]
    for name in ("robustness", "monza", "away", "timing", "made_by", "versions"):
        assert getattr(again, name) == getattr(whole, name)
    assert sorted(again.plan["trainings"]) == sorted(whole.plan["trainings"])
    assert [one["methods"] for one in again.plan["parts"]] == [
        one.plan["methods"] for one in parts.values()
    ]
    assert len(study.sections(again)) == len(study.sections(whole))
    first, *others = parts.items()
    step_by_step = joined({first[0]: first[1]})
    for name, other in others:
        step_by_step = joined({"joined": step_by_step, name: other})
    assert step_by_step.learning == again.learning
    assert step_by_step.plan == again.plan


def test_the_agents_are_those_of_the_part_that_trained_them() -> None:
    whole = StudyResult.read(RECORD)
    other = part(whole, ("ddpg",)).model_copy(
        update={
            "timing": whole.timing.model_copy(update={"lap_steps": 1}),
            "made_by": ["another"],
            "versions": {**whole.versions, "numpy": "9.9"},
        }
    )
    found = joined({"a": other, "b": part(whole, ("adaptive",))})
    assert found.timing == whole.timing
    assert set(found.made_by) == {"another", *whole.made_by}
    assert found.versions["numpy"] == f"9.9, {whole.versions['numpy']}"


def test_parts_that_do_not_go_together_are_refused(tmp_path: FilePath) -> None:
    whole = StudyResult.read(RECORD)
    ddpg, both = part(whole, ("ddpg",)), part(whole, ("both",))
    with pytest.raises(ConfigError, match=r"a and b both train 'ddpg'"):
        joined({"a": ddpg, "b": part(whole, ("both", "ddpg"))})
    for methods in (("both",), ("both", "ddpg")):
        other = part(whole, methods, circle_seconds=2.0)
        with pytest.raises(ConfigError, match=r"b is of another plan than a: circle_seconds"):
            joined({"a": ddpg, "b": other})
    write_results(both, tmp_path)
    with pytest.raises(ConfigError, match="is given twice"):
        join([tmp_path, tmp_path / "x" / ".."], tmp_path / "out")


def test_a_folder_that_is_no_part_is_named(tmp_path: FilePath) -> None:
    (tmp_path / "empty").mkdir()
    (tmp_path / "other").mkdir()
    (tmp_path / "other" / "results.json").write_text("{}", encoding="utf-8")
    for name, words in (
        ("none", "no such folder; give folders that steersman reproduce wrote"),
        ("empty", "no results.json in it"),
        ("other/results.json", "no such folder"),
        ("other", "not a study of steersman reproduce"),
    ):
        with pytest.raises(DataError, match=words):
            join([tmp_path / name], tmp_path / "out")


def test_nothing_else_is_written_over(tmp_path: FilePath) -> None:
    folder, out = tmp_path / "part", tmp_path / "out"
    for made in (folder, out):
        made.mkdir()
    write_results(part(StudyResult.read(RECORD), ("both",)), folder)
    other = tmp_path / "other"
    other.mkdir()
    (other / "results.json").write_text("{}", encoding="utf-8")
    for root in (folder, tmp_path, other):
        with pytest.raises(DataError, match=r"--out .*holds something else"):
            join([folder], root)
    assert join([folder], out) == join([folder], out)


def test_the_command_joins_and_writes_the_page(tmp_path: FilePath) -> None:
    whole = StudyResult.read(RECORD)
    folders = []
    for name in ("ddpg", "adaptive"):
        folders.append(tmp_path / name)
        folders[-1].mkdir()
        write_results(part(whole, (name,)), folders[-1])
    out, both = tmp_path / "out", ",".join(map(str, folders))
    done = CliRunner().invoke(app, ["reproduce", "--join", both, "--out", str(out)])
    assert done.exit_code == 0, done.output
    found = StudyResult.read(out / "results.json")
    assert found.plan["methods"] == ["ddpg", "adaptive"]
    assert (out / "report.html").exists()
    assert "| DDPG alone |" in (out / "tables" / "methods.md").read_text(encoding="utf-8")


@pytest.mark.parametrize("words", [["--quick"], ["--published"], ["--seeds", "2"]])
def test_what_the_parts_decide_is_not_given_with_them(tmp_path: FilePath, words: list[str]) -> None:
    done = CliRunner().invoke(
        app, ["reproduce", "--join", str(tmp_path), *words, "--out", str(tmp_path / "out")]
    )
    assert done.exit_code == 2
    assert f"leave out {words[0]}" in done.stderr
    assert not (tmp_path / "out").exists()
