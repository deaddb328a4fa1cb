"""Features: what each declares, and what is made of the declaration."""

from __future__ import annotations

import math
import shutil
import subprocess
from pathlib import Path as FilePath

import numpy as np
import pytest
from numba.core import caching

from steersman.config import build, components
from steersman.contracts.feature import check, drive, mirrored_rows, scenes
from steersman.contracts.reward import check as check_term
from steersman.contracts.task import check as check_task
from steersman.controllers.card import card_layout
from steersman.delivery.translate.policies import placed_formula
from steersman.delivery.translate.program import Program
from steersman.delivery.translate.values import INT, Array, NotTranslatable, Scalar, Value
from steersman.encoding import EncodingComponent, FeatureList, Layout
from steersman.errors import ConfigError
from steersman.features.base import Feature, Loop
from steersman.features.motion import SpeedAcross, YawRateError
from steersman.features.road import RoadAccelerations, RoadCurvatures, Waypoints
from steersman.kernels import observe
from steersman.kernels.formula import Formula, Group, call, compiled
from steersman.learning.rewards import FunctionTerm, Judged, RewardTerm
from steersman.learning.task import PaperTask, TaskComponent
from steersman.policy_file import locate, read_policy, shipped
from steersman.types import Observation

FEATURES = [build(cls, {}) for cls in components("feature").values()]
TERMS = [build(cls, {}) for k, cls in components("reward").items() if k != "function"]
TASKS = [build(cls, {}) for cls in components("task").values()]


@pytest.mark.parametrize("feature", FEATURES, ids=lambda f: f.kind)
def test_every_feature_fulfils_its_contract(feature: Feature) -> None:
    assert check(feature) == []


@pytest.mark.parametrize("term", TERMS, ids=lambda t: t.kind)
def test_every_reward_term_fulfils_its_contract(term: RewardTerm) -> None:
    assert check_term(term) == []


@pytest.mark.parametrize("task", TASKS, ids=lambda t: t.kind)
@pytest.mark.parametrize("demonstration", ["none", "fixed", "adaptive"])
def test_every_task_is_the_sum_of_its_terms(task: TaskComponent, demonstration: str) -> None:
    function = FunctionTerm(function=lambda step: -abs(step.yaw_rate))
    changes = {"demonstration": demonstration, "c_change": 2.0, "terms": (*TERMS, function)}
    # A Python function cannot be loaded from plain data, which the contract's first check needs.
    summed = task.model_copy(update=changes)
    assert [text for each in check_task.checks for text in each(summed)] == []


@pytest.mark.parametrize("name", shipped())
def test_a_shipped_policys_names_and_scales_are_those_of_today(name: str) -> None:
    _, card = read_policy(locate(name))
    layout = card_layout(card)
    assert card.observation == layout.names
    assert card.scale == layout.scale.tolist()


def test_all_features_together_mirror_and_have_distinct_names() -> None:
    layout = Layout(tuple(FEATURES), 2.0, 0.05)
    assert len(set(layout.names)) == len(layout.names) == len(layout.scale) == len(layout.mirror)
    rows, commands = scenes(layout.reads, 2.0)
    left, right = drive(layout, rows, commands), drive(layout, mirrored_rows(rows), -commands)
    assert right == pytest.approx(left * layout.mirror, abs=1e-9)


def test_the_road_asks_for_its_curvature_times_the_speed_squared() -> None:
    """And what the car does beyond that turn is zero in it."""
    curvatures, accelerations = RoadCurvatures(count=4), RoadAccelerations(count=4)
    rows, commands = scenes(7, 2.0)
    rows[:, observe.O_RATE] = rows[:, observe.O_VX] * rows[:, observe.O_KAPPA]
    rows[:, observe.O_VY] = -rows[:, observe.O_VX] * rows[:, observe.O_HEADING]
    parts = curvatures, accelerations, YawRateError(), SpeedAcross()
    made = drive(Layout(parts, 2.0, 0.05), rows, commands)
    square = rows[:, [observe.O_VX]] ** 2
    assert made[:, 4:8] == pytest.approx(made[:, :4] * square, abs=1e-9)
    assert made[:, 8:] == pytest.approx(np.zeros((len(made), 2)), abs=1e-9)


def test_any_list_of_features_is_an_encoding() -> None:
    encoding = build(FeatureList, {"features": ["yaw_rate", {"kind": "past_errors", "count": 2}]})
    layout = encoding.layout(2.0, 0.05, "residual")
    assert layout.names == [
        "yaw_rate [rad/s]", "lateral_error_1_ago [m]", "lateral_error_2_ago [m]",
        "last_command [-]", "base_command_less_last [-]",
    ]  # fmt: skip


@pytest.mark.parametrize(
    ("features", "fault"),
    [
        (["yaw_rate", "yaw_rate"], r"yaw_rate \[rad/s\] is there twice"),
        (["base_command_less_last"], "is added where a base is corrected"),
        (["yaw_rat"], "unknown feature 'yaw_rat'; did you mean 'yaw_rate'"),
        ([], "at least 1"),
    ],
)
def test_a_list_that_makes_no_sense_is_refused(features: list[str], fault: str) -> None:
    with pytest.raises(ConfigError, match=fault):
        build(FeatureList, {"features": features})


class Wrong(Feature):
    """Declares the wrong sign, and keeps a constant."""

    sign = 1.0

    def value(self, seen: Observation) -> float:
        """Lateral error [m]."""
        return 1e4 * seen.lateral_error


class Unknown(Feature):
    """Reads what there is not."""

    def value(self, seen: Observation) -> float:
        """Nothing."""
        return seen.weather  # type: ignore[attr-defined,no-any-return]


class Generous(RewardTerm):
    """Prefers the left and ignores its weight."""

    def value(self, step: Judged) -> float:
        """Steering."""
        return step.steer


def test_contracts_name_what_is_wrong() -> None:
    found = "; ".join(check(Wrong()))
    assert "does not turn as its sign says" in found
    assert "is of size" in found
    assert "there is no seen.weather; " in check(Unknown())[0]
    found = "; ".join(check_term(Generous()))
    assert "prefers one side" in found
    assert "does not double with its weight" in found
    task = PaperTask().model_copy(update={"terms": (Generous(),)})
    assert any("prefers one side" in finding for finding in check_task(task))


# ---------------------------------------------------------------------------------- C code


GROUPS = {
    "seen": Group({"v_x": 2}),
    "loop": Group({"dt": 3}),
    "self": Group({}),
    "memory": Group({}),
}


def toy(seen: Observation, loop: Loop, i: int) -> float:
    """Branches, names, and functions of math."""
    a = math.atan2(seen.v_x, 2.0) if i > 1 and not seen.v_x > 100.0 else -math.pi
    if i % 2 == 0 or seen.v_x < loop.dt:
        a = a + seen.v_x**2
    else:
        a = min(a, seen.v_x, 0.5) - max(seen.v_x, float(i))
    return abs(a) * math.hypot(a, 1.0) / (1.0 + math.exp(-a))


def in_c(formula: Formula) -> tuple[Program, str]:
    """The formula as a C function of a row, a memory, and an index."""
    program = Program(single=True)
    given: dict[str, Value] = {name: Array(name, (4,)) for name in GROUPS}
    made = program.function(placed_formula(formula.address), {**given, "i": Scalar("i", INT)})
    return program, made.name


@pytest.mark.skipif(shutil.which("cc") is None, reason="no C compiler")
def test_a_formula_in_c_is_the_formula(tmp_path: FilePath) -> None:
    program, name = in_c(compiled(toy, GROUPS))
    cases = [(x, i) for x in (-3.0, -0.02, 0.0, 0.7, 150.0) for i in range(4)]
    calls = "".join(
        f'row[2] = {x}f; memory[3] = 0.05f; printf("%.9g ", {name}(0, row, memory, row, row, {i}));'
        for x, i in cases
    )
    text = f"""#include <math.h>
#include <stdio.h>
typedef float real;
typedef int parameters;
{"".join(program.helpers.values())}{"".join(each.text for each in program.functions.values())}
int main(void) {{ real row[4] = {{0}}, memory[4] = {{0}}; {calls} return 0; }}
"""
    (tmp_path / "toy.c").write_text(text)
    command = ["cc", "-std=c99", "-o", str(tmp_path / "toy"), str(tmp_path / "toy.c"), "-lm"]
    subprocess.run(command, check=True)
    said = subprocess.run([str(tmp_path / "toy")], check=True, capture_output=True, text=True)
    seen = Observation(*[0.0] * 8, preview=np.zeros((1, 2)), spacing=2.0)

    class Now:
        dt = 0.05

    expected = [toy(seen._replace(v_x=x), Now(), i) for x, i in cases]  # type: ignore[arg-type]
    assert [float(x) for x in said.stdout.split()] == pytest.approx(expected, rel=1e-5)


def loops(seen: Observation) -> float:
    """What has no C."""
    return float(np.cbrt(seen.v_x))


def test_what_has_no_c_is_refused_with_its_line() -> None:
    with pytest.raises(NotTranslatable, match="a call of cbrt") as caught:
        in_c(compiled(loops, GROUPS))
    assert "test_features.py" in caught.value.where  # type: ignore[attr-defined]


@pytest.mark.parametrize("encoding", [*components("encoding").values()], ids=lambda e: e.kind)
def test_every_encoding_is_made_of_registered_features(encoding: type[EncodingComponent]) -> None:
    for feature in build(encoding, {}).layout(2.0, 0.05, "residual").features:
        assert type(feature) is components("feature")[feature.kind]
    assert Waypoints(count=3).reads == 3


@pytest.mark.parametrize("fault", ["no folder", "a folder that cannot be written"])
def test_a_formula_is_compiled_without_a_cache(fault: str, monkeypatch: pytest.MonkeyPatch) -> None:
    def denied(*_: object) -> None:
        raise PermissionError(13, "Permission denied")

    if fault == "no folder":
        monkeypatch.setattr(caching.CompileResultCacheImpl, "_locator_classes", [])
    else:
        monkeypatch.setattr(caching.IndexDataCacheFile, "save", denied)
    place = {"no folder": 1, "a folder that cannot be written": 2}[fault]  # not compiled before
    groups = {"loop": Group({"dt": place})}

    def doubled(loop: Loop) -> float:
        return 2.0 * loop.dt

    row = np.arange(3.0)
    formula = compiled(doubled, groups)
    assert call(formula.address, row, row, row, 0, 0, 0) == 2.0 * place


@pytest.mark.parametrize(
    "kind", [k for k, cls in components("feature").items() if "count" in cls.model_fields]
)
def test_a_count_that_would_fill_the_memory_is_refused(kind: str) -> None:
    with pytest.raises(ConfigError, match=r"count.*must be at most"):
        build(components("feature")[kind], {"count": 777_777_777})
