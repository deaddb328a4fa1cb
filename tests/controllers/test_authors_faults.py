"""What authors of controllers do wrong is said in their words: what, where, and the cure."""

from __future__ import annotations

import math
from pathlib import Path as FilePath
from typing import Any

import pytest

import steersman as sm
from steersman.bench.entrants import Entrant
from steersman.bench.results import BenchResult
from steersman.bench.runner import bench
from steersman.bench.suites import quick
from steersman.bench.summary import results
from steersman.config import Component
from steersman.contracts.controller import check
from steersman.report.benchmark import sections

HERE = FilePath(__file__).name
SOLVED = sm.Status.SOLVED


class Mine(sm.Controller):
    """Feedback as it should be."""

    gain: float = sm.param(0.3, "1/m", "Gain.")

    def init(self, vehicle: sm.Vehicle, dt: float) -> Any:
        """The vehicle, whose figures it reads."""
        return vehicle

    def decide(self, state: Any, observation: sm.Observation) -> Any:
        """Lateral and heading error, and the curvature ahead."""
        return self._steer(state, observation), SOLVED, state

    def _steer(self, state: Any, seen: sm.Observation) -> float:
        turn = math.atan(state.wheelbase * self._wanted(seen))
        return float(state.steer_for_wheel_angle(turn, seen.v_x))

    def _wanted(self, seen: sm.Observation) -> float:
        return seen.curvature - 0.02 * seen.lateral_error - 0.2 * seen.heading_error


class Alone(Mine):
    def decide(self, state: Any, observation: sm.Observation) -> Any:
        return -0.5


class NoNumber(Mine):
    def decide(self, state: Any, observation: sm.Observation) -> Any:
        return None, SOLVED, state


class NoStatus(Mine):
    def decide(self, state: Any, observation: sm.Observation) -> Any:
        return 0.0, "fine", state


class Keeps(Mine):
    def decide(self, state: Any, observation: sm.Observation) -> Any:
        self.gain = 1.0  # type: ignore[misc]
        return 0.0, SOLVED, state


class Misspelt(Mine):
    def decide(self, state: Any, observation: sm.Observation) -> Any:
        return -observation.lateral_eror, SOLVED, state  # type: ignore[attr-defined]


class Deeper(Mine):
    """Raises in a library that it calls: the line is its own."""

    def decide(self, state: Any, observation: sm.Observation) -> Any:
        return Component.model_validate({"nosuch": 1}), SOLVED, state


class InInit(Mine):
    def init(self, vehicle: sm.Vehicle, dt: float) -> Any:
        return vehicle.wheelbas  # type: ignore[attr-defined]


EXPECTED = "decide has to return (steer, status, state): return steer, sm.Status.SOLVED, state"


@pytest.mark.parametrize(
    ("controller", "message"),
    [
        (Alone(), f"{EXPECTED} (cannot unpack non-iterable float object)"),
        (NoNumber(), EXPECTED),
        (NoStatus(), f"the status is 'fine'; {EXPECTED}"),
        (Keeps(), "sets self.gain, but one object drives many cars and is frozen: what changes"),
        (Misspelt(), "raised AttributeError: 'Observation' object has no attribute 'lateral_eror'"),
        (Deeper(), "raised ValidationError"),
        (InInit(), "raised AttributeError: 'CarlaModel3' object has no attribute 'wheelbas'"),
    ],
)
def test_the_message_names_fault_and_line(controller: Mine, message: str) -> None:
    with pytest.raises(sm.SteersmanError) as caught:
        sm.drive(controller, path="circle", duration=0.2)
    text = str(caught.value)
    assert f"controller '{type(controller).__name__}'" in text
    assert message in text
    assert "base.py" not in text
    assert (f"({HERE}, line " in text) == ("raised" in message or "sets" in message)
    # The contract, which steps by itself, says the same.
    if not isinstance(controller, InInit):
        assert any(message in finding for finding in check(controller))


class WrongSign(Mine):
    def _wanted(self, seen: sm.Observation) -> float:
        return seen.curvature + 0.02 * seen.lateral_error + 0.2 * seen.heading_error


class WrongBend(Mine):
    def _wanted(self, seen: sm.Observation) -> float:
        return -seen.curvature - 0.02 * seen.lateral_error - 0.2 * seen.heading_error


class Degrees(Mine):
    def _steer(self, state: Any, seen: sm.Observation) -> float:
        turn = math.degrees(math.atan(state.wheelbase * self._wanted(seen)))
        return float(state.steer_for_wheel_angle(turn, seen.v_x))


@pytest.mark.parametrize(
    ("controller", "found"),
    [
        (Mine(), set()),
        (WrongSign(), {"0.5 m left of a straight road", "turned 0.1 rad to the left of"}),
        (WrongBend(), {"on the line of a left bend it steers right"}),
        (Degrees(), {"an angle is in degrees, where rad are meant"}),
    ],
)
def test_signs_and_units_are_found_by_name(controller: Mine, found: set[str]) -> None:
    every = {"left of a straight", "turned 0.1 rad", "on the line of a left", "in degrees"}
    findings = check(controller)
    for words in found:
        assert any(words in each for each in findings), findings
    said = {words for words in every if any(words in each for each in findings)}
    assert len(said) == len(found)
    # What rounding does at full lock is no finding of its own.
    assert not any("elsewhere" in each for each in findings)


@pytest.fixture(scope="module")
def ranked(tmp_path_factory: pytest.TempPathFactory) -> tuple[BenchResult, list[Any]]:
    scenarios = quick().scenarios((1,))[:2]
    who = [
        Entrant(type(one).__name__, one, False, type(one).__name__, 0, 0.0, {})
        for one in (Mine(), Misspelt())
    ]
    rows = bench(scenarios, who, tmp_path_factory.mktemp("bench"), jobs=1)
    return results("quick", quick(), [1], rows, who), rows


def test_a_ranking_says_what_was_raised(ranked: tuple[BenchResult, list[Any]]) -> None:
    found, rows = ranked
    mine, misspelt = (found.summary.controllers[name] for name in ("Mine", "Misspelt"))
    assert mine.failed_words("Mine") is None
    words = misspelt.failed_words("Misspelt")
    assert words is not None
    assert words.startswith("Misspelt: failed in 2 of 2 drives; controller 'Misspelt' raised")
    assert [("error" in row.plain()) for row in rows] == [False, True, False, True]
    assert type(rows[1]).model_validate(rows[1].plain()) == rows[1]
    assert words in sections(found.summary, ())[0].warnings
