"""The runner: deterministic, resumable, the same over processes; failures are kept."""

from __future__ import annotations

import json
import os
import signal
from pathlib import Path as FilePath
from typing import Any

import pytest

from steersman.bench import suites
from steersman.bench.entrants import Entrant, entrants
from steersman.bench.results import BenchRow
from steersman.bench.runner import ROWS, bench, plan, read_rows
from steersman.bench.suite import Scenario, Suite
from steersman.bench.summary import summarise_rows
from steersman.config import build
from steersman.controllers.base import ControllerComponent
from steersman.errors import ConfigError, DataError, SteersmanError
from steersman.types import Observation, Status
from steersman.vehicles import Vehicle

from ..loops import random_policy

SCENARIOS = suites.quick().scenarios((3,))
PAIR = entrants(["pid", "mpc_pid"])


def untimed(rows: list[BenchRow]) -> list[dict[str, Any]]:
    """Without what tells of the machine: computing times, and the commit of a busy work tree."""
    other = ("control_time", "computing_time", "deadline_misses", "commit")
    return [{k: v for k, v in r.plain().items() if not k.startswith(other)} for r in rows]


@pytest.fixture(scope="module")
def rows(tmp_path_factory: pytest.TempPathFactory) -> list[BenchRow]:
    """The quick suite, driven in one process."""
    return bench(SCENARIOS, PAIR, tmp_path_factory.mktemp("bench"), jobs=1)


def test_every_entrant_drives_every_scenario_in_order(rows: list[BenchRow]) -> None:
    assert [(r.scenario, r.controller) for r in rows] == [
        (s.name, e.name) for s in SCENARIOS for e in PAIR
    ]
    plain = [json.loads(json.dumps(row.plain(), allow_nan=False)) for row in rows]
    assert [BenchRow.model_validate(row) for row in plain] == rows


def test_processes_change_nothing_but_the_time(
    rows: list[BenchRow], tmp_path: FilePath, monkeypatch: Any
) -> None:
    monkeypatch.setattr("steersman.engine.jobs._PIECE_JOBS", 5)
    assert untimed(bench(SCENARIOS, PAIR, tmp_path, jobs=2)) == untimed(rows)


def test_an_interrupted_bench_goes_on(
    rows: list[BenchRow], tmp_path: FilePath, monkeypatch: Any
) -> None:
    monkeypatch.setattr("steersman.engine.jobs._PIECE_JOBS", 3)

    def stop(done: float, total: float) -> None:
        if done > 0.3 * total:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        bench(SCENARIOS, PAIR, tmp_path, jobs=1, progress=stop)
    kept = (tmp_path / ROWS).read_bytes()
    assert 0 < kept.count(b"\n") < len(rows)
    # The process was killed while it wrote: half a line is at the end.
    with (tmp_path / ROWS).open("ab") as stream:
        stream.write(b'{"key": "ab')
    told: list[float] = []
    again = bench(
        SCENARIOS, PAIR, tmp_path, jobs=1, progress=lambda done, total: told.append(done / total)
    )
    assert untimed(again) == untimed(rows)
    assert told[0] > 0.3
    assert told[-1] == pytest.approx(1.0)
    assert (tmp_path / ROWS).read_bytes().startswith(kept)


class Deadly(ControllerComponent):
    """Ends its process, as the system does for want of memory."""

    parent: int

    def init(self, vehicle: Vehicle, dt: float) -> int:
        return 0

    def decide(self, state: int, observation: Observation) -> tuple[float, Status, int]:
        if os.getpid() != self.parent:
            os.kill(os.getpid(), signal.SIGKILL)
        return 0.0, Status.SOLVED, state


def test_a_killed_process_is_told_in_a_line(tmp_path: FilePath, monkeypatch: Any) -> None:
    monkeypatch.setattr("steersman.engine.jobs._PIECE_JOBS", 5)
    monkeypatch.syspath_prepend(FilePath(__file__).parents[2])  # where the class is found
    deadly = Entrant("deadly", Deadly(parent=os.getpid()), False, "deadly", 0, 0.0, {})
    with pytest.raises(SteersmanError, match=r"SIGKILL.*; the same command goes on"):
        bench(SCENARIOS, [deadly], tmp_path, jobs=2)


def test_what_is_finished_is_not_driven_again(rows: list[BenchRow], tmp_path: FilePath) -> None:
    first = bench(SCENARIOS, PAIR[:1], tmp_path, jobs=1)
    before = (tmp_path / ROWS).read_bytes()
    told: list[float] = []
    both = bench(SCENARIOS, PAIR, tmp_path, jobs=1, progress=lambda done, _: told.append(done))
    assert (tmp_path / ROWS).read_bytes().startswith(before)
    assert [r for r in both if r.controller == "pid"] == first  # times included
    assert bench(SCENARIOS, PAIR, tmp_path, jobs=1) == both
    renamed = bench(SCENARIOS, entrants(["other=pid"]), tmp_path, jobs=1)
    assert [r.controller for r in renamed] == ["other"] * len(SCENARIOS)
    assert [r.charged_rms_m for r in renamed] == [r.charged_rms_m for r in first]


def test_a_key_changes_with_the_scenario_and_the_controller() -> None:
    tasks = plan([*SCENARIOS, *suites.quick().scenarios((4,))], PAIR)
    assert len({task.key for task in tasks}) == len(tasks)


def test_a_journal_of_something_else_is_refused(rows: list[BenchRow], tmp_path: FilePath) -> None:
    kept = json.dumps(rows[0].plain()) + "\n"
    (tmp_path / ROWS).write_text(kept + "nonsense\n", encoding="utf-8")
    with pytest.raises(DataError, match="line 2: not a row"):
        read_rows(tmp_path)


def test_an_unknown_engine_is_refused(tmp_path: FilePath) -> None:
    with pytest.raises(ConfigError, match="unknown engine 'locl'; did you mean 'local'"):
        bench(SCENARIOS, PAIR, tmp_path, engine="locl")


# --------------------------------------------------------------------------------- failures


class Failing(ControllerComponent):
    """Raises after half a second, or steers off the road."""

    raises: bool = True

    def init(self, vehicle: Vehicle, dt: float) -> int:
        return 0

    def decide(self, state: int, observation: Observation) -> tuple[float, Status, int]:
        if state >= 10 and self.raises:
            raise ZeroDivisionError("of no use")
        return (0.1 if state >= 10 else 0.0), Status.SOLVED, state + 1


def failing(*, raises: bool) -> Entrant:
    return Entrant("failing", Failing(raises=raises), False, f"failing {raises}", 0, 0.0, {})


@pytest.mark.parametrize(("raises", "end"), [(True, "error"), (False, "off_track")])
def test_who_fails_is_charged_and_not_dropped(tmp_path: FilePath, raises: bool, end: str) -> None:
    suite = build(
        Suite,
        {"courses": {"a": {"path": "straight", "speeds": {"s": "constant_speed"}, "duration": 10}}},
    )
    (row,) = bench(suite.scenarios(), [failing(raises=raises)], tmp_path, jobs=1)
    assert row.end == end
    assert row.completed is False
    assert 0.0 < row.driven_share < 0.5
    assert row.charged_rms_m > 1.5 * 0.5**0.5
    assert row.charged_p95_m == row.charged_max_m == 1.5
    found = summarise_rows([row], [failing(raises=raises)]).controllers["failing"]
    assert found.failures == 1
    assert found.ends == {end: 1}
    assert found.all.rms_m.value == pytest.approx(row.charged_rms_m)


# --------------------------------------------------------------------------------- policies


def test_a_policy_gets_the_waypoints_it_reads(tmp_path: FilePath) -> None:
    (one,) = entrants([str(random_policy(tmp_path / "trained"))])
    far = one._replace(waypoints=25, digest="far")
    rows = bench(SCENARIOS[:1], [one, far], tmp_path, jobs=1)
    assert [r.controller for r in rows] == ["trained", "trained"]
    tasks = plan(SCENARIOS[:1], [one, far])
    assert tasks[0].key != tasks[1].key


def test_a_policy_for_another_period_is_refused_before_anything_runs(tmp_path: FilePath) -> None:
    (one,) = entrants([str(random_policy(tmp_path / "trained"))])
    scenario = SCENARIOS[0]
    plant = scenario.run.plant.model_copy(update={"dt": 0.02})
    other: Scenario = scenario._replace(run=scenario.run.model_copy(update={"plant": plant}))
    with pytest.raises(ConfigError, match=r"trained: .*control period of 0\.05 s"):
        bench([other], [one], tmp_path / "out", jobs=1)
    assert not (tmp_path / "out" / ROWS).exists()
